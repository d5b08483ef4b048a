//! A trained garment in somebody else's program: ready once, then frame by frame.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use muslin_body::{Bone, Follower, Pose, place_bones};
use muslin_model::{Model, Player};

use crate::animate::{
    as_trained, decode_model, fits, model_failure, note_of, others, wants_character,
};
use crate::brought::{is_file, standing_in};
use crate::drape::cloth;
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of, body_note};
use crate::options::DressOptions;
use crate::outfit::WARDROBE;
use crate::simulate::SimulateOptions;
use crate::swings;
use crate::wardrobe;

/// A garment on our own body or on a character, as its model predicts it: a frame takes no memory, reads no file and is
/// not checked.
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
    character: Option<Led>,
}

/// A character, whose joints lead our body.
#[derive(Debug)]
struct Led {
    names: Vec<String>,
    /// `world_from_joint` of every joint as the character was bound, in its own places.
    bound: Vec<[f32; 16]>,
    follower: Follower,
    ours_from_file: DAffine3,
    file_from_ours: DAffine3,
    /// Where its joints are, in our places.
    joints: Vec<DAffine3>,
}

impl Led {
    fn new(hero: &Hero) -> Self {
        let file_from_ours = hero.ours_from_file.inverse();
        let bound = hero.twin.stance().iter().map(|j| {
            let place = DMat4::from(file_from_ours * *j);
            place.to_cols_array().map(|x| x as f32)
        });
        Self {
            names: hero.character.names.clone(),
            bound: bound.collect(),
            follower: hero.twin.follower(),
            ours_from_file: hero.ours_from_file,
            file_from_ours,
            joints: hero.twin.stance().to_vec(),
        }
    }

    /// From our places to the character's.
    fn give_back(&self, at: &mut [[f32; 3]], normals: &mut [[f32; 3]]) {
        let (m, t) = (
            self.file_from_ours.matrix3.as_mat3(),
            self.file_from_ours.translation.as_vec3(),
        );
        for p in at {
            *p = (m * Vec3::from_array(*p) + t).to_array();
        }
        for n in normals {
            *n = (m * Vec3::from_array(*n)).normalize_or_zero().to_array();
        }
    }
}

/// What a model is worn with, as it was taught and as is asked for. A model names files of its garment and its fabric as
/// they were called where it was taught: who plays it says where they are.
fn worn_as(model: &Model, options: &DressOptions) -> Result<DressOptions, Failure> {
    let asked = SimulateOptions {
        dress: options.clone(),
        ..SimulateOptions::default()
    };
    let mut dress = as_trained(std::slice::from_ref(model), &asked)?.dress;
    dress.check()?;
    let named = options.outfit.first();
    let (garment, fabric) = (note_of(model, "garment"), note_of(model, "fabric"));
    let other = |what: &str, hint: &str| {
        let fault = Failure::new(Exit::Invalid, "not-of-the-wardrobe", what);
        Err(fault.hint(hint))
    };
    if !WARDROBE.iter().any(|e| e.name == garment) {
        match named.filter(|w| is_file(&w.garment)) {
            Some(wear) => dress.outfit[0].garment.clone_from(&wear.garment),
            None => {
                let what = "a model of a garment from a file";
                return other(what, "name that file as the garment");
            }
        }
    }
    if fabric::is_file(fabric) && named.is_none_or(|w| w.fabric.is_none()) {
        let what = "a model in a fabric from a file";
        return other(what, "name that file, or another, as the fabric");
    }
    Ok(dress)
}

/// Seconds from frame to frame: until they are said, and within what they may be.
const STEP: f64 = 1.0 / 30.0;
const STEPS: std::ops::RangeInclusive<f64> = 1e-4_f32 as f64..=10.0;

