//! Room for cloth: limbs that rest on the body, or sink into it, are held a little off.
//!
//! A recording fits the body it was made of, and a fit sees no depth: on somebody else's hips the
//! same arms end inside, on somebody else's belly the same knee. No cloth can lie there, so thighs
//! and upper arms turn outward, by as little as is needed. Upper arms may press on the chest, as
//! arms do, but not lie in it: whoever is broader than the actor carries them wider.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use muslin_geom::Surface;
use rayon::prelude::*;

use crate::pose::parent_turn;
use crate::{Avatar, BodyError, Figure, Part, Pose, Posed};

/// Rounds of looking and turning.
const ROUNDS: usize = 10;
/// Most that a limb turns in a round, and in all [rad].
const TURN: f64 = 0.12;
const MOST: f64 = 0.6;
/// How often both arms are looked at, if both turn.
const ARMS: usize = 3;
/// How far the rest of the body is looked for, and by an upper arm, which is near it anyway [m].
const FAR: f64 = 0.15;
const NEAR: f64 = 0.08;
/// One vertex in so many is looked at.
const STRIDE: usize = 3;
/// How deep upper arms may press into the chest [m].
const PRESS: f64 = 0.01;
/// Skin of the upper arm is moved by the arm by more than the first share, the chest beside it by
/// less than the second: between them lies the armpit, which belongs to both.
const ARM: f64 = 0.7;
const CHEST: f64 = 0.3;
/// Skin that was this near at rest is one fold, not two parts [m].
const SAME: f64 = 0.025;
/// Nothing that follows the limb by more than this counts as the rest of the body.
const OTHERS: f64 = 0.02;

/// The limbs that make room, and the room they are to keep: found once, for any number of poses.
pub struct Limbs(Vec<Limb>);

impl Limbs {
    /// Legs, then arms. Shins and feet, then forearms and hands are to keep these rooms [m] from the rest of
    /// the body, but for the other hand; upper arms may press into the chest by a centimetre.
    ///
    /// Fails on an avatar without the default rig's limbs.
    pub fn new(avatar: &Avatar, [legs, forearms]: [f64; 2]) -> Result<Limbs, BodyError> {
        let arms = [avatar.bone("upperarm01.L")?, avatar.bone("upperarm01.R")?];
        let hands = [avatar.bone("wrist.L")?, avatar.bone("wrist.R")?];
        let of = |bones: &[usize]| -> Vec<f64> {
            let each: Vec<Vec<f64>> = bones.iter().map(|&b| avatar.rig().share_of(b)).collect();
            let skin = avatar.part(Part::Body);
            skin.map(|v| each.iter().map(|share| share[v]).sum())
                .collect()
        };
        let sides = [("L", DVec3::X), ("R", DVec3::NEG_X)];
        let thighs = [avatar.bone("upperleg01.L")?, avatar.bone("upperleg01.R")?];
        let arm = of(&arms);
        // What shins, then forearms keep off; hands may meet.
        let away = [
            vec![thighs[0], arms[0], arms[1]],
            vec![thighs[1], arms[0], arms[1]],
            vec![arms[0], hands[1]],
            vec![arms[1], hands[0]],
        ];
        let (chest, others) = rayon::join(
            || Arc::new(Others::new(avatar, &arm, CHEST)),
            || {
                let others = away.par_iter();
                let others = others.map(|bones| Others::new(avatar, &of(bones), OTHERS));
                others.map(Arc::new).collect::<Vec<_>>()
            },
        );
        let mut others = others.into_iter();
        let mut limbs = Vec::new();
        for (((side, out), thigh), others) in sides.into_iter().zip(thighs).zip(others.by_ref()) {
            let shin = avatar.bone(&format!("lowerleg01.{side}"))?;
            // Seen from the side, where legs overlap most often, a leg that gives way sideways stays.
            let lower = Keep {
                skin: above(&of(&[shin]), 0.5),
                room: legs,
                others,
                far: FAR,
                way: Way::To(out),
            };
            limbs.push(Limb {
                pivot: thigh,
                keeps: vec![lower],
            });
        }
        for (((side, out), arm), others) in sides.into_iter().zip(arms).zip(others) {
            let forearm = of(&[avatar.bone(&format!("lowerarm01.{side}"))?]);
            let lower = Keep {
                skin: above(&forearm, 0.5),
                room: forearms,
                others,
                far: FAR,
                way: Way::Nearest(out),
            };
            let mut skin = above(&of(&[arm]), ARM);
            let is_one_fold = |v: usize| chest.at_rest.closest(avatar.mean()[v], SAME).is_some();
            skin.retain(|&v| forearm[v as usize] <= 0.5 && !is_one_fold(v as usize));
            let upper = Keep {
                skin,
                room: -PRESS,
                others: chest.clone(),
                far: NEAR,
                way: Way::To(out),
            };
            limbs.push(Limb {
                pivot: arm,
                keeps: vec![lower, upper],
            });
        }
        Ok(Limbs(limbs))
    }

