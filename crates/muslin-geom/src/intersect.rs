//! Exact intersection of triangles: what two meshes share, decided without rounding.
//!
//! Every decision is the sign of a determinant computed exactly (adaptive predicates), so that
//! "no intersection" is a fact about the given coordinates. Sets are closed: touching counts.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use robust::{Coord, Coord3D};

use crate::Mesh;
use crate::bvh::{Bvh, face_boxes};

/// Pairs `[face of a, face of b]` that share a point, in ascending order.
pub fn intersecting_pairs(a: &Mesh, b: &Mesh) -> Vec<[u32; 2]> {
    let [of_a, of_b] = [a, b].map(|m| Bvh::over(&face_boxes(&m.verts, &m.faces)));
    meetings((&of_a, (&a.verts, &a.faces)), (&of_b, (&b.verts, &b.faces)))
}

/// Vertices [m] and triangles, and the tree over them.
type Placed<'a> = (&'a Bvh, (&'a [DVec3], &'a [[u32; 3]]));

/// [`intersecting_pairs`] of triangles that have trees.
pub(crate) fn meetings(a: Placed<'_>, b: Placed<'_>) -> Vec<[u32; 2]> {
    keep(a.0.pairs(b.0, 0.0), |&[i, j]| {
        triangles_meet(&corners(a.1, i), &corners(b.1, j))
    })
}

/// Pairs `[i, j]`, `i < j`, of a mesh's own triangles that cross each other, in ascending order.
///
/// Triangles that share no vertex cross when they share a point. Those that share one vertex
/// cross when the edge opposite to it meets the other triangle. Neighbours across an edge are
/// never counted. An empty list means that no edge pierces a triangle it does not touch by
/// construction.
pub fn self_intersections(mesh: &Mesh) -> Vec<[u32; 2]> {
    let tree = Bvh::over(&face_boxes(&mesh.verts, &mesh.faces));
    crossings((&tree, (&mesh.verts, &mesh.faces)))
}

/// [`self_intersections`] of triangles that have a tree.
pub(crate) fn crossings((tree, (verts, faces)): Placed<'_>) -> Vec<[u32; 2]> {
    let of = |face: u32| {
        let face = faces[face as usize];
        (face, face.map(|v| verts[v as usize]))
    };
    keep(tree.self_pairs(0.0), |&[i, j]| faces_cross(of(i), of(j)))
}

/// Whether two faces of one mesh cross, each given by its vertices and where these are; see [`self_intersections`].
fn faces_cross((f, a): ([u32; 3], [DVec3; 3]), (g, b): ([u32; 3], [DVec3; 3])) -> bool {
    let held = |k: &usize| g.contains(&f[*k]);
    let mut shared = (0..3).filter(held);
    match (shared.next(), shared.next()) {
        (None, _) => triangles_meet(&a, &b),
        (Some(k), None) => {
            let same = |l: &usize| g[*l] == f[k];
            let l = (0..3).find(same).expect("k is shared, so g holds it");
            let (mine, theirs) = (opposite(&a, k), opposite(&b, l));
            !parted_at(a[k], mine, theirs)
                && (segment_meets_triangle(mine, &b) || segment_meets_triangle(theirs, &a))
        }
        _ => false,
    }
}

fn corners((verts, faces): (&[DVec3], &[[u32; 3]]), face: u32) -> [DVec3; 3] {
    faces[face as usize].map(|i| verts[i as usize])
}

fn edges(t: &[DVec3; 3]) -> [[DVec3; 2]; 3] {
    [0, 1, 2].map(|k| opposite(t, k))
}

/// The edge opposite to corner `k`.
fn opposite(t: &[DVec3; 3], k: usize) -> [DVec3; 2] {
    [t[(k + 1) % 3], t[(k + 2) % 3]]
}

fn keep(pairs: Vec<[u32; 2]>, test: impl Fn(&[u32; 2]) -> bool + Sync) -> Vec<[u32; 2]> {
    let mut hits: Vec<[u32; 2]> = pairs.into_par_iter().filter(|p| test(p)).collect();
    hits.sort_unstable();
    hits
}

