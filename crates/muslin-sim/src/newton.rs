//! One Newton step: assemble, solve, make sure that it descends.

use glam::{DMat3, DVec3};
use muslin_energy::{contact::Barrier, point};
use rayon::prelude::*;

use crate::{
    elastic,
    matrix::{Effort, Matrix},
    ordered,
    pairs::{self, Pair},
    touch::{self, Touch},
    weave::Weave,
};

/// What one time step minimises, with contacts as they were found before it.
pub(crate) struct Problem<'a> {
    pub weave: &'a Weave,
    /// Where every vertex would go unforced [m].
    pub target: &'a [DVec3],
    /// Time step [s].
    pub step: f64,
    pub gravity: DVec3,
    pub touches: &'a [Touch],
    pub pairs: &'a [Pair],
    pub barrier: Barrier,
    /// Vertices held, and where [m].
    pub pins: &'a [(u32, DVec3)],
}

/// Stiffness of a pin [N/m]: far above what a garment pulls with, far below what harms the solve.
const PIN: f64 = 2000.0;

impl Problem<'_> {
    /// The incremental potential at `x` [J].
    pub fn energy(&self, x: &[DVec3]) -> f64 {
        let w = self.weave;
        let bodies = ordered::sum(x.len(), |range| range.map(|i| self.own_energy(x, i)).sum());
        let pins = self
            .pins
            .iter()
            .map(|&(i, t)| point::pin(x[i as usize], t, PIN).energy);
        bodies
            + elastic::energy(w, x)
            + touch::energy(self.touches, x)
            + pairs::energy(self.pairs, x, &self.barrier)
            + pins.sum::<f64>()
    }

    /// Inertia, weight and bending of one vertex [J].
    fn own_energy(&self, x: &[DVec3], i: usize) -> f64 {
        let m = self.weave.mass[i];
        // Rows of Q sum to zero, so any point may be the origin; a near one keeps the digits.
        let bend = self
            .weave
            .bending
            .pull(i, x, &self.weave.pattern.near)
            .dot(x[i] - x[0]);
        // Weight is measured from the target, so that no digits go to the height of the room.
        point::inertia(x[i], self.target[i], m, self.step).energy
            + point::gravity(x[i] - self.target[i], m, self.gravity).energy
            + 0.5 * bend
    }

    /// The gradient [N] and the matrix at `x`.
    fn assemble(&self, x: &[DVec3]) -> (Vec<DVec3>, Matrix<'_>) {
        let w = self.weave;
        let answers = elastic::responses(w, x);
        let mut gradient = ordered::map(x.len(), |i| self.own_gradient(&answers, x, i));
        let mut blocks = self.blocks(&answers);
        let mut add = |place: u32, h: DMat3| {
            let block = &mut blocks[place as usize];
            block
                .iter_mut()
                .zip(h.to_cols_array())
                .for_each(|(b, h)| *b += h as f32);
        };
        for &(i, t) in self.pins {
            let held = point::pin(x[i as usize], t, PIN);
            gradient[i as usize] += held.gradient;
            add(w.pattern.diagonal[i as usize], held.hessian);
        }
        touch::add(self.touches, x, &mut gradient, |touch, a, b, h| {
            let place = match touch.face {
                Some(f) => w.pattern.places[f as usize][a][b],
                None => w.pattern.diagonal[touch.verts[a] as usize],
            };
            add(place, h);
        });
        let links = pairs::add(self.pairs, x, &self.barrier, &mut gradient);
        (gradient, Matrix::new(&w.pattern, &w.bending, blocks, links))
    }

    fn own_gradient(&self, answers: &[muslin_energy::InPlane], x: &[DVec3], i: usize) -> DVec3 {
        let (w, m) = (self.weave, self.weave.mass[i]);
        point::inertia(x[i], self.target[i], m, self.step).gradient
            + point::gravity(x[i], m, self.gravity).gradient
            + w.bending.pull(i, x, &w.pattern.near)
            + elastic::gradient(w, answers, i)
    }

    /// Blocks of inertia, stretch and bending.
    fn blocks(&self, answers: &[muslin_energy::InPlane]) -> Vec<[f32; 9]> {
        let (w, near) = (self.weave, &self.weave.pattern.near);
        let n = w.n_verts();
        let chunks: Vec<Vec<[f32; 9]>> = (0..n.div_ceil(ordered::CHUNK))
            .into_par_iter()
            .map(|c| {
                let rows = c * ordered::CHUNK..((c + 1) * ordered::CHUNK).min(n);
                let first = near.start[rows.start] as usize;
                let last = near.start[rows.end] as usize;
                let scalar = |k: &f64| DMat3::from_diagonal(DVec3::splat(*k));
                let mut out: Vec<DMat3> = w.bending.near[first..last].iter().map(scalar).collect();
                for i in rows {
                    elastic::add_row(w, answers, (i, first), &mut out);
                    let k = w.mass[i] / (self.step * self.step);
                    out[w.pattern.diagonal[i] as usize - first] += scalar(&k);
                }
                out.iter()
                    .map(|b| b.to_cols_array().map(|v| v as f32))
                    .collect()
            })
            .collect();
        chunks.concat()
    }

    /// A displacement from `x` that lowers the energy [m]; none if nothing finite was found.
    pub fn descend(&self, x: &[DVec3], effort: &Effort) -> Option<Vec<DVec3>> {
        let (gradient, matrix) = self.assemble(x);
        let down: Vec<DVec3> = gradient.iter().map(|g| -*g).collect();
        let (mut moves, _) = matrix.solve(&down, effort);
        let first = self.energy(x);
        for _ in 0..HALVINGS {
            touch::keep_out(self.touches, x, &mut moves);
            let there: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
            let energy = self.energy(&there);
            // A rise within rounding of the sum is no rise.
            if energy <= first + 1e-12 * first.abs() {
                return Some(moves);
            }
            moves.iter_mut().for_each(|m| *m *= 0.5);
        }
        moves.iter().all(|m| m.is_finite()).then_some(moves)
    }
}

/// Steps are halved this often; a step of a sixteenth is taken whatever the energy says.
const HALVINGS: usize = 4;
