//! A surface that is followed from step to step: its point nearest to another, from triangle to neighbouring triangle.

use glam::{DVec3, Vec3};
use muslin_geom::{Closest, vertex_normals};

use crate::rows::flat;

/// A wall at one vertex: unit normal, and how far it is from the origin [m].
pub type Wall = [f32; 4];
/// Where there is none.
pub const OPEN: Wall = [0.0, 0.0, 0.0, -1.0];
/// The face of a vertex that has no wall.
pub const NO_FACE: u32 = u32::MAX;
/// Steps from face to face when a wall is followed.
const HOPS: usize = 12;
/// Nearer than this the way to a surface has no direction of its own [m].
const TOUCHING: f32 = 5e-5;

/// A surface where it lies now: skin around the cloth in a pose, or cloth below other cloth.
#[derive(Clone, Debug, Default)]
pub struct Posed {
    /// Positions [m].
    pub verts: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
}

impl Posed {
    /// Vertices at `x` [m] with the normals of these triangles.
    pub fn new(x: &[DVec3], faces: &[[u32; 3]]) -> Self {
        let single = |list: &[DVec3]| list.iter().map(|p| p.as_vec3()).collect();
        Self {
            verts: single(x),
            normals: single(&vertex_normals(x, faces)),
        }
    }

    /// The memory that it takes [bytes].
    pub fn bytes(&self) -> usize {
        size_of_val(&self.verts[..]) + size_of_val(&self.normals[..])
    }
}

/// Triangles that can be followed.
#[derive(Clone, Debug)]
pub struct Ground {
    faces: Vec<[u32; 3]>,
    /// Triangles around every vertex: where each vertex's start, and they.
    around: (Vec<u32>, Vec<u32>),
    /// Which triangles lie at an opening: which side one is on cannot be told there.
    rim: Vec<bool>,
}

impl Ground {
    /// Triangles over `n` vertices.
    pub fn new(n: usize, faces: &[[u32; 3]]) -> Self {
        Self {
            around: around(n, faces),
            rim: rim(faces),
            faces: faces.to_vec(),
        }
    }

    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Where the triangles around each vertex start, and they.
    #[cfg(any(test, feature = "cuda"))]
    pub fn around(&self) -> [&[u32]; 2] {
        [&self.around.0, &self.around.1]
    }

    /// Which triangles lie at an opening.
    pub fn rim(&self) -> &[bool] {
        &self.rim
    }

    /// The wall of a point `p` [m] whose nearest triangle was `face`, and the shares that the corners of the one that is
    /// nearest now have of the point nearest to it; follows it over the surface `at` its place.
    ///
    /// None where there is none, at an opening, or farther than `lost` [m] behind: it passed by another limb.
    pub fn wall(
        &self,
        at: &Posed,
        p: Vec3,
        (face, lost): (&mut u32, f32),
    ) -> Option<(Wall, [f32; 3])> {
        if *face == NO_FACE {
            return None;
        }
        let hit = self.follow(at, p, face);
        let f = self.faces[*face as usize];
        let smooth: Vec3 = (0..3)
            .map(|k| at.normals[f[k] as usize] * hit.weights[k])
            .sum();
        let away = p - hit.point;
        let behind = away.dot(smooth) < 0.0 && hit.square > lost * lost;
        if behind || self.rim[*face as usize] {
            return None;
        }
        let n = match hit.square > TOUCHING * TOUCHING {
            true => away * (away.dot(smooth).signum() / hit.square.sqrt()),
            false => smooth.normalize_or_zero(),
        };
        Some(([n.x, n.y, n.z, n.dot(hit.point)], hit.weights))
    }

    /// Goes from triangle to neighbouring triangle for as long as that leads nearer to `p`.
    fn follow(&self, at: &Posed, p: Vec3, face: &mut u32) -> Near {
        let faces = &self.faces;
        let corners = |f: u32| faces[f as usize].map(|v| at.verts[v as usize]);
        let mut hit = near_triangle(p, corners(*face));
        for _ in 0..HOPS {
            // Inside a triangle the way to the surface is along its normal: no neighbour is nearer.
            if hit.weights.iter().all(|w| *w > 0.0) {
                break;
            }
            let pivot = (0..3).max_by(|a, b| hit.weights[*a].total_cmp(&hit.weights[*b]));
            let pivot = faces[*face as usize][pivot.expect("three corners")] as usize;
            let span = self.around.0[pivot] as usize..self.around.0[pivot + 1] as usize;
            let before = *face;
            for &f in &self.around.1[span] {
                let next = near_triangle(p, corners(f));
                if next.square < hit.square {
                    (hit, *face) = (next, f);
                }
            }
            if *face == before {
                break;
            }
        }
        hit
    }
}

/// The plane through the nearest point of a surface that looks towards `x` [m] from the outside.
pub(crate) fn plane(hit: &Closest, x: DVec3) -> Wall {
    let n = match hit.signed.abs() > f64::from(TOUCHING) {
        true => (x - hit.point) / hit.signed,
        false => hit.normal,
    };
    let [a, b, c] = n.as_vec3().to_array();
    [a, b, c, n.dot(hit.point) as f32]
}

/// Which triangles have a corner on an edge that belongs to no other.
fn rim(faces: &[[u32; 3]]) -> Vec<bool> {
    let mut edges: Vec<[u32; 2]> = (faces.iter())
        .flat_map(|f| (0..3).map(|k| [f[k].min(f[(k + 1) % 3]), f[k].max(f[(k + 1) % 3])]))
        .collect();
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| a == b).filter(|e| e.len() == 1);
    let mut verts: Vec<u32> = single.flat_map(|e| e[0]).collect();
    verts.sort_unstable();
    let on = |v: &u32| verts.binary_search(v).is_ok();
    faces.iter().map(|f| f.iter().any(on)).collect()
}

/// Triangles around every vertex.
fn around(n: usize, faces: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut rows = vec![Vec::new(); n];
    for (f, face) in faces.iter().enumerate() {
        face.iter().for_each(|v| rows[*v as usize].push(f as u32));
    }
    flat(&rows)
}

/// The point of a triangle nearest to another.
#[derive(Clone, Copy)]
struct Near {
    point: Vec3,
    weights: [f32; 3],
    /// Squared distance [m²].
    square: f32,
}

/// The point of triangle `t` nearest to `p`: `muslin_geom`'s in single precision, seen from `p`.
fn near_triangle(p: Vec3, t: [Vec3; 3]) -> Near {
    let t = t.map(|c| c - p);
    let [a, b, c] = t;
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (-ab.dot(a), -ac.dot(a));
    let at = |u: f32, v: f32, w: f32| {
        let off = a * u + b * v + c * w;
        Near {
            point: p + off,
            weights: [u, v, w],
            square: off.length_squared(),
        }
    };
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(1.0, 0.0, 0.0);
    }
    let (d3, d4) = (-ab.dot(b), -ac.dot(b));
    if d3 >= 0.0 && d4 <= d3 {
        return at(0.0, 1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return at(1.0 - v, v, 0.0);
    }
    let (d5, d6) = (-ab.dot(c), -ac.dot(c));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return at(1.0 - w, 0.0, w);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(0.0, 1.0 - w, w);
    }
    let s = 1.0 / (va + vb + vc);
    at(1.0 - vb * s - vc * s, vb * s, vc * s)
}
