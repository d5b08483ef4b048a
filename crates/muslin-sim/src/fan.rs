//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.

use glam::DVec3;

use crate::{ordered, weave::Weave};

/// Heights count as distances with this much to spare, for fans with obtuse corners.
const SPARE: f64 = 1.25;

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
        let stray = stray.map(|j| (moves[j] - moves[i]).length_squared());
        let room = SPARE * (reach + 2.0 * stray.fold(0.0, f64::max).sqrt());
        // The two sides of every face that start here.
        let mut all = [[DVec3::ZERO; 2]; FACES];
        let Some(all) = all.get_mut(..corners.len()) else {
            return false;
        };
        for (sides, c) in all.iter_mut().zip(corners) {
            let [b, c] = others(c);
            *sides = [x[b] - x[i], x[c] - x[i]];
        }
        let sides = || all.iter().copied();
        let normals = sides().map(|[b, c]| b.cross(c));
        let mean = normals.sum::<DVec3>().normalize_or_zero();
        // Seen along the mean normal: what lies in its direction does not count.
        let dot = |a: DVec3, b: DVec3| a.dot(b) - a.dot(mean) * b.dot(mean);
        let area = |a: DVec3, b: DVec3| mean.dot(a.cross(b));
        // A fan that goes round more than once has two faces over one direction.
        let mut ahead: Option<DVec3> = None;
        let mut over = 0;
        let heights = sides().all(|[b, c]| {
            let twice = area(b, c);
            let longest = dot(b, b).max(dot(c, c)).max(dot(c - b, c - b));
            let ahead = *ahead.get_or_insert(b);
            let before = area(b, ahead) >= 0.0;
            let behind = area(ahead, c) > 0.0;
            over += usize::from(before && behind && dot(ahead, b + c) > 0.0);
            twice > 0.0 && twice * twice > room * room * longest
        });
        heights && over <= 1
    })
}