    /// The bones that turn: both thighs, both upper arms.
    pub fn bones(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|limb| limb.pivot)
    }

    /// Turns thighs, then upper arms, until all have their room; says by how much at most [rad].
    /// Arms that both turned may have met, and are looked at again.
    ///
    /// Thighs are left to lie on each other and on the belly: flesh yields there, and a turn that
    /// frees what is next to the hip leads the foot far away. Limbs that would have to turn by more
    /// than 0.6 rad stay where they got to.
    pub fn make_room(&self, pose: &mut Pose, avatar: &Avatar, figure: &Figure) -> f64 {
        let mut posed = avatar.pose(figure, pose);
        let mut turn = |limb: &Limb| limb.make_room((pose, &mut posed), avatar, figure);
        let (legs, arms) = self.0.split_at(2);
        let mut most = legs.iter().map(&mut turn).fold(0.0, f64::max);
        for _ in 0..ARMS {
            let turned: Vec<f64> = arms.iter().map(&mut turn).collect();
            most = turned.iter().copied().fold(most, f64::max);
            if turned.contains(&0.0) {
                break;
            }
        }
        most
    }
}

/// What turns about a joint.
struct Limb {
    /// The bone that turns.
    pivot: usize,
    keeps: Vec<Keep>,
}

/// Skin of a limb, and what it must not sink into.
struct Keep {
    /// Vertices, and the room that they must have [m].
    skin: Vec<u32>,
    room: f64,
    others: Arc<Others>,
    /// How far these are looked for [m].
    far: f64,
    /// Which way out.
    way: Way,
}

/// A way out of the body, seen by the bone that a limb hangs on.
#[derive(Clone, Copy)]
enum Way {
    /// There.
    To(DVec3),
    /// Whichever is nearest, but from its own side, which is there, not to the other.
    Nearest(DVec3),
}

impl Way {
    /// The way from a point `p`, where `normal` is the nearest; `middle` is between both sides, and `frame` how the bone is
    /// turned.
    fn out(self, (p, normal): (DVec3, DVec3), (middle, frame): (DVec3, DQuat)) -> DVec3 {
        match self {
            Way::To(out) => frame * out,
            Way::Nearest(side) => {
                let side = frame * side;
                match (p - middle).dot(side) > 0.0 {
                    true => normal - side * normal.dot(side).min(0.0),
                    false => normal,
                }
            }
        }
    }
}

/// A part of the body, ready to be moved into poses, and whether its triangles end where it was
/// cut: there, inside and outside cannot be told.
struct Others {
    at_rest: Surface,
    at_cut: Vec<bool>,
}

impl Others {
    /// Triangles none of whose corners follow a limb by `most` of their weight or more.
    fn new(avatar: &Avatar, limb: &[f64], most: f64) -> Others {
        let free = |f: &[u32; 3]| f.iter().all(|&v| limb[v as usize] < most);
        let (kept, cut): (Vec<_>, Vec<_>) = avatar.collision_faces().iter().partition(|f| free(f));
        let mut rim = vec![false; limb.len()];
        cut.iter().flatten().for_each(|&v| rim[v as usize] = true);
        let at_cut = |f: &[u32; 3]| f.iter().any(|&v| rim[v as usize]);
        Others {
            at_cut: kept.iter().map(at_cut).collect(),
            at_rest: Surface::new(&avatar.mean()[avatar.part(Part::Body)], &kept),
        }
    }
}

