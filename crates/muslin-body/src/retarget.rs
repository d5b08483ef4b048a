//! Motion in: somebody else's skeleton moves our body.
//!
//! Recordings disagree about rest poses (T, A, or all bones along one axis), joint names and
//! units, so only what they agree on is used: where the joints are. Hips and shoulders turn
//! the trunk, and every limb bone points where the recorded one points. Twist about a limb is
//! taken from the plane in which knee or elbow bends. Where arms are raised the shoulder girdle takes
//! its part, as in living people. Feet are as flat as ours where they stand,
//! toes do not dip into the floor, and a floor that slopes is levelled.

mod ground;
mod limb;
mod tread;

use std::f64::consts::PI;

use crate::{Avatar, BodyError, Figure, Motion, Pose};
use glam::{DMat3, DQuat, DVec3};
use ground::Ground;
use limb::{Limb, TOES, turn_limb};

pub(crate) use limb::Memory;
use tread::Soles;

/// A tree of named joints. Parents come before their children.
#[derive(Debug, Clone, Default)]
pub struct Skeleton {
    /// One name per joint, as in the file.
    pub names: Vec<String>,
    /// The joint that each joint hangs from; roots have none.
    pub parents: Vec<Option<usize>>,
    /// Place in the parent's frame at rest.
    pub offsets: Vec<DVec3>,
    /// Where the bone of a last joint ends, in its frame.
    pub ends: Vec<Option<DVec3>>,
}

/// One moment: a place and a rotation per joint, in its parent's frame.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// In the file's unit.
    pub translations: Vec<DVec3>,
    /// `parent_from_joint`.
    pub rotations: Vec<DQuat>,
}

/// A skeleton in motion, as recorded: its own names, unit and rest pose.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Who moves.
    pub skeleton: Skeleton,
    /// Frames a second [1/s].
    pub fps: f64,
    /// In order of time.
    pub frames: Vec<Frame>,
}

/// Our body in the stance of `recording`'s frame number `frame`.
///
/// The size is taken from the legs. The body starts over the origin, on the floor where the
/// recording's feet stand, or else come lowest, and faces where the recording faces. A frame past the end
/// is the last one. Fails where arms or legs cannot be found by their names.
pub fn retarget(
    avatar: &Avatar,
    figure: &Figure,
    recording: &Recording,
    frame: usize,
) -> Result<Pose, BodyError> {
    let actor = Actor::new(recording)?;
    let target = Target::new(avatar, figure)?;
    let stance = actor.on_feet(frame, &target.rest);
    let hips = target.hips(&actor, &stance);
    let pose = target.pose(&stance, hips, &mut [Memory::default(); 4]);
    Ok(Soles::new(avatar, figure)?.lifted(pose))
}

/// Our body in all stances of `recording`; see [`retarget`].
///
/// Limbs go on from frame to frame: what the recording's joints leave open, the twist about a
/// limb, never jumps but follows at ten radians a second at most; a recorded limb that jumps itself
/// is followed at sixty.
pub fn retarget_all(
    avatar: &Avatar,
    figure: &Figure,
    recording: &Recording,
) -> Result<Motion, BodyError> {
    let actor = Actor::new(recording)?;
    let target = Target::new(avatar, figure)?;
    let soles = Soles::new(avatar, figure)?;
    let mut limbs = [Memory::at(recording.fps); 4];
    let poses = (0..recording.frames.len()).map(|f| {
        let stance = actor.on_feet(f, &target.rest);
        soles.lifted(target.pose(&stance, target.hips(&actor, &stance), &mut limbs))
    });
    Ok(Motion {
        fps: recording.fps,
        poses: poses.collect(),
    })
}

/// Where the parts of a body are. Sides: left, right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stance {
    pub leg: [[DVec3; 3]; 2],
    pub toe: [Option<DVec3>; 2],
    pub arm: [[DVec3; 3]; 2],
    pub hand: [Option<DVec3>; 2],
    pub neck: Option<DVec3>,
    pub head: Option<DVec3>,
}

impl Stance {
    pub fn map(&self, f: impl Fn(DVec3) -> DVec3) -> Stance {
        Stance {
            leg: self.leg.map(|l| l.map(&f)),
            toe: self.toe.map(|t| t.map(&f)),
            arm: self.arm.map(|a| a.map(&f)),
            hand: self.hand.map(|h| h.map(&f)),
            neck: self.neck.map(&f),
            head: self.head.map(&f),
        }
    }

