//! A body on strings: hips and feet have places, trunk and arms have directions.
//!
//! Lengths are told in legs (hip to ankle) and directions in the body's own frame, so that one key
//! suits every figure. Arms are told for the left side, x pointing outwards; the right is its
//! mirror image.

use glam::{DMat3, DQuat, DVec3};

use crate::retarget::{Bones, share};
use crate::{Avatar, BodyError, Figure, Part, Pose};

/// One moment of a motion.
pub struct Key {
    /// Middle of the hip joints [legs]; y above where it is when the figure stands.
    pub hips: DVec3,
    /// Where the body faces: turn about the vertical [rad].
    pub heading: f64,
    /// Lean ahead, tilt to the left, turn to the left on top of the heading [degrees].
    pub pelvis: [f64; 3],
    /// The same of the chest against the pelvis.
    pub chest: [f64; 3],
    /// The same of the head against the chest.
    pub head: [f64; 3],
    /// Upper arm and forearm, left and right, in the chest's frame; x outwards.
    pub arms: [[DVec3; 2]; 2],
    /// Left and right.
    pub legs: [Leg; 2],
}

/// What a leg does.
#[derive(Clone, Copy)]
pub enum Leg {
    /// The foot has a place; hip and knee follow.
    Foot(Foot),
    /// Thigh and shin have directions in the pelvis's frame; x outwards.
    Free([DVec3; 2]),
}

/// Where a foot is.
#[derive(Clone, Copy)]
pub struct Foot {
    /// Place of the ball of the foot when flat on the floor [legs]; y is how high it is lifted.
    pub ball: DVec3,
    /// Where the toes point: turn about the vertical [rad].
    pub heading: f64,
    /// Heel up about the ball if positive, toes up about the heel if negative [degrees].
    pub pitch: f64,
}

/// A figure with its strings.
pub struct Puppet<'a> {
    avatar: &'a Avatar,
    figure: &'a Figure,
    bones: Bones,
    /// Bones of the toes' first joints.
    toes: [Vec<usize>; 2],
    /// Heads of a leg's bones, then the ball of the foot [m].
    leg: [[DVec3; 4]; 2],
    /// Heads of an arm's bones [m].
    arm: [[DVec3; 3]; 2],
    /// Hip to ankle along the bones [m].
    length: f64,
    /// Where the figure stands [m].
    floor: f64,
    /// How far outwards an arm must point at least to hang clear of the hips: x for y = −1.
    pub clear: f64,
    /// Where the ball of a foot is at ease, outwards and ahead of the hips [legs].
    pub stance: [f64; 2],
}

/// How the feet of the rest pose, which stands with legs apart, come together.
const CLOSER: f64 = 0.8;
/// Room between a hanging forearm's bone and the hips [m]: half the arm's width and some cloth.
const ARM_ROOM: f64 = 0.1;
/// A leg's reach is used up to this share; beyond it gives way softly.
const REACH: f64 = 0.97;

impl<'a> Puppet<'a> {
    /// The figure with its strings; fails on a rig without the default bones.
    pub fn new(avatar: &'a Avatar, figure: &'a Figure) -> Result<Self, BodyError> {
        let bones = Bones::find(avatar)?;
        let head = |b: usize| figure.joints[b];
        let ball = |side: &str| avatar.bone(&format!("toe3-1.{side}")).map(head);
        let balls = [ball("L")?, ball("R")?];
        let leg = [0, 1].map(|s| {
            let [hip, knee, ankle] = bones.leg[s].map(head);
            [hip, knee, ankle, balls[s]]
        });
        let toes = [0, 1].map(|s| {
            let starts = |b: &usize| avatar.rig().bones[*b].parent == Some(bones.leg[s][2]);
            (0..avatar.rig().n_bones()).filter(starts).collect()
        });
        let length = leg[0][0].distance(leg[0][1]) + leg[0][1].distance(leg[0][2]);
        let skin = &figure.verts[avatar.part(Part::Body)];
        let mut puppet = Self {
            avatar,
            figure,
            toes,
            leg,
            arm: bones.arm.map(|a| a.map(head)),
            length,
            floor: lowest(skin),
            clear: 0.0,
            stance: [
                CLOSER * leg[0][3].x / length,
                (leg[0][3].z - leg[0][0].z) / length,
            ],
            bones,
        };
        puppet.clear = puppet.clearance();
        Ok(puppet)
    }

