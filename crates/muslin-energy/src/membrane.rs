//! Stretch: what it costs to lengthen, shorten or shear woven cloth in its plane.
//!
//! The orthotropic membrane of Baraff and Witkin 1998 as a finite element (Kim 2020): one
//! stiffness along each yarn direction and one for the angle between them,
//!
//! `ψ(F) = ½ k_weft (|F_u| − 1)² + ½ k_warp (|F_v| − 1)² + ½ k_shear (F_u · F_v)²` [J/m²].
//!
//! The Hessian is the sum of the three terms' exact Hessians, each with its negative eigenvalues
//! set to zero in closed form. It is the exact one where `|F_u| ≥ 1`, `|F_v| ≥ 1` and
//! `F_u · F_v = 0`; elsewhere it leaves out what would push a compressed yarn sideways.

use glam::{DMat3, DVec3, Mat3A, Vec3, Vec3A};

use crate::{InPlane, Local, RestTriangle, local::spread_stress, outer};

/// How hard a fabric resists in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Force per width per unit strain along the warp (material y) [N/m].
    pub warp: f64,
    /// The same along the weft (material x) [N/m].
    pub weft: f64,
    /// Force per width per radian of shear [N/m].
    pub shear: f64,
    /// Share of warp and weft stiffness that remains in compression, 0 to 1.
    ///
    /// One is the plain law. Less stands for the wrinkles that a coarse mesh cannot show; the
    /// Hessian then jumps at zero strain, the gradient does not.
    pub compression: f64,
}

impl Stretch {
    #[inline]
    fn along(&self, length: f64) -> [f64; 2] {
        let share = if length < 1.0 { self.compression } else { 1.0 };
        [self.weft * share, self.warp * share]
    }
}

/// The density `ψ(F)` [J/m²] of a deformation (see [`RestTriangle::deformation`]).
#[inline]
pub fn density(f: &[DVec3; 2], k: &Stretch) -> f64 {
    let shear = f[0].dot(f[1]);
    let mut sum = k.shear * shear * shear;
    for i in 0..2 {
        let length = f[i].length();
        sum += k.along(length)[i] * (length - 1.0) * (length - 1.0);
    }
    0.5 * sum
}

/// `ψ` and `∂ψ/∂F` [N/m].
///
/// A yarn of length zero has no direction: its tension is zero.
#[inline]
pub fn stress(f: &[DVec3; 2], k: &Stretch) -> (f64, [DVec3; 2]) {
    let shear = f[0].dot(f[1]);
    let mut p = [f[1] * (k.shear * shear), f[0] * (k.shear * shear)];
    for i in 0..2 {
        let length = f[i].length();
        p[i] += f[i].normalize_or_zero() * (k.along(length)[i] * (length - 1.0));
    }
    (density(f, k), p)
}

/// `ψ`, `∂ψ/∂F` and the projected `∂²ψ/∂F²`.
#[inline]
pub fn response(f: &[DVec3; 2], k: &Stretch) -> InPlane {
    let mut out = shear(f, k.shear);
    for i in 0..2 {
        let length = f[i].length();
        let (e, stress, hessian) = yarn(f[i], length, k.along(length)[i]);
        out.energy += e;
        out.stress[i] += stress;
        out.hessian[2 * i] += hessian;
    }
    out
}

/// `∂ψ/∂F` as [`stress`] has it, and the Hessian of [`response`] in single precision.
///
/// For solvers in which the Hessian decides only how fast they converge.
#[inline]
pub fn response_single(f: &[DVec3; 2], k: &Stretch) -> ([DVec3; 2], [Mat3A; 3]) {
    let [u, v] = *f;
    let (c, squares) = (u.dot(v), [u.length_squared(), v.length_squared()]);
    let trace = squares[0] + squares[1];
    if trace == 0.0 {
        return ([DVec3::ZERO; 2], [Mat3A::ZERO; 3]);
    }
    // The shear's two parts: see `shear`, whose norms are these.
    let lambda = 0.5 * (trace + (trace * trace + 12.0 * c * c).sqrt());
    let size = trace * (lambda * lambda + c * c) + 4.0 * lambda * c * c;
    let steep = (k.shear * lambda / size).sqrt();
    let along = [v * lambda + u * c, u * lambda + v * c].map(|q| (q * steep).as_vec3a());
    let (sign, half) = (1.0_f64.copysign(c), 0.5 * k.shear * c.abs());
    let w = (v + u * sign) * (half / (trace + 2.0 * c.abs())).sqrt();
    let (w, sign) = (w.as_vec3a(), sign as f32);
    let mut stress = [v * (k.shear * c), u * (k.shear * c)];
    let side = |i: usize, stress: &mut DVec3| {
        let length = squares[i].sqrt();
        let (stiff, strain) = (k.along(length)[i], length - 1.0);
        if length == 0.0 {
            return (Vec3A::ZERO, half as f32);
        }
        let d = f[i] / length;
        *stress += d * (stiff * strain);
        let across = (stiff * strain / length).max(0.0);
        (
            (d * (stiff - across).sqrt()).as_vec3a(),
            (across + half) as f32,
        )
    };
    let [to_u, to_v] = &mut stress;
    let yarns = [side(0, to_u), side(1, to_v)];
    let whole = |i: usize| {
        let (yarn, across) = yarns[i];
        let rest = Mat3A::from_diagonal(Vec3::splat(across));
        outer_single(along[i], along[i]) + outer_single(yarn, yarn) - outer_single(w, w) + rest
    };
    let across = Mat3A::from_diagonal(Vec3::splat(half as f32)) - outer_single(w, w);
    let cross = outer_single(along[0], along[1]) + across * sign;
    (stress, [whole(0), cross, whole(1)])
}

