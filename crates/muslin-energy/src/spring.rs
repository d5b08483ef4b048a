//! Springs along edges: the plainest cloth there is.

use glam::{DMat3, DVec3};

use crate::{Local, outer};

/// A spring along an edge: `E = ½ k (l − l̄)²`.
///
/// `x`: end points [m]; `rest`: l̄ > 0 [m]; `k`: stiffness [N/m]. The Hessian is `k d dᵀ` along the
/// edge and `k (1 − l̄/l)` across it, the latter at least zero: exact in tension, and in compression
/// without what would push the edge sideways. Ends that coincide have no direction: gradient and
/// Hessian are zero.
///
/// The edge term of mass-spring cloth (Provot 1995) and of neural garments (PBNS, Bertiche et al.
/// 2021). Its stiffness depends on the mesh; a fabric's own law is [`crate::membrane`].
#[inline]
pub fn edge(x: &[DVec3; 2], rest: f64, k: f64) -> Local<2> {
    let mut out = Local::ZERO;
    let along = x[1] - x[0];
    let length = along.length();
    let d = along.normalize_or_zero();
    let stretch = length - rest;
    out.energy = 0.5 * k * stretch * stretch;
    out.gradient = [d * (-k * stretch), d * (k * stretch)];
    if d == DVec3::ZERO {
        return out;
    }
    let across = k * (stretch / length).max(0.0);
    let block = outer(d * (k - across), d) + DMat3::from_diagonal(DVec3::splat(across));
    out.hessian = [[block, -block], [-block, block]];
    out
}
