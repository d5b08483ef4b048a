//! Contact with the body: where cloth touches skin, and what that costs.
//!
//! A touch is a vertex of the cloth against the plane through the nearest skin. The plane stays while a step is solved; the next step finds it anew. As the side
//! is signed, cloth that starts inside is pushed out by the same law.

use glam::{DMat3, DVec3};
use muslin_energy::{AtPoint, contact, contact::Barrier, friction, friction::Pressed};

/// A vertex of the cloth near the body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    pub vert: u32,
    /// Nearest skin point at the end of the step [m].
    pub skin: DVec3,
    /// Outward unit normal there.
    pub normal: DVec3,
    /// Where the vertex would be if it had stuck to the skin [m].
    pub stuck: DVec3,
    pub barrier: Barrier,
    /// Largest friction force [N], from the press before the step.
    pub grip: f64,
    /// Slide that still counts as sticking [m].
    pub stick: f64,
}

impl Touch {
    /// Signed distance from the skin's plane [m].
    pub fn gap(&self, x: &[DVec3]) -> f64 {
        (x[self.vert as usize] - self.skin).dot(self.normal)
    }

    /// Energy, force and stiffness.
    pub fn answer(&self, x: &[DVec3]) -> AtPoint {
        let p = x[self.vert as usize];
        let mut out = contact::plane(p - self.skin, self.normal, &self.barrier);
        if self.grip > 0.0 {
            let on = Pressed {
                normal: self.normal,
                limit: self.grip,
                stick: self.stick,
            };
            let rub = friction::slide_majorised(p - self.stuck, &on);
            out.energy += rub.energy;
            out.gradient += rub.gradient;
            out.hessian += rub.hessian;
        }
        out
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
        let skin = (self.stuck - at) / step;
        let leaving = (after - skin).dot(self.normal);
        let was = (before - skin).dot(self.normal).max(0.0);
        after - self.normal * (leaving - was).max(0.0)
    }

    /// Sets the grip from the press at `x`, with Coulomb's coefficient `mu`.
    pub fn press(&mut self, x: &[DVec3], mu: f64) {
        let [_, slope, _] = self.barrier.at(self.gap(x));
        self.grip = -slope * mu;
    }
}

/// Sum of the touches' energies [J].
pub(crate) fn energy(touches: &[Touch], x: &[DVec3]) -> f64 {
    crate::ordered::sum(touches.len(), |range| {
        range.map(|t| touches[t].answer(x).energy).sum()
    })
}

/// Adds every touch's gradient, and its block to the vertex it is of.
pub(crate) fn add(
    touches: &[Touch],
    x: &[DVec3],
    gradient: &mut [DVec3],
    mut block: impl FnMut(u32, DMat3),
) {
    let answers = crate::ordered::map(touches.len(), |t| touches[t].answer(x));
    for (touch, answer) in touches.iter().zip(answers) {
        gradient[touch.vert as usize] += answer.gradient;
        block(touch.vert, answer.hessian);
    }
}

/// Takes from `moves` what would bring cloth from outside the skin to below half its gap.
///
/// A touch that has not begun has no stiffness yet, so that a solve would fall through it.
pub(crate) fn keep_out(touches: &[Touch], x: &[DVec3], moves: &mut [DVec3]) {
    for touch in touches {
        let i = touch.vert as usize;
        let gap = touch.gap(x);
        let least = gap.min(0.5 * touch.barrier.radius);
        let short = least - (gap + moves[i].dot(touch.normal));
        if gap > 0.0 && short > 0.0 {
            moves[i] += touch.normal * short;
        }
    }
}
