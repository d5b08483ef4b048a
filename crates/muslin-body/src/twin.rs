//! Our body in the likeness of somebody else's character: the same proportions, the same skin as far
//! as cloth minds, moved by the same joints.
//!
//! Our skin takes the character's stance, is bent so that joints meet, and drawn over its skin. What
//! is cut on our body, and all that moves it, then goes for the character. Its own mesh is posed by
//! `world_from_joint = M B⁻¹ bound`, with `M` our bones in the pose and `B` the same bones in the
//! stance that the character was bound in; our skin as well, so that one lies on the other in any pose.

mod joints;
mod warp;
mod wrap;

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use muslin_geom::{Mesh, Surface, intersecting_pairs, vertex_normals};

use crate::avatar::Bound;
use crate::pose::{blended, skin};
use crate::retarget::{Memory, Stance, Target};
use crate::{Avatar, Blend, BodyError, Character, Figure, Part, Pose, Posed, Shape, Sparse};
pub(crate) use joints::Joints;
use warp::Warp;
use wrap::{Cover, Under, pairs};

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
    /// The place of our skin that each of the character's vertices goes with where flesh gives way.
    on_skin: Vec<Option<([u32; 3], [f64; 3])>>,
    bound: Vec<DAffine3>,
    joints: Vec<DAffine3>,
    parents: Vec<Option<usize>>,
}

/// Limbs that are told apart: arms, then legs, left before right; 0 is the rest.
const LIMBS: [(&[&str], &str); 4] = [
    (&["upperarm", "lowerarm", "wrist", "metacarpal", "finger"], ".L"),
    (&["upperarm", "lowerarm", "wrist", "metacarpal", "finger"], ".R"),
    (&["upperleg", "lowerleg", "foot", "toe"], ".L"),
    (&["upperleg", "lowerleg", "foot", "toe"], ".R"),
];
/// How far the nearest skin is looked for [m].
const FAR: f64 = 1.0;
/// A vertex of the character that lies within this of our skin goes with it [m].
const NEAR: f64 = 0.05;
/// How far from the rest pose to the bound stance arms are held out to be dressed, the first that is
/// enough, and the room on either side [m].
const ARMS_OUT: [f64; 4] = [0.0, 0.25, 0.5, 0.75];
const SLEEVE: f64 = 0.01;
/// The tights lie at least this far off the skin [m].
const OFF: f64 = 0.003;
/// A vertex farther than this outside our skin is seen through cloth [m].
const SEEN: f64 = 0.003;

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
    /// ([`Posed::bones`]). Joints that the hips hang from stay.
    pub fn joints(&self, bones: &[DAffine3]) -> Vec<DAffine3> {
        let moved = |(j, follows): (&DAffine3, &Option<usize>)| match follows {
            Some(b) => bones[*b] * self.bound[*b].inverse() * *j,
            None => *j,
        };
        self.joints.iter().zip(&self.follows).map(moved).collect()
    }

    /// The character's vertices [m] when our bones are moved by `bones` and our skin from where they
    /// take it by `yielded` [m] (nothing, or one for each of its vertices).
    pub fn posed(
        &self,
        character: &Character,
        bones: &[DAffine3],
        yielded: &[DVec3],
    ) -> Vec<DVec3> {
        let pairs = self.joints(bones).into_iter().zip(&self.joints);
        let moved: Vec<DAffine3> = pairs.map(|(now, bound)| now * bound.inverse()).collect();
        let rows = character.verts.iter().zip(character.weights.rows());
        let places = rows.map(|(p, row)| blended(row, &moved).transform_point3(*p));
        places.zip(self.yielded(yielded)).map(|(p, by)| p + by).collect()
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

    /// Our pose where the character's joints are at `joints` (`world_from_joint`).
    ///
    /// Only turns are taken, and the place of the hips: joints that move apart are not followed.
    pub fn pose_of(&self, joints: &[DAffine3]) -> Pose {
        let turn = |a: &DAffine3| {
            let m = a.matrix3;
            let unit = glam::DMat3::from_cols(
                m.x_axis.normalize_or_zero(),
                m.y_axis.normalize_or_zero(),
                m.z_axis.normalize_or_zero(),
            );
            DQuat::from_mat3(&unit).normalize()
        };
        let rig = self.avatar.rig();
        let mut by: Vec<Option<usize>> = vec![None; rig.n_bones()];
        for (j, b) in self.follows.iter().enumerate() {
            let is_first = self.parents[j].is_none_or(|p| self.follows[p] != *b);
            if let (Some(b), true) = (b, is_first) {
                by[*b].get_or_insert(j);
            }
        }
        let mut pose = Pose::rest(&self.avatar);
        let mut world = vec![DQuat::IDENTITY; rig.n_bones()];
        for (b, bone) in rig.bones.iter().enumerate() {
            let above = bone.parent.map_or(DQuat::IDENTITY, |p| world[p]);
            let source = by[b].map(|j| {
                turn(&joints[j]) * turn(&self.joints[j]).inverse() * turn(&self.bound[b])
            });
            world[b] = source.unwrap_or(above * self.still(b));
            pose.rotations[b] = (above.inverse() * world[b]).normalize();
        }
        let head = |b: usize| self.avatar.mean()[self.avatar.head_point(b)];
        if let Some(j) = by[0] {
            let at = self.bound[0].transform_point3(head(0));
            let moved = joints[j] * self.joints[j].inverse();
            pose.root = moved.transform_point3(at) - head(0);
        }
        pose
    }

    /// How a bone is turned in its parent's frame in the stance that the character was bound in.
    fn still(&self, b: usize) -> DQuat {
        let of = |b: usize| DQuat::from_mat3(&self.bound[b].matrix3).normalize();
        let above = self.avatar.rig().bones[b].parent.map_or(DQuat::IDENTITY, of);
        above.inverse() * of(b)
    }
}

