//! Cloth that meets cloth: walls between parts that a pose brings together, as at an armpit.
//!
//! A garment encloses a body, so where two of its parts meet they do so with their outer sides.
//! Each side sees the plane midway to the other as a wall. As the side is known, parts that have
//! passed through each other are led back by the same law.

use std::collections::BTreeMap;

use glam::DVec3;
use muslin_body::Sparse;
use muslin_geom::{Aabb, Bvh, Surface};

use crate::ground::{OPEN, Wall};
use crate::lanes::{LANES, Row, side_by_side};

/// Cloth this near is looked for [m].
const NEAR: f64 = 0.014;
/// Cloth that was this near at rest is the same part [m].
const SAME: f64 = 0.03;
/// Parts that share more than this of what they follow are one part: a crease in it may well have its
/// inner sides together, and no wall belongs there.
pub const PARTS: f64 = 0.6;
/// Parts that share no more than this are limbs, a leg and the other or a forearm and the trunk: nothing lies in folds
/// between them.
pub const LIMBS: f64 = 0.3;
/// Size of a lot of vertices that are asked together whether others come near [m].
const LOT: f64 = 0.03;
/// By how much a sum of what is shared may be rounded.
const ROUNDING: f64 = 1e-9;
/// Distance that parts keep from each other [m].
const APART: f64 = 0.003;

/// A cloth that can be asked where it meets itself.
#[derive(Clone, Debug)]
pub struct Folds {
    rest: Vec<DVec3>,
    weights: Sparse,
    surface: Surface,
    lots: Lots,
}

impl Folds {
    /// A cloth that lies at `rest` [m] where it does not meet itself, and follows bones by `weights`.
    pub fn new(faces: &[[u32; 3]], rest: &[DVec3], weights: &Sparse) -> Self {
        Self {
            rest: rest.to_vec(),
            weights: weights.clone(),
            surface: Surface::new(rest, faces),
            lots: Lots::new(faces, rest, weights),
        }
    }

    /// The walls of the vertices that meet another part of the cloth at `x` [m], with which they share at most `shared`
    /// ([`PARTS`], [`LIMBS`]) of what they follow, for a law that pushes below a gap of `radius` [m].
    pub fn find(&self, x: &[DVec3], (radius, shared): (f64, f64)) -> Vec<(u32, Wall)> {
        let surface = self.surface.moved(x);
        let meets = |v: usize| self.meets(&surface, v, (radius, shared));
        let one = |v: u32| meets(v as usize).map(|w| (v, w));
        let asked = self.lots.near_others(x, surface.faces(), shared);
        asked.into_iter().filter_map(one).collect()
    }

    fn meets(&self, surface: &Surface, v: usize, (radius, shared): (f64, f64)) -> Option<Wall> {
        let (p, faces) = (surface.verts()[v], surface.faces());
        let other = |f: u32| {
            let own = faces[f as usize];
            let apart = own
                .iter()
                .all(|i| self.rest[*i as usize].distance_squared(self.rest[v]) > SAME * SAME);
            match apart {
                true => surface.distance_squared(p, f),
                false => f64::INFINITY,
            }
        };
        let (face, _) = surface.bvh().nearest(p, NEAR * NEAR, other)?;
        let hit = surface.at(p, face);
        if self.shared(v, faces[face as usize][0] as usize) > shared {
            return None;
        }
        if surface.vertex_normal(v as u32).dot(hit.normal) > 0.0 {
            return None;
        }
        // Midway, and so that the law begins to push where the parts come too near.
        let depth = (p - hit.point).dot(hit.normal);
        let offset = hit.normal.dot(hit.point) + 0.5 * depth - radius + 0.5 * APART;
        let n = hit.normal.as_vec3();
        Some([n.x, n.y, n.z, offset as f32])
    }
}

impl Folds {
    /// How much of what two vertices follow is the same, 0 to 1.
    fn shared(&self, a: usize, b: usize) -> f64 {
        let other = self.weights.row(b);
        let same = |&(bone, w): &(u32, f64)| {
            other
                .iter()
                .find(|e| e.0 == bone)
                .map_or(0.0, |e| w.min(e.1))
        };
        self.weights.row(a).iter().map(same).sum()
    }
}

