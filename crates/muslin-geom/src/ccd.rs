//! Continuous collision: how far along its way a pair may go before it gets too close.
//!
//! Additive CCD: the distance of a pair divided by the fastest its two sides can approach is a
//! time that is always safe; repeat from there. It needs no root finding, never overshoots and
//! works on relative motion, so that what two sides do together costs nothing.
//!
//! Li, Kaufman and Jiang 2021 (codimensional IPC), additive CCD.

use glam::DVec3;

use crate::closest::{on_segments, on_triangle};

/// What a pair keeps of the distance that it starts with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Share of it, between 0 and 1.
    pub share: f64,
    /// Never less than this [m]; a pair that starts nearer keeps all it has.
    pub least: f64,
    /// Never more than this [m]: who comes from afar may pass as near by as those that lie on each other.
    pub most: f64,
}

impl Keep {
    /// Nothing need be left.
    pub const NOTHING: Self = Self {
        share: 0.0,
        least: 0.0,
        most: f64::INFINITY,
    };
    /// What cloth keeps of its distance from cloth. The least is more than what files round positions
    /// by: cloth that is pressed together without it comes so near within a frame that a file shows it
    /// crossed.
    pub const CLOTH: Self = Self {
        share: 0.2,
        least: 1e-5,
        most: 3e-4,
    };
}

/// Largest safe share of the step, `0..=1`, for the point `x[0]` and the triangle `x[1..4]`.
///
/// `x`: positions [m]; `d`: displacements over the step [m]. The returned share leaves what the pair
/// is to `keep` at every earlier moment; a pair that touches at the start gets 0 unless it does not
/// move relative to itself.
pub fn vertex_triangle(x: &[DVec3; 4], d: &[DVec3; 4], keep: Keep) -> f64 {
    let d = relative(d);
    let speed = d[0].length() + d[1].length().max(d[2].length()).max(d[3].length());
    let gap = |x: &[DVec3; 4]| x[0] - on_triangle(x[0], &[x[1], x[2], x[3]]).point;
    advance(x, (&d, speed, 1), keep, gap)
}

/// Largest safe share of the step for the edges `x[0..2]` and `x[2..4]`; see [`vertex_triangle`].
pub fn edge_edge(x: &[DVec3; 4], d: &[DVec3; 4], keep: Keep) -> f64 {
    let d = relative(d);
    let speed = d[0].length().max(d[1].length()) + d[2].length().max(d[3].length());
    let gap = |x: &[DVec3; 4]| on_segments([x[0], x[1]], [x[2], x[3]]).gap;
    advance(x, (&d, speed, 2), keep, gap)
}

/// Displacements without the part that all four share.
fn relative(d: &[DVec3; 4]) -> [DVec3; 4] {
    let mean = (d[0] + d[1] + d[2] + d[3]) * 0.25;
    d.map(|v| v - mean)
}

/// More advances than this gain nothing; what was reached is safe.
const ADVANCES: usize = 64;

/// `speed`: what the two sides approach each other by at most; `split`: where the second side starts.
fn advance(
    x: &[DVec3; 4],
    (d, speed, split): (&[DVec3; 4], f64, usize),
    keep: Keep,
    gap: impl Fn(&[DVec3; 4]) -> DVec3,
) -> f64 {
    let mut between = gap(x);
    let first = between.length();
    let least = (keep.share * first)
        .min(keep.most)
        .max(keep.least.min(first));
    if speed <= first - least {
        return 1.0;
    }
    // Whoever passes by or parts stays on his side of a slab for longer than speed alone tells. Near the least
    // distance a bound by speed stops everybody.
    let is_close = least > keep.share * first;
    let mut t = 0.0;
    for _ in 0..ADVANCES {
        let at: [DVec3; 4] = std::array::from_fn(|i| x[i] + d[i] * t);
        if t > 0.0 {
            between = gap(&at);
        }
        let by_speed = match is_close {
            true => 0.0,
            false => (between.length() - least).max(0.0) / speed,
        };
        let step = 0.9 * in_slab(&at, (d, split), between, least).max(by_speed);
        t += step;
        if t >= 1.0 {
            return 1.0;
        }
        if step < 1e-4 {
            return t;
        }
    }
    t
}

/// For how long the two sides stay on the two sides of a slab across `between`, the way from the second
/// to the first, as thick as `least` [m].
fn in_slab(x: &[DVec3; 4], (d, split): (&[DVec3; 4], usize), between: DVec3, least: f64) -> f64 {
    let normal = between.normalize_or_zero();
    let mut time = f64::INFINITY;
    for (i, j) in (0..split).flat_map(|i| (split..4).map(move |j| (i, j))) {
        let room = normal.dot(x[i] - x[j]) - least;
        let closing = normal.dot(d[j] - d[i]);
        if room < -ASKEW * least {
            return 0.0;
        } else if closing > 0.0 {
            time = time.min(room.max(0.0) / closing);
        }
    }
    // Sides that touch have no slab between them.
    if normal == DVec3::ZERO { 0.0 } else { time }
}

