//! First guesses: from places in space where a detector gives them, else by turning round.

use crate::evidence::Evidence;
use crate::fold::Folded;
use crate::guess::{Guess, Placed};
use crate::joint::Habit;
use glam::{DMat3, DQuat, DVec3};

/// Marker rows (see `muslin_body::REGRESSED`): left, right.
const SHOULDERS: [usize; 2] = [5, 6];
const ELBOWS: [usize; 2] = [7, 8];
const WRISTS: [usize; 2] = [9, 10];
const HIPS: [usize; 2] = [11, 12];
const KNEES: [usize; 2] = [13, 14];
const ANKLES: [usize; 2] = [15, 16];
const HEELS: [usize; 2] = [21, 22];
const TOES: [usize; 2] = [17, 18];

/// What a first guess is made from.
pub struct Start<'a> {
    /// The folded body.
    pub folded: &'a Folded,
    /// Its features at the expected shape.
    pub features: &'a [DVec3],
    /// Keypoints by marker.
    pub evidence: &'a Evidence,
    /// One habit per joint group.
    pub habits: &'a [Option<Habit>],
    /// Expected focal length [px].
    pub focal: f64,
    /// First values of the free shape parameters.
    pub shape: Vec<f64>,
}

impl Start<'_> {
    /// The habitual stance, turned about the vertical by `yaw` [rad].
    pub fn turned(&self, yaw: f64) -> Guess {
        let rest = |h: &Option<Habit>| {
            h.map_or(DQuat::IDENTITY, |h| {
                DQuat::from_scaled_axis(h.axes * h.mean)
            })
        };
        let mut turns: Vec<DQuat> = self.habits.iter().map(rest).collect();
        turns[0] = DQuat::from_rotation_y(yaw);
        self.seat(turns)
    }

    /// The stance that the places in space show; the habitual one for limbs without them.
    ///
    /// None without both shoulders and hips.
    pub fn shown(&self) -> Option<Guess> {
        let world = |k: usize| self.evidence.marker(k).and_then(|s| s.world);
        let now = trunk(&world)?;
        let rest_markers = self.at_rest();
        let rest = trunk(&|k| Some(rest_markers[k]))?;
        let mut turns: Vec<DQuat> = vec![DQuat::IDENTITY; self.folded.groups.len()];
        let [pelvis, chest] = [0, 1].map(|k| DQuat::from_mat3(&(now[k] * rest[k].transpose())));
        turns[0] = pelvis;
        let each = DQuat::IDENTITY.slerp(pelvis.inverse() * chest, 0.2);
        for name in ["waist", "chest"] {
            turns[self.folded.group(name)?] = each;
        }
        for side in 0..2 {
            let arm = [SHOULDERS[side], ELBOWS[side], WRISTS[side]];
            self.aim(&mut turns, chest, ["shoulder", "elbow"], (side, &arm));
            let leg = [HIPS[side], KNEES[side], ANKLES[side]];
            let shin = self.aim(&mut turns, pelvis, ["hip", "knee"], (side, &leg));
            self.aim_foot(&mut turns, shin, side);
        }
        Some(self.seat(turns))
    }

    fn at_rest(&self) -> Vec<DVec3> {
        let turns = vec![DQuat::IDENTITY; self.folded.groups.len()];
        Placed::new(self.folded, self.features, &self.unplaced(turns)).markers
    }

    fn group(&self, name: &str, side: usize) -> Option<usize> {
        self.folded.group(&format!("{name}.{}", ["L", "R"][side]))
    }

    /// Points the two bones between three markers as the places in space do; how the last
    /// bone is turned then.
    fn aim(
        &self,
        turns: &mut [DQuat],
        trunk: DQuat,
        names: [&str; 2],
        (side, markers): (usize, &[usize; 3]),
    ) -> DQuat {
        let rest = self.at_rest();
        let rest = directions(|k| Some(rest[markers[k]]));
        let now = directions(|k| self.evidence.marker(markers[k]).and_then(|s| s.world));
        let mut parent = trunk;
        for k in 0..2 {
            let (Some(now), Some(rest)) = (now[k], rest[k]) else {
                return parent;
            };
            let Some(group) = self.group(names[k], side) else {
                return parent;
            };
            let mut turn = DQuat::from_rotation_arc(parent * rest, now) * parent;
            if let (0, Some(bend)) = (k, self.bend(names[1], side, turn, now, markers)) {
                turn = bend * turn;
            }
            turns[group] = parent.inverse() * turn;
            parent = turn;
        }
        parent
    }

    /// The twist about the upper bone that lets the lower joint bend about its own hinge.
    fn bend(
        &self,
        lower: &str,
        side: usize,
        turn: DQuat,
        along: DVec3,
        m: &[usize; 3],
    ) -> Option<DQuat> {
        let world = |k: usize| self.evidence.marker(m[k]).and_then(|s| s.world);
        let hinge = turn * self.habits[self.group(lower, side)?]?.hinge();
        let bend = along.cross((world(2)? - world(1)?).normalize_or_zero());
        let seen = ((bend.length() - 0.1) / 0.4).clamp(0.0, 1.0);
        let angle = hinge.cross(bend).dot(along).atan2(hinge.dot(bend));
        Some(DQuat::from_axis_angle(along, seen * angle))
    }

    fn aim_foot(&self, turns: &mut [DQuat], shin: DQuat, side: usize) {
        let world = |k: usize| self.evidence.marker(k).and_then(|s| s.world);
        let rest = self.at_rest();
        let (Some(toe), Some(heel)) = (world(TOES[side]), world(HEELS[side])) else {
            return;
        };
        let Some(group) = self.group("ankle", side) else {
            return;
        };
        let from = (rest[TOES[side]] - rest[HEELS[side]]).normalize_or_zero();
        let to = (toe - heel).normalize_or_zero();
        if from != DVec3::ZERO && to != DVec3::ZERO {
            turns[group] = DQuat::from_rotation_arc(from, shin.inverse() * to);
        }
    }

    fn unplaced(&self, turns: Vec<DQuat>) -> Guess {
        Guess {
            root: DVec3::ZERO,
            turns,
            log_focal: self.focal.ln(),
            origin: DVec3::ZERO,
            log_scale: 0.0,
            shape: self.shape.clone(),
        }
    }

    /// Puts the body where its markers come nearest to their pixels, and the hints' origin
    /// and scale where they come nearest to the markers.
    fn seat(&self, turns: Vec<DQuat>) -> Guess {
        let mut guess = self.unplaced(turns);
        let markers = Placed::new(self.folded, self.features, &guess).markers;
        guess.root = self.seat_at(&markers);
        let pairs: Vec<(DVec3, DVec3)> = self
            .evidence
            .seen
            .iter()
            .filter_map(|s| Some((markers[s.marker], s.world?)))
            .collect();
        if pairs.len() > 1 {
            let n = pairs.len() as f64;
            let mean = pairs
                .iter()
                .fold([DVec3::ZERO; 2], |m, p| [m[0] + p.0 / n, m[1] + p.1 / n]);
            let spread =
                |f: &dyn Fn(&(DVec3, DVec3)) -> f64| pairs.iter().map(f).sum::<f64>().sqrt();
            let ours = spread(&|p| (p.0 - mean[0]).length_squared());
            let theirs = spread(&|p| (p.1 - mean[1]).length_squared());
            let scale = (ours / theirs.max(1e-9)).clamp(0.2, 5.0);
            guess.log_scale = scale.ln();
            guess.origin = guess.root + mean[0] - scale * mean[1];
        }
        guess
    }

    /// The translation t with `x + t_x + u (z + t_z) ≈ 0` for every pixel `u f`, and y alike.
    fn seat_at(&self, markers: &[DVec3]) -> DVec3 {
        let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for seen in &self.evidence.seen {
            let (x, pixel) = (markers[seen.marker], seen.pixel / self.focal);
            for (row, miss) in [
                (DVec3::new(1.0, 0.0, pixel.x), x.x + pixel.x * x.z),
                (DVec3::new(0.0, 1.0, pixel.y), x.y + pixel.y * x.z),
            ] {
                a += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * seen.score;
                b -= row * miss * seen.score;
            }
        }
        let t = (a + DMat3::from_diagonal(DVec3::splat(1e-9))).inverse() * b;
        if t.is_finite() && t.z < -0.3 {
            return t;
        }
        // Nothing to measure the distance by: as far as a grown person would be.
        let depth = self.focal * 1.7 / self.evidence.size.max(1.0);
        let middle = self
            .evidence
            .seen
            .first()
            .map_or(glam::DVec2::ZERO, |s| s.pixel / self.focal);
        DVec3::new(middle.x * depth, middle.y * depth, -depth)
    }
}

/// Directions from each marker to the next.
fn directions(at: impl Fn(usize) -> Option<DVec3>) -> [Option<DVec3>; 2] {
    [0, 1].map(|k| Some((at(k + 1)? - at(k)?).normalize_or(DVec3::NEG_Y)))
}

/// Pelvis and chest: x to the body's left, y along the trunk.
fn trunk(at: &dyn Fn(usize) -> Option<DVec3>) -> Option<[DMat3; 2]> {
    let pair = |m: [usize; 2]| Some([at(m[0])?, at(m[1])?]);
    let (hips, shoulders) = (pair(HIPS)?, pair(SHOULDERS)?);
    let y = (shoulders[0] + shoulders[1] - hips[0] - hips[1]).normalize_or(DVec3::Y);
    let frame = |[left, right]: [DVec3; 2]| {
        let z = (left - right).cross(y).normalize_or(DVec3::Z);
        DMat3::from_cols(y.cross(z), y, z)
    };
    Some([frame(hips), frame(shoulders)])
}
