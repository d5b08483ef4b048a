//! Stretch of a rubbery sheet: a stable neo-Hookean membrane.
//!
//! `ψ(F) = ½ μ (|F|² − 2) − μ (J − 1) + ½ (λ + μ) (J − 1)²` with `J = |F_u × F_v|`, the change of area
//! [J/m²]. It is the volumetric law of Smith, de Goes and Kim 2018 without its barrier, for the two
//! columns of a sheet: at rest it is at rest, for small strains it is the plane law of Lamé, and
//! squeezed to a line or a point it stays finite.
//!
//! In the frame of the singular values the Hessian is a 2×2 block of the two stretches and four
//! single eigenvalues: `μ ± g` in the plane and `μ + g σ₂/σ₁`, `μ + g σ₁/σ₂` out of it, where
//! `g = (λ + μ) (J − 1) − μ`. The negative ones are set to zero.

use glam::{DMat3, DVec3};

use crate::strain::frames;
use crate::stvk::Lame;
use crate::{InPlane, Local, RestTriangle, local::spread_stress, triangle};

/// `∂ψ/∂J` of the terms in `J` [N/m].
#[inline]
fn slope(area: f64, k: &Lame) -> f64 {
    (k.lambda + k.mu) * (area - 1.0) - k.mu
}

/// The density `ψ(F)` [J/m²] of a deformation (see [`RestTriangle::deformation`]).
#[inline]
pub fn density(f: &[DVec3; 2], k: &Lame) -> f64 {
    let grown = f[0].cross(f[1]).length() - 1.0;
    let trace = f[0].length_squared() + f[1].length_squared();
    0.5 * k.mu * (trace - 2.0) - k.mu * grown + 0.5 * (k.lambda + k.mu) * grown * grown
}

/// `ψ` and `∂ψ/∂F` [N/m].
///
/// A triangle squeezed to a line has no plane to grow in: its area then pushes nowhere.
#[inline]
pub fn stress(f: &[DVec3; 2], k: &Lame) -> (f64, [DVec3; 2]) {
    let normal = f[0].cross(f[1]);
    let push = slope(normal.length(), k);
    let n = normal.normalize_or_zero() * push;
    let stress = [f[0] * k.mu + f[1].cross(n), f[1] * k.mu + n.cross(f[0])];
    (density(f, k), stress)
}

/// `ψ`, `∂ψ/∂F` and the nearest positive semidefinite `∂²ψ/∂F²`.
pub fn response(f: &[DVec3; 2], k: &Lame) -> InPlane {
    with(f, k, |eigenvalue| eigenvalue.max(0.0))
}

/// The exact, possibly indefinite `∂²ψ/∂F²` [N/m]: weft-weft, weft-warp, warp-warp.
///
/// Not a number where the triangle is squeezed to a line.
pub fn exact_hessian(f: &[DVec3; 2], k: &Lame) -> [DMat3; 3] {
    with(f, k, |eigenvalue| eigenvalue).hessian
}

/// Energy [J] and gradient [N] of a triangle at `x` [m].
#[inline]
pub fn gradient(x: &[DVec3; 3], rest: &RestTriangle, k: &Lame) -> (f64, [DVec3; 3]) {
    let (density, stress) = stress(&rest.deformation(x), k);
    spread_stress(density, stress, rest)
}

/// Energy, gradient and positive semidefinite Hessian of a triangle at `x` [m].
#[inline]
pub fn hessian(x: &[DVec3; 3], rest: &RestTriangle, k: &Lame) -> Local<3> {
    response(&rest.deformation(x), k).spread(rest)
}

/// The answer with every eigenvalue of the Hessian as `keep` leaves it.
fn with(f: &[DVec3; 2], k: &Lame, keep: impl Fn(f64) -> f64) -> InPlane {
    let (energy, stress) = stress(f, k);
    let mut out = InPlane {
        energy,
        stress,
        ..InPlane::ZERO
    };
    let sigma = triangle::principal(f);
    let (v, u) = frames(f, sigma);
    let area = sigma[0] * sigma[1];
    let g = slope(area, k);
    let tensor = |a: DVec3, b: [f64; 2]| [a * b[0], a * b[1]];
    let grows = k.lambda + k.mu;
    let block = [
        k.mu + grows * sigma[1] * sigma[1],
        g + grows * area,
        k.mu + grows * sigma[0] * sigma[0],
    ];
    for (value, [c, s]) in pairs(block) {
        out.add_outer(
            keep(value),
            tensor_sum(tensor(u[0], v[0]), c, tensor(u[1], v[1]), s),
        );
    }
    let (a, b) = (tensor(u[0], v[1]), tensor(u[1], v[0]));
    out.add_outer(0.5 * keep(k.mu - g), tensor_sum(a, 1.0, b, 1.0));
    out.add_outer(0.5 * keep(k.mu + g), tensor_sum(a, 1.0, b, -1.0));
    for i in 0..2 {
        let ratio = sigma[1 - i] / sigma[i];
        // Zero over zero: a triangle at a point, where every way out is equally good.
        let value = k.mu + if ratio.is_nan() { g } else { g * ratio };
        out.add_outer(keep(value), tensor(u[2], v[i]));
    }
    out
}

fn tensor_sum(a: [DVec3; 2], c: f64, b: [DVec3; 2], s: f64) -> [DVec3; 2] {
    [a[0] * c + b[0] * s, a[1] * c + b[1] * s]
}

/// Eigenvalues of a symmetric 2×2 matrix, each with its unit vector.
fn pairs([a, b, d]: [f64; 3]) -> [(f64, [f64; 2]); 2] {
    let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
    let radius = half.hypot(b);
    let (s, c) = (0.5 * b.atan2(half)).sin_cos();
    [(mean + radius, [c, s]), (mean - radius, [-s, c])]
}
