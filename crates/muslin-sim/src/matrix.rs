//! The linear system of a Newton step, and conjugate gradients on it.
//!
//! Stretch and body contact live in 3×3 blocks at the pattern's places, bending across hinges in
//! plain numbers, cloth-on-cloth contact in a list of small stencils. All of it is in single
//! precision, four lanes wide: displacements are multiplied here, never positions, and what comes
//! out only decides how fast a step converges; the gradient that decides to what stays in double.
//!
//! The preconditioner inverts the diagonal blocks and, beside them, motions of cloth in large parts
//! ([`crate::coarse`]). Without that second part a sheet that nothing holds hardly moves in its own
//! plane: its stretch is so much stiffer than its inertia that the iterations run out first.

use glam::{DMat3, DVec3, Mat3A, Vec3, Vec3A};
use rayon::prelude::*;

use crate::{
    bending::Bending,
    coarse::{Factor, Far, Handles},
    ordered::{self, CHUNK},
    pattern::{Pattern, Rows},
};

/// Most vertices that one contact couples.
pub(crate) const STENCIL: usize = 4;

/// A contact between weighted vertices: `K (Σ wᵢ xᵢ)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Link {
    pub verts: [u32; STENCIL],
    pub weights: [f32; STENCIL],
    pub stiffness: Mat3A,
}

