//! Where cloth has passed through cloth, and the way back.
//!
//! A crossing is an edge that pierces a face. The line along which two sheets cross shortens when
//! each piercing edge moves along the line into its own sheets; when it has no length left the
//! sheets are apart. That way needs to know neither inside nor outside.
//!
//! Volino and Magnenat-Thalmann 2006 (intersection contour minimisation); the first-order form
//! without their factor two, which the two sheets of an edge supply themselves.

use glam::DVec3;
use muslin_geom::{closest::on_triangle, intersect::segment_meets_triangle};

use crate::weave::Weave;

/// An edge that pierces a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piercing {
    /// The face the edge belongs to, and the corner the edge starts at.
    pub from: (u32, u8),
    /// The face that is pierced.
    pub through: u32,
}

/// The piercing edges of crossing faces.
pub(crate) fn piercings(weave: &Weave, x: &[DVec3], pairs: &[[u32; 2]]) -> Vec<Piercing> {
    let mut out = Vec::new();
    for &[f, g] in pairs {
        for (from, through) in [(f, g), (g, f)] {
            let (edges, face) = (weave.faces[from as usize], weave.faces[through as usize]);
            let t = weave.corners(x, through as usize);
            for k in 0..3 {
                let ends = [edges[k], edges[(k + 1) % 3]];
                let shared = ends.iter().any(|e| face.contains(e));
                if !shared && segment_meets_triangle(ends.map(|i| x[i as usize]), &t) {
                    out.push(Piercing {
                        from: (from, k as u8),
                        through,
                    });
                }
            }
        }
    }
    out
}

/// Displacements that shorten the crossing lines, at most `most` [m] per vertex.
pub(crate) fn way_back(weave: &Weave, x: &[DVec3], found: &[Piercing], most: f64) -> Vec<DVec3> {
    let mut sum = vec![DVec3::ZERO; x.len()];
    for piercing in found {
        let Some((push, s, w)) = push(weave, x, piercing) else {
            continue;
        };
        let edge = weave.faces[piercing.from.0 as usize];
        let k = piercing.from.1 as usize;
        sum[edge[k] as usize] += push * (1.0 - s);
        sum[edge[(k + 1) % 3] as usize] += push * s;
        let face = weave.faces[piercing.through as usize];
        for c in 0..3 {
            sum[face[c] as usize] -= push * w[c];
        }
    }
    let scale = |v: DVec3| v * most;
    sum.into_iter()
        .map(|v| scale(v).clamp_length_max(most))
        .collect()
}

/// Direction for the edge, the place along it, the weights in the face.
fn push(weave: &Weave, x: &[DVec3], found: &Piercing) -> Option<(DVec3, f64, [f64; 3])> {
    let t = weave.corners(x, found.through as usize);
    let normal = (t[1] - t[0]).cross(t[2] - t[0]).try_normalize()?;
    let own = weave.corners(x, found.from.0 as usize);
    let k = found.from.1 as usize;
    let (a, b, c) = (own[k], own[(k + 1) % 3], own[(k + 2) % 3]);
    let edge = (b - a).try_normalize()?;
    let (up, down) = ((b - t[0]).dot(normal), (a - t[0]).dot(normal));
    let s = (down / (down - up)).clamp(0.0, 1.0);
    let place = a.lerp(b, s);
    // Along the crossing line, from the edge into its own sheet.
    let line = normal.cross((b - a).cross(c - a)).try_normalize()?;
    let line = line * (c - a).reject_from_normalized(edge).dot(line).signum();
    let slope = edge.dot(normal);
    let slope = if slope.abs() < 0.1 {
        0.1f64.copysign(slope)
    } else {
        slope
    };
    let push = line - normal * (edge.dot(line) / slope);
    Some((push.normalize_or_zero(), s, on_triangle(place, &t).weights))
}
