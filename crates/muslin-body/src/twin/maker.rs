//! How a likeness is made.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use muslin_geom::{Mesh, Surface, intersecting_pairs, vertex_normals};

use super::covering::Covering;
use super::likes::{Likes, correspondences, standing};
use super::warp::Warp;
use super::wrap::{Cover, SIDES, Sides, Under, neighbours, pairs};
use super::{Joints, Twin};
use crate::avatar::Bound;
use crate::pose::{blended, skin};
use crate::retarget::{Memory, Stance, Target};
use crate::sparse::strongest;
use crate::{Avatar, Blend, BodyError, Character, Figure, Part, Pose, Posed, Shape, Sparse};

/// Limbs that are told apart: arms, then legs, left before right; 0 is the rest.
const LIMBS: [(&[&str], &str); 4] = [
    (
        &["upperarm", "lowerarm", "wrist", "metacarpal", "finger"],
        ".L",
    ),
    (
        &["upperarm", "lowerarm", "wrist", "metacarpal", "finger"],
        ".R",
    ),
    (&["upperleg", "lowerleg", "foot", "toe"], ".L"),
    (&["upperleg", "lowerleg", "foot", "toe"], ".R"),
];
/// Bones that move a vertex of our skin at most.
const INFLUENCES: usize = 8;
/// How far the nearest skin is looked for [m].
const FAR: f64 = 1.0;
/// A vertex of the character that lies within this of our skin goes with it [m].
const NEAR: f64 = 0.05;
/// How far from the rest pose to the bound stance arms are held out to be dressed, the first that is
/// enough, and the room on either side [m].
const ARMS_OUT: [f64; 4] = [0.0, 0.25, 0.5, 0.75];
const SLEEVE: f64 = 0.01;
/// Our skin has met the character's within this share of its height.
const MET: f64 = 0.03;
/// The tights lie at least this far off the skin [m].
const OFF: f64 = 0.003;
/// A vertex farther than this outside our skin is seen through cloth [m].
const SEEN: f64 = 0.003;