impl Limb {
    /// Turns the limb in a pose, in which the body is `posed`; says by how much [rad].
    fn make_room(
        &self,
        (pose, posed): (&mut Pose, &mut Posed),
        avatar: &Avatar,
        figure: &Figure,
    ) -> f64 {
        let mut turned = 0.0;
        for _ in 0..ROUNDS {
            let skin = &posed.verts[avatar.part(Part::Body)];
            let joint = posed.bones[self.pivot].transform_point3(figure.joints[self.pivot]);
            let frame = parent_turn(avatar.rig(), &posed.bones, self.pivot);
            let middle = posed.bones[0].transform_point3(figure.joints[0]);
            let from = (joint, middle, frame);
            let turns = (self.keeps.iter()).filter_map(|keep| keep.turn_out(skin, from));
            let Some((turn, angle)) = turns.max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            if turned + angle > MOST {
                break;
            }
            turned += angle;
            pose.turn_in_world((self.pivot, frame), turn);
            *posed = avatar.pose(figure, pose);
        }
        turned
    }
}

impl Keep {
    /// The turn about `joint` that frees what is deepest, and its angle [rad]; none if all is free.
    /// `middle`: where the body's is, `frame`: how the bone that the limb hangs on is turned.
    fn turn_out(
        &self,
        skin: &[DVec3],
        (joint, middle, frame): (DVec3, DVec3, DQuat),
    ) -> Option<(DQuat, f64)> {
        let (lack, p, normal) = self.worst(skin, STRIDE)?;
        let lever = p - joint;
        let axis = lever.cross(self.way.out((p, normal), (middle, frame)));
        // A push along the limb cannot be answered by a turn of it.
        let reach = axis.length().max(0.3 * lever.length());
        let angle = ((lack + 1e-3) / reach).min(TURN);
        Some((DQuat::from_axis_angle(axis.try_normalize()?, angle), angle))
    }

