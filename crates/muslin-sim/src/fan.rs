//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.

use glam::DVec3;

use crate::{ordered, weave::Weave};

/// Heights count as distances with this much to spare, for fans with obtuse corners.
const SPARE: f64 = 1.25;

/// Vertices whose faces cannot come within `reach` [m] of each other, but at what they share,
/// while every vertex goes straight by its entry of `moves` [m].
pub(crate) fn open(weave: &Weave, (x, moves): (&[DVec3], &[DVec3]), reach: f64) -> Vec<bool> {
    ordered::map(x.len(), |i| {
        let corners = weave.pattern.corners.row(i);
        let faces = || corners.iter().map(|c| weave.faces[*c as usize / 3]);
        let stray = faces().flatten().map(|j| moves[j as usize] - moves[i]);
        let stray = stray.map(|d| d.length_squared()).fold(0.0, f64::max).sqrt();
        let normal = |f: [u32; 3]| {
            let [a, b, c] = f.map(|j| x[j as usize]);
            (b - a).cross(c - a)
        };
        let mean = faces().map(normal).sum::<DVec3>().normalize_or_zero();
        // A fan that goes round more than once has two faces over one direction.
        let mut ahead: Option<DVec3> = None;
        let mut over = 0;
        let heights = faces().zip(corners).all(|(f, c)| {
            let k = *c as usize % 3;
            let [a, b, c] = [0, 1, 2].map(|n| flat(x[f[(k + n) % 3] as usize] - x[i], mean));
            let twice = mean.dot((b - a).cross(c - a));
            let longest = [b - a, c - b, a - c]
                .map(|e| e.length_squared())
                .into_iter()
                .fold(0.0, f64::max);
            let ahead = *ahead.get_or_insert(b - a);
            let before = mean.dot((b - a).cross(ahead)) >= 0.0;
            let behind = mean.dot(ahead.cross(c - a)) > 0.0;
            over += usize::from(before && behind && ahead.dot(b + c - a - a) > 0.0);
            twice > SPARE * (reach + 2.0 * stray) * longest.sqrt()
        });
        heights && over <= 1
    })
}

/// `p` without its part along the unit vector `n`.
fn flat(p: DVec3, n: DVec3) -> DVec3 {
    p - n * p.dot(n)
}
