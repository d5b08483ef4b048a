//! Pictures of what has been learnt so far: the garment in a few of the poses that it is taught, side by side.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use muslin_body::{Avatar, Motion, Part, Pose};
use muslin_geom::Image;
use muslin_io::{png, write_file};
use muslin_picture::{Ground, Options, Scene, Stage, View};
use muslin_train::Training;

use super::kept::failure;
use super::lessons::Pupil;
use crate::animate::model_failure;
use crate::dress::file_failure;
use crate::failure::Failure;
use crate::look;
use crate::options::Backdrop;
use crate::outfit::Outfit;

/// Poses in a picture.
const POSES: usize = 4;
/// From one figure to the next [m].
const APART: f64 = 1.1;
/// Pixels across and up.
const SIZE: [usize; 2] = [1280, 640];
/// Time that a network with a memory is told to have passed [s].
const TIME: f64 = 0.1;

/// Who is drawn in what, and how often.
pub(super) struct Sketch<'a> {
    pub avatar: &'a Avatar,
    pub pupil: &'a Pupil,
    pub outfit: &'a Outfit,
    /// Evenly chosen of what is taught.
    pub poses: Vec<Pose>,
    /// Steps from one picture to the next.
    pub every: u64,
    pub out: &'a Path,
}

/// Poses that are drawn, evenly spread over those of the motions.
pub(super) fn drawn(motions: &[Motion]) -> Vec<Pose> {
    let all: Vec<&Pose> = motions.iter().flat_map(|m| &m.poses).collect();
    let n = all.len().min(POSES);
    let middle = |k: usize| (2 * k + 1) * all.len() / (2 * n);
    (0..n).map(|k| all[middle(k)].clone()).collect()
}

impl Sketch<'_> {
    /// Writes `NAME.STEP.png` if there is to be one after this step.
    pub fn draw(&self, trainer: &dyn Training, last: u64) -> Result<(), Failure> {
        let step = trainer.steps();
        if !step.is_multiple_of(self.every) && step != last {
            return Ok(());
        }
        let bytes = png(&self.picture(trainer)?);
        let written = write_file(&self.path(step), &bytes);
        written.map(|_| ()).map_err(|e| file_failure(&e))
    }

    fn path(&self, step: u64) -> PathBuf {
        self.out.with_extension(format!("{step:06}.png"))
    }

    fn picture(&self, trainer: &dyn Training) -> Result<Image, Failure> {
        let model = trainer.model(BTreeMap::new());
        let model = model.map_err(|e| failure(&e))?;
        let player = self.pupil.player(model, self.avatar);
        let mut player = player.map_err(|e| model_failure(&e))?;
        let mut at = vec![[0.0f32; 3]; player.n_verts()];
        let mut all = Scene::default();
        for (k, pose) in self.poses.iter().enumerate() {
            let posed = self.avatar.pose(&self.pupil.figure, pose);
            player.begin(TIME);
            player.frame(pose, &posed.bones, &mut at);
            let floor = look::lowest(&posed.verts[self.avatar.part(Part::Body)]);
            let here = DVec3::X * APART * k as f64 - pose.root.with_y(floor);
            let moved = |x: DVec3| x + here;
            let body: Vec<DVec3> = posed.verts.iter().map(|v| moved(*v)).collect();
            let cloth = at.iter().map(|p| moved(DVec3::from(p.map(f64::from))));
            let cloth: Vec<DVec3> = cloth.collect();
            let scene = look::scene(
                (self.avatar, &body),
                self.outfit,
                &cloth,
                Backdrop::default(),
            );
            all.parts.extend(scene.parts);
            all.background = scene.background;
        }
        all.ground = Some(Ground::at(0.0));
        let stage = Stage::new(&all, &Options::quick());
        let [width, height] = SIZE;
        let view = View {
            width,
            height,
            ..View::default()
        };
        Ok(stage.shoot(&stage.frame(&view)))
    }
}
