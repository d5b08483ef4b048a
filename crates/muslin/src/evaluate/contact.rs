//! Cloth against the body, and against itself, in one frame.

use std::collections::HashSet;

use glam::DVec3;
use muslin_geom::bvh::Aabb;
use muslin_geom::intersect::segment_meets_triangle;
use muslin_geom::{Bvh, Surface, vertex_normals};
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

/// The cloth and the body of a clip, moved from frame to frame: their trees keep their shape.
#[derive(Clone)]
pub struct Scene {
    pub cloth: Surface,
    /// Every garment that another is worn over.
    pub inner: Vec<Surface>,
    skin: Option<Skin>,
}

/// A body's surface, and the tree over its vertices.
#[derive(Clone)]
struct Skin {
    surface: Surface,
    points: Bvh,
}

impl Scene {
    /// At frame `t`.
    pub fn new(clip: &Clip, t: usize) -> Self {
        let skin = clip.body.get(t).map(|body| Skin {
            surface: Surface::new(body, &clip.body_faces),
            points: Bvh::over(&point_boxes(body)),
        });
        let (x, faces) = (&clip.drape.frames[t], &clip.drape.faces);
        let worn_over = clip.drape.parts.split_last().map_or(&[][..], |s| s.1);
        let inner = worn_over.iter();
        Self {
            cloth: Surface::new(x, faces),
            inner: inner
                .map(|p| Surface::new(x, &faces[p.faces.clone()]))
                .collect(),
            skin,
        }
    }

    /// Moves everything to frame `t`.
    pub fn show(&mut self, clip: &Clip, t: usize) {
        let all = std::iter::once(&mut self.cloth).chain(&mut self.inner);
        all.for_each(|cloth| cloth.refit(&clip.drape.frames[t]));
        if let Some(skin) = &mut self.skin {
            skin.surface.refit(&clip.body[t]);
            skin.points.refit(&point_boxes(&clip.body[t]));
        }
    }

    /// Signed distance of every vertex from the body [m]; infinite beyond 30 cm; empty without
    /// a body.
    pub fn clearance(&self) -> Vec<f64> {
        let Some(Skin { surface, .. }) = &self.skin else {
            return Vec::new();
        };
        let mut last = None;
        let signed = |x: &DVec3| {
            let near = match last {
                Some(face) => surface.closest_near(*x, FAR, face),
                None => surface.closest(*x, FAR),
            };
            last = near.map(|hit| hit.face);
            near.map_or(f64::INFINITY, |hit| surface.sided(*x, hit).signed)
        };
        self.cloth.verts().iter().map(signed).collect()
    }
}

fn point_boxes(points: &[DVec3]) -> Vec<Aabb> {
    points.iter().map(|&p| Aabb::of(&[p])).collect()
}

impl Contact {
    /// Frame `t`, shown by the scene, whose cloth is so far from the body; nothing without one.
    pub fn of(scene: &Scene, t: usize, clearance: &[f64]) -> Self {
        let Some(skin) = &scene.skin else {
            return Self::default();
        };
        Self {
            depths: clearance
                .iter()
                .filter(|c| **c < 0.0)
                .map(|c| -*c as f32)
                .collect(),
            close: clearance.iter().filter(|c| **c < CLOSE).count(),
            by_nearest_vertex: by_nearest_vertex(scene.cloth.verts(), skin),
            pairs: scene.cloth.intersections(&skin.surface).len(),
            body_self: t
                .is_multiple_of(SAMPLED)
                .then(|| skin.surface.self_intersections().len()),
        }
    }
}

fn by_nearest_vertex(x: &[DVec3], Skin { surface, points }: &Skin) -> usize {
    let verts = surface.verts();
    let normals = vertex_normals(verts, surface.faces());
    let is_behind = |p: &&DVec3| {
        let nearest = points.nearest(**p, FAR * FAR, |i| verts[i as usize].distance_squared(**p));
        nearest.is_some_and(|(i, _)| (**p - verts[i as usize]).dot(normals[i as usize]) < 0.0)
    };
    x.iter().filter(is_behind).count()
}

/// Edges that pierce a triangle they share no vertex with, each pair once, by exact predicates.
pub fn piercing_edges(cloth: &Surface) -> usize {
    let mut seen: HashSet<([u32; 2], u32)> = HashSet::new();
    for [i, j] in cloth.self_intersections() {
        for (from, to) in [(i, j), (j, i)] {
            let [face, other] = [from, to].map(|f| cloth.faces()[f as usize]);
            let corners = cloth.corners(to);
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                let apart = !other.contains(&a) && !other.contains(&b);
                let edge = [a, b].map(|v| cloth.verts()[v as usize]);
                if apart && segment_meets_triangle(edge, &corners) {
                    seen.insert(([a.min(b), a.max(b)], to));
                }
            }
        }
    }
    seen.len()
}
