//! Built-in stances of the default body, each told by where its limbs point.
//!
//! Directions are in the body's own frame: +X its left, +Y up, +Z ahead. Limbs are aimed from the
//! trunk outwards by the smallest turn, so a stance looks alike on every shape.

use glam::{DQuat, DVec3};

use crate::pose::world_from_rest;
use crate::{Avatar, BodyError, Figure, Pose, names};

/// A limb (first and last bone) and where it points.
type Aim = (&'static str, &'static str, [f64; 3]);

const UPPER_ARM: [(&str, &str); 2] = [
    ("upperarm01.L", "upperarm02.L"),
    ("upperarm01.R", "upperarm02.R"),
];
const FOREARM: [(&str, &str); 2] = [
    ("lowerarm01.L", "lowerarm02.L"),
    ("lowerarm01.R", "lowerarm02.R"),
];
const THIGH: [(&str, &str); 2] = [
    ("upperleg01.L", "upperleg02.L"),
    ("upperleg01.R", "upperleg02.R"),
];
const SHIN: [(&str, &str); 2] = [
    ("lowerleg01.L", "lowerleg02.L"),
    ("lowerleg01.R", "lowerleg02.R"),
];

const HAND: [(&str, &str); 2] = [("wrist.L", "finger3-1.L"), ("wrist.R", "finger3-1.R")];

/// Where upper arms, forearms, thighs and shins point; left, then right, seen from the body.
struct Stance {
    name: &'static str,
    says: &'static str,
    /// Forward lean of the spine [degrees].
    lean: f64,
    limbs: [[[f64; 3]; 2]; 4],
    /// Where hands point; none: on from the forearms.
    hands: Option<[[f64; 3]; 2]>,
}

/// Straight down, a little outwards.
const DOWN: [[f64; 3]; 2] = [[0.04, -1.0, 0.0], [-0.04, -1.0, 0.0]];
const SHINS: [[f64; 3]; 2] = [[0.04, -1.0, -0.05], [-0.04, -1.0, -0.05]];