/// A likeness in the making.
pub(super) struct Maker<'a> {
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
    pub fn new(
        base: &'a Avatar,
        shape: &Shape,
        (character, joints): (&'a Character, &'a Joints),
    ) -> Result<Maker<'a>, BodyError> {
        let mut figure = base.figure(shape)?;
        let points = character
            .places()
            .iter()
            .map(|p| [*p, *p])
            .collect::<Vec<_>>();
        let stance = joints.roles.stance(&points);
        let size = |s: &Stance| {
            let trunk = s.hips().distance(0.5 * (s.arm[0][0] + s.arm[1][0]));
            trunk
                + s.leg
                    .iter()
                    .map(|l| l[0].distance(l[1]) + l[1].distance(l[2]))
                    .sum::<f64>()
                    / 2.0
        };
        let scale = size(&stance) / size(&Target::new(base, &figure)?.rest).max(1e-9);
        let all = figure.verts.iter_mut().chain(&mut figure.joints);
        all.chain(&mut figure.tails).for_each(|p| *p *= scale);
        let target = Target::new(base, &figure)?;
        let pose = target.pose(&stance, stance.hips(), &mut [Memory::default(); 4]);
        let posed = base.pose(&figure, &pose);
        let limb_of = |b: usize| limb(&base.rig().bones[b].name);
        let own = base.rig().weights.rows().map(|row| {
            let mut share = [0.0; SIDES];
            row.iter().for_each(|w| share[limb_of(w.0 as usize)] += w.1);
            (0..SIDES).find(|l| share[*l] > 0.95)
        });
        let theirs = character.weights.rows().map(|row| {
            let mut share = [0.0; SIDES];
            for w in row {
                share[joints.follows[w.0 as usize].map_or(0, limb_of)] += w.1;
            }
            (0..SIDES)
                .max_by(|a, b| share[*a].total_cmp(&share[*b]))
                .unwrap_or(0)
        });
        let (own, theirs): (Vec<_>, Vec<_>) = (own.collect(), theirs.collect());
        let warp = {
            let limb: Vec<usize> = own.iter().map(|l| l.unwrap_or(0)).collect();
            let ours = Likes {
                stance: standing(base, &figure, &posed)?,
                verts: &posed.verts[base.part(Part::Body)],
                limb: &limb,
            };
            let theirs = Likes {
                stance,
                verts: &character.verts,
                limb: &theirs,
            };
            let (from, to) = correspondences(&ours, &theirs);
            Warp::new(&from, &to)
                .ok_or(BodyError::NoBody("its joints and skin lie in one plane"))?
        };
        Ok(Maker {
            base,
            figure,
            posed,
            pose,
            character,
            joints,
            warp,
            own,
            theirs,
        })
    }

    pub fn make(&self, whole: &Character) -> Result<Twin, BodyError> {
        let base = self.base;
        let body = base.part(Part::Body);
        let mut drawn: Vec<DVec3> = self.posed.verts[body.clone()]
            .iter()
            .map(|p| self.warp.at(*p))
            .collect();
        let (edges, pull) = self.stiffness();
        let cover = Cover {
            faces: base.collision_faces(),
            edges,
            pull,
            limb: self.own[body].to_vec(),
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
        let unmet = unmet((&drawn, &cover.pull), &under);
        let own = Surface::new(&drawn, base.collision_faces());
        let on_skin = whole.verts.iter().map(|p| {
            let hit = own.closest(*p, NEAR)?;
            Some((own.faces()[hit.face as usize], hit.weights))
        });
        let covering = Covering::new((&drawn, base.collision_faces()), whole, |i| {
            cover.pull[i] > 0.0
        });
        let avatar = self.avatar(rest, (&rest_heads, &rest_tails), weights, (&drawn, unbind))?;
        Ok(Twin {
            avatar,
            follows: self.joints.follows.clone(),
            uncovered,
            unmet,
            on_skin: on_skin.collect(),
            covering,
            bound,
            joints: whole.bound.clone(),
            leads: self.joints.leads(whole),
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
            "root",
            "spine",
            "pelvis",
            "breast",
            "upper",
            "lower",
            "clavicle",
            "shoulder",
            "wrist",
            "foot",
            "neck",
            "finger",
            "metacarpal",
            "toe",
        ]);
        let mut outer = vec![false; n];
        base.collision_faces()
            .as_flattened()
            .iter()
            .for_each(|v| outer[*v as usize] = true);
        let pull = (0..n).map(|i| match outer[i] {
            false => 0.0,
            true if hand[i] > 0.5 => 0.0,
            true => 1.0 - 0.7 * toes[i].min(1.0),
        });
        let kind =
            |i: usize| 1.0 + 100.0 * hand[i] + 10.0 * toes[i] + 4.0 * (1.0 - trunk[i]).max(0.0);
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
            bone.is_some_and(|b| {
                !["wrist", "head"]
                    .iter()
                    .any(|n| bones[b].name.starts_with(n))
            })
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
        // Bones that begin in one point go on doing so.
        let joint = |b: usize| {
            let alike = |o: &usize| bones[*o].head == bones[b].head;
            let mut all = std::iter::once(b).chain((0..n).filter(alike));
            all.find_map(|o| self.joints.heads[o])
        };
        let head = |b: usize| match joint(b) {
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
            DAffine3::from_rotation_translation(turn(b), heads[b])
                * DAffine3::from_translation(-rest[b])
        });
        let bound = bound.collect();
        (bound, rest, rest_tails)
    }

    /// Our skin's weights, those of the character's skin below it.
    fn weights(&self, drawn: &[DVec3], edges: &[([u32; 2], f64)]) -> Sparse {
        let (base, c) = (self.base, self.character);
        let bones = &base.rig().bones;
        let sides = Sides::new(&c.verts, &c.faces, &self.theirs);
        let below = |i: usize| -> Vec<(u32, f64)> {
            let own = base.rig().weights.row(i);
            let hand: f64 = (own.iter())
                .filter(|w| {
                    let name = &bones[w.0 as usize].name;
                    name.starts_with("finger") || name.starts_with("metacarpal")
                })
                .map(|w| w.1)
                .sum();
            let wrist = |l: usize| {
                bones
                    .iter()
                    .position(|b| b.name == ["wrist.L", "wrist.R"][l - 1])
            };
            if let (true, Some(l @ 1..=2)) = (hand > 0.5, self.own[i])
                && let Some(b) = wrist(l)
                && self.joints.heads[b].is_some()
            {
                return vec![(b as u32, 1.0)];
            }
            let surface = sides.of(self.own[i]);
            let Some(hit) = surface.closest(drawn[i], FAR) else {
                return own.to_vec();
            };
            let face = surface.faces()[hit.face as usize];
            let rows = face.iter().zip(hit.weights).flat_map(|(v, s)| {
                let row = c.weights.row(*v as usize).iter();
                row.map(move |w| {
                    (
                        self.joints.follows[w.0 as usize].unwrap_or(0) as u32,
                        w.1 * s,
                    )
                })
            });
            strongest(rows, INFLUENCES)
        };
        let mut rows: Vec<Vec<(u32, f64)>> = (0..drawn.len()).map(below).collect();
        let near = neighbours(drawn.len(), edges);
        for _ in 0..2 {
            let mixed = |i: usize| {
                let share = 0.5 / near[i].len().max(1) as f64;
                let others = near[i]
                    .iter()
                    .flat_map(|j| rows[*j].iter().map(|w| (w.0, w.1 * share)));
                let own = rows[i].iter().map(|w| (w.0, w.1 * 0.5));
                strongest(own.chain(others), INFLUENCES)
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
        [1, 2]
            .iter()
            .all(|arm| intersecting_pairs(&of(*arm), &trunk).is_empty())
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
        parts
            .mean
            .extend(places.into_iter().map(Option::unwrap_or_default));
        (parts.modes, parts.blend, parts.targets) = (Vec::new(), Blend::default(), Vec::new());
        parts.rig.weights = weights;
        let mut avatar = Avatar::new(parts)?;
        let weights = &avatar.rig().weights;
        let back = |i: usize| match drawn.get(i) {
            Some(p) => *p,
            None => blended(weights.row(i), &unbind)
                .inverse()
                .transform_point3(rest[i]),
        };
        let verts: Vec<DVec3> = (0..n).map(back).collect();
        debug_assert!(
            skin(&verts, avatar.rig(), &unbind)
                .iter()
                .zip(&rest)
                .all(|(a, b)| a.distance(*b) < 1e-6)
        );
        // Heads at rest are where the root is in the stance, so that nothing is left to go.
        let pose = Pose {
            root: DVec3::ZERO,
            ..self.pose.clone()
        };
        let rest = Pose::rest(&avatar);
        let mut bound = Bound {
            verts,
            unbind,
            dressing: rest.clone(),
        };
        avatar.standard = Some(Arc::new(base.standard()?));
        avatar.bound = Some(Arc::new(bound.clone()));
        let figure = avatar.figure(&Shape::default())?;
        let away =
            |t: &f64| self.arms_are_clear(&avatar.pose(&figure, &rest.toward(&pose, *t)).verts);
        let out = ARMS_OUT.iter().find(|t| away(t)).unwrap_or(&1.0);
        bound.dressing = rest.toward(&pose, *out);
        avatar.bound = Some(Arc::new(bound));
        Ok(avatar)
    }
}

/// 0, or one more than the place in [`LIMBS`].
fn limb(bone: &str) -> usize {
    let is = |(names, side): &(&[&str], &str)| {
        bone.ends_with(side) && names.iter().any(|n| bone.starts_with(n))
    };
    LIMBS.iter().position(is).map_or(0, |l| l + 1)
}

/// Share of our skin, as far as it is pulled, that finds none of the character's near.
fn unmet((drawn, pull): (&[DVec3], &[f64]), under: &Under) -> f64 {
    let theirs = Surface::new(under.verts, under.faces);
    let pulled = || drawn.iter().zip(pull).filter(|p| *p.1 > 0.0);
    let far = |p: &(&DVec3, &f64)| theirs.closest(*p.0, MET * under.height).is_none();
    pulled().filter(far).count() as f64 / pulled().count().max(1) as f64
}

/// Share of what is to be covered that is seen outside the skin all the same.
fn uncovered(drawn: &[DVec3], faces: &[[u32; 3]], under: &Under) -> f64 {
    let own = Surface::new(drawn, faces);
    let bare = || under.bare.iter().enumerate().filter(|b| *b.1).map(|b| b.0);
    let seen = |i: &usize| {
        own.closest(under.verts[*i], 0.2)
            .is_none_or(|h| h.signed > SEEN)
    };
    bare().filter(seen).count() as f64 / bare().count().max(1) as f64
}