/// `a bᵀ`.
#[inline]
fn outer_single(a: Vec3A, b: Vec3A) -> Mat3A {
    Mat3A::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The exact, possibly indefinite `∂²ψ/∂F²` [N/m]: weft-weft, weft-warp, warp-warp.
///
/// For checks and for solvers that bring their own regularisation.
pub fn exact_hessian(f: &[DVec3; 2], k: &Stretch) -> [DMat3; 3] {
    let [u, v] = *f;
    let side = |f: DVec3, i: usize| {
        let length = f.length();
        let (d, k) = (f.normalize_or_zero(), k.along(length)[i]);
        let across = if length > 0.0 {
            k * (1.0 - 1.0 / length)
        } else {
            0.0
        };
        outer(d, d) * (k - across) + DMat3::from_diagonal(DVec3::splat(across))
    };
    let cross = outer(v, u) + DMat3::from_diagonal(DVec3::splat(u.dot(v)));
    [
        side(u, 0) + outer(v, v) * k.shear,
        cross * k.shear,
        side(v, 1) + outer(u, u) * k.shear,
    ]
}

/// Energy [J] of a triangle at `x` [m].
#[inline]
pub fn energy(x: &[DVec3; 3], rest: &RestTriangle, k: &Stretch) -> f64 {
    density(&rest.deformation(x), k) * rest.area
}

/// Energy [J] and gradient [N] of a triangle at `x` [m].
#[inline]
pub fn gradient(x: &[DVec3; 3], rest: &RestTriangle, k: &Stretch) -> (f64, [DVec3; 3]) {
    let (density, stress) = stress(&rest.deformation(x), k);
    spread_stress(density, stress, rest)
}

/// Energy, gradient and positive semidefinite Hessian of a triangle at `x` [m].
#[inline]
pub fn hessian(x: &[DVec3; 3], rest: &RestTriangle, k: &Stretch) -> Local<3> {
    response(&rest.deformation(x), k).spread(rest)
}

/// `½ k (l − 1)²` along one yarn; eigenvalues `k` along it and `k (1 − 1/l)`, at least 0, across.
#[inline]
fn yarn(f: DVec3, length: f64, k: f64) -> (f64, DVec3, DMat3) {
    let (d, strain) = (f.normalize_or_zero(), length - 1.0);
    let across = if strain > 0.0 {
        k * strain / length
    } else {
        0.0
    };
    let hessian = outer(d * (k - across), d) + DMat3::from_diagonal(DVec3::splat(across));
    (0.5 * k * strain * strain, d * (k * strain), hessian)
}

/// `½ k c²`, `c = F_u · F_v`, projected.
///
/// With `g = ∇c = (F_v, F_u)` and `S` the swap of columns the exact Hessian is `k (g gᵀ + c S)`.
/// Inside `span(g, S g)` its positive eigenpair is `λ = ½ (|F|² + √(|F|⁴ + 12 c²))` with
/// `λ g + c S g`; outside it `S` has the eigenvalues ±1, and the half with the sign of `c` stays.
#[inline]
fn shear(f: &[DVec3; 2], k: f64) -> InPlane {
    let [u, v] = *f;
    let (c, trace) = (u.dot(v), u.length_squared() + v.length_squared());
    let mut out = InPlane::ZERO;
    if trace == 0.0 {
        return out;
    }
    out.energy = 0.5 * k * c * c;
    out.stress = [v * (k * c), u * (k * c)];
    let lambda = 0.5 * (trace + (trace * trace + 12.0 * c * c).sqrt());
    let q = [v * lambda + u * c, u * lambda + v * c];
    out.add_outer(
        k * lambda / (q[0].length_squared() + q[1].length_squared()),
        q,
    );
    let sign = 1.0_f64.copysign(c);
    let w = (v + u * sign).normalize_or_zero();
    let half = 0.5 * k * c.abs();
    let across = DMat3::from_diagonal(DVec3::splat(half)) - outer(w * half, w);
    out.hessian[0] += across;
    out.hessian[1] += across * sign;
    out.hessian[2] += across;
    out
}