    /// The pose of a key, planted: the lowest point of the skin is as high as the lower foot is
    /// lifted, or on the floor if the legs are free.
    pub fn pose(&self, key: &Key) -> Result<Pose, BodyError> {
        let mut pose = Pose::rest(self.avatar);
        let pelvis = DQuat::from_rotation_y(key.heading) * turned(key.pelvis);
        pose.rotations[0] = pelvis;
        share(&mut pose, &self.bones.spine, turned(key.chest));
        share(&mut pose, &self.bones.neck, turned(key.head));
        let rest_hips = 0.5 * (self.leg[0][0] + self.leg[1][0]);
        let hips = self.length * key.hips + rest_hips.with_x(0.0).with_z(0.0);
        let root = self.figure.joints[0];
        pose.root = hips - root - pelvis * (rest_hips - root);
        for side in 0..2 {
            self.arm(&mut pose, side, key.arms[side]);
            self.leg(&mut pose, side, (key.legs[side], hips, pelvis));
        }
        pose.relax_hands(self.avatar, self.figure)?;
        pose.root.y += self.floor + self.length * lift(key) - self.lowest(&pose);
        Ok(pose)
    }

    /// The skin of a pose [m].
    pub fn skin(&self, pose: &Pose) -> Vec<DVec3> {
        let mut verts = self.avatar.pose(self.figure, pose).verts;
        verts.truncate(self.avatar.part(Part::Body).end);
        verts
    }

    fn lowest(&self, pose: &Pose) -> f64 {
        lowest(&self.skin(pose))
    }

    fn arm(&self, pose: &mut Pose, side: usize, [upper, fore]: [DVec3; 2]) {
        let [a, b, c] = self.arm[side];
        let [u, f] = [b - a, c - b].map(DVec3::normalize);
        let upper_turn = DQuat::from_rotation_arc(u, outward(upper, side));
        let fore_turn = DQuat::from_rotation_arc(upper_turn * f, outward(fore, side)) * upper_turn;
        let [bone, elbow, _] = self.bones.arm[side];
        pose.rotations[bone] = upper_turn;
        pose.rotations[elbow] = upper_turn.inverse() * fore_turn;
        self.bones.raise(pose, side, u);
    }

    fn leg(&self, pose: &mut Pose, side: usize, (leg, hips, pelvis): (Leg, DVec3, DQuat)) {
        let [hip, knee, ankle, ball] = self.leg[side];
        let rest_hips = 0.5 * (self.leg[0][0] + self.leg[1][0]);
        let rest = [knee - hip, ankle - knee].map(DVec3::normalize);
        let (across, dirs, foot) = match leg {
            Leg::Free(dirs) => {
                let dirs = dirs.map(|d| pelvis * outward(d, side));
                (pelvis * DVec3::X, dirs, None)
            }
            Leg::Foot(foot) => {
                let turn = DQuat::from_rotation_y(foot.heading);
                // The knee follows the foot, but not all the way where the pelvis faces elsewhere.
                let across = turn * DVec3::X + pelvis * DVec3::X;
                let from = hips + pelvis * (hip - rest_hips);
                let to = self.ankle(foot, [ankle, ball]);
                let bones = [hip.distance(knee), knee.distance(ankle)];
                (across, bent(to - from, across, bones), Some(foot))
            }
        };
        let [thigh, shin] = [0, 1].map(|k| {
            DQuat::from_mat3(&(frame(dirs[k], across) * frame(rest[k], DVec3::X).transpose()))
        });
        let [b0, b1, b2] = self.bones.leg[side];
        pose.rotations[b0] = pelvis.inverse() * thigh;
        pose.rotations[b1] = thigh.inverse() * shin;
        if let Some(foot) = foot {
            let pitch = foot.pitch.to_radians();
            let world = DQuat::from_rotation_y(foot.heading) * DQuat::from_rotation_x(pitch);
            pose.rotations[b2] = shin.inverse() * world;
            let flat = DQuat::from_rotation_x(-pitch.max(0.0));
            self.toes[side]
                .iter()
                .for_each(|&b| pose.rotations[b] = flat);
        }
    }

