//! Cloth in the making: a piece of tights or skirt, cut and remeshed, bound to their vertices.

use crate::GarmentError;
use crate::settle::Net;
use crate::stand::BodyMap;
use glam::DVec3;
use muslin_geom::{Mesh, RemeshOptions, Surface, cut, remesh};
use std::f64::consts::TAU;

/// Which vertices a point hangs on, and by how much of each; the shares sum to one.
pub(crate) type Row = Vec<(u32, f64)>;

/// A piece of tights, skirt, or both.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    pub faces: Vec<[u32; 3]>,
    pub rows: Vec<Row>,
}

impl Sheet {
    /// All of the tights.
    pub fn whole(map: &BodyMap) -> Sheet {
        Sheet::of(&map.tights)
    }

    /// All of the skirt.
    pub fn skirt(map: &BodyMap) -> Sheet {
        Sheet::of(&map.skirt)
    }

    fn of(faces: &[[u32; 3]]) -> Sheet {
        let n = faces.iter().flatten().max().map_or(0, |m| m + 1);
        Sheet {
            faces: faces.to_vec(),
            rows: (0..n).map(|i| vec![(i, 1.0)]).collect(),
        }
    }

    /// Joined to a piece below: the lowest rim of this one, where the vertices are on `verts`
    /// [m], to the highest of that.
    ///
    /// Both rims go once around the vertical; the band between them turns with their angles.
    pub fn joined(self, lower: Sheet, verts: &[DVec3]) -> Sheet {
        let n = self.rows.len() as u32;
        let rim = |s: &Sheet, sense: f64| {
            let x = s.at(verts);
            let height = |ring: &Vec<u32>| {
                let sum: f64 = ring.iter().map(|&i| x[i as usize].y).sum();
                sense * sum / ring.len() as f64
            };
            let loops = Net::new(s.faces.clone(), s.rows.len()).loops;
            let ring = loops
                .into_iter()
                .max_by(|a, b| height(a).total_cmp(&height(b)));
            let mut ring: Vec<(f64, u32)> = (ring.into_iter().flatten())
                .map(|i| (x[i as usize].x.atan2(x[i as usize].z), i))
                .collect();
            ring.sort_by(|a, b| a.0.total_cmp(&b.0));
            ring
        };
        let (above, below) = (rim(&self, -1.0), rim(&lower, 1.0));
        let below: Vec<(f64, u32)> = below.into_iter().map(|(a, i)| (a, i + n)).collect();
        let shifted = lower.faces.iter().map(|f| f.map(|i| i + n));
        let mut faces = self.faces;
        faces.extend(shifted);
        faces.extend(band(&above, &below));
        let rows = self.rows.into_iter().chain(lower.rows).collect();
        Sheet { faces, rows }
    }

    /// The vertices' places on a body [m].
    pub fn at(&self, verts: &[DVec3]) -> Vec<DVec3> {
        self.rows.iter().map(|r| blend(r, verts)).collect()
    }

    /// Keeps where `field` of the place on `verts` [m] is not negative.
    pub fn cut(self, verts: &[DVec3], field: impl Fn(DVec3) -> f64) -> Sheet {
        let values: Vec<f64> = self.at(verts).into_iter().map(field).collect();
        let kept = cut(&self.faces, &values);
        let row = |v: &muslin_geom::OnEdge| {
            let [a, b] = v.ends.map(|i| &self.rows[i as usize]);
            mix(&[(a, 1.0 - v.along), (b, v.along)])
        };
        Sheet {
            rows: kept.verts.iter().map(row).collect(),
            faces: kept.faces,
        }
    }

    /// Keeps the largest connected piece.
    pub fn largest(self) -> Sheet {
        let mut label: Vec<u32> = (0..self.rows.len() as u32).collect();
        for f in &self.faces {
            let [a, b, c] = f.map(|i| root(&mut label, i));
            let low = a.min(b).min(c);
            [a, b, c].iter().for_each(|&i| label[i as usize] = low);
        }
        let of: Vec<u32> = self.faces.iter().map(|f| root(&mut label, f[0])).collect();
        let mut count = vec![0usize; self.rows.len()];
        of.iter().for_each(|&l| count[l as usize] += 1);
        let most = (0..count.len())
            .max_by_key(|&l| (count[l], usize::MAX - l))
            .unwrap_or(0);
        let mut faces = self.faces;
        let mut keep = of.iter().map(|&l| l as usize == most);
        faces.retain(|_| keep.next().unwrap_or(false));
        Sheet {
            faces,
            rows: self.rows,
        }
        .compact()
    }

    fn compact(mut self) -> Sheet {
        let mut new = vec![u32::MAX; self.rows.len()];
        let mut rows = Vec::new();
        for i in self.faces.iter_mut().flatten() {
            if new[*i as usize] == u32::MAX {
                new[*i as usize] = rows.len() as u32;
                rows.push(self.rows[*i as usize].clone());
            }
            *i = new[*i as usize];
        }
        Sheet {
            faces: self.faces,
            rows,
        }
    }

