//! Pictures of a simulation: its last frame, and a film that follows the body.

use glam::{DAffine3, DVec3};
use muslin_geom::Image;
use muslin_io::Clip;
use muslin_picture::{Camera, Ground, Options, Stage};
use rayon::prelude::*;

use crate::look;
use crate::options::Backdrop;

use super::set::Set;

/// Frames of the film.
const FRAMES: usize = 24;
/// Pixels a side of the still and of the film.
const SIDES: [usize; 2] = [1024, 400];
/// How long each frame of the film stays [ms].
pub const FRAME_MS: u16 = 100;

/// A set, and which of its skin's vertices are left out: none, or a flag each.
type Seen<'a> = (&'a Set<'a>, &'a [bool]);

/// The last frame, and frames evenly spread over the time.
pub fn pictures((set, covered): Seen, clip: &Clip, backdrop: Backdrop) -> (Image, Vec<Image>) {
    let last = clip.drape.frames.len() - 1;
    let count = FRAMES.min(last + 1);
    let shown: Vec<usize> = (0..count).map(|i| i * last / (count - 1).max(1)).collect();
    let near = following(set, clip, &shown);
    let film = shown.par_iter().map(|&t| {
        let scene = scene((set, covered), clip, (t, backdrop));
        let camera = Camera {
            world_from_camera: DAffine3::from_translation(place(set, t)) * near.world_from_camera,
            ..near.clone()
        };
        Stage::new(&scene, &Options::quick()).shoot(&camera)
    });
    let scene = scene((set, covered), clip, (last, backdrop));
    let stage = look::stage(&scene);
    let still = stage.shoot(&stage.frame(&look::view(SIDES[0])));
    (still, film.collect())
}

fn scene(
    (set, covered): Seen,
    clip: &Clip,
    (t, backdrop): (usize, Backdrop),
) -> muslin_picture::Scene {
    let body = set.seen(t, &clip.body[t]);
    let cloth = &clip.drape.frames[t];
    let is_covered = |i: &u32| covered.get(*i as usize).copied().unwrap_or(false);
    let mut scene = look::scene((set.avatar, &body), &set.outfit, cloth, backdrop);
    if let Some(hero) = set.hero {
        scene.parts[0] =
            look::mannequin(set.hero_at(hero, (t, &clip.body[t])), &hero.character.faces);
    }
    let faces = &mut scene.parts[0].faces;
    faces.retain(|f| !f.iter().all(is_covered));
    // One floor for all frames: who jumps leaves it.
    let floor = clip.body.iter().map(|b| look::lowest(b));
    let floor = floor.fold(f64::INFINITY, f64::min);
    muslin_picture::Scene {
        ground: scene.ground.map(|_| Ground::at(floor)),
        ..scene
    }
}

/// Where the body as a whole is, on the floor [m].
fn place(set: &Set, t: usize) -> DVec3 {
    set.moving.motion.poses[set.moving.lead + t]
        .root
        .with_y(0.0)
}

/// A camera that sees all shown frames if it goes where the body goes.
fn following(set: &Set, clip: &Clip, shown: &[usize]) -> Camera {
    let points = shown.iter().flat_map(|&t| {
        let here = place(set, t);
        let all = clip.body[t].iter().chain(&clip.drape.frames[t]);
        all.map(move |p| *p - here)
    });
    Camera::framing(&points.collect::<Vec<_>>(), &look::view(SIDES[1]))
}
