//! Made-up people with exact keypoints, and how well the solver finds them again.

use crate::descend::Descent;
use crate::evidence::Evidence;
use crate::exact;
use crate::figure::Shapes;
use crate::fold::KNUCKLES;
use crate::guess::{Guess, Placed, view};
use crate::solve::Fitter;
use glam::{DQuat, DVec2, DVec3};
use muslin_body::{Avatar, Keypoint, Keypoints, Layout, Pose, Shape};

#[cfg(test)]
mod tests;

/// How a body came back from its own exact points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundTrip {
    /// Farthest that a point is off [m].
    pub points: f64,
    /// Farthest that a long bone is turned [rad].
    pub bones: f64,
    /// Steps of the solver.
    pub steps: usize,
    /// Half the sum of squares at the end, in standard deviations.
    pub cost: f64,
}

/// Fits a body to exact points of a made-up person, in the picture and in space, with nothing
/// expected of it, and compares.
///
/// `seed`: which person. None if the solver found no way in; that never happened.
pub fn round_trip(fitter: &Fitter, seed: u64) -> Option<RoundTrip> {
    let avatar = fitter.avatar();
    let person = person(fitter, avatar, seed);
    // In double precision: a micrometre can hide half a degree of how arm and collar share.
    let markers = person.folded_markers(fitter, avatar);
    let evidence = Evidence::new(&person.keypoints_at(&markers, true));
    let (shape, end) = exact::meet(fitter, &evidence, EXPECTED_FOCAL).ok()??;
    let found = Person::of(fitter, shape, &end);
    let pairs = found
        .markers(avatar)
        .into_iter()
        .zip(person.markers(avatar));
    let points = pairs.map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
    let pairs = found
        .directions(avatar)
        .into_iter()
        .zip(person.directions(avatar));
    let bones = pairs.map(|(a, b)| a.angle_between(b)).fold(0.0, f64::max);
    Some(RoundTrip {
        points,
        bones,
        steps: end.steps,
        cost: end.cost,
    })
}

/// What the solver takes for the focal length at first [px].
const EXPECTED_FOCAL: f64 = 1800.0;

/// Numbers that look random and are the same everywhere (SplitMix64).
struct Chance(u64);

impl Chance {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A person, where the camera sees them from.
struct Person {
    shape: Shape,
    pose: Pose,
    focal: f64,
}

const SIZE: [u32; 2] = [1200, 1600];

/// A random body in a random stance, a few metres before the camera.
fn person(fitter: &Fitter, avatar: &Avatar, seed: u64) -> Person {
    let mut chance = Chance(seed);
    let mut shape = Shape::default();
    for p in &mut shape.phenotypes[..6] {
        *p = chance.between(0.15, 0.85);
    }
    shape.phenotypes[1] = chance.between(0.7, 0.95);
    let mut pose = Pose::rest(avatar);
    for joint in &fitter.folded().joints {
        if let Some(habit) = fitter.habits()[joint.group] {
            let same = &mut Chance(seed ^ (joint.group as u64 * 7919 + 13));
            let draw = DVec3::from_array(std::array::from_fn(|_| same.between(-1.2, 1.2)));
            let phi = (habit.mean + habit.spread * draw).clamp(habit.range[0], habit.range[1]);
            pose.rotations[joint.bone] = DQuat::from_scaled_axis(habit.axes * phi);
        }
    }
    let turn = DQuat::from_rotation_y(chance.between(-3.1, 3.1));
    pose.rotations[0] = turn * DQuat::from_rotation_x(chance.between(-0.3, 0.4));
    pose.root = DVec3::new(
        chance.between(-0.4, 0.4),
        chance.between(-0.3, 0.3),
        -chance.between(3.0, 5.0),
    );
    Person {
        shape,
        pose,
        focal: chance.between(1400.0, 2400.0),
    }
}

impl Person {
    /// The person that a descent ended at.
    fn of(fitter: &Fitter, shape: Shape, end: &Descent) -> Person {
        let avatar = fitter.avatar();
        let mut pose = Pose::rest(avatar);
        let joints = &fitter.folded().joints;
        joints
            .iter()
            .for_each(|j| pose.rotations[j.bone] = end.guess.turns[j.group]);
        let head = avatar.figure(&shape).expect("an adult").joints[0];
        pose.root = end.guess.root - head;
        Person {
            shape,
            pose,
            focal: end.guess.log_focal.exp(),
        }
    }

