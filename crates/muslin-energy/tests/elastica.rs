//! A strip of cloth that hangs over an edge, against the elastica: the whole of stretch, bending
//! and weight at large angles, minimised with the laws' own gradients and Hessians.

use glam::{DMat3, DVec2, DVec3};
use muslin_energy::hinge::{self, Bend, RestHinge, Stencil};
use muslin_energy::membrane::{self, Stretch};
use muslin_energy::{Local, RestTriangle, point};

/// 150 g/m², 5 cm overhang: the strip whose angles are tabled for three stiffnesses.
const DENSITY: f64 = 0.15;
const OVERHANG: f64 = 0.05;
const COLUMNS: usize = 4;
const G: f64 = 9.81;

struct Strip {
    faces: Vec<([usize; 3], RestTriangle)>,
    hinges: Vec<(Stencil, RestHinge)>,
    masses: Vec<f64>,
    x: Vec<DVec3>,
    /// From here on vertices may move: two rows are clamped.
    free: usize,
}

impl Strip {
    /// Rows of near-equilateral triangles along z, the clamp's edge at z = 0, at `edge` [m].
    fn new(edge: f64, bend: f64) -> Self {
        let high = edge * 0.75_f64.sqrt();
        // The hinge in the second clamped row bends for half a row on either side.
        let rows = ((OVERHANG / high) - 0.5).round() as usize + 2;
        let step = OVERHANG / (rows as f64 - 1.5);
        let mut plane = Vec::new();
        for r in 0..rows {
            let over = if r % 2 == 1 { 0.5 * edge } else { 0.0 };
            plane.extend(
                (0..COLUMNS).map(|c| DVec2::new(c as f64 * edge + over, (r as f64 - 0.5) * step)),
            );
        }
        let faces = triangles(rows);
        let corners: Vec<[DVec2; 3]> = faces.iter().map(|f| f.map(|v| plane[v as usize])).collect();
        let bend = Bend {
            warp: bend,
            weft: bend,
        };
        let mut masses = vec![0.0; plane.len()];
        let mut patches = Vec::new();
        for (f, c) in faces.iter().zip(&corners) {
            let rest = RestTriangle::new(*c).expect("near-equilateral triangles have area");
            let f = f.map(|v| v as usize);
            f.iter()
                .for_each(|v| masses[*v] += DENSITY * rest.area / 3.0);
            patches.push((f, rest));
        }
        let rest = |h: &Stencil| RestHinge::new(h.corners(&corners), &bend, 0.0);
        let hinges = hinge::stencils(&faces)
            .into_iter()
            .map(|h| (h, rest(&h)))
            .collect();
        let x = plane.iter().map(|p| DVec3::new(p.x, 0.0, p.y)).collect();
        Self {
            faces: patches,
            hinges,
            masses,
            x,
            free: 2 * COLUMNS,
        }
    }

    fn energy(&self, x: &[DVec3]) -> f64 {
        let stretch: f64 = self
            .faces
            .iter()
            .map(|(f, rest)| membrane::energy(&f.map(|v| x[v]), rest, &WEAVE))
            .sum();
        let bend: f64 = self
            .hinges
            .iter()
            .map(|(h, r)| hinge::energy(&h.verts.map(|v| x[v as usize]), r))
            .sum();
        let weight: f64 = (self.free..x.len()).map(|i| self.weight(x, i).energy).sum();
        stretch + bend + weight
    }

    fn weight(&self, x: &[DVec3], i: usize) -> muslin_energy::AtPoint {
        point::gravity(x[i], self.masses[i], DVec3::NEG_Y * G)
    }

    /// Gradient and Hessian of the free vertices.
    fn system(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let n = 3 * (self.x.len() - self.free);
        let mut system = (vec![0.0; n], vec![vec![0.0; n]; n]);
        for (f, rest) in &self.faces {
            self.gather(
                &mut system,
                *f,
                &membrane::hessian(&f.map(|v| self.x[v]), rest, &WEAVE),
            );
        }
        for (h, rest) in &self.hinges {
            let v = h.verts.map(|v| v as usize);
            self.gather(&mut system, v, &hinge::hessian(&v.map(|v| self.x[v]), rest));
        }
        for i in self.free..self.x.len() {
            self.gather(&mut system, [i], &self.weight(&self.x, i).spread(&[1.0]));
        }
        system
    }