/// A slab that somebody stands in by this share of its thickness lies askew: what is between sides that
/// almost touch is mostly rounding. It tells nothing.
const ASKEW: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Rng;

    const TENTH: Keep = Keep {
        share: 0.1,
        least: 0.0,
        most: f64::INFINITY,
    };

    #[test]
    fn the_safe_share_never_passes_through() {
        let mut rng = Rng(11);
        let mut stopped = 0;
        for _ in 0..2000 {
            let x: [DVec3; 4] = std::array::from_fn(|_| rng.vec());
            let d: [DVec3; 4] = std::array::from_fn(|_| (rng.vec() - 0.5) * 3.0);
            let t = [vertex_triangle(&x, &d, TENTH), edge_edge(&x, &d, TENTH)];
            let gap = |k: usize, t: f64| {
                let y: [DVec3; 4] = std::array::from_fn(|i| x[i] + d[i] * t);
                match k {
                    0 => on_triangle(y[0], &[y[1], y[2], y[3]]).point.distance(y[0]),
                    _ => on_segments([y[0], y[1]], [y[2], y[3]]).distance,
                }
            };
            for k in 0..2 {
                let dense = (0..=200).map(|s| gap(k, t[k] * f64::from(s) / 200.0));
                let least = dense.fold(f64::INFINITY, f64::min);
                assert!(least >= 0.1 * gap(k, 0.0) - 1e-12, "came to {least}");
                stopped += usize::from(t[k] < 1.0);
            }
        }
        assert!(stopped > 400);
    }

    #[test]
    fn who_passes_by_is_not_stopped() {
        // A metre along a large triangle, or along an edge, a millimetre off.
        let by = [DVec3::X, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
        let corners = [
            DVec3::new(-9.0, 0.0, -9.0),
            DVec3::new(9.0, 0.0, -9.0),
            DVec3::new(0.0, 0.0, 9.0),
        ];
        let at = [DVec3::Y * 1e-3, corners[0], corners[1], corners[2]];
        assert_eq!(vertex_triangle(&at, &by, Keep::CLOTH), 1.0);
        let by = [DVec3::X, DVec3::X, DVec3::ZERO, DVec3::ZERO];
        let ends = [DVec3::Y, DVec3::new(0.0, 1.0, 0.01)].map(|p| p * 1e-3);
        let at = [ends[0], ends[1], DVec3::X * -9.0, DVec3::X * 9.0];
        assert_eq!(edge_edge(&at, &by, Keep::CLOTH), 1.0);
        // Two edges side by side, one of which comes from a centimetre off and goes as far again.
        let ends = [0.0, 0.02].map(|z| DVec3::new(-0.01, 1.4e-3, z));
        let below = [0.0, 0.02].map(|z| DVec3::Z * z);
        let at = [ends[0], ends[1], below[0], below[1]];
        assert_eq!(edge_edge(&at, &by.map(|d| d * 0.02), Keep::CLOTH), 1.0);
        let low = at.map(|p| DVec3::new(p.x, 0.2 * p.y, p.z));
        assert!(edge_edge(&low, &by.map(|d| d * 0.02), Keep::CLOTH) < 0.5);
    }

    #[test]
    fn who_is_nearer_than_the_least_may_part_but_not_approach() {
        let keep = Keep::CLOTH;
        let mut rng = Rng(5);
        let mut parted = 0;
        for k in 0..2000 {
            let mut x: [DVec3; 4] = std::array::from_fn(|_| rng.vec());
            let gap = |x: &[DVec3; 4]| match k % 2 {
                0 => x[0] - on_triangle(x[0], &[x[1], x[2], x[3]]).point,
                _ => on_segments([x[0], x[1]], [x[2], x[3]]).gap,
            };
            // Brought to a few times the least distance, or less.
            let near = 4e-5 * rng.unit();
            let shift = gap(&x) - gap(&x).normalize_or_zero() * near;
            (0..2 - (k + 1) % 2).for_each(|i| x[i] -= shift);
            let d: [DVec3; 4] = std::array::from_fn(|_| (rng.vec() - 0.5) * 1e-3);
            let t = match k % 2 {
                0 => vertex_triangle(&x, &d, keep),
                _ => edge_edge(&x, &d, keep),
            };
            let first = gap(&x).length();
            let least = (0.2 * first).max(first.min(1e-5)) * 0.98;
            for s in 0..=100 {
                let y = std::array::from_fn(|i| x[i] + d[i] * (t * f64::from(s) / 100.0));
                assert!(
                    gap(&y).length() >= least,
                    "{k}: {first} to {}",
                    gap(&y).length()
                );
            }
            parted += usize::from(t == 1.0 && first < 1e-5);
        }
        assert!(parted > 100, "{parted}");
    }

    #[test]
    fn a_head_on_hit_is_stopped_just_before() {
        let x = [
            DVec3::Y,
            DVec3::X,
            DVec3::Z,
            -DVec3::ONE * DVec3::new(1.0, 0.0, 1.0),
        ];
        let d = [DVec3::Y * -2.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
        let t = vertex_triangle(&x, &d, TENTH);
        assert!((0.40..0.4501).contains(&t), "{t}");
    }

    #[test]
    fn moving_together_costs_nothing() {
        let x = [DVec3::Y * 1e-6, DVec3::X, DVec3::Z, -DVec3::X];
        assert_eq!(vertex_triangle(&x, &[DVec3::ONE * 7.0; 4], TENTH), 1.0);
        assert_eq!(edge_edge(&x, &[DVec3::ONE * 7.0; 4], TENTH), 1.0);
    }
}
