//! Which way is up, and what stands on the floor.
//!
//! A picture does not say how its camera was held. People do: they stand in balance, on feet that
//! are on one floor.

use crate::fold::{Folded, N_MARKERS};
use crate::guess::{Guess, Placed};
use crate::touch::Tie;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// A camera is not expected to be tilted more than this, up or down, and to a side [rad].
const MOST: DVec2 = DVec2::new(0.35, 0.3);
/// How far people hold it from level [rad].
const USUAL: DVec2 = DVec2::new(0.3, 0.06);
/// The same, once balance has had its say.
const SURE: DVec2 = DVec2::new(0.04, 0.03);
/// How far out of balance people stand [rad], and when they do not stand at all.
const BALANCE: (f64, f64) = (0.05, 8.0);
/// How far apart in height feet are that share a floor [m], and when they do not.
const LEVEL: (f64, f64) = (0.025, 2.5);
/// A foot carries its owner at this distance from its middle too [m].
const FOOT: f64 = 0.02;
/// A foot that is lifted this much carries nothing [m].
const LIFTED: f64 = 0.25;
/// Who has less between feet and middle of mass does not stand [m].
const STANDS: f64 = 0.5;

/// A foot less than the first of these above the floor is put down; above the second it stays [m].
const NEAR_FLOOR: [f64; 2] = [0.08, 0.14];
/// Heels farther apart than this are on their way somewhere [m].
const STRIDE: f64 = 0.4;
/// How exactly both feet reach the floor [m].
const FLOOR_SPREAD: f64 = 0.01;

/// Parts of a body's mass, each between two pairs of markers (left and right together).
///
/// Rounded from Winter's table of segment masses (head 8 %, trunk 50, arms 10, legs 32).
const MASSES: [([usize; 2], f64); 6] = [
    ([3, 4], 0.08),
    ([5, 6], 0.27),
    ([7, 8], 0.08),
    ([11, 12], 0.33),
    ([13, 14], 0.16),
    ([15, 16], 0.08),
];

/// Heels and toes, left then right.
const FEET: [[usize; 3]; 2] = [[17, 19, 21], [18, 20, 22]];

/// The points of a body that meet the floor.
#[derive(Debug, Clone)]
pub struct Stand {
    /// Under toes, small toes and heels, left then right [m].
    soles: [[DVec3; 3]; 2],
    /// Middle of mass [m].
    mass: DVec3,
    /// All markers [m].
    markers: Vec<DVec3>,
}

impl Stand {
    /// Of a body in the camera's frame.
    pub fn new(folded: &Folded, features: &[DVec3], placed: &Placed) -> Stand {
        let rest = Placed::new(folded, features, &at_rest(folded, features)).markers;
        let sole = features[features.len() - 1].y;
        let under = |side: usize| {
            let ankle = folded.group(["ankle.L", "ankle.R"][side]);
            let joint = folded.joints.iter().position(|j| Some(j.group) == ankle);
            let turn = joint.map_or(DMat3::IDENTITY, |j| placed.turns[j]);
            FEET[side].map(|k| placed.markers[k] + turn * DVec3::new(0.0, sole - rest[k].y, 0.0))
        };
        let middle = |m: [usize; 2]| 0.5 * (placed.markers[m[0]] + placed.markers[m[1]]);
        Stand {
            soles: [0, 1].map(under),
            mass: MASSES.iter().map(|&(m, w)| w * middle(m)).sum(),
            markers: placed.markers[..N_MARKERS].to_vec(),
        }
    }

    /// The unit vector that points up, in the camera's frame.
    ///
    /// The camera is taken as level but for what brings the middle of mass over the feet and
    /// both feet to one floor. Level where nobody stands.
    pub fn up(&self) -> DVec3 {
        let feet = self.soles.map(|s| s.iter().sum::<DVec3>() / 3.0);
        if self.mass.y - feet[0].y.min(feet[1].y) < STANDS {
            return DVec3::Y;
        }
        let balanced = self.likeliest((DVec2::ZERO, USUAL), 0.0);
        // A foot in the air stays there, however the camera could have been held.
        let close = ((NEAR_FLOOR[1] - self.gap(up_of(balanced))) / NEAR_FLOOR[0]).clamp(0.0, 1.0);
        up_of(self.likeliest((balanced, SURE), close))
    }

    /// How the camera was held, by compass search: the sum has kinks and is cheap.
    ///
    /// Around `expected`; `level`: how much it counts that both feet are on one floor.
    fn likeliest(&self, (expected, spread): (DVec2, DVec2), level: f64) -> DVec2 {
        let strange = |held: DVec2| {
            let off = ((held - expected) / spread).length_squared();
            let lean = robust(self.lean(up_of(held)), BALANCE);
            off + lean + level * robust(self.gap(up_of(held)), LEVEL)
        };
        let (mut at, mut step) = (expected, 0.08);
        let mut least = strange(at);
        while step > 1e-3 {
            let tries = [DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y];
            let tries = tries.map(|d| (at + step * d).clamp(-MOST, MOST));
            let best = tries.map(|t| (strange(t), t));
            let best = best.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
            match best {
                Some((cost, place)) if cost < least => (least, at) = (cost, place),
                _ => step *= 0.5,
            }
        }
        at
    }

