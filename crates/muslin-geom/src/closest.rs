//! Closest points, and the signed distance to a surface.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::bvh::{Aabb, Bvh, face_boxes};
use crate::intersect;

/// A point of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnTriangle {
    /// Where it is [m].
    pub point: DVec3,
    /// Its weights on the three corners; they sum to one.
    pub weights: [f64; 3],
}

/// The point of triangle `t` closest to `p`; a degenerate triangle acts as its edges.
///
/// Ericson, Real-Time Collision Detection, 5.1.5.
pub fn on_triangle(p: DVec3, t: &[DVec3; 3]) -> OnTriangle {
    let [a, b, c] = *t;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let at = |u: f64, v: f64, w: f64| OnTriangle {
        point: a + ab * v + ac * w,
        weights: [u, v, w],
    };
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(1.0, 0.0, 0.0);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return at(0.0, 1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        let v = d1 / (d1 - d3);
        return at(1.0 - v, v, 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        let w = d2 / (d2 - d6);
        return at(1.0 - w, 0.0, w);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 && d4 + d5 > d3 + d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(0.0, 1.0 - w, w);
    }
    let sum = va + vb + vc;
    if sum.is_nan() || sum <= 0.0 {
        return on_rim(p, t);
    }
    let s = 1.0 / sum;
    at(1.0 - vb * s - vc * s, vb * s, vc * s)
}

/// The point of a triangle's edges closest to `p`.
fn on_rim(p: DVec3, t: &[DVec3; 3]) -> OnTriangle {
    let edge = |k: usize| {
        let (from, to) = (t[k], t[(k + 1) % 3]);
        let [share, _] = on_segments([from, to], [p, p]).at;
        let mut weights = [0.0; 3];
        (weights[k], weights[(k + 1) % 3]) = (1.0 - share, share);
        OnTriangle {
            point: from + (to - from) * share,
            weights,
        }
    };
    let far = |hit: &OnTriangle| hit.point.distance_squared(p);
    let [ab, bc, ca] = [edge(0), edge(1), edge(2)];
    let nearer = |a, b| if far(&b) < far(&a) { b } else { a };
    nearer(nearer(ab, bc), ca)
}

/// The closest points of two segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnSegments {
    /// Parameters along the first and the second segment, `0..=1`.
    pub at: [f64; 2],
    /// From the second segment's point to the first's [m].
    pub gap: DVec3,
    /// Length of the gap [m].
    pub distance: f64,
}

/// The closest points of segments `a` and `b`; either may be a point, and they may be parallel.
///
/// Ericson, Real-Time Collision Detection, 5.1.9.
pub fn on_segments(a: [DVec3; 2], b: [DVec3; 2]) -> OnSegments {
    let (d, e, r) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (dd, ee, f) = (d.length_squared(), e.length_squared(), e.dot(r));
    let (de, c) = (d.dot(e), d.dot(r));
    let tiny = f64::MIN_POSITIVE;
    let clamp = |x: f64| x.clamp(0.0, 1.0);
    let (mut s, mut t) = (0.0, 0.0);
    if dd > tiny {
        let denom = dd * ee - de * de;
        if denom > 1e-14 * dd * ee {
            s = clamp((de * f - c * ee) / denom);
        }
        t = if ee > tiny { (de * s + f) / ee } else { 0.0 };
        if !(0.0..=1.0).contains(&t) || ee <= tiny {
            t = clamp(t);
            s = clamp((de * t - c) / dd);
        }
    } else if ee > tiny {
        t = clamp(f / ee);
    }
    let gap = (a[0] + d * s) - (b[0] + e * t);
    OnSegments {
        at: [s, t],
        gap,
        distance: gap.length(),
    }
}

/// Where a query met a [`Surface`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// The triangle.
    pub face: u32,
    /// The surface point's weights on its corners.
    pub weights: [f64; 3],
    /// The surface point [m].
    pub point: DVec3,
    /// Unit pseudo-normal there, outward.
    pub normal: DVec3,
    /// Distance [m]: positive outside, negative inside.
    pub signed: f64,
}