    pub fn hips(&self) -> DVec3 {
        0.5 * (self.leg[0][0] + self.leg[1][0])
    }

    fn shoulders(&self) -> DVec3 {
        0.5 * (self.arm[0][0] + self.arm[1][0])
    }

    fn leg_length(&self) -> f64 {
        let length = |l: &[DVec3; 3]| l[0].distance(l[1]) + l[1].distance(l[2]);
        0.5 * (length(&self.leg[0]) + length(&self.leg[1]))
    }

    /// How far a foot points up [rad]; none where toes are not known.
    fn foot_up(&self, side: usize) -> Option<f64> {
        let foot = (self.toe[side]? - self.leg[side][2]).try_normalize()?;
        Some(foot.y.clamp(-1.0, 1.0).asin())
    }

    fn lowest_ankle(&self) -> f64 {
        self.leg[0][2].y.min(self.leg[1][2].y)
    }

    /// `world_from_pelvis` and `world_from_chest`: x to the body's left, y along the trunk.
    fn trunk(&self) -> [DMat3; 2] {
        let up = self.shoulders() - self.hips();
        let across = |side: [[DVec3; 3]; 2]| side[0][0] - side[1][0];
        [across(self.leg), across(self.arm)].map(|x| {
            let y = up.normalize_or(DVec3::Y);
            let z = x.cross(y).normalize_or(y.any_orthonormal_vector());
            DMat3::from_cols(y.cross(z), y, z)
        })
    }
}

/// How many moments of a recording tell where its floor is, at most, and how often feet are looked at to see
/// whether they move [1/s].
const MOMENTS: usize = 1000;
const LOOKS_AHEAD: f64 = 30.0;

/// A recording whose joints are understood.
struct Actor<'a> {
    recording: &'a Recording,
    skeleton: Skeleton,
    roles: Roles,
    z_up: bool,
    ground: Ground,
    start: DVec3,
}

impl<'a> Actor<'a> {
    fn new(recording: &'a Recording) -> Result<Self, BodyError> {
        let mut roles = Roles::find(&recording.skeleton)?;
        let skeleton = with_toes(&recording.skeleton, &mut roles);
        let z_up = stands_along_z(&skeleton, &roles);
        let mut actor = Actor {
            recording,
            skeleton,
            roles,
            z_up,
            ground: Ground::default(),
            start: DVec3::ZERO,
        };
        actor.ground = Ground::new(&actor.seen());
        actor.start = actor.stance(0).hips();
        Ok(actor)
    }

    /// Moments all along the recording, and how fast feet move in them.
    fn seen(&self) -> Vec<(Stance, [f64; 2])> {
        let n = self.recording.frames.len();
        let fps = self.recording.fps.max(1.0);
        let ahead = (fps / LOOKS_AHEAD).round().max(1.0) as usize;
        let look = |f: usize| {
            let now = self.stance(f);
            if f + ahead >= n {
                return (now, [f64::INFINITY; 2]);
            }
            let then = self.stance(f + ahead);
            let speeds = [0, 1].map(|side| {
                let ankle = now.leg[side][2].distance(then.leg[side][2]);
                let toes = now.toe[side].zip(then.toe[side]);
                let toe = toes.map_or(0.0, |(a, b)| a.distance(b));
                ankle.max(toe) * fps / ahead as f64
            });
            (now, speeds)
        };
        (0..n).step_by(1 + n / MOMENTS).map(look).collect()
    }

    /// The stance on feet as flat as those of `rest`.
    fn on_feet(&self, frame: usize, rest: &Stance) -> Stance {
        self.ground.flattened(&self.stance(frame), rest)
    }

    fn stance(&self, frame: usize) -> Stance {
        let skeleton = &self.skeleton;
        let rest = Frame {
            translations: skeleton.offsets.clone(),
            rotations: vec![DQuat::IDENTITY; skeleton.names.len()],
        };
        let last = self.recording.frames.len().saturating_sub(1);
        let moment = self.recording.frames.get(frame.min(last)).unwrap_or(&rest);
        let stance = self.roles.stance(&world(skeleton, moment));
        match self.z_up {
            true => stance.map(|p| DVec3::new(p.x, p.z, -p.y)),
            false => stance,
        }
    }
}

