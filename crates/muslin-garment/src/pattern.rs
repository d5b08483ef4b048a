//! The pattern: a garment's surface laid flat, panel by panel, with the grain upright.
//!
//! Panels are flattened as rigidly as possible (Liu, Zhang, Xu, Gotsman, Gortler, "A
//! local/global approach to mesh parameterization", 2008): each triangle keeps its shape up to
//! a rotation, as nearly as the curvature allows. `u` runs across the grain (weft), `v` along
//! it (warp), both in metres.

use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Where a face goes before it is flattened.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Laid {
    /// Panel number.
    pub panel: usize,
    /// First guess of the three corners [m], orientation as seen from outside or mirrored.
    pub corners: [DVec2; 3],
}

/// How far apart two corners of one vertex may be laid and still be joined [m].
const JOINED: f64 = 0.05;

/// Flattens a surface; `laid` has one entry per face. Returns the corners' places [m].
pub(crate) fn flatten(x: &[DVec3], faces: &[[u32; 3]], laid: &[Laid]) -> Vec<[DVec2; 3]> {
    let charts = Charts::new(faces, laid);
    let guess = charts.first_guess(laid);
    let local: Vec<[DVec2; 3]> = faces
        .iter()
        .map(|f| lay_flat(f.map(|i| x[i as usize])))
        .collect();
    let solved = charts.rigid(&local, guess, 10);
    charts
        .corner
        .iter()
        .map(|c| c.map(|i| solved[i as usize]))
        .collect()
}

/// A triangle in its own plane: the first corner at the origin, the second along x [m].
pub(crate) fn lay_flat([a, b, c]: [DVec3; 3]) -> [DVec2; 3] {
    let (ab, ac) = (b - a, c - a);
    let along = ab.normalize_or(DVec3::X);
    let x = ac.dot(along);
    let y = (ac - along * x).length();
    [DVec2::ZERO, DVec2::new(ab.length(), 0.0), DVec2::new(x, y)]
}

/// The rotation (cosine, sine) that turns triangle `from` most nearly onto `to`.
pub(crate) fn turn(from: &[DVec2; 3], to: &[DVec2; 3]) -> DVec2 {
    let mut sum = DVec2::ZERO;
    for k in 0..3 {
        let (a, b) = (from[(k + 1) % 3] - from[k], to[(k + 1) % 3] - to[k]);
        sum += DVec2::new(a.dot(b), a.perp_dot(b));
    }
    sum.normalize_or(DVec2::X)
}

/// Corners joined into the vertices of the flat panels.
struct Charts {
    corner: Vec<[u32; 3]>,
    n: usize,
}

impl Charts {
    fn new(faces: &[[u32; 3]], laid: &[Laid]) -> Charts {
        let mut label: Vec<u32> = (0..3 * faces.len() as u32).collect();
        let mut open: HashMap<(u32, u32), (usize, usize)> = HashMap::new();
        for (t, f) in faces.iter().enumerate() {
            for k in 0..3 {
                let j = (k + 1) % 3;
                if let Some((s, m)) = open.remove(&(f[j], f[k])) {
                    let n = (m + 1) % 3;
                    let same = laid[s].panel == laid[t].panel;
                    let near = |p: usize, q: usize| {
                        (laid[t].corners[p] - laid[s].corners[q]).length() < JOINED
                    };
                    if same && near(k, n) && near(j, m) {
                        join(&mut label, 3 * t + k, 3 * s + n);
                        join(&mut label, 3 * t + j, 3 * s + m);
                    }
                } else {
                    open.insert((f[k], f[j]), (t, k));
                }
            }
        }
        let mut number = HashMap::new();
        let mut corner = vec![[0; 3]; faces.len()];
        for c in 0..label.len() {
            let n = number.len() as u32;
            let r = root(&mut label, c);
            corner[c / 3][c % 3] = *number.entry(r).or_insert(n);
        }
        Charts {
            corner,
            n: number.len(),
        }
    }

    /// The first guess, mirrored where a panel was laid face down.
    fn first_guess(&self, laid: &[Laid]) -> Vec<DVec2> {
        let panels = laid.iter().map(|l| l.panel + 1).max().unwrap_or(0);
        let mut area = vec![0.0; panels];
        for l in laid {
            let [a, b, c] = l.corners;
            area[l.panel] += (b - a).perp_dot(c - a);
        }
        let mut guess = vec![DVec2::ZERO; self.n];
        for (c, l) in self.corner.iter().zip(laid) {
            let mirror = DVec2::new(area[l.panel].signum(), 1.0);
            for k in 0..3 {
                guess[c[k] as usize] = l.corners[k] * mirror;
            }
        }
        guess
    }

