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
        if let Some(corner) = shared_corner(weave, piercing) {
            unfold(weave, x, (piercing, corner), &mut sum);
            continue;
        }
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

/// The corner that both faces of a piercing have, if any.
fn shared_corner(weave: &Weave, found: &Piercing) -> Option<u32> {
    let [own, other] = [found.from.0, found.through].map(|f| weave.faces[f as usize]);
    own.into_iter().find(|v| other.contains(v))
}

/// A corner of one face that went through the plane of another.
struct Strayed {
    corner: u32,
    /// The face it went through.
    past: [u32; 3],
    /// Its way back to the plane [m].
    back: DVec3,
}

/// Turns faces apart that pass through each other about a corner of both: their line ends in that corner, and would
/// shorten only by drawing them together there. Of their other corners the one that is through by the least goes back.
fn unfold(weave: &Weave, x: &[DVec3], (found, about): (&Piercing, u32), sum: &mut [DVec3]) {
    let [f, g] = [found.from.0, found.through].map(|f| weave.faces[f as usize]);
    let strayed = |(own, past): ([u32; 3], [u32; 3])| {
        let [a, b, c] = past.map(|v| x[v as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        own.map(|corner| Strayed {
            corner,
            past,
            back: normal * (a - x[corner as usize]).dot(normal),
        })
    };
    let all = [(f, g), (g, f)].into_iter().flat_map(strayed);
    let others = all.filter(|s| s.corner != about);
    let least = others.min_by(|s, t| s.back.length_squared().total_cmp(&t.back.length_squared()));
    let Some(least) = least else { return };
    let way = least.back.normalize_or_zero();
    sum[least.corner as usize] += way;
    for v in least.past.into_iter().filter(|v| *v != about) {
        sum[v as usize] -= 0.5 * way;
    }
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

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use muslin_geom::Surface;

    use super::*;
    use crate::{cloth::Cloth, testing::sheets};

    #[test]
    fn faces_that_turned_through_each_other_about_a_corner_come_apart() {
        // A pyramid of four faces, one corner of whose square was drawn over the opposite side.
        let square = [[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]].map(DVec2::from);
        let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
        let flat = |v: u32| v.checked_sub(1).map_or(DVec2::ZERO, |k| square[k as usize]);
        let (sheets, _) = sheets(0.05);
        let cloth = Cloth {
            rest: faces.iter().map(|f: &[u32; 3]| f.map(flat)).collect(),
            material_of: vec![0; 4],
            layers: vec![0; 5],
            faces,
            ..sheets
        };
        let weave = Weave::new(&cloth).expect("valid");
        let mut x: Vec<DVec3> = (0..5).map(|v| flat(v).extend(0.0)).collect();
        x[0].z = 0.005;
        x[3] = DVec3::new(0.005, -0.014, 0.0);
        let crossing = |x: &[DVec3]| Surface::new(x, &weave.faces).self_intersections();
        assert_eq!(crossing(&x), [[0, 2]]);
        let start = x.clone();
        for _ in 0..8 {
            let found = piercings(&weave, &x, &crossing(&x));
            let moves = way_back(&weave, &x, &found, 1e-3);
            x.iter_mut().zip(moves).for_each(|(x, m)| *x += m);
        }
        assert!(crossing(&x).is_empty());
        let apex = [&start, &x].map(|x| x[0]);
        assert_eq!(apex[0], apex[1]);
    }
}
