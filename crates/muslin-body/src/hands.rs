//! Hands at ease: the rest pose spreads the fingers, which nobody does.

use glam::{DQuat, DVec3};

use crate::{Avatar, BodyError, Figure, Pose};

/// How far the three joints of a finger curl towards the palm [degrees], index to little finger.
const CURL: [[f64; 3]; 4] = [
    [4.0, 12.0, 6.0],
    [6.0, 14.0, 8.0],
    [9.0, 16.0, 9.0],
    [12.0, 18.0, 10.0],
];
/// The same for the thumb.
const THUMB: [f64; 3] = [0.0, 6.0, 8.0];
/// Where the thumb points: along the hand, to the index finger's side, towards the palm.
const THUMB_TO: [f64; 3] = [1.0, 0.36, 0.36];
/// Share of its spread from the middle finger that a finger gives up.
const CLOSE: f64 = 0.85;

impl Pose {
    /// Curls and closes the fingers that have not been posed, by the figure's own hands.
    ///
    /// Fails on an avatar without the default rig's finger bones.
    pub fn relax_hands(&mut self, avatar: &Avatar, figure: &Figure) -> Result<(), BodyError> {
        for side in ["L", "R"] {
            let hand = Hand::of(avatar, figure, side)?;
            for (finger, joint) in (1..=5).flat_map(|f| (1..=3).map(move |j| (f, j))) {
                let b = avatar.bone(&format!("finger{finger}-{joint}.{side}"))?;
                if self.rotations[b] != DQuat::IDENTITY {
                    continue;
                }
                let along = figure.tails[b] - figure.joints[b];
                let (degrees, first) = match finger {
                    1 => (THUMB[joint - 1], hand.thumb),
                    _ => (CURL[finger - 2][joint - 1], hand.closing(along)),
                };
                let curl = turn(along.cross(hand.palm), f64::to_radians(degrees));
                let first = if joint == 1 { first } else { DQuat::IDENTITY };
                self.rotations[b] = first * curl;
            }
        }
        Ok(())
    }
}

/// How a hand lies at rest.
struct Hand {
    /// Where the palm faces.
    palm: DVec3,
    /// Where the hand points [m].
    ahead: DVec3,
    /// Lays the thumb beside the hand.
    thumb: DQuat,
}

impl Hand {
    fn of(avatar: &Avatar, figure: &Figure, side: &str) -> Result<Hand, BodyError> {
        let bone = |name: &str| avatar.bone(&format!("{name}.{side}"));
        let wrist = figure.joints[bone("wrist")?];
        let knuckle = |name: &str| bone(name).map(|b| figure.joints[b] - wrist);
        let (index, ahead) = (knuckle("finger2-1")?, knuckle("finger3-1")?);
        let little = knuckle("finger5-1")?;
        // The cross product points to the palm on the right hand only.
        let sign = if side == "R" { 1.0 } else { -1.0 };
        let palm = (sign * index.cross(little)).normalize_or_zero();
        let across = (index - little).reject_from(ahead).normalize_or_zero();
        let thumb = figure.tails[bone("finger1-3")?] - figure.joints[bone("finger1-1")?];
        let axes = [ahead.normalize_or_zero(), across, palm];
        let to = axes
            .iter()
            .zip(THUMB_TO)
            .map(|(a, k)| *a * k)
            .sum::<DVec3>();
        let ends = [thumb, to].map(|v| v.normalize_or(DVec3::Y));
        Ok(Hand {
            palm,
            ahead,
            thumb: DQuat::from_rotation_arc(ends[0], ends[1]),
        })
    }

    /// Turns a finger's first joint within the palm's plane towards where the hand points.
    fn closing(&self, along: DVec3) -> DQuat {
        let flat = |v: DVec3| v.reject_from(self.palm).normalize_or_zero();
        let [from, to] = [flat(along), flat(self.ahead)];
        let angle = from.cross(to).dot(self.palm).atan2(from.dot(to));
        turn(self.palm, CLOSE * angle)
    }
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