impl Playing {
    /// The model in these bytes of a `.muslin` file, or without bytes that of the first garment of the options in
    /// the wardrobe, on somebody of their height, weight and gender, or on their character, in their size and fabric.
    /// Where the model is of a garment from a file, that is the options' first garment.
    pub fn new(bytes: Option<&[u8]>, options: &DressOptions) -> Result<Self, Failure> {
        let model = match bytes {
            Some(bytes) => decode_model("the model", bytes)?,
            None => wardrobe::model(options.outfit.first().map_or("", |w| &w.garment))?,
        };
        wants_character(&model, options.body.is_some())?;
        let dress = worn_as(&model, options)?;
        let hero = Hero::load(&dress)?;
        let avatar = avatar_of(hero.as_ref())?;
        let (figure, outfit, worn) = standing_in((&avatar, hero.as_ref()), &dress)?;
        let cloth = cloth(&outfit, &worn);
        fits(&model, &outfit.pieces[0].garment)?;
        let stranger = others((0, &model), &dress, &body_note(hero.as_ref()))?.contains(&true);
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
            character: hero.as_ref().map(Led::new),
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

    /// The joints of the character that wears it, as its file names them; none of our own body.
    pub fn character_joints(&self) -> &[String] {
        self.character.as_ref().map_or(&[], |c| &c.names)
    }

    /// Where the character's joints are as it was bound: `world_from_joint`, column after column, in the places and the
    /// unit of its file.
    pub fn character_bound(&self) -> &[[f32; 16]] {
        self.character.as_ref().map_or(&[], |c| &c.bound)
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
    /// body is moved [m]; of a character that is our body in its likeness. None where one of these or of what comes out
    /// is not finite, or a turn is nothing; the sequence then begins anew.
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

    /// The cloth where the character's joints are next: `world_from_joint` of each, column after column as glTF has its
    /// matrices, in the places and the unit of its file, in which the cloth is as well. None on our own body, and as in
    /// [`Playing::frame`].
    ///
    /// Turns are taken, and places, also where joints move apart; of joints that lead no bone of ours (fingers, sockets)
    /// nothing is.
    ///
    /// # Panics
    /// Where `joints` has not one entry per joint.
    pub fn frame_on(&mut self, joints: &[[f32; 16]]) -> Option<&[[f32; 3]]> {
        self.follow(joints, false)?;
        Some(&self.at)
    }

    /// [`Playing::frame_on`], and then the unit normal of every vertex.
    ///
    /// # Panics
    /// Where `joints` has not one entry per joint.
    pub fn frame_on_with_normals(&mut self, joints: &[[f32; 16]]) -> Option<[&[[f32; 3]]; 2]> {
        self.follow(joints, true)?;
        Some([&self.at, &self.normals])
    }

    /// Nothing where something is not finite.
    fn follow(&mut self, joints: &[[f32; 16]], normals: bool) -> Option<()> {
        let led = self.character.as_mut()?;
        assert_eq!(joints.len(), led.joints.len(), "a place per joint");
        let place = |j: usize| DMat4::from_cols_array(&joints[j].map(f64::from));
        let is_sound = |j: usize| place(j).is_finite() && place(j).determinant().abs() > 1e-30;
        // What leads no bone may be scaled to nothing, as what is hidden is.
        if !led.follower.leading().all(is_sound) {
            return self.anew();
        }
        let led = self.character.as_mut()?;
        for j in led.follower.leading() {
            led.joints[j] = led.ours_from_file * DAffine3::from_mat4(place(j));
        }
        led.follower.follow(&led.joints, &mut self.pose);
        self.lay(normals)?;
        let normals = if normals {
            &mut self.normals[..]
        } else {
            &mut []
        };
        if let Some(led) = &self.character {
            led.give_back(&mut self.at, normals);
        }
        Some(())
    }

    /// Nothing where something is not finite.
    fn predict(&mut self, turns: &[[f32; 4]], root: [f32; 3], normals: bool) -> Option<()> {
        assert_eq!(turns.len(), self.pose.rotations.len(), "a turn per bone");
        let sound = |q: &[f32; 4]| {
            let sum: f32 = q.iter().map(|x| x * x).sum();
            sum.is_finite() && sum > 1e-12
        };
        if !turns.iter().all(sound) || !root.iter().all(|x| x.is_finite()) {
            return self.anew();
        }
        for (to, q) in self.pose.rotations.iter_mut().zip(turns) {
            *to = DQuat::from_array(q.map(f64::from)).normalize();
        }
        self.pose.root = DVec3::from_array(root.map(f64::from));
        // Joints that have moved apart did so on a character's skeleton.
        self.pose.shifts.clear();
        self.lay(normals)
    }

    /// The cloth in the pose that is set; nothing where it is not finite.
    fn lay(&mut self, normals: bool) -> Option<()> {
        place_bones((&self.rig, &self.joints), &self.pose, &mut self.bones);
        match normals {
            true => {
                let out = (&mut self.at[..], &mut self.normals[..]);
                self.player.frame_with_normals(&self.pose, &self.bones, out);
            }
            false => self.player.frame(&self.pose, &self.bones, &mut self.at),
        }
        if !self.at.as_flattened().iter().all(|x| x.is_finite()) {
            return self.anew();
        }
        Some(())
    }

    /// Nothing, and the sequence begins anew.
    fn anew(&mut self) -> Option<()> {
        self.player.begin(self.step);
        None
    }
}
