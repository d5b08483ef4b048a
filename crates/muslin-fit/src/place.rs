//! From the camera's frame to a world with a floor, and from joint groups to all bones.

use crate::fold::Folded;
use crate::ground::Stand;
use crate::guess::{Guess, Placed};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use muslin_body::{Avatar, Pose};

/// The pose in a world whose floor carries the feet, and where the camera is in it.
///
/// The body stands over the origin and faces +z.
pub fn world(
    avatar: &Avatar,
    folded: &Folded,
    features: &[DVec3],
    guess: &Guess,
) -> (Pose, DAffine3) {
    let placed = Placed::new(folded, features, guess);
    let stand = Stand::new(folded, features, &placed);
    let up = stand.up();
    let level = DMat3::from_quat(DQuat::from_rotation_arc(up, DVec3::Y));
    let ahead = level * DMat3::from_quat(guess.turns[0]).z_axis;
    let turn = DMat3::from_rotation_y(-ahead.x.atan2(ahead.z)) * level;
    let floor = stand.floor(up);
    let hips = turn * (0.5 * (placed.markers[11] + placed.markers[12]));
    let world_from_camera = DAffine3 {
        matrix3: turn,
        translation: DVec3::new(-hips.x, floor, -hips.z),
    };
    let mut pose = Pose::rest(avatar);
    for joint in &folded.joints {
        pose.rotations[joint.bone] = guess.turns[joint.group];
    }
    let root = &folded.joints[0];
    pose.rotations[root.bone] = DQuat::from_mat3(&turn) * guess.turns[root.group];
    pose.root = world_from_camera.transform_point3(guess.root) - features[0];
    spread_twists(avatar, folded, features, &mut pose);
    (pose, world_from_camera)
}

/// Limbs twist along their length, not at one joint: half of each twist moves to the bone
/// below, and half of the hand's to the forearm. Directions stay as they are.
fn spread_twists(avatar: &Avatar, folded: &Folded, features: &[DVec3], pose: &mut Pose) {
    for side in ["L", "R"] {
        let bone = |name: &str| avatar.bone(&format!("{name}.{side}")).ok();
        let joint = |name: &str| {
            folded
                .joints
                .iter()
                .position(|j| Some(j.bone) == bone(name))
        };
        let along = |from: &str, to: &str| {
            Some((features[joint(to)?] - features[joint(from)?]).normalize_or(DVec3::Y))
        };
        if let (Some(hand), Some(half), Some(axis)) = (
            bone("wrist"),
            bone("lowerarm02"),
            along("lowerarm01", "wrist"),
        ) {
            let moved = half_twist(pose.rotations[hand], axis);
            pose.rotations[half] = moved;
            pose.rotations[hand] = moved.inverse() * pose.rotations[hand];
        }
        for [upper, lower, end] in [
            ["upperarm01", "upperarm02", "lowerarm01"],
            ["lowerarm01", "lowerarm02", "wrist"],
            ["upperleg01", "upperleg02", "lowerleg01"],
        ] {
            if let (Some(upper), Some(lower), Some(axis)) =
                (bone(upper), bone(lower), along(upper, end))
            {
                let moved = half_twist(pose.rotations[upper], axis);
                pose.rotations[upper] *= moved.inverse();
                pose.rotations[lower] = moved * pose.rotations[lower];
            }
        }
    }
}

/// Half of the part of `q` that turns about `axis` (before the rest of it).
fn half_twist(q: DQuat, axis: DVec3) -> DQuat {
    let s = DVec3::new(q.x, q.y, q.z).dot(axis);
    let angle = 2.0 * s.atan2(q.w);
    let angle = (angle + std::f64::consts::PI).rem_euclid(2.0 * std::f64::consts::PI)
        - std::f64::consts::PI;
    DQuat::from_axis_angle(axis, 0.5 * angle)
}
