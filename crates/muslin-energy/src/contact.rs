//! Contact: what it costs to come closer than two surfaces are thick.
//!
//! A contact is a gap `d` between weighted points. The body pushes one way along its normal
//! ([`plane`]); cloth keeps cloth apart along the line between the nearest points ([`apart`]).
//! Both share one barrier, whose curvature grows from zero (so that a light touch does not
//! jitter) to a fixed stiffness (so that a start deep inside recovers instead of exploding).

use glam::DVec3;

use crate::{AtPoint, outer};

/// A cubic barrier with a quadratic end: three times differentiable in pieces, C² as a whole.
///
/// With the depth `s = radius − d`: zero for `s ≤ 0`, `k s³ / (6 w)` for `s ≤ w`, and from there
/// on the parabola of curvature `k` that continues it. A fixed curvature from the start would
/// be the penalty method; `w` is how much of the gap it takes to get there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    /// Gap at which the push begins [m].
    pub radius: f64,
    /// Depth over which the curvature rises to `stiffness`, > 0 [m].
    pub width: f64,
    /// Largest curvature `k` [N/m].
    pub stiffness: f64,
}

impl Barrier {
    /// Energy [J], slope [N] (never positive: it pushes apart) and curvature [N/m] at a gap [m].
    #[inline]
    pub fn at(&self, gap: f64) -> [f64; 3] {
        let (s, w, k) = (self.radius - gap, self.width, self.stiffness);
        if s <= 0.0 {
            return [0.0; 3];
        }
        if s <= w {
            return [k * s * s * s / (6.0 * w), -k * s * s / (2.0 * w), k * s / w];
        }
        let over = s - w;
        [
            k * (w * w / 6.0 + 0.5 * w * over + 0.5 * over * over),
            -k * (0.5 * w + over),
            k,
        ]
    }
}

/// One-sided contact with a plane: `E = b(n · r)`; Hessian `b″ n nᵀ`, exact.
///
/// `r`: cloth point minus the nearest body point [m], or their weighted sum; `normal`: outward
/// unit normal there. The gap is signed, so a point inside is pushed out by the same law. The
/// plane is the caller's to follow: between updates the body is taken as flat.
#[inline]
pub fn plane(r: DVec3, normal: DVec3, barrier: &Barrier) -> AtPoint {
    let [energy, slope, curvature] = barrier.at(normal.dot(r));
    AtPoint {
        energy,
        gradient: normal * slope,
        hessian: outer(normal * curvature, normal),
    }
}

/// Contact of two points, or two nearest points: `E = b(|r|)`; Hessian `b″ n nᵀ`, `n = r / |r|`.
///
/// `r`: one nearest point minus the other [m] (weights from [`crate::proximity`]). The exact
/// Hessian for fixed weights adds `b′/|r| (I − n nᵀ)`, which is never positive as `b′ ≤ 0`: what
/// stands here is the exact one with its negative eigenvalues set to zero. The gradient is also
/// that of the distance with moving nearest points, as these are where it is stationary.
/// Points that coincide have no direction between them: their gradient is zero, and whoever knows
/// the side should use [`plane`].
#[inline]
pub fn apart(r: DVec3, barrier: &Barrier) -> AtPoint {
    let gap = r.length();
    let [energy, slope, curvature] = barrier.at(gap);
    let normal = r.normalize_or_zero();
    AtPoint {
        energy,
        gradient: normal * slope,
        hessian: outer(normal * curvature, normal),
    }
}
