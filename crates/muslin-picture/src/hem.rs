//! How far each vertex of a cloth lies from the cloth's open edge.

use std::collections::HashMap;

use glam::DVec3;

use crate::project::FAR;

/// Distance from the nearest open edge [m] for vertices within `reach` of it along
/// the cloth; a large one elsewhere. All are large where `reach` is zero.
///
/// Every vertex asks the boundary segments that its neighbours found nearest, so
/// that a sleeve's hem does not mark the chest it touches.
pub(crate) fn distances(verts: &[DVec3], faces: &[[u32; 3]], reach: f32) -> Vec<f32> {
    let mut dist = vec![FAR; verts.len()];
    if reach <= 0.0 {
        return dist;
    }
    let cloth = Cloth {
        verts,
        faces,
        rim: open_edges(faces),
        reach,
    };
    let mut nearest = vec![usize::MAX; verts.len()];
    for (i, edge) in cloth.rim.iter().enumerate() {
        for &v in edge {
            dist[v as usize] = 0.0;
            nearest[v as usize] = i;
        }
    }
    // Each sweep carries the front at least one triangle further.
    (0..SWEEPS).any(|_| !cloth.spread(&mut dist, &mut nearest));
    dist
}

/// How far from the edge [m] a hem of `width` [m] shows.
pub(crate) fn reach(width: f32) -> f32 {
    if width > 0.0 {
        width * 1.5 + 0.012
    } else {
        0.0
    }
}

/// More than enough triangles across a hem of any usual mesh.
const SWEEPS: usize = 24;

/// A mesh and its open edges.
struct Cloth<'a> {
    verts: &'a [DVec3],
    faces: &'a [[u32; 3]],
    rim: Vec<[u32; 2]>,
    reach: f32,
}

impl Cloth<'_> {
    /// One sweep over the faces; whether anything became nearer.
    fn spread(&self, dist: &mut [f32], nearest: &mut [usize]) -> bool {
        let mut changed = false;
        for face in self.faces.iter().map(|f| f.map(|v| v as usize)) {
            for (from, to) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                let (from, to) = (face[from], face[to]);
                if nearest[from] == usize::MAX || nearest[from] == nearest[to] {
                    continue;
                }
                let [a, b] = self.rim[nearest[from]].map(|v| self.verts[v as usize]);
                let d = segment_distance(self.verts[to], a, b) as f32;
                if d < dist[to] && d <= self.reach {
                    (dist[to], nearest[to], changed) = (d, nearest[from], true);
                }
            }
        }
        changed
    }
}

/// Edges with one face, in the order the faces name them.
fn open_edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let edges = || {
        faces
            .iter()
            .flat_map(|f| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]])
    };
    let key = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    for edge in edges() {
        *count.entry(key(edge)).or_default() += 1;
    }
    edges().filter(|&e| count[&key(e)] == 1).collect()
}

fn segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let t = (p - a).dot(ab) / ab.length_squared().max(f64::MIN_POSITIVE);
    (p - a - ab * t.clamp(0.0, 1.0)).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strip_knows_its_distance_from_both_rims() {
        let n = 11;
        let at = |i: u32, j: u32| i * n + j;
        let verts = (0..n * n).map(|v| DVec3::new(f64::from(v / n), f64::from(v % n), 0.0) * 0.01);
        let verts: Vec<DVec3> = verts.collect();
        let cell = |i, j| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        let faces: Vec<[u32; 3]> = (0..n - 1)
            .flat_map(|i| (0..n - 1).flat_map(move |j| cell(i, j)))
            .collect();
        let got = distances(&verts, &faces, 0.035);
        for (v, d) in got.iter().enumerate() {
            let (i, j) = (v as u32 / n, v as u32 % n);
            let want = 0.01 * f64::from(i.min(j).min(n - 1 - i).min(n - 1 - j)) as f32;
            let want = if want > 0.035 { FAR } else { want };
            assert!((d - want).abs() < 1e-6, "{i} {j}: {d}, not {want}");
        }
    }
}
