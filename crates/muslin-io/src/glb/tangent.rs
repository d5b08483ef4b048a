//! Tangents: which way a normal map's red and green point on the surface.

use glam::{DVec2, DVec3, DVec4};

use crate::scene::Node;

/// One tangent a vertex: the unit direction of growing u across the normal, and in `w` the sign
/// that makes `w * normal × tangent` point to growing v (up in the picture).
///
/// Area-weighted over the triangles around the vertex. Where coordinates do not tell a direction,
/// any one across the normal will do.
pub fn tangents(node: &Node, normals: &[DVec3]) -> Vec<DVec4> {
    let mut along_u = vec![DVec3::ZERO; normals.len()];
    let mut along_v = along_u.clone();
    for face in &node.mesh.faces {
        let x = face.map(|i| node.mesh.verts[i as usize]);
        let uv = face.map(|i| node.uvs[i as usize]);
        let (u, v) = directions(x, uv);
        for &i in face {
            along_u[i as usize] += u;
            along_v[i as usize] += v;
        }
    }
    let sums = along_u.into_iter().zip(along_v);
    sums.zip(normals)
        .map(|((u, v), &n)| frame(u, v, n))
        .collect()
}

/// Directions of growing u and v in a triangle, as long as twice its area in the picture.
fn directions(x: [DVec3; 3], uv: [DVec2; 3]) -> (DVec3, DVec3) {
    let (e, f) = (x[1] - x[0], x[2] - x[0]);
    let (a, b) = (uv[1] - uv[0], uv[2] - uv[0]);
    let side = a.perp_dot(b).signum();
    ((e * b.y - f * a.y) * side, (f * a.x - e * b.x) * side)
}

/// The tangent at normal `n` from summed directions.
fn frame(u: DVec3, v: DVec3, n: DVec3) -> DVec4 {
    let n = n.try_normalize().unwrap_or(DVec3::Y);
    let across = (u - n * n.dot(u)).try_normalize();
    let t = across.unwrap_or_else(|| n.any_orthonormal_vector());
    t.extend(if n.cross(t).dot(v) < 0.0 { -1.0 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use muslin_geom::Mesh;

    use super::*;

    /// A square in the XY plane with these coordinates.
    fn tangent(uv: impl Fn(DVec3) -> DVec2) -> DVec4 {
        let verts = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        let uvs = verts.iter().map(|&x| uv(x)).collect();
        let mesh = Mesh {
            verts,
            faces: vec![[0, 1, 2], [0, 2, 3]],
        };
        let node = Node {
            mesh,
            uvs,
            ..Node::default()
        };
        tangents(&node, &[DVec3::Z; 4])[2]
    }

    #[test]
    fn a_tangent_follows_u_and_knows_a_mirrored_picture() {
        assert_eq!(
            tangent(|x| DVec2::new(x.x, x.y)),
            DVec4::new(1.0, 0.0, 0.0, 1.0)
        );
        assert_eq!(
            tangent(|x| DVec2::new(-x.x, x.y)),
            DVec4::new(-1.0, 0.0, 0.0, -1.0)
        );
        assert_eq!(
            tangent(|x| DVec2::new(3.0 * x.y, -x.x)),
            DVec4::new(0.0, 1.0, 0.0, 1.0)
        );
    }

    #[test]
    fn coordinates_without_area_still_give_a_unit_tangent() {
        let t = tangent(|_| DVec2::ZERO);
        assert!((t.truncate().length() - 1.0).abs() < 1e-12 && t.truncate().dot(DVec3::Z) == 0.0);
    }
}
