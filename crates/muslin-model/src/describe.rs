//! What a network is told of a pose.
//!
//! The descriptors of Neural Cloth Simulation (Bertiche et al. 2022): for each joint the first two
//! columns of its rotation in its parent's frame, and the direction of gravity in its own. The
//! root tells gravity alone, so that the way the body faces does not matter.

use glam::{DAffine3, DVec3};
use muslin_body::{Avatar, Pose};

use crate::ModelError;

/// Reads the inputs of a network off a pose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reader {
    bones: Vec<usize>,
}

/// Numbers for the root, and for every other bone.
const ROOT: usize = 3;
const EACH: usize = 9;

/// The named bones in the avatar's rig.
pub(crate) fn found(avatar: &Avatar, names: &[String]) -> Result<Vec<usize>, ModelError> {
    let find = |name: &String| {
        let bone = avatar.bone(name);
        bone.map_err(|_| ModelError::NoBone(name.clone()))
    };
    names.iter().map(find).collect()
}

impl Reader {
    /// For the named bones of this avatar; the first is taken as the root.
    pub fn new(avatar: &Avatar, drivers: &[String]) -> Result<Self, ModelError> {
        let bones = found(avatar, drivers)?;
        Ok(Self { bones })
    }

    /// The bones in the avatar's rig.
    pub(crate) fn bones(&self) -> &[usize] {
        &self.bones
    }

    /// How many numbers describe a pose.
    pub fn n_inputs(&self) -> usize {
        Self::n_inputs_of(self.bones.len())
    }

    /// How many numbers describe a pose of `n` bones.
    pub fn n_inputs_of(n: usize) -> usize {
        if n == 0 { 0 } else { ROOT + EACH * (n - 1) }
    }

    /// Writes them; `bones` is `world_from_rest` of all of the rig.
    pub fn read(&self, pose: &Pose, bones: &[DAffine3], out: &mut [f32]) {
        let mut at = 0;
        for (k, &b) in self.bones.iter().enumerate() {
            if k > 0 {
                let local = glam::DMat3::from_quat(pose.rotations[b]);
                for column in [local.x_axis, local.y_axis] {
                    out[at..at + 3].copy_from_slice(&column.as_vec3().to_array());
                    at += 3;
                }
            }
            let down = bones[b].matrix3.transpose() * DVec3::NEG_Y;
            out[at..at + 3].copy_from_slice(&down.as_vec3().to_array());
            at += 3;
        }
    }
}
