//! Continuous collision: how far along its way a pair may go before it gets too close.
//!
//! Additive CCD: the distance of a pair divided by the fastest its two sides can approach is a
//! time that is always safe; repeat from there. It needs no root finding, never overshoots and
//! works on relative motion, so that what two sides do together costs nothing.
//!
//! Li, Kaufman and Jiang 2021 (codimensional IPC), additive CCD.

use glam::DVec3;

use crate::closest::{on_segments, on_triangle};

/// Largest safe share of the step, `0..=1`, for the point `x[0]` and the triangle `x[1..4]`.
///
/// `x`: positions [m]; `d`: displacements over the step [m]. The returned share leaves at least
/// `keep` (between 0 and 1) of the first distance at every earlier moment; a pair that touches
/// at the start gets 0 unless it does not move relative to itself.
pub fn vertex_triangle(x: &[DVec3; 4], d: &[DVec3; 4], keep: f64) -> f64 {
    let d = relative(d);
    let speed = d[0].length() + d[1].length().max(d[2].length()).max(d[3].length());
    let distance = |x: &[DVec3; 4]| on_triangle(x[0], &[x[1], x[2], x[3]]).point.distance(x[0]);
    advance(x, &d, speed, keep, distance)
}

/// Largest safe share of the step for the edges `x[0..2]` and `x[2..4]`; see [`vertex_triangle`].
pub fn edge_edge(x: &[DVec3; 4], d: &[DVec3; 4], keep: f64) -> f64 {
    let d = relative(d);
    let speed = d[0].length().max(d[1].length()) + d[2].length().max(d[3].length());
    let distance = |x: &[DVec3; 4]| on_segments([x[0], x[1]], [x[2], x[3]]).distance;
    advance(x, &d, speed, keep, distance)
}

/// Displacements without the part that all four share.
fn relative(d: &[DVec3; 4]) -> [DVec3; 4] {
    let mean = (d[0] + d[1] + d[2] + d[3]) * 0.25;
    d.map(|v| v - mean)
}

/// More advances than this gain nothing; what was reached is safe.
const ADVANCES: usize = 64;

fn advance(
    x: &[DVec3; 4],
    d: &[DVec3; 4],
    speed: f64,
    keep: f64,
    distance: impl Fn(&[DVec3; 4]) -> f64,
) -> f64 {
    let first = distance(x);
    if speed <= first * (1.0 - keep) {
        return 1.0;
    }
    let least = keep * first;
    let mut t = 0.0;
    let mut room = first;
    for _ in 0..ADVANCES {
        let step = 0.9 * (room - least).max(0.0) / speed;
        t += step;
        if t >= 1.0 {
            return 1.0;
        }
        if step < 1e-4 {
            return t;
        }
        room = distance(&std::array::from_fn(|i| x[i] + d[i] * t));
    }
    t
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Rng;

    #[test]
    fn the_safe_share_never_passes_through() {
        let mut rng = Rng(11);
        let mut stopped = 0;
        for _ in 0..2000 {
            let x: [DVec3; 4] = std::array::from_fn(|_| rng.vec());
            let d: [DVec3; 4] = std::array::from_fn(|_| (rng.vec() - 0.5) * 3.0);
            let t = [vertex_triangle(&x, &d, 0.1), edge_edge(&x, &d, 0.1)];
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
    fn a_head_on_hit_is_stopped_just_before() {
        let x = [
            DVec3::Y,
            DVec3::X,
            DVec3::Z,
            -DVec3::ONE * DVec3::new(1.0, 0.0, 1.0),
        ];
        let d = [DVec3::Y * -2.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
        let t = vertex_triangle(&x, &d, 0.1);
        assert!((0.40..0.4501).contains(&t), "{t}");
    }

    #[test]
    fn moving_together_costs_nothing() {
        let x = [DVec3::Y * 1e-6, DVec3::X, DVec3::Z, -DVec3::X];
        assert_eq!(vertex_triangle(&x, &[DVec3::ONE * 7.0; 4], 0.1), 1.0);
        assert_eq!(edge_edge(&x, &[DVec3::ONE * 7.0; 4], 0.1), 1.0);
    }
}
