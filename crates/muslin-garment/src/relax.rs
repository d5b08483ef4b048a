//! Relax: cloth drawn to the shape it was cut in, outside of bodies, with its seams pulled shut.
//!
//! Local and global steps in turn, as in projective dynamics (Bouaziz and others 2014): each
//! triangle is turned to lie as it was cut, then one linear system finds the positions that suit
//! triangles, seams and smoothness best, pushed out of the skin only along its normal, so that
//! cloth slides. No mass and no fabric: this finds a start from which real cloth can settle, and
//! it never lets a vertex move far in one round, so that nothing jumps through a limb.

use glam::{DVec2, DVec3};
use muslin_geom::{Mesh, Surface, self_intersections};
use rayon::prelude::*;

/// Cloth with what follows from its cut.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Elastic {
    pub faces: Vec<[u32; 3]>,
    /// Each face's corners on the cloth [m].
    pub rest: Vec<[DVec2; 3]>,
    /// For every vertex, its corners as `3 · face + corner`.
    corners: Vec<Vec<u32>>,
    /// Neighbours and how firmly the shape holds them.
    pub rows: Vec<Vec<(u32, f64)>>,
    /// Seams not yet closed: pairs of vertices.
    stitches: Vec<Vec<u32>>,
    /// Whether a vertex has cloth all around.
    inner: Vec<bool>,
}

/// What cloth has to stay outside of, and by how much [m].
pub(crate) struct Outside<'a> {
    pub surface: &'a Surface,
    pub gap: f64,
    /// Vertices where an open surface ends; beyond them it has no sides.
    pub rim: Option<&'a [bool]>,
}

/// How a round goes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    /// Strength of open seams against that of the cloth.
    pub stitch: f64,
    /// Strength of smoothness.
    pub smooth: f64,
    /// Farthest that a vertex moves [m].
    pub most: f64,
    /// By how much cloth may be shorter than cut without resisting: it will fold there.
    pub slack: f64,
}

/// What a run of rounds remembers from one to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    /// A near face of each surface for each vertex.
    hints: Vec<Vec<u32>>,
    /// Where cloth has to leave cloth that it passed through.
    apart: Vec<Touch>,
    /// The fewest crossings found so far.
    fewest: Option<usize>,
}

/// A vertex on the skin: outward direction, and how far along it the vertex must be [m].
type Touch = Option<(DVec3, f64)>;

/// Faces whose normals' cosine is above this do not face each other.
const FACING: f64 = 0.2;
/// Slack of cloth that may fold.
pub(crate) const FOLDS: f64 = 0.3;
/// Growth of the number of crossings at which leading apart is given up.
const WORSE: usize = 3;
/// How far crossing cloth is led apart [m].
const APART: f64 = 3e-3;
/// Strength of the skin against that of the cloth.
const SKIN: f64 = 8.0;
/// Strength with which a vertex stays where it was.
const STAY: f64 = 0.02;
/// Rounds of conjugate gradients.
const SOLVES: usize = 24;
/// How far from a vertex the skin is looked for [m].
const REACH: f64 = 0.1;