/// Length of a foot whose end is not told [shins].
const FOOT_LENGTH: f64 = 0.3;

/// The skeleton with feet that point somewhere: where all bones lie along one axis of their own, and a foot
/// has no length, its end is on that axis.
fn with_toes(skeleton: &Skeleton, roles: &mut Roles) -> Skeleton {
    let mut out = skeleton.clone();
    for side in 0..2 {
        let [_, knee, ankle] = roles.leg[side];
        let shin = skeleton.offsets[ankle];
        let along = |j: usize| skeleton.offsets[j].angle_between(shin) < 0.1;
        let (Spot::Head(elbow) | Spot::End(elbow)) = roles.arm[side][1];
        if roles.toe[side].is_none() && along(knee) && along(elbow) {
            out.ends[ankle] = Some(FOOT_LENGTH * shin);
            roles.toe[side] = Some(Spot::End(ankle));
        }
    }
    out
}

/// Heads and ends of all joints in the world; a joint without an end ends at its head.
fn world(skeleton: &Skeleton, frame: &Frame) -> Vec<[DVec3; 2]> {
    let mut turned: Vec<DQuat> = Vec::new();
    let mut points: Vec<[DVec3; 2]> = Vec::new();
    for (j, parent) in skeleton.parents.iter().enumerate() {
        let (base, turn) = match *parent {
            Some(p) => (points[p][0], turned[p]),
            None => (DVec3::ZERO, DQuat::IDENTITY),
        };
        let (head, turn) = (
            base + turn * frame.translations[j],
            turn * frame.rotations[j],
        );
        points.push([head, head + turn * skeleton.ends[j].unwrap_or(DVec3::ZERO)]);
        turned.push(turn);
    }
    points
}

/// Whether the legs of the rest pose hang along −z: then z is up, and the body faces −y.
fn stands_along_z(skeleton: &Skeleton, roles: &Roles) -> bool {
    let down = |j: usize| skeleton.offsets[j].normalize_or_zero().dot(DVec3::NEG_Z) > 0.85;
    roles.leg.iter().all(|leg| down(leg[1]) && down(leg[2]))
}

/// A joint's head, or the end of its bone.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Spot {
    Head(usize),
    End(usize),
}

/// Which joint plays which part.
pub(crate) struct Roles {
    pub leg: [[usize; 3]; 2],
    pub toe: [Option<Spot>; 2],
    pub arm: [[Spot; 3]; 2],
    pub hand: [Option<Spot>; 2],
    /// The joint called hand that hangs from one called wrist, if so.
    pub palm: [Option<usize>; 2],
    pub neck: Option<usize>,
    pub head: Option<Spot>,
}

/// Names of a part, the surest first: a `shoulder` is a collar bone beside an `arm`.
const THIGH: &[&str] = &["upperleg01", "upperleg", "upleg", "thigh", "hip"];
const SHIN: &[&str] = &["lowerleg01", "lowerleg", "leg", "shin", "calf", "knee"];
const FOOT: &[&str] = &["foot", "ankle"];
const TOE: &[&str] = &["toe31", "toebase", "toes", "toe", "ball"];
const UPPER_ARM: &[&str] = &[
    "upperarm01",
    "upperarm",
    "arm",
    "shldr",
    "humerus",
    "shoulder",
];
const FOREARM: &[&str] = &["lowerarm01", "lowerarm", "forearm", "elbow"];
const WRIST: &[&str] = &["wrist", "hand"];
const NECK: &[&str] = &["neck01", "neck"];
const HEAD: &[&str] = &["head", "face"];

