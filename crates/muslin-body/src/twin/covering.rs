//! Our skin over the character's own in a pose: the two are skinned by different weights, and where theirs comes out of
//! ours by some millimetres, cloth that lies on ours would be pierced by it.

use glam::DVec3;
use muslin_geom::{Surface, vertex_normals};

use super::Place;
use crate::Character;

/// Our skin lies on the character's where that is so near [m], and faces as it does (cosine).
const NEAR: f64 = 0.03;
const ALIKE: f64 = 0.3;
/// By how much our skin is raised at most [m], and how far from where it lay the character's may have gone [m].
const MOST: f64 = 0.02;
const GONE: f64 = 0.06;
/// Rounds in which skin beside what is raised follows.
const ROUNDS: usize = 3;

/// Where on the character's skin each vertex of ours lies.
#[derive(Clone, Debug)]
pub(super) struct Covering {
    lies_on: Vec<Option<Place>>,
    faces: Vec<[u32; 3]>,
}

impl Covering {
    /// `skin`: ours, drawn over the character [m], and its triangles; `wanted`: which of its vertices are to cover it.
    pub fn new(
        (skin, faces): (&[DVec3], &[[u32; 3]]),
        character: &Character,
        wanted: impl Fn(usize) -> bool,
    ) -> Self {
        let theirs = Surface::new(&character.verts, &character.faces);
        let normals = vertex_normals(skin, faces);
        let lies_on = |(i, p): (usize, &DVec3)| {
            let hit = theirs.closest(*p, NEAR).filter(|_| wanted(i))?;
            let face = theirs.faces()[hit.face as usize];
            let [a, b, c] = face.map(|v| character.verts[v as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            (normal.dot(normals[i]) > ALIKE).then_some((face, hit.weights))
        };
        Self {
            lies_on: skin.iter().enumerate().map(lies_on).collect(),
            faces: faces.to_vec(),
        }
    }

    /// Our `skin` in a pose [m], raised to where the character's comes out of it; `theirs`: its vertices in that pose [m].
    pub fn over(&self, skin: &mut [DVec3], theirs: &[DVec3]) {
        let normals = vertex_normals(skin, &self.faces);
        let raise = |(i, on): (usize, &Option<Place>)| {
            let Some((face, weights)) = on else {
                return 0.0;
            };
            let corners = face.iter().zip(weights);
            let place: DVec3 = corners.map(|(v, w)| theirs[*v as usize] * *w).sum();
            let off = place - skin[i];
            match off.length() < GONE {
                true => off.dot(normals[i]).clamp(0.0, MOST),
                false => 0.0,
            }
        };
        let mut raised: Vec<f64> = self.lies_on.iter().enumerate().map(raise).collect();
        for _ in 0..ROUNDS {
            self.follow(&mut raised);
        }
        for (x, (n, by)) in skin.iter_mut().zip(normals.iter().zip(raised)) {
            *x += *n * by;
        }
    }

    /// No vertex is lower than the mean of those around it, so that skin rises in hills and not in thorns.
    fn follow(&self, raised: &mut [f64]) {
        let mut around = vec![(0.0, 0.0); raised.len()];
        for face in &self.faces {
            let sum: f64 = face.iter().map(|v| raised[*v as usize]).sum();
            for v in face {
                let (total, count) = &mut around[*v as usize];
                *total += sum - raised[*v as usize];
                *count += 2.0;
            }
        }
        for (own, (total, count)) in raised.iter_mut().zip(around) {
            *own = own.max(total / f64::max(count, 1.0));
        }
    }
}
