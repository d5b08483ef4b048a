//! Cloth that is taken along by the body: the guess that each step of the path starts from.
//!
//! Every vertex belongs to the skin it started next to, for good: a sleeve stays with its arm
//! even where arm and chest touch. What that skin does in a step is a rigid motion; smoothed over
//! the cloth, the motions become a gentle one for all.

use glam::{DAffine3, DMat3, DVec3};
use muslin_geom::Surface;

use crate::{ordered, pattern::Rows};

/// Each vertex's place on the skin.
pub(crate) struct Carrier {
    faces: Vec<u32>,
    weights: Vec<[f64; 3]>,
    /// How firmly the vertex follows its own skin rather than its neighbours.
    hold: Vec<f64>,
}

/// A body's triangles where they are at one moment.
pub(crate) struct Skin<'a> {
    pub faces: &'a [[u32; 3]],
    /// Positions [m].
    pub verts: &'a [DVec3],
}

impl<'a> Skin<'a> {
    pub fn of(surface: &'a Surface) -> Skin<'a> {
        Skin {
            faces: surface.faces(),
            verts: surface.verts(),
        }
    }
}

/// Rounds of smoothing; a motion then spreads over about the square root of it in edges.
const ROUNDS: usize = 24;
/// Distance over which the hold of the skin falls [m].
const FALL: f64 = 0.03;

impl Carrier {
    /// Binds the cloth at `x` [m] to the nearest skin.
    pub fn new(skin: &Surface, x: &[DVec3]) -> Carrier {
        let hits = ordered::map(x.len(), |i| {
            skin.closest(x[i], 10.0).unwrap_or_else(|| skin.at(x[i], 0))
        });
        let hold = |d: f64| 0.3 / (1.0 + (d / FALL) * (d / FALL)) + 1e-3;
        Carrier {
            faces: hits.iter().map(|h| h.face).collect(),
            weights: hits.iter().map(|h| h.weights).collect(),
            hold: hits.iter().map(|h| hold(h.signed)).collect(),
        }
    }

    /// Skin vertices that the cloth is worn on.
    pub fn worn_on(&self, skin: &Surface) -> Vec<bool> {
        let mut out = vec![false; skin.verts().len()];
        for &f in &self.faces {
            skin.faces()[f as usize]
                .iter()
                .for_each(|&v| out[v as usize] = true);
        }
        out
    }

    /// The skin's frame under a vertex: where it is and how it is turned.
    pub fn frame(&self, i: usize, skin: &Skin<'_>) -> DAffine3 {
        let c = skin.faces[self.faces[i] as usize].map(|v| skin.verts[v as usize]);
        let along = (c[1] - c[0]).normalize_or(DVec3::X);
        let normal = along
            .cross(c[2] - c[0])
            .normalize_or(along.any_orthonormal_vector());
        let turn = DMat3::from_cols(along, normal, along.cross(normal));
        let w = self.weights[i];
        DAffine3::from_mat3_translation(turn, c[0] * w[0] + c[1] * w[1] + c[2] * w[2])
    }

    /// What the skin's move from `before` to `after` does to every vertex.
    pub fn motions(&self, before: &Skin<'_>, after: &Skin<'_>, near: &Rows) -> Vec<DAffine3> {
        let own = ordered::map(self.faces.len(), |i| {
            self.frame(i, after) * self.frame(i, before).inverse()
        });
        let mut now = own.clone();
        let mut next = own.clone();
        for _ in 0..ROUNDS {
            ordered::fill(&mut next, |i| self.mixed(i, &own, &now, near));
            std::mem::swap(&mut now, &mut next);
        }
        now
    }

    fn mixed(&self, i: usize, own: &[DAffine3], now: &[DAffine3], near: &Rows) -> DAffine3 {
        let row = near.row(i);
        let (hold, share) = (self.hold[i], 1.0 / row.len() as f64);
        let mut turn = own[i].matrix3 * hold;
        let mut shift = own[i].translation * hold;
        for &j in row {
            turn += now[j as usize].matrix3 * share;
            shift += now[j as usize].translation * share;
        }
        let all = 1.0 / (1.0 + hold);
        DAffine3 {
            matrix3: turn * all,
            translation: shift * all,
        }
    }
}