    /// Even triangles with edges of about `edge` [m] where the vertices are at `x` [m], by so
    /// many rounds of remeshing, and where the new vertices are.
    pub fn remeshed(&self, x: Vec<DVec3>, edge: f64, rounds: usize) -> (Sheet, Vec<DVec3>) {
        let mesh = Mesh {
            verts: x,
            faces: self.faces.clone(),
        };
        let made = remesh(&mesh, RemeshOptions { edge, rounds });
        let row = |o: &muslin_geom::OnFace| {
            let f = self.faces[o.face as usize];
            mix(&[0, 1, 2].map(|k| (&self.rows[f[k] as usize], o.weights[k])))
        };
        let rows = made.origin.iter().map(row).collect();
        (
            Sheet {
                rows,
                faces: made.mesh.faces,
            },
            made.mesh.verts,
        )
    }

    /// The same places on the second skin, each as three weights of one triangle.
    pub fn bound(self, verts: &[DVec3], ground: &Surface) -> Result<Sheet, GarmentError> {
        let row = |r: &Row| {
            let c = ground
                .closest(blend(r, verts), 0.05)
                .ok_or(GarmentError::NoTights)?;
            let f = ground.faces()[c.face as usize];
            // A point on an edge may come with a weight a rounding below zero.
            let weights = c.weights.map(|w| w.max(0.0));
            let total: f64 = weights.iter().sum();
            Ok((0..3).map(|k| (f[k], weights[k] / total)).collect())
        };
        let rows: Result<Vec<Row>, GarmentError> = self.rows.iter().map(row).collect();
        Ok(Sheet {
            rows: rows?,
            faces: self.faces,
        })
    }
}

/// The blend of values that a row asks for.
pub(crate) fn blend(row: &[(u32, f64)], values: &[DVec3]) -> DVec3 {
    row.iter().map(|&(i, w)| values[i as usize] * w).sum()
}

/// A blend of rows.
pub(crate) fn mix(parts: &[(&Row, f64)]) -> Row {
    let mut all: Row = parts
        .iter()
        .flat_map(|(row, share)| row.iter().map(move |&(i, w)| (i, w * share)))
        .filter(|(_, w)| *w != 0.0)
        .collect();
    all.sort_by_key(|e| e.0);
    all.dedup_by(|b, a| {
        let same = a.0 == b.0;
        if same {
            a.1 += b.1;
        }
        same
    });
    all
}

/// Triangles between two closed rings of (angle, vertex), each in the order of its angles.
fn band(above: &[(f64, u32)], below: &[(f64, u32)]) -> Vec<[u32; 3]> {
    let at = |ring: &[(f64, u32)], k: usize| {
        let turns = (k / ring.len()) as f64;
        (ring[k % ring.len()].0 + TAU * turns, ring[k % ring.len()].1)
    };
    let (mut i, mut j) = (0, 0);
    let mut faces = Vec::with_capacity(above.len() + below.len());
    while i < above.len() || j < below.len() {
        let (a, b) = (at(above, i).1, at(below, j).1);
        let (next_a, next_b) = (at(above, i + 1), at(below, j + 1));
        // Angles grow from front to left: seen from outside, to the right.
        if j == below.len() || (i < above.len() && next_a.0 <= next_b.0) {
            faces.push([a, b, next_a.1]);
            i += 1;
        } else {
            faces.push([a, b, next_b.1]);
            j += 1;
        }
    }
    faces
}

fn root(label: &mut [u32], mut i: u32) -> u32 {
    while label[i as usize] != i {
        label[i as usize] = label[label[i as usize] as usize];
        i = label[i as usize];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixing_rows_adds_what_they_share() {
        let (a, b) = (vec![(1, 0.5), (4, 0.5)], vec![(0, 1.0)]);
        let m = mix(&[(&a, 0.5), (&b, 0.25), (&vec![(4, 1.0)], 0.25)]);
        assert_eq!(m, vec![(0, 0.25), (1, 0.25), (4, 0.5)]);
    }

    #[test]
    fn two_rings_are_joined_by_triangles_that_face_outward() {
        let ring = |n: u32, turn: f64, first: u32| -> Vec<(f64, u32)> {
            (0..n)
                .map(|k| (TAU * f64::from(k) / f64::from(n) - 3.1 + turn, first + k))
                .collect()
        };
        let (above, below) = (ring(7, 0.02, 0), ring(5, 0.3, 7));
        let at = |i: u32| {
            let (ring, y) = if i < 7 { (&above, 1.0) } else { (&below, 0.0) };
            let (s, c) = ring[(i % 7) as usize].0.sin_cos();
            DVec3::new(s, y, c)
        };
        let faces = band(&above, &below);
        assert_eq!(faces.len(), 12);
        for f in &faces {
            let [a, b, c] = f.map(at);
            let out = (a + b + c).with_y(0.0);
            assert!((b - a).cross(c - a).dot(out) > 0.0, "{f:?}");
        }
        let rims = Net::new(faces, 12).loops;
        assert_eq!(rims.iter().map(Vec::len).collect::<Vec<_>>(), [7, 5]);
    }

    #[test]
    fn only_the_largest_piece_is_kept() {
        let rows = (0..7).map(|i| vec![(i, 1.0)]).collect();
        let sheet = Sheet {
            faces: vec![[0, 1, 2], [3, 4, 5], [3, 5, 6]],
            rows,
        }
        .largest();
        assert_eq!(sheet.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(sheet.rows[0], [(3, 1.0)]);
    }
}
