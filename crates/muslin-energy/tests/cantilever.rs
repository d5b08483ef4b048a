//! Is the bending stiffness of a mesh that of the fabric? Cylinders and cantilevers say.

use glam::{DVec2, DVec3};
use muslin_energy::check::Rng;
use muslin_energy::flat::{self, FlatHinge};
use muslin_energy::hinge::{self, Bend, RestHinge};
use muslin_energy::plate;

const B: f64 = 1e-5;
const PLAIN: Bend = Bend { warp: B, weft: B };

/// How a rectangle is cut into triangles.
#[derive(Clone, Copy, Debug)]
enum Cut {
    /// Squares with one diagonal, all the same way.
    OneWay,
    /// Squares with diagonals that alternate.
    Alternating,
    /// Rows of equilateral triangles.
    Equilateral,
    /// Equilateral, every vertex moved by up to a fifth of an edge.
    Shaken,
}

/// Who says what bending costs.
#[derive(Clone, Copy)]
enum Law {
    Angles,
    Flat,
    Plates,
}

struct Sheet {
    points: Vec<DVec2>,
    faces: Vec<[u32; 3]>,
    hinges: Vec<hinge::Stencil>,
    /// Vertices across the width.
    columns: usize,
}

impl Sheet {
    /// `size`: width along x and length along y [m]; `edge` [m].
    fn new(cut: Cut, size: DVec2, edge: f64) -> Self {
        let regular = matches!(cut, Cut::Equilateral | Cut::Shaken);
        let (columns, rows) = (
            (size.x / edge).round() as usize + 1,
            (size.y / (edge * if regular { 0.75_f64.sqrt() } else { 1.0 })).round() as usize + 1,
        );
        let step = DVec2::new(size.x / (columns - 1) as f64, size.y / (rows - 1) as f64);
        let mut rng = Rng::new(11);
        let mut points = Vec::new();
        for r in 0..rows {
            for c in 0..columns {
                let inner = r > 1 && r + 1 < rows && c > 0 && c + 1 < columns;
                // Every second row stands half an edge over; its ends stay on the rim.
                let over = if regular && r % 2 == 1 && c + 1 < columns {
                    0.5
                } else {
                    0.0
                };
                let shake = if matches!(cut, Cut::Shaken) && inner {
                    0.2
                } else {
                    0.0
                };
                let off = rng.vector().truncate() * shake;
                points.push(step * (DVec2::new(c as f64 + over, r as f64) + off));
            }
        }
        let mut faces = Vec::new();
        for r in 0..rows - 1 {
            for c in 0..columns - 1 {
                let i = (r * columns + c) as u32;
                let [p, q, s, t] = [i, i + 1, i + columns as u32, i + columns as u32 + 1];
                let falling = match cut {
                    Cut::OneWay => false,
                    Cut::Alternating => (r + c) % 2 == 1,
                    Cut::Equilateral | Cut::Shaken => r % 2 == 0,
                };
                faces.extend(if falling {
                    [[p, q, s], [q, t, s]]
                } else {
                    [[p, q, t], [p, t, s]]
                });
            }
        }
        let hinges = hinge::stencils(&faces);
        Self {
            points,
            faces,
            hinges,
            columns,
        }
    }

    fn corners(&self) -> Vec<[DVec2; 3]> {
        self.faces
            .iter()
            .map(|f| f.map(|v| self.points[v as usize]))
            .collect()
    }

    fn rests(&self, bend: &Bend) -> Vec<RestHinge> {
        let corners = self.corners();
        self.hinges
            .iter()
            .map(|h| RestHinge::new(h.corners(&corners), bend, 0.0))
            .collect()
    }

