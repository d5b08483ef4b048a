//! Bending of flat cloth, triangle by triangle: the same however the cloth was cut into triangles.
//!
//! A triangle curves by what its three edges fold, each across itself: with the folds `lᵢθᵢ = ΣKx`
//! of [`crate::flat`] and the edges' normals `nᵢ` in the cloth, `κ = Σᵢ lᵢθᵢ nᵢ⊗nᵢ / 2A`, and
//! `E = A/2r (B_weft κ₁₁² + B_warp κ₂₂² + (B_weft + B_warp) κ₁₂²)` [J]: the plate whose cylinders cost
//! [`Bend::along`]. Six vertices take part: the triangle's own and those across its edges.
//!
//! - Constant curvature is in balance on any mesh, so that nothing relaxes and a strip of any
//!   triangles reads its fabric; hinges one by one read 0.84 to 1.36 of it (see [`crate::hinge`]).
//! - `r` is how much a neighbourhood of uneven triangles overstates unit curvature along both yarns,
//!   as a mean: 1 on regular meshes, and 1 beside a rim.
//! - What curves across a rim is free, and takes the value that costs least.
//!
//! The curvature is that of the rotation-free triangle of Oñate and Zárate 2000, on the quadratic folds
//! of Bergou et al. 2006; `r` and the rim are ours.

use glam::{DMat2, DMat3, DVec2, DVec3};

use crate::{
    Local, flat,
    hinge::{Bend, Stencil, stencils},
    outer,
};

/// Vertices that a triangle's curvature depends on.
const VERTS: usize = 6;
/// A triangle smaller than this share of its neighbours' mean counts as so large.
const SLIVER: f64 = 0.25;
/// What uneven triangles may be taken to overstate at least and at most.
const EXCESS: [f64; 2] = [0.5, 3.0];

/// How a triangle and those across its edges resist curving together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// `Q` of `E = ½ ΣΣ Qᵢⱼ xᵢ·xⱼ` [N/m]; symmetric, never indefinite, rows sum to zero.
    pub matrix: [[f64; VERTS]; VERTS],
}

/// Of every triangle of a mesh: its vertices, those across its edges in the order of the edges, and
/// how they resist.
///
/// `rest`: every triangle's corners as cut [m], also where neighbours lie apart as at a seam; `bend`: its
/// stiffness. Beside softer cloth the softer one counts. Across a rim the triangle's own first corner
/// stands, with a row of zeros. A triangle without area resists nothing.
pub fn plates(
    faces: &[[u32; 3]],
    rest: &[[DVec2; 3]],
    bend: impl Fn(usize) -> Bend,
) -> Vec<([u32; VERTS], Plate)> {
    let hinges = stencils(faces);
    let weights = |s: &Stencil| flat::weights(s.corners(rest)).unwrap_or_default();
    let folds: Vec<[f64; 4]> = hinges.iter().map(weights).collect();
    let mut edges = vec![[None; 3]; faces.len()];
    for (h, stencil) in hinges.iter().enumerate() {
        for side in 0..2 {
            edges[stencil.faces[side] as usize][stencil.starts[side] as usize] = Some((h, side));
        }
    }
    let cut = |(f, edges): (usize, &[Option<(usize, usize)>; 3])| {
        let around = edges.map(|e| e.map(|(h, side)| (&hinges[h], &folds[h], side)));
        Triangle::new(f, faces[f], rest, around)
    };
    let triangles: Vec<Triangle> = edges.iter().enumerate().map(cut).collect();
    let excess = excess(faces, &triangles);
    let one = |(f, t): (usize, &Triangle)| {
        let softest =
            (t.around.iter().flatten()).fold(bend(f), |b, n| softer(b, bend(*n as usize)));
        (t.verts, t.plate(&softest, excess[f]))
    };
    triangles.iter().enumerate().map(one).collect()
}

/// The one matrix of all plates: `(i, j, Qᵢⱼ)` [N/m], entries of the same place to be added up.
pub fn entries(
    faces: &[[u32; 3]],
    rest: &[[DVec2; 3]],
    bend: impl Fn(usize) -> Bend,
) -> Vec<(u32, u32, f64)> {
    let mut out = Vec::with_capacity(VERTS * VERTS * faces.len());
    for (verts, plate) in plates(faces, rest, bend) {
        for (i, row) in verts.iter().zip(plate.matrix) {
            let entered = verts.iter().zip(row).filter(|(_, q)| *q != 0.0);
            out.extend(entered.map(|(j, q)| (*i, *j, q)));
        }
    }
    out
}

