//! How a body stands, and the skin that follows its bones.
//!
//! Every bone's rest frame is axis-aligned at its head, so identity rotations are the rest
//! pose and a bone's rotation means the same whatever the shape:
//!
//! `world_from_bone(b) = world_from_bone(parent) · T(head_b − head_parent + shift_b) · R(rotation_b)`
//!
//! where the first bone has `T(head + root)`. The skin follows
//! `world_from_rest(b) = world_from_bone(b) · T(−head_b)` by linear blending.

use crate::{Avatar, Bone, Figure, Rig};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use muslin_geom::vertex_normals;

/// One stance of the full rig.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// Translation of the whole body [m].
    pub root: DVec3,
    /// One rotation per bone, in its parent's frame.
    pub rotations: Vec<DQuat>,
    /// How far each bone's head is from its place at rest, in its parent's frame [m]; no entries where all are there. The
    /// first bone has `root` instead.
    pub shifts: Vec<DVec3>,
    /// What each joint of a character does in the frame of the bone that takes it along ([`Twin::joints`](crate::Twin::joints));
    /// no entries where they do nothing.
    pub beyond: Vec<DAffine3>,
}

/// A figure in a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// All vertices of the figure [m].
    pub verts: Vec<DVec3>,
    /// `world_from_rest` of every bone.
    pub bones: Vec<DAffine3>,
}

impl Pose {
    /// The rest pose: arms a little away from the sides, legs a little apart.
    pub fn rest(avatar: &Avatar) -> Self {
        Self {
            root: DVec3::ZERO,
            rotations: vec![DQuat::IDENTITY; avatar.rig().n_bones()],
            shifts: Vec::new(),
            beyond: Vec::new(),
        }
    }

    /// `t` = 0 is this pose, 1 the other; rotations take the shorter way round, all else the straight one.
    pub fn toward(&self, other: &Pose, t: f64) -> Pose {
        let pairs = self.rotations.iter().zip(&other.rotations);
        Pose {
            root: self.root.lerp(other.root, t),
            rotations: pairs.map(|(a, b)| a.slerp(*b, t)).collect(),
            shifts: between((&self.shifts, &other.shifts), DVec3::ZERO, |a, b| {
                a.lerp(b, t)
            }),
            beyond: between((&self.beyond, &other.beyond), DAffine3::IDENTITY, |a, b| {
                DAffine3 {
                    matrix3: a.matrix3 * (1.0 - t) + b.matrix3 * t,
                    translation: a.translation.lerp(b.translation, t),
                }
            }),
        }
    }

    /// How far each bone's head is from its place at rest [m].
    pub(crate) fn shift(&self, bone: usize) -> DVec3 {
        self.shifts.get(bone).copied().unwrap_or(DVec3::ZERO)
    }
}

/// Entries between two lists of which either may have none, which stands for `rest` everywhere.
fn between<T: Copy>((a, b): (&[T], &[T]), rest: T, mix: impl Fn(T, T) -> T) -> Vec<T> {
    let of = |list: &[T], k: usize| list.get(k).copied().unwrap_or(rest);
    (0..a.len().max(b.len()))
        .map(|k| mix(of(a, k), of(b, k)))
        .collect()
}

impl Pose {
    /// Turns a bone, and what hangs on it, by `turn` in the world, where its parent is turned by `frame`
    /// ([`parent_turn`]).
    pub(crate) fn turn_in_world(&mut self, (bone, frame): (usize, DQuat), turn: DQuat) {
        let own = &mut self.rotations[bone];
        *own = (frame.inverse() * turn * frame * *own).normalize();
    }
}

/// How the bone that `bone` hangs on is turned, of a body whose bones moved by `bones` ([`Posed::bones`]).
pub(crate) fn parent_turn(rig: &Rig, bones: &[DAffine3], bone: usize) -> DQuat {
    let turn = |p: usize| DQuat::from_mat3(&bones[p].matrix3).normalize();
    rig.bones[bone].parent.map_or(DQuat::IDENTITY, turn)
}