    /// Energy per area over `½ B κ²` on a cylinder whose axis is across `around`, rim left out.
    fn cylinder(&self, around: DVec2, curvature: f64, bend: &Bend) -> f64 {
        let corners = self.corners();
        let onto = |p: DVec2| {
            let (s, c) = (around.dot(p) * curvature).sin_cos();
            DVec3::new(around.perp_dot(p), s / curvature, (c - 1.0) / curvature)
        };
        let middle = |h: &hinge::Stencil| {
            let p = 0.5 * (self.points[h.verts[0] as usize] + self.points[h.verts[1] as usize]);
            p.x > 0.03 && p.x < 0.07 && p.y > 0.03 && p.y < 0.07
        };
        let (mut energy, mut area) = (0.0, 0.0);
        for (h, rest) in self.hinges.iter().zip(self.rests(bend)) {
            if middle(h) {
                let x = h.verts.map(|v| onto(self.points[v as usize]));
                energy += hinge::energy(&x, &rest);
                // Each hinge stands for a third of both its faces.
                for [p, q, r] in h.corners(&corners) {
                    area += (q - p).perp_dot(r - p).abs() / 6.0;
                }
            }
        }
        energy / (area * 0.5 * bend.along(around) * curvature * curvature)
    }

    /// `B` as read from the tip of the clamped strip under its own weight, over the given `B`.
    ///
    /// Small deflection: `w = q l⁴ / (8 B)`, the matrix from the law's Hessian, height alone.
    fn cantilever(&self, law: Law) -> f64 {
        let matrix = match law {
            Law::Angles => self.hinged(false),
            Law::Flat => self.hinged(true),
            Law::Plates => self.plated(),
        };
        self.deflected(matrix)
    }

    fn plated(&self) -> Vec<Vec<f64>> {
        let n = self.points.len();
        let mut matrix = vec![vec![0.0; n]; n];
        for (i, j, q) in plate::entries(&self.faces, &self.corners(), |_| PLAIN) {
            matrix[i as usize][j as usize] += q;
        }
        matrix
    }

    fn hinged(&self, flat_form: bool) -> Vec<Vec<f64>> {
        let x: Vec<DVec3> = self.points.iter().map(|p| p.extend(0.0)).collect();
        let n = self.points.len();
        let mut matrix = vec![vec![0.0; n]; n];
        let corners = self.corners();
        for (h, rest) in self.hinges.iter().zip(self.rests(&PLAIN)) {
            let at = h.verts.map(|v| x[v as usize]);
            let local = if flat_form {
                flat::hessian(&at, &FlatHinge::new(h.corners(&corners), &PLAIN))
            } else {
                hinge::hessian(&at, &rest)
            };
            for i in 0..4 {
                for j in 0..4 {
                    matrix[h.verts[i] as usize][h.verts[j] as usize] +=
                        local.hessian[i][j].z_axis.z;
                }
            }
        }
        matrix
    }

    fn deflected(&self, matrix: Vec<Vec<f64>>) -> f64 {
        let (n, fixed) = (self.points.len(), 2 * self.columns);
        let mut load = vec![0.0; n];
        for (f, [p, q, r]) in self.faces.iter().zip(&self.corners()) {
            f.iter()
                .for_each(|v| load[*v as usize] += (*q - *p).perp_dot(*r - *p).abs() / 6.0);
        }
        let matrix: Vec<Vec<f64>> = matrix[fixed..]
            .iter()
            .map(|row| row[fixed..].to_vec())
            .collect();
        let tip = solve(matrix, load[fixed..].to_vec());
        let end = &tip[tip.len() - self.columns..];
        let deflection = end.iter().sum::<f64>() / end.len() as f64;
        // The hinge in the clamped row bends for half an edge on its far side too.
        let edge = self.points[self.columns].y - self.points[0].y;
        let length = self.points[n - 1].y - 0.5 * edge;
        length.powi(4) / (8.0 * deflection) / B
    }
}

/// Cholesky, dense: the strips are small.
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

const GARMENT_LIKE: [Cut; 2] = [Cut::Equilateral, Cut::Shaken];
const SQUARES: [Cut; 2] = [Cut::OneWay, Cut::Alternating];

