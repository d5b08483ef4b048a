//! Cloth against the body, and against itself, in one frame.

use std::collections::HashSet;

use glam::DVec3;
use muslin_geom::bvh::Aabb;
use muslin_geom::intersect::segment_meets_triangle;
use muslin_geom::{Bvh, Mesh, Surface, intersecting_pairs, self_intersections, vertex_normals};
use muslin_io::Clip;

/// Vertices closer than this count as close [m].
const CLOSE: f64 = 2e-3;
/// Farther than this from the body nothing is asked [m].
const FAR: f64 = 0.3;

/// The body is held against itself only so often: it costs more than all the rest.
const SAMPLED: usize = 6;

/// What a frame says about cloth and body.
#[derive(Default)]
pub struct Contact {
    /// How deep each penetrating vertex is [m].
    pub depths: Vec<f32>,
    /// Vertices less than 2 mm outside, or inside.
    pub close: usize,
    /// Vertices behind the body's nearest vertex: how papers count.
    pub by_nearest_vertex: usize,
    /// Pairs of cloth and body triangles that meet.
    pub pairs: usize,
    /// Pairs of the body's own triangles that cross, in every [`SAMPLED`]th frame.
    pub body_self: Option<usize>,
}

/// Signed distance of every vertex from the body [m]; infinite beyond 30 cm; empty without
/// a body.
pub fn clearance(clip: &Clip, t: usize) -> Vec<f64> {
    let Some(body) = clip.body.get(t) else {
        return Vec::new();
    };
    let skin = Surface::new(body, &clip.body_faces);
    let signed = |x: &DVec3| skin.signed(*x, FAR).unwrap_or(f64::INFINITY);
    clip.drape.frames[t].iter().map(signed).collect()
}

impl Contact {
    /// Frame `t`, whose cloth is so far from the body.
    pub fn of(clip: &Clip, t: usize, clearance: &[f64]) -> Self {
        let (x, body) = (&clip.drape.frames[t], &clip.body[t]);
        let mesh = |verts: &[DVec3], faces: &[[u32; 3]]| Mesh {
            verts: verts.to_vec(),
            faces: faces.to_vec(),
        };
        let skin = mesh(body, &clip.body_faces);
        Self {
            depths: clearance
                .iter()
                .filter(|c| **c < 0.0)
                .map(|c| -*c as f32)
                .collect(),
            close: clearance.iter().filter(|c| **c < CLOSE).count(),
            by_nearest_vertex: by_nearest_vertex(x, &skin),
            pairs: intersecting_pairs(&mesh(x, &clip.drape.faces), &skin).len(),
            body_self: t
                .is_multiple_of(SAMPLED)
                .then(|| self_intersections(&skin).len()),
        }
    }
}

fn by_nearest_vertex(x: &[DVec3], skin: &Mesh) -> usize {
    let points: Vec<Aabb> = skin.verts.iter().map(|&v| Aabb::of(&[v])).collect();
    let (tree, normals) = (Bvh::over(&points), vertex_normals(&skin.verts, &skin.faces));
    let is_behind = |p: &&DVec3| {
        let nearest = tree.nearest(**p, FAR * FAR, |i| {
            skin.verts[i as usize].distance_squared(**p)
        });
        nearest.is_some_and(|(i, _)| (**p - skin.verts[i as usize]).dot(normals[i as usize]) < 0.0)
    };
    x.iter().filter(is_behind).count()
}

/// Edges that pierce a triangle they share no vertex with, each pair once, by exact predicates.
pub fn piercing_edges(mesh: &Mesh) -> usize {
    let mut seen: HashSet<([u32; 2], u32)> = HashSet::new();
    for [i, j] in self_intersections(mesh) {
        for (from, to) in [(i, j), (j, i)] {
            let (face, other) = (mesh.faces[from as usize], mesh.faces[to as usize]);
            let corners = other.map(|k| mesh.verts[k as usize]);
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                let apart = !other.contains(&a) && !other.contains(&b);
                let edge = [a, b].map(|v| mesh.verts[v as usize]);
                if apart && segment_meets_triangle(edge, &corners) {
                    seen.insert(([a.min(b), a.max(b)], to));
                }
            }
        }
    }
    seen.len()
}