impl Posed {
    /// Unit normals of the triangles `faces` at every vertex; zero where no face touches.
    pub fn normals(&self, faces: &[[u32; 3]]) -> Vec<DVec3> {
        vertex_normals(&self.verts, faces)
    }

    /// `world_from_bone` of bone `b`: where its head is, and how it is turned.
    pub fn world_from_bone(&self, figure: &Figure, b: usize) -> DAffine3 {
        self.bones[b] * DAffine3::from_translation(figure.joints[b])
    }
}

impl Avatar {
    /// The figure's skin and bones in `pose`.
    ///
    /// Rotations that the pose lacks are taken as the identity.
    pub fn pose(&self, figure: &Figure, pose: &Pose) -> Posed {
        let bones = world_from_rest(self.rig(), figure, pose);
        let verts = match &self.bound {
            None => skin(&figure.verts, self.rig(), &bones),
            Some(bound) => {
                let pairs = bones.iter().zip(&bound.unbind);
                let whole: Vec<DAffine3> = pairs.map(|(b, u)| *b * *u).collect();
                skin(&bound.verts, self.rig(), &whole)
            }
        };
        Posed { verts, bones }
    }
}

impl Avatar {
    /// `world_from_rest` of every bone alone, as in [`Posed::bones`].
    pub fn bones(&self, figure: &Figure, pose: &Pose) -> Vec<DAffine3> {
        world_from_rest(self.rig(), figure, pose)
    }
}

/// `world_from_rest` of every bone (see the module's own words).
pub(crate) fn world_from_rest(rig: &Rig, figure: &Figure, pose: &Pose) -> Vec<DAffine3> {
    let mut world = Vec::with_capacity(rig.n_bones());
    place_bones((&rig.bones, &figure.joints), pose, &mut world);
    world
}

/// As [`Avatar::bones`], of bones and where they turn in the rest pose ([`Figure::joints`]) alone, in memory that is
/// there.
///
/// # Panics
/// Where there are fewer joints than bones.
pub fn place_bones((bones, joints): (&[Bone], &[DVec3]), pose: &Pose, world: &mut Vec<DAffine3>) {
    world.clear();
    for (b, bone) in bones.iter().enumerate() {
        let turn = pose.rotations.get(b).copied().unwrap_or(DQuat::IDENTITY);
        let head = joints[b];
        let placed = match bone.parent {
            None => DAffine3::from_rotation_translation(turn, head + pose.root),
            Some(p) => {
                let place = head - joints[p] + pose.shift(b);
                world[p] * DAffine3::from_rotation_translation(turn, place)
            }
        };
        world.push(placed);
    }
    for (w, joint) in world.iter_mut().zip(joints) {
        *w *= DAffine3::from_translation(-*joint);
    }
}

/// The blend of bones that moves a vertex, `Σ w_b A_b`; `row` holds bones and their weights.
pub fn blended(row: &[(u32, f64)], bones: &[DAffine3]) -> DAffine3 {
    let mut sum = DAffine3 {
        matrix3: DMat3::ZERO,
        translation: DVec3::ZERO,
    };
    for &(b, w) in row {
        sum.matrix3 += bones[b as usize].matrix3 * w;
        sum.translation += bones[b as usize].translation * w;
    }
    sum
}

/// Linear blend skinning: `x' = (Σ w_b A_b) x`.
pub(crate) fn skin(rest: &[DVec3], rig: &Rig, bones: &[DAffine3]) -> Vec<DVec3> {
    let rows: Vec<[f64; 12]> = bones.iter().map(DAffine3::to_cols_array).collect();
    let blend = |(x, row): (&DVec3, &[(u32, f64)])| {
        let mut sum = [0.0; 12];
        for &(b, w) in row {
            let a = &rows[b as usize];
            for k in 0..12 {
                sum[k] += w * a[k];
            }
        }
        DMat3::from_cols_slice(&sum[..9]) * *x + DVec3::from_slice(&sum[9..])
    };
    rest.iter().zip(rig.weights.rows()).map(blend).collect()
}
