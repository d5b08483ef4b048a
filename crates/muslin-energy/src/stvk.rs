//! Stretch of an isotropic sheet: Saint Venant and Kirchhoff's law.
//!
//! `ψ(F) = μ |E|² + ½ λ tr(E)²` with Green's strain `E = ½ (FᵀF − I)` [J/m²]: the membrane that
//! the published neural garments train with (SNUG, Santesteban et al. 2022), kept for comparison.

use glam::{DMat3, DVec3};

use crate::{InPlane, Local, RestTriangle, local::spread_stress};

/// Lamé's constants of a sheet, times its thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lame {
    /// `μ ≥ 0` [N/m].
    pub mu: f64,
    /// `λ ≥ 0` [N/m].
    pub lambda: f64,
}

/// Green's strain: weft-weft, weft-warp, warp-warp.
#[inline]
fn green(f: &[DVec3; 2]) -> [f64; 3] {
    [
        0.5 * (f[0].length_squared() - 1.0),
        0.5 * f[0].dot(f[1]),
        0.5 * (f[1].length_squared() - 1.0),
    ]
}

/// Second Piola stress `S = 2 μ E + λ tr(E) I` [N/m]: weft-weft, weft-warp, warp-warp.
#[inline]
fn piola(e: [f64; 3], k: &Lame) -> [f64; 3] {
    let pressure = k.lambda * (e[0] + e[2]);
    [
        2.0 * k.mu * e[0] + pressure,
        2.0 * k.mu * e[1],
        2.0 * k.mu * e[2] + pressure,
    ]
}

/// The density `ψ(F)` [J/m²].
#[inline]
pub fn density(f: &[DVec3; 2], k: &Lame) -> f64 {
    let [a, b, d] = green(f);
    k.mu * (a * a + 2.0 * b * b + d * d) + 0.5 * k.lambda * (a + d) * (a + d)
}

/// `ψ` and `∂ψ/∂F = F S` [N/m].
#[inline]
pub fn stress(f: &[DVec3; 2], k: &Lame) -> (f64, [DVec3; 2]) {
    let [a, b, d] = piola(green(f), k);
    (density(f, k), [f[0] * a + f[1] * b, f[0] * b + f[1] * d])
}

/// `ψ`, `∂ψ/∂F` and a positive semidefinite `∂²ψ/∂F²`.
///
/// The exact Hessian is `∂E: C : ∂E + S ⊗ I₃`. The first part is positive as it stands; of the
/// second the negative eigenvalues of the stress `S` (compression) are set to zero. So it is exact
/// in tension, and in compression only adds to the exact one.
#[inline]
pub fn response(f: &[DVec3; 2], k: &Lame) -> InPlane {
    let s = tension(piola(green(f), k));
    InPlane {
        hessian: hessian_with(f, s, k),
        ..first_order(f, k)
    }
}

/// The exact, possibly indefinite `∂²ψ/∂F²` [N/m]: weft-weft, weft-warp, warp-warp.
pub fn exact_hessian(f: &[DVec3; 2], k: &Lame) -> [DMat3; 3] {
    hessian_with(f, piola(green(f), k), k)
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

#[inline]
fn first_order(f: &[DVec3; 2], k: &Lame) -> InPlane {
    let (energy, stress) = stress(f, k);
    InPlane {
        energy,
        stress,
        ..InPlane::ZERO
    }
}

#[inline]
fn hessian_with(f: &[DVec3; 2], s: [f64; 3], k: &Lame) -> [DMat3; 3] {
    let mut out = InPlane::ZERO;
    let [u, v] = *f;
    // ∇E of the three components; the off-diagonal one counts twice in |E|².
    out.add_outer(2.0 * k.mu, [u, DVec3::ZERO]);
    out.add_outer(2.0 * k.mu, [DVec3::ZERO, v]);
    out.add_outer(k.mu, [v, u]);
    out.add_outer(k.lambda, [u, v]);
    for i in 0..3 {
        out.hessian[i] += DMat3::from_diagonal(DVec3::splat(s[i]));
    }
    out.hessian
}

/// A symmetric 2×2 matrix without its negative eigenvalues.
#[inline]
fn tension([a, b, d]: [f64; 3]) -> [f64; 3] {
    let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
    let radius = half.hypot(b);
    let (high, low) = ((mean + radius).max(0.0), (mean - radius).max(0.0));
    if radius == 0.0 {
        return [high, 0.0, high];
    }
    let (middle, share) = (0.5 * (high + low), 0.5 * (high - low) / radius);
    [middle + share * half, share * b, middle - share * half]
}
