//! Room for cloth: limbs that rest on the body, or sink into it, are held a little off.
//!
//! A recording fits the body it was made of, and a fit sees no depth: on somebody else's hips the
//! same arms end inside, on somebody else's belly the same knee. No cloth can lie there, so thighs
//! and upper arms turn outward, by as little as is needed.

use glam::{DQuat, DVec3};
use muslin_geom::Surface;

use crate::{Avatar, BodyError, Figure, Part, Pose};

/// Rounds of looking and turning.
const ROUNDS: usize = 10;
/// Most that a limb turns in a round, and in all [rad].
const TURN: f64 = 0.12;
const MOST: f64 = 0.6;
/// How far the rest of the body is looked for [m].
const FAR: f64 = 0.15;
/// One vertex in so many is looked at.
const STRIDE: usize = 3;

/// The limbs that make room, and the room they are to keep: found once, for any number of poses.
pub struct Limbs(Vec<Limb>);

impl Limbs {
    /// Legs, then arms, each to keep `room` [m] from the rest of the body.
    ///
    /// Fails on an avatar without the default rig's limbs.
    pub fn new(avatar: &Avatar, room: f64) -> Result<Limbs, BodyError> {
        let arms = [avatar.bone("upperarm01.L")?, avatar.bone("upperarm01.R")?];
        let mut limbs = Vec::new();
        // Seen from the side, where legs overlap most often, a leg that gives way sideways stays.
        for (side, out) in [("L", DVec3::X), ("R", DVec3::NEG_X)] {
            let thigh = avatar.bone(&format!("upperleg01.{side}"))?;
            let shin = avatar.bone(&format!("lowerleg01.{side}"))?;
            let apart = [thigh, arms[0], arms[1]];
            limbs.push(Limb::new(avatar, (thigh, shin), &apart, (room, Some(out))));
        }
        for (side, upper) in ["L", "R"].into_iter().zip(arms) {
            let lower = avatar.bone(&format!("lowerarm01.{side}"))?;
            limbs.push(Limb::new(avatar, (upper, lower), &arms, (room, None)));
        }
        Ok(Limbs(limbs))
    }

    /// The bones that turn: both thighs, both upper arms.
    pub fn bones(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|limb| limb.pivot)
    }

    /// Turns thighs, then upper arms, until shins and feet, forearms and hands have their room;
    /// says by how much at most [rad].
    ///
    /// Thighs are left to lie on each other and on the belly: flesh yields there, and a turn that
    /// frees what is next to the hip leads the foot far away. Limbs that would have to turn by more
    /// than 0.6 rad stay where they got to.
    pub fn make_room(&self, pose: &mut Pose, avatar: &Avatar, figure: &Figure) -> f64 {
        let turns = self
            .0
            .iter()
            .map(|limb| limb.make_room(pose, avatar, figure));
        turns.fold(0.0, f64::max)
    }
}

/// What turns about a joint, and what it must not sink into.
struct Limb {
    /// The bone that turns.
    pivot: usize,
    /// Skin vertices, and the room that they must keep [m].
    skin: Vec<u32>,
    room: f64,
    /// The rest of the body, ready to be moved into poses, and whether its triangles end where it
    /// was cut: there, inside and outside cannot be told.
    others: Surface,
    at_cut: Vec<bool>,
    /// Which way out, seen by the bone it hangs on; none: whichever is nearest.
    out: Option<DVec3>,
}

impl Limb {
    /// What follows `lower`, to be kept from all that follows none of the bones `apart`.
    fn new(
        avatar: &Avatar,
        (pivot, lower): (usize, usize),
        apart: &[usize],
        (room, out): (f64, Option<DVec3>),
    ) -> Limb {
        let lower = share_of(avatar, lower);
        let skin = avatar.part(Part::Body).filter(|&i| lower[i] > 0.5);
        let apart: Vec<Vec<f64>> = apart.iter().map(|&b| share_of(avatar, b)).collect();
        let (others, at_cut) = faces_without(avatar, |v| apart.iter().map(|s| s[v]).sum());
        Limb {
            pivot,
            skin: skin.map(|i| i as u32).collect(),
            room,
            others: Surface::new(&avatar.mean()[avatar.part(Part::Body)], &others),
            at_cut,
            out,
        }
    }

    /// Turns the limb in a pose; says by how much [rad].
    fn make_room(&self, pose: &mut Pose, avatar: &Avatar, figure: &Figure) -> f64 {
        let mut turned = 0.0;
        for _ in 0..ROUNDS {
            let posed = avatar.pose(figure, pose);
            let skin = &posed.verts[avatar.part(Part::Body)];
            let joint = posed.bones[self.pivot].transform_point3(figure.joints[self.pivot]);
            let parent = avatar.rig().bones[self.pivot].parent;
            let frame = parent.map_or(DQuat::IDENTITY, |p| {
                DQuat::from_mat3(&posed.bones[p].matrix3).normalize()
            });
            let Some((turn, angle)) = self.turn_out(skin, (joint, frame)) else {
                break;
            };
            if turned + angle > MOST {
                break;
            }
            turned += angle;
            let own = pose.rotations[self.pivot];
            pose.rotations[self.pivot] = (frame.inverse() * turn * frame * own).normalize();
        }
        turned
    }

