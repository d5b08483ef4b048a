//! Bending of all triangles together: one constant sparse matrix of plain numbers.
//!
//! Cloth is cut flat and hardly stretches, so how a triangle curves is linear in the positions and
//! the energy is `½ xᵀ Q x` with the same `Q` for each coordinate (see [`muslin_energy::plate`]).

use glam::DVec3;
use muslin_energy::plate;

use crate::{
    cloth::Cloth,
    pattern::{Pattern, Rows},
};

/// `Q`: entries where stretch has a block as well, and those it has not.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bending {
    /// Per place of the pattern's `near` rows [N/m].
    pub near: Vec<f64>,
    /// Vertices that bend together and share no face.
    pub far: Rows,
    /// Their entries [N/m].
    pub far_weights: Vec<f64>,
    /// The same in single precision.
    pub far_single: Vec<f32>,
}

/// The place of an entry where stretch has none.
const FAR: u32 = u32::MAX;

impl Bending {
    pub fn new(cloth: &Cloth, pattern: &Pattern) -> Bending {
        let bend = |f: usize| cloth.materials[cloth.material_of[f] as usize].bend;
        let entries = plate::entries(&cloth.faces, &cloth.rest, bend);
        let mut near = vec![0.0; pattern.near.items.len()];
        let place = |&(i, j, _): &(u32, u32, f64)| match pattern.near.find(i, j) {
            Some(k) => k as u32,
            None => FAR,
        };
        let places: Vec<u32> = entries.iter().map(place).collect();
        let is_far = |(_, place): &(_, &u32)| **place == FAR;
        let pairs = entries.iter().zip(&places).filter(is_far);
        let pairs: Vec<_> = pairs.map(|(e, _)| (e.0, e.1)).collect();
        let far = Rows::sorted(cloth.n_verts(), &pairs);
        let mut far_weights = vec![0.0; far.items.len()];
        for (&(i, j, q), place) in entries.iter().zip(&places) {
            match *place {
                FAR => far_weights[far.find(i, j).expect("entered as far above")] += q,
                k => near[k as usize] += q,
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
