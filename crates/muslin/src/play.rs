//! A trained garment in somebody else's program: ready once, then frame by frame.

use glam::{DAffine3, DQuat, DVec3};
use muslin_body::{Avatar, Bone, Pose, place_bones};
use muslin_model::Player;

use crate::animate::{as_trained, decode_model, fits, model_failure, note_of, others};
use crate::drape::{cloth, standing_in};
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::hero::OURS;
use crate::options::DressOptions;
use crate::outfit::WARDROBE;
use crate::simulate::SimulateOptions;
use crate::swings;
use crate::wardrobe;

/// A garment on our own body, as its model predicts it: a frame takes no memory, reads no file and is not
/// checked.
#[derive(Debug)]
pub struct Playing {
    /// The rig, and where its bones turn at rest [m].
    rig: Vec<Bone>,
    joints: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    player: Player,
    pose: Pose,
    bones: Vec<DAffine3>,
    /// Where the cloth was predicted last [m], and its normals, where they were asked for.
    at: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    step: f64,
}

/// Seconds from frame to frame: until they are said, and within what they may be.
const STEP: f64 = 1.0 / 30.0;
const STEPS: std::ops::RangeInclusive<f64> = 1e-4..=10.0;

impl Playing {
    /// The model in these bytes of a `.muslin` file, or without bytes that of the first garment of the options in
    /// the wardrobe, on somebody of their height, weight and gender, in their size and fabric.
    pub fn new(bytes: Option<&[u8]>, options: &DressOptions) -> Result<Self, Failure> {
        let model = match bytes {
            Some(bytes) => decode_model("the model", bytes)?,
            None => wardrobe::model(options.outfit.first().map_or("", |w| &w.garment))?,
        };
        let note = |name: &str| note_of(&model, name);
        if !["", OURS].contains(&note("body")) || options.body.is_some() {
            let what = "models of characters are not played here";
            return Err(Failure::new(Exit::Usage, "no-character", what)
                .hint("take a model of our own body, or `muslin animate --body`"));
        }
        if !WARDROBE.iter().any(|e| e.name == note("garment")) || fabric::is_file(note("fabric")) {
            let what = "a model of a garment or a fabric from a file";
            return Err(Failure::new(Exit::Invalid, "not-of-the-wardrobe", what)
                .hint("play it with `muslin animate`, which reads the file as well"));
        }
        let asked = SimulateOptions {
            dress: options.clone(),
            ..SimulateOptions::default()
        };
        let dress = as_trained(std::slice::from_ref(&model), &asked)?.dress;
        dress.check()?;
        let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
        let (figure, outfit, worn) = standing_in(&avatar, &dress)?;
        let cloth = cloth(&outfit, &worn);
        fits(&model, &outfit.pieces[0].garment)?;
        let stranger = others((0, &model), &dress, OURS)?.contains(&true);
        let body = (&avatar, &figure);
        let mut model = wardrobe::around(model, body, (&outfit, 0, &worn[0].verts))?;
        if swings::are_ours(&model) && (stranger || model.sway.is_none()) {
            model = swings::swinging(model, body, &cloth)?;
        }
        let player = Player::new(&model, &avatar).map_err(|e| model_failure(&e))?;
        Ok(Self {
            pose: Pose::rest(&avatar),
            bones: Vec::with_capacity(avatar.rig().n_bones()),
            at: vec![[0.0; 3]; player.n_verts()],
            normals: vec![[0.0; 3]; player.n_verts()],
            step: STEP,
            faces: model.faces,
            player,
            rig: avatar.rig().bones.clone(),
            joints: figure.joints,
        })
    }

    /// Triangles of the cloth.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// How many vertices a frame has.
    pub fn n_verts(&self) -> usize {
        self.player.n_verts()
    }

    /// The bones that poses are of, parents before their children.
    pub fn bones(&self) -> &[Bone] {
        &self.rig
    }

    /// Where each bone turns in the rest pose of who wears it [m].
    pub fn joints(&self) -> &[DVec3] {
        &self.joints
    }

    /// Starts a sequence of frames `step` seconds apart, a ten-thousandth to ten, else as before: the body comes to
    /// the first without motion.
    pub fn begin(&mut self, step: f64) {
        if STEPS.contains(&step) {
            self.step = step;
        }
        self.player.begin(self.step);
    }

    /// How much motion counts, 0 (as if the body stood still) to 10, 1 as in nature; others, and models that do
    /// not tell motion from the pose, stay as they are.
    pub fn set_motion_level(&mut self, level: f32) {
        if (0.0..=10.0).contains(&level) {
            self.player.set_motion_level(level);
        }
    }

    /// The cloth [m] in the next pose: a turn of every bone in its parent's frame (x, y, z, w), and how far the
    /// body is moved [m]. None where one of these or of what comes out is not finite, or a turn is nothing; the
    /// sequence then begins anew.
    ///
    /// # Panics
    /// Where `turns` has not one entry per bone.
    pub fn frame(&mut self, turns: &[[f32; 4]], root: [f32; 3]) -> Option<&[[f32; 3]]> {
        self.predict(turns, root, false)?;
        Some(&self.at)
    }

    /// [`Playing::frame`], and then the unit normal of every vertex.
    ///
    /// # Panics
    /// Where `turns` has not one entry per bone.
    pub fn frame_with_normals(
        &mut self,
        turns: &[[f32; 4]],
        root: [f32; 3],
    ) -> Option<[&[[f32; 3]]; 2]> {
        self.predict(turns, root, true)?;
        Some([&self.at, &self.normals])
    }

    /// Nothing where something is not finite.
    fn predict(&mut self, turns: &[[f32; 4]], root: [f32; 3], normals: bool) -> Option<()> {
        assert_eq!(turns.len(), self.pose.rotations.len(), "a turn per bone");
        let sound = |q: &[f32; 4]| {
            let sum: f32 = q.iter().map(|x| x * x).sum();
            sum.is_finite() && sum > 1e-12
        };
        if !turns.iter().all(sound) || !root.iter().all(|x| x.is_finite()) {
            self.player.begin(self.step);
            return None;
        }
        for (to, q) in self.pose.rotations.iter_mut().zip(turns) {
            *to = DQuat::from_array(q.map(f64::from)).normalize();
        }
        self.pose.root = DVec3::from_array(root.map(f64::from));
        place_bones((&self.rig, &self.joints), &self.pose, &mut self.bones);
        match normals {
            true => {
                let out = (&mut self.at[..], &mut self.normals[..]);
                self.player.frame_with_normals(&self.pose, &self.bones, out);
            }
            false => self.player.frame(&self.pose, &self.bones, &mut self.at),
        }
        if !self.at.as_flattened().iter().all(|x| x.is_finite()) {
            self.player.begin(self.step);
            return None;
        }
        Some(())
    }
}
