//! Contact with the body: where cloth touches skin, and what that costs.
//!
//! A touch is a point of the cloth (a vertex, or a point of a face) against the plane through the
//! nearest skin. The plane stays while a step is solved; the next step finds it anew. As the side
//! is signed, cloth that starts inside is pushed out by the same law.

use glam::{DMat3, DVec3};
use muslin_energy::{AtPoint, contact, contact::Barrier};

use crate::rub::Rub;

/// A point of the cloth near the body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    /// Corners whose weighted sum touches; a vertex has weight one on its first corner.
    pub verts: [u32; 3],
    pub weights: [f64; 3],
    /// The face with these corners; none for a vertex.
    pub face: Option<u32>,
    /// Nearest skin point at the end of the step [m].
    pub skin: DVec3,
    /// How the two rub, from the press before the step; its normal is the skin's, outward.
    pub rub: Rub,
    pub barrier: Barrier,
}

impl Touch {
    pub fn point(&self, x: &[DVec3]) -> DVec3 {
        let at = |k: usize| x[self.verts[k] as usize] * self.weights[k];
        at(0) + at(1) + at(2)
    }

    /// Signed distance from the skin's plane [m].
    pub fn gap(&self, x: &[DVec3]) -> f64 {
        (self.point(x) - self.skin).dot(self.rub.normal)
    }

    /// What a vertex that goes from one place [m] to another lacks of half its gap, if it comes from outside the skin.
    pub fn lift(&self, from: DVec3, to: DVec3) -> DVec3 {
        let gap = (from - self.skin).dot(self.rub.normal);
        let least = gap.min(0.5 * self.barrier.radius);
        let short = least - (to - self.skin).dot(self.rub.normal);
        match gap > 0.0 && short > 0.0 {
            true => self.rub.normal * short,
            false => DVec3::ZERO,
        }
    }

    /// Energy, force and stiffness at the touching point.
    pub fn answer(&self, x: &[DVec3]) -> AtPoint {
        let p = self.point(x);
        let mut out = contact::plane(p - self.skin, self.rub.normal, &self.barrier);
        let rub = self.rub.answer(p);
        out.energy += rub.energy;
        out.gradient += rub.gradient;
        out.hessian += rub.hessian;
        out
    }

    /// The touch at `x` [m] with where its slide ends, if all other forces lead vertices farther by their `ways` than
    /// friction may hold them `back` [m].
    pub fn led_on(&self, x: &[DVec3], ways: &[DVec3], back: &[f64]) -> Touch {
        let back = (0..3).map(|k| back[self.verts[k] as usize] * self.weights[k]);
        let rub = self.rub.led_on(self.point(x), self.point(ways), back.sum());
        Touch { rub, ..*self }
    }

    /// The velocity `after` a step [m/s], less what the push out of the skin added to it.
    ///
    /// Contact may stop what comes towards the skin, and take along what the skin pushes; it may
    /// not throw cloth off. `before`: the velocity before the step; `at`, `step`: where the point
    /// was then [m], and how long ago [s].
    pub fn without_bounce(
        &self,
        (before, after): (DVec3, DVec3),
        (at, step): (DVec3, f64),
    ) -> DVec3 {
        let skin = (self.rub.stuck - at) / step;
        let leaving = (after - skin).dot(self.rub.normal);
        let was = (before - skin).dot(self.rub.normal).max(0.0);
        after - self.rub.normal * (leaving - was).max(0.0)
    }

    /// Sets the grip from the press at `x`, with Coulomb's coefficient `mu`.
    pub fn press(&mut self, x: &[DVec3], mu: f64) {
        let [_, slope, _] = self.barrier.at(self.gap(x));
        self.rub.grip = -slope * mu;
    }

    /// How strongly the skin pushes after a Newton step from `from` to `to`, as the step saw it [N]. The
    /// barrier itself, which is curved, answers more where a step from deep inside ends.
    pub fn pressure(&self, from: &[DVec3], to: &[DVec3]) -> f64 {
        let gap = self.gap(from);
        let [_, slope, curvature] = self.barrier.at(gap);
        (-slope - curvature * (self.gap(to) - gap)).max(0.0)
    }
}

/// By how much friction may hold every one of `n` vertices back [N].
pub(crate) fn grips(touches: &[Touch], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n];
    for touch in touches {
        for (v, w) in touch.verts.iter().zip(touch.weights) {
            out[*v as usize] += touch.rub.grip * w;
        }
    }
    out
}

/// Sum of the touches' energies [J].
pub(crate) fn energy(touches: &[Touch], x: &[DVec3]) -> f64 {
    crate::ordered::sum(touches.len(), |range| {
        range.map(|t| touches[t].answer(x).energy).sum()
    })
}

/// Adds gradient and blocks of every touch.
pub(crate) fn add(
    touches: &[Touch],
    x: &[DVec3],
    gradient: &mut [DVec3],
    mut block: impl FnMut(&Touch, usize, usize, DMat3),
) {
    let answers = crate::ordered::map(touches.len(), |t| touches[t].answer(x));
    for (touch, answer) in touches.iter().zip(answers) {
        for a in (0..3).filter(|&a| touch.weights[a] != 0.0) {
            gradient[touch.verts[a] as usize] += answer.gradient * touch.weights[a];
            for b in (0..3).filter(|&b| touch.weights[b] != 0.0) {
                block(
                    touch,
                    a,
                    b,
                    answer.hessian * (touch.weights[a] * touch.weights[b]),
                );
            }
        }
    }
}

/// Takes from `moves` what would bring cloth from outside the skin to below half its gap.
///
/// A touch that has not begun has no stiffness yet, so that a solve would fall through it.
pub(crate) fn keep_out(touches: &[Touch], x: &[DVec3], moves: &mut [DVec3]) {
    for touch in touches.iter().filter(|t| t.face.is_none()) {
        let i = touch.verts[0] as usize;
        moves[i] += touch.lift(x[i], x[i] + moves[i]);
    }
}
