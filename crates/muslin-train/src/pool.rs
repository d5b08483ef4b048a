//! Poses to learn from.

use glam::{DQuat, DVec3};
use muslin_body::{Avatar, Motion, Pose};
use muslin_net::learn::Noise;

/// Poses of the motions, `rate` of them a second [1/s].
pub fn sampled(motions: &[Motion], rate: f64) -> Vec<Pose> {
    let of = |m: &Motion| m.resampled(rate.min(m.fps)).poses;
    motions.iter().flat_map(of).collect()
}

/// At most `most` poses, evenly taken.
pub fn thinned(poses: Vec<Pose>, most: usize) -> Vec<Pose> {
    let n = poses.len();
    if n <= most {
        return poses;
    }
    (0..most).map(|k| poses[k * n / most].clone()).collect()
}

/// Bones that each part of a body hangs on; what hangs on none of them is the trunk.
const LIMBS: [&str; 4] = ["clavicle.L", "clavicle.R", "upperleg01.L", "upperleg01.R"];

/// Bones that hang limbs on the trunk.
const LOOSE: [&str; 4] = [
    "upperarm01.L",
    "upperarm01.R",
    "upperleg01.L",
    "upperleg01.R",
];
/// A bone that turns less than this over all poses stays as it is [rad].
const TURNS: f64 = 0.5;
/// Deviation of the turn that is added to bones that turn widely, about each axis [rad].
const NOISE: f64 = 0.3;

/// `count` new poses, each with trunk, arms and legs of different ones, half of them mirrored.
///
/// A recording shows few of the ways in which arms, legs and trunk go together; cloth at a
/// shoulder hardly asks what the legs do. Every limb lies anywhere between two that were shown, and
/// where it hangs on the trunk it is turned a little more, so that the ways between and around them
/// are learnt as well. Limbs may then pass through the body.
pub fn mixed(avatar: &Avatar, poses: &[Pose], (count, noise): (usize, &mut Noise)) -> Vec<Pose> {
    let rig = avatar.rig();
    let limbs: Vec<usize> = LIMBS.iter().filter_map(|b| avatar.bone(b).ok()).collect();
    let of = |b: usize| limbs.iter().position(|l| rig.descends(b, *l));
    // Legs keep together, as their feet do.
    let limb: Vec<Option<usize>> = (0..rig.n_bones()).map(|b| Some(of(b)?.min(2))).collect();
    let loose: Vec<usize> = (LOOSE.iter())
        .filter_map(|b| avatar.bone(b).ok())
        .filter(|b| turns(poses, *b))
        .collect();
    let twins = twins(avatar);
    let one = |_| {
        let mut pose = poses[noise.below(poses.len())].clone();
        let ways = [0; 3].map(|_| {
            let ends = [0; 2].map(|_| &poses[noise.below(poses.len())]);
            (ends, noise.unit())
        });
        for (b, limb) in limb.iter().enumerate() {
            if let Some(k) = limb {
                let ([from, to], t) = ways[*k];
                pose.rotations[b] = from.rotations[b].slerp(to.rotations[b], t);
            }
        }
        for b in &loose {
            let turn = DVec3::from_array([0; 3].map(|_| NOISE * noise.normal()));
            pose.rotations[*b] = DQuat::from_scaled_axis(turn) * pose.rotations[*b];
        }
        if noise.below(2) == 0 {
            pose
        } else {
            mirrored(&pose, &twins)
        }
    };
    (0..count).map(one).collect()
}

/// Whether a bone turns widely.
fn turns(poses: &[Pose], b: usize) -> bool {
    let first = poses[0].rotations[b];
    poses
        .iter()
        .any(|p| p.rotations[b].angle_between(first) > TURNS)
}

/// For every bone its like on the other side; itself in the middle.
fn twins(avatar: &Avatar) -> Vec<usize> {
    let bones = &avatar.rig().bones;
    let twin = |(b, bone): (usize, &muslin_body::Bone)| {
        let other = match bone.name.rsplit_once('.') {
            Some((stem, "L")) => format!("{stem}.R"),
            Some((stem, "R")) => format!("{stem}.L"),
            _ => return b,
        };
        avatar.bone(&other).unwrap_or(b)
    };
    bones.iter().enumerate().map(twin).collect()
}

/// The pose as a mirror across the body's middle shows it.
fn mirrored(pose: &Pose, twins: &[usize]) -> Pose {
    let flip = |b: &usize| {
        let q = pose.rotations[*b];
        DQuat::from_xyzw(q.x, -q.y, -q.z, q.w)
    };
    let across = |b: &usize| pose.shifts[*b].with_x(-pose.shifts[*b].x);
    Pose {
        root: pose.root.with_x(-pose.root.x),
        rotations: twins.iter().map(flip).collect(),
        shifts: match pose.shifts.is_empty() {
            true => Vec::new(),
            false => twins.iter().map(across).collect(),
        },
        beyond: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use muslin_body::{Shape, motions};

    use super::*;

    #[test]
    fn a_mirrored_pose_mirrors_the_body_and_mixing_is_the_same_for_the_same_seed() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let walk = motions::make(&avatar, &figure, "wave", 10.0).expect("a built-in motion");
        let pose = &walk.poses[12];
        let twins = twins(&avatar);
        let other = avatar.bones(&figure, &mirrored(pose, &twins));
        for (b, m) in avatar.bones(&figure, pose).iter().enumerate() {
            let (p, q) = (
                m.transform_point3(figure.joints[b]),
                other[twins[b]].transform_point3(figure.joints[twins[b]]),
            );
            assert!(
                (p.x + q.x).abs() < 2e-3 && (p.y - q.y).abs() < 2e-3,
                "{p} {q}"
            );
        }
        let mix = |seed| mixed(&avatar, &walk.poses, (5, &mut Noise::new(seed)));
        assert!(mix(1) == mix(1) && mix(1) != mix(2));
    }
}