/// A likeness in the making.
struct Maker<'a> {
    base: &'a Avatar,
    /// Our body at rest, as large as the character.
    figure: Figure,
    /// The same in the character's stance.
    posed: Posed,
    /// That stance.
    pose: Pose,
    character: &'a Character,
    joints: &'a Joints,
    warp: Warp,
    /// Limb of each of our vertices if it is of one alone, and of each of the character's.
    own: Vec<Option<usize>>,
    theirs: Vec<usize>,
}

impl<'a> Maker<'a> {
    fn new(
        base: &'a Avatar,
        shape: &Shape,
        (character, joints): (&'a Character, &'a Joints),
    ) -> Result<Maker<'a>, BodyError> {
        let mut figure = base.figure(shape)?;
        let points = character.places().iter().map(|p| [*p, *p]).collect::<Vec<_>>();
        let stance = joints.roles.stance(&points);
        let size = |s: &Stance| {
            let trunk = s.hips().distance(0.5 * (s.arm[0][0] + s.arm[1][0]));
            trunk + s.leg.iter().map(|l| l[0].distance(l[1]) + l[1].distance(l[2])).sum::<f64>() / 2.0
        };
        let scale = size(&stance) / size(&Target::new(base, &figure)?.rest).max(1e-9);
        let all = figure.verts.iter_mut().chain(&mut figure.joints);
        all.chain(&mut figure.tails).for_each(|p| *p *= scale);
        let target = Target::new(base, &figure)?;
        let pose = target.pose(&stance, stance.hips(), &mut [Memory::default(); 4]);
        let posed = base.pose(&figure, &pose);
        let limb_of = |b: usize| limb(&base.rig().bones[b].name);
        let own = base.rig().weights.rows().map(|row| {
            let mut share = [0.0; 5];
            row.iter().for_each(|w| share[limb_of(w.0 as usize)] += w.1);
            (0..5).find(|l| share[*l] > 0.95)
        });
        let theirs = character.weights.rows().map(|row| {
            let mut share = [0.0; 5];
            for w in row {
                share[joints.follows[w.0 as usize].map_or(0, limb_of)] += w.1;
            }
            (0..5).max_by(|a, b| share[*a].total_cmp(&share[*b])).unwrap_or(0)
        });
        let (own, theirs): (Vec<_>, Vec<_>) = (own.collect(), theirs.collect());
        let warp = {
            let limb: Vec<usize> = own.iter().map(|l| l.unwrap_or(0)).collect();
            let ours = Body {
                stance: ours_posed(base, &figure, &posed)?,
                verts: &posed.verts[base.part(Part::Body)],
                limb: &limb,
            };
            let theirs = Body { stance, verts: &character.verts, limb: &theirs };
            let (from, to) = correspondences(&ours, &theirs);
            Warp::new(&from, &to).ok_or(BodyError::Corrupt("joints in one plane"))?
        };
        Ok(Maker { base, figure, posed, pose, character, joints, warp, own, theirs })
    }

    fn make(&self, whole: &Character) -> Result<Twin, BodyError> {
        let base = self.base;
        let skin_range = base.part(Part::Body);
        let mut drawn: Vec<DVec3> = self.posed.verts[skin_range.clone()]
            .iter()
            .map(|p| self.warp.at(*p))
            .collect();
        let (edges, pull) = self.stiffness();
        let cover = Cover {
            faces: base.collision_faces(),
            edges,
            pull,
            limb: self.own[skin_range.clone()].to_vec(),
        };
        let bare = self.bare();
        let under = Under {
            verts: &self.character.verts,
            faces: &self.character.faces,
            limb: &self.theirs,
            bare: &bare,
            height: self.character.height(),
        };
        cover.draw_over(&under, &mut drawn);
        let (bound, rest_heads, rest_tails) = self.bones();
        let unbind: Vec<DAffine3> = bound.iter().map(DAffine3::inverse).collect();
        let weights = self.weights(&drawn, &cover.edges);
        let rest = self.rest(&drawn, (&unbind, &weights));
        let uncovered = uncovered(&drawn, base.collision_faces(), &under);
        let own = Surface::new(&drawn, base.collision_faces());
        let on_skin = whole.verts.iter().map(|p| {
            let hit = own.closest(*p, NEAR)?;
            Some((own.faces()[hit.face as usize], hit.weights))
        });
        let avatar = self.avatar(rest, (&rest_heads, &rest_tails), weights, (&drawn, unbind))?;
        Ok(Twin {
            avatar,
            follows: self.joints.follows.clone(),
            uncovered,
            on_skin: on_skin.collect(),
            bound,
            joints: whole.bound.clone(),
            parents: whole.parents.clone(),
        })
    }

    /// Pairs of neighbours with their stiffness, and how much the character's skin pulls.
    ///
    /// Hands keep their shape, and so, a little, do heads and toes.
    fn stiffness(&self) -> (Vec<([u32; 2], f64)>, Vec<f64>) {
        let base = self.base;
        let n = base.part(Part::Body).len();
        let share = |names: &[&str]| -> Vec<f64> {
            let bones = &base.rig().bones;
            let ours: Vec<bool> = bones
                .iter()
                .map(|b| names.iter().any(|s| b.name.starts_with(s)))
                .collect();
            let rows = base.rig().weights.rows().take(n);
            rows.map(|row| row.iter().filter(|w| ours[w.0 as usize]).map(|w| w.1).sum())
                .collect()
        };
        let hand = share(&["finger", "metacarpal"]);
        let toes = share(&["toe"]);
        let trunk = share(&[
            "root", "spine", "pelvis", "breast", "upper", "lower", "clavicle", "shoulder", "wrist",
            "foot", "neck", "finger", "metacarpal", "toe",
        ]);
        let mut outer = vec![false; n];
        base.collision_faces().as_flattened().iter().for_each(|v| outer[*v as usize] = true);
        let pull = (0..n).map(|i| match outer[i] {
            false => 0.0,
            true if hand[i] > 0.5 => 0.0,
            true => 1.0 - 0.7 * toes[i].min(1.0),
        });
        let kind = |i: usize| 1.0 + 100.0 * hand[i] + 10.0 * toes[i] + 4.0 * (1.0 - trunk[i]).max(0.0);
        let edges = pairs(base.quads(Part::Body)).into_iter().map(|[a, b]| {
            let stiff = kind(a as usize).min(kind(b as usize));
            ([a, b], stiff)
        });
        (edges.collect(), pull.collect())
    }

    /// Which of the character's vertices are to be covered: not hands, nor head.
    fn bare(&self) -> Vec<bool> {
        let bones = &self.base.rig().bones;
        let is_bare = |row: &[(u32, f64)]| {
            let most = row.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            let bone = most.and_then(|w| self.joints.follows[w.0 as usize]);
            bone.is_some_and(|b| !["wrist", "head"].iter().any(|n| bones[b].name.starts_with(n)))
        };
        self.character.weights.rows().map(is_bare).collect()
    }

    /// `B`, and where heads and tails of the bones are at rest [m].
    fn bones(&self) -> (Vec<DAffine3>, Vec<DVec3>, Vec<DVec3>) {
        let places = self.character.places();
        let bones = &self.base.rig().bones;
        let bent = |b: usize, p: DVec3| self.warp.at(self.posed.bones[b].transform_point3(p));
        let turn = |b: usize| DQuat::from_mat3(&self.posed.bones[b].matrix3).normalize();
        let n = bones.len();
        let head = |b: usize| match self.joints.heads[b] {
            Some(j) => places[j],
            None => bent(b, self.figure.joints[b]),
        };
        let heads: Vec<DVec3> = (0..n).map(head).collect();
        let mut tails: Vec<DVec3> = (0..n).map(|b| bent(b, self.figure.tails[b])).collect();
        for (b, bone) in bones.iter().enumerate() {
            // A bone that ended where another begins still does.
            if let Some(p) = bone.parent
                && bones[p].tail == bone.head
            {
                tails[p] = heads[b];
            }
        }
        let mut rest: Vec<DVec3> = Vec::with_capacity(n);
        for (b, bone) in bones.iter().enumerate() {
            let at = match bone.parent {
                None => heads[b],
                Some(p) => rest[p] + turn(p).inverse() * (heads[b] - heads[p]),
            };
            rest.push(at);
        }
        let rest_tails = (0..n).map(|b| rest[b] + turn(b).inverse() * (tails[b] - heads[b]));
        let rest_tails: Vec<DVec3> = rest_tails.collect();
        let bound = (0..n).map(|b| {
            DAffine3::from_rotation_translation(turn(b), heads[b]) * DAffine3::from_translation(-rest[b])
        });
        let bound = bound.collect();
        (bound, rest, rest_tails)
    }

    /// Our skin's weights, those of the character's skin below it.
    fn weights(&self, drawn: &[DVec3], edges: &[([u32; 2], f64)]) -> Sparse {
        let (base, c) = (self.base, self.character);
        let bones = &base.rig().bones;
        let surfaces: Vec<Surface> = (0..5)
            .map(|l| {
                let faces = c.faces.iter();
                let own = faces.filter(|f| f.iter().any(|v| self.theirs[*v as usize] == l));
                Surface::new(&c.verts, &own.copied().collect::<Vec<_>>())
            })
            .collect();
        let whole = Surface::new(&c.verts, &c.faces);
        let below = |i: usize| -> Vec<(u32, f64)> {
            let own = base.rig().weights.row(i);
            let hand: f64 = (own.iter())
                .filter(|w| {
                    let name = &bones[w.0 as usize].name;
                    name.starts_with("finger") || name.starts_with("metacarpal")
                })
                .map(|w| w.1)
                .sum();
            let wrist = |l: usize| bones.iter().position(|b| b.name == ["wrist.L", "wrist.R"][l - 1]);
            if let (true, Some(l @ 1..=2)) = (hand > 0.5, self.own[i])
                && let Some(b) = wrist(l)
                && self.joints.heads[b].is_some()
            {
                return vec![(b as u32, 1.0)];
            }
            let surface = self.own[i].map_or(&whole, |l| &surfaces[l]);
            let Some(hit) = surface.closest(drawn[i], FAR) else {
                return own.to_vec();
            };
            let face = surface.faces()[hit.face as usize];
            let rows = face.iter().zip(hit.weights).flat_map(|(v, s)| {
                let row = c.weights.row(*v as usize).iter();
                row.map(move |w| (self.joints.follows[w.0 as usize].unwrap_or(0) as u32, w.1 * s))
            });
            summed(rows)
        };
        let mut rows: Vec<Vec<(u32, f64)>> = (0..drawn.len()).map(below).collect();
        let mut near = vec![Vec::new(); drawn.len()];
        for ([a, b], _) in edges {
            near[*a as usize].push(*b as usize);
            near[*b as usize].push(*a as usize);
        }
        for _ in 0..2 {
            let mixed = |i: usize| {
                let share = 0.5 / near[i].len().max(1) as f64;
                let others = near[i].iter().flat_map(|j| rows[*j].iter().map(|w| (w.0, w.1 * share)));
                let own = rows[i].iter().map(|w| (w.0, w.1 * 0.5));
                summed(own.chain(others))
            };
            rows = (0..rows.len()).map(mixed).collect();
        }
        let mut weights = Sparse::new();
        rows.into_iter().for_each(|row| weights.push(row));
        let n = drawn.len();
        for row in base.rig().weights.rows().skip(n) {
            weights.push(row.iter().copied());
        }
        weights
    }

    /// All vertices at rest [m]: the skin out of its stance, what hangs around it carried along.
    fn rest(&self, drawn: &[DVec3], (unbind, weights): (&[DAffine3], &Sparse)) -> Vec<DVec3> {
        let base = self.base;
        let n = drawn.len();
        let mut rest: Vec<DVec3> = (0..n)
            .map(|i| blended(weights.row(i), unbind).transform_point3(drawn[i]))
            .collect();
        let before = Surface::new(&self.figure.verts, base.collision_faces());
        let carried = |p: &DVec3| match before.closest(*p, FAR) {
            Some(hit) => {
                let face = before.faces()[hit.face as usize];
                let moves = face.iter().zip(hit.weights);
                let by: DVec3 = moves
                    .map(|(v, w)| (rest[*v as usize] - self.figure.verts[*v as usize]) * w)
                    .sum();
                *p + by
            }
            None => *p,
        };
        let around: Vec<DVec3> = self.figure.verts[n..].iter().map(carried).collect();
        rest.extend(around);
        for part in [Part::Tights, Part::Skirt] {
            let after = Surface::new(&rest, base.collision_faces());
            for i in base.part(part) {
                if let Some(hit) = after.closest(rest[i], 0.05)
                    && hit.signed < OFF
                {
                    rest[i] = hit.point + hit.normal * OFF;
                }
            }
        }
        rest
    }

    /// Whether both arms leave room for a sleeve and a shirt between them and the trunk.
    fn arms_are_clear(&self, verts: &[DVec3]) -> bool {
        let faces = self.base.collision_faces();
        let skin = &verts[self.base.part(Part::Body)];
        let normals = vertex_normals(skin, faces);
        let grown = skin.iter().zip(&normals).map(|(p, n)| *p + *n * SLEEVE);
        let grown: Vec<DVec3> = grown.collect();
        let of = |limb: usize| Mesh {
            verts: grown.clone(),
            faces: faces
                .iter()
                .filter(|f| f.iter().all(|v| self.own[*v as usize] == Some(limb)))
                .copied()
                .collect(),
        };
        let trunk = of(0);
        [1, 2].iter().all(|arm| intersecting_pairs(&of(*arm), &trunk).is_empty())
    }

    fn avatar(
        &self,
        rest: Vec<DVec3>,
        (heads, tails): (&[DVec3], &[DVec3]),
        weights: Sparse,
        (drawn, unbind): (&[DVec3], Vec<DAffine3>),
    ) -> Result<Avatar, BodyError> {
        let base = self.base;
        let mut parts = base.parts.clone();
        let n = base.n_verts();
        parts.mean.truncate(n);
        parts.mean.copy_from_slice(&rest);
        let anchors = base.n_points() - n;
        let mut places = vec![None; anchors];
        for (b, bone) in base.rig().bones.iter().enumerate() {
            places[bone.head as usize].get_or_insert(heads[b]);
        }
        for (b, bone) in base.rig().bones.iter().enumerate() {
            places[bone.tail as usize].get_or_insert(tails[b]);
        }
        parts.mean.extend(places.into_iter().map(Option::unwrap_or_default));
        (parts.modes, parts.blend, parts.targets) = (Vec::new(), Blend::default(), Vec::new());
        parts.rig.weights = weights;
        let mut avatar = Avatar::new(parts)?;
        let weights = &avatar.rig().weights;
        let back = |i: usize| match drawn.get(i) {
            Some(p) => *p,
            None => blended(weights.row(i), &unbind).inverse().transform_point3(rest[i]),
        };
        let verts: Vec<DVec3> = (0..n).map(back).collect();
        debug_assert!(skin(&verts, avatar.rig(), &unbind).iter().zip(&rest).all(|(a, b)| a.distance(*b) < 1e-6));
        // Heads at rest are where the root is in the stance, so that nothing is left to go.
        let pose = Pose {
            root: DVec3::ZERO,
            ..self.pose.clone()
        };
        let rest = Pose::rest(&avatar);
        let mut bound = Bound { verts, unbind, dressing: rest.clone() };
        avatar.standard = Some(Arc::new(base.standard()?));
        avatar.bound = Some(Arc::new(bound.clone()));
        let figure = avatar.figure(&Shape::default())?;
        let away = |t: &f64| self.arms_are_clear(&avatar.pose(&figure, &rest.toward(&pose, *t)).verts);
        let out = ARMS_OUT.iter().find(|t| away(t)).unwrap_or(&1.0);
        bound.dressing = rest.toward(&pose, *out);
        avatar.bound = Some(Arc::new(bound));
        Ok(avatar)
    }
}

