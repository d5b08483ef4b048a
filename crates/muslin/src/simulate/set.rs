//! Everything that a simulation starts from: who, how they move, what they wear.

use std::sync::OnceLock;

use glam::{DAffine3, DVec3};
use muslin_body::{Avatar, Cores, Figure, Part, Pose, Posed};
use muslin_garment::Worn;
use muslin_geom::Drape;
use muslin_io::{Clip, sha256};
use muslin_model::Model;
use muslin_sim::{Air, Cloth, Frame, Walk};
use rayon::prelude::*;

use crate::brought::dressed;
use crate::drape::{cloth, cloth_of, put_on};
use crate::failure::Failure;
use crate::figure::body_frame;
use crate::hero::Hero;
use crate::look::lowest;
use crate::outfit::Outfit;
use crate::wardrobe;

use super::motion::Moving;
use super::reel::Reel;

/// What a simulation takes in memory, about [bytes].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Memory {
    /// The frames while the files are made: twice as doubles (as simulated, and with the eyes for the GLB), once as
    /// the file itself.
    pub frames: usize,
    /// All: these with what is left over beside them, the body, and the solver at work.
    pub all: usize,
}

/// Program and body, and the solver's share for a vertex, by the peaks of runs of 3,292 to 6,484 vertices [bytes].
const STANDING: usize = 60 << 20;
const A_VERTEX: usize = 12 << 10;

impl Memory {
    /// For so many frames of so many vertices of cloth and of skin.
    pub fn of(frames: usize, [cloth, skin]: [usize; 2]) -> Self {
        let frames = frames * (cloth + skin) * (24 + 24 + 12);
        Self {
            frames,
            all: STANDING + cloth * A_VERTEX + frames + frames / 5,
        }
    }

    /// Of the runs of `all`, `side` by side, at their most.
    pub fn at_once(mut all: Vec<Self>, side: usize) -> Self {
        all.sort_unstable_by_key(|m| std::cmp::Reverse(m.all));
        let most = || all.iter().take(side);
        Self {
            frames: most().map(|m| m.frames).sum(),
            all: most().map(|m| m.all).sum(),
        }
    }

    /// As in `about 132 MB, 30 of them for frames`.
    pub fn text(self) -> String {
        let [all, frames] = [self.all, self.frames].map(megabytes);
        format!("about {all} MB, {frames} of them for frames")
    }

    /// A warning where the machine has less to give.
    pub fn scarce(self) -> Option<String> {
        let free = free().filter(|free| self.all > *free)?;
        Some(format!(
            "it needs about {} MB of memory and {} are free: take fewer frames at a time (--start, --seconds, --fps), or fewer cores for several motions (RAYON_NUM_THREADS)",
            megabytes(self.all),
            megabytes(free)
        ))
    }
}

/// Memory that can be had without swapping [bytes]; only Linux tells.
fn free() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find(|l| l.starts_with("MemAvailable:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<usize>().ok()? << 10)
}

/// Whole megabytes, rounded up.
pub fn megabytes(bytes: usize) -> f64 {
    (bytes as f64 / 1e6).ceil()
}

/// A figure in its clothes, before the first step.
pub struct Set<'a> {
    /// The body's family.
    pub avatar: &'a Avatar,
    /// The body at rest.
    pub figure: Figure,
    /// The skin while it is dressed [m].
    stood: Vec<DVec3>,
    cores: Cores<'a>,
    /// How it moves.
    pub moving: Moving,
    /// What it wears.
    pub outfit: Outfit,
    /// The same for the solver.
    pub cloth: Cloth,
    /// Where the cloth starts, around the body as it is dressed [m].
    pub start: Vec<DVec3>,
    /// Whether time goes on by BDF2.
    pub bdf2: bool,
    /// What it moves through.
    pub air: Air,
    /// Whom the body stands for, if not for itself.
    pub hero: Option<&'a Hero>,
    /// Found once it is asked for.
    floor: OnceLock<f64>,
}

#[cfg(test)]
impl<'a> Set<'a> {
    /// What these options ask for, on the default body.
    pub fn asked(avatar: &'a Avatar, options: &super::SimulateOptions) -> Self {
        let figure = avatar.figure(&Default::default()).expect("an adult");
        let moving = super::motion::load((avatar, None), &figure, options).expect("built in");
        let outfit = Outfit::make(avatar, &options.dress, |_| {}).expect("it can be cut");
        Self::new(avatar, figure, moving, outfit).expect("it fits")
    }
}

