//! Our body in the likeness of somebody else's character: the same proportions, the same skin as far
//! as cloth minds, moved by the same joints.
//!
//! Our skin takes the character's stance, is bent so that joints meet, and drawn over its skin. What
//! is cut on our body, and all that moves it, then goes for the character. Its own mesh is posed by
//! `world_from_joint = M B⁻¹ bound`, with `M` our bones in the pose and `B` the same bones in the
//! stance that the character was bound in; our skin as well, so that one lies on the other in any pose.

mod covering;
mod follower;
mod joints;
mod likes;
mod maker;
mod warp;
mod wrap;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::pose::blended;
use crate::{Avatar, BodyError, Character, Pose, Shape};
use covering::Covering;
pub use follower::Follower;
pub(crate) use joints::Joints;
use maker::Maker;

/// The size that is left of a joint that is shrunk to nothing.
const HIDDEN: f64 = 1e-3;

/// A place on a skin: the corners of a triangle, and their shares.
type Place = ([u32; 3], [f64; 3]);

/// A character that can wear what our body can.
#[derive(Clone, Debug)]
pub struct Twin {
    /// Our body in its likeness.
    pub avatar: Avatar,
    /// Our bone that each joint of the character goes with; none for what the hips hang from.
    pub follows: Vec<Option<usize>>,
    /// Share of the character's vertices, hands and head left out, that lie more than 3 mm outside our
    /// skin.
    pub uncovered: f64,
    /// Share of our skin, as far as it is drawn over the character's, that finds none near.
    pub unmet: f64,
    /// The place of our skin that each of the character's vertices goes with where flesh gives way.
    on_skin: Vec<Option<Place>>,
    /// Where our skin lies on the character's.
    covering: Covering,
    bound: Vec<DAffine3>,
    joints: Vec<DAffine3>,
    /// The joint that turns each of our bones, if one.
    leads: Vec<Option<usize>>,
}

impl Twin {
    /// The likeness of a character on the joints of `base`, starting from a body of `shape`.
    ///
    /// Fails where arms or legs cannot be found.
    pub fn new(base: &Avatar, shape: &Shape, character: &Character) -> Result<Twin, BodyError> {
        let joints = Joints::find(base, character)?;
        let welded = character.welded();
        let maker = Maker::new(base, shape, (&welded, &joints))?;
        maker.make(character)
    }

    /// `world_from_joint` of every joint of the character when our bones are moved by `bones`
    /// ([`Posed::bones`](crate::Posed::bones)) and its joints do `beyond` ([`Pose::beyond`]) in the frames of those that they
    /// go with. Joints that the hips hang from stay.
    pub fn joints(&self, bones: &[DAffine3], beyond: &[DAffine3]) -> Vec<DAffine3> {
        let taken = self.taken(bones).into_iter().enumerate();
        let moved = taken.map(|(j, place)| match beyond.get(j) {
            Some(own) => place * *own,
            None => place,
        });
        moved.collect()
    }

    /// Where our bones alone take the joints.
    fn taken(&self, bones: &[DAffine3]) -> Vec<DAffine3> {
        let moved = |(j, follows): (&DAffine3, &Option<usize>)| match follows {
            Some(b) => bones[*b] * self.bound[*b].inverse() * *j,
            None => *j,
        };
        self.joints.iter().zip(&self.follows).map(moved).collect()
    }

    /// What joints at `joints` (`world_from_joint`) do beyond where our bones take them ([`Pose::beyond`]). A joint that is
    /// shrunk to nothing, to hide what hangs on it, is left with a thousandth.
    pub fn beyond(&self, bones: &[DAffine3], joints: &[DAffine3]) -> Vec<DAffine3> {
        let pairs = self.taken(bones).into_iter().zip(joints);
        let own = pairs.zip(&self.follows).map(|((taken, now), follows)| {
            let own = taken.inverse() * *now;
            match follows {
                None => DAffine3::IDENTITY,
                Some(_) if own.matrix3.determinant().abs() > HIDDEN.powi(3) => own,
                Some(_) => DAffine3 {
                    matrix3: DMat3::from_diagonal(DVec3::splat(HIDDEN)),
                    translation: own.translation,
                },
            }
        });
        own.collect()
    }

    /// The character's vertices [m] where its joints are at `joints` ([`Twin::joints`]) and our skin has given way from where
    /// our bones take it by `yielded` [m] (nothing, or one for each of its vertices).
    pub fn posed(
        &self,
        character: &Character,
        joints: &[DAffine3],
        yielded: &[DVec3],
    ) -> Vec<DVec3> {
        let pairs = joints.iter().zip(&self.joints);
        let moved: Vec<DAffine3> = pairs.map(|(now, bound)| *now * bound.inverse()).collect();
        let rows = character.verts.iter().zip(character.weights.rows());
        let places = rows.map(|(p, row)| blended(row, &moved).transform_point3(*p));
        places
            .zip(self.yielded(yielded))
            .map(|(p, by)| p + by)
            .collect()
    }

    /// Our `skin` in a pose [m], raised by up to 2 cm to where the character's own comes out of it, whose joints are at
    /// `joints` ([`Twin::joints`]).
    pub fn cover(&self, character: &Character, joints: &[DAffine3], skin: &mut [DVec3]) {
        self.covering
            .over(skin, &self.posed(character, joints, &[]));
    }

    /// How far each of the character's vertices goes with our skin [m] where that gives way.
    pub fn yielded(&self, yielded: &[DVec3]) -> impl Iterator<Item = DVec3> {
        self.on_skin.iter().map(|on| match on {
            Some((face, weights)) if !yielded.is_empty() => {
                let corners = face.iter().zip(weights);
                corners.map(|(v, w)| yielded[*v as usize] * *w).sum()
            }
            _ => DVec3::ZERO,
        })
    }

    /// Our pose where the character's joints are at `joints` (`world_from_joint`); see [`Follower`].
    pub fn pose_of(&self, joints: &[DAffine3]) -> Pose {
        let mut pose = Pose::rest(&self.avatar);
        self.follower().follow(joints, &mut pose);
        pose
    }

    /// What takes our body to where the character's joints are.
    pub fn follower(&self) -> Follower {
        Follower::new(self)
    }

    /// `world_from_joint` of every joint of the character in the stance that it was bound in.
    pub fn stance(&self) -> &[DAffine3] {
        &self.joints
    }

    /// How a bone is turned in its parent's frame in the stance that the character was bound in.
    fn still(&self, b: usize) -> DQuat {
        let of = |b: usize| DQuat::from_mat3(&self.bound[b].matrix3).normalize();
        let above = self.avatar.rig().bones[b]
            .parent
            .map_or(DQuat::IDENTITY, of);
        above.inverse() * of(b)
    }
}