/// Where a straight way passes through a [`Surface`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Share of the way, `0..=1`.
    pub at: f64,
    /// The triangle.
    pub face: u32,
    /// Whether the way comes from behind the triangle, as from inside to outside.
    pub leaves: bool,
}

/// A triangle surface that answers how far a point is, and on which side.
///
/// The side is told by angle-weighted pseudo-normals, which is exact for a closed surface
/// without self-intersections (Bærentzen and Aanæs 2005); an open surface answers by its nearest
/// piece. [`Surface::sided`] tells it beside folds as well.
///
/// Copies share what is the same wherever its vertices are.
#[derive(Clone, Debug)]
pub struct Surface {
    faces: Arc<[[u32; 3]]>,
    /// For every face, the edge from each corner to the next.
    face_edges: Arc<[[u32; 3]]>,
    of_edge: Uses,
    of_vertex: Uses,
    /// Whether every edge has two faces.
    is_closed: bool,
    verts: Vec<DVec3>,
    bvh: Bvh,
}

impl Surface {
    /// A surface over triangles, counter-clockwise seen from outside.
    pub fn new(verts: &[DVec3], faces: &[[u32; 3]]) -> Surface {
        let (face_edges, n_edges) = number_edges(verts.len(), faces);
        let of_edge = Uses::new(n_edges, &face_edges);
        Surface {
            faces: faces.into(),
            is_closed: (0..n_edges as u32).all(|e| of_edge.of(e).len() == 2),
            of_edge,
            of_vertex: Uses::new(verts.len(), faces),
            face_edges: face_edges.into(),
            verts: verts.to_vec(),
            bvh: Bvh::over(&face_boxes(verts, faces)),
        }
    }

    /// The surface at other positions [m] of the same vertices: its tree keeps its shape.
    pub fn moved(&self, verts: &[DVec3]) -> Surface {
        Surface {
            verts: verts.to_vec(),
            bvh: self.bvh.moved(&face_boxes(verts, &self.faces)),
            faces: self.faces.clone(),
            face_edges: self.face_edges.clone(),
            of_edge: self.of_edge.clone(),
            of_vertex: self.of_vertex.clone(),
            is_closed: self.is_closed,
        }
    }

    /// Moves the surface to new positions [m] of the same vertices.
    pub fn refit(&mut self, verts: &[DVec3]) {
        self.verts.clear();
        self.verts.extend_from_slice(verts);
        self.bvh.refit(&face_boxes(verts, &self.faces));
    }

    /// Positions [m].
    pub fn verts(&self) -> &[DVec3] {
        &self.verts
    }

    /// Triangles.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// The tree over the triangles' boxes.
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// Corners of a face [m].
    pub fn corners(&self, face: u32) -> [DVec3; 3] {
        let [a, b, c] = self.faces[face as usize];
        let at = |i: u32| self.verts[i as usize];
        [at(a), at(b), at(c)]
    }

    /// The nearest surface point closer than `within` [m].
    pub fn closest(&self, p: DVec3, within: f64) -> Option<Closest> {
        self.bounded(p, within * within, None)
    }

    /// As [`Surface::closest`], sped up by a face that was near before.
    pub fn closest_near(&self, p: DVec3, within: f64, hint: u32) -> Option<Closest> {
        let d = self.distance_squared(p, hint);
        let bound = within * within;
        if d < bound {
            self.bounded(p, d, Some(hint))
        } else {
            self.bounded(p, bound, None)
        }
    }

    fn bounded(&self, p: DVec3, bound: f64, hint: Option<u32>) -> Option<Closest> {
        let distance = |f: u32| self.distance_squared(p, f);
        let face = self.bvh.nearest(p, bound, distance).map(|b| b.0).or(hint)?;
        Some(self.at(p, face))
    }

    /// How far `p` is from one face, squared [m²].
    pub fn distance_squared(&self, p: DVec3, face: u32) -> f64 {
        let nearest = on_triangle(p, &self.corners(face)).point;
        nearest.distance_squared(p)
    }

