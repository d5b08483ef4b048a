//! Our skin drawn over somebody else's: the nearest points that face the same way pull, and
//! neighbours want to move alike, less and less.

use std::collections::HashSet;

use glam::DVec3;
use muslin_geom::{Mesh, Surface, self_intersections, vertex_normals};
use rayon::prelude::*;

/// How stiff neighbours are to each other, and how far the other skin is looked for (shares of the
/// height), round by round.
const ROUNDS: [(f64, f64); 12] = [
    (80.0, 0.07),
    (80.0, 0.07),
    (50.0, 0.06),
    (50.0, 0.06),
    (30.0, 0.05),
    (30.0, 0.05),
    (20.0, 0.04),
    (20.0, 0.04),
    (12.0, 0.03),
    (12.0, 0.03),
    (8.0, 0.025),
    (8.0, 0.025),
];
/// Our skin lies this far outside [m].
const MARGIN: f64 = 0.002;
/// The least cosine between two normals of the same place.
const ALIKE: f64 = 0.35;
/// Rounds of covering what still sticks out, and what sticks out farther than this is no skin [m].
const COVERS: usize = 10;
const STICKS: f64 = 0.05;
/// How stiff neighbours are where the skin is pushed out.
const PUSHED: f64 = 2.0;
/// How much less places that nothing pulls at want to stay, beside those that are pulled.
const STAY: f64 = 0.02;
/// Rounds of evening out folds, how many neighbours far, and how often each time.
const UNFOLDS: usize = 20;
const RINGS: usize = 2;
const EVENED: usize = 3;
/// Conjugate gradients: most steps, and the residual's share at the end.
const STEPS: usize = 200;
const ENOUGH: f64 = 1e-4;

/// Limbs that are told apart, the trunk among them.
pub(crate) const SIDES: usize = 5;

/// Our skin, and how its places are to be treated.
pub(crate) struct Cover<'a> {
    /// Triangles of the outer skin.
    pub faces: &'a [[u32; 3]],
    /// Neighbours, each pair once, and how much stiffer than others they are.
    pub edges: Vec<([u32; 2], f64)>,
    /// How much the other skin may pull at each vertex.
    pub pull: Vec<f64>,
    /// The limb that each vertex is of; none near where limbs meet.
    pub limb: Vec<Option<usize>>,
}

/// The other skin.
pub(crate) struct Under<'a> {
    pub verts: &'a [DVec3],
    pub faces: &'a [[u32; 3]],
    /// The limb of every vertex, as in [`Cover::limb`].
    pub limb: &'a [usize],
    /// Which vertices are to be covered.
    pub bare: &'a [bool],
    pub height: f64,
}

/// A skin as a whole, and limb by limb.
pub(crate) struct Sides {
    whole: Surface,
    of_limb: Vec<Surface>,
}

impl Sides {
    /// `limb` says which limb each vertex is of; a triangle is of every limb that one of its corners is of.
    pub fn new(verts: &[DVec3], faces: &[[u32; 3]], limb: &[usize]) -> Self {
        let of = |l| {
            let own = faces
                .iter()
                .filter(|f| f.iter().any(|v| limb[*v as usize] == l));
            Surface::new(verts, &own.copied().collect::<Vec<_>>())
        };
        Self {
            whole: Surface::new(verts, faces),
            of_limb: (0..SIDES).map(of).collect(),
        }
    }

    /// The skin of a limb; all of it where no limb is named.
    pub fn of(&self, limb: Option<usize>) -> &Surface {
        limb.map_or(&self.whole, |l| &self.of_limb[l])
    }
}

/// The neighbours of each of `n` vertices.
pub(crate) fn neighbours(n: usize, edges: &[([u32; 2], f64)]) -> Vec<Vec<usize>> {
    let mut near = vec![Vec::new(); n];
    for ([a, b], _) in edges {
        near[*a as usize].push(*b as usize);
        near[*b as usize].push(*a as usize);
    }
    near
}