impl Elastic {
    pub fn new(faces: Vec<[u32; 3]>, rest: Vec<[DVec2; 3]>, n_verts: usize) -> Elastic {
        let mut corners = vec![Vec::new(); n_verts];
        let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n_verts];
        for (t, (f, r)) in faces.iter().zip(&rest).enumerate() {
            let w = hold(r);
            for k in 0..3 {
                let (i, j) = (f[k], f[(k + 1) % 3]);
                corners[i as usize].push((3 * t + k) as u32);
                rows[i as usize].push((j, w[k]));
                rows[j as usize].push((i, w[k]));
            }
        }
        let mut inner = vec![true; n_verts];
        for (row, inner) in rows.iter_mut().zip(&mut inner) {
            row.sort_by_key(|e| e.0);
            let shared = row.chunk_by(|a, b| a.0 == b.0).all(|c| c.len() > 1);
            *inner = shared && !row.is_empty();
            row.dedup_by(|b, a| {
                let same = a.0 == b.0;
                a.1 += if same { b.1 } else { 0.0 };
                same
            });
        }
        Elastic {
            faces,
            rest,
            corners,
            rows,
            stitches: vec![Vec::new(); n_verts],
            inner,
        }
    }

    /// Pulls these pairs of vertices together from now on.
    pub fn stitched(mut self, pairs: &[[u32; 2]]) -> Elastic {
        for &[a, b] in pairs {
            self.stitches[a as usize].push(b);
            self.stitches[b as usize].push(a);
        }
        self
    }

    /// One round outside of all these.
    pub fn round(
        &self,
        x: &mut [DVec3],
        (outside, memory): (&[Outside], &mut Memory),
        how: &Round,
    ) {
        let hints = &mut memory.hints;
        hints.resize_with(outside.len(), || vec![0; x.len()]);
        let mut touches: Vec<Vec<Touch>> = (outside.iter().zip(hints))
            .map(|(o, hints)| touches(o, x, hints))
            .collect();
        if !memory.apart.is_empty() {
            touches.push(memory.apart.clone());
        }
        let turned = self.turned(x, how.slack);
        let right: Vec<DVec3> = (0..x.len())
            .into_par_iter()
            .map(|i| self.right(i, x[i], &turned, &touches))
            .collect();
        let system = System {
            cloth: self,
            touches: &touches,
            how,
        };
        let new = system.solve(x, &right);
        for (x, new) in x.iter_mut().zip(new) {
            *x += (new - *x).clamp_length_max(how.most);
        }
    }

    /// Every face as it was cut, turned to lie as it lies at `x`: its sides [m].
    fn turned(&self, x: &[DVec3], slack: f64) -> Vec<[DVec3; 3]> {
        let one = |(f, r): (&[u32; 3], &[DVec2; 3])| {
            let [u, v] = nearest_shape(f.map(|i| x[i as usize]), r, slack);
            let lift = |d: DVec2| u * d.x + v * d.y;
            [0, 1, 2].map(|k| lift(r[(k + 1) % 3] - r[k]))
        };
        self.faces.par_iter().zip(&self.rest).map(one).collect()
    }

    fn right(&self, i: usize, x: DVec3, turned: &[[DVec3; 3]], touches: &[Vec<Touch>]) -> DVec3 {
        let mut sum = x * STAY;
        for &c in &self.corners[i] {
            let (t, k) = (c as usize / 3, c as usize % 3);
            let w = hold(&self.rest[t]);
            let last = (k + 2) % 3;
            sum += turned[t][last] * w[last] - turned[t][k] * w[k];
        }
        let held = touches.iter().filter_map(|t| t[i]);
        sum + held.map(|(n, d)| n * (d * SKIN)).sum::<DVec3>()
    }

    /// Looks where cloth passes through cloth, for the next rounds to mend; says in how many
    /// places.
    ///
    /// Where two pieces face each other, as sleeve and side do in an armpit, each belongs on the
    /// outer side of the other. Others are left alone: which is over which is not known.
    pub fn find_crossings(&self, x: &[DVec3], memory: &mut Memory) -> usize {
        let mesh = Mesh {
            verts: x.to_vec(),
            faces: self.faces.clone(),
        };
        let pairs = self_intersections(&mesh);
        let fewest = memory.fewest.map_or(pairs.len(), |f| f.min(pairs.len()));
        memory.fewest = Some(fewest);
        if pairs.is_empty() || pairs.len() > WORSE * fewest + WORSE * 10 {
            // The guess which side is which was wrong; shape and smoothness do better alone.
            memory.apart.clear();
            return pairs.len();
        }
        let mut apart: Vec<Touch> = vec![None; x.len()];
        for [a, b] in pairs.iter().flat_map(|&[a, b]| [[a, b], [b, a]]) {
            let corners = |f: u32| self.faces[f as usize].map(|i| x[i as usize]);
            let normal = |[p, q, r]: [DVec3; 3]| (q - p).cross(r - p).normalize_or_zero();
            let (n, wall) = (normal(corners(b)), corners(b)[0]);
            if normal(corners(a)).dot(n) > FACING {
                continue;
            }
            for i in self.faces[a as usize] {
                let (slot, p) = (&mut apart[i as usize], x[i as usize]);
                let deeper = |t: &(DVec3, f64)| t.1 - t.0.dot(p);
                let new = (n, n.dot(wall) + APART);
                if deeper(&new) > slot.as_ref().map_or(0.0, deeper) {
                    *slot = Some(new);
                }
            }
        }
        memory.apart = apart;
        pairs.len()
    }

    /// How far each pair of an open seam still is apart, at most [m].
    pub fn gap(&self, x: &[DVec3]) -> f64 {
        let apart = |(i, row): (usize, &Vec<u32>)| {
            let all = row.iter().map(|&j| x[i].distance(x[j as usize]));
            all.fold(0.0, f64::max)
        };
        self.stitches
            .iter()
            .enumerate()
            .map(apart)
            .fold(0.0, f64::max)
    }

    /// The larger principal strain of every face (0.1 is 10 % longer).
    pub fn strains(&self, x: &[DVec3]) -> Vec<f64> {
        let one = |(f, r): (&[u32; 3], &[DVec2; 3])| {
            let [u, v] = deformation(f.map(|i| x[i as usize]), r);
            let (a, b, d) = (u.length_squared(), u.dot(v), v.length_squared());
            (0.5 * (a + d) + (0.5 * (a - d)).hypot(b)).sqrt() - 1.0
        };
        self.faces.iter().zip(&self.rest).map(one).collect()
    }
}

