//! The strain limit: what it costs to stretch cloth as far as its yarns allow.
//!
//! Cloth is soft up to a few per cent and then hardly gives. The wall is a convex, growing
//! function `φ` of a stretch, zero up to where it starts, so every Hessian here is exact and
//! positive semidefinite as it stands. Two measures of stretch: [`principal`], the largest in any
//! direction (the one that reports quote), and [`yarn`], along warp and weft alone (which lets
//! woven cloth shear on the bias).

use glam::{DMat3, DVec3};

use crate::{InPlane, outer, triangle};

/// Where the wall begins, where it stands, how stiff it is.
///
/// With `t = (σ − 1 − start) / (limit − start)` and `w = limit − start`:
/// `φ = −k w² t² ln(1 − t)` [J/m²] for `0 < t ≤ wall`, and beyond that the parabola that continues
/// it. C² everywhere; about `k w² t³` at first. Finite even far beyond the limit, because a start
/// state may lie there: there it pulls back with a force that grows linearly.
///
/// The logarithm with squared front is C-IPC's (Li et al. 2021); the finite end is ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrainLimit {
    /// Strain at which the wall begins, ≥ 0 (0.03 is 3 %).
    pub start: f64,
    /// Strain at which the logarithm would be infinite, > `start`.
    pub limit: f64,
    /// `k` [N/m], as a rule the stretch stiffness it takes over from.
    pub stiffness: f64,
    /// Share of the way from start to limit from which the parabola continues, in (0, 1).
    ///
    /// At 0.9 the curvature there is 122 k, at 0.5 it is 6.4 k.
    pub wall: f64,
}

impl StrainLimit {
    /// Whether no stretch of a deformation comes near the start, which most cloth does not: told by what the larger
    /// is at most, `σ₁² ≤ max(|F_u|², |F_v|²) + |F_u · F_v|`.
    #[inline]
    pub fn is_far_from(&self, f: &[DVec3; 2]) -> bool {
        let most = f[0].length_squared().max(f[1].length_squared()) + f[0].dot(f[1]).abs();
        most < (1.0 + self.start) * (1.0 + self.start) * (1.0 - 1e-9)
    }

    /// `φ`, `φ′`, `φ″` at a stretch `σ` (1 = unstretched).
    #[inline]
    pub fn at(&self, stretch: f64) -> [f64; 3] {
        let w = self.limit - self.start;
        let t = (stretch - 1.0 - self.start) / w;
        if t <= 0.0 {
            return [0.0; 3];
        }
        let [e, slope, curvature] = log_wall(t.min(self.wall));
        let over = (t - self.wall).max(0.0);
        [
            self.stiffness * w * w * (e + over * (slope + 0.5 * curvature * over)),
            self.stiffness * w * (slope + curvature * over),
            self.stiffness * curvature,
        ]
    }
}

/// `−t² ln(1 − t)` and its first two derivatives.
#[inline]
fn log_wall(t: f64) -> [f64; 3] {
    let (log, rest) = ((-t).ln_1p(), 1.0 - t);
    let ratio = t / rest;
    [
        -t * t * log,
        t * ratio - 2.0 * t * log,
        4.0 * ratio + ratio * ratio - 2.0 * log,
    ]
}

/// `Σ φ(σᵢ)` [J/m²] over the principal stretches.
#[inline]
pub fn principal_density(f: &[DVec3; 2], limit: &StrainLimit) -> f64 {
    if limit.is_far_from(f) {
        return 0.0;
    }
    let [a, b] = triangle::principal(f);
    limit.at(a)[0] + limit.at(b)[0]
}

/// `Σ φ(σᵢ)` over the principal stretches, with stress and exact Hessian.
///
/// In the frame of the singular vectors the eigenvalues are `φ″ᵢ` (stretch), `(φ′₁ ± φ′₂)/(σ₁ ± σ₂)`
/// (twist and shear) and `φ′ᵢ/σᵢ` (out of the plane): none is negative as `φ` is convex and grows.
/// Below the start nothing acts and nothing is computed. A triangle squeezed to a line has no second
/// direction: any across the first is as good, as its eigenvalues then agree.
#[inline]
pub fn principal(f: &[DVec3; 2], limit: &StrainLimit) -> InPlane {
    if limit.is_far_from(f) {
        return InPlane::ZERO;
    }
    let sigma = triangle::principal(f);
    if sigma[0] <= 1.0 + limit.start {
        return InPlane::ZERO;
    }
    beyond(f, sigma, limit)
}