    /// What the skin vertex with the least room lacks of it [m], where it is [m], and the way out;
    /// none if all have room. Looks at every `stride`th vertex.
    fn worst(&self, skin: &[DVec3], stride: usize) -> Option<(f64, DVec3, DVec3)> {
        let others = self.others.at_rest.moved(skin);
        let lack = |&i: &u32| {
            let p = skin[i as usize];
            let hit = others.closest(p, self.far)?;
            let told = !self.others.at_cut[hit.face as usize] && hit.signed < self.room;
            told.then_some((self.room - hit.signed, p, hit.normal))
        };
        let lacks = self.skin.iter().step_by(stride).filter_map(lack);
        lacks.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Vertices whose share is more than `least`.
fn above(share: &[f64], least: f64) -> Vec<u32> {
    let found = share.iter().enumerate().filter(|(_, s)| **s > least);
    found.map(|(v, _)| v as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    /// What skin of a limb lacks of its room at most [m].
    fn lack(keep: &Keep, avatar: &Avatar, figure: &Figure, pose: &Pose) -> f64 {
        let posed = avatar.pose(figure, pose);
        let worst = keep.worst(&posed.verts[avatar.part(Part::Body)], 1);
        worst.map_or(0.0, |w| w.0)
    }

    #[test]
    fn a_hand_sunk_into_the_hip_comes_out_and_free_limbs_stay() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let mut free = Pose::rest(&avatar);
        let limbs = Limbs::new(&avatar, [0.01; 2]).expect("limbs");
        assert_eq!(limbs.make_room(&mut free, &avatar, &figure), 0.0);
        let mut pose = Pose::rest(&avatar);
        let upper = avatar.bone("upperarm01.L").expect("an arm");
        // The left arm hangs at +X; this brings it down and inward, into the thigh.
        pose.rotations[upper] = DQuat::from_rotation_z(-0.85);
        let arm = &limbs.0[2].keeps[0];
        assert!(lack(arm, &avatar, &figure, &pose) > 0.02);
        let turn = limbs.make_room(&mut pose, &avatar, &figure);
        assert!(turn > 0.02 && turn < MOST, "{turn}");
        let left = lack(arm, &avatar, &figure, &pose);
        assert!(left < 0.003, "{left}");
    }

    #[test]
    fn an_arm_on_its_own_side_is_not_sent_to_the_other() {
        let (left, middle) = (DVec3::X, DVec3::new(0.0, 0.9, 0.0));
        let frame = DQuat::from_rotation_y(0.3);
        let back_and_in = frame * DVec3::new(-0.6, 0.0, -0.8);
        let out = |p: DVec3| Way::Nearest(left).out((p, back_and_in), (middle, frame));
        let on_own_side = out(middle + frame * DVec3::new(0.1, -0.2, -0.05));
        assert!(on_own_side.distance(frame * DVec3::new(0.0, 0.0, -0.8)) < 1e-12);
        assert_eq!(out(middle - frame * DVec3::X * 0.1), back_and_in);
        let ahead = Way::To(DVec3::Z).out((middle, back_and_in), (middle, frame));
        assert!(ahead.distance(frame * DVec3::Z) < 1e-12);
    }

    #[test]
    fn hands_deep_in_the_belly_and_in_the_other_forearm_come_out() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let limbs = Limbs::new(&avatar, [0.01; 2]).expect("limbs");
        let mut pose = Pose::rest(&avatar);
        // Arms hang, elbows bend forward and inward: forearms lie in the belly and in each other.
        for (side, out) in [("L", 1.0), ("R", -1.0)] {
            let bone = |name: &str| avatar.bone(&format!("{name}.{side}")).expect("a bone");
            let (forward, inward) = (DQuat::from_rotation_x, DQuat::from_rotation_z(-0.6 * out));
            pose.rotations[bone("upperarm01")] = forward(0.18) * inward;
            let bent = DQuat::from_rotation_y(-1.2 * out);
            pose.rotations[bone("lowerarm01")] = forward(0.6) * bent;
        }
        let lacks = |pose: &Pose| {
            let lower = |limb: &Limb| lack(&limb.keeps[0], &avatar, &figure, pose);
            [lower(&limbs.0[2]), lower(&limbs.0[3])]
        };
        let before = lacks(&pose);
        assert!(before.iter().all(|l| *l > 0.08), "{before:?}");
        limbs.make_room(&mut pose, &avatar, &figure);
        let after = lacks(&pose);
        assert!(after.iter().all(|l| *l < 0.025), "{before:?} to {after:?}");
    }

    #[test]
    fn a_foot_in_the_other_leg_comes_out() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let shape = Shape::default().with("weight", 0.8).expect("a phenotype");
        let figure = avatar.figure(&shape).expect("a heavy person");
        let thigh = avatar.bone("upperleg01.L").expect("a leg");
        let limbs = Limbs::new(&avatar, [0.01; 2]).expect("limbs");
        let leg = &limbs.0[0].keeps[0];
        let mut pose = Pose::rest(&avatar);
        pose.rotations[thigh] = DQuat::from_rotation_z(-0.35);
        let before = lack(leg, &avatar, &figure, &pose);
        assert!(before > 0.005, "{before}");
        let turned = limbs.make_room(&mut pose, &avatar, &figure);
        let after = lack(leg, &avatar, &figure, &pose);
        assert!(after < 0.003 && turned < MOST, "{before} to {after}");
    }

    #[test]
    fn broad_people_carry_their_arms_wider_and_others_as_they_were() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let limbs = Limbs::new(&avatar, [0.01; 2]).expect("limbs");
        let [left, right] = ["L", "R"].map(|side| {
            let arm = avatar.bone(&format!("upperarm01.{side}"));
            arm.expect("an arm")
        });
        let mut hanging = Pose::rest(&avatar);
        hanging.rotations[left] = DQuat::from_rotation_z(-0.72);
        hanging.rotations[right] = DQuat::from_rotation_z(0.72);
        let freed = |weight: f64| {
            let shape = Shape::default().with("weight", weight);
            let figure = avatar.figure(&shape.expect("a phenotype"));
            let figure = figure.expect("a person");
            let mut pose = hanging.clone();
            let sunk = |pose: &Pose| {
                let upper = |limb: &Limb| lack(&limb.keeps[1], &avatar, &figure, pose);
                limbs.0[2..].iter().map(upper).fold(0.0, f64::max)
            };
            let before = sunk(&pose);
            let turned = limbs.make_room(&mut pose, &avatar, &figure);
            (before, sunk(&pose), turned)
        };
        let (before, after, turned) = freed(1.0);
        assert!(before > 0.012 && after < 0.003, "{before} to {after}");
        assert!((0.05..MOST).contains(&turned), "{turned}");
        assert_eq!(freed(0.3).2, 0.0);
    }
}
