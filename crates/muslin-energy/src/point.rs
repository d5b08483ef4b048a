//! What acts on one point: its inertia, its weight, a pin, the air.

use glam::{DMat3, DVec3};

use crate::AtPoint;

/// A spring to a target: `E = ½ k |x − target|²`; exact Hessian `k I`.
///
/// `x`, `target`: positions [m]; `k`: stiffness [N/m]. With `k = m / h²` and the target
/// `x + h v` it is the inertia of a mass `m` [kg] over an implicit Euler step `h` [s]; with two
/// ends spread by the weights `[1, −1]` and target zero it is a stitch.
#[inline]
pub fn pin(x: DVec3, target: DVec3, k: f64) -> AtPoint {
    let d = x - target;
    AtPoint {
        energy: 0.5 * k * d.length_squared(),
        gradient: d * k,
        hessian: DMat3::from_diagonal(DVec3::splat(k)),
    }
}

/// Inertia over one implicit Euler step: `E = m / (2 h²) |x − target|²`.
///
/// `target`: where the point would go unforced, `x + h v` [m]; `mass` [kg]; `step`: h > 0 [s].
/// Gravity is a law of its own, so that a state at rest stays the start of the next step.
#[inline]
pub fn inertia(x: DVec3, target: DVec3, mass: f64, step: f64) -> AtPoint {
    pin(x, target, mass / (step * step))
}

/// Where a point would go unforced over a step of BDF2, and the step that its inertia then has.
///
/// `x`, `v`: positions [m] and velocities [m/s] now and one step before; `step`: h > 0 [s]. The
/// answer `(target, τ)` goes into [`inertia`]: `τ = ⅔ h` and
/// `target = (4 x₀ − x₁)/3 + τ (4 v₀ − v₁)/3`. The velocity afterwards is
/// `(3 x − 4 x₀ + x₁) / (2 h)`.
///
/// Second order in time: quadratic motion such as free fall is exact, and a wave keeps far more of
/// its energy than under implicit Euler. The first step has no past and takes implicit Euler.
#[inline]
pub fn bdf2(x: [DVec3; 2], v: [DVec3; 2], step: f64) -> (DVec3, f64) {
    let tau = step * (2.0 / 3.0);
    let past = |[now, before]: [DVec3; 2]| now + (now - before) / 3.0;
    (past(x) + past(v) * tau, tau)
}

/// Weight: `E = −m g · x`; no curvature.
///
/// `mass` [kg]; `g`: acceleration, as a rule `(0, −9.81, 0)` [m/s²].
#[inline]
pub fn gravity(x: DVec3, mass: f64, g: DVec3) -> AtPoint {
    AtPoint {
        energy: -mass * g.dot(x),
        gradient: g * -mass,
        hessian: DMat3::ZERO,
    }
}

/// Linear drag over one step: `E = c / (2 h) |x − carried|²`, a force `−c (v − v_medium)`.
///
/// `carried`: where the medium would have taken the point, `x_before + h v_medium` [m]; `c`:
/// drag coefficient ≥ 0 [N s/m]; `step`: h > 0 [s]. The medium is the air, or for damping the
/// neighbouring body.
#[inline]
pub fn drag(x: DVec3, carried: DVec3, c: f64, step: f64) -> AtPoint {
    pin(x, carried, c / step)
}
