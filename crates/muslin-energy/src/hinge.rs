//! Bending: what it costs to fold cloth about an edge.
//!
//! A hinge is an edge with its two triangles. Its vertices are `[a, b, c, d]`: the edge from `a`
//! to `b`, then the third corner of face `(a, b, c)` and of face `(b, a, d)`, both wound alike.
//!
//! `E = ½ B l² / (A₀ + A₁) (θ − θ̄)²` [J], with edge length `l`, areas `A` and angle `θ̄` at rest.
//! A regular mesh bent to a cylinder of curvature `κ` then stores `½ B κ²` per area, which makes
//! `B` the bending stiffness of the fabric [N m]. A strip that may also curve across its length
//! relaxes and reads softer, by the mesh: [`crate::plate`] does not, and is what cloth is moved and taught by.
//!
//! The angle form of Grinspun et al. 2003; the constant derived for `B`.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use crate::Local;

/// How hard a fabric resists being curved along its yarns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// Bending stiffness when the warp (material y) curves [N m].
    pub warp: f64,
    /// Bending stiffness when the weft (material x) curves [N m].
    pub weft: f64,
}

impl Bend {
    /// Stiffness when the material direction `m` (any length) curves: `(B_weft mₓ² + B_warp m_y²)/m²`.
    ///
    /// The orthotropic plate whose mixed term is the mean of the two; the mean for `m = 0`.
    pub fn along(&self, m: DVec2) -> f64 {
        let square = m.length_squared();
        if square == 0.0 {
            return 0.5 * (self.warp + self.weft);
        }
        (self.weft * m.x * m.x + self.warp * m.y * m.y) / square
    }
}

/// A hinge as it was cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestHinge {
    /// `½ B l² / (A₀ + A₁)` [J/rad²].
    pub stiffness: f64,
    /// Rest angle θ̄ [rad].
    pub angle: f64,
}

impl RestHinge {
    /// From both faces' material corners [m], in the order `(a, b, c)` and `(b, a, d)`.
    ///
    /// The two faces may lie apart in material space, as at a seam: length and direction of the
    /// fold are the mean of both. Faces without area together give a hinge without stiffness.
    pub fn new(faces: [[DVec2; 3]; 2], bend: &Bend, angle: f64) -> Self {
        let mut area = 0.0;
        let mut square = 0.0;
        let mut b = 0.0;
        for [p, q, r] in faces {
            area += 0.5 * (q - p).perp_dot(r - p).abs();
            square += 0.5 * (q - p).length_squared();
            b += 0.5 * bend.along((q - p).perp());
        }
        let stiffness = if area > 0.0 {
            0.5 * b * square / area
        } else {
            0.0
        };
        Self { stiffness, angle }
    }
}

/// Where a hinge stands in a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stencil {
    /// Vertices `[a, b, c, d]`.
    pub verts: [u32; 4],
    /// The faces `(a, b, c)` and `(b, a, d)`.
    pub faces: [u32; 2],
    /// For each face the corner that its order starts with: corners `(s, s+1, s+2) mod 3`.
    pub starts: [u8; 2],
}

impl Stencil {
    /// Both faces' material corners in the hinge's order, from each face's own corners.
    pub fn corners(&self, rest: &[[DVec2; 3]]) -> [[DVec2; 3]; 2] {
        [0, 1].map(|side| {
            let corners = rest[self.faces[side] as usize];
            [0, 1, 2].map(|i| corners[(self.starts[side] as usize + i) % 3])
        })
    }
}

/// All hinges of a mesh, in the order of their first face.
///
/// Edges with one face are a rim and have none. Edges whose second face winds the other way, or
/// of more than two faces, are not manifold: the first well-wound pair is taken.
pub fn stencils(faces: &[[u32; 3]]) -> Vec<Stencil> {
    let mut owner = HashMap::with_capacity(faces.len() * 3);
    for (f, face) in faces.iter().enumerate() {
        for i in 0..3 {
            owner
                .entry((face[i], face[(i + 1) % 3]))
                .or_insert((f as u32, i as u8));
        }
    }
    let mut out = Vec::with_capacity(faces.len() * 3 / 2);
    for (f, face) in faces.iter().enumerate() {
        for i in 0..3 {
            let (a, b, c) = (face[i], face[(i + 1) % 3], face[(i + 2) % 3]);
            let mine = owner.get(&(a, b)) == Some(&(f as u32, i as u8));
            let Some(&(g, j)) = owner.get(&(b, a)) else {
                continue;
            };
            if mine && f < g as usize {
                let d = faces[g as usize][(j as usize + 2) % 3];
                out.push(Stencil {
                    verts: [a, b, c, d],
                    faces: [f as u32, g],
                    starts: [i as u8, j],
                });
            }
        }
    }
    out
}