/// Where our limbs are in a pose [m].
fn ours_posed(base: &Avatar, figure: &Figure, posed: &Posed) -> Result<Stance, BodyError> {
    let at = |name: &str| -> Result<DVec3, BodyError> {
        let b = base.bone(name)?;
        Ok(posed.bones[b].transform_point3(figure.joints[b]))
    };
    let limb = |names: [&str; 3], side: &str| -> Result<[DVec3; 3], BodyError> {
        let [a, b, c] = names.map(|n| at(&format!("{n}.{side}")));
        Ok([a?, b?, c?])
    };
    let (leg, arm) = (["upperleg01", "lowerleg01", "foot"], ["upperarm01", "lowerarm01", "wrist"]);
    Ok(Stance {
        leg: [limb(leg, "L")?, limb(leg, "R")?],
        arm: [limb(arm, "L")?, limb(arm, "R")?],
        toe: [Some(at("toe3-1.L")?), Some(at("toe3-1.R")?)],
        hand: [None, None],
        neck: Some(at("neck01")?),
        head: Some(at("head")?),
    })
}

/// A body whose like points are to be found on another.
struct Body<'a> {
    stance: Stance,
    verts: &'a [DVec3],
    limb: &'a [usize],
}

/// Points of one body, and where they are on the other [m].
fn correspondences(ours: &Body, theirs: &Body) -> (Vec<DVec3>, Vec<DVec3>) {
    let (mut from, mut to) = (Vec::new(), Vec::new());
    let mut add = |a: Option<DVec3>, b: Option<DVec3>| {
        if let (Some(a), Some(b)) = (a, b)
            && from.iter().all(|f: &DVec3| f.distance(a) > 0.01)
        {
            from.push(a);
            to.push(b);
        }
    };
    let (a, b) = (&ours.stance, &theirs.stance);
    for s in 0..2 {
        for k in 0..3 {
            add(Some(a.leg[s][k]), Some(b.leg[s][k]));
            add(Some(a.arm[s][k]), Some(b.arm[s][k]));
        }
        add(ours.sole(s), theirs.sole(s));
        add(ours.fingertip(s), theirs.fingertip(s));
        add(ours.toe_tip(s), theirs.toe_tip(s));
        for k in 0..2 {
            for t in [0.3, 0.7] {
                for way in 0..4 {
                    let leg = |body: &Body| body.around(3 + s, &body.stance.leg[s][k..], (t, way));
                    add(leg(ours), leg(theirs));
                    let arm = |body: &Body| body.around(1 + s, &body.stance.arm[s][k..], (t, way));
                    add(arm(ours), arm(theirs));
                }
            }
        }
    }
    add(a.neck, b.neck);
    if b.neck.is_some() {
        add(a.head, b.head);
    }
    add(ours.crown(), theirs.crown());
    for way in 0..4 {
        // Across, the shoulders are the arms' concern.
        let levels = if way < 2 { 0.0..0.9 } else { 0.0..0.5 };
        for t in [0.0, 0.3, 0.6, 0.85].into_iter().filter(|t| levels.contains(t)) {
            let trunk = |body: &Body| body.around(0, &body.trunk(), (t, way));
            add(trunk(ours), trunk(theirs));
        }
        let head = |body: &Body| body.around(0, &body.head()?, (0.5, way));
        add(head(ours), head(theirs));
    }
    (from, to)
}