fn square(cut: Cut) -> Sheet {
    Sheet::new(cut, DVec2::splat(0.1), 0.002)
}

#[test]
fn a_cylinder_along_either_yarn_stores_half_b_kappa_squared_per_area() {
    for cut in [SQUARES, GARMENT_LIKE].concat() {
        for around in [DVec2::X, DVec2::Y] {
            let ratio = square(cut).cylinder(around, 5.0, &PLAIN);
            assert!((0.93..1.1).contains(&ratio), "{cut:?} {around}: {ratio:.3}");
        }
    }
}

#[test]
fn on_equilateral_meshes_the_bias_is_as_stiff_and_on_squares_it_is_stiffer() {
    let bias = DVec2::ONE.normalize();
    for cut in GARMENT_LIKE {
        let ratio = square(cut).cylinder(bias, 5.0, &PLAIN);
        assert!((0.95..1.1).contains(&ratio), "{cut:?}: {ratio:.3}");
    }
    // Why garments are not cut into squares: a fold on the bias costs up to three times its due.
    let one_way = square(Cut::OneWay).cylinder(bias, 5.0, &PLAIN);
    let alternating = square(Cut::Alternating).cylinder(bias, 5.0, &PLAIN);
    assert!((2.9..3.1).contains(&one_way) && (1.4..1.6).contains(&alternating));
}

#[test]
fn warp_and_weft_keep_their_own_stiffness() {
    let denim = Bend {
        warp: 6e-5,
        weft: 4e-5,
    };
    for (cut, worst) in [
        (Cut::OneWay, 1.05),
        (Cut::Equilateral, 1.2),
        (Cut::Shaken, 1.3),
    ] {
        for around in [DVec2::X, DVec2::Y] {
            // A slanting edge mixes the two: on equilateral meshes a sixth of the other yarn.
            let ratio = square(cut).cylinder(around, 5.0, &denim);
            assert!(
                ratio > 0.93 && ratio < worst,
                "{cut:?} {around}: {ratio:.3}"
            );
        }
    }
}

#[test]
fn a_cantilever_of_equilateral_triangles_reads_its_fabric_within_a_tenth() {
    for cut in GARMENT_LIKE {
        for (width, length, edge) in [(0.05, 0.1, 0.01), (0.05, 0.1, 0.005), (0.02, 0.1, 0.005)] {
            let strip = Sheet::new(cut, DVec2::new(width, length), edge);
            for law in [Law::Angles, Law::Flat] {
                let ratio = strip.cantilever(law);
                assert!(
                    (0.9..1.0).contains(&ratio),
                    "{cut:?} {width} {edge}: {ratio:.3}"
                );
            }
        }
    }
}

#[test]
fn a_cantilever_of_squares_relaxes_across_and_reads_a_sixth_less() {
    for cut in SQUARES {
        for edge in [0.01, 0.005] {
            let ratio = Sheet::new(cut, DVec2::new(0.05, 0.1), edge).cantilever(Law::Angles);
            assert!((0.82..0.9).contains(&ratio), "{cut:?} {edge}: {ratio:.3}");
        }
    }
}

#[test]
fn plates_read_their_fabric_however_a_strip_is_cut() {
    for (cut, off) in [
        (Cut::OneWay, 0.03),
        (Cut::Alternating, 0.03),
        (Cut::Equilateral, 0.03),
        (Cut::Shaken, 0.05),
    ] {
        for (width, edge) in [(0.05, 0.01), (0.05, 0.005), (0.02, 0.005)] {
            let strip = Sheet::new(cut, DVec2::new(width, 0.1), edge);
            let ratio = strip.cantilever(Law::Plates);
            assert!(
                (ratio - 1.0).abs() < off,
                "{cut:?} {width} {edge}: {ratio:.3}"
            );
        }
    }
}
