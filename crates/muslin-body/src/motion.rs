//! Poses over time: length, rate, and the way in from the rest pose.

use std::ops::Range;

use glam::{DQuat, DVec3};

use crate::Pose;

/// Poses at a steady rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Poses a second [1/s].
    pub fps: f64,
    /// In order of time.
    pub poses: Vec<Pose>,
}

impl Motion {
    /// Time from the first pose to the last [s]; zero for a still.
    pub fn duration(&self) -> f64 {
        self.poses.len().saturating_sub(1) as f64 / self.fps
    }

    /// The pose at a time [s], between its neighbours by the shorter way round.
    ///
    /// Before the start it is the first pose, after the end the last.
    ///
    /// # Panics
    /// If there are no poses.
    pub fn at(&self, time: f64) -> Pose {
        let last = self.poses.len() - 1;
        let place = (time * self.fps).clamp(0.0, last as f64);
        // A place that only rounding keeps from a pose is that pose, to the bit.
        let near = place.round();
        if (place - near).abs() < 1e-9 {
            return self.poses[near as usize].clone();
        }
        let before = place.floor() as usize;
        self.poses[before].toward(&self.poses[before + 1], place - before as f64)
    }

    /// How many poses it has at another rate [1/s]: it ends at most one step earlier.
    pub fn count_at(&self, fps: f64) -> usize {
        match self.poses.is_empty() {
            true => 0,
            false => (self.duration() * fps + 1e-6).floor() as usize + 1,
        }
    }

    /// The same motion at another rate [1/s].
    pub fn resampled(&self, fps: f64) -> Motion {
        self.part(fps, 0..self.count_at(fps))
    }

    /// Those poses of the motion at another rate [1/s].
    ///
    /// # Panics
    /// If there are no poses, and some are asked for.
    pub fn part(&self, fps: f64, poses: Range<usize>) -> Motion {
        let poses = poses.map(|i| self.at(i as f64 / fps)).collect();
        Motion { fps, poses }
    }

    /// How many steps lead from `rest` to the first pose if no joint may turn by more than `most`
    /// [rad] and the body go by no more than `far` [m] in one of them.
    pub fn steps_from(&self, rest: &Pose, (most, far): (f64, f64)) -> usize {
        let Some(first) = self.poses.first() else {
            return 0;
        };
        // Easing makes the middle of the way half as fast again as its mean.
        let turns = 1.5 * widest_turn(rest, first) / most;
        let shifts = (0..first.shifts.len()).map(|b| rest.shift(b).distance(first.shifts[b]));
        let way = shifts.fold(rest.root.distance(first.root), f64::max);
        let ways = 1.5 * way / far;
        turns.max(ways).ceil() as usize
    }

    /// The motion after `steps` steps that ease from `rest` to its first pose, so that cloth can
    /// be put on the body at rest. The first pose is then `rest`; the old first comes `steps` later.
    pub fn with_lead_in(&self, rest: &Pose, steps: usize) -> Motion {
        let Some(first) = self.poses.first() else {
            return self.clone();
        };
        let eased = (0..steps).map(|i| {
            let t = i as f64 / steps as f64;
            rest.toward(first, t * t * (3.0 - 2.0 * t))
        });
        let poses = eased.chain(self.poses.iter().cloned()).collect();
        Motion {
            fps: self.fps,
            poses,
        }
    }

    /// The motion turned about the vertical and moved level so that it starts over the origin and
    /// faces ahead (+Z). A body that lies, with no side ahead, is moved but not turned.
    pub fn from_origin(&self) -> Motion {
        let Some(first) = self.poses.first() else {
            return self.clone();
        };
        let ahead = first.rotations.first().map_or(DVec3::Z, |q| *q * DVec3::Z);
        let yaw = match ahead.with_y(0.0).length() > 0.2 {
            true => ahead.x.atan2(ahead.z),
            false => 0.0,
        };
        let back = DQuat::from_rotation_y(-yaw);
        let start = first.root.with_y(0.0);
        let mut motion = self.clone();
        for pose in &mut motion.poses {
            pose.root = back * (pose.root - start);
            if let Some(q) = pose.rotations.first_mut() {
                *q = back * *q;
            }
        }
        motion
    }

    /// The motion without its false start, and how many poses that was: recordings often begin with
    /// a pose or two for the record, then jump to where the actor stood. A jump is a joint that
    /// turns faster than 40 rad/s, within the first three poses.
    pub fn without_false_start(&self) -> (Motion, usize) {
        let jumps = |p: &[Pose]| widest_turn(&p[0], &p[1]) * self.fps > 40.0;
        let early = self.poses.windows(2).take(3);
        let n = early
            .enumerate()
            .filter(|(_, p)| jumps(p))
            .map(|(i, _)| i + 1);
        let n = n.max().unwrap_or(0);
        let poses = self.poses[n..].to_vec();
        (
            Motion {
                fps: self.fps,
                poses,
            },
            n,
        )
    }

