//! Our skin over the character's own in a pose: the two are skinned by different weights, and where theirs comes out of
//! ours by some millimetres, cloth that lies on ours would be pierced by it.

use glam::DVec3;
use muslin_geom::{Surface, neighbours, vertex_normals};

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
    near: Vec<Vec<u32>>,
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
            near: neighbours(skin.len(), faces),
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
            raised = self.followed(&raised);
        }
        for (x, (n, by)) in skin.iter_mut().zip(normals.iter().zip(raised)) {
            *x += *n * by;
        }
    }

    /// No vertex is lower than the mean of those around it, so that skin rises in hills and not in thorns.
    fn followed(&self, raised: &[f64]) -> Vec<f64> {
        let follow = |(own, near): (&f64, &Vec<u32>)| {
            let sum: f64 = near.iter().map(|v| raised[*v as usize]).sum();
            own.max(sum / near.len().max(1) as f64)
        };
        raised.iter().zip(&self.near).map(follow).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of 5 x 5 vertices, 2 cm apart, that faces up.
    fn sheet() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let at = |i: u32| DVec3::new(f64::from(i % 5), f64::from(i / 5), 0.0) * 0.02;
        let cells = (0..20_u32).filter(|i| i % 5 < 4);
        let faces = cells.flat_map(|i| [[i, i + 1, i + 6], [i, i + 6, i + 5]]);
        ((0..25).map(at).collect(), faces.collect())
    }

    #[test]
    fn skin_is_raised_to_what_comes_out_of_it_and_no_farther() {
        let (skin, faces) = sheet();
        let character = Character {
            verts: skin.clone(),
            faces: faces.clone(),
            ..Character::default()
        };
        let covering = Covering::new((&skin, &faces), &character, |i| i != 24);
        let raised = |theirs: f64| {
            let theirs: Vec<DVec3> = skin.iter().map(|p| *p + DVec3::Z * theirs).collect();
            let mut own = skin.clone();
            covering.over(&mut own, &theirs);
            own.into_iter().map(|p| p.z).collect::<Vec<_>>()
        };
        let near = |all: Vec<f64>, z: f64| all.iter().all(|x| (x - z).abs() < 1e-12);
        // The corner that is not to cover follows what is around it.
        assert!(near(raised(0.008), 0.008));
        assert!(near(raised(0.05), MOST));
        assert!(
            near(raised(-0.01), 0.0),
            "what lies under our skin is covered"
        );
        assert!(
            near(raised(0.1), 0.0),
            "what is that far away is something else"
        );
    }

    #[test]
    fn a_side_that_faces_away_is_not_covered() {
        let (skin, faces) = sheet();
        let character = Character {
            verts: skin.clone(),
            faces: faces.iter().map(|f| [f[0], f[2], f[1]]).collect(),
            ..Character::default()
        };
        let covering = Covering::new((&skin, &faces), &character, |_| true);
        assert!(covering.lies_on.iter().all(Option::is_none));
    }
}