/// The fold angle θ in (−π, π]: 0 when flat, positive when the faces fall away from the normals.
///
/// A face without area has no normal: the angle is then zero.
#[inline]
pub fn angle(x: &[DVec3; 4]) -> f64 {
    let (n0, n1) = normals(x);
    let along = (x[1] - x[0]).normalize_or_zero();
    n0.cross(n1).dot(along).atan2(n0.dot(n1))
}

/// θ and `∂θ/∂x` [rad/m].
///
/// A face without area (height below 1e-9 of the edge) adds nothing to the gradient.
#[inline]
pub fn angle_gradient(x: &[DVec3; 4]) -> (f64, [DVec3; 4]) {
    let (n0, n1) = normals(x);
    let edge = x[1] - x[0];
    let square = edge.length_squared();
    if square == 0.0 {
        return (0.0, [DVec3::ZERO; 4]);
    }
    let length = square.sqrt();
    let theta = n0.cross(n1).dot(edge / length).atan2(n0.dot(n1));
    // Unit normal over height: how fast a corner that rises turns its face.
    let turn = |n: DVec3| {
        let area = n.length_squared();
        if area > 1e-18 * square * square {
            n * (length / area)
        } else {
            DVec3::ZERO
        }
    };
    let (t0, t1) = (turn(n0), turn(n1));
    let (s0, s1) = (
        (x[2] - x[0]).dot(edge) / square,
        (x[3] - x[0]).dot(edge) / square,
    );
    let a = t0 * (1.0 - s0) + t1 * (1.0 - s1);
    let b = t0 * s0 + t1 * s1;
    (theta, [a, b, -t0, -t1])
}

#[inline]
fn normals(x: &[DVec3; 4]) -> (DVec3, DVec3) {
    let edge = x[1] - x[0];
    (edge.cross(x[2] - x[0]), (x[3] - x[0]).cross(edge))
}

/// Energy [J] of a hinge at `x` [m].
#[inline]
pub fn energy(x: &[DVec3; 4], rest: &RestHinge) -> f64 {
    let turn = turn(angle(x), rest.angle);
    rest.stiffness * turn * turn
}

/// Energy [J] and gradient [N] of a hinge at `x` [m].
#[inline]
pub fn gradient(x: &[DVec3; 4], rest: &RestHinge) -> (f64, [DVec3; 4]) {
    let (theta, g) = angle_gradient(x);
    let turn = turn(theta, rest.angle);
    (
        rest.stiffness * turn * turn,
        g.map(|g| g * (2.0 * rest.stiffness * turn)),
    )
}

/// Energy, gradient and Gauss-Newton Hessian `2 c ∇θ ∇θᵀ`, `c = ½ B l²/(A₀ + A₁)`.
///
/// The full Hessian adds `2 c (θ − θ̄) ∇²θ`, which can have either sign and is left out: the one
/// here is exact at the rest angle and positive semidefinite everywhere.
#[inline]
pub fn hessian(x: &[DVec3; 4], rest: &RestHinge) -> Local<4> {
    let (theta, g) = angle_gradient(x);
    let (turn, c) = (turn(theta, rest.angle), rest.stiffness);
    Local::rank_one(c * turn * turn, 2.0 * c * turn, 2.0 * c, &g)
}

/// The way back to the rest angle: within a half turn of it, the short one.
#[inline]
fn turn(theta: f64, rest: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let turn = theta - rest;
    if turn > PI {
        turn - TAU
    } else if turn < -PI {
        turn + TAU
    } else {
        turn
    }
}