/// Between two cloths the softer one folds.
fn softer(a: Bend, b: Bend) -> Bend {
    Bend {
        warp: a.warp.min(b.warp),
        weft: a.weft.min(b.weft),
    }
}

/// A triangle among its neighbours, before it has a fabric.
struct Triangle {
    verts: [u32; VERTS],
    /// The face across each edge.
    around: [Option<u32>; 3],
    /// `K` of the fold along each edge; zeros at a rim.
    folds: [[f64; VERTS]; 3],
    /// `n⊗n` of each edge: weft, warp and mixed.
    across: [DVec3; 3],
    /// The material points of all vertices in the triangle's own plane [m].
    points: [DVec2; VERTS],
    area: f64,
    /// The area that its curvature is spread over: more than its own if it is a sliver.
    spread: f64,
}

impl Triangle {
    fn new(
        f: usize,
        [a, b, c]: [u32; 3],
        rest: &[[DVec2; 3]],
        edges: [Option<(&Stencil, &[f64; 4], usize)>; 3],
    ) -> Self {
        let own = rest[f];
        let mut t = Triangle {
            verts: [a, b, c, a, a, a],
            around: [None; 3],
            folds: [[0.0; VERTS]; 3],
            across: [0, 1, 2].map(|i| tensor((own[(i + 1) % 3] - own[i]).perp())),
            points: [own[0], own[1], own[2], own[0], own[0], own[0]],
            area: area(&own),
            spread: 0.0,
        };
        let mut others = Vec::with_capacity(3);
        for (i, edge) in edges.into_iter().enumerate() {
            let Some((stencil, weights, side)) = edge else {
                continue;
            };
            // The second face's edge runs from b to a.
            let order = [[0, 1, 2, 3], [1, 0, 3, 2]][side];
            let places = [i, (i + 1) % 3, (i + 2) % 3, 3 + i];
            for (place, corner) in places.into_iter().zip(order) {
                t.folds[i][place] = weights[corner];
            }
            let other = stencil.faces[1 - side];
            let theirs = stencil.corners(rest)[1 - side];
            t.around[i] = Some(other);
            t.verts[3 + i] = stencil.verts[order[3]];
            t.points[3 + i] = unfolded(&own, i, &theirs);
            others.push(area(&theirs));
        }
        let mean = others.iter().sum::<f64>() / others.len().max(1) as f64;
        t.spread = t.area.max(SLIVER * mean);
        t
    }

    /// What it would cost to curve by one along weft and along warp, of stiffness one, and what it should [m²].
    fn reading(&self) -> [f64; 2] {
        let mut sum = 0.0;
        for axis in 0..2 {
            let height = self.points.map(|p| {
                let along = p[axis] - self.points[0][axis];
                0.5 * along * along
            });
            let curved = (self.folds.iter().zip(&self.across))
                .map(|(k, n)| *n * (0..VERTS).map(|v| k[v] * height[v]).sum::<f64>())
                .sum::<DVec3>();
            sum += (curved * curved).dot(DVec3::new(1.0, 1.0, 2.0)) / (4.0 * self.spread);
        }
        [sum, 2.0 * self.area]
    }

    fn plate(&self, bend: &Bend, excess: f64) -> Plate {
        let mut matrix = [[0.0; VERTS]; VERTS];
        if self.area > 0.0 {
            let law = self.resists(bend);
            for (k, n) in self.folds.iter().zip(&self.across) {
                for (l, m) in self.folds.iter().zip(&self.across) {
                    let c = n.dot(law * *m) / (4.0 * self.spread * excess);
                    for i in 0..VERTS {
                        (0..VERTS).for_each(|j| matrix[i][j] += c * k[i] * l[j]);
                    }
                }
            }
        }
        Plate { matrix }
    }