impl Roles {
    pub fn find(skeleton: &Skeleton) -> Result<Roles, BodyError> {
        let names: Vec<(Option<usize>, String)> = skeleton.names.iter().map(|n| part(n)).collect();
        let find = |side: Option<usize>, wanted: &[&str]| {
            let named = |want: &&str| names.iter().position(|(s, n)| *s == side && n == want);
            wanted.iter().find_map(named)
        };
        let must = |side: usize, wanted: &'static [&'static str]| {
            find(Some(side), wanted).ok_or_else(|| unknown(skeleton, side, wanted))
        };
        let leg = |s| Ok::<_, BodyError>([must(s, THIGH)?, must(s, SHIN)?, must(s, FOOT)?]);
        let arm = |s| {
            let (upper, fore) = (must(s, UPPER_ARM)?, must(s, FOREARM)?);
            let wrist = find(Some(s), WRIST).map(Spot::Head);
            let wrist = wrist.or_else(|| tip(skeleton, fore));
            let wrist = wrist.ok_or_else(|| unknown(skeleton, s, WRIST))?;
            Ok::<_, BodyError>([Spot::Head(upper), Spot::Head(fore), wrist])
        };
        let (leg, arm) = ([leg(0)?, leg(1)?], [arm(0)?, arm(1)?]);
        let toe = |s: usize| {
            find(Some(s), TOE)
                .map(Spot::Head)
                .or(tip(skeleton, leg[s][2]))
        };
        let hand = |s: usize| match arm[s][2] {
            Spot::Head(wrist) => tip(skeleton, wrist),
            Spot::End(_) => None,
        };
        let palm = |s: usize| {
            let wrist = find(Some(s), &WRIST[..1])?;
            find(Some(s), &WRIST[1..]).filter(|h| skeleton.parents[*h] == Some(wrist))
        };
        let head = find(None, HEAD).map(Spot::Head);
        let (toe, hand) = ([toe(0), toe(1)], [hand(0), hand(1)]);
        Ok(Roles {
            leg,
            toe,
            arm,
            hand,
            palm: [palm(0), palm(1)],
            neck: find(None, NECK),
            head,
        })
    }

    pub fn stance(&self, points: &[[DVec3; 2]]) -> Stance {
        let at = |spot: Spot| match spot {
            Spot::Head(j) => points[j][0],
            Spot::End(j) => points[j][1],
        };
        Stance {
            leg: self.leg.map(|l| l.map(|j| points[j][0])),
            toe: self.toe.map(|t| t.map(at)),
            arm: self.arm.map(|a| a.map(at)),
            hand: self.hand.map(|h| h.map(at)),
            neck: self.neck.map(|j| points[j][0]),
            head: self.head.map(at),
        }
    }
}

/// Where joint `j`'s bone points: its end, or the head of its middle child; none at zero length.
fn tip(skeleton: &Skeleton, j: usize) -> Option<Spot> {
    if skeleton.ends[j].is_some_and(|e| e.length() > 0.0) {
        return Some(Spot::End(j));
    }
    let far = |&c: &usize| skeleton.parents[c] == Some(j) && skeleton.offsets[c].length() > 0.0;
    let children: Vec<usize> = (0..skeleton.names.len()).filter(far).collect();
    children.get(children.len() / 2).map(|&c| Spot::Head(c))
}

fn unknown(skeleton: &Skeleton, side: usize, wanted: &[&str]) -> BodyError {
    let named = skeleton.names.iter().filter(|n| !n.is_empty());
    let some: Vec<&str> = named.take(6).map(String::as_str).collect();
    let names = match some.is_empty() {
        true => "its joints have no names".to_owned(),
        false => format!("its joints are {} ..", some.join(", ")),
    };
    let side = ["left", "right"][side];
    BodyError::UnknownSkeleton {
        missing: format!("{side} {}", wanted[1]),
        names,
    }
}

/// Side (0 left, 1 right) and bare name of a joint: `Neo_LeftUpLeg` is (left, `upleg`).
fn part(name: &str) -> (Option<usize>, String) {
    let name = name.rsplit(':').next().unwrap_or(name);
    let name = [
        "Neo_",
        "joint_",
        "mixamorig_",
        "mixamorig",
        "J_Bip_C_",
        "J_Bip_",
        "DEF-",
    ]
    .iter()
    .fold(name, |n, p| n.strip_prefix(p).unwrap_or(n));
    let (side, rest) = side(name);
    let bare = rest
        .chars()
        .filter(|c| c.is_alphanumeric())
        .collect::<String>();
    (side, bare.to_lowercase())
}

