//! Motions to learn from, cut into windows, and what sixteen windows look like side by side.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use muslin_body::{Motion, Pose};
use muslin_model::Stream;
use rayon::prelude::*;

use crate::body::Skinned;
use crate::ground::Posed;
use crate::lanes::{LANES, Row};

/// A pose of a motion: which motion, which pose.
pub(crate) type Place = [u32; 2];

/// Skins are kept for as long as they take less than this [bytes].
const ROOM: usize = 512 << 20;

/// Motions, with skins of poses that were asked for.
pub(crate) struct Clips {
    pub motions: Vec<Motion>,
    /// By wearer and place.
    skins: Mutex<HashMap<(usize, Place), Arc<Posed>>>,
    /// Where each window ends.
    pub windows: Vec<Place>,
}

impl Clips {
    /// All windows of the motions, or `most` of them evenly taken.
    pub fn new(motions: Vec<Motion>, most: usize) -> Self {
        let all = |(c, m): (usize, &Motion)| (0..m.poses.len()).map(move |k| [c as u32, k as u32]);
        let ends: Vec<Place> = motions.iter().enumerate().flat_map(all).collect();
        let n = ends.len().min(most);
        Self {
            skins: Mutex::default(),
            windows: (0..n).map(|k| ends[k * ends.len() / n]).collect(),
            motions,
        }
    }

    /// The pose `back` poses before a place; the first one before the first.
    fn before(&self, [clip, pose]: Place, back: usize) -> Place {
        [clip, pose.saturating_sub(back as u32)]
    }

    fn pose(&self, [clip, pose]: Place) -> &Pose {
        &self.motions[clip as usize].poses[pose as usize]
    }

    /// The skins of wearer `who` at `places` [m], root over the origin.
    ///
    /// Nothing is locked while skins are made: that work is shared out, and whoever waited for a
    /// lock inside it could wait for itself.
    pub fn skins(&self, (who, body): (usize, &Skinned), places: &[Place]) -> Vec<Arc<Posed>> {
        let known = || self.skins.lock().unwrap_or_else(PoisonError::into_inner);
        let mut all: HashMap<Place, Arc<Posed>> = {
            let known = known();
            let of = |at: &Place| Some((*at, known.get(&(who, *at))?.clone()));
            places.iter().filter_map(of).collect()
        };
        let mut new: Vec<Place> = places.to_vec();
        new.retain(|at| !all.contains_key(at));
        new.sort_unstable();
        new.dedup();
        let made: Vec<(Place, Arc<Posed>)> = (new.par_iter())
            .map(|at| (*at, Arc::new(body.skin(self.pose(*at)))))
            .collect();
        all.extend(made.iter().cloned());
        let mut known = known();
        let room = made.first().map_or(0, |m| ROOM / m.1.bytes().max(1));
        if known.len() + made.len() > room {
            known.clear();
        }
        known.extend((made.into_iter().take(room)).map(|(at, skin)| ((who, at), skin)));
        places.iter().map(|at| all[at].clone()).collect()
    }
}

/// How long windows are, in poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    /// Poses before the first that the network is told of, which only its rates need.
    pub lead: usize,
    /// Poses that the network is told of.
    pub told: usize,
    /// Poses at the end that are decoded.
    pub decoded: usize,
}

/// One decoded pose of sixteen windows.
pub(crate) struct Frame {
    pub at: [Place; LANES],
    /// Transforms of the bones that the cloth follows, root over the origin.
    pub bones: Vec<[Row; 12]>,
}

/// Sixteen windows side by side.
pub(crate) struct Batch {
    /// What the network is told, for every pose (inputs × lanes).
    pub told: Vec<Vec<f32>>,
    pub frames: Vec<Frame>,
    /// Who wears the cloth in all of them.
    pub wearer: usize,
    /// `r_t − 2 r_{t−1} + r_{t−2}` of the root over the last poses [m].
    pub root: [Row; 3],
}

/// Somebody who can be watched: the body, a fresh stream, and the bones that the cloth follows.
pub(crate) struct Watched<'a> {
    pub wearer: usize,
    pub body: &'a Skinned<'a>,
    pub stream: &'a Stream,
    pub rig: &'a [usize],
    pub n_inputs: usize,
    pub span: Span,
}

/// One window: what is told of every pose, and the followed bones of the decoded ones.
type Seen = (Vec<Vec<f32>>, Vec<Vec<[f32; 12]>>);

impl Watched<'_> {
    /// The windows that end at these places.
    pub fn batch(&self, clips: &Clips, ends: [Place; LANES]) -> Batch {
        let seen: Vec<Seen> = ends
            .par_iter()
            .map(|end| self.window(clips, *end))
            .collect();
        let Span { told, decoded, .. } = self.span;
        let rows = |t: usize| {
            let row = |i: usize| seen.iter().map(move |s| s.0[t][i]);
            (0..self.n_inputs).flat_map(row).collect()
        };
        let frame = |f: usize| Frame {
            at: ends.map(|end| clips.before(end, decoded - 1 - f)),
            bones: (0..self.rig.len())
                .map(|b| std::array::from_fn(|k| std::array::from_fn(|l| seen[l].1[f][b][k])))
                .collect(),
        };
        let change = ends.map(|end| {
            let root = |back: usize| clips.pose(clips.before(end, back)).root;
            (root(0) - root(1)) - (root(1) - root(2))
        });
        let lane = |axis: usize| change.map(|c: DVec3| c[axis] as f32);
        Batch {
            wearer: self.wearer,
            told: (0..told).map(rows).collect(),
            frames: (0..decoded).map(frame).collect(),
            root: [lane(0), lane(1), lane(2)],
        }
    }

    fn window(&self, clips: &Clips, end: Place) -> Seen {
        let mut stream = self.stream.clone();
        let Span {
            lead,
            told,
            decoded,
        } = self.span;
        let mut out = (Vec::new(), Vec::new());
        for back in (0..lead + told).rev() {
            let pose = clips.pose(clips.before(end, back));
            let bones = self.body.avatar.bones(self.body.figure, pose);
            let mut row = vec![0.0; self.n_inputs];
            stream.read(pose, &bones, &mut row);
            if back < told {
                out.0.push(row);
            }
            if back < decoded {
                let own = |b: &usize| {
                    let mut bone = bones[*b];
                    bone.translation -= pose.root;
                    bone.to_cols_array().map(|x| x as f32)
                };
                out.1.push(self.rig.iter().map(own).collect());
            }
        }
        out
    }
}