    /// The plate's stiffness by weft, warp and mixed curvature [N m], less what rims leave free.
    fn resists(&self, bend: &Bend) -> DMat3 {
        let whole = DMat3::from_diagonal(DVec3::new(bend.weft, bend.warp, bend.weft + bend.warp));
        let rims: Vec<DVec3> = (self.across.iter().zip(&self.around))
            .filter(|(_, other)| other.is_none())
            .map(|(n, _)| *n)
            .collect();
        match rims[..] {
            [] => whole,
            [n] => {
                let pull = whole * n;
                whole - outer(pull, pull) * (1.0 / n.dot(pull).max(f64::MIN_POSITIVE))
            }
            [n, m, ..] => {
                let (pn, pm) = (whole * n, whole * m);
                let free = DMat2::from_cols_array(&[n.dot(pn), n.dot(pm), m.dot(pn), m.dot(pm)]);
                if free.determinant() <= 0.0 {
                    return DMat3::ZERO;
                }
                let s = free.inverse();
                whole
                    - outer(pn * s.x_axis.x + pm * s.x_axis.y, pn)
                    - outer(pn * s.y_axis.x + pm * s.y_axis.y, pm)
            }
        }
    }
}

/// How much each triangle's neighbourhood overstates curvature, the mean about each of its corners.
fn excess(faces: &[[u32; 3]], triangles: &[Triangle]) -> Vec<f64> {
    let n = faces.iter().flatten().max().map_or(0, |v| *v as usize + 1);
    let mut rim = vec![false; n];
    for (face, t) in faces.iter().zip(triangles) {
        for i in (0..3).filter(|i| t.around[*i].is_none()) {
            rim[face[i] as usize] = true;
            rim[face[(i + 1) % 3] as usize] = true;
        }
    }
    let mut sums = vec![[0.0; 2]; n];
    for (face, t) in faces.iter().zip(triangles) {
        let mut reading = t.reading();
        if face.iter().any(|v| rim[*v as usize]) || !reading[0].is_finite() {
            reading[0] = reading[1];
        }
        for v in face {
            (0..2).for_each(|k| sums[*v as usize][k] += reading[k]);
        }
    }
    let of = |face: &[u32; 3]| {
        let whole = |k: usize| face.iter().map(|v| sums[*v as usize][k]).sum::<f64>();
        match whole(1) > 0.0 {
            true => (whole(0) / whole(1)).clamp(EXCESS[0], EXCESS[1]),
            false => 1.0,
        }
    };
    faces.iter().map(of).collect()
}

/// `n⊗n` of the direction `m` (any length): weft, warp and mixed.
fn tensor(m: DVec2) -> DVec3 {
    let n = m.normalize_or_zero();
    DVec3::new(n.x * n.x, n.y * n.y, n.x * n.y)
}

fn area([p, q, r]: &[DVec2; 3]) -> f64 {
    0.5 * (*q - *p).perp_dot(*r - *p).abs()
}

/// Where the third corner across edge `i` lies if the neighbour is laid into the plane of `own`.
///
/// `theirs`: the neighbour's corners, its first two the same edge the other way round.
fn unfolded(own: &[DVec2; 3], i: usize, theirs: &[DVec2; 3]) -> DVec2 {
    let (edge, side) = (theirs[1] - theirs[0], theirs[2] - theirs[0]);
    let square = edge.length_squared();
    if square == 0.0 {
        return own[i];
    }
    let (along, away) = (side.dot(edge) / square, side.perp_dot(edge).abs() / square);
    let (from, to) = (own[(i + 1) % 3], own[i]);
    let inward = (own[(i + 2) % 3] - from).perp_dot(to - from);
    let outward = (to - from).perp() * inward.signum();
    from + (to - from) * along + outward * away
}

/// Energy [J] of a plate at `x` [m].
#[inline]
pub fn energy(x: &[DVec3; VERTS], rest: &Plate) -> f64 {
    gradient(x, rest).0
}

/// Energy [J] and gradient [N] of a plate at `x` [m], on differences so that none are lost far from
/// the origin.
#[inline]
pub fn gradient(x: &[DVec3; VERTS], rest: &Plate) -> (f64, [DVec3; VERTS]) {
    let d = x.map(|p| p - x[0]);
    let pull = rest
        .matrix
        .map(|row| (0..VERTS).map(|j| d[j] * row[j]).sum::<DVec3>());
    let energy = 0.5 * (0..VERTS).map(|i| d[i].dot(pull[i])).sum::<f64>();
    (energy, pull)
}

/// Energy, gradient and the constant Hessian `Qᵢⱼ I`, exact.
#[inline]
pub fn hessian(x: &[DVec3; VERTS], rest: &Plate) -> Local<VERTS> {
    let (energy, gradient) = gradient(x, rest);
    let of = |q: f64| DMat3::from_diagonal(DVec3::splat(q));
    Local {
        energy,
        gradient,
        hessian: rest.matrix.map(|row| row.map(of)),
    }
}