    /// The turn about `joint` that frees what is deepest, and its angle [rad]; none if all is free.
    /// `frame`: how the bone that the limb hangs on is turned.
    fn turn_out(&self, skin: &[DVec3], (joint, frame): (DVec3, DQuat)) -> Option<(DQuat, f64)> {
        let (lack, p, normal) = self.worst(skin, STRIDE)?;
        let lever = p - joint;
        let axis = lever.cross(self.out.map_or(normal, |out| frame * out));
        // A push along the limb cannot be answered by a turn of it.
        let reach = axis.length().max(0.3 * lever.length());
        let angle = ((lack + 1e-3) / reach).min(TURN);
        Some((DQuat::from_axis_angle(axis.try_normalize()?, angle), angle))
    }

    /// What the skin vertex with the least room lacks of it [m], where it is [m], and the way out;
    /// none if all have room. Looks at every `stride`th vertex.
    fn worst(&self, skin: &[DVec3], stride: usize) -> Option<(f64, DVec3, DVec3)> {
        let others = self.others.moved(skin);
        let lack = |&i: &u32| {
            let p = skin[i as usize];
            let hit = others.closest(p, FAR)?;
            let told = !self.at_cut[hit.face as usize] && hit.signed < self.room;
            told.then_some((self.room - hit.signed, p, hit.normal))
        };
        let lacks = self.skin.iter().step_by(stride).filter_map(lack);
        lacks.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Triangles none of whose corners follow what `share` counts, and which of them lie at the cut.
fn faces_without(avatar: &Avatar, share: impl Fn(usize) -> f64) -> (Vec<[u32; 3]>, Vec<bool>) {
    let free = |f: &[u32; 3]| f.iter().all(|&v| share(v as usize) < 0.02);
    let (kept, cut): (Vec<_>, Vec<_>) = avatar.collision_faces().iter().partition(|f| free(f));
    let mut rim = vec![false; avatar.part(Part::Body).len()];
    cut.iter().flatten().for_each(|&v| rim[v as usize] = true);
    let at_cut = kept
        .iter()
        .map(|f: &[u32; 3]| f.iter().any(|&v| rim[v as usize]));
    let at_cut = at_cut.collect();
    (kept, at_cut)
}

/// For every vertex, the weight of a bone and all that descend from it.
fn share_of(avatar: &Avatar, bone: usize) -> Vec<f64> {
    let rig = avatar.rig();
    let sum = |row: &[(u32, f64)]| {
        row.iter()
            .filter(|(b, _)| rig.descends(*b as usize, bone))
            .map(|(_, w)| w)
            .sum()
    };
    rig.weights.rows().map(sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    /// What a limb lacks of its room at most [m].
    fn lack(limb: &Limb, avatar: &Avatar, figure: &Figure, pose: &Pose) -> f64 {
        let posed = avatar.pose(figure, pose);
        let worst = limb.worst(&posed.verts[avatar.part(Part::Body)], 1);
        worst.map_or(0.0, |w| w.0)
    }

    #[test]
    fn a_hand_sunk_into_the_hip_comes_out_and_free_limbs_stay() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let mut free = Pose::rest(&avatar);
        let limbs = Limbs::new(&avatar, 0.01).expect("limbs");
        assert_eq!(limbs.make_room(&mut free, &avatar, &figure), 0.0);
        let mut pose = Pose::rest(&avatar);
        let upper = avatar.bone("upperarm01.L").expect("an arm");
        // The left arm hangs at +X; this brings it down and inward, into the thigh.
        pose.rotations[upper] = DQuat::from_rotation_z(-0.85);
        let arm = &limbs.0[2];
        assert!(lack(arm, &avatar, &figure, &pose) > 0.02);
        let turn = limbs.make_room(&mut pose, &avatar, &figure);
        assert!(turn > 0.02 && turn < MOST, "{turn}");
        let left = lack(arm, &avatar, &figure, &pose);
        assert!(left < 0.003, "{left}");
    }

    #[test]
    fn a_foot_in_the_other_leg_comes_out() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let shape = Shape::default().with("weight", 0.8).expect("a phenotype");
        let figure = avatar.figure(&shape).expect("a heavy person");
        let thigh = avatar.bone("upperleg01.L").expect("a leg");
        let limbs = Limbs::new(&avatar, 0.01).expect("limbs");
        let leg = &limbs.0[0];
        let mut pose = Pose::rest(&avatar);
        pose.rotations[thigh] = DQuat::from_rotation_z(-0.35);
        let before = lack(leg, &avatar, &figure, &pose);
        assert!(before > 0.005, "{before}");
        let turned = limbs.make_room(&mut pose, &avatar, &figure);
        let after = lack(leg, &avatar, &figure, &pose);
        assert!(after < 0.003 && turned < MOST, "{before} to {after}");
    }
}
