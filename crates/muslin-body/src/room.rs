//! Room for cloth: hands that rest on the body, or sink into it, are held a little off.
//!
//! A recording fits the body it was made of, and a fit sees no depth: on somebody else's hips the
//! same arms end inside. No cloth can lie there, so upper arms turn outward, by as little as is
//! needed.

use glam::{DQuat, DVec3};
use muslin_geom::Surface;

use crate::{Avatar, BodyError, Figure, Part, Pose};

/// Rounds of looking and turning.
const ROUNDS: usize = 10;
/// Most that an arm turns in a round, and in all [rad].
const TURN: f64 = 0.12;
const MOST: f64 = 0.6;
/// How far the trunk is looked for [m].
const FAR: f64 = 0.15;
/// One vertex in so many is looked at.
const STRIDE: usize = 3;

impl Pose {
    /// Turns the upper arms until forearms and hands keep `room` [m] from trunk and legs; says by
    /// how much at most [rad].
    ///
    /// Arms that would have to turn by more than 0.6 rad stay where they got to. Fails on an
    /// avatar without the default rig's arms.
    pub fn make_room(
        &mut self,
        avatar: &Avatar,
        figure: &Figure,
        room: f64,
    ) -> Result<f64, BodyError> {
        let trunk = trunk_faces(avatar)?;
        let mut most = 0.0f64;
        for side in ["L", "R"] {
            let upper = avatar.bone(&format!("upperarm01.{side}"))?;
            let arm = below(avatar, avatar.bone(&format!("lowerarm01.{side}"))?);
            let mut turned = 0.0;
            for _ in 0..ROUNDS {
                let posed = avatar.pose(figure, self);
                let skin = &posed.verts[avatar.part(Part::Body)];
                let surface = Surface::new(skin, &trunk);
                let pivot = posed.bones[upper].transform_point3(figure.joints[upper]);
                let Some((turn, angle)) = turn_out(&surface, skin, &arm, (pivot, room)) else {
                    break;
                };
                if turned + angle > MOST {
                    break;
                }
                turned += angle;
                let parent = avatar.rig().bones[upper].parent;
                let frame = parent.map_or(DQuat::IDENTITY, |p| {
                    DQuat::from_mat3(&posed.bones[p].matrix3).normalize()
                });
                let own = self.rotations[upper];
                self.rotations[upper] = (frame.inverse() * turn * frame * own).normalize();
            }
            most = most.max(turned);
        }
        Ok(most)
    }
}

/// The turn about `pivot` that frees what is deepest, and its angle [rad]; none if all is free.
fn turn_out(
    trunk: &Surface,
    skin: &[DVec3],
    arm: &[u32],
    (pivot, room): (DVec3, f64),
) -> Option<(DQuat, f64)> {
    let near = |&i: &u32| {
        let p = skin[i as usize];
        let hit = trunk.closest(p, FAR)?;
        (hit.signed < room).then_some((p, hit))
    };
    let hits = arm.iter().step_by(STRIDE).filter_map(near);
    let (p, hit) = hits.min_by(|a, b| a.1.signed.total_cmp(&b.1.signed))?;
    let lever = p - pivot;
    let axis = lever.cross(hit.normal);
    // A push along the arm cannot be answered by a turn of it.
    let reach = axis.length().max(0.3 * lever.length());
    let angle = ((room - hit.signed + 1e-3) / reach).min(TURN);
    Some((DQuat::from_axis_angle(axis.try_normalize()?, angle), angle))
}

/// Vertices of the skin that follow `bone` and what hangs on it.
fn below(avatar: &Avatar, bone: usize) -> Vec<u32> {
    let follows = share_of(avatar, bone);
    let skin = avatar.part(Part::Body);
    skin.filter(|&i| follows[i] > 0.5)
        .map(|i| i as u32)
        .collect()
}

/// Triangles of trunk, head and legs: those that follow no arm.
fn trunk_faces(avatar: &Avatar) -> Result<Vec<[u32; 3]>, BodyError> {
    let left = share_of(avatar, avatar.bone("upperarm01.L")?);
    let right = share_of(avatar, avatar.bone("upperarm01.R")?);
    let free = |v: u32| left[v as usize] + right[v as usize] < 0.02;
    let faces = avatar.collision_faces().iter();
    Ok(faces
        .copied()
        .filter(|f| f.iter().all(|&v| free(v)))
        .collect())
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

    #[test]
    fn a_hand_sunk_into_the_hip_comes_out_and_free_arms_stay() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let mut free = Pose::rest(&avatar);
        assert_eq!(free.make_room(&avatar, &figure, 0.01), Ok(0.0));
        let mut pose = Pose::rest(&avatar);
        let upper = avatar.bone("upperarm01.L").expect("an arm");
        // The left arm hangs at +X; this brings it down and inward, into the thigh.
        pose.rotations[upper] = DQuat::from_rotation_z(-0.85);
        let depth = |pose: &Pose| {
            let posed = avatar.pose(&figure, pose);
            let skin = &posed.verts[avatar.part(Part::Body)];
            let trunk = Surface::new(skin, &trunk_faces(&avatar).expect("arms"));
            let lower = avatar.bone("lowerarm01.L").expect("an arm");
            let arm = below(&avatar, lower);
            let signed = |&i: &u32| trunk.closest(skin[i as usize], FAR).map(|h| h.signed);
            arm.iter().filter_map(signed).fold(FAR, f64::min)
        };
        assert!(depth(&pose) < -0.01, "{}", depth(&pose));
        let turn = pose.make_room(&avatar, &figure, 0.01).expect("an arm");
        assert!(turn > 0.02 && turn < MOST, "{turn}");
        assert!(depth(&pose) > 0.007, "{}", depth(&pose));
    }
}
