//! From a character's joints to our pose, frame after frame.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::Twin;
use crate::Pose;

/// Our pose where a character's joints are, without taking memory after the first.
///
/// Bones that a joint leads are turned as it is and have their heads where it takes them, however far joints move apart;
/// of joints that lead no bone nothing is taken.
#[derive(Clone, Debug)]
pub struct Follower {
    bones: Vec<Follows>,
    /// How our bones are turned now, and where their heads are [m].
    world: Vec<(DQuat, DVec3)>,
}

/// What moves one of our bones.
#[derive(Clone, Debug)]
struct Follows {
    parent: Option<usize>,
    /// From its parent's head to its own at rest; from the origin where there is no parent [m].
    offset: DVec3,
    joint: Option<Led>,
    /// Its turn in its parent's frame where no joint leads it.
    still: DQuat,
}

/// A bone in the frame of the joint that leads it.
#[derive(Clone, Debug)]
struct Led {
    joint: usize,
    turn: DQuat,
    head: DVec3,
}

/// Heads nearer than this to their places at rest [m] are there.
const THERE: f64 = 1e-5;

impl Follower {
    pub(super) fn new(twin: &Twin) -> Self {
        let rig = twin.avatar.rig();
        let head = |b: usize| twin.avatar.mean()[twin.avatar.head_point(b)];
        let one = |b: usize| {
            let parent = rig.bones[b].parent;
            let led = |joint: usize| {
                let inside = twin.joints[joint].inverse() * twin.bound[b];
                Led {
                    joint,
                    turn: turn(&twin.joints[joint]).inverse() * turn(&twin.bound[b]),
                    head: inside.transform_point3(head(b)),
                }
            };
            Follows {
                parent,
                offset: head(b) - parent.map_or(DVec3::ZERO, head),
                joint: twin.leads[b].map(led),
                still: twin.still(b),
            }
        };
        Self {
            bones: (0..rig.n_bones()).map(one).collect(),
            world: vec![(DQuat::IDENTITY, DVec3::ZERO); rig.n_bones()],
        }
    }

    /// The joints that lead our bones.
    pub fn leading(&self) -> impl Iterator<Item = usize> {
        self.bones
            .iter()
            .filter_map(|b| Some(b.joint.as_ref()?.joint))
    }

    /// Takes our body to where the character's joints are at `joints` (`world_from_joint`).
    ///
    /// # Panics
    /// Where there are fewer joints than the character has, or `pose` is of another skeleton.
    pub fn follow(&mut self, joints: &[DAffine3], pose: &mut Pose) {
        pose.shifts.clear();
        pose.shifts.resize(self.bones.len(), DVec3::ZERO);
        for (b, bone) in self.bones.iter().enumerate() {
            let (frame, from) =
                (bone.parent).map_or((DQuat::IDENTITY, DVec3::ZERO), |p| self.world[p]);
            let rest = from + frame * bone.offset;
            self.world[b] = match &bone.joint {
                Some(led) => {
                    let joint = &joints[led.joint];
                    (turn(joint) * led.turn, joint.transform_point3(led.head))
                }
                None => (frame * bone.still, rest),
            };
            let (now, head) = self.world[b];
            pose.rotations[b] = (frame.inverse() * now).normalize();
            let shift = frame.inverse() * (head - rest);
            match bone.parent {
                None => pose.root = shift,
                Some(_) => pose.shifts[b] = shift,
            }
        }
        if pose.shifts.iter().all(|s| s.length() < THERE) {
            pose.shifts.clear();
        }
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
