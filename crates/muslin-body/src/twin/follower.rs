//! From a character's joints to our pose, frame after frame.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::Twin;
use crate::Pose;

/// Our pose where a character's joints are, without taking memory.
///
/// Only turns are taken, and the place of the hips: joints that move apart are not followed.
#[derive(Clone, Debug)]
pub struct Follower {
    bones: Vec<Follows>,
    root: Option<Root>,
    /// How our bones are turned now.
    world: Vec<DQuat>,
}

/// How one of our bones is turned.
#[derive(Clone, Debug)]
struct Follows {
    parent: Option<usize>,
    /// The joint that turns it, and our bone in the frame of that joint.
    joint: Option<(usize, DQuat)>,
    /// Its turn in its parent's frame where no joint does.
    still: DQuat,
}

/// What moves the hips.
#[derive(Clone, Debug)]
struct Root {
    joint: usize,
    /// Where the hips are in its frame, and at rest [m].
    inside: DVec3,
    rest: DVec3,
}

impl Follower {
    pub(super) fn new(twin: &Twin) -> Self {
        let rig = twin.avatar.rig();
        let mut by: Vec<Option<usize>> = vec![None; rig.n_bones()];
        for (j, b) in twin.follows.iter().enumerate() {
            let is_first = twin.parents[j].is_none_or(|p| twin.follows[p] != *b);
            if let (Some(b), true) = (b, is_first) {
                by[*b].get_or_insert(j);
            }
        }
        let one = |b: usize| Follows {
            parent: rig.bones[b].parent,
            joint: by[b].map(|j| (j, turn(&twin.joints[j]).inverse() * turn(&twin.bound[b]))),
            still: twin.still(b),
        };
        let rest = twin.avatar.mean()[twin.avatar.head_point(0)];
        let root = by[0].map(|joint| Root {
            joint,
            inside: (twin.joints[joint].inverse() * twin.bound[0]).transform_point3(rest),
            rest,
        });
        Self {
            bones: (0..rig.n_bones()).map(one).collect(),
            root,
            world: vec![DQuat::IDENTITY; rig.n_bones()],
        }
    }

    /// Takes our body to where the character's joints are at `joints` (`world_from_joint`).
    ///
    /// # Panics
    /// Where there are fewer joints than the character has, or `pose` is of another skeleton.
    pub fn follow(&mut self, joints: &[DAffine3], pose: &mut Pose) {
        for (b, bone) in self.bones.iter().enumerate() {
            let above = bone.parent.map_or(DQuat::IDENTITY, |p| self.world[p]);
            self.world[b] = match bone.joint {
                Some((j, inside)) => turn(&joints[j]) * inside,
                None => above * bone.still,
            };
            pose.rotations[b] = (above.inverse() * self.world[b]).normalize();
        }
        pose.root = self.root.as_ref().map_or(DVec3::ZERO, |root| {
            joints[root.joint].transform_point3(root.inside) - root.rest
        });
    }
}

/// How a frame is turned, whatever its scale.
fn turn(a: &DAffine3) -> DQuat {
    let m = a.matrix3;
    let unit = DMat3::from_cols(
        m.x_axis.normalize_or_zero(),
        m.y_axis.normalize_or_zero(),
        m.z_axis.normalize_or_zero(),
    );
    DQuat::from_mat3(&unit).normalize()
}