/// Whether two closed triangles share a point; degenerate ones count as segments or points.
pub fn triangles_meet(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    if parted(a, b) || separated(a, b) || separated(b, a) {
        return false;
    }
    // Two convex sets that meet, meet on an edge of one of them.
    edges(a).into_iter().any(|e| segment_meets_triangle(e, b))
        || edges(b).into_iter().any(|e| segment_meets_triangle(e, a))
}

/// How far along a way places go at most and at least, counted from somewhere near, and by how much rounding may be wrong
/// there.
struct Extent {
    most: f64,
    least: f64,
    error: f64,
}

impl Extent {
    /// `places`: differences of two points, each rounded once.
    #[inline]
    fn new<const N: usize>(way: DVec3, places: [DVec3; N]) -> Self {
        let mut to = Self {
            most: f64::NEG_INFINITY,
            least: f64::INFINITY,
            error: f64::MIN_POSITIVE,
        };
        for p in places {
            let far = p.dot(way);
            to.most = to.most.max(far);
            to.least = to.least.min(far);
            to.error += ROUNDING * p.abs().dot(way.abs());
        }
        to
    }

    /// Whether all of this is before all of `other`, without a doubt.
    fn is_before(&self, other: &Self) -> bool {
        other.least - self.most > self.error + other.error
    }
}

/// A sum of three products of differences is rounded by less than this share of what they are without their signs: no
/// product meets more than six operations, each of which rounds by 2⁻⁵³ at most.
const ROUNDING: f64 = 1e-15;

/// Whether two triangles lie on either side of a plane across the way between their middles. Most that are near each
/// other do, and it takes no exact number to know that: a doubt is a no.
fn parted(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let (a, b) = (a.map(|p| p - a[0]), b.map(|p| p - a[0]));
    let way = (b[0] + b[1] + b[2]) - (a[1] + a[2]);
    Extent::new(way, a).is_before(&Extent::new(way, b))
}

/// The same of two edges and a corner that both their triangles share, on the plane.
fn parted_at(corner: DVec3, a: [DVec3; 2], b: [DVec3; 2]) -> bool {
    let [a, b] = [a, b].map(|edge| edge.map(|p| p - corner));
    let (to_a, to_b) = (a[0] + a[1], b[0] + b[1]);
    let way = to_b * to_a.length() - to_a * to_b.length();
    let here = Extent::new(way, [DVec3::ZERO]);
    Extent::new(way, a).is_before(&here) && here.is_before(&Extent::new(way, b))
}

/// Whether all of `b` lies strictly on one side of `a`'s plane.
fn separated(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let s = b.map(|p| side(a, p));
    s.iter().all(|&x| x > 0) || s.iter().all(|&x| x < 0)
}

/// Whether a closed segment and a closed triangle share a point; either may be degenerate.
pub fn segment_meets_triangle(s: [DVec3; 2], t: &[DVec3; 3]) -> bool {
    let Some(axis) = solid_axis(t) else {
        return (0..3).any(|k| segments_meet(s, [t[k], t[(k + 1) % 3]]));
    };
    let (p, q) = (side(t, s[0]), side(t, s[1]));
    if p * q > 0 {
        return false;
    }
    if p == 0 && q == 0 {
        return meets_in_plane(s.map(|v| flat(v, axis)), t.map(|v| flat(v, axis)));
    }
    let turns = [0, 1, 2].map(|k| side(&[s[0], s[1], t[k]], t[(k + 1) % 3]));
    !(turns.contains(&1) && turns.contains(&-1))
}

/// The segment and the triangle, both in one plane; the triangle is not degenerate.
fn meets_in_plane(s: [DVec2; 2], t: [DVec2; 3]) -> bool {
    let turns = [0, 1, 2].map(|k| turn(t[k], t[(k + 1) % 3], s[0]));
    let inside = !(turns.contains(&1) && turns.contains(&-1));
    inside || (0..3).any(|k| segments_meet_in_plane(s, [t[k], t[(k + 1) % 3]]))
}

/// Whether two closed segments in space share a point; either may be a single point.
fn segments_meet(s: [DVec3; 2], t: [DVec3; 2]) -> bool {
    if side(&[s[0], s[1], t[0]], t[1]) != 0 {
        return false;
    }
    let points = [s[0], s[1], t[0], t[1]];
    let solid = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    let axis = solid.iter().find_map(|k| solid_axis(&k.map(|i| points[i])));
    // All on one line: they meet on the axis along which the line is longest, exactly.
    let Some(axis) = axis else {
        return overlap_on_line(s, t);
    };
    segments_meet_in_plane(s.map(|v| flat(v, axis)), t.map(|v| flat(v, axis)))
}

