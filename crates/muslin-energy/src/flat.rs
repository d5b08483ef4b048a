//! Bending of flat panels: a quadratic form that is assembled once.
//!
//! For cloth that is flat at rest and hardly stretches, the fold is linear in the positions
//! (Bergou et al. 2006): `E = ½ k · 3/(A₀ + A₁) |Σ Kᵢ xᵢ|²`, with cotangent weights `K`. The Hessian is
//! constant and exact. A regular mesh bent to a cylinder reads `B = 3 k`, so `k = B/3` here.

use glam::{DMat3, DVec2, DVec3};

use crate::{Local, hinge::Bend};

/// A hinge that was cut flat; vertices as in [`crate::hinge`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatHinge {
    /// Weights `Kᵢ` of the four vertices [-]; they sum to zero.
    pub weights: [f64; 4],
    /// `B/(A₀ + A₁)` [N/m].
    pub stiffness: f64,
}

impl FlatHinge {
    /// From both faces' material corners [m], in the order `(a, b, c)` and `(b, a, d)`.
    ///
    /// A face without area gives a hinge without stiffness.
    pub fn new(faces: [[DVec2; 3]; 2], bend: &Bend) -> Self {
        let Some(weights) = weights(faces) else {
            return Self {
                weights: [0.0; 4],
                stiffness: 0.0,
            };
        };
        let (mut area, mut stiffness) = (0.0, 0.0);
        for [p, q, r] in faces {
            area += 0.5 * (q - p).perp_dot(r - p).abs();
            stiffness += 0.5 * bend.along((q - p).perp());
        }
        Self {
            weights,
            stiffness: stiffness / area,
        }
    }
}

/// The weights `Kᵢ` of a fold between two faces; none if one of them has no area.
pub(crate) fn weights(faces: [[DVec2; 3]; 2]) -> Option<[f64; 4]> {
    let mut weights = [0.0; 4];
    for (side, [p, q, r]) in faces.into_iter().enumerate() {
        let (at_p, at_q) = (cotangent(q - p, r - p), cotangent(p - q, r - q));
        let (a, b) = if side == 0 { (0, 1) } else { (1, 0) };
        weights[a] += at_q;
        weights[b] += at_p;
        weights[2 + side] = -(at_p + at_q);
        if !(at_p + at_q).is_finite() {
            return None;
        }
    }
    Some(weights)
}

/// Cotangent of the angle between two sides; infinite or not a number if they are parallel.
fn cotangent(a: DVec2, b: DVec2) -> f64 {
    a.dot(b) / a.perp_dot(b).abs()
}

/// Energy [J] of a flat hinge at `x` [m].
#[inline]
pub fn energy(x: &[DVec3; 4], rest: &FlatHinge) -> f64 {
    0.5 * rest.stiffness * fold(x, rest).length_squared()
}

/// Energy [J] and gradient [N] of a flat hinge at `x` [m].
#[inline]
pub fn gradient(x: &[DVec3; 4], rest: &FlatHinge) -> (f64, [DVec3; 4]) {
    let pull = fold(x, rest) * rest.stiffness;
    (energy(x, rest), rest.weights.map(|w| pull * w))
}

/// Energy, gradient and the constant Hessian `stiffness Kᵢ Kⱼ I`, exact.
#[inline]
pub fn hessian(x: &[DVec3; 4], rest: &FlatHinge) -> Local<4> {
    let (energy, gradient) = gradient(x, rest);
    let mut out = Local {
        energy,
        gradient,
        ..Local::ZERO
    };
    for i in 0..4 {
        for j in 0..4 {
            let k = rest.stiffness * rest.weights[i] * rest.weights[j];
            out.hessian[i][j] = DMat3::from_diagonal(DVec3::splat(k));
        }
    }
    out
}

/// `Σ Kᵢ xᵢ`, on differences so that a mesh far from the origin loses no digits [m].
#[inline]
fn fold(x: &[DVec3; 4], rest: &FlatHinge) -> DVec3 {
    let w = &rest.weights;
    (x[1] - x[0]) * w[1] + (x[2] - x[0]) * w[2] + (x[3] - x[0]) * w[3]
}
