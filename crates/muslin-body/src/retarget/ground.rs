//! The floor that a recording walks on.
//!
//! Floors of recordings slope: a walker of four metres ends 5 cm higher than it began. And ankle and
//! toes are other places in every skeleton, so that their line on a flat foot points down by 10
//! degrees in one and by 40 in another. Where feet stand shows both.

use glam::{DQuat, DVec3};

use super::Stance;

/// A foot stands where ankle and toes move less than this [leg lengths a second].
const STILL: f64 = 0.25;
/// Moments in which feet stand that tell anything, and the share of all moments that they are at least.
const FEWEST: usize = 12;
const SHARE: f64 = 0.05;
/// Feet this much above the lowest [leg lengths] may stand on the floor before its slope is known, and after.
const STEPS: f64 = 0.2;
const NEAR: f64 = 0.06;
/// Rounds in which who stands on the floor and its slope are found.
const ROUNDS: usize = 4;
/// Steeper floors are hills [m/m].
const STEEPEST: f64 = 0.05;
/// Slope is believed as far as feet stand this far apart [leg lengths].
const APART: f64 = 0.3;
/// Share of the standing feet that may be below the floor.
const BELOW: f64 = 0.1;
/// Feet that differ more from ours are not taken for flat ones [rad].
const MOST_LIFT: f64 = 0.7;

/// Where a recording's feet stand.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ground {
    /// How much the floor rises along x and z [m/m].
    slope: [f64; 2],
    /// Height of a standing ankle, the slope taken out.
    pub floor: f64,
    /// How far each foot points up where it stands [rad]; none where it is not seen to.
    up: [Option<f64>; 2],
}

impl Ground {
    /// From moments of a recording, each with how fast ankle and toes move, the faster of them; left, right.
    pub fn new(seen: &[(Stance, [f64; 2])]) -> Ground {
        let lowest = seen.iter().map(|(s, _)| s.lowest_ankle());
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        let mut ground = Ground {
            floor: if lowest.is_finite() { lowest } else { 0.0 },
            ..Ground::default()
        };
        let Some(leg) = seen.first().map(|(s, _)| s.leg_length()) else {
            return ground;
        };
        let still: Vec<(&Stance, usize)> = (seen.iter())
            .flat_map(|(s, speeds)| [0, 1].map(|side| (s, side, speeds[side])))
            .filter(|(_, _, speed)| *speed < STILL * leg)
            .map(|(s, side, _)| (s, side))
            .collect();
        let ankles: Vec<DVec3> = still.iter().map(|(s, side)| s.leg[*side][2]).collect();
        let enough = |n: usize| n >= FEWEST && n as f64 >= SHARE * seen.len() as f64;
        let on_floor = |g: &Ground, near: f64| -> Vec<usize> {
            let heights: Vec<f64> = ankles.iter().map(|p| g.level(*p).y).collect();
            let low = quantile(heights.clone(), 0.1);
            let all = 0..ankles.len();
            all.filter(|&k| heights[k] < low + near * leg).collect()
        };
        let mut standing = on_floor(&ground, STEPS);
        for _ in 0..ROUNDS {
            if !enough(standing.len()) {
                return ground;
            }
            let points: Vec<DVec3> = standing.iter().map(|&k| ankles[k]).collect();
            let slope = slope(&points, APART * leg);
            if slope[0].hypot(slope[1]) > STEEPEST {
                return ground;
            }
            let sloped = Ground { slope, ..ground };
            standing = on_floor(&sloped, NEAR);
            ground = sloped;
        }
        let heights = standing.iter().map(|&k| ground.level(ankles[k]).y);
        ground.floor = quantile(heights.collect(), BELOW);
        ground.up = [0, 1].map(|side| {
            let own = standing.iter().map(|&k| still[k]).filter(|s| s.1 == side);
            let up: Vec<f64> = own.filter_map(|(s, _)| s.foot_up(side)).collect();
            (up.len() >= FEWEST / 2).then(|| quantile(up, 0.5))
        });
        ground
    }

    /// The place above a level floor.
    pub fn level(&self, p: DVec3) -> DVec3 {
        let [x, z] = self.slope;
        p - DVec3::Y * (x * p.x + z * p.z)
    }

    /// The stance on feet that are flat where those of `rest` are.
    pub fn flattened(&self, stance: &Stance, rest: &Stance) -> Stance {
        let mut out = *stance;
        for side in 0..2 {
            let [_, knee, ankle] = out.leg[side];
            let (Some(theirs), Some(ours), Some(toe)) =
                (self.up[side], rest.foot_up(side), out.toe[side])
            else {
                continue;
            };
            let lift = ours - theirs;
            let axis = (ankle - knee).cross(toe - ankle).try_normalize();
            if let Some(axis) = axis.filter(|_| lift.abs() < MOST_LIFT) {
                let turn = DQuat::from_axis_angle(axis, lift);
                out.toe[side] = Some(ankle + turn * (toe - ankle));
            }
        }
        out
    }
}

/// The slope of a floor below points, none where they lie within `apart`: least squares.
fn slope(points: &[DVec3], apart: f64) -> [f64; 2] {
    let n = points.len() as f64;
    let middle = points.iter().sum::<DVec3>() / n;
    let [mut xx, mut xz, mut zz, mut xy, mut zy] = [0.0; 5];
    for p in points {
        let d = *p - middle;
        xx += d.x * d.x / n;
        xz += d.x * d.z / n;
        zz += d.z * d.z / n;
        xy += d.x * d.y / n;
        zy += d.z * d.y / n;
    }
    let (xx, zz) = (xx + apart * apart, zz + apart * apart);
    let det = xx * zz - xz * xz;
    [(zz * xy - xz * zy) / det, (xx * zy - xz * xy) / det]
}

/// The value that a share of all are below.
fn quantile(mut all: Vec<f64>, share: f64) -> f64 {
    all.sort_by(f64::total_cmp);
    let at = (share * all.len() as f64) as usize;
    all.get(at.min(all.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::INFINITY)
}