    /// The largest turn of a joint between neighbouring poses [rad]; zero for a still.
    pub fn largest_turn(&self) -> f64 {
        let pairs = self.poses.windows(2);
        pairs.map(|p| widest_turn(&p[0], &p[1])).fold(0.0, f64::max)
    }

    /// Whether every number is finite and every rotation has unit length.
    pub fn is_sound(&self) -> bool {
        self.fps > 0.0
            && self.fps.is_finite()
            && self.poses.iter().all(|p| {
                p.root.is_finite()
                    && p.rotations.iter().all(|q| (q.length() - 1.0).abs() < 1e-6)
                    && p.shifts.iter().all(|s| s.is_finite())
                    && p.beyond.iter().all(|b| b.is_finite())
            })
    }
}

/// The largest angle between two poses' rotations of one joint [rad].
fn widest_turn(a: &Pose, b: &Pose) -> f64 {
    let turn = |(a, b): (&DQuat, &DQuat)| {
        let d = a.inverse() * *b;
        2.0 * d.xyz().length().atan2(d.w.abs())
    };
    let pairs = a.rotations.iter().zip(&b.rotations);
    pairs.map(turn).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(fps: f64, n: usize) -> Motion {
        let pose = |i: usize| Pose {
            root: DVec3::new(i as f64 / fps, 0.0, 0.0),
            rotations: vec![DQuat::from_rotation_y(0.3 * i as f64 / fps)],
            ..Pose::default()
        };
        Motion {
            fps,
            poses: (0..n).map(pose).collect(),
        }
    }

    #[test]
    fn another_rate_keeps_the_path_and_the_time() {
        let motion = ramp(120.0, 241);
        let slow = motion.resampled(60.0);
        assert_eq!((slow.poses.len(), slow.duration()), (121, 2.0));
        assert_eq!(slow.poses[7], motion.poses[14]);
        let odd = motion.resampled(47.0);
        for (i, pose) in odd.poses.iter().enumerate() {
            assert!((pose.root.x - i as f64 / 47.0).abs() < 1e-12);
        }
        assert_eq!(motion.resampled(120.0), motion);
    }

    #[test]
    fn a_lead_in_starts_at_rest_and_never_turns_faster_than_asked() {
        let motion = Motion {
            fps: 30.0,
            poses: vec![Pose {
                root: DVec3::new(0.0, 0.0, 2.0),
                rotations: vec![DQuat::from_rotation_x(2.0)],
                ..Pose::default()
            }],
        };
        let rest = Pose {
            root: DVec3::ZERO,
            rotations: vec![DQuat::IDENTITY],
            ..Pose::default()
        };
        let steps = motion.steps_from(&rest, (0.05, 1.0));
        let whole = motion.with_lead_in(&rest, steps);
        assert_eq!((whole.poses.len(), &whole.poses[0]), (steps + 1, &rest));
        assert!(whole.largest_turn() <= 0.05, "{}", whole.largest_turn());
    }

    #[test]
    fn a_pose_for_the_record_is_left_out() {
        let mut motion = ramp(30.0, 9);
        motion.poses[0].rotations[0] = DQuat::from_rotation_x(2.0);
        let (rest, n) = motion.without_false_start();
        assert_eq!((n, rest.poses), (1, motion.poses[1..].to_vec()));
        assert_eq!(ramp(30.0, 9).without_false_start(), (ramp(30.0, 9), 0));
    }

    #[test]
    fn from_the_origin_it_faces_ahead_and_keeps_its_shape() {
        let turn = DQuat::from_rotation_y(2.0);
        let mut motion = ramp(30.0, 4);
        for pose in &mut motion.poses {
            pose.root = turn * pose.root + DVec3::new(3.0, 0.5, -1.0);
            pose.rotations[0] = turn * pose.rotations[0];
        }
        let back = motion.from_origin();
        assert!(back.poses[0].root.distance(DVec3::new(0.0, 0.5, 0.0)) < 1e-12);
        let want = ramp(30.0, 4);
        for (a, b) in back.poses.iter().zip(&want.poses) {
            assert!(a.root.with_y(0.0).distance(b.root) < 1e-12);
            assert!(a.rotations[0].angle_between(b.rotations[0]) < 1e-7);
        }
    }
}
