//! Regions of the cloth, and by how much two of them shift against each other.
//!
//! A list of near pairs stays whole for as long as nothing outside of it can have come near. What
//! the cloth does as a whole, or a sleeve as a whole, brings nobody together: only what one region
//! does as seen from another counts, and only against the distance between the two.

use glam::DVec3;
use muslin_geom::Aabb;
use rayon::prelude::*;

use crate::pattern::Rows;

/// Regions that are worth handing to another thread.
const SHARED: usize = 32;
/// Vertices that a region is grown to before its faces are counted.
const SIZE: usize = 24;

/// Sets of neighbouring faces.
#[derive(Clone, Debug)]
pub(crate) struct Regions {
    /// Every face is in one region.
    faces: Rows,
    /// All corners of a region's faces.
    verts: Rows,
}

impl Regions {
    /// `near`: for every vertex those that share a face with it.
    pub fn new(near: &Rows, faces: &[[u32; 3]]) -> Regions {
        let of = grown(near);
        let n = of.iter().max().map_or(0, |last| *last as usize + 1);
        let owner = |f: &[u32; 3]| of[f[0] as usize];
        let corners = |f: &[u32; 3]| f.map(|v| (owner(f), v));
        let numbered: Vec<(u32, u32)> = faces.iter().map(owner).zip(0..).collect();
        Regions {
            faces: Rows::counted(n, &numbered),
            verts: Rows::sorted(n, &faces.iter().flat_map(corners).collect::<Vec<_>>()),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.verts.start.len() - 1
    }

    /// Numbers of a region's faces.
    pub fn faces(&self, region: usize) -> &[u32] {
        self.faces.row(region)
    }

    /// Its vertices.
    pub fn verts(&self, region: usize) -> &[u32] {
        self.verts.row(region)
    }

    /// The box of every region's points.
    pub fn boxes(&self, at: impl Fn(usize) -> DVec3 + Sync + Send) -> Vec<Aabb> {
        let around = |r: usize| {
            let mut b = Aabb::EMPTY;
            for &v in self.verts.row(r) {
                let p = at(v as usize);
                b.min = b.min.min(p);
                b.max = b.max.max(p);
            }
            b
        };
        let regions = (0..self.len()).into_par_iter().with_min_len(SHARED);
        regions.map(around).collect()
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

/// Distance between two boxes [m].
pub(crate) fn gap(a: &Aabb, b: &Aabb) -> f64 {
    (b.min - a.max).max(a.min - b.max).max(DVec3::ZERO).length()
}

/// The most that two entries of these boxes of moves differ by [m].
pub(crate) fn shift(a: &Aabb, b: &Aabb) -> f64 {
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
    fn every_face_lies_whole_in_one_region() {
        let (x, faces) = sheets(0.02);
        let pattern = Pattern::new(x.len(), &faces);
        let regions = Regions::new(&pattern.near, &faces);
        let mut seen = vec![0; faces.len()];
        for r in 0..regions.len() {
            for &f in regions.faces(r) {
                seen[f as usize] += 1;
                let corners = faces[f as usize];
                assert!(corners.iter().all(|v| regions.verts(r).contains(v)));
            }
        }
        assert!(seen.iter().all(|n| *n == 1));
        assert!(regions.len() >= 8);
    }
}
