//! Friction: what it costs to slide while pressed.
//!
//! Coulomb's law as a potential that lags behind: normal, force and nearest points come from the
//! last contact update, and sticking is a slide slower than a small speed (Li et al. 2020, IPC).

use glam::{DMat3, DVec3};

use crate::{AtPoint, outer};

/// A contact that has been pressed together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pressed {
    /// Unit normal of the contact.
    pub normal: DVec3,
    /// Largest friction force `μ N` [N].
    pub limit: f64,
    /// Slide below which the contact sticks, `ε_v h` > 0 [m]; usually 1 mm/s times the step.
    pub stick: f64,
}

/// `E = μN f(|u|)`, `u` the part of `slide` across the normal; the exact Hessian, never negative.
///
/// `slide`: how far the two sides moved relative to each other in this step [m]: in the frame
/// that moves with the body, subtract the body point's own motion. With `ε = stick`:
/// `f = |u|²/ε − |u|³/(3 ε²)` up to `ε`, then `|u| − ε/3`, so the force rises smoothly to `μN`
/// and stays. No slide, no force: there the Hessian is `2 μN/ε` across the normal.
#[inline]
pub fn slide(slide: DVec3, on: &Pressed) -> AtPoint {
    let (n, eps) = (on.normal, on.stick);
    let u = slide - n * n.dot(slide);
    let length = u.length();
    let direction = u.normalize_or_zero();
    let y = length / eps;
    let (energy, per_length, curvature) = if y < 1.0 {
        (
            eps * y * y * (1.0 - y / 3.0),
            (2.0 - y) / eps,
            2.0 * (1.0 - y) / eps,
        )
    } else {
        (length - eps / 3.0, 1.0 / length, 0.0)
    };
    let across = DMat3::IDENTITY - outer(n, n);
    let hessian = across * per_length + outer(direction * (curvature - per_length), direction);
    AtPoint {
        energy: on.limit * energy,
        gradient: u * (on.limit * per_length),
        hessian: hessian * on.limit,
    }
}

/// [`slide`] with a larger Hessian, `μN f′(|u|)/|u|` across the normal, whose parabola never falls
/// below the energy.
///
/// The exact one is flat along the slide: a Newton step that trusts it drives a sliding contact
/// far past the place where it would have stuck. With this one the step ends there at the latest.
#[inline]
pub fn slide_majorised(displacement: DVec3, on: &Pressed) -> AtPoint {
    let n = on.normal;
    let length = (displacement - n * n.dot(displacement)).length();
    let y = length / on.stick;
    let per_length = if y < 1.0 {
        (2.0 - y) / on.stick
    } else {
        1.0 / length
    };
    AtPoint {
        hessian: (DMat3::IDENTITY - outer(n, n)) * (on.limit * per_length),
        ..slide(displacement, on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_majorising_parabola_lies_above_the_energy() {
        let on = Pressed {
            normal: DVec3::Z,
            limit: 0.7,
            stick: 1e-3,
        };
        let places = || (-40..=40).map(|k| DVec3::new(f64::from(k) * 1.3e-4, 2e-4, 5e-4));
        for from in places() {
            let at = slide_majorised(from, &on);
            for to in places() {
                let d = to - from;
                let bound = at.energy + at.gradient.dot(d) + 0.5 * d.dot(at.hessian * d);
                let energy = slide(to, &on).energy;
                assert!(energy <= bound + 1e-15, "{from} to {to}: {energy} {bound}");
            }
        }
    }
}