impl Body<'_> {
    fn of(&self, limb: usize) -> impl Iterator<Item = DVec3> {
        let all = self.verts.iter().zip(self.limb);
        all.filter(move |(_, l)| **l == limb).map(|(p, _)| *p)
    }

    /// Straight below the ankle.
    fn sole(&self, side: usize) -> Option<DVec3> {
        let low = self.of(3 + side).map(|p| p.y).reduce(f64::min)?;
        Some(self.stance.leg[side][2].with_y(low))
    }

    fn toe_tip(&self, side: usize) -> Option<DVec3> {
        self.of(3 + side)
            .filter(|p| p.y < self.stance.leg[side][2].y)
            .max_by(|a, b| a.z.total_cmp(&b.z))
    }

    /// The end of the hand along the forearm.
    fn fingertip(&self, side: usize) -> Option<DVec3> {
        let [_, elbow, wrist] = self.stance.arm[side];
        let along = (wrist - elbow).normalize_or_zero();
        let reach = self.of(1 + side).map(|p| (p - wrist).dot(along)).reduce(f64::max)?;
        Some(wrist + along * reach)
    }

    fn crown(&self) -> Option<DVec3> {
        let top = self.of(0).max_by(|a, b| a.y.total_cmp(&b.y))?;
        Some(DVec3::new(self.stance.hips().x, top.y, self.stance.neck.or(self.stance.head)?.z))
    }

    /// From the hips to the shoulders.
    fn trunk(&self) -> [DVec3; 2] {
        let shoulders = 0.5 * (self.stance.arm[0][0] + self.stance.arm[1][0]);
        [self.stance.hips(), shoulders]
    }

    /// From the lower end of the head or neck to the crown.
    fn head(&self) -> Option<[DVec3; 2]> {
        Some([self.stance.neck.or(self.stance.head)?, self.crown()?])
    }

    /// The farthest skin from the line between two places, a share of the way along it, to one of four
    /// sides: before, behind, and across.
    fn around(&self, limb: usize, line: &[DVec3], (t, way): (f64, usize)) -> Option<DVec3> {
        let along = line[1] - line[0];
        let at = line[0] + along * t;
        let across = along.cross(DVec3::Z).normalize_or(DVec3::X);
        let side = [DVec3::Z, DVec3::NEG_Z, across, -across][way];
        let thick = 0.06 * along.length();
        let near = self.of(limb).filter(|p| (*p - at).dot(along).abs() < thick * along.length());
        let reach = near.map(|p| (p - at).dot(side)).reduce(f64::max)?;
        Some(at + side * reach.max(0.0))
    }
}