/// A cloth in lots of vertices that lie together at rest.
#[derive(Clone, Debug)]
struct Lots(Vec<Lot>);

/// Vertices, and the triangles that begin with them.
#[derive(Clone, Debug, Default)]
struct Lot {
    verts: Vec<u32>,
    faces: Vec<u32>,
    /// The bones that all of the vertices follow, in ascending order, and how much each of them does at least.
    follows: Vec<(u32, f64)>,
}

impl Lots {
    fn new(faces: &[[u32; 3]], rest: &[DVec3], weights: &Sparse) -> Self {
        let mut lots: BTreeMap<[i32; 3], Lot> = BTreeMap::new();
        let place = |p: DVec3| (p / LOT).floor().as_ivec3().to_array();
        for (v, p) in (0..).zip(rest) {
            lots.entry(place(*p)).or_default().verts.push(v);
        }
        for (f, face) in (0..).zip(faces) {
            let lot = lots.entry(place(rest[face[0] as usize])).or_default();
            lot.faces.push(f);
        }
        for lot in lots.values_mut() {
            let mut least: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
            for (bone, w) in lot.verts.iter().flat_map(|v| weights.row(*v as usize)) {
                let one = least.entry(*bone).or_insert((0, f64::INFINITY));
                *one = (one.0 + 1, one.1.min(*w));
            }
            let all = least.into_iter().filter(|e| e.1.0 == lot.verts.len());
            lot.follows = all.map(|(bone, (_, w))| (bone, w)).collect();
        }
        Lots(lots.into_values().collect())
    }

    /// The vertices of all lots that may come within [`NEAR`] at `x` [m] of triangles with which they share `shared` or
    /// less, in ascending order.
    fn near_others(&self, x: &[DVec3], faces: &[[u32; 3]], shared: f64) -> Vec<u32> {
        let boxes = |of: fn(&Lot) -> &[u32], at: &dyn Fn(u32) -> Aabb| -> Vec<Aabb> {
            let one = |lot: &Lot| of(lot).iter().fold(Aabb::EMPTY, |b, i| b.union(at(*i)));
            self.0.iter().map(one).collect()
        };
        let verts = boxes(|l| &l.verts, &|v| Aabb::of(&[x[v as usize]]).grown(NEAR));
        let faces = boxes(|l| &l.faces, &|f| Aabb::of_face(x, faces[f as usize]));
        let tree = Bvh::over(&faces);
        let mut asked = Vec::new();
        for (lot, around) in self.0.iter().zip(&verts) {
            let mut meets = false;
            tree.near(around, |other| {
                meets |= lot.shares(&self.0[other as usize]) <= shared + ROUNDING;
            });
            if meets {
                asked.extend(&lot.verts);
            }
        }
        asked.sort_unstable();
        asked
    }
}

impl Lot {
    /// How much of what they follow is the same at least for a vertex of this and one of the other.
    fn shares(&self, other: &Lot) -> f64 {
        let (mut sum, mut theirs) = (0.0, other.follows.iter().peekable());
        for &(bone, w) in &self.follows {
            while theirs.next_if(|e| e.0 < bone).is_some() {}
            sum += theirs.next_if(|e| e.0 == bone).map_or(0.0, |e| w.min(e.1));
        }
        sum
    }
}