/// How firmly each side holds its length: half the cotangent of the angle across, kept positive.
fn hold(t: &[DVec2; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let (p, q) = (t[k] - t[(k + 2) % 3], t[(k + 1) % 3] - t[(k + 2) % 3]);
        (0.5 * p.dot(q) / p.perp_dot(q).abs().max(1e-12)).clamp(0.05, 5.0)
    })
}

/// Where a unit of weft and of warp went.
fn deformation(x: [DVec3; 3], r: &[DVec2; 3]) -> [DVec3; 2] {
    let (a, b) = (r[1] - r[0], r[2] - r[0]);
    let (p, q) = (x[1] - x[0], x[2] - x[0]);
    let twice = a.perp_dot(b);
    let twice = if twice.abs() < 1e-14 { 1e-14 } else { twice };
    [(p * b.y - q * a.y) / twice, (q * a.x - p * b.x) / twice]
}

/// The shape nearest to a face's deformation that is nowhere longer than it was cut, nor shorter
/// than by the share `slack`: without slack the polar factor of a 3 × 2 matrix.
fn nearest_shape(x: [DVec3; 3], r: &[DVec2; 3], slack: f64) -> [DVec3; 2] {
    let [u, v] = deformation(x, r);
    let (a, b, d) = (u.length_squared(), u.dot(v), v.length_squared());
    let (mean, half) = (0.5 * (a + d), (0.5 * (a - d)).hypot(b));
    let [long, short] = [mean + half, mean - half].map(|l| l.max(0.0).sqrt());
    if short.is_nan() || short < 1e-6 {
        let along = u.normalize_or(v.normalize_or(DVec3::X));
        return [along, along.any_orthonormal_vector()];
    }
    let [p, q] = [long, short].map(|s| s.clamp(1.0 - slack, 1.0) / s);
    // The direction of the longer stretch; any will do where both are equal.
    let turn = 0.5 * (2.0 * b).atan2(a - d);
    let (sin, cos) = turn.sin_cos();
    let (m, n, o) = (
        p * cos * cos + q * sin * sin,
        (p - q) * sin * cos,
        p * sin * sin + q * cos * cos,
    );
    [u * m + v * n, u * n + v * o]
}

fn touches(o: &Outside, x: &[DVec3], hints: &mut [u32]) -> Vec<Touch> {
    let reach = REACH + o.gap.max(0.0);
    x.par_iter()
        .zip(hints)
        .map(|(p, hint)| {
            let hit = o.surface.closest_near(*p, reach, *hint)?;
            *hint = hit.face;
            if hit.signed > o.gap {
                return None;
            }
            if let Some(rim) = o.rim {
                let f = o.surface.faces()[hit.face as usize];
                let ends = (0..3).all(|k| hit.weights[k] < 1e-9 || rim[f[k] as usize]);
                if ends {
                    return None;
                }
            }
            let away = (*p - hit.point) * hit.signed.signum();
            let n = if away.length() > 1e-5 {
                away.normalize()
            } else {
                hit.normal
            };
            Some((n, n.dot(hit.point) + o.gap))
        })
        .collect()
}

/// The linear system of a round.
struct System<'a> {
    cloth: &'a Elastic,
    touches: &'a [Vec<Touch>],
    how: &'a Round,
}