    /// Alternates best rotations and best positions.
    fn rigid(&self, local: &[[DVec2; 3]], mut uv: Vec<DVec2>, rounds: usize) -> Vec<DVec2> {
        let weights: Vec<[f64; 3]> = local.iter().map(cotangents).collect();
        for _ in 0..rounds {
            let mut right = vec![DVec2::ZERO; self.n];
            for ((c, l), w) in self.corner.iter().zip(local).zip(&weights) {
                let r = turn(l, &c.map(|i| uv[i as usize]));
                for k in 0..3 {
                    let j = (k + 1) % 3;
                    let pull = r.rotate(l[k] - l[j]) * w[k];
                    right[c[k] as usize] += pull;
                    right[c[j] as usize] -= pull;
                }
            }
            uv = self.solve(&weights, &right, uv, 40);
        }
        uv
    }

    /// Conjugate gradients on the weighted Laplacian, from `x`; each panel's mean stays put.
    fn solve(
        &self,
        w: &[[f64; 3]],
        right: &[DVec2],
        mut x: Vec<DVec2>,
        times: usize,
    ) -> Vec<DVec2> {
        let mut scale = vec![1e-12; self.n];
        for (c, w) in self.corner.iter().zip(w) {
            for k in 0..3 {
                scale[c[k] as usize] += w[k];
                scale[c[(k + 1) % 3] as usize] += w[k];
            }
        }
        let dot = |a: &[DVec2], b: &[DVec2]| -> DVec2 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let inverse =
            |r: &[DVec2]| -> Vec<DVec2> { r.iter().zip(&scale).map(|(r, s)| r / s).collect() };
        let ax = self.laplacian(w, &x);
        let mut r: Vec<DVec2> = right.iter().zip(&ax).map(|(b, a)| b - a).collect();
        let mut z = inverse(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        for _ in 0..times {
            let ap = self.laplacian(w, &p);
            let a = rz / dot(&p, &ap).max(DVec2::splat(1e-300));
            for i in 0..self.n {
                x[i] += p[i] * a;
                r[i] -= ap[i] * a;
            }
            z = inverse(&r);
            let new = dot(&r, &z);
            let b = new / rz.max(DVec2::splat(1e-300));
            for i in 0..self.n {
                p[i] = z[i] + p[i] * b;
            }
            rz = new;
        }
        x
    }

    fn laplacian(&self, w: &[[f64; 3]], x: &[DVec2]) -> Vec<DVec2> {
        let mut out = vec![DVec2::ZERO; self.n];
        for (c, w) in self.corner.iter().zip(w) {
            for k in 0..3 {
                let (i, j) = (c[k] as usize, c[(k + 1) % 3] as usize);
                let d = (x[i] - x[j]) * w[k];
                out[i] += d;
                out[j] -= d;
            }
        }
        out
    }
}

/// Half the cotangent of the angle across from each edge, kept positive.
fn cotangents(t: &[DVec2; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
        let (p, q) = (a - c, b - c);
        (0.5 * p.dot(q) / p.perp_dot(q).abs().max(1e-12)).max(0.01)
    })
}

fn root(label: &mut [u32], i: usize) -> usize {
    let mut i = i;
    while label[i] as usize != i {
        label[i] = label[label[i] as usize];
        i = label[i] as usize;
    }
    i
}

fn join(label: &mut [u32], a: usize, b: usize) {
    let (a, b) = (root(label, a), root(label, b));
    label[a.max(b)] = a.min(b) as u32;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a cylinder of radius 0.1 m, laid by its shadow on a plane.
    fn half_pipe() -> (Vec<DVec3>, Vec<[u32; 3]>, Vec<Laid>) {
        let (n, rows) = (16u32, 12u32);
        let mut x = Vec::new();
        for r in 0..=rows {
            for k in 0..=n {
                let t = std::f64::consts::PI * f64::from(k) / f64::from(n);
                x.push(DVec3::new(
                    -0.1 * t.cos(),
                    0.02 * f64::from(r),
                    0.1 * t.sin(),
                ));
            }
        }
        let mut faces = Vec::new();
        for r in 0..rows {
            for k in 0..n {
                let a = r * (n + 1) + k;
                let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        let laid = faces
            .iter()
            .map(|f| Laid {
                panel: 0,
                corners: f.map(|i| x[i as usize].truncate()),
            })
            .collect();
        (x, faces, laid)
    }

    #[test]
    fn a_half_pipe_unrolls_without_strain() {
        let (x, faces, laid) = half_pipe();
        let flat = flatten(&x, &faces, &laid);
        for (f, uv) in faces.iter().zip(&flat) {
            for k in 0..3 {
                let j = (k + 1) % 3;
                let (want, got) = (
                    (x[f[k] as usize] - x[f[j] as usize]).length(),
                    (uv[k] - uv[j]).length(),
                );
                assert!((got / want - 1.0).abs() < 0.03, "{got} for {want}");
            }
        }
    }

    #[test]
    fn turning_finds_the_rotation() {
        let a = [DVec2::ZERO, DVec2::X, DVec2::new(0.3, 0.8)];
        let r = DVec2::from_angle(0.7);
        let b = a.map(|p| r.rotate(p) + DVec2::ONE);
        assert!((turn(&a, &b) - r).length() < 1e-12);
    }
}
