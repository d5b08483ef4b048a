//! Cloth in the making: a piece of the tights, cut and remeshed, bound to the tights' vertices.

use crate::GarmentError;
use crate::stand::BodyMap;
use glam::DVec3;
use muslin_geom::{Mesh, RemeshOptions, Surface, cut, remesh};

/// Which vertices a point hangs on, and by how much of each; the shares sum to one.
pub(crate) type Row = Vec<(u32, f64)>;

/// A piece of the tights.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    pub faces: Vec<[u32; 3]>,
    pub rows: Vec<Row>,
}

impl Sheet {
    /// All of the tights.
    pub fn whole(map: &BodyMap) -> Sheet {
        let n = map.tights.iter().flatten().max().map_or(0, |m| m + 1);
        let rows = (0..n).map(|i| vec![(i, 1.0)]).collect();
        Sheet {
            faces: map.tights.clone(),
            rows,
        }
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

    /// The same places on the tights, each as three weights of one triangle.
    pub fn bound(self, verts: &[DVec3], tights: &Surface) -> Result<Sheet, GarmentError> {
        let row = |r: &Row| {
            let c = tights
                .closest(blend(r, verts), 0.05)
                .ok_or(GarmentError::NoTights)?;
            let f = tights.faces()[c.face as usize];
            let total: f64 = c.weights.iter().sum();
            Ok((0..3).map(|k| (f[k], c.weights[k] / total)).collect())
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
