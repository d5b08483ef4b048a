//! The states on which the suite asks: cloth of the size and in the shapes that garments have, and some that are
//! nearly degenerate.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

use super::{Rng, Scale};

/// How many states a law is asked on.
pub const STATES: usize = 1200;

/// Below a nanojoule and a micronewton nothing happens to a 12 mm triangle that stretches.
pub const NOTHING: Scale = Scale {
    energy: 1e-9,
    force: 1e-6,
};

/// Below a picojoule and a nanonewton nothing happens to a patch of 12 mm that bends.
pub const NO_FOLD: Scale = Scale {
    energy: 1e-12,
    force: 1e-9,
};

/// A triangle and its three neighbours: the faces of [`star`].
pub const STAR: [[u32; 3]; 4] = [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5]];

/// A triangle as cut [m], of garment size, one in four of them a sliver.
pub fn triangle(rng: &mut Rng) -> [DVec2; 3] {
    let size = rng.scale(0.004, 0.03);
    let height = if rng.between(0.0, 1.0) < 0.25 {
        rng.scale(1e-3, 0.1)
    } else {
        rng.between(0.4, 1.2)
    };
    let (s, c) = rng.between(-3.0, 3.0).sin_cos();
    let turn = |p: DVec2| DVec2::new(c * p.x - s * p.y, s * p.x + c * p.y) * size;
    let apex = DVec2::new(rng.between(-0.2, 1.2), height);
    [DVec2::ZERO, DVec2::X, apex].map(turn)
}

/// The triangle deformed [m]: mostly a few per cent, one in three far off, one in ten almost flattened.
pub fn deformed(corners: [DVec2; 3], rng: &mut Rng) -> [DVec3; 3] {
    let kind = rng.between(0.0, 1.0);
    let amount = if kind < 0.33 { 0.8 } else { 0.08 };
    let mut f = DMat3::IDENTITY;
    for i in 0..2 {
        *f.col_mut(i) += rng.vector() * amount;
    }
    if kind > 0.9 {
        *f.col_mut(1) = f.col(0) * rng.between(-1.2, 1.2) + rng.vector() * 1e-3;
    }
    let at = rng.vector();
    corners.map(|c| at + f * c.extend(0.0))
}

/// Shortest height of the triangle as it lies [m], the length a finite difference must stay below.
pub fn height(x: &[DVec3; 3]) -> f64 {
    let area = (x[1] - x[0]).cross(x[2] - x[0]).length();
    let longest = (0..3)
        .map(|i| x[i].distance(x[(i + 1) % 3]))
        .fold(0.0, f64::max);
    area / longest
}

/// An edge of garment size [m], its rest length [m] and stiffness [N/m]; one in ten almost without length.
pub fn edge(rng: &mut Rng) -> ([DVec3; 2], f64, f64) {
    let rest = rng.scale(0.004, 0.03);
    let much = if rng.between(0.0, 1.0) < 0.1 {
        rng.scale(1e-4, 1e-2)
    } else {
        rng.between(0.3, 1.8)
    };
    let at = rng.vector();
    let end = at + rng.vector().normalize() * rest * much;
    ([at, end], rest, rng.scale(1.0, 1e3))
}

/// Height of a triangle over an edge of one; one in seven is a sliver's.
fn tall(rng: &mut Rng) -> f64 {
    if rng.between(0.0, 1.0) < 0.15 {
        rng.scale(2e-3, 0.1)
    } else {
        rng.between(0.4, 1.2)
    }
}

/// A hinge as cut [m], flat and 12 mm or so wide: its edge, then the corner on either side; one in four has a sliver
/// for a face.
pub fn hinge(rng: &mut Rng) -> [DVec2; 4] {
    let size = rng.scale(0.004, 0.03);
    let (up, down) = (tall(rng), tall(rng));
    let (c, d) = (rng.between(-0.2, 1.2), rng.between(-0.2, 1.2));
    let turn = DMat2::from_angle(rng.between(-3.0, 3.0));
    [
        DVec2::ZERO,
        DVec2::X,
        DVec2::new(c, up),
        DVec2::new(d, -down),
    ]
    .map(|p| turn * p * size)
}

/// The two faces of a hinge.
pub fn faces<T: Copy>([a, b, c, d]: [T; 4]) -> [[T; 3]; 2] {
    [[a, b, c], [b, a, d]]
}

/// The hinge folded by up to 2.5 radians, then every corner moved by up to a fifth of the lower height [m].
pub fn folded(corners: [DVec2; 4], rng: &mut Rng) -> [DVec3; 4] {
    let (fold, at) = (rng.between(-2.5, 2.5), rng.vector());
    let edge = corners[1].normalize().extend(0.0);
    let turn = DQuat::from_axis_angle(edge, fold);
    let mut x = corners.map(|c| c.extend(0.0));
    x[3] = turn * x[3];
    let shake = 0.2 * lower(&x);
    x.map(|p| p + rng.vector() * shake + at)
}

/// The lower of a hinge's two heights over its edge, or the edge if that is shorter [m].
pub fn lower(x: &[DVec3; 4]) -> f64 {
    let edge = x[1] - x[0];
    let over = |p: DVec3| edge.cross(p - x[0]).length() / edge.length();
    over(x[2]).min(over(x[3])).min(edge.length())
}

/// Corners of [`STAR`] as cut [m], 12 mm or so wide; one height in seven is a sliver's.
pub fn star(rng: &mut Rng) -> [DVec2; 6] {
    let size = rng.scale(0.004, 0.03);
    let heights = [(); 4].map(|()| tall(rng));
    let own = [
        DVec2::ZERO,
        DVec2::X,
        DVec2::new(rng.between(-0.2, 1.2), heights[0]),
    ];
    let mut apex = |i: usize| {
        let (from, to) = (own[i], own[(i + 1) % 3]);
        let along = from + (to - from) * rng.between(0.0, 1.0);
        along - (to - from).perp().normalize() * heights[i + 1]
    };
    let [d, e, f] = [0, 1, 2].map(&mut apex);
    let turn = DMat2::from_angle(rng.between(-3.0, 3.0));
    [own[0], own[1], own[2], d, e, f].map(|p| turn * p * size)
}

/// A star crumpled [m].
pub fn crumpled(corners: &[DVec2; 6], rng: &mut Rng) -> [DVec3; 6] {
    let size = corners[0].distance(corners[1]);
    corners.map(|p| p.extend(0.0) + rng.vector() * 0.3 * size)
}

/// Corners of faces.
pub fn corners(faces: &[[u32; 3]], points: &[DVec2]) -> Vec<[DVec2; 3]> {
    let of = |f: &[u32; 3]| f.map(|v| points[v as usize]);
    faces.iter().map(of).collect()
}