fn overlap_on_line(s: [DVec3; 2], t: [DVec3; 2]) -> bool {
    (0..3).all(|k| {
        let (a, b) = (s[0][k].min(s[1][k]), s[0][k].max(s[1][k]));
        let (c, d) = (t[0][k].min(t[1][k]), t[0][k].max(t[1][k]));
        a <= d && c <= b
    })
}

fn segments_meet_in_plane(s: [DVec2; 2], t: [DVec2; 2]) -> bool {
    let on_s = [turn(s[0], s[1], t[0]), turn(s[0], s[1], t[1])];
    let on_t = [turn(t[0], t[1], s[0]), turn(t[0], t[1], s[1])];
    if on_s[0] * on_s[1] < 0 && on_t[0] * on_t[1] < 0 {
        return true;
    }
    let within = |o: i32, a: [DVec2; 2], p: DVec2| {
        o == 0 && p.cmpge(a[0].min(a[1])).all() && p.cmple(a[0].max(a[1])).all()
    };
    within(on_s[0], s, t[0])
        || within(on_s[1], s, t[1])
        || within(on_t[0], t, s[0])
        || within(on_t[1], t, s[1])
}

/// Sign of the volume that `t` and `p` span: 0 when exactly coplanar.
fn side(t: &[DVec3; 3], p: DVec3) -> i32 {
    let c = |v: DVec3| Coord3D {
        x: v.x,
        y: v.y,
        z: v.z,
    };
    sign(robust::orient3d(c(t[0]), c(t[1]), c(t[2]), c(p)))
}

/// Sign of the turn `a → b → c`: 0 when exactly on a line.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> i32 {
    let to = |v: DVec2| Coord { x: v.x, y: v.y };
    sign(robust::orient2d(to(a), to(b), to(c)))
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

/// An axis along which the triangle projects to a proper triangle; none if its corners are
/// exactly on a line.
fn solid_axis(t: &[DVec3; 3]) -> Option<usize> {
    (0..3).find(|&k| turn(flat(t[0], k), flat(t[1], k), flat(t[2], k)) != 0)
}

