//! Feet that carry a body along a way: each stands still while it carries.

use glam::{DQuat, DVec2, DVec3};

use super::puppet::Foot;

/// A place on a way.
#[derive(Clone, Copy)]
pub struct Spot {
    /// To the left and ahead of the start [legs].
    pub at: DVec2,
    /// Where the body faces [rad].
    pub heading: f64,
}

/// Steps along a way. What the way is measured in is up to it: legs, or turns on the spot.
pub struct Gait<'a> {
    /// Where the hips are after so much of the way.
    pub way: &'a dyn Fn(f64) -> Spot,
    /// How much of the way there is.
    pub end: f64,
    /// Way from one step of a foot to the next of the same foot.
    pub stride: f64,
    /// Share of a stride that a foot is on the floor.
    pub duty: f64,
    /// How high a foot is lifted [legs].
    pub lift: f64,
    /// How far the heel comes up before the foot leaves, and the toes before it lands [degrees].
    pub roll: [f64; 2],
    /// Where the ball of a foot is at ease, outwards and ahead of the hips [legs].
    pub stance: [f64; 2],
}

/// How far apart the feet are before the first step, as a share of a step.
const STANDING: f64 = 0.6;

impl Gait<'_> {
    /// Where a foot is (0 left, 1 right) when the hips have come `s` far.
    pub fn foot(&self, s: f64, side: usize) -> Foot {
        let u = self.phase(s, side);
        let (n, x) = (u.floor(), u - u.floor());
        let (from, to) = (self.plant(n, side), self.plant(n + 1.0, side));
        let (out, back) = (
            self.size(&from, &to),
            self.size(&self.plant(n - 1.0, side), &from),
        );
        let [heel, toes] = self.roll;
        if x < self.duty {
            let y = x / self.duty;
            let strike = -toes * back * (1.0 - smooth(y / 0.2));
            let push = heel * out * smooth((y - 0.5) / 0.5);
            return foot(from, 0.0, strike + push);
        }
        let t = (x - self.duty) / (1.0 - self.duty);
        let moved = Spot {
            at: from.at.lerp(to.at, smooth(t)),
            heading: from.heading + (to.heading - from.heading) * smooth(t),
        };
        let pitch = out * (heel - (heel + toes) * smooth(t / 0.85));
        let height = self.lift * out * (std::f64::consts::PI * t).sin().powi(2);
        foot(moved, height, pitch)
    }

    /// How many strides a foot has made, its landing being a whole number.
    pub fn phase(&self, s: f64, side: usize) -> f64 {
        s / self.stride + [0.0, 0.5][side]
    }

    /// Where the ball of a foot stands in its `n`-th stance: under the hips in the middle of it.
    ///
    /// What it stands on at the start, and in the end, is nearer to the hips, as one stands about
    /// to go or having come.
    fn plant(&self, n: f64, side: usize) -> Spot {
        let landing = (n - [0.0, 0.5][side]) * self.stride;
        let leaving = landing + self.duty * self.stride;
        let carried = 0.5 * (landing + leaving);
        let middle = match (landing <= 1e-9, leaving >= self.end - 1e-9) {
            (true, _) => STANDING * carried.max(-0.5 * self.stride),
            (_, true) => self.end + STANDING * (carried - self.end).min(0.5 * self.stride),
            _ => carried,
        };
        let spot = (self.way)(middle);
        let [out, ahead] = self.stance;
        let out = if side == 0 { out } else { -out };
        let off = DQuat::from_rotation_y(spot.heading) * DVec3::new(out, 0.0, ahead);
        Spot {
            at: spot.at + DVec2::new(off.x, off.z),
            heading: spot.heading,
        }
    }

    /// How large a step is, up to one.
    fn size(&self, from: &Spot, to: &Spot) -> f64 {
        let turn = 0.3 * (to.heading - from.heading).abs();
        ((from.at.distance(to.at) + turn) / 0.6).min(1.0)
    }
}

fn foot(spot: Spot, height: f64, pitch: f64) -> Foot {
    Foot {
        ball: DVec3::new(spot.at.x, height, spot.at.y),
        heading: spot.heading,
        pitch,
    }
}

/// From 0 to 1 without a jerk at either end, and flat beyond (the minimum-jerk polynomial).
pub fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

/// Share of a way covered at time `t` of `time` [s]: speed grows over the first `ramp` seconds,
/// then holds, and fades over the last.
pub fn eased(t: f64, time: f64, ramp: f64) -> f64 {
    // The integral of 3x² − 2x³.
    let grown = |x: f64| ramp * x * x * x * (1.0 - 0.5 * x);
    let whole = time - ramp;
    let t = t.clamp(0.0, time);
    let covered = if t < ramp {
        grown(t / ramp)
    } else if t < time - ramp {
        0.5 * ramp + (t - ramp)
    } else {
        whole - grown((time - t) / ramp)
    };
    covered / whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn easing_covers_the_whole_way_without_a_jump() {
        assert_eq!((eased(0.0, 3.0, 0.5), eased(3.0, 3.0, 0.5)), (0.0, 1.0));
        let v = |t: f64| (eased(t + 1e-6, 3.0, 0.5) - eased(t - 1e-6, 3.0, 0.5)) / 2e-6;
        for t in [0.5, 2.5] {
            assert!((v(t - 1e-3) - v(t + 1e-3)).abs() < 1e-2);
        }
        assert!(v(1e-5) < 1e-3 && v(3.0 - 1e-5) < 1e-3);
    }

    #[test]
    fn a_foot_stands_still_while_it_carries_and_starts_and_ends_near_the_other() {
        let way = |s: f64| Spot {
            at: DVec2::new(0.0, s),
            heading: 0.0,
        };
        let gait = Gait {
            way: &way,
            end: 4.5,
            stride: 1.5,
            duty: 0.6,
            lift: 0.1,
            roll: [30.0, 10.0],
            stance: [0.1, 0.0],
        };
        for s in [0.0, 4.5] {
            let [l, r] = [0, 1].map(|side| gait.foot(s, side).ball);
            assert!((l.z - r.z).abs() < 0.5, "{l} {r}");
        }
        for side in 0..2 {
            let mut last = gait.foot(0.0, side);
            for i in 1..=900 {
                let now = gait.foot(0.005 * f64::from(i), side);
                let is_down = now.ball.y == 0.0 && last.ball.y == 0.0;
                let moved = now.ball.distance(last.ball);
                assert!(!is_down || moved == 0.0, "{moved} at {i}");
                assert!(moved < 0.06 && (now.pitch - last.pitch).abs() < 4.0, "{i}");
                last = now;
            }
        }
    }
}
