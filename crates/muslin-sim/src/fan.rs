//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.

use glam::{DVec3, Vec3A};

use crate::{ordered, weave::Weave};

/// Heights count as distances with this much to spare, for fans with obtuse corners; beside it what single precision
/// loses is nothing.
const SPARE: f32 = 1.25;

/// Faces around a vertex at most: a fan of more is not asked.
const FACES: usize = 16;

/// Vertices whose faces cannot come within `reach` [m] of each other, but at what they share,
/// while every vertex goes straight by its entry of `moves` [m]; of those that are `asked` about.
pub(crate) fn open(
    weave: &Weave,
    (x, moves): (&[DVec3], &[DVec3]),
    (reach, asked): (f64, &[bool]),
) -> Vec<bool> {
    ordered::map(x.len(), |i| {
        if !asked[i] {
            return false;
        }
        let corners = weave.pattern.corners.row(i);
        let others = |c: &u32| {
            let (f, k) = (weave.faces[*c as usize / 3], *c as usize % 3);
            [1, 2].map(|n| f[(k + n) % 3] as usize)
        };
        let stray = corners.iter().flat_map(others);
        let stray = stray.map(|j| (moves[j] - moves[i]).as_vec3a().length_squared());
        let room = SPARE * (reach as f32 + 2.0 * stray.fold(0.0, f32::max).sqrt());
        // The two sides of every face that start here.
        let mut all = [[Vec3A::ZERO; 2]; FACES];
        let Some(all) = all.get_mut(..corners.len()) else {
            return false;
        };
        for (sides, c) in all.iter_mut().zip(corners) {
            let [b, c] = others(c);
            *sides = [b, c].map(|j| (x[j] - x[i]).as_vec3a());
        }
        let sides = || all.iter().copied();
        let normals = sides().map(|[b, c]| b.cross(c));
        let mean = normals.sum::<Vec3A>().normalize_or_zero();
        let area = |a: Vec3A, b: Vec3A| mean.dot(a.cross(b));
        // A fan that goes round more than once has two faces over one direction, seen along the mean normal.
        let mut ahead: Option<Vec3A> = None;
        let mut over = 0;
        let heights = sides().all(|[b, c]| {
            let twice = area(b, c);
            // Seen so, sides are no longer than they are.
            let longest = (b.length_squared().max(c.length_squared())).max(b.distance_squared(c));
            let ahead = *ahead.get_or_insert(b);
            let before = area(b, ahead) >= 0.0;
            let behind = area(ahead, c) > 0.0;
            let along = |a: Vec3A, b: Vec3A| a.dot(b) - a.dot(mean) * b.dot(mean);
            over += usize::from(before && behind && along(ahead, b + c) > 0.0);
            twice > 0.0 && twice * twice > room * room * longest
        });
        heights && over <= 1
    })
}