fn side(name: &str) -> (Option<usize>, &str) {
    for (s, ends) in [(0, [".L", "_L", ".l", "_l"]), (1, [".R", "_R", ".r", "_r"])] {
        if let Some(rest) = ends.iter().find_map(|e| name.strip_suffix(e)) {
            return (Some(s), rest);
        }
    }
    for (s, starts) in [(0, ["Left", "left", "L_"]), (1, ["Right", "right", "R_"])] {
        if let Some(rest) = starts.iter().find_map(|p| name.strip_prefix(p)) {
            return (Some(s), rest);
        }
    }
    let mut letters = name.chars();
    let (first, second) = (letters.next(), letters.next());
    match (first, second.is_some_and(char::is_uppercase)) {
        (Some('l' | 'L'), true) => (Some(0), &name[1..]),
        (Some('r' | 'R'), true) => (Some(1), &name[1..]),
        _ => (None, name),
    }
}

/// Our figure, ready to follow.
pub(crate) struct Target<'a> {
    avatar: &'a Avatar,
    pub rest: Stance,
    root: DVec3,
    bones: Bones,
}

/// The bones that follow; sides: left, right.
pub(crate) struct Bones {
    pub spine: [usize; 5],
    pub neck: [usize; 4],
    pub arm: [[usize; 3]; 2],
    pub leg: [[usize; 3]; 2],
    /// Between trunk and arm, from within.
    girdle: [[usize; 2]; 2],
}

/// An arm that is swung farther from rest than this [rad] takes the shoulder girdle along, and what share of the rest
/// its bones take. In living people the girdle takes a third of nearly all (Inman, Saunders and Abbott 1944); skin that is
/// blended between arm and trunk folds over the collarbone only above that. The inner bone takes less: it carries the
/// shoulder, and the hand with it, farther.
const RAISED: f64 = 1.2;
const TAKEN: [f64; 2] = [0.15, 0.35];
/// So near to the opposite of rest [rad] the way there, and with it how the girdle would turn, is lost.
const LOST: f64 = 0.4;

impl Bones {
    pub(crate) fn find(avatar: &Avatar) -> Result<Bones, BodyError> {
        let spine = ["spine05", "spine04", "spine03", "spine02", "spine01"];
        let neck = ["neck01", "neck02", "neck03", "head"];
        let arm = ["upperarm01", "lowerarm01", "wrist"];
        let leg = ["upperleg01", "lowerleg01", "foot"];
        let girdle = ["clavicle", "shoulder01"];
        Ok(Bones {
            spine: chain(avatar, spine, "")?,
            neck: chain(avatar, neck, "")?,
            arm: [chain(avatar, arm, ".L")?, chain(avatar, arm, ".R")?],
            leg: [chain(avatar, leg, ".L")?, chain(avatar, leg, ".R")?],
            girdle: [chain(avatar, girdle, ".L")?, chain(avatar, girdle, ".R")?],
        })
    }

    /// Lets the shoulder girdle take its part in how an arm is raised, which points along `rest` at rest and where it
    /// did in the end.
    pub(crate) fn raise(&self, pose: &mut Pose, side: usize, rest: DVec3) {
        let arm = self.arm[side][0];
        let turn = pose.rotations[arm];
        let swing = DQuat::from_rotation_arc(rest, turn * rest);
        let angle = swing.angle_between(DQuat::IDENTITY);
        if angle <= RAISED {
            return;
        }
        let known = ((PI - angle) / LOST).min(1.0);
        let part = |taken: f64| {
            let by = known * taken * (angle - RAISED);
            DQuat::IDENTITY.slerp(swing, by / angle)
        };
        for (bone, taken) in self.girdle[side].into_iter().zip(TAKEN) {
            pose.rotations[bone] = part(taken);
        }
        let taken = part(TAKEN.iter().sum());
        pose.rotations[arm] = (taken.inverse() * turn).normalize();
    }
}

/// Bones by their names, whose side comes last.
fn chain<const N: usize>(
    avatar: &Avatar,
    names: [&str; N],
    side: &str,
) -> Result<[usize; N], BodyError> {
    let mut bones = [0; N];
    for (slot, name) in bones.iter_mut().zip(names) {
        *slot = avatar.rig().bone(&format!("{name}{side}"))?;
    }
    Ok(bones)
}

