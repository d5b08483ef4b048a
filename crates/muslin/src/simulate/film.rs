//! Pictures of a simulation: its last frame, and a film that follows the body.

use std::f64::consts::TAU;

use glam::DAffine3;
use muslin_geom::Image;
use muslin_io::Clip;
use muslin_picture::{Camera, Ground, Options, Stage};
use rayon::prelude::*;

use crate::look;
use crate::options::Backdrop;

use super::set::Set;

/// Frames of the film a second, and how many it has at least and at most; it lasts as long as the motion.
const RATE: f64 = 12.0;
const FRAMES: [usize; 2] = [24, 96];
/// Pixels a side of the still and of the film.
const SIDES: [usize; 2] = [1024, 400];
/// A set, and which of its skin's vertices are left out: none, or a flag each.
type Seen<'a> = (&'a Set<'a>, &'a [bool]);

/// What there is to see.
pub struct Film {
    /// The last frame.
    pub still: Image,
    /// Frames evenly spread over the time.
    pub frames: Vec<Image>,
    /// How long each of these stays [ms].
    pub frame_ms: u16,
}

/// The last frame and a film, in which the camera may go around the body once.
pub fn pictures((set, covered): Seen, clip: &Clip, (backdrop, turns): (Backdrop, bool)) -> Film {
    let last = clip.drape.frames.len() - 1;
    let seconds = (last + 1) as f64 / clip.drape.fps;
    let count = ((seconds * RATE).ceil() as usize)
        .clamp(FRAMES[0], FRAMES[1])
        .min(last + 1);
    let seat = |i: usize| Seat {
        frame: i * last / (count - 1).max(1),
        yaw: if turns {
            TAU * i as f64 / count as f64
        } else {
            0.0
        },
    };
    let shown: Vec<Seat> = (0..count).map(seat).collect();
    let near = following(set, clip, &shown);
    // One floor for all frames: who jumps leaves it.
    let floor = clip.body.par_iter().map(|b| look::lowest(b));
    let floor = floor.reduce(|| f64::INFINITY, f64::min);
    let film = shown.par_iter().map(|seat| {
        let scene = scene((set, covered), clip, (seat.frame, backdrop, floor));
        let camera = Camera {
            world_from_camera: seat.at(set) * near.world_from_camera,
            ..near.clone()
        };
        Stage::new(&scene, &Options::quick()).shoot(&camera)
    });
    let scene = scene((set, covered), clip, (last, backdrop, floor));
    let stage = look::stage(&scene);
    let still = stage.shoot(&stage.frame(&look::view(SIDES[0])));
    Film {
        still,
        frames: film.collect(),
        frame_ms: (1000.0 * seconds / count as f64)
            .round()
            .clamp(1.0, f64::from(u16::MAX)) as u16,
    }
}

/// Where the camera is for a frame of the film.
struct Seat {
    frame: usize,
    /// How far it has gone around the body [rad].
    yaw: f64,
}

impl Seat {
    /// Goes where the body goes, on the floor, and turns about it.
    fn at(&self, set: &Set) -> DAffine3 {
        let root = set.moving.motion.poses[set.moving.lead + self.frame].root;
        DAffine3::from_translation(root.with_y(0.0)) * DAffine3::from_rotation_y(self.yaw)
    }
}

fn scene(
    (set, covered): Seen,
    clip: &Clip,
    (t, backdrop, floor): (usize, Backdrop, f64),
) -> muslin_picture::Scene {
    let body = set.seen(t, &clip.body[t]);
    let cloth = &clip.drape.frames[t];
    let is_covered = |i: &u32| covered.get(*i as usize).copied().unwrap_or(false);
    let mut scene = look::scene((set.avatar, &body), &set.outfit, cloth, backdrop);
    if let Some(hero) = set.hero {
        let verts = set.hero_at(hero, (t, &clip.body[t]));
        scene.parts[0] = look::character(verts, &hero.character.faces, hero.colours());
    }
    let faces = &mut scene.parts[0].faces;
    faces.retain(|f| !f.iter().all(is_covered));
    muslin_picture::Scene {
        ground: scene.ground.map(|_| Ground::at(floor)),
        ..scene
    }
}

/// A camera that sees all shown frames if it goes from seat to seat.
fn following(set: &Set, clip: &Clip, shown: &[Seat]) -> Camera {
    let points = shown.iter().flat_map(|seat| {
        let here = seat.at(set).inverse();
        let all = clip.body[seat.frame].iter();
        let all = all.chain(&clip.drape.frames[seat.frame]);
        all.map(move |p| here.transform_point3(*p))
    });
    Camera::framing(&points.collect::<Vec<_>>(), &look::view(SIDES[1]))
}