    /// The point of one face nearest to `p`, with the side of the surface that `p` is on.
    pub fn at(&self, p: DVec3, face: u32) -> Closest {
        let hit = on_triangle(p, &self.corners(face));
        let normal = self.pseudo_normal(face, hit.weights);
        let away = p - hit.point;
        let signed = away.length() * if away.dot(normal) < 0.0 { -1.0 } else { 1.0 };
        Closest {
            face,
            weights: hit.weights,
            point: hit.point,
            normal,
            signed,
        }
    }

    /// What the surface answered about `p`, with the side told by how often it winds around `p` where it is closed.
    /// Beside skin that a fold turns inside out the nearest triangle faces the wrong way, and where two parts of a
    /// body lie in each other it may be of the one and `p` in the other.
    pub fn sided(&self, p: DVec3, hit: Closest) -> Closest {
        if !self.is_closed {
            return hit;
        }
        let is_inside = self.winding(p) > 0;
        if is_inside == (hit.signed < 0.0) {
            return hit;
        }
        let side = if is_inside { -1.0 } else { 1.0 };
        let away = p - hit.point;
        Closest {
            normal: away.try_normalize().map_or(-hit.normal, |n| n * side),
            signed: away.length() * side,
            ..hit
        }
    }

    /// How far `p` is from the surface, if that is less than `within` [m]: negative inside, as [`Surface::sided`] tells it.
    pub fn signed(&self, p: DVec3, within: f64) -> Option<f64> {
        let hit = self.closest(p, within)?;
        Some(self.sided(p, hit).signed)
    }

    fn pseudo_normal(&self, face: u32, w: [f64; 3]) -> DVec3 {
        let f = face as usize;
        let zero = w.map(|x| x <= 0.0);
        match zero {
            [false, true, true] => self.vertex_normal(self.faces[f][0]),
            [true, false, true] => self.vertex_normal(self.faces[f][1]),
            [true, true, false] => self.vertex_normal(self.faces[f][2]),
            [false, false, true] => self.edge_normal(self.face_edges[f][0]),
            [true, false, false] => self.edge_normal(self.face_edges[f][1]),
            [false, true, false] => self.edge_normal(self.face_edges[f][2]),
            _ => self.face_normal(face),
        }
    }

    /// How many times the surface winds around `p`: 1 inside a closed surface, 0 outside, 2 where
    /// it overlaps itself. The signed crossings of a ray are counted.
    pub fn winding(&self, p: DVec3) -> i32 {
        // A direction no model is aligned with, so that rays rarely graze edges.
        let dir = DVec3::new(0.310_7, 0.912_3, 0.266_1);
        let mut turns = 0;
        self.along(p, dir * 1e3, |crossing| {
            turns += if crossing.leaves { 1 } else { -1 }
        });
        turns
    }

    /// Calls `visit` with every triangle that the straight way from `p` by `d` [m] passes
    /// through, in no particular order. A way that grazes an edge may miss it.
    pub fn along(&self, p: DVec3, d: DVec3, mut visit: impl FnMut(Crossing)) {
        let inv = d.recip();
        let meets = |b: &Aabb| {
            let (a, b) = ((b.min - p) * inv, (b.max - p) * inv);
            let (near, far) = (
                a.min(b).max_element().max(0.0),
                a.max(b).min_element().min(1.0),
            );
            near <= far
        };
        self.bvh.each(meets, &mut |face| {
            if let Some((at, leaves)) = crossing(p, d, &self.corners(face)) {
                visit(Crossing { at, face, leaves });
            }
        });
    }

    /// Pairs `[own face, other's face]` that share a point: as [`crate::intersecting_pairs`], without new trees.
    pub fn intersections(&self, other: &Surface) -> Vec<[u32; 2]> {
        intersect::meetings(
            (&self.bvh, (&self.verts, &self.faces)),
            (&other.bvh, (&other.verts, &other.faces)),
        )
    }

