//! Hands at ease: the rest pose spreads the fingers, which nobody does.

use glam::{DQuat, DVec3};

use crate::{Avatar, BodyError, Figure, Pose};

/// How far the three joints of a finger curl towards the palm [degrees], index to little finger.
const CURL: [[f64; 3]; 4] = [
    [16.0, 24.0, 14.0],
    [20.0, 28.0, 16.0],
    [24.0, 30.0, 18.0],
    [28.0, 32.0, 20.0],
];
/// The same for the thumb.
const THUMB: [f64; 3] = [10.0, 8.0, 10.0];
/// Share of its spread from the middle finger that a finger gives up.
const CLOSE: f64 = 0.7;

/// Index finger, middle finger, little finger.
const PALM: [usize; 3] = [2, 3, 5];

impl Pose {
    /// Curls and closes the fingers that have not been posed, by the figure's own hands.
    ///
    /// Fails on an avatar without the default rig's finger bones.
    pub fn relax_hands(&mut self, avatar: &Avatar, figure: &Figure) -> Result<(), BodyError> {
        for (side, sign) in [("L", -1.0), ("R", 1.0)] {
            let bone = |finger: usize, joint: usize| {
                avatar.bone(&format!("finger{finger}-{joint}.{side}"))
            };
            let wrist = figure.joints[avatar.bone(&format!("wrist.{side}"))?];
            let [index, middle, little] =
                PALM.map(|f| bone(f, 1).map(|b| figure.joints[b] - wrist));
            // Towards the palm: the cross product points there on the right hand only.
            let palm = (sign * index?.cross(little?)).normalize_or_zero();
            let ahead = middle?;
            for finger in 1..=5 {
                for joint in 1..=3 {
                    let b = bone(finger, joint)?;
                    if self.rotations[b] != DQuat::IDENTITY {
                        continue;
                    }
                    let along = figure.tails[b] - figure.joints[b];
                    let degrees = if finger == 1 {
                        THUMB[joint - 1]
                    } else {
                        CURL[finger - 2][joint - 1]
                    };
                    let curl = turn(along.cross(palm), degrees.to_radians());
                    let closes = finger > 1 && joint == 1;
                    let close = if closes {
                        closing(along, ahead, palm)
                    } else {
                        DQuat::IDENTITY
                    };
                    self.rotations[b] = close * curl;
                }
            }
        }
        Ok(())
    }
}

/// Turns a finger's first joint within the palm's plane towards where the hand points.
fn closing(along: DVec3, ahead: DVec3, palm: DVec3) -> DQuat {
    let [from, to] = [along, ahead].map(|v| v.reject_from(palm).normalize_or_zero());
    let angle = from.cross(to).dot(palm).atan2(from.dot(to));
    turn(palm, CLOSE * angle)
}

/// A turn about an axis of any length; none about a zero axis.
fn turn(axis: DVec3, angle: f64) -> DQuat {
    axis.try_normalize()
        .map_or(DQuat::IDENTITY, |a| DQuat::from_axis_angle(a, angle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    #[test]
    fn fingertips_come_closer_to_the_wrist_and_to_each_other_on_both_hands() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.figure(&Shape::default()).expect("an adult");
        let mut relaxed = Pose::rest(&avatar);
        relaxed
            .relax_hands(&avatar, &figure)
            .expect("the default rig has fingers");
        let tip = |pose: &Pose, name: &str| {
            let b = avatar.bone(name).expect("a bone");
            avatar.pose(&figure, pose).bones[b].transform_point3(figure.tails[b])
        };
        for side in ["L", "R"] {
            let wrist = figure.joints[avatar.bone(&format!("wrist.{side}")).expect("a bone")];
            let spread = |pose: &Pose| {
                let [a, b] = [2, 5].map(|f| tip(pose, &format!("finger{f}-3.{side}")));
                (a.distance(b), a.distance(wrist) + b.distance(wrist))
            };
            let (before, after) = (spread(&Pose::rest(&avatar)), spread(&relaxed));
            assert!(after.0 < 0.9 * before.0, "{side}: {before:?} {after:?}");
            assert!(after.1 < 0.95 * before.1, "{side}: {before:?} {after:?}");
        }
    }
}