impl Cover<'_> {
    /// Draws the skin at `x` [m] over the other.
    pub fn draw_over(&self, under: &Under, x: &mut [DVec3]) {
        let sides = Sides::new(under.verts, under.faces, under.limb);
        for (stiff, far) in ROUNDS {
            let normals = vertex_normals(x, self.faces);
            let pulled = (0..x.len()).into_par_iter().map(|i| {
                if self.pull[i] == 0.0 {
                    return (0.0, DVec3::ZERO);
                }
                let surface = sides.of(self.limb[i]);
                match surface.closest(x[i], far * under.height) {
                    Some(hit) if hit.normal.dot(normals[i]) > ALIKE => {
                        (self.pull[i], hit.point + hit.normal * MARGIN - x[i])
                    }
                    _ => (0.0, DVec3::ZERO),
                }
            });
            let pulled: Vec<_> = pulled.collect();
            self.move_by(&pulled, stiff, x);
        }
        for _ in 0..COVERS {
            if !self.cover(under, x) {
                break;
            }
        }
        self.unfold(x);
    }

    /// Pushes the skin out where the other still sticks out; says whether it did.
    fn cover(&self, under: &Under, x: &mut [DVec3]) -> bool {
        let own = Surface::new(x, self.faces);
        let out = vertex_normals(under.verts, under.faces);
        let lacks = (0..under.verts.len()).into_par_iter().filter_map(|i| {
            let hit = under.bare[i]
                .then(|| own.closest(under.verts[i], STICKS))
                .flatten()?;
            let lack = hit.signed + MARGIN;
            (lack > 0.0 && hit.normal.dot(out[i]) > ALIKE).then_some((hit.face, lack))
        });
        let lacks: Vec<(u32, f64)> = lacks.collect();
        let worst = lacks.iter().map(|l| l.1).fold(0.0, f64::max);
        if worst < 0.25 * MARGIN {
            return false;
        }
        let mut want = vec![0.0f64; x.len()];
        for (face, lack) in lacks {
            for v in self.faces[face as usize] {
                let v = v as usize;
                if self.pull[v] > 0.0 {
                    want[v] = want[v].max(lack);
                }
            }
        }
        let normals = vertex_normals(x, self.faces);
        let pulled = |(n, w): (&DVec3, &f64)| match *w > 0.0 {
            true => (1.0, *n * *w),
            false => (STAY, DVec3::ZERO),
        };
        let pulled: Vec<_> = normals.iter().zip(&want).map(pulled).collect();
        self.move_by(&pulled, PUSHED, x);
        true
    }

    /// Evens out places where the skin passes through itself, as over the edge of a cuff.
    fn unfold(&self, x: &mut [DVec3]) {
        let near = neighbours(x.len(), &self.edges);
        for _ in 0..UNFOLDS {
            let mesh = Mesh {
                verts: x.to_vec(),
                faces: self.faces.to_vec(),
            };
            let mut folded = vec![false; x.len()];
            for f in self_intersections(&mesh).as_flattened() {
                for v in self.faces[*f as usize] {
                    folded[v as usize] |= self.pull[v as usize] > 0.5;
                }
            }
            if !folded.contains(&true) {
                break;
            }
            for _ in 0..RINGS {
                let wider = (0..x.len()).filter(|i| near[*i].iter().any(|j| folded[*j]));
                let wider: Vec<usize> = wider.collect();
                wider
                    .into_iter()
                    .for_each(|i| folded[i] |= self.pull[i] > 0.5);
            }
            for _ in 0..EVENED {
                let even = |i: usize| match folded[i] && !near[i].is_empty() {
                    true => near[i].iter().map(|j| x[*j]).sum::<DVec3>() / near[i].len() as f64,
                    false => x[i],
                };
                let evened: Vec<DVec3> = (0..x.len()).map(even).collect();
                x.copy_from_slice(&evened);
            }
        }
    }

    /// Adds the moves `d` that minimise `Σ w |d − t|² + stiff Σ k |d_i − d_j|²` for pairs `(w, t)`.
    fn move_by(&self, pulled: &[(f64, DVec3)], stiff: f64, x: &mut [DVec3]) {
        let product = |d: &[DVec3]| {
            let mut out: Vec<DVec3> = d
                .iter()
                .zip(pulled)
                .map(|(d, p)| *d * (p.0 + 1e-6))
                .collect();
            for ([a, b], k) in &self.edges {
                let (a, b) = (*a as usize, *b as usize);
                let pull = (d[a] - d[b]) * (stiff * k);
                out[a] += pull;
                out[b] -= pull;
            }
            out
        };
        let mut diagonal: Vec<f64> = pulled.iter().map(|p| p.0 + 1e-6).collect();
        for ([a, b], k) in &self.edges {
            diagonal[*a as usize] += stiff * k;
            diagonal[*b as usize] += stiff * k;
        }
        let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let mut d = vec![DVec3::ZERO; x.len()];
        let mut r: Vec<DVec3> = pulled.iter().map(|p| p.1 * p.0).collect();
        let eased =
            |r: &[DVec3]| -> Vec<DVec3> { r.iter().zip(&diagonal).map(|(r, m)| *r / *m).collect() };
        let mut z = eased(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let first = rz;
        for _ in 0..STEPS {
            if rz <= first * ENOUGH * ENOUGH || rz == 0.0 {
                break;
            }
            let ap = product(&p);
            let step = rz / dot(&p, &ap);
            for i in 0..d.len() {
                d[i] += p[i] * step;
                r[i] -= ap[i] * step;
            }
            z = eased(&r);
            let next = dot(&r, &z);
            let share = next / rz;
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = *z + *p * share);
        }
        x.iter_mut().zip(&d).for_each(|(x, d)| *x += *d);
    }
}

/// Pairs of corners next to each other, each once.
pub(crate) fn pairs(quads: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut seen = HashSet::new();
    let mut all = Vec::new();
    for q in quads {
        for k in 0..4 {
            let (a, b) = (q[k], q[(k + 1) % 4]);
            let pair = [a.min(b), a.max(b)];
            if a != b && seen.insert(pair) {
                all.push(pair);
            }
        }
    }
    all
}