    /// Where the ankle of a placed foot is [m].
    fn ankle(&self, foot: Foot, [ankle, ball]: [DVec3; 2]) -> DVec3 {
        let turn = DQuat::from_rotation_y(foot.heading);
        let pitch = DQuat::from_rotation_x(foot.pitch.to_radians());
        // The heel touches the floor about a third of the way from ankle to ball behind the ankle.
        let heel = (ankle - 0.35 * (ball - ankle)).with_y(self.floor);
        let pivot = if foot.pitch >= 0.0 { ball } else { heel };
        let place = self.length * foot.ball + DVec3::new(0.0, ball.y, 0.0);
        place + turn * (pivot - ball + pitch * (ankle - pivot))
    }

    /// How far outwards hanging arms must point to pass the hips and thighs.
    fn clearance(&self) -> f64 {
        let [shoulder, elbow, wrist] = self.arm[0];
        let reach = shoulder.distance(elbow) + elbow.distance(wrist);
        let rig = self.avatar.rig();
        let body = self.avatar.part(Part::Body);
        let is_arm: Vec<bool> = (0..rig.n_bones())
            .map(|b| {
                self.bones
                    .arm
                    .iter()
                    .any(|arm| rig.descends(b, rig.bones[arm[0]].parent.unwrap_or(arm[0])))
            })
            .collect();
        let span = shoulder.y - 1.25 * reach..shoulder.y - 0.45 * reach;
        let wide = |(v, row): (&DVec3, &[(u32, f64)])| {
            let on_arm: f64 = row
                .iter()
                .filter(|w| is_arm[w.0 as usize])
                .map(|w| w.1)
                .sum();
            (on_arm < 0.2 && span.contains(&v.y))
                .then(|| (v.x.abs() + ARM_ROOM - shoulder.x) / (shoulder.y - v.y))
        };
        let rows = self.figure.verts[body].iter().zip(rig.weights.rows());
        rows.filter_map(wide).fold(0.12, f64::max)
    }
}

/// Ahead, then to the left, then about the vertical [degrees].
fn turned([lean, tilt, turn]: [f64; 3]) -> DQuat {
    DQuat::from_rotation_y(turn.to_radians())
        * DQuat::from_rotation_z(-tilt.to_radians())
        * DQuat::from_rotation_x(lean.to_radians())
}

/// A unit direction whose x points away from the body on this side.
fn outward(d: DVec3, side: usize) -> DVec3 {
    let mirror = if side == 0 { 1.0 } else { -1.0 };
    DVec3::new(mirror * d.x, d.y, d.z).normalize()
}

/// Axes with y against `along` and x as near to `across` as can be.
fn frame(along: DVec3, across: DVec3) -> DMat3 {
    let y = -along;
    let x = (across - y * across.dot(y)).normalize();
    DMat3::from_cols(x, y, x.cross(y))
}

/// Directions of thigh and shin that reach from hip to ankle, the knee ahead.
fn bent(way: DVec3, across: DVec3, [a, b]: [f64; 2]) -> [DVec3; 2] {
    let down = way.normalize();
    let most = a + b;
    let c = most * soft(way.length() / most);
    let x = (across - down * across.dot(down)).normalize();
    let ahead = down.cross(x);
    let cos = ((a * a + c * c - b * b) / (2.0 * a * c)).clamp(-1.0, 1.0);
    let knee = a * (down * cos + ahead * (1.0 - cos * cos).sqrt());
    [knee.normalize(), (down * c - knee).normalize()]
}

/// `x` as far as [`REACH`], then ever slower towards one: no leg is torn straight.
fn soft(x: f64) -> f64 {
    let room = 0.999 - REACH;
    match x > REACH {
        true => REACH + room * (1.0 - (-(x - REACH) / room).exp()),
        false => x,
    }
}

/// How high the lower foot is lifted [legs].
fn lift(key: &Key) -> f64 {
    let height = |leg: &Leg| match leg {
        Leg::Foot(foot) => foot.ball.y,
        Leg::Free(_) => 0.0,
    };
    height(&key.legs[0]).min(height(&key.legs[1]))
}

fn lowest(verts: &[DVec3]) -> f64 {
    verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min)
}
