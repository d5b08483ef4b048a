//! Remesh: near-equilateral triangles of one size on a given surface.
//!
//! Split long edges, collapse short ones, flip for even valence, slide vertices along the
//! surface; a few rounds of that (Botsch and Kobbelt, "A remeshing approach to multiresolution
//! modeling", 2004). Every pass applies only changes that cannot touch each other, in a fixed
//! order, so the result depends on nothing but the input. Each vertex remembers where it lies
//! on the input surface, and finds its next place by walking there from face to face: two
//! sheets that come close in space are never confused.

mod edit;
mod place;

use crate::Mesh;
use edit::Sheet;
use place::Reference;

/// What the triangles shall be like.
#[derive(Clone, Copy, Debug)]
pub struct RemeshOptions {
    /// Edge length aimed at [m].
    pub edge: f64,
    /// Rounds of split, collapse, flip and slide; 8 is usually enough.
    pub rounds: usize,
}

/// Where a vertex lies on the surface it was made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnFace {
    /// Face of the input.
    pub face: u32,
    /// Barycentric weights of that face's corners; they sum to one.
    pub weights: [f64; 3],
}

/// A remeshed surface.
#[derive(Clone, Debug)]
pub struct Remeshed {
    /// The new triangles.
    pub mesh: Mesh,
    /// One place on the input surface per vertex.
    pub origin: Vec<OnFace>,
}

/// Triangulates `surface` anew with edges of about `options.edge`.
///
/// `surface` must be an oriented manifold, open or closed; its boundary curves keep their
/// shape and are resampled evenly, vertices move only on the surface. An empty surface
/// returns itself.
pub fn remesh(surface: &Mesh, options: RemeshOptions) -> Remeshed {
    let reference = Reference::new(surface);
    let mut sheet = Sheet::new(&reference);
    for round in 0..options.rounds {
        sheet.split(4.0 / 3.0 * options.edge);
        sheet.collapse(4.0 / 5.0 * options.edge);
        let regular = round + 2 < options.rounds;
        for _ in 0..3 {
            if regular {
                sheet.flip_for_valence()
            } else {
                sheet.flip_for_angles()
            };
        }
        sheet.slide(if regular { 2 } else { 5 });
    }
    for _ in 0..4 {
        sheet.flip_for_angles();
    }
    sheet.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::collections::HashMap;
    use std::f64::consts::TAU;

    /// A coarse open tube of radius 0.1 m and height 0.3 m.
    fn tube() -> Mesh {
        let (around, rows) = (24, 7);
        let mut mesh = Mesh::default();
        for r in 0..rows {
            for k in 0..around {
                let t = TAU * k as f64 / around as f64;
                let y = 0.3 * r as f64 / (rows - 1) as f64;
                mesh.verts.push(DVec3::new(0.1 * t.sin(), y, 0.1 * t.cos()));
            }
        }
        for r in 0..rows as u32 - 1 {
            for k in 0..around as u32 {
                let at = |r: u32, k: u32| r * around as u32 + k % around as u32;
                let (a, b, c, d) = (at(r, k), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k));
                mesh.faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    fn edges(faces: &[[u32; 3]]) -> HashMap<[u32; 2], usize> {
        let mut count = HashMap::new();
        for f in faces {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                *count.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
            }
        }
        count
    }

    #[test]
    fn a_tube_gets_even_well_shaped_triangles() {
        let made = remesh(
            &tube(),
            RemeshOptions {
                edge: 0.012,
                rounds: 8,
            },
        );
        let x = &made.mesh.verts;
        let count = edges(&made.mesh.faces);
        assert!(count.values().all(|&n| n <= 2), "manifold");
        let length = |e: &[u32; 2]| (x[e[0] as usize] - x[e[1] as usize]).length();
        let mean = count.keys().map(length).sum::<f64>() / count.len() as f64;
        assert!((0.9..1.1).contains(&(mean / 0.012)), "mean edge {mean}");
        let worst = made
            .mesh
            .faces
            .iter()
            .map(|&f| smallest_angle(x, f))
            .fold(9.0, f64::min);
        assert!(
            worst > 28f64.to_radians(),
            "smallest angle {}",
            worst.to_degrees()
        );
    }

    fn smallest_angle(x: &[DVec3], f: [u32; 3]) -> f64 {
        let p = f.map(|i| x[i as usize]);
        (0..3)
            .map(|k| (p[(k + 1) % 3] - p[k]).angle_between(p[(k + 2) % 3] - p[k]))
            .fold(9.0, f64::min)
    }

    #[test]
    fn the_rims_stay_where_they_are() {
        let made = remesh(
            &tube(),
            RemeshOptions {
                edge: 0.01,
                rounds: 8,
            },
        );
        let rim: Vec<[u32; 2]> = edges(&made.mesh.faces)
            .into_iter()
            .filter(|e| e.1 == 1)
            .map(|e| e.0)
            .collect();
        assert!((90..140).contains(&rim.len()), "{} rim edges", rim.len());
        for i in rim.into_iter().flatten() {
            let y = made.mesh.verts[i as usize].y;
            assert!(y.abs() < 1e-12 || (y - 0.3).abs() < 1e-12, "y {y}");
        }
    }

    #[test]
    fn places_on_the_input_reproduce_the_vertices() {
        let input = tube();
        let made = remesh(
            &input,
            RemeshOptions {
                edge: 0.02,
                rounds: 6,
            },
        );
        for (x, o) in made.mesh.verts.iter().zip(&made.origin) {
            let corners = input.faces[o.face as usize].map(|i| input.verts[i as usize]);
            let back: DVec3 = (0..3).map(|k| corners[k] * o.weights[k]).sum();
            assert!((back - *x).length() < 1e-12);
            assert!((o.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
