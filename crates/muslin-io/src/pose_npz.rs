//! Pose sequences as NPZ: our own layout, for motions that a program made.
//!
//! `rotations` (T,J,4) [x, y, z, w]: each bone's turn in its parent's frame, whose axes are the
//! world's when the body is at rest; `root` (T,3): the whole body's way from its rest place [m];
//! `fps`: one number; `bones` (J): names of the default rig's bones, such as `upperarm01.L`. Bones
//! that are not named stay at rest. All `float32` or `float64`.

use glam::{DQuat, DVec3, DVec4};
use muslin_body::{Avatar, Motion, Pose};

use crate::error::{Fault, IoError};
use crate::npz::{self, Array, Npz, Values};

/// The bytes of an `.npz` with a motion of this avatar. Fails on numbers that are not finite.
pub fn write_poses(avatar: &Avatar, motion: &Motion) -> Result<Vec<u8>, IoError> {
    let bones = &avatar.rig().bones;
    let (t, j) = (motion.poses.len(), bones.len());
    let rest = DQuat::IDENTITY;
    let rotations = motion
        .poses
        .iter()
        .flat_map(|p| (0..j).flat_map(move |b| p.rotations.get(b).unwrap_or(&rest).to_array()));
    let roots = motion.poses.iter().flat_map(|p| p.root.to_array());
    npz::write(&[
        (
            "rotations",
            Array::f32(&[t, j, 4], rotations.map(|x| x as f32).collect()),
        ),
        (
            "root",
            Array::f32(&[t, 3], roots.map(|x| x as f32).collect()),
        ),
        ("fps", Array::number(motion.fps)),
        (
            "bones",
            Array::text(bones.iter().map(|b| b.name.clone()).collect()),
        ),
    ])
}

/// Reads a motion of this avatar; `name` is what errors call the file.
///
/// Rotations need not have unit length, but some.
pub fn read_poses(avatar: &Avatar, name: &str, bytes: &[u8]) -> Result<Motion, IoError> {
    let npz = npz::read(name, bytes)?;
    if npz.get("rotations").is_none() && npz.get("poses").is_some() {
        let fault = Fault::new(
            "npz-poses",
            name,
            "poses of the SMPL family are not read yet",
        );
        let hint = "convert the motion to BVH, or to the arrays rotations, root, fps and bones";
        return Err(fault.hint(hint).refused());
    }
    let named = bones(avatar, &npz)?;
    let values = npz.floats("rotations", &[None, Some(named.len()), Some(4)])?;
    let n = values.len() / (4 * named.len()).max(1);
    let roots = npz.floats("root", &[Some(n), Some(3)])?;
    let fps = npz.get("fps").and_then(Array::floats);
    let fps = fps.filter(|f| f.len() == 1 && f[0] > 0.0 && f[0].is_finite());
    let fps = fps.ok_or_else(|| npz.fault("fps", "is not one positive number"))?[0];
    let mut poses = Vec::with_capacity(n);
    for i in 0..n {
        let mut pose = Pose::rest(avatar);
        pose.root = DVec3::from_slice(&roots[3 * i..]);
        for (k, &bone) in named.iter().enumerate() {
            let q = DVec4::from_slice(&values[4 * (i * named.len() + k)..]);
            let turn = q.try_normalize().filter(|q| q.is_finite());
            let turn =
                turn.ok_or_else(|| npz.fault("rotations", "holds one without a direction"))?;
            pose.rotations[bone] = DQuat::from_vec4(turn);
        }
        if !pose.root.is_finite() {
            return Err(npz.fault("root", "holds a number that is not finite"));
        }
        poses.push(pose);
    }
    match poses.is_empty() {
        true => Err(npz.fault("rotations", "has no frames")),
        false => Ok(Motion { fps, poses }),
    }
}

/// The avatar's bones that the file names, in the file's order.
fn bones(avatar: &Avatar, npz: &Npz) -> Result<Vec<usize>, IoError> {
    let Values::Text(names) = &npz.shaped("bones", &[None])?.values else {
        return Err(npz.fault("bones", "holds no names"));
    };
    let bone = |n: &String| {
        avatar
            .bone(n)
            .map_err(|e| npz.fault("bones", &format!("does not fit: {e}")))
    };
    names.iter().map(bone).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use muslin_body::{Shape, motions};

    #[test]
    fn a_motion_comes_back_to_single_precision() {
        let avatar = Avatar::embedded().expect("the embedded body");
        let figure = avatar.figure(&Shape::default()).expect("an adult");
        let motion = motions::make(&avatar, &figure, "wave", 10.0).expect("built in");
        let bytes = write_poses(&avatar, &motion).expect("finite");
        let back = read_poses(&avatar, "a.npz", &bytes).expect("our own");
        assert_eq!((back.fps, back.poses.len()), (10.0, motion.poses.len()));
        for (a, b) in back.poses.iter().zip(&motion.poses) {
            assert!(a.root.distance(b.root) < 1e-6);
            let pairs = a.rotations.iter().zip(&b.rotations);
            assert!(pairs.map(|(a, b)| a.dot(*b).abs()).all(|c| c > 1.0 - 1e-6));
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let avatar = Avatar::embedded().expect("the embedded body");
        let file = |bone: &str, q: Vec<f32>| {
            let arrays = [
                ("rotations", Array::f32(&[1, 1, 4], q)),
                ("root", Array::f32(&[1, 3], vec![0.0; 3])),
                ("fps", Array::number(30.0)),
                ("bones", Array::text(vec![bone.into()])),
            ];
            let bytes = npz::write(&arrays).expect("finite");
            read_poses(&avatar, "a.npz", &bytes).map_err(|e| e.to_string())
        };
        assert!(file("head", vec![0.0, 0.0, 0.0, 2.0]).is_ok());
        assert!(
            file("head", vec![0.0; 4])
                .expect_err("zero")
                .contains("direction")
        );
        assert!(
            file("tail", vec![0.0, 0.0, 0.0, 1.0])
                .expect_err("unknown")
                .contains("tail")
        );
        let smpl = npz::write(&[("poses", Array::f32(&[1, 3], vec![0.0; 3]))]).expect("finite");
        let error = read_poses(&avatar, "a.npz", &smpl).expect_err("SMPL");
        assert!(error.hint().contains("BVH"));
    }
}
