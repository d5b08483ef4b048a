//! From the camera's frame to a world with a floor, and from joint groups to all bones.

use crate::fold::{Folded, N_MARKERS};
use crate::guess::{Guess, Placed};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use muslin_body::{Avatar, Pose};

/// A camera is not expected to be tilted more than this [rad].
const MOST_TILT: f64 = 0.35;

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

/// The pose in a world whose floor carries the feet, and where the camera is in it.
///
/// The body stands over the origin and faces +z. Which way is down is not in the picture: the
/// camera is taken as level, tilted up or down so far that the body stands in balance.
pub fn world(
    avatar: &Avatar,
    folded: &Folded,
    features: &[DVec3],
    guess: &Guess,
) -> (Pose, DAffine3) {
    let placed = Placed::new(folded, features, guess);
    let level = DMat3::from_rotation_x(tilt(&placed.markers));
    let ahead = level * DMat3::from_quat(guess.turns[0]).z_axis;
    let turn = DMat3::from_rotation_y(-ahead.x.atan2(ahead.z)) * level;
    let down = turn.transpose() * DVec3::NEG_Y;
    let floor = lowest(folded, features, &placed, down);
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

/// The camera's tilt that brings the middle of mass over the feet, about x [rad].
///
/// Zero for somebody who does not stand.
fn tilt(markers: &[DVec3]) -> f64 {
    let middle = |m: [usize; 2]| 0.5 * (markers[m[0]] + markers[m[1]]);
    let mass = MASSES.iter().map(|&(m, w)| w * middle(m)).sum::<DVec3>();
    let foot = |f: &[usize; 3]| f.iter().map(|&k| markers[k]).sum::<DVec3>() / 3.0;
    let feet = FEET.each_ref().map(foot);
    // A raised foot carries nothing.
    let lift = ((feet[0].y - feet[1].y) / 0.25).clamp(-1.0, 1.0);
    let up = mass - feet[0].lerp(feet[1], 0.5 + 0.5 * lift);
    if up.y < 0.5 {
        return 0.0;
    }
    (-up.z.atan2(up.y)).clamp(-MOST_TILT, MOST_TILT)
}

/// How far the lowest point lies along `down` [m]: soles, else whatever touches the floor.
fn lowest(folded: &Folded, features: &[DVec3], placed: &Placed, down: DVec3) -> f64 {
    let rest = Placed::new(folded, features, &rest_guess(folded, features)).markers;
    let sole = features[features.len() - 1].y;
    let mut lowest = f64::NEG_INFINITY;
    for (side, foot) in FEET.iter().enumerate() {
        let name = ["ankle.L", "ankle.R"][side];
        let Some(j) = folded
            .joints
            .iter()
            .position(|j| folded.groups[j.group] == name)
        else {
            continue;
        };
        for &k in foot {
            let below = placed.turns[j] * DVec3::new(0.0, sole - rest[k].y, 0.0);
            lowest = lowest.max(down.dot(placed.markers[k] + below));
        }
    }
    // Knees, hips and hands have some flesh below them.
    let others = (0..17).map(|k| down.dot(placed.markers[k]) + 0.05);
    debug_assert!(placed.markers.len() == N_MARKERS);
    others.fold(lowest, f64::max)
}

fn rest_guess(folded: &Folded, features: &[DVec3]) -> Guess {
    Guess {
        root: features[0],
        turns: vec![DQuat::IDENTITY; folded.groups.len()],
        log_focal: 0.0,
        origin: DVec3::ZERO,
        log_scale: 0.0,
        shape: Vec::new(),
    }
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