    /// Pairs of own faces that cross: as [`crate::self_intersections`], without a new tree.
    pub fn self_intersections(&self) -> Vec<[u32; 2]> {
        intersect::crossings((&self.bvh, (&self.verts, &self.faces)))
    }

    /// Unit normal of a face; zero where it has no area.
    pub fn face_normal(&self, face: u32) -> DVec3 {
        normal(&self.corners(face)).normalize_or_zero()
    }

    fn edge_normal(&self, edge: u32) -> DVec3 {
        let faces = self.of_edge.of(edge).iter();
        let sum: DVec3 = faces.map(|&corner| self.face_normal(corner / 3)).sum();
        sum.normalize_or_zero()
    }

    /// Unit pseudo-normal at a vertex; zero where nothing is attached.
    pub fn vertex_normal(&self, vertex: u32) -> DVec3 {
        let at = |&corner: &u32| {
            let x = self.corners(corner / 3);
            normal(&x).normalize_or_zero() * angle(&x, corner as usize % 3)
        };
        let sum: DVec3 = self.of_vertex.of(vertex).iter().map(at).sum();
        sum.normalize_or_zero()
    }

    /// Unit pseudo-normals at all vertices.
    pub fn vertex_normals(&self) -> Vec<DVec3> {
        let all = (0..self.verts.len() as u32).into_par_iter();
        let all = all.with_min_len(MANY);
        all.map(|i| self.vertex_normal(i)).collect()
    }
}

/// Vertices that are worth handing to another thread.
const MANY: usize = 1024;

/// Normal of a triangle, twice its area long [m²].
fn normal(x: &[DVec3; 3]) -> DVec3 {
    (x[1] - x[0]).cross(x[2] - x[0])
}

/// Angle at a corner of a triangle [rad].
fn angle(x: &[DVec3; 3], corner: usize) -> f64 {
    let [p, q, r] = [0, 1, 2].map(|k| x[(corner + k) % 3]);
    let (a, b) = (q - p, r - p);
    a.cross(b).length().atan2(a.dot(b))
}

/// Corners `3 face + corner` of every vertex or edge, in ascending order.
#[derive(Clone, Debug)]
struct Uses {
    start: Arc<[u32]>,
    corners: Arc<[u32]>,
}

impl Uses {
    fn new(n: usize, used: &[[u32; 3]]) -> Uses {
        let mut start = vec![0; n + 1];
        let used = used.as_flattened();
        used.iter().for_each(|&i| start[i as usize + 1] += 1);
        for i in 0..n {
            start[i + 1] += start[i];
        }
        let (mut next, mut corners) = (start.clone(), vec![0; used.len()]);
        for (corner, &i) in used.iter().enumerate() {
            corners[next[i as usize] as usize] = corner as u32;
            next[i as usize] += 1;
        }
        Uses {
            start: start.into(),
            corners: corners.into(),
        }
    }

    fn of(&self, i: u32) -> &[u32] {
        let i = i as usize;
        &self.corners[self.start[i] as usize..self.start[i + 1] as usize]
    }
}

/// Where the way from `p` by `d` passes through a triangle, and whether along its normal.
fn crossing(p: DVec3, d: DVec3, t: &[DVec3; 3]) -> Option<(f64, bool)> {
    let [a, b, c] = t.map(|v| v - p);
    let (u, v, w) = (d.dot(c.cross(b)), d.dot(a.cross(c)), d.dot(b.cross(a)));
    let same = (u > 0.0 && v > 0.0 && w > 0.0) || (u < 0.0 && v < 0.0 && w < 0.0);
    if !same {
        return None;
    }
    let det = u + v + w;
    let at = (a * u + b * v + c * w).dot(d) / (det * d.length_squared());
    (at > 0.0 && at <= 1.0).then_some((at, det < 0.0))
}