impl<'a> Set<'a> {
    /// Puts the outfit on.
    pub fn new(
        avatar: &'a Avatar,
        figure: Figure,
        moving: Moving,
        outfit: Outfit,
    ) -> Result<Self, Failure> {
        let (_, stood) = avatar.dressing(&figure);
        let worn = put_on(avatar, &outfit, &stood)?;
        let who = (avatar, figure, stood);
        Ok(Self::wearing(who, moving, (outfit, worn)))
    }

    /// The same for models, which were taught of garments at rest.
    pub fn rested(
        avatar: &'a Avatar,
        figure: Figure,
        moving: Moving,
        outfit: Outfit,
    ) -> Result<Self, Failure> {
        let stands = avatar.dressing(&figure);
        let worn = dressed(avatar, &outfit, (&figure, &stands))?;
        let who = (avatar, figure, stands.1);
        Ok(Self::wearing(who, moving, (outfit, worn)))
    }

    fn wearing(
        (avatar, figure, stood): (&'a Avatar, Figure, Figure),
        moving: Moving,
        (outfit, worn): (Outfit, Vec<Worn>),
    ) -> Self {
        Self {
            stood: stood.verts[avatar.part(Part::Body)].to_vec(),
            cloth: cloth(&outfit, &worn),
            start: worn.into_iter().flat_map(|w| w.verts).collect(),
            cores: Cores::new(avatar, &figure),
            avatar,
            figure,
            moving,
            outfit,
            bdf2: false,
            air: Air::STILL,
            hero: None,
            floor: OnceLock::new(),
        }
    }

    /// A model of its garment `k`, laid around this body and told of it and of the fabric.
    pub fn told(&self, k: usize, model: Model) -> Result<Model, Failure> {
        let start = &self.start[self.outfit.parts()[k].verts.clone()];
        let body = (self.avatar, &self.figure);
        wardrobe::around(model, body, (&self.outfit, k, start))
    }

    /// Garment `k` alone for the solver.
    pub fn cloth_of(&self, k: usize) -> Cloth {
        cloth_of(&self.cloth, (k, &self.outfit.parts()[k]))
    }

    /// The skin in a pose of the motion, the lead-in counted [m].
    pub fn skin(&self, k: usize) -> Vec<DVec3> {
        self.posed(k).verts[self.avatar.part(Part::Body)].to_vec()
    }

    /// The body in a pose of the motion, the lead-in counted; over a character's own skin where it is in its likeness.
    fn posed(&self, k: usize) -> Posed {
        match self.hero {
            Some(hero) => self.over(hero, k).0,
            None => self.avatar.pose(&self.figure, &self.moving.motion.poses[k]),
        }
    }

    /// The same over a character's skin, and where its joints are ([`muslin_body::Twin::joints`]).
    fn over(&self, hero: &Hero, k: usize) -> (Posed, Vec<DAffine3>) {
        let pose = &self.moving.motion.poses[k];
        let mut posed = self.avatar.pose(&self.figure, pose);
        let joints = hero.twin.joints(&posed.bones, &pose.beyond);
        let skin = &mut posed.verts[self.avatar.part(Part::Body)];
        hero.twin.cover(&hero.character, &joints, skin);
        (posed, joints)
    }

    /// The body in a pose of the motion, the lead-in counted, as the solver meets it.
    pub fn frame(&self, k: usize) -> Frame {
        body_frame(self.avatar, &self.posed(k), &self.cores)
    }

    /// The motion as the solver meets it; `rest` and `at` as [`rest`](Self::rest) and
    /// [`frame`](Self::frame) say.
    pub fn walk<'w>(
        &'w self,
        rest: &'w [DVec3],
        at: &'w (dyn Fn(usize) -> Frame + Sync),
    ) -> Walk<'w> {
        Walk {
            faces: self.avatar.collision_faces(),
            rest,
            frames: self.moving.motion.poses.len(),
            lead: self.moving.lead,
            fps: self.moving.motion.fps,
            at,
        }
    }

    /// The skin while it is dressed [m].
    pub fn rest(&self) -> Vec<DVec3> {
        self.stood.clone()
    }

    /// How high the lowest skin of all delivered frames is [m]: in results that is where the floor lies, at zero. A character
    /// keeps its own.
    pub fn floor(&self) -> f64 {
        let find = || {
            let frames = (self.moving.lead..self.moving.motion.poses.len()).into_par_iter();
            let low = frames.map(|k| lowest(&self.skin(k)));
            low.reduce(|| f64::INFINITY, f64::min)
        };
        match self.hero {
            Some(_) => 0.0,
            None => *self.floor.get_or_init(find),
        }
    }

    /// Skin and eyes in a delivered frame [m], with the skin that the cloth lies on, as [`clip`](Self::clip) has it.
    pub fn seen(&self, frame: usize, skin: &[DVec3]) -> Vec<DVec3> {
        let pose = &self.moving.motion.poses[self.moving.lead + frame];
        let mut verts = self.avatar.pose(&self.figure, pose).verts;
        let floor = self.floor();
        verts.iter_mut().for_each(|x| x.y -= floor);
        verts[self.avatar.part(Part::Body)].copy_from_slice(skin);
        verts.truncate(self.avatar.part(Part::Eyes).end);
        verts
    }

    /// The character's own vertices in a delivered frame [m], where its flesh has given way as the skin
    /// that the cloth lies on has.
    pub fn hero_at(&self, hero: &Hero, (frame, skin): (usize, &[DVec3])) -> Vec<DVec3> {
        let (joints, by) = self.joints_at(hero, (frame, skin));
        hero.twin.posed(&hero.character, &joints, &by)
    }

    /// The character's joints in a delivered frame ([`muslin_body::Twin::joints`]), and how far the skin has given way
    /// from where our bones take it [m].
    pub fn joints_at(
        &self,
        hero: &Hero,
        (frame, skin): (usize, &[DVec3]),
    ) -> (Vec<DAffine3>, Vec<DVec3>) {
        let (posed, joints) = self.over(hero, self.moving.lead + frame);
        let by = skin
            .iter()
            .zip(&posed.verts)
            .map(|(s, p)| *s - *p)
            .collect();
        (joints, by)
    }

    /// Vertices of the cloth and of the skin.
    pub fn n_verts(&self) -> [usize; 2] {
        [self.start.len(), self.avatar.part(Part::Body).len()]
    }

    /// What it takes in memory.
    pub fn memory(&self) -> Memory {
        Memory::of(self.moving.frames(), self.n_verts())
    }

    /// The frames as a clip over the skin, on a floor at zero.
    pub fn clip(&self, mut reel: Reel) -> Clip {
        let frames = reel.cloth.par_iter_mut().chain(&mut reel.body);
        let floor = self.floor();
        frames.flatten().for_each(|x| x.y -= floor);
        Clip {
            drape: Drape {
                parts: self.outfit.parts(),
                faces: self.cloth.faces.clone(),
                frames: reel.cloth,
                fps: self.moving.motion.fps,
            },
            body: reel.body,
            body_faces: self.avatar.collision_faces().to_vec(),
            rest: self.start.clone(),
            corners: self.cloth.rest.clone(),
            pins: self.cloth.pins.clone(),
            fabrics: (self.outfit.pieces.iter())
                .map(|p| p.fabric.name.clone())
                .collect(),
            rate_unknown: false,
        }
    }

    /// What the frames depend on, as names and hashes: two runs that agree in all give the same.
    pub fn identity(&self) -> Vec<(&'static str, String)> {
        let motion = &self.moving.motion;
        let turns = motion.poses.iter().flat_map(|p| &p.rotations);
        let shifts = |p: &Pose| [&[p.root][..], &p.shifts].concat();
        let beyond = motion.poses.iter().flat_map(|p| &p.beyond);
        let beyond = beyond.flat_map(|a| a.to_cols_array());
        let poses = motion.poses.iter().flat_map(shifts);
        let poses = poses.flat_map(|x| x.to_array()).chain(beyond);
        let poses = poses.chain(turns.flat_map(|q| q.to_array()));
        let c = &self.cloth;
        let cut = c.rest.as_flattened().iter().flat_map(|p| p.to_array());
        let rest = format!("{:?}{:?}{:?}", c.materials, c.layers, c.pins);
        let clothes = [
            hash(points(&self.start)),
            hash(cut),
            hash(c.faces.as_flattened().iter().map(|&i| i.into())),
            hash(c.material_of.iter().map(|&i| i.into())),
            sha256(rest.as_bytes()),
        ];
        vec![
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("body", hash(points(&self.figure.verts))),
            (
                "character",
                self.hero.map_or(String::new(), |h| h.file.sha256.clone()),
            ),
            (
                "motion",
                hash(poses.chain([motion.fps, self.moving.lead as f64])),
            ),
            ("clothes", sha256(clothes.concat().as_bytes())),
            ("time", if self.bdf2 { "BDF2" } else { "Euler" }.to_owned()),
            (
                "air or wind",
                hash(
                    self.air
                        .wind
                        .to_array()
                        .into_iter()
                        .chain([self.air.density]),
                ),
            ),
        ]
    }
}

fn points(list: &[DVec3]) -> impl Iterator<Item = f64> {
    list.iter().flat_map(|p| p.to_array())
}

fn hash(numbers: impl Iterator<Item = f64>) -> String {
    let bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
    sha256(&bytes)
}
