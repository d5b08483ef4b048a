//! The linear system of a Newton step, and conjugate gradients on it.
//!
//! Stretch and body contact live in 3×3 blocks at the pattern's places, bending across hinges in
//! plain numbers, cloth-on-cloth contact in a list of small stencils. Blocks are kept in single
//! precision: they multiply displacements, never positions, and only decide how fast the solve
//! converges; the right-hand side that decides to what stays in double.
//!
//! The preconditioner inverts the diagonal blocks and, beside them, motions of cloth in large parts
//! ([`crate::coarse`]). Without that second part a sheet that nothing holds hardly moves in its own
//! plane: its stretch is so much stiffer than its inertia that the iterations run out first.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::{
    bending::Bending,
    coarse::{Far, Handles},
    ordered::{self, CHUNK},
    pattern::{Pattern, Rows},
};

/// Most vertices that one contact couples.
pub(crate) const STENCIL: usize = 4;

/// A contact between weighted vertices: `K (Σ wᵢ xᵢ)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Link {
    pub verts: [u32; STENCIL],
    pub weights: [f64; STENCIL],
    pub stiffness: DMat3,
}

/// A symmetric positive definite matrix of one Newton step.
pub(crate) struct Matrix<'a> {
    pub pattern: &'a Pattern,
    pub bending: &'a Bending,
    /// Column-major 3×3 blocks at the pattern's places; bending's near part included [N/m].
    pub blocks: Vec<[f32; 9]>,
    pub links: Vec<Link>,
    /// For every vertex, `4 link + position in its stencil`.
    of_vertex: Rows,
}

/// What [`Matrix::solve`] should reach, whichever comes first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort<'a> {
    pub iterations: usize,
    /// What moves cloth in parts; without them, every piece moves as a whole.
    pub handles: Option<&'a Handles>,
    /// Ratio of last to first residual in the preconditioned norm.
    pub tolerance: f64,
}

impl<'a> Matrix<'a> {
    pub fn new(
        pattern: &'a Pattern,
        bending: &'a Bending,
        blocks: Vec<[f32; 9]>,
        links: Vec<Link>,
    ) -> Self {
        let n = pattern.diagonal.len();
        let mut uses = Vec::with_capacity(links.len() * STENCIL);
        for (l, link) in links.iter().enumerate() {
            let used = (0..STENCIL).filter(|&k| link.weights[k] != 0.0);
            uses.extend(used.map(|k| (link.verts[k], (STENCIL * l + k) as u32)));
        }
        Matrix {
            pattern,
            bending,
            blocks,
            links,
            of_vertex: Rows::counted(n, &uses),
        }
    }

    /// Writes `A p` and returns `p · A p`.
    fn multiply(&self, p: &[DVec3], pulls: &mut [DVec3], out: &mut [DVec3]) -> f64 {
        ordered::fill(pulls, |l| {
            let Link {
                verts,
                weights,
                stiffness,
            } = &self.links[l];
            let at = |k: usize| p[verts[k] as usize] * weights[k];
            *stiffness * (at(0) + at(1) + at(2) + at(3))
        });
        let chunks = out.par_chunks_mut(CHUNK).enumerate();
        let parts: Vec<f64> = chunks
            .map(|(c, out)| {
                let mut dot = 0.0;
                for (k, out) in out.iter_mut().enumerate() {
                    let i = c * CHUNK + k;
                    *out = self.row(i, p, pulls);
                    dot += p[i].dot(*out);
                }
                dot
            })
            .collect();
        parts.iter().sum()
    }

    /// `A p`.
    #[cfg(test)]
    pub fn times(&self, p: &[DVec3]) -> Vec<DVec3> {
        let mut out = vec![DVec3::ZERO; p.len()];
        self.multiply(p, &mut vec![DVec3::ZERO; self.links.len()], &mut out);
        out
    }

    fn row(&self, i: usize, p: &[DVec3], pulls: &[DVec3]) -> DVec3 {
        let near = &self.pattern.near;
        let mut sum = DVec3::ZERO;
        for k in near.span(i) {
            let (b, v) = (&self.blocks[k], p[near.items[k] as usize]);
            let b = b.map(f64::from);
            sum.x += b[0] * v.x + b[3] * v.y + b[6] * v.z;
            sum.y += b[1] * v.x + b[4] * v.y + b[7] * v.z;
            sum.z += b[2] * v.x + b[5] * v.y + b[8] * v.z;
        }
        let far = &self.bending.far;
        for k in far.span(i) {
            sum += p[far.items[k] as usize] * self.bending.far_weights[k];
        }
        for &use_ in self.of_vertex.row(i) {
            let (l, k) = (use_ as usize / STENCIL, use_ as usize % STENCIL);
            sum += pulls[l] * self.links[l].weights[k];
        }
        sum
    }