/// 0, or one more than the place in [`LIMBS`].
fn limb(bone: &str) -> usize {
    let is = |(names, side): &(&[&str], &str)| bone.ends_with(side) && names.iter().any(|n| bone.starts_with(n));
    LIMBS.iter().position(is).map_or(0, |l| l + 1)
}

/// Equal columns added up, the weakest left out, and made to sum to one.
fn summed(row: impl Iterator<Item = (u32, f64)>) -> Vec<(u32, f64)> {
    let mut sums: Vec<(u32, f64)> = Vec::new();
    for (b, w) in row {
        match sums.iter_mut().find(|s| s.0 == b) {
            Some(s) => s.1 += w,
            None => sums.push((b, w)),
        }
    }
    sums.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    sums.truncate(8);
    let total: f64 = sums.iter().map(|s| s.1).sum();
    sums.into_iter().map(|(b, w)| (b, w / total)).collect()
}

/// Share of what is to be covered that is seen outside the skin all the same.
fn uncovered(drawn: &[DVec3], faces: &[[u32; 3]], under: &Under) -> f64 {
    let own = Surface::new(drawn, faces);
    let bare = || under.bare.iter().enumerate().filter(|b| *b.1).map(|b| b.0);
    let seen = |i: &usize| own.closest(under.verts[*i], 0.2).is_none_or(|h| h.signed > SEEN);
    bare().filter(seen).count() as f64 / bare().count().max(1) as f64
}