    fn gather<const N: usize>(
        &self,
        (gradient, matrix): &mut (Vec<f64>, Vec<Vec<f64>>),
        verts: [usize; N],
        local: &Local<N>,
    ) {
        for i in 0..N {
            let Some(row) = verts[i].checked_sub(self.free) else {
                continue;
            };
            for a in 0..3 {
                gradient[3 * row + a] += local.gradient[i][a];
            }
            for j in 0..N {
                let Some(column) = verts[j].checked_sub(self.free) else {
                    continue;
                };
                let block: DMat3 = local.hessian[i][j];
                for a in 0..3 {
                    for b in 0..3 {
                        matrix[3 * row + a][3 * column + b] += block.col(b)[a];
                    }
                }
            }
        }
    }

    /// One Newton step with halving; how far the farthest vertex went [m].
    fn step(&mut self) -> f64 {
        let (gradient, mut matrix) = self.system();
        for i in 0..matrix.len() {
            matrix[i][i] += 1e-4;
        }
        let d = solve(matrix, gradient.iter().map(|g| -g).collect());
        let descent: f64 = d.iter().zip(&gradient).map(|(d, g)| d * g).sum();
        let here = self.energy(&self.x);
        let mut share = 1.0;
        loop {
            let mut there = self.x.clone();
            for (i, p) in there[self.free..].iter_mut().enumerate() {
                *p += DVec3::new(d[3 * i], d[3 * i + 1], d[3 * i + 2]) * share;
            }
            if self.energy(&there) <= here + 1e-4 * share * descent || share < 1e-6 {
                let moved = self
                    .x
                    .iter()
                    .zip(&there)
                    .map(|(a, b)| a.distance(*b))
                    .fold(0.0, f64::max);
                self.x = there;
                return moved;
            }
            share *= 0.5;
        }
    }

    /// Angle of the line from the clamp's edge to the free end below the horizontal [degrees].
    fn angle(&self) -> f64 {
        let end = &self.x[self.x.len() - COLUMNS..];
        let tip = end.iter().sum::<DVec3>() / COLUMNS as f64;
        (-tip.y).atan2(tip.z).to_degrees()
    }
}

const WEAVE: Stretch = Stretch {
    warp: 1000.0,
    weft: 1000.0,
    shear: 300.0,
    compression: 1.0,
};

fn triangles(rows: usize) -> Vec<[u32; 3]> {
    let mut faces = Vec::new();
    for r in 0..rows - 1 {
        for c in 0..COLUMNS - 1 {
            let i = (r * COLUMNS + c) as u32;
            let [p, q, s, t] = [i, i + 1, i + COLUMNS as u32, i + COLUMNS as u32 + 1];
            faces.extend(if r % 2 == 0 {
                [[p, q, s], [q, t, s]]
            } else {
                [[p, q, t], [p, t, s]]
            });
        }
    }
    faces
}

/// Cholesky, dense.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = if i == j { sum.sqrt() } else { sum / a[j][j] };
        }
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..n).rev() {
        b[i] = (b[i] - (i + 1..n).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    b
}

/// The elastica's angle for a bending stiffness [N m] by shooting: `B κ′ = −ρ g (L − s) cos θ`.
fn elastica(bend: f64) -> f64 {
    let shoot = |kappa: f64| {
        let (n, mut theta, mut k, mut at) = (20_000, 0.0_f64, kappa, DVec2::ZERO);
        let ds = OVERHANG / n as f64;
        for i in 0..n {
            let s = (i as f64 + 0.5) * ds;
            let middle = theta + 0.5 * k * ds;
            at += DVec2::from(middle.sin_cos()) * ds;
            k -= DENSITY * G / bend * (OVERHANG - s) * middle.cos() * ds;
            theta += k * ds;
        }
        (k, at)
    };
    let (mut low, mut high) = (0.0, DENSITY * G * OVERHANG * OVERHANG / bend);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shoot(middle).0 > 0.0 {
            high = middle
        } else {
            low = middle
        }
    }
    let at = shoot(low).1;
    at.x.atan2(at.y).to_degrees()
}

#[test]
fn the_elastica_hangs_at_the_angles_that_are_tabled_for_it() {
    for (bend, degrees) in [(1e-5, 60.2), (3e-5, 35.1), (1e-4, 12.8), (3e-4, 4.4)] {
        let got = elastica(bend);
        assert!((got - degrees).abs() < 0.1, "B {bend:e}: {got:.2}");
    }
}

#[test]
fn a_strip_hangs_like_the_elastica_on_every_mesh() {
    for bend in [1e-5, 3e-5, 1e-4] {
        for edge in [0.01, 0.005] {
            let mut strip = Strip::new(edge, bend);
            let steps = (0..500).take_while(|_| strip.step() > 1e-8).count();
            assert!(steps < 500, "B {bend:e}, {edge} m: not settled");
            let (got, want) = (strip.angle(), elastica(bend));
            assert!(
                (got - want).abs() < 2.0,
                "B {bend:e}, {edge} m: {got:.2}, want {want:.2}"
            );
        }
    }
}