/// The point without its coordinate `axis`.
fn flat(v: DVec3, axis: usize) -> DVec2 {
    match axis {
        0 => DVec2::new(v.y, v.z),
        1 => DVec2::new(v.z, v.x),
        _ => DVec2::new(v.x, v.y),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Rng, sphere};

    fn of(mesh: &Mesh, face: u32) -> [DVec3; 3] {
        corners((&mesh.verts, &mesh.faces), face)
    }

    fn v(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    const FLOOR: [DVec3; 3] = [
        DVec3::ZERO,
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.0, 0.0, 1.0),
    ];

    fn meets_floor(t: [DVec3; 3]) -> bool {
        let answer = triangles_meet(&FLOOR, &t);
        for k in 0..3 {
            let (a, b) = (
                [FLOOR[k], FLOOR[(k + 1) % 3], FLOOR[(k + 2) % 3]],
                [t[1], t[0], t[2]],
            );
            assert_eq!(
                triangles_meet(&a, &b),
                answer,
                "corner order must not matter"
            );
            assert_eq!(triangles_meet(&b, &a), answer, "the relation is symmetric");
        }
        answer
    }

    #[test]
    fn every_way_to_touch_counts() {
        let (up, out) = (v(0.0, 1.0, 0.0), v(5.0, 5.0, 0.0));
        assert!(
            meets_floor([v(0.2, -1.0, 0.2), v(0.2, 1.0, 0.2), out]),
            "pierced"
        );
        assert!(
            meets_floor([v(0.2, 0.0, 0.2), up, out]),
            "a corner on the inside"
        );
        assert!(
            meets_floor([v(0.5, 0.0, 0.5), up, out]),
            "a corner on an edge"
        );
        assert!(
            meets_floor([v(1.0, 0.0, 0.0), up, out]),
            "a corner on a corner"
        );
        assert!(
            meets_floor([v(0.5, -1.0, 0.0), v(0.5, 1.0, 0.0), v(0.5, 0.0, -3.0)]),
            "edges"
        );
        assert!(
            meets_floor([v(0.1, 0.0, 0.1), v(0.2, 0.0, 0.1), v(0.1, 0.0, 0.2)]),
            "inside it"
        );
        assert!(
            meets_floor([v(-9.0, 0.0, -9.0), v(9.0, 0.0, -9.0), v(0.0, 0.0, 9.0)]),
            "around"
        );
        assert!(
            meets_floor([v(0.5, 0.0, 0.5), v(2.0, 0.0, 2.0), v(2.0, 0.0, 0.0)]),
            "in plane"
        );
    }

    #[test]
    fn what_does_not_touch_does_not_count() {
        let tiny = f64::EPSILON;
        assert!(
            !meets_floor([v(0.2, tiny, 0.2), v(0.3, 1.0, 0.2), v(0.2, 1.0, 0.5)]),
            "above"
        );
        assert!(!meets_floor([
            v(1.0 + tiny, 0.0, 0.0),
            v(2.0, 1.0, 0.0),
            v(2.0, 1.0, 1.0)
        ]));
        assert!(
            !meets_floor([v(1.0, 0.0, 1.0), v(2.0, 0.0, 1.0), v(1.0, 0.0, 2.0)]),
            "coplanar"
        );
        assert!(
            !meets_floor([v(2.0, -1.0, 2.0), v(2.0, 1.0, 2.0), v(3.0, 0.0, 2.0)]),
            "beside"
        );
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let p = v(0.25, 0.0, 0.25);
        assert!(meets_floor([p, p, p]));
        assert!(!meets_floor([p + DVec3::Y; 3]));
        assert!(
            meets_floor([p - DVec3::Y, p + DVec3::Y, p]),
            "a needle through"
        );
        assert!(!meets_floor([
            v(2.0, -1.0, 2.0),
            v(2.0, 1.0, 2.0),
            v(2.0, 0.0, 2.0)
        ]));
        let needle = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert!(triangles_meet(
            &needle,
            &[DVec3::X * 2.0, DVec3::X * 3.0, DVec3::X * 4.0]
        ));
        assert!(!triangles_meet(
            &needle,
            &[DVec3::X * 3.0, DVec3::X * 4.0, DVec3::X * 5.0]
        ));
        assert!(triangles_meet(
            &needle,
            &[v(1.0, -1.0, 0.0), v(1.0, 1.0, 0.0), v(1.0, 2.0, 0.0)]
        ));
    }

    #[test]
    fn surfaces_that_moved_meet_as_meshes_there_do() {
        let mut rng = Rng(5);
        let mut soup = |at: DVec3| -> Mesh {
            let verts: Vec<DVec3> = (0..60).map(|_| at + rng.vec()).collect();
            let faces = (0..20).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
            Mesh { verts, faces }
        };
        let [before, a, b] = [DVec3::X * 3.0, DVec3::ZERO, DVec3::X * 0.3].map(&mut soup);
        let mut moved = crate::Surface::new(&before.verts, &before.faces);
        moved.refit(&a.verts);
        let other = crate::Surface::new(&b.verts, &b.faces);
        let (met, crossed) = (moved.intersections(&other), moved.self_intersections());
        assert!(met.len() > 5 && crossed.len() > 5, "{met:?} {crossed:?}");
        assert_eq!(met, intersecting_pairs(&a, &b));
        assert_eq!(crossed, self_intersections(&a));
    }

    #[test]
    fn random_triangles_agree_with_a_rounded_solution() {
        let mut rng = Rng(9);
        let mut hits = 0;
        for _ in 0..4000 {
            let t = [rng.vec(), rng.vec(), rng.vec()];
            let s = [rng.vec(), rng.vec()];
            let m = glam::DMat3::from_cols(t[1] - t[0], t[2] - t[0], s[0] - s[1]);
            let w = m.inverse() * (s[0] - t[0]);
            let want = w.x > 0.0 && w.y > 0.0 && w.x + w.y < 1.0 && w.z > 0.0 && w.z < 1.0;
            assert_eq!(segment_meets_triangle(s, &t), want);
            hits += usize::from(want);
        }
        assert!(hits > 200);
    }

    #[test]
    fn two_spheres_meet_in_a_ring_and_a_sphere_alone_is_clean() {
        let a = sphere(12, 20);
        assert_eq!(self_intersections(&a), Vec::<[u32; 2]>::new());
        let moved = |d: f64| Mesh {
            verts: a.verts.iter().map(|p| *p + DVec3::X * d).collect(),
            faces: a.faces.clone(),
        };
        assert!(intersecting_pairs(&a, &moved(2.01)).is_empty());
        let near = moved(1.0);
        let got = intersecting_pairs(&a, &near);
        let mut want = Vec::new();
        for i in 0..a.faces.len() as u32 {
            let hit = |j: &u32| triangles_meet(&of(&a, i), &of(&near, *j));
            want.extend((0..a.faces.len() as u32).filter(hit).map(|j| [i, j]));
        }
        assert_eq!(got, want);
        assert!(!got.is_empty());
    }

    #[test]
    fn what_a_plane_parts_never_meets_however_little_is_between() {
        let rng = &mut Rng(5);
        let meets = |e: [DVec3; 2], t: &[DVec3; 3]| segment_meets_triangle(e, t);
        let (mut parted_ones, mut met) = (0, 0);
        for k in 0..30_000 {
            // A corner of the one on, before or behind the other, by what a number can just tell.
            let far = DVec3::splat(f64::from(k % 3) * 7.0);
            let mut a = [0; 3].map(|_| far + rng.vec());
            let mut b = [0; 3].map(|_| far + rng.vec());
            if k % 2 == 0 {
                b[0] = a[0].lerp(a[1], rng.unit()).lerp(a[2], rng.unit());
                b[0].y += (rng.unit() - 0.5) * 1e-15;
            }
            if k % 5 == 0 {
                // So small that products vanish.
                a = a.map(|p| p * 1e-165);
                b = b.map(|p| p * 1e-165);
            }
            let want = edges(&a).into_iter().any(|e| meets(e, &b))
                || edges(&b).into_iter().any(|e| meets(e, &a));
            assert!(!(parted(&a, &b) && want), "{a:?} {b:?}");
            parted_ones += usize::from(parted(&a, &b));
            met += usize::from(want);

            b[0] = a[0];
            let (mine, theirs) = (opposite(&a, 0), opposite(&b, 0));
            let want = meets(mine, &b) || meets(theirs, &a);
            assert!(!(parted_at(a[0], mine, theirs) && want), "{a:?} {b:?}");
        }
        assert!(parted_ones > 3000 && met > 3000, "{parted_ones} {met}");

        // In a sheet no pair takes more than that but at the poles.
        let mesh = sphere(12, 20);
        for [i, j] in Bvh::over(&face_boxes(&mesh.verts, &mesh.faces)).self_pairs(0.0) {
            let [f, g] = [i, j].map(|k| mesh.faces[k as usize]);
            let shared: Vec<usize> = (0..3).filter(|k| g.contains(&f[*k])).collect();
            if let [k] = shared[..] {
                let l = (0..3).find(|l| g[*l] == f[k]).expect("shared");
                let [a, b] = [of(&mesh, i), of(&mesh, j)];
                let is_pole = a[k].y.abs() > 0.99;
                assert!(is_pole || parted_at(a[k], opposite(&a, k), opposite(&b, l)));
            }
        }
    }

    #[test]
    fn a_fan_folded_through_itself_is_counted() {
        // Two triangles share only the origin; the far edge of one pierces the other.
        let verts = vec![
            DVec3::ZERO,
            v(2.0, -1.0, 0.0),
            v(2.0, 1.0, 0.0),
            v(1.0, 0.0, -1.0),
            v(1.0, 0.0, 1.0),
        ];
        let mesh = Mesh {
            verts,
            faces: vec![[0, 1, 2], [0, 3, 4]],
        };
        assert_eq!(self_intersections(&mesh), vec![[0, 1]]);
        let flat = Mesh {
            faces: vec![[0, 1, 2], [0, 2, 3]],
            ..mesh
        };
        assert!(self_intersections(&flat).is_empty());
    }
}
