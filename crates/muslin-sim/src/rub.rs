//! Rubbing: friction between two sides that are pressed together, and where their slide ends.

use glam::{DMat3, DVec3};
use muslin_energy::{AtPoint, friction, friction::Pressed, outer};

/// Friction between two sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rub {
    /// Unit vector across the two sides.
    pub normal: DVec3,
    /// Where the one would be, as seen from the other, had they stuck together since the step began [m].
    pub stuck: DVec3,
    /// Largest friction force [N].
    pub grip: f64,
    /// Slide that still counts as sticking [m].
    pub stick: f64,
    /// Where the slide ends that all other forces lead on, as seen from there [m]; none where friction holds it back.
    ends: Option<DVec3>,
}

impl Rub {
    /// Sides that stick together until all other forces are known.
    pub fn new((normal, stuck): (DVec3, DVec3), grip: f64, stick: f64) -> Rub {
        Rub {
            normal,
            stuck,
            grip,
            stick,
            ends: None,
        }
    }

    /// With where the slide ends of who is at `at` [m], if all other forces lead it farther by a `way` than friction
    /// may hold it `back` [m].
    pub fn led_on(&self, at: DVec3, way: DVec3, back: f64) -> Rub {
        let at = self.along(at - self.stuck);
        let to = at + self.along(way);
        let (so_far, far) = (at.length(), to.length());
        let gains = self.grip > 0.0 && far - back > so_far.max(self.stick);
        // Who slides the other way must come to rest first.
        let is_onwards = so_far < self.stick || to.dot(at) > 0.0;
        Rub {
            ends: (gains && is_onwards).then(|| to * (1.0 - back / far)),
            ..*self
        }
    }

    /// What it costs to be at `at` [m].
    pub fn answer(&self, at: DVec3) -> AtPoint {
        if self.grip <= 0.0 {
            return AtPoint::ZERO;
        }
        let on = Pressed {
            normal: self.normal,
            limit: self.grip,
            stick: self.stick,
        };
        let slide = at - self.stuck;
        let rub = friction::slide_majorised(slide, &on);
        match self.ends {
            None => rub,
            Some(ends) => AtPoint {
                hessian: self.gaining(slide, ends, &on),
                ..rub
            },
        }
    }

    /// The stiffness with which one step leads a slide to where it ends: from there on the limit holds it back, which
    /// in motion it does already, and at rest not yet. The parabola above its energy would have it stick.
    fn gaining(&self, slide: DVec3, ends: DVec3, on: &Pressed) -> DMat3 {
        let whole = friction::slide_majorised(ends, on).hessian;
        if self.along(slide).length() < self.stick {
            return whole;
        }
        let along = ends.normalize_or_zero();
        whole - outer(along * along.dot(whole * along), along)
    }

    /// The part along the two sides.
    fn along(&self, d: DVec3) -> DVec3 {
        d - self.normal * self.normal.dot(d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_step_leads_a_slide_that_gains_to_where_it_ends_and_no_other_farther() {
        let on = Rub::new((DVec3::Y, DVec3::Z), 1e-3, 3e-5);
        let back = 1e-4;
        // What is across the two sides is not theirs.
        let led = |slid: f64, way: f64| {
            let at = DVec3::Z + DVec3::X * slid;
            let led = on.led_on(at, DVec3::new(way, 5e-4, 0.0), back);
            let answer = led.answer(at);
            (led.ends, answer.gradient.x, answer.hessian.x_axis.x)
        };
        let (ends, slope, k) = led(0.0, 3e-4);
        let ends = ends.expect("it begins to slide");
        assert!(ends.distance(DVec3::X * 2e-4) < 1e-12 && slope == 0.0);
        assert!((k * ends.x / on.grip - 1.0).abs() < 1e-9);
        let (ends, slope, k) = led(2e-4, 3e-4);
        assert!(ends.expect("it slides on").distance(DVec3::X * 4e-4) < 1e-12);
        assert!((slope / on.grip - 1.0).abs() < 1e-9 && k.abs() < 1e-9 * on.grip / 2e-4);
        // Held back, losing, or turning round.
        for (slid, way) in [(0.0, 1.2e-4), (2e-4, 0.9e-4), (2e-4, -9e-4)] {
            let (ends, _, k) = led(slid, way);
            let parabola = on.answer(DVec3::Z + DVec3::X * slid).hessian.x_axis.x;
            assert!(
                ends.is_none() && k == parabola && k > 0.0,
                "{way}: {ends:?}"
            );
        }
        let smooth = Rub { grip: 0.0, ..on };
        let led = smooth.led_on(DVec3::Z, DVec3::X, 0.0);
        assert!(led.ends.is_none() && led.answer(DVec3::ONE) == AtPoint::ZERO);
    }
}
