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

/// How a step in time follows from those before it: implicit Euler, or BDF2.
///
/// With `ρ` the step over the one before, `s = ρ² / (1 + 2 ρ)` and `past(q) = q₀ + s (q₀ − q₁)`:
/// the step ends at `x = past(x) + τ v` with `v = past(v) + τ a`, where `τ = h (1 + ρ) / (1 + 2 ρ)`,
/// which is what [`inertia`] asks for with `target` and `τ`. For equal steps `s = 1/3`, `τ = ⅔ h`;
/// implicit Euler has `s = 0`, `τ = h`.
///
/// BDF2 is of second order in time: quadratic motion such as free fall is exact, and a swing keeps
/// far more of its energy than under implicit Euler. The first step has no past and takes Euler's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scheme {
    share: f64,
    /// The step that inertia has, `τ` [s].
    pub tau: f64,
}

impl Scheme {
    /// Implicit Euler with a step of `h` > 0 [s].
    pub fn euler(h: f64) -> Scheme {
        Scheme { share: 0.0, tau: h }
    }

    /// BDF2 with a step of `h` after one of `last` [s].
    pub fn bdf2(h: f64, last: f64) -> Scheme {
        let ratio = h / last;
        Scheme {
            share: ratio * ratio / (1.0 + 2.0 * ratio),
            tau: h * (1.0 + ratio) / (1.0 + 2.0 * ratio),
        }
    }

    /// What the past makes of a quantity, now and one step before.
    #[inline]
    pub fn past(&self, [now, before]: [DVec3; 2]) -> DVec3 {
        now + (now - before) * self.share
    }

    /// Where a point would go unforced [m]. `x`, `v`: positions [m] and velocities [m/s], now and one
    /// step before.
    #[inline]
    pub fn target(&self, x: [DVec3; 2], v: [DVec3; 2]) -> DVec3 {
        self.past(x) + self.past(v) * self.tau
    }

    /// The velocity at the step's end `next` [m/s].
    #[inline]
    pub fn velocity(&self, next: DVec3, x: [DVec3; 2]) -> DVec3 {
        (next - self.past(x)) / self.tau
    }
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
