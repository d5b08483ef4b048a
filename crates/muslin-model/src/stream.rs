//! What an encoder is told of poses, one after the other.
//!
//! [`Encoder::Plain`] and the still part of [`Encoder::Ncs`] read the descriptors of [`Reader`].
//! [`Encoder::Pbns`] and [`Encoder::Snug`] read each bone's turn as axis times angle [rad], SNUG
//! with the body's shape before and the root's velocity [m/s] after them. The moving part of
//! [`Encoder::Ncs`] reads of each joint the rates of its descriptors [1/s] and its acceleration
//! [m/s²] in its own frame.
//!
//! The papers tell the root's turn as it is. Here nothing depends on the way the body faces: the
//! heading is taken out of the root's turn and of its velocity, and the rate of the root's turn is
//! told in its own frame.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use muslin_body::{Avatar, Pose};

use crate::player::STEP;
use crate::{Encoder, ModelError, Ncs, Reader};

/// Reads the inputs of an encoder off poses in time.
#[derive(Clone, Debug)]
pub struct Stream {
    reader: Reader,
    kind: Kind,
    /// Seconds from pose to pose.
    step: f64,
    /// Whether the next pose is the first.
    is_first: bool,
}

#[derive(Clone, Debug)]
enum Kind {
    Joints,
    Turns,
    Body { numbers: Vec<f32>, root: DVec3 },
    Motion(Motion),
}

/// What is remembered of the poses before.
#[derive(Clone, Debug)]
struct Motion {
    /// Joints on the body at rest [m].
    joints: Vec<DVec3>,
    /// Descriptors of the pose before.
    still: Vec<f32>,
    /// Turn of the root in the pose before.
    root: DMat3,
    /// Where each joint was, and one pose before [m].
    places: Vec<[DVec3; 2]>,
}

impl Stream {
    /// For the named bones of this avatar; the first is taken as the root. A step lasts 1/30 s
    /// until [`Stream::begin`] says otherwise.
    pub fn new(encoder: &Encoder, drivers: &[String], avatar: &Avatar) -> Result<Self, ModelError> {
        let kind = match encoder {
            Encoder::Plain(_) => Kind::Joints,
            Encoder::Pbns(_) => Kind::Turns,
            Encoder::Snug(s) => Kind::Body {
                numbers: s.body.clone(),
                root: DVec3::ZERO,
            },
            Encoder::Ncs(n) => Kind::Motion(Motion {
                joints: (n.joints.iter())
                    .map(|p| DVec3::from_array(p.map(f64::from)))
                    .collect(),
                still: vec![0.0; Reader::n_inputs_of(drivers.len())],
                root: DMat3::IDENTITY,
                places: vec![[DVec3::ZERO; 2]; drivers.len()],
            }),
        };
        Ok(Self {
            reader: Reader::new(avatar, drivers)?,
            kind,
            step: STEP,
            is_first: true,
        })
    }

    /// Starts anew: the next pose is the first, and the body came to it without motion. `step` is
    /// the time from pose to pose [s].
    pub fn begin(&mut self, step: f64) {
        self.step = step;
        self.is_first = true;
    }

    /// Writes what the encoder is told of the next pose; `bones` is `world_from_rest` of all of the
    /// rig.
    pub fn read(&mut self, pose: &Pose, bones: &[DAffine3], out: &mut [f32]) {
        let (rig, first) = (self.reader.bones(), self.is_first);
        match &mut self.kind {
            Kind::Joints => self.reader.read(pose, bones, out),
            Kind::Turns => turns(rig, pose, out),
            Kind::Body { numbers, root } => {
                let (told, rest) = out.split_at_mut(numbers.len());
                let (turned, speed) = rest.split_at_mut(3 * rig.len());
                told.copy_from_slice(numbers);
                turns(rig, pose, turned);
                let before = if first { pose.root } else { *root };
                let ahead = heading(pose.rotations[rig[0]]).inverse();
                let velocity = ahead * ((pose.root - before) / self.step);
                speed.copy_from_slice(&velocity.as_vec3().to_array());
                *root = pose.root;
            }
            Kind::Motion(motion) => {
                let (still, moving) = out.split_at_mut(motion.still.len());
                self.reader.read(pose, bones, still);
                motion.read((rig, bones), (still, self.step, first), moving);
            }
        }
        self.is_first = false;
    }
}

impl Motion {
    /// Writes the motion of every joint, and remembers.
    fn read(
        &mut self,
        (rig, bones): (&[usize], &[DAffine3]),
        (still, step, first): (&[f32], f64, bool),
        out: &mut [f32],
    ) {
        let root = bones[rig[0]].matrix3;
        if first {
            self.still.copy_from_slice(still);
            self.root = root;
        }
        let rate = |i: usize| ((f64::from(still[i]) - f64::from(self.still[i])) / step) as f32;
        let turned = root.transpose() * (root - self.root);
        for (j, out) in out.chunks_exact_mut(Ncs::MOVING).enumerate() {
            let bone = &bones[rig[j]];
            // The root tells gravity alone, the others their turn before it.
            if j == 0 {
                for (k, column) in [turned.x_axis, turned.y_axis].into_iter().enumerate() {
                    let rate = (column / step).as_vec3().to_array();
                    out[3 * k..3 * k + 3].copy_from_slice(&rate);
                }
                (0..3).for_each(|k| out[6 + k] = rate(k));
            } else {
                (0..9).for_each(|k| out[k] = rate(Reader::n_inputs_of(j) + k));
            }
            let here = bone.transform_point3(self.joints[j]);
            let [before, first_of] = match first {
                true => [here; 2],
                false => self.places[j],
            };
            let change = (here - before) - (before - first_of);
            let own = bone.matrix3.transpose() * (change / (step * step));
            out[9..].copy_from_slice(&own.as_vec3().to_array());
            self.places[j] = [here, before];
        }
        self.still.copy_from_slice(still);
        self.root = root;
    }
}

/// Axis times angle of every bone [rad], the shorter way round; of the root without its heading.
fn turns(rig: &[usize], pose: &Pose, out: &mut [f32]) {
    for (k, (&b, out)) in rig.iter().zip(out.chunks_exact_mut(3)).enumerate() {
        let own = pose.rotations[b];
        let turn = match k {
            0 => heading(own).inverse() * own,
            _ => own,
        };
        let turn = if turn.w < 0.0 { -turn } else { turn };
        out.copy_from_slice(&turn.to_scaled_axis().as_vec3().to_array());
    }
}

/// The part of a turn about the vertical; none where the body hangs head down.
fn heading(turn: DQuat) -> DQuat {
    let about = DQuat::from_xyzw(0.0, turn.y, 0.0, turn.w);
    match about.length_squared() > 1e-12 {
        true => about.normalize(),
        false => DQuat::IDENTITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_its_heading_and_then_a_tilt_without_one() {
        let tilt = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_z(-0.3);
        let without = heading(tilt).inverse() * tilt;
        for yaw in [-2.9, 0.4, 3.1] {
            let turn = DQuat::from_rotation_y(yaw) * tilt;
            let rest = heading(turn).inverse() * turn;
            assert!(rest.dot(without).abs() > 1.0 - 1e-12, "{yaw}");
        }
        let head_down = DQuat::from_rotation_z(std::f64::consts::PI);
        assert!(heading(head_down).is_normalized());
    }
}