/// Walls of sixteen poses, side by side; where a pose has none it is far off.
pub fn gathered(poses: &[Vec<(u32, Wall)>]) -> Vec<(u32, [Row; 4])> {
    let none = OPEN.map(|c| [c; LANES]);
    side_by_side(poses.iter(), &none, |planes, lane, wall| {
        (0..4).for_each(|c| planes[c][lane] = wall[c]);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two sheets that were far apart at rest, facing each other `gap` apart, and follow one bone by `shared`, each
    /// its own by the rest.
    fn sheets(gap: f64, shared: f64) -> (Folds, Vec<DVec3>) {
        let mut weights = Sparse::new();
        (0..50u32).for_each(|v| weights.push([(0, shared), (1 + v / 25, 1.0 - shared)]));
        let (mut faces, mut rest, mut x) = (Vec::new(), Vec::new(), Vec::new());
        for side in 0..2u32 {
            for i in 0..25u32 {
                let p = DVec3::new(f64::from(i % 5) * 0.01, 0.0, f64::from(i / 5) * 0.01);
                rest.push(p + DVec3::Y * 0.5 * f64::from(side));
                x.push(p + DVec3::Y * gap * f64::from(side));
            }
            for c in (0..20u32).filter(|c| c % 5 < 4) {
                let [a, b, d, e] = [c, c + 1, c + 5, c + 6].map(|i| i + 25 * side);
                // The lower sheet faces up, the upper one down.
                let (f, g) = if side == 0 {
                    ([a, d, b], [b, d, e])
                } else {
                    ([a, b, d], [b, e, d])
                };
                faces.extend([f, g]);
            }
        }
        (Folds::new(&faces, &rest, &weights), x)
    }

    #[test]
    fn whoever_is_not_asked_would_have_met_nobody() {
        // A strip that follows one bone after the other and is folded over in the middle.
        let n = 60u32;
        let mut weights = Sparse::new();
        let (mut rest, mut x) = (Vec::new(), Vec::new());
        for v in 0..2 * n {
            let (along, side) = (0.01 * f64::from(v / 2), 0.01 * f64::from(v % 2));
            let (bone, t) = ((v / 60), f64::from(v % 60) / 60.0);
            weights.push([(bone, 1.0 - t), (bone + 1, t)]);
            rest.push(DVec3::new(along, 0.0, side));
            let over = along.min(0.59 - along);
            let up = if along < 0.295 {
                0.0
            } else {
                0.004 + 0.04 * (0.2 - over).max(0.0)
            };
            x.push(DVec3::new(over, up, side));
        }
        let strips = (0..2 * n - 2).map(|v| match v % 2 {
            0 => [v, v + 1, v + 2],
            _ => [v, v + 2, v + 1],
        });
        let folds = Folds::new(&strips.collect::<Vec<_>>(), &rest, &weights);
        let surface = folds.surface.moved(&x);
        for shared in [PARTS, LIMBS] {
            let asked = folds.lots.near_others(&x, surface.faces(), shared);
            assert!(
                asked.is_sorted() && asked.len() < x.len(),
                "{}",
                asked.len()
            );
            let meets = |v: u32| Some((v, folds.meets(&surface, v as usize, (0.004, shared))?));
            let all: Vec<_> = (0..2 * n).filter_map(meets).collect();
            assert!(all.len() > 4, "{}", all.len());
            assert_eq!(folds.find(&x, (0.004, shared)), all);
        }
    }

    #[test]
    fn parts_too_near_or_through_each_other_are_led_apart_and_others_left_alone() {
        for (gap, pushes) in [(0.01, false), (0.002, true), (-0.004, true)] {
            let (folds, x) = sheets(gap, 0.0);
            let found = folds.find(&x, (0.004, PARTS));
            assert_eq!(found.len(), 50);
            for (v, wall) in found {
                let n = DVec3::new(f64::from(wall[0]), f64::from(wall[1]), f64::from(wall[2]));
                let out = if v < 25 { -DVec3::Y } else { DVec3::Y };
                assert!(n.dot(out) > 0.99, "{v}: {n}");
                let below = n.dot(x[v as usize]) - f64::from(wall[3]) < 0.004;
                assert_eq!(below, pushes, "gap {gap}");
            }
        }
        for (shared, parts, limbs) in [(0.2, 50, 50), (0.5, 50, 0), (0.8, 0, 0)] {
            let (folds, x) = sheets(0.002, shared);
            let found = [PARTS, LIMBS].map(|most| folds.find(&x, (0.004, most)).len());
            assert_eq!(found, [parts, limbs], "creases of one part are left alone");
        }
        let (folds, _) = sheets(0.01, 0.0);
        assert!(
            folds.find(&folds.rest, (0.004, PARTS)).is_empty(),
            "nothing meets at rest"
        );
    }
}