/// Numbers the edges of `faces` of `n` vertices in the order of their ends, smaller one first, and counts them. Edge `k` of a
/// face goes from its corner `k` to the next.
pub fn number_edges(n: usize, faces: &[[u32; 3]]) -> (Vec<[u32; 3]>, usize) {
    let low = |f: &[u32; 3]| [0, 1, 2].map(|k| f[k].min(f[(k + 1) % 3]));
    let low: Vec<[u32; 3]> = faces.iter().map(low).collect();
    let uses = Uses::new(n, &low);
    let (mut face_edges, mut n_edges) = (vec![[0; 3]; faces.len()], 0);
    let mut row = Vec::new();
    for v in 0..n as u32 {
        row.clear();
        row.extend(uses.of(v).iter().map(|&corner| {
            let (f, k) = (faces[corner as usize / 3], corner as usize % 3);
            (f[k].max(f[(k + 1) % 3]), corner)
        }));
        row.sort_unstable();
        for (k, &(end, corner)) in row.iter().enumerate() {
            n_edges += usize::from(k == 0 || row[k - 1].0 != end);
            face_edges[corner as usize / 3][corner as usize % 3] = n_edges as u32 - 1;
        }
    }
    (face_edges, n_edges)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Rng, sphere};

    #[test]
    fn the_closest_point_of_a_triangle_beats_a_fine_grid() {
        let mut rng = Rng(21);
        for _ in 0..300 {
            let t = [rng.vec(), rng.vec(), rng.vec()];
            let p = rng.vec() * 3.0 - 1.0;
            let got = on_triangle(p, &t);
            let rebuilt = t[0] * got.weights[0] + t[1] * got.weights[1] + t[2] * got.weights[2];
            assert!(rebuilt.distance(got.point) < 1e-12);
            let mut best = f64::INFINITY;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    best = best.min((t[0] * (1.0 - u - v) + t[1] * u + t[2] * v).distance(p));
                }
            }
            let d = got.point.distance(p);
            assert!(d <= best + 1e-12 && best - d < 0.05, "{d} against {best}");
        }
    }

    #[test]
    fn the_closest_points_of_segments_beat_a_fine_grid() {
        let mut rng = Rng(22);
        for i in 0..400 {
            let a = [rng.vec(), rng.vec()];
            let b = match i % 4 {
                0 => [a[0] + DVec3::Z, a[1] + DVec3::Z], // parallel
                1 => [rng.vec(); 2],                     // a point
                _ => [rng.vec(), rng.vec()],
            };
            let got = on_segments(a, b);
            let mut best = f64::INFINITY;
            for (j, k) in (0..=50).flat_map(|j| (0..=50).map(move |k| (j, k))) {
                let (s, t) = (f64::from(j) / 50.0, f64::from(k) / 50.0);
                best = best.min(a[0].lerp(a[1], s).distance(b[0].lerp(b[1], t)));
            }
            assert!(got.distance <= best + 1e-9 && best - got.distance < 0.05);
            let back = a[0].lerp(a[1], got.at[0]) - b[0].lerp(b[1], got.at[1]);
            assert!(back.distance(got.gap) < 1e-12);
        }
    }

    #[test]
    fn triangles_without_area_act_as_their_edges() {
        let mut rng = Rng(25);
        for k in 0..400 {
            let (a, way) = (rng.vec(), rng.vec() - 0.5);
            // All in one place, two in one place each, or all on a line.
            let [u, v, w] = [
                [0.0, 0.0, 0.0],
                [0.0, 0.0, 1.0],
                [0.0, 1.0, 0.0],
                [0.0, 1.0, 1.0],
                [0.0, 1.0, 0.3],
            ][k % 5];
            let p = rng.vec() * 3.0 - 1.0;
            let got = on_triangle(p, &[u, v, w].map(|s| a + way * s)).point;
            let ends = [0.0f64, u.max(v).max(w)].map(|s| a + way * s);
            let want = on_segments(ends, [p, p]).distance;
            assert!((got.distance(p) - want).abs() < 1e-9, "{k}: {got}, {want}");
        }
    }

    #[test]
    fn signed_distance_and_winding_know_inside_from_outside() {
        let mesh = sphere(24, 40);
        let surface = Surface::new(&mesh.verts, &mesh.faces);
        let mut rng = Rng(23);
        let mut inside = 0;
        for _ in 0..500 {
            let p = (rng.vec() - 0.5) * 3.0;
            let hit = surface
                .closest(p, 10.0)
                .expect("everything is within ten metres");
            assert!(
                (hit.signed - (p.length() - 1.0)).abs() < 0.02,
                "{} at {p}",
                hit.signed
            );
            assert_eq!(surface.winding(p), i32::from(hit.signed < 0.0));
            inside += usize::from(hit.signed < 0.0);
            let hinted = surface
                .closest_near(p, 10.0, 7)
                .expect("the hint is near enough");
            assert!((hinted.signed - hit.signed).abs() < 1e-12);
        }
        assert!(inside > 30);
        assert_eq!(surface.closest(DVec3::X * 3.0, 1.0), None);
    }

    #[test]
    fn a_spike_is_outside_whatever_face_is_nearest() {
        // Beyond a sharp tip the nearest point is the tip: one face's normal alone would be wrong.
        let verts = vec![
            DVec3::Y * 5.0,
            DVec3::new(1.0, 0.0, 1.0),
            DVec3::new(1.0, 0.0, -1.0),
            DVec3::new(-1.0, 0.0, -1.0),
            DVec3::new(-1.0, 0.0, 1.0),
        ];
        let faces = [
            [0, 1, 2],
            [0, 2, 3],
            [0, 3, 4],
            [0, 4, 1],
            [1, 4, 3],
            [1, 3, 2],
        ];
        let surface = Surface::new(&verts, &faces);
        for p in [
            DVec3::new(0.5, 5.2, 0.0),
            DVec3::new(0.0, 5.2, -0.5),
            DVec3::Y * 5.1,
        ] {
            assert!(surface.closest(p, 9.0).expect("near").signed > 0.0);
        }
        assert!(surface.closest(DVec3::Y, 9.0).expect("near").signed < 0.0);
    }

    #[test]
    fn beside_a_fold_that_is_inside_out_the_side_is_still_told() {
        // The pole of a ball is pulled down through its other side: what comes out there faces inward.
        let mut mesh = sphere(24, 32);
        mesh.verts[0].y = -1.4;
        let surface = Surface::new(&mesh.verts, &mesh.faces);
        let beside = DVec3::new(0.05, -1.35, 0.02);
        let [below, within, above] = [-1.6, -0.9, 1.2].map(|y| DVec3::new(0.011, y, 0.007));
        let at = |p| surface.closest(p, 9.0).expect("near");
        assert!(at(beside).signed < 0.0, "the nearest triangle is misled");
        let told = surface.sided(beside, at(beside));
        assert!((told.signed + at(beside).signed).abs() < 1e-12);
        let away = (beside - told.point).normalize();
        assert!(told.normal.distance(away) < 1e-9 && told.point == at(beside).point);
        for p in [below, above, DVec3::X * 0.8] {
            let is_inside = p.length() < 1.0;
            assert_eq!(surface.sided(p, at(p)).signed < 0.0, is_inside, "{p}");
            assert_eq!(surface.signed(p, 9.0), Some(surface.sided(p, at(p)).signed));
        }
        // What the tip holds once more is outside, on its way through the ball as well.
        assert_eq!(surface.winding(within), 0);
        // An open surface has no sides but those of its triangles.
        let open = Surface::new(&mesh.verts, &mesh.faces[1..]);
        let hit = open.closest(beside, 9.0).expect("near");
        assert!(hit.signed < 0.0 && open.sided(beside, hit) == hit);
    }

    #[test]
    fn a_refitted_surface_is_where_it_was_moved_to() {
        let mesh = sphere(10, 16);
        let surface = Surface::new(&mesh.verts, &mesh.faces);
        let moved: Vec<DVec3> = mesh.verts.iter().map(|p| *p * 2.0 + DVec3::X).collect();
        let surface = surface.moved(&moved);
        let hit = surface.closest(DVec3::X, 9.0).expect("near");
        assert!((-2.0..-1.9).contains(&hit.signed), "{}", hit.signed);
    }
}