    /// Heights of the soles' lowest points [m].
    fn heights(&self, up: DVec3) -> [f64; 2] {
        let lowest = |s: &[DVec3; 3]| s.iter().map(|p| up.dot(*p)).fold(f64::MAX, f64::min);
        self.soles.each_ref().map(lowest)
    }

    /// How much higher one foot is than the other [m].
    fn gap(&self, up: DVec3) -> f64 {
        let [a, b] = self.heights(up);
        (a - b).abs()
    }

    /// How far the middle of mass is out of balance [rad].
    fn lean(&self, up: DVec3) -> f64 {
        let height = self.heights(up);
        let feet = self.soles.map(|s| s.iter().sum::<DVec3>() / 3.0);
        let (low, high) = if height[0] < height[1] {
            (0, 1)
        } else {
            (1, 0)
        };
        let gap = height[high] - height[low];
        let share = 1.0 - (gap / LIFTED).min(1.0);
        let flat = |v: DVec3| v - up * up.dot(v);
        let (reach, arm) = (
            flat(share * (feet[high] - feet[low])),
            flat(self.mass - feet[low]),
        );
        let t = (arm.dot(reach) / reach.length_squared().max(1e-9)).clamp(0.0, 1.0);
        let out = ((arm - t * reach).length() - FOOT).max(0.0);
        out.atan2(up.dot(self.mass) - height[low])
    }

    /// How far the lowest point lies below the camera [m]: soles, else whatever touches the floor.
    pub fn floor(&self, up: DVec3) -> f64 {
        let soles = self.soles.iter().flatten().map(|p| -up.dot(*p));
        // Knees, hips and hands have some flesh below them.
        let others = self.markers[..17].iter().map(|p| 0.05 - up.dot(*p));
        soles.chain(others).fold(f64::NEG_INFINITY, f64::max)
    }

    /// What brings a foot near the floor down to it, and flat where somebody stands at ease.
    pub fn steps(&self, up: DVec3) -> Vec<Step> {
        let lowest = |side: usize| {
            let sole = self.soles[side];
            let height = |k: &usize| up.dot(sole[*k]);
            let low = (0..3).min_by(|a, b| height(a).total_cmp(&height(b)));
            [side, low.expect("a foot has three points")]
        };
        let [a, b] = [lowest(0), lowest(1)];
        let height = |[side, k]: [usize; 2]| up.dot(self.soles[side][k]);
        let (low, high) = if height(a) < height(b) {
            (a, b)
        } else {
            (b, a)
        };
        let mut steps = vec![(high, low)];
        let apart = self.soles[0][2] - self.soles[1][2];
        if (apart - up * up.dot(apart)).length() < STRIDE {
            steps.extend([0, 1].map(|side| ([side, 2], [side, 0])));
        }
        let step = |(high, low): ([usize; 2], [usize; 2])| {
            let gap = (height(high) - height(low)).abs();
            let [all, none] = NEAR_FLOOR;
            let share = ((none - gap) / (none - all)).clamp(0.0, 1.0);
            let lift =
                |[side, k]: [usize; 2]| up.dot(self.markers[FEET[side][k]] - self.soles[side][k]);
            let [foot, other] = [high, low].map(|[side, k]| FEET[side][k]);
            (share > 0.0).then(|| Step {
                along: up,
                ends: vec![(foot, 1.0), (other, -1.0)],
                apart: lift(high) - lift(low),
                spread: FLOOR_SPREAD / share,
            })
        };
        steps.into_iter().filter_map(step).collect()
    }
}

/// That a mean of markers is where somebody at ease has it, along some direction: one point of
/// the feet as low as another, shoulders over hips.
#[derive(Debug, Clone)]
pub struct Step {
    /// Direction, in the camera's frame.
    pub along: DVec3,
    /// Markers and their weights, which sum to zero.
    pub ends: Vec<(usize, f64)>,
    /// What `along · Σ w x` is then [m].
    pub apart: f64,
    /// One standard deviation [m].
    pub spread: f64,
}

impl Step {
    /// What is left to do.
    pub fn tie(&self, placed: &Placed) -> Tie {
        let line: DVec3 = self.ends.iter().map(|&(k, w)| w * placed.markers[k]).sum();
        let gap = self.along.dot(line) - self.apart;
        Tie {
            ends: self.ends.clone(),
            along: self.along,
            miss: gap / self.spread,
            spread: self.spread,
        }
    }
}

/// Up for a camera that looks up or down, and leans to a side, by these angles [rad].
fn up_of(held: DVec2) -> DVec3 {
    let level = DQuat::from_rotation_x(held.x) * DQuat::from_rotation_z(held.y);
    level.inverse() * DVec3::Y
}

/// Geman-McClure: the square of a miss, which counts no more than the square of `doubt`.
fn robust(miss: f64, (spread, doubt): (f64, f64)) -> f64 {
    let square = (miss / spread).powi(2);
    square / (1.0 + square / (doubt * doubt))
}

/// The body before anybody moves it.
pub fn at_rest(folded: &Folded, features: &[DVec3]) -> Guess {
    Guess {
        root: features[0],
        turns: vec![DQuat::IDENTITY; folded.groups.len()],
        log_focal: 0.0,
        origin: DVec3::ZERO,
        log_scale: 0.0,
        shape: Vec::new(),
    }
}
