//! A triangle mesh and what follows from its connectivity.

use glam::DVec3;

/// Triangles over points in space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// Corner indices, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// Area-weighted unit normals; a vertex without area gets zero.
    pub fn vertex_normals(&self) -> Vec<DVec3> {
        vertex_normals(&self.verts, &self.faces)
    }

    /// Volume enclosed by a closed, outward-facing mesh [m³] (divergence theorem).
    pub fn volume(&self) -> f64 {
        let six = self.faces.iter().map(|&f| {
            let [a, b, c] = f.map(|i| self.verts[i as usize]);
            a.dot(b.cross(c))
        });
        six.sum::<f64>() / 6.0
    }
}

/// Vertices that share an edge with each vertex, in order.
pub fn neighbours(n: usize, faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut near = vec![Vec::new(); n];
    for f in faces {
        for k in 0..3 {
            near[f[k] as usize].extend([f[(k + 1) % 3], f[(k + 2) % 3]]);
        }
    }
    for row in &mut near {
        row.sort_unstable();
        row.dedup();
    }
    near
}

/// Area-weighted unit normals of `verts` [m]; a vertex without area gets zero.
pub fn vertex_normals(verts: &[DVec3], faces: &[[u32; 3]]) -> Vec<DVec3> {
    let mut sum = vec![DVec3::ZERO; verts.len()];
    for f in faces {
        let [a, b, c] = f.map(|i| verts[i as usize]);
        let n = (b - a).cross(c - a);
        for i in f {
            sum[*i as usize] += n;
        }
    }
    sum.into_iter().map(DVec3::normalize_or_zero).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_tetrahedron_has_a_sixth_of_a_cube() {
        let verts = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let mesh = Mesh { verts, faces };
        assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-15);
        let out = DVec3::ONE.normalize();
        let n = Mesh {
            verts: mesh.verts[1..].to_vec(),
            faces: vec![[0, 1, 2]],
        }
        .vertex_normals();
        assert!((n[0] - out).length() < 1e-15);
    }
}
