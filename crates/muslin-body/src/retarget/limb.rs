//! A limb that follows: its bones point where the recorded ones point, and twist as they bend.
//!
//! Directions leave the turn about them open. It is carried on from the frame before by the
//! smallest turn, so that nothing jumps where a limb passes the opposite of its rest direction,
//! and led, slowly, to where the bend of the limb shows it, or else to where the smallest turn from
//! rest puts it.

use glam::{DQuat, DVec3};

use crate::Pose;

/// How much the foot's direction counts beside the bend of the knee.
pub const TOES: f64 = 0.4;

/// Fastest that a twist is led [rad/s].
const FASTEST: f64 = 10.0;

/// Faster than any joint turns [rad/s]: recorded angles that jump are followed at this.
const SWIFT: f64 = 60.0;
/// Frames in which a recording may still jump to where it starts.
const STARTING: usize = 4;

/// Directions of a limb's three bones, at rest and now (zero where not known), and the axis
/// of its middle joint at rest.
pub struct Limb {
    /// At rest.
    pub rest: [DVec3; 3],
    /// Now, in the world.
    pub now: [DVec3; 3],
    /// Axis of the middle joint at rest.
    pub hinge: DVec3,
    /// What else tells that axis now; zero if nothing does.
    pub hint: DVec3,
}

/// A limb's turns in the frame before.
#[derive(Clone, Copy)]
pub struct Memory {
    /// Of each bone in its parent's frame.
    last: [Option<DQuat>; 3],
    /// Length of a frame [s]; none if nothing is known of time.
    frame: Option<f64>,
    /// Frames so far.
    age: usize,
}

impl Default for Memory {
    /// Nothing was before.
    fn default() -> Self {
        Memory {
            last: [None; 3],
            frame: None,
            age: 0,
        }
    }
}

impl Memory {
    /// Nothing was before, at `fps` frames a second.
    pub fn at(fps: f64) -> Self {
        Memory {
            frame: Some(1.0 / fps.max(1.0)),
            ..Memory::default()
        }
    }

    /// The turn of bone `k` that takes `rest` to `now`, both in its parent's frame; `axis` is where
    /// `hinge` should come to lie, and how sure that is.
    fn follow(
        &mut self,
        k: usize,
        (rest, now): (DVec3, DVec3),
        (hinge, axis, seen): (DVec3, DVec3, f64),
    ) -> DQuat {
        let neutral = DQuat::from_rotation_arc(rest, now);
        let shown = seen * about(now, neutral * hinge, axis);
        let turn = match self.last[k] {
            None => DQuat::from_axis_angle(now, shown) * neutral,
            Some(last) => {
                let way = DQuat::from_rotation_arc(last * rest, now);
                let swift = self.frame.filter(|_| self.age > STARTING);
                let carried = no_faster(way, swift.map_or(f64::INFINITY, |f| SWIFT * f)) * last;
                let most = self.frame.map_or(f64::INFINITY, |f| FASTEST * f);
                // Opposite to rest, the smallest turn from there says nothing.
                let known = smooth((1.0 + rest.dot(now)) / 0.5);
                let back = known * about(now, carried * hinge, neutral * hinge);
                let lead = seen * about(now, carried * hinge, axis) + (1.0 - seen) * back;
                DQuat::from_axis_angle(now, lead.clamp(-most, most)) * carried
            }
        };
        self.last[k] = Some(turn.normalize());
        turn.normalize()
    }
}

/// Turns the three bones of a limb on a trunk.
pub fn turn_limb(
    pose: &mut Pose,
    bones: [usize; 3],
    world_from_trunk: DQuat,
    (limb, memory): (Limb, &mut Memory),
) {
    let mut parent = world_from_trunk;
    memory.age += 1;
    let bend = limb.now[0].cross(limb.now[1]) + limb.hint;
    // Fades out as the limb straightens and its axis is lost.
    let seen = smooth((bend.length() - 0.1) / 0.4);
    for k in 0..3 {
        if limb.now[k] == DVec3::ZERO || limb.rest[k] == DVec3::ZERO {
            continue;
        }
        let now = parent.inverse() * limb.now[k];
        let shown = match k {
            0 => (limb.hinge, parent.inverse() * bend, seen),
            _ => (limb.rest[k].any_orthonormal_vector(), DVec3::ZERO, 0.0),
        };
        pose.rotations[bones[k]] = memory.follow(k, (limb.rest[k], now), shown);
        parent *= pose.rotations[bones[k]];
    }
}

/// The same turn, but by no more than `most` [rad].
fn no_faster(turn: DQuat, most: f64) -> DQuat {
    let angle = turn.angle_between(DQuat::IDENTITY);
    match angle > most {
        true => DQuat::IDENTITY.slerp(turn, most / angle),
        false => turn,
    }
}

/// The angle about `line` that turns `from` into the half plane of `to`; zero if either is along it.
fn about(line: DVec3, from: DVec3, to: DVec3) -> f64 {
    from.cross(to)
        .dot(line)
        .atan2(from.reject_from(line).dot(to.reject_from(line)))
}

fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
