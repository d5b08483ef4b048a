//! Bending of all hinges together: one constant sparse matrix of plain numbers.
//!
//! Cloth is cut flat and hardly stretches, so the fold of a hinge is linear in the positions and
//! the energy is `½ xᵀ Q x` with the same `Q` for each coordinate (see [`muslin_energy::flat`]).

use glam::DVec3;
use muslin_energy::{flat::FlatHinge, hinge};

use crate::{
    cloth::Cloth,
    pattern::{Pattern, Rows},
};

/// `Q`: entries where stretch has a block as well, and those it has not.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bending {
    /// Per place of the pattern's `near` rows [N/m].
    pub near: Vec<f64>,
    /// Vertices across a hinge that share no face.
    pub far: Rows,
    /// Their entries [N/m].
    pub far_weights: Vec<f64>,
    /// The same in single precision.
    pub far_single: Vec<f32>,
}

impl Bending {
    pub fn new(cloth: &Cloth, pattern: &Pattern) -> Bending {
        let entries = entries(cloth);
        let mut near = vec![0.0; pattern.near.items.len()];
        let is_far = |&&(i, j, _): &&(u32, u32, f64)| pattern.near.find(i, j).is_none();
        let pairs = entries.iter().filter(is_far).map(|e| (e.0, e.1)).collect();
        let far = Rows::sorted(cloth.n_verts(), pairs);
        let mut far_weights = vec![0.0; far.items.len()];
        for &(i, j, q) in &entries {
            match pattern.near.find(i, j) {
                Some(k) => near[k] += q,
                None => far_weights[far.find(i, j).expect("entered as far above")] += q,
            }
        }
        Bending {
            near,
            far,
            far_single: far_weights.iter().map(|w| *w as f32).collect(),
            far_weights,
        }
    }

    /// Row `i` of `Q x` [N], on differences: the rows of `Q` sum to zero.
    pub fn pull(&self, i: usize, x: &[DVec3], near: &Rows) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for k in near.span(i) {
            sum += (x[near.items[k] as usize] - x[i]) * self.near[k];
        }
        for k in self.far.span(i) {
            sum += (x[self.far.items[k] as usize] - x[i]) * self.far_weights[k];
        }
        sum
    }
}

/// `(i, j, Q_ij)` of every hinge.
fn entries(cloth: &Cloth) -> Vec<(u32, u32, f64)> {
    let mut out = Vec::new();
    for stencil in hinge::stencils(&cloth.faces) {
        let bend = |side: usize| {
            cloth.materials[cloth.material_of[stencil.faces[side] as usize] as usize].bend
        };
        let flat = FlatHinge::new(stencil.corners(&cloth.rest), &softer(bend(0), bend(1)));
        for a in 0..4 {
            for b in 0..4 {
                let q = flat.stiffness * flat.weights[a] * flat.weights[b];
                out.push((stencil.verts[a], stencil.verts[b], q));
            }
        }
    }
    out
}

/// Between two materials the softer one folds.
fn softer(a: hinge::Bend, b: hinge::Bend) -> hinge::Bend {
    hinge::Bend {
        warp: a.warp.min(b.warp),
        weft: a.weft.min(b.weft),
    }
}