/// A symmetric positive definite matrix of one Newton step.
pub(crate) struct Matrix<'a> {
    pub pattern: &'a Pattern,
    pub bending: &'a Bending,
    /// 3×3 blocks at the pattern's places, bending's near part included [N/m]. On the diagonal stands
    /// only what the rows do not sum to zero without: inertia, pins and touches.
    pub blocks: Vec<Mat3A>,
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
        blocks: Vec<Mat3A>,
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
    fn multiply(&self, p: &[Vec3A], pulls: &mut [Vec3A], out: &mut [Vec3A]) -> f64 {
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
                let mut dot = Vec3A::ZERO;
                for (k, out) in out.iter_mut().enumerate() {
                    let i = c * CHUNK + k;
                    *out = self.row(i, p, pulls);
                    dot += p[i] * *out;
                }
                total(dot)
            })
            .collect();
        parts.iter().sum()
    }

    /// `A p`.
    #[cfg(test)]
    pub fn times(&self, p: &[DVec3]) -> Vec<DVec3> {
        let p: Vec<Vec3A> = p.iter().map(single).collect();
        let mut out = vec![Vec3A::ZERO; p.len()];
        self.multiply(&p, &mut vec![Vec3A::ZERO; self.links.len()], &mut out);
        out.iter().map(double).collect()
    }

    fn row(&self, i: usize, p: &[Vec3A], pulls: &[Vec3A]) -> Vec3A {
        let (near, far) = (&self.pattern.near, &self.bending.far);
        // On differences, so that cloth which moves as one meets its inertia and nothing else: beside
        // the stiffness of its yarns that would be lost in rounding.
        let here = p[i];
        let mut sum = self.blocks[self.pattern.diagonal[i] as usize] * here;
        let span = near.span(i);
        for (block, &j) in self.blocks[span.clone()].iter().zip(&near.items[span]) {
            sum += *block * (p[j as usize] - here);
        }
        let span = far.span(i);
        let weights = &self.bending.far_single[span.clone()];
        for (weight, &j) in weights.iter().zip(&far.items[span]) {
            sum += (p[j as usize] - here) * *weight;
        }
        for &use_ in self.of_vertex.row(i) {
            let (l, k) = (use_ as usize / STENCIL, use_ as usize % STENCIL);
            sum += pulls[l] * self.links[l].weights[k];
        }
        sum
    }

    /// All blocks but those of links, as rows: where each starts, whom its blocks couple the vertex
    /// with, in ascending order, and they [N/m]; less that much on the diagonal of vertex `i`.
    pub fn rows(&self, less: impl Fn(usize) -> f64) -> (Vec<u32>, Vec<u32>, Vec<DMat3>) {
        let (near, far) = (&self.pattern.near, &self.bending.far);
        let (mut starts, mut cols, mut blocks) = (vec![0], Vec::new(), Vec::new());
        for i in 0..self.pattern.diagonal.len() {
            let here = self.pattern.diagonal[i] as usize;
            let scalar = |k: f64| DMat3::from_diagonal(DVec3::splat(k));
            let own = self.blocks[here].as_dmat3() - scalar(less(i));
            let others = near.span(i).filter(|k| *k != here);
            let mut row: Vec<(u32, DMat3)> = others
                .map(|k| (near.items[k], self.blocks[k].as_dmat3()))
                .collect();
            row.extend(
                far.span(i)
                    .map(|k| (far.items[k], scalar(self.bending.far_weights[k]))),
            );
            // Rows that sum to nothing but what holds the vertex: to the last digit, for a swing is
            // a millionth of what yarns could do.
            let sum: DMat3 = row.iter().map(|e| e.1).sum();
            row.push((i as u32, own - sum));
            row.sort_unstable_by_key(|e| e.0);
            cols.extend(row.iter().map(|e| e.0));
            blocks.extend(row.iter().map(|e| e.1));
            starts.push(cols.len() as u32);
        }
        (starts, cols, blocks)
    }

    /// The block on the diagonal, without links.
    fn diagonal(&self, i: usize) -> Mat3A {
        let far = &self.bending.far_single[self.bending.far.span(i)];
        self.stretched(i) - Mat3A::from_diagonal(Vec3::splat(far.iter().sum()))
    }

    /// The block on the diagonal, without links and without bending across hinges.
    pub fn stretched(&self, i: usize) -> Mat3A {
        let here = self.pattern.diagonal[i] as usize;
        let others = self.pattern.near.span(i).filter(|k| *k != here);
        let others: Mat3A = others.map(|k| self.blocks[k]).sum();
        self.blocks[here] - others
    }

    /// Inverses of the diagonal blocks.
    fn inverse_diagonal(&self) -> Vec<Mat3A> {
        ordered::map(self.pattern.diagonal.len(), |i| {
            let mut d = self.diagonal(i);
            for &use_ in self.of_vertex.row(i) {
                let (l, k) = (use_ as usize / STENCIL, use_ as usize % STENCIL);
                let w = self.links[l].weights[k];
                d += self.links[l].stiffness * (w * w);
            }
            let inverse = d.as_dmat3().inverse();
            if inverse.is_finite() {
                narrow(&inverse)
            } else {
                Mat3A::IDENTITY
            }
        })
    }

    /// An approximate solution of `A x = b`, started from zero, and the iterations spent.
    ///
    /// Stops where the matrix shows no positive curvature along the search direction, which
    /// rounding alone can cause; what was found up to there still descends. `kept`: see [`Far::new`].
    pub fn solve(
        &self,
        b: &[DVec3],
        effort: &Effort<'_>,
        kept: &mut Option<Factor>,
    ) -> (Vec<DVec3>, usize) {
        let n = b.len();
        let inverse = self.inverse_diagonal();
        let far = Far::new(self, effort.handles, kept);
        let nothing = || vec![Vec3A::ZERO; n];
        let mut r: Vec<Vec3A> = b.iter().map(single).collect();
        let (mut x, mut z, mut p, mut ap) = (nothing(), nothing(), nothing(), nothing());
        let mut pulls = vec![Vec3A::ZERO; self.links.len()];
        let found = |x: &[Vec3A]| x.iter().map(double).collect();
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
                return (found(&x), done);
            }
            ordered::change(&mut p, |i, p| z[i] + far.at(i, &shifts) + p * beta);
            let curvature = self.multiply(&p, &mut pulls, &mut ap);
            if curvature.is_nan() || curvature <= 0.0 {
                return (found(&x), done);
            }
            let step = Step {
                alpha: (rz / curvature) as f32,
                p: &p,
                ap: &ap,
            };
            let next = self.advance(&step, (&inverse, &far), (&mut x, &mut r, &mut z));
            beta = (next.0 / rz) as f32;
            (rz, shifts) = next;
        }
        (found(&x), effort.iterations)
    }

    /// `x += α p`, `r −= α A p`, `z = D⁻¹ r`, and how every large part is to shift.
    ///
    /// Returns `r` times the two together, and the shifts.
    fn advance(
        &self,
        step: &Step<'_>,
        (inverse, far): (&[Mat3A], &Far<'_>),
        (x, r, z): (&mut [Vec3A], &mut [Vec3A], &mut [Vec3A]),
    ) -> (f64, Vec<Vec3A>) {
        let chunks = x
            .par_chunks_mut(CHUNK)
            .zip(r.par_chunks_mut(CHUNK))
            .zip(z.par_chunks_mut(CHUNK));
        let parts: Vec<(f64, Vec<Vec3A>)> = chunks
            .enumerate()
            .map(|(c, ((x, r), z))| {
                let (mut dot, mut sums) = (Vec3A::ZERO, vec![Vec3A::ZERO; far.len()]);
                for k in 0..x.len() {
                    let i = c * CHUNK + k;
                    x[k] += step.p[i] * step.alpha;
                    r[k] -= step.ap[i] * step.alpha;
                    z[k] = inverse[i] * r[k];
                    dot += r[k] * z[k];
                    far.gather(i, r[k], &mut sums);
                }
                (total(dot), sums)
            })
            .collect();
        let mut dot: f64 = parts.iter().map(|p| p.0).sum();
        let sum = |part: usize| parts.iter().map(|p| p.1[part]).sum();
        let sums: Vec<Vec3A> = (0..far.len()).map(sum).collect();
        let shifts = far.moves(&sums);
        for (sum, shift) in sums.iter().zip(&shifts) {
            dot += total(*sum * *shift);
        }
        (dot, shifts)
    }
}

/// A step along a direction, and what the matrix makes of it.
struct Step<'a> {
    alpha: f32,
    p: &'a [Vec3A],
    ap: &'a [Vec3A],
}

/// Sum of the three lanes.
fn total(v: Vec3A) -> f64 {
    f64::from(v.x) + f64::from(v.y) + f64::from(v.z)
}

fn single(v: &DVec3) -> Vec3A {
    v.as_vec3a()
}

fn double(v: &Vec3A) -> DVec3 {
    v.as_dvec3()
}

/// A block in single precision.
pub(crate) fn narrow(m: &DMat3) -> Mat3A {
    m.as_mat3().into()
}
