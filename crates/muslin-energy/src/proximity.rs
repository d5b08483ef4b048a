//! Where two pieces of cloth are nearest, as weights on their four vertices.
//!
//! The weighted sum of the vertices is the vector between the nearest points, ready for
//! [`crate::contact`] and for [`crate::AtPoint::spread`].

use glam::DVec3;

/// `Σ wᵢ xᵢ` [m].
#[inline]
pub fn weighted<const N: usize>(x: &[DVec3; N], weights: &[f64; N]) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for i in 0..N {
        sum += x[i] * weights[i];
    }
    sum
}

/// Weights `[1, −a, −b, −c]` of vertex `x[0]` against the nearest point of triangle `x[1..4]`.
///
/// A triangle without area is treated as its longest-lived side: the nearest point of its edges.
#[inline]
pub fn vertex_triangle(x: &[DVec3; 4]) -> [f64; 4] {
    let [p, a, b, c] = *x;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let n = ab.cross(ac);
    let area = n.length_squared();
    let (beta, gamma) = (ap.cross(ac).dot(n) / area, ab.cross(ap).dot(n) / area);
    if area > 0.0 && beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 {
        return [1.0, beta + gamma - 1.0, -beta, -gamma];
    }
    nearest_side(p, [a, b, c])
}

/// The nearest point of a triangle's rim, as [`vertex_triangle`]'s weights.
fn nearest_side(p: DVec3, corners: [DVec3; 3]) -> [f64; 4] {
    let mut best = (f64::INFINITY, [1.0, -1.0, 0.0, 0.0]);
    for i in 0..3 {
        let j = (i + 1) % 3;
        let t = along(p, corners[i], corners[j]);
        let d = (corners[i].lerp(corners[j], t) - p).length_squared();
        if d < best.0 {
            let mut w = [1.0, 0.0, 0.0, 0.0];
            (w[1 + i], w[1 + j]) = (t - 1.0, -t);
            best = (d, w);
        }
    }
    best.1
}

/// Where on the segment from `a` to `b` the point nearest to `p` is, 0 to 1; 0 if they coincide.
#[inline]
fn along(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let d = b - a;
    let square = d.length_squared();
    if square > 0.0 {
        ((p - a).dot(d) / square).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// Weights `[1−s, s, t−1, −t]` of the nearest points of segments `x[0..2]` and `x[2..4]`.
///
/// Parallel segments have many nearest pairs: one of them is taken, the distance is still right.
#[inline]
pub fn edge_edge(x: &[DVec3; 4]) -> [f64; 4] {
    let (d1, d2, r) = (x[1] - x[0], x[3] - x[2], x[0] - x[2]);
    let (a, e, b) = (d1.length_squared(), d2.length_squared(), d1.dot(d2));
    let det = a * e - b * b;
    let mut s = 0.0;
    if det > 1e-12 * a * e {
        s = ((b * d2.dot(r) - e * d1.dot(r)) / det).clamp(0.0, 1.0);
    } else if a > 0.0 && e > 0.0 {
        s = middle_of_overlap(x, a);
    }
    let on_first = x[0].lerp(x[1], s);
    let t = along(on_first, x[2], x[3]);
    // The clamp of t may have moved it: the first segment answers once more.
    let s = if a > 0.0 {
        along(x[2].lerp(x[3], t), x[0], x[1])
    } else {
        0.0
    };
    [1.0 - s, s, t - 1.0, -t]
}

/// For parallel segments: the middle of the shared stretch, so that the push does not twist.
fn middle_of_overlap(x: &[DVec3; 4], a: f64) -> f64 {
    let place = |p: DVec3| ((p - x[0]).dot(x[1] - x[0]) / a).clamp(0.0, 1.0);
    0.5 * (place(x[2]) + place(x[3]))
}