    /// Inverses of the diagonal blocks.
    fn inverse_diagonal(&self) -> Vec<DMat3> {
        ordered::map(self.pattern.diagonal.len(), |i| {
            let b = self.blocks[self.pattern.diagonal[i] as usize].map(f64::from);
            let mut d = DMat3::from_cols_array(&b);
            for &use_ in self.of_vertex.row(i) {
                let (l, k) = (use_ as usize / STENCIL, use_ as usize % STENCIL);
                let w = self.links[l].weights[k];
                d += self.links[l].stiffness * (w * w);
            }
            let inverse = d.inverse();
            if inverse.is_finite() {
                inverse
            } else {
                DMat3::IDENTITY
            }
        })
    }

    /// An approximate solution of `A x = b`, started from zero, and the iterations spent.
    ///
    /// Stops where the matrix shows no positive curvature along the search direction, which
    /// rounding alone can cause; what was found up to there still descends.
    pub fn solve(&self, b: &[DVec3], effort: &Effort<'_>) -> (Vec<DVec3>, usize) {
        let n = b.len();
        let inverse = self.inverse_diagonal();
        let far = Far::new(self, effort.handles);
        let mut x = vec![DVec3::ZERO; n];
        let mut r = b.to_vec();
        let mut z = vec![DVec3::ZERO; n];
        let mut p = vec![DVec3::ZERO; n];
        let mut ap = vec![DVec3::ZERO; n];
        let mut pulls = vec![DVec3::ZERO; self.links.len()];
        // With a step of nothing this only prepares the first direction.
        let first = Step {
            alpha: 0.0,
            p: &p,
            ap: &ap,
        };
        let (mut rz, mut shifts) = self.advance(&first, (&inverse, &far), (&mut x, &mut r, &mut z));
        let goal = rz * effort.tolerance * effort.tolerance;
        let mut beta = 0.0;
        for done in 0..effort.iterations {
            if rz <= goal || rz <= f64::MIN_POSITIVE {
                return (x, done);
            }
            ordered::change(&mut p, |i, p| z[i] + far.at(i, &shifts) + p * beta);
            let curvature = self.multiply(&p, &mut pulls, &mut ap);
            if curvature.is_nan() || curvature <= 0.0 {
                return (x, done);
            }
            let step = Step {
                alpha: rz / curvature,
                p: &p,
                ap: &ap,
            };
            let next = self.advance(&step, (&inverse, &far), (&mut x, &mut r, &mut z));
            beta = next.0 / rz;
            (rz, shifts) = next;
        }
        (x, effort.iterations)
    }

    /// `x += α p`, `r −= α A p`, `z = D⁻¹ r`, and how every large part is to shift.
    ///
    /// Returns `r` times the two together, and the shifts.
    fn advance(
        &self,
        step: &Step<'_>,
        (inverse, far): (&[DMat3], &Far<'_>),
        (x, r, z): (&mut [DVec3], &mut [DVec3], &mut [DVec3]),
    ) -> (f64, Vec<DVec3>) {
        let chunks = x
            .par_chunks_mut(CHUNK)
            .zip(r.par_chunks_mut(CHUNK))
            .zip(z.par_chunks_mut(CHUNK));
        let parts: Vec<(f64, Vec<DVec3>)> = chunks
            .enumerate()
            .map(|(c, ((x, r), z))| {
                let (mut dot, mut sums) = (0.0, vec![DVec3::ZERO; far.len()]);
                for k in 0..x.len() {
                    let i = c * CHUNK + k;
                    x[k] += step.p[i] * step.alpha;
                    r[k] -= step.ap[i] * step.alpha;
                    z[k] = inverse[i] * r[k];
                    dot += r[k].dot(z[k]);
                    far.gather(i, r[k], &mut sums);
                }
                (dot, sums)
            })
            .collect();
        let mut dot: f64 = parts.iter().map(|p| p.0).sum();
        let sum = |part: usize| parts.iter().map(|p| p.1[part]).sum();
        let sums: Vec<DVec3> = (0..far.len()).map(sum).collect();
        let shifts = far.moves(&sums);
        for (sum, shift) in sums.iter().zip(&shifts) {
            dot += sum.dot(*shift);
        }
        (dot, shifts)
    }
}

/// A step along a direction, and what the matrix makes of it.
struct Step<'a> {
    alpha: f64,
    p: &'a [DVec3],
    ap: &'a [DVec3],
}