impl System<'_> {
    fn times(&self, x: &[DVec3]) -> Vec<DVec3> {
        let bumps = self.bumps(x);
        let one = |i: usize| {
            let mut out = x[i] * STAY;
            for &(j, w) in &self.cloth.rows[i] {
                out += (x[i] - x[j as usize]) * w;
            }
            for &j in &self.cloth.stitches[i] {
                out += (x[i] - x[j as usize]) * self.how.stitch;
            }
            for (n, _) in self.touches.iter().filter_map(|t| t[i]) {
                out += n * (n.dot(x[i]) * SKIN);
            }
            let row = &self.cloth.rows[i];
            let from = |j: u32| bumps[j as usize] / self.cloth.rows[j as usize].len() as f64;
            let back: DVec3 = row.iter().map(|&(j, _)| from(j)).sum();
            out + (bumps[i] - back) * self.how.smooth
        };
        (0..x.len())
            .into_par_iter()
            .with_min_len(256)
            .map(one)
            .collect()
    }

    /// How far each inner vertex is from the middle of its neighbours [m].
    fn bumps(&self, x: &[DVec3]) -> Vec<DVec3> {
        let one = |i: usize| {
            if !self.cloth.inner[i] {
                return DVec3::ZERO;
            }
            let row = &self.cloth.rows[i];
            x[i] - row.iter().map(|&(j, _)| x[j as usize]).sum::<DVec3>() / row.len() as f64
        };
        (0..x.len())
            .into_par_iter()
            .with_min_len(256)
            .map(one)
            .collect()
    }

    fn diagonal(&self) -> Vec<f64> {
        let one = |i: usize| {
            let shape: f64 = self.cloth.rows[i].iter().map(|e| e.1).sum();
            let seams = self.cloth.stitches[i].len() as f64 * self.how.stitch;
            let held = self.touches.iter().filter(|t| t[i].is_some()).count();
            STAY + shape + seams + self.how.smooth * 1.2 + held as f64 * SKIN / 3.0
        };
        (0..self.cloth.rows.len()).map(one).collect()
    }

    /// Conjugate gradients from `x`.
    fn solve(&self, x: &[DVec3], right: &[DVec3]) -> Vec<DVec3> {
        let dot =
            |a: &[DVec3], b: &[DVec3]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
        let scale = self.diagonal();
        let smooth =
            |r: &[DVec3]| -> Vec<DVec3> { r.iter().zip(&scale).map(|(r, s)| r / *s).collect() };
        let mut x = x.to_vec();
        let ax = self.times(&x);
        let mut r: Vec<DVec3> = right.iter().zip(&ax).map(|(b, a)| b - a).collect();
        let mut z = smooth(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        for _ in 0..SOLVES {
            let ap = self.times(&p);
            let a = rz / dot(&p, &ap).max(f64::MIN_POSITIVE);
            for i in 0..x.len() {
                x[i] += p[i] * a;
                r[i] -= ap[i] * a;
            }
            z = smooth(&r);
            let new = dot(&r, &z);
            let b = new / rz.max(f64::MIN_POSITIVE);
            for i in 0..x.len() {
                p[i] = z[i] + p[i] * b;
            }
            rz = new;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_and_stretched_strip_gets_its_shape_back() {
        let n = 12;
        let flat: Vec<DVec2> = (0..2 * n)
            .map(|i| DVec2::new(f64::from(i / 2), f64::from(i % 2)) * 0.01)
            .collect();
        let mut faces = Vec::new();
        for k in 0..n as u32 - 1 {
            let a = 2 * k;
            faces.extend([[a, a + 2, a + 3], [a, a + 3, a + 1]]);
        }
        let rest = faces
            .iter()
            .map(|f: &[u32; 3]| f.map(|i| flat[i as usize]))
            .collect();
        let cloth = Elastic::new(faces, rest, flat.len());
        let mut x: Vec<DVec3> = (flat.iter())
            .map(|p| DVec3::new(1.4 * p.x, p.y, 5.0 * p.x * p.x))
            .collect();
        let how = Round {
            stitch: 0.0,
            smooth: 0.01,
            most: 0.05,
            slack: 0.0,
        };
        let mut memory = Memory::default();
        for _ in 0..200 {
            cloth.round(&mut x, (&[], &mut memory), &how);
        }
        let worst = cloth
            .strains(&x)
            .into_iter()
            .map(f64::abs)
            .fold(0.0, f64::max);
        assert!(worst < 0.01, "{worst}");
    }

    #[test]
    fn the_turn_of_a_turned_face_is_that_turn() {
        let r = [DVec2::ZERO, DVec2::X, DVec2::new(0.3, 0.8)];
        let (u, v) = (DVec3::new(0.6, 0.0, 0.8), DVec3::Y);
        let x = r.map(|p| (u * p.x + v * p.y) * 1.3 + DVec3::ONE);
        let [a, b] = nearest_shape(x, &r, 0.0);
        assert!(a.distance(u) < 1e-12 && b.distance(v) < 1e-12);
        let squeezed = r.map(|p| u * p.x * 0.8 + v * p.y * 1.2);
        let [a, b] = nearest_shape(squeezed, &r, 0.3);
        assert!(a.distance(u * 0.8) < 1e-12 && b.distance(v) < 1e-12);
    }
}