impl<'a> Target<'a> {
    pub fn new(avatar: &'a Avatar, figure: &Figure) -> Result<Self, BodyError> {
        let bones = Bones::find(avatar)?;
        let head = |b: usize| figure.joints[b];
        let named = |name: &str, side: &str| avatar.rig().bone(&format!("{name}.{side}")).map(head);
        let toe = [named("toe3-1", "L")?, named("toe3-1", "R")?];
        let hand = [named("finger3-1", "L")?, named("finger3-1", "R")?];
        let rest = Stance {
            leg: bones.leg.map(|l| l.map(head)),
            toe: toe.map(Some),
            arm: bones.arm.map(|a| a.map(head)),
            hand: hand.map(Some),
            neck: Some(head(bones.neck[0])),
            head: Some(head(bones.neck[3])),
        };
        Ok(Target {
            avatar,
            rest,
            root: figure.joints[0],
            bones,
        })
    }

    /// The stance with our hips at a place [m].
    pub(crate) fn pose(&self, stance: &Stance, hips: DVec3, limbs: &mut [Memory; 4]) -> Pose {
        let mut pose = Pose::rest(self.avatar);
        let [pelvis, chest] = std::array::from_fn(|k| {
            DQuat::from_mat3(&(stance.trunk()[k] * self.rest.trunk()[k].transpose()))
        });
        pose.rotations[0] = pelvis;
        share(&mut pose, &self.bones.spine, pelvis.inverse() * chest);
        self.turn_head(&mut pose, stance, chest);
        for side in 0..2 {
            let [arm, leg] = [self.arm(stance, side), self.leg(stance, side)];
            let at_rest = arm.rest[0];
            turn_limb(
                &mut pose,
                self.bones.arm[side],
                chest,
                (arm, &mut limbs[side]),
            );
            turn_limb(
                &mut pose,
                self.bones.leg[side],
                pelvis,
                (leg, &mut limbs[2 + side]),
            );
            self.bones.raise(&mut pose, side, at_rest);
        }
        pose.root = hips - self.root - pelvis * (self.rest.hips() - self.root);
        pose
    }

    /// Where our hips go [m].
    fn hips(&self, actor: &Actor, stance: &Stance) -> DVec3 {
        let scale = self.rest.leg_length() / stance.leg_length().max(1e-9);
        let moved = scale * (stance.hips() - actor.start);
        let level = actor.ground.level(stance.hips()).y - actor.ground.floor;
        let height = self.rest.lowest_ankle() + scale * level;
        DVec3::new(moved.x, height, moved.z)
    }

    fn turn_head(&self, pose: &mut Pose, stance: &Stance, chest: DQuat) {
        let line = |s: &Stance| Some((s.head? - s.neck?).normalize_or_zero());
        let (Some(now), Some(rest)) = (line(stance), line(&self.rest)) else {
            return;
        };
        if now != DVec3::ZERO {
            let turn = DQuat::from_rotation_arc(rest, chest.inverse() * now);
            share(pose, &self.bones.neck, turn);
        }
    }

    fn arm(&self, stance: &Stance, side: usize) -> Limb {
        let rest = limb(self.rest.arm[side], self.rest.hand[side]);
        let now = limb(stance.arm[side], stance.hand[side]);
        // The forearm bends forward: from along the arm toward +z.
        let hinge = rest[0].cross(DVec3::Z).normalize_or_zero();
        let hint = DVec3::ZERO;
        Limb {
            rest,
            now,
            hinge,
            hint,
        }
    }

    fn leg(&self, stance: &Stance, side: usize) -> Limb {
        let rest = limb(self.rest.leg[side], self.rest.toe[side]);
        let now = limb(stance.leg[side], stance.toe[side]);
        // The shin bends backward: from down toward −z.
        let hinge = rest[0].cross(DVec3::NEG_Z).normalize_or_zero();
        // A straight knee has no axis, but the foot tells which way it would bend.
        let hint = TOES * now[2].cross(now[0]);
        Limb {
            rest,
            now,
            hinge,
            hint,
        }
    }
}

fn limb(joints: [DVec3; 3], end: Option<DVec3>) -> [DVec3; 3] {
    let [a, b, c] = joints;
    [b - a, c - b, end.map_or(DVec3::ZERO, |e| e - c)].map(DVec3::normalize_or_zero)
}

/// Spreads one rotation evenly over a chain of bones.
pub(crate) fn share(pose: &mut Pose, bones: &[usize], turn: DQuat) {
    let each = DQuat::IDENTITY.slerp(turn, 1.0 / bones.len() as f64);
    for &b in bones {
        pose.rotations[b] = each;
    }
}

#[cfg(test)]
mod tests;
