//! Regions of the cloth, and by how much two of them may shift against each other.
//!
//! A list of near pairs stays whole for as long as nothing outside of it can have come near. What
//! the cloth does as a whole, or a sleeve as a whole, brings nobody together: only what one region
//! does as seen from another counts, and only against the distance between the two.

use glam::DVec3;
use muslin_geom::Aabb;

use crate::{ordered, pattern::Rows};

/// Vertices that a region is grown to before its faces are counted.
const SIZE: usize = 24;
/// Regions farther apart than this are not looked at one by one [m].
const FAR: f64 = 0.05;

/// Sets of neighbouring vertices, such that every face lies whole in at least one.
#[derive(Clone, Debug)]
pub(crate) struct Regions(Rows);

impl Regions {
    /// `near`: for every vertex those that share a face with it.
    pub fn new(near: &Rows, faces: &[[u32; 3]]) -> Regions {
        let of = grown(near);
        let n = of.iter().max().map_or(0, |last| *last as usize + 1);
        let owner = |f: &[u32; 3]| of[f[0] as usize];
        let corners = |f: &[u32; 3]| f.map(|v| (owner(f), v));
        Regions(Rows::sorted(n, faces.iter().flat_map(corners).collect()))
    }

    fn len(&self) -> usize {
        self.0.start.len() - 1
    }

    /// The box of every region's points.
    fn boxes(&self, at: impl Fn(usize) -> DVec3 + Sync + Send) -> Vec<Aabb> {
        ordered::map(self.len(), |r| {
            let mut b = Aabb::EMPTY;
            for &v in self.0.row(r) {
                let p = at(v as usize);
                b.min = b.min.min(p);
                b.max = b.max.max(p);
            }
            b
        })
    }
}

/// For every vertex the number of its region.
fn grown(near: &Rows) -> Vec<u32> {
    let n = near.start.len() - 1;
    let mut of = vec![u32::MAX; n];
    let mut regions = 0;
    for seed in 0..n {
        if of[seed] != u32::MAX {
            continue;
        }
        let mut found = vec![seed as u32];
        of[seed] = regions;
        let mut next = 0;
        while next < found.len() && found.len() < SIZE {
            for &v in near.row(found[next] as usize) {
                if of[v as usize] == u32::MAX && found.len() < SIZE {
                    of[v as usize] = regions;
                    found.push(v);
                }
            }
            next += 1;
        }
        regions += 1;
    }
    of
}

/// How far apart regions are where a list of pairs was made.
#[derive(Clone, Debug, Default)]
pub(crate) struct Distances {
    /// Two regions, the same one twice too, and the distance between them [m].
    near: Vec<(u32, u32, f64)>,
}

impl Distances {
    /// Distances between regions of points `at` [m].
    pub fn between(regions: &Regions, at: &[DVec3]) -> Distances {
        let boxes = regions.boxes(|v| at[v]);
        let rows = ordered::map(boxes.len(), |a| {
            let around = boxes[a].grown(FAR);
            let others = (a..boxes.len()).filter(|&b| around.overlaps(&boxes[b]));
            let row = others.map(|b| (a as u32, b as u32, gap(&boxes[a], &boxes[b])));
            row.collect::<Vec<_>>()
        });
        Distances {
            near: rows.concat(),
        }
    }

    /// Whether features that were `reach` [m] apart or more, or as far as their regions, are still
    /// more than `radius` [m] apart after every vertex went by `gone` [m].
    pub fn hold(
        &self,
        (regions, reach): (&Regions, f64),
        gone: impl Fn(usize) -> DVec3 + Sync + Send,
        radius: f64,
    ) -> bool {
        let moves = regions.boxes(gone);
        let all = moves.iter().fold(Aabb::EMPTY, |all, b| all.union(*b));
        shift(&all, &all) <= FAR.max(reach) - radius
            && self.near.iter().all(|&(a, b, apart)| {
                shift(&moves[a as usize], &moves[b as usize]) <= apart.max(reach) - radius
            })
    }
}

/// Distance between two boxes [m].
fn gap(a: &Aabb, b: &Aabb) -> f64 {
    (b.min - a.max).max(a.min - b.max).max(DVec3::ZERO).length()
}

/// The most that two entries of these boxes of moves differ by [m].
fn shift(a: &Aabb, b: &Aabb) -> f64 {
    (a.max - b.min).max(b.max - a.min).max(DVec3::ZERO).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Pattern;

    /// Two sheets of 10 x 10 vertices, 1 cm apart each way, `apart` [m] from each other.
    fn sheets(apart: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let (mut x, mut faces) = (Vec::new(), Vec::new());
        for sheet in 0..2 {
            let base = x.len() as u32;
            for i in 0..100 {
                let (col, row) = (f64::from(i % 10), f64::from(i / 10));
                x.push(DVec3::new(0.01 * col, apart * f64::from(sheet), 0.01 * row));
            }
            for i in (0..90).filter(|i| i % 10 < 9) {
                let v = base + i;
                faces.extend([[v, v + 1, v + 11], [v, v + 11, v + 10]]);
            }
        }
        (x, faces)
    }

    #[test]
    fn every_face_lies_whole_in_a_region() {
        let (x, faces) = sheets(0.02);
        let pattern = Pattern::new(x.len(), &faces);
        let regions = Regions::new(&pattern.near, &faces);
        let whole = |f: &[u32; 3]| {
            (0..regions.len()).any(|r| f.iter().all(|v| regions.0.row(r).contains(v)))
        };
        assert!(faces.iter().all(whole));
        assert!(regions.len() >= 8);
    }

    #[test]
    fn what_moves_together_holds_and_what_closes_in_does_not() {
        let (x, faces) = sheets(0.02);
        let pattern = Pattern::new(x.len(), &faces);
        let regions = Regions::new(&pattern.near, &faces);
        let d = Distances::between(&regions, &x);
        let wind = |_: usize| DVec3::new(3.0, 1.0, 2.0);
        assert!(d.hold((&regions, 5e-3), wind, 4e-3));
        // One sheet comes down on the other: told apart by the 2 cm between them.
        let fall = |by: f64| move |v: usize| wind(0) - DVec3::Y * if v < 100 { 0.0 } else { by };
        assert!(d.hold((&regions, 5e-3), fall(0.015), 4e-3));
        assert!(!d.hold((&regions, 5e-3), fall(0.017), 4e-3));
        // A crumple within a sheet is told against the reach alone.
        let crumple = |by: f64| move |v: usize| DVec3::X * if v == 44 { by } else { 0.0 };
        assert!(d.hold((&regions, 5e-3), crumple(0.9e-3), 4e-3));
        assert!(!d.hold((&regions, 5e-3), crumple(1.1e-3), 4e-3));
    }
}