const STANCES: [Stance; 8] = [
    Stance {
        name: "stand",
        says: "upright, arms at the sides",
        lean: 0.0,
        limbs: [
            [[0.30, -1.0, 0.0], [-0.30, -1.0, 0.0]],
            [[0.20, -1.0, 0.22], [-0.20, -1.0, 0.22]],
            [[0.07, -1.0, 0.0], [-0.07, -1.0, 0.0]],
            SHINS,
        ],
        hands: None,
    },
    Stance {
        name: "a-pose",
        says: "arms halfway down, as tailors measure",
        lean: 0.0,
        limbs: [
            [[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]],
            [[1.0, -1.0, 0.1], [-1.0, -1.0, 0.1]],
            [[0.12, -1.0, 0.0], [-0.12, -1.0, 0.0]],
            SHINS,
        ],
        hands: None,
    },
    Stance {
        name: "t-pose",
        says: "arms level",
        lean: 0.0,
        limbs: [
            [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
            [[1.0, 0.0, 0.05], [-1.0, 0.0, 0.05]],
            DOWN,
            SHINS,
        ],
        hands: None,
    },
    Stance {
        name: "walk",
        says: "mid-stride, arms swinging",
        lean: 3.0,
        limbs: [
            [[0.25, -1.0, -0.45], [-0.25, -1.0, 0.35]],
            [[0.15, -1.0, -0.05], [-0.10, -0.9, 0.75]],
            [[0.03, -1.0, 0.45], [-0.03, -1.0, -0.30]],
            [[0.02, -1.0, 0.15], [-0.02, -0.8, -0.75]],
        ],
        hands: None,
    },
    Stance {
        name: "hands-on-hips",
        says: "elbows out, palms on the hips",
        lean: 0.0,
        limbs: [
            [[0.95, -1.0, -0.35], [-0.95, -1.0, -0.35]],
            [[-0.68, -0.82, 0.2], [0.68, -0.82, 0.2]],
            [[0.15, -1.0, 0.0], [-0.15, -1.0, 0.0]],
            SHINS,
        ],
        hands: Some([[0.01, -0.54, 0.82], [-0.01, -0.54, 0.82]]),
    },
    Stance {
        name: "arms-up",
        says: "both arms raised",
        lean: 0.0,
        limbs: [
            [[0.45, 1.0, 0.05], [-0.45, 1.0, 0.05]],
            [[0.20, 1.0, 0.10], [-0.20, 1.0, 0.10]],
            DOWN,
            SHINS,
        ],
        hands: None,
    },
    Stance {
        name: "lunge",
        says: "left foot far ahead, knee bent",
        lean: 8.0,
        limbs: [
            [[0.5, -1.0, -0.3], [-0.5, -1.0, 0.4]],
            [[0.3, -1.0, 0.4], [-0.3, -0.6, 0.9]],
            [[0.08, -0.55, 1.0], [-0.08, -1.0, -0.75]],
            [[0.02, -1.0, -0.05], [-0.04, -0.6, -1.0]],
        ],
        hands: None,
    },
    Stance {
        name: "sit",
        says: "as on a stool, hands over the knees",
        lean: 4.0,
        limbs: [
            [[0.30, -1.0, 0.30], [-0.30, -1.0, 0.30]],
            [[0.05, -0.45, 1.0], [-0.05, -0.45, 1.0]],
            [[0.22, -0.12, 1.0], [-0.22, -0.12, 1.0]],
            [[0.05, -1.0, 0.05], [-0.05, -1.0, 0.05]],
        ],
        hands: None,
    },
];

impl Pose {
    /// Names and descriptions of the built-in stances.
    pub fn stances() -> impl Iterator<Item = (&'static str, &'static str)> {
        STANCES.iter().map(|s| (s.name, s.says))
    }

    /// The built-in stance called `name`, on this figure.
    pub fn stance(avatar: &Avatar, figure: &Figure, name: &str) -> Result<Pose, BodyError> {
        let stance = STANCES
            .iter()
            .find(|s| s.name.eq_ignore_ascii_case(name))
            .ok_or_else(|| BodyError::UnknownStance {
                name: name.to_owned(),
                nearest: names::nearest(name, STANCES.iter().map(|s| s.name)),
            })?;
        let mut pose = Pose::rest(avatar);
        for bone in ["spine05", "spine04", "spine03", "spine02", "spine01"] {
            let lean = DQuat::from_rotation_x((stance.lean / 5.0).to_radians());
            pose.rotations[avatar.rig().bone(bone)?] = lean;
        }
        for (first, last, direction) in aims(stance) {
            pose.aim(avatar, figure, (first, last), DVec3::from_array(direction))?;
        }
        Ok(pose)
    }

    /// Turns the bone `first` by the smallest rotation that makes the limb from its head to the
    /// tail of `last` point along `direction` (any length, in the world's frame).
    ///
    /// A limb without length, or a zero direction, stays as it is.
    pub fn aim(
        &mut self,
        avatar: &Avatar,
        figure: &Figure,
        (first, last): (&str, &str),
        direction: DVec3,
    ) -> Result<(), BodyError> {
        let rig = avatar.rig();
        let (b, end) = (rig.bone(first)?, rig.bone(last)?);
        let world = world_from_rest(rig, figure, self);
        let head = world[b].transform_point3(figure.joints[b]);
        let along = (world[end].transform_point3(figure.tails[end]) - head).normalize_or_zero();
        let wanted = direction.normalize_or_zero();
        if along == DVec3::ZERO || wanted == DVec3::ZERO {
            return Ok(());
        }
        let turn = DQuat::from_rotation_arc(along, wanted);
        let parent = rig.bones[b]
            .parent
            .map_or(DQuat::IDENTITY, |p| DQuat::from_mat3(&world[p].matrix3));
        self.rotations[b] = (parent.inverse() * turn * parent * self.rotations[b]).normalize();
        Ok(())
    }
}

fn aims(stance: &Stance) -> impl Iterator<Item = Aim> {
    let limbs = [UPPER_ARM, FOREARM, THIGH, SHIN];
    let pairs = limbs.into_iter().zip(stance.limbs);
    let hands = stance.hands.map(|to| (HAND, to));
    let pairs = pairs.chain(hands);
    pairs.flat_map(|(names, to)| (0..2).map(move |s| (names[s].0, names[s].1, to[s])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    #[test]
    fn limbs_point_where_the_stance_says_on_any_shape() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for gender in [0.0, 1.0] {
            let shape = Shape::default()
                .with("gender", gender)
                .expect("a known phenotype");
            let figure = avatar.figure(&shape).expect("an adult");
            for stance in &STANCES {
                let pose = Pose::stance(&avatar, &figure, stance.name).expect("built in");
                let world = world_from_rest(avatar.rig(), &figure, &pose);
                for (first, last, to) in aims(stance) {
                    let b = avatar.rig().bone(first).expect("a bone");
                    let e = avatar.rig().bone(last).expect("a bone");
                    let head = world[b].transform_point3(figure.joints[b]);
                    let tail = world[e].transform_point3(figure.tails[e]);
                    let cos = (tail - head)
                        .normalize()
                        .dot(DVec3::from_array(to).normalize());
                    assert!(cos > 1.0 - 1e-9, "{} {first} {cos}", stance.name);
                }
            }
        }
    }

    #[test]
    fn an_unknown_stance_names_its_neighbours() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.figure(&Shape::default()).expect("an adult");
        let fault = Pose::stance(&avatar, &figure, "wlak").unwrap_err();
        assert!(fault.to_string().contains("walk"), "{fault}");
        assert!(Pose::stance(&avatar, &figure, "Walk").is_ok());
    }
}
