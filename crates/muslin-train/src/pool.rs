//! Poses to learn from.

use glam::DQuat;
use muslin_body::{Avatar, Motion, Pose};
use muslin_net::learn::Noise;

/// Poses of the motions, `rate` of them a second [1/s].
pub fn sampled(motions: &[Motion], rate: f64) -> Vec<Pose> {
    let of = |m: &Motion| m.resampled(rate.min(m.fps)).poses;
    motions.iter().flat_map(of).collect()
}

/// Bones that each part of a body hangs on; what hangs on none of them is the trunk.
const LIMBS: [&str; 4] = ["clavicle.L", "clavicle.R", "upperleg01.L", "upperleg01.R"];

/// `count` new poses, each with trunk, arms and legs of different ones, half of them mirrored.
///
/// A recording shows few of the ways in which arms, legs and trunk go together; cloth at a
/// shoulder hardly asks what the legs do. Limbs may then pass through the body.
pub fn mixed(avatar: &Avatar, poses: &[Pose], (count, noise): (usize, &mut Noise)) -> Vec<Pose> {
    let rig = avatar.rig();
    let limbs: Vec<usize> = LIMBS.iter().filter_map(|b| avatar.bone(b).ok()).collect();
    let of = |b: usize| limbs.iter().position(|l| rig.descends(b, *l));
    let part: Vec<Option<usize>> = (0..rig.n_bones()).map(of).collect();
    let twins = twins(avatar);
    let one = |_| {
        let mut draw = || noise.below(poses.len());
        let (trunk, arms, legs) = (draw(), [draw(), draw()], draw());
        let mut pose = poses[trunk].clone();
        for (b, part) in part.iter().enumerate() {
            let from = match part {
                None => continue,
                Some(k @ (0 | 1)) => arms[*k],
                Some(_) => legs,
            };
            pose.rotations[b] = poses[from].rotations[b];
        }
        if noise.below(2) == 0 {
            pose
        } else {
            mirrored(&pose, &twins)
        }
    };
    (0..count).map(one).collect()
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
    Pose {
        root: pose.root.with_x(-pose.root.x),
        rotations: twins.iter().map(flip).collect(),
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