/// [`principal`] once the larger stretch has passed the start.
fn beyond(f: &[DVec3; 2], sigma: [f64; 2], limit: &StrainLimit) -> InPlane {
    let (v, u) = frames(f, sigma);
    let [e1, p1, h1] = limit.at(sigma[0]);
    let [e2, p2, h2] = limit.at(sigma[1]);
    let mut out = InPlane::ZERO;
    out.energy = e1 + e2;
    let tensor = |a: DVec3, b: [f64; 2]| [a * b[0], a * b[1]];
    let (d1, d2) = (tensor(u[0], v[0]), tensor(u[1], v[1]));
    out.stress = [d1[0] * p1 + d2[0] * p2, d1[1] * p1 + d2[1] * p2];
    out.add_outer(h1, d1);
    out.add_outer(h2, d2);
    let (m12, m21) = (tensor(u[0], v[1]), tensor(u[1], v[0]));
    let gap = sigma[0] - sigma[1];
    let flip = if gap > 1e-7 {
        (p1 - p2) / gap
    } else {
        0.5 * (h1 + h2)
    };
    let twist = (p1 + p2) / (sigma[0] + sigma[1]);
    out.add_outer(0.5 * flip, [m12[0] + m21[0], m12[1] + m21[1]]);
    out.add_outer(0.5 * twist, [m12[0] - m21[0], m12[1] - m21[1]]);
    out.add_outer(p1 / sigma[0], tensor(u[2], v[0]));
    if p2 > 0.0 {
        out.add_outer(p2 / sigma[1], tensor(u[2], v[1]));
    }
    out
}

/// The larger principal stretch (1 = unstretched).
#[inline]
pub fn larger(f: &[DVec3; 2]) -> f64 {
    triangle::principal(f)[0]
}

/// Where the larger principal stretch lies in the material: its unit share along weft and warp.
#[inline]
pub fn direction(f: &[DVec3; 2]) -> [f64; 2] {
    let twice = (2.0 * f[0].dot(f[1])).atan2(f[0].length_squared() - f[1].length_squared());
    let (sin, cos) = (0.5 * twice).sin_cos();
    [cos, sin]
}

/// Right singular vectors, then left ones with the normal.
pub(crate) fn frames(f: &[DVec3; 2], sigma: [f64; 2]) -> ([[f64; 2]; 2], [DVec3; 3]) {
    let [c, s] = direction(f);
    let first = (f[0] * c + f[1] * s).normalize_or_zero();
    let across = f[1] * c - f[0] * s;
    let across = across - first * first.dot(across);
    let second = if sigma[1] > 1e-9 * sigma[0] {
        across.normalize_or(first.any_orthonormal_vector())
    } else {
        first.any_orthonormal_vector()
    };
    ([[c, s], [-s, c]], [first, second, first.cross(second)])
}

/// `φ(|F_u|) + φ(|F_v|)` [J/m²].
#[inline]
pub fn yarn_density(f: &[DVec3; 2], limit: &StrainLimit) -> f64 {
    limit.at(f[0].length())[0] + limit.at(f[1].length())[0]
}

/// `φ(|F_u|) + φ(|F_v|)`: the limit along weft and warp alone; exact Hessian.
///
/// `φ″` along the yarn, `φ′/|F|` across it.
#[inline]
pub fn yarn(f: &[DVec3; 2], limit: &StrainLimit) -> InPlane {
    let mut out = InPlane::ZERO;
    for i in 0..2 {
        let length = f[i].length();
        let [e, slope, curvature] = limit.at(length);
        if e == 0.0 {
            continue;
        }
        let (d, across) = (f[i] / length, slope / length);
        out.energy += e;
        out.stress[i] = d * slope;
        out.hessian[2 * i] =
            outer(d * (curvature - across), d) + DMat3::from_diagonal(DVec3::splat(across));
    }
    out
}
