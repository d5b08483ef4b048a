//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.

use glam::{Vec2, Vec3A};

use crate::{ordered, weave::Weave};

/// Heights count as distances with this much to spare, for fans with obtuse corners.
const SPARE: f32 = 1.25;

/// Faces around a vertex at most: a fan of more is not asked.
const FACES: usize = 16;

/// Vertices whose faces cannot come within `reach` [m] of each other, but at what they share,
/// while every vertex goes straight by its entry of `moves` [m]; of those that are `asked` about.
/// `x`: as seen from somewhere near [m]; `reach` has room for what single precision leaves open.
pub(crate) fn open(
    weave: &Weave,
    (x, moves): (&[Vec3A], &[Vec3A]),
    (reach, asked): (f32, &[bool]),
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
        let around = weave.pattern.near.row(i).iter();
        let stray = around.map(|j| (moves[*j as usize] - moves[i]).length_squared());
        let room = SPARE * (reach + 2.0 * stray.fold(0.0, f32::max).sqrt());
        // The two sides of every face that start here.
        let mut all = [[Vec3A::ZERO; 2]; FACES];
        let Some(all) = all.get_mut(..corners.len()) else {
            return false;
        };
        for (sides, c) in all.iter_mut().zip(corners) {
            let [b, c] = others(c);
            *sides = [x[b] - x[i], x[c] - x[i]];
        }
        let normals = all.iter().map(|[b, c]| b.cross(*c));
        let Some(mean) = normals.sum::<Vec3A>().try_normalize() else {
            return false;
        };
        // Seen along the mean normal: what lies in its direction does not count.
        let (right, up) = mean.any_orthonormal_pair();
        let seen = |a: &Vec3A| Vec2::new(a.dot(right), a.dot(up));
        // A fan that goes round more than once has two faces over one direction.
        let mut ahead: Option<Vec2> = None;
        let mut over = 0;
        let heights = all.iter().all(|[b, c]| {
            let [b, c] = [b, c].map(seen);
            let twice = b.perp_dot(c);
            let longest = b.length_squared();
            let longest = longest.max(c.length_squared()).max(b.distance_squared(c));
            let ahead = *ahead.get_or_insert(b);
            let before = b.perp_dot(ahead) >= 0.0;
            let behind = ahead.perp_dot(c) > 0.0;
            over += usize::from(before && behind && ahead.dot(b + c) > 0.0);
            twice > 0.0 && twice * twice > room * room * longest
        });
        heights && over <= 1
    })
}