    /// All markers in the camera's frame, by way of the whole mesh.
    fn markers(&self, avatar: &Avatar) -> Vec<DVec3> {
        let figure = avatar.figure(&self.shape).expect("an adult");
        let posed = avatar.pose(&figure, &self.pose);
        let regressed = avatar.regressors().rows().map(|row| {
            row.iter()
                .map(|&(v, w)| w * posed.verts[v as usize])
                .sum::<DVec3>()
        });
        let knuckle = |name: &&str| {
            let bone = avatar.bone(name).expect("a knuckle");
            posed.bones[bone].transform_point3(figure.joints[bone])
        };
        regressed.chain(KNUCKLES.iter().map(knuckle)).collect()
    }

    /// All markers in the camera's frame, by way of the folded body.
    fn folded_markers(&self, fitter: &Fitter, avatar: &Avatar) -> Vec<DVec3> {
        let folded = fitter.folded();
        let shapes = Shapes::new(avatar, folded, &self.shape, &[]).expect("a shape");
        let features = shapes.features(&[]);
        let mut turns = vec![DQuat::IDENTITY; folded.groups.len()];
        folded
            .joints
            .iter()
            .for_each(|j| turns[j.group] = self.pose.rotations[j.bone]);
        let root = features[0] + self.pose.root;
        let guess = Guess {
            root,
            turns,
            log_focal: 0.0,
            origin: DVec3::ZERO,
            log_scale: 0.0,
            shape: vec![],
        };
        Placed::new(folded, &features, &guess).markers
    }

    /// Exact keypoints as BlazePose would number them.
    #[cfg(test)]
    fn keypoints(&self, avatar: &Avatar, depth: bool) -> Keypoints {
        self.keypoints_at(&self.markers(avatar), depth)
    }

    /// The same, from all markers in the camera's frame [m].
    fn keypoints_at(&self, markers: &[DVec3], depth: bool) -> Keypoints {
        let hips = 0.5 * (markers[11] + markers[12]);
        let layout = Layout::BlazePose33;
        let marker = |i: usize| match layout.regressed(i) {
            Some([a, _]) => Some(a),
            None => (17..=22).contains(&i).then(|| 23 + i - 17),
        };
        let centre = 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
        let point = |i: usize| match marker(i) {
            Some(k) => {
                let pixel = view(markers[k], self.focal).0 * DVec2::new(1.0, -1.0) + centre;
                Keypoint { pixel, score: 1.0 }
            }
            None => Keypoint {
                pixel: centre,
                score: 0.0,
            },
        };
        let world = |i: usize| marker(i).map_or(DVec3::ZERO, |k| markers[k] - hips);
        Keypoints {
            layout,
            points: (0..33).map(point).collect(),
            world: depth.then(|| (0..33).map(world).collect()),
            image_size: SIZE,
        }
    }

    /// Directions of the long bones: upper arms, forearms, thighs, shins, trunk.
    fn directions(&self, avatar: &Avatar) -> Vec<DVec3> {
        let figure = avatar.figure(&self.shape).expect("an adult");
        let posed = avatar.pose(&figure, &self.pose);
        let at = |name: &str| {
            let b = avatar.bone(name).expect("a bone");
            posed.bones[b].transform_point3(figure.joints[b])
        };
        let middle = |n: &str| 0.5 * (at(&format!("{n}.L")) + at(&format!("{n}.R")));
        let mut all = vec![middle("upperarm01") - middle("upperleg01")];
        for side in ["L", "R"] {
            let at = |name: &str| at(&format!("{name}.{side}"));
            all.push(at("lowerarm01") - at("upperarm01"));
            all.push(at("wrist") - at("lowerarm01"));
            all.push(at("lowerleg01") - at("upperleg01"));
            all.push(at("foot") - at("lowerleg01"));
        }
        all.into_iter().map(DVec3::normalize).collect()
    }
}
