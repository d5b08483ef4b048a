//! Between frames: whether cloth went through the body or through cloth unseen.

use glam::DVec3;
use muslin_geom::bvh::Aabb;
use muslin_geom::{Bvh, closest::on_triangle};
use muslin_io::Clip;
use rayon::prelude::*;

/// How many times a vertex of the cloth passes a triangle of the body between two frames, both
/// moving straight: it is on one side before, on the other after, and within it at the moment
/// between. There and back within one frame is not seen.
pub fn through_body(clip: &Clip, sound: &[bool]) -> usize {
    between(sound, |trees, t| {
        let points = [t - 1, t].map(|t| clip.drape.frames[t].as_slice());
        let body = [t - 1, t].map(|t| clip.body[t].as_slice());
        passages(trees, points, (body, &clip.body_faces), |_, _| false)
    })
}

/// The same of triangles of the cloth that the vertex is no corner of. Who went around a hem or a fold between two
/// frames, on a bent way, may count.
pub fn through_cloth(clip: &Clip, sound: &[bool]) -> usize {
    let faces = &clip.drape.faces;
    between(sound, |trees, t| {
        let x = [t - 1, t].map(|t| clip.drape.frames[t].as_slice());
        passages(trees, x, (x, faces), |i, f| faces[f as usize].contains(&i))
    })
}

/// Over points and over faces, once there are some: they keep their shape from frame to frame.
type Trees = Option<[Bvh; 2]>;

/// The sum over all pairs of frames with finite positions.
fn between(sound: &[bool], count: impl Fn(&mut Trees, usize) -> usize + Sync + Send) -> usize {
    let pairs = (1..sound.len()).into_par_iter();
    let pairs = pairs.filter(|&t| sound[t - 1] && sound[t]);
    pairs.map_init(|| None, count).sum()
}

/// How many pairs of a point and a face, but those of its own, pass one another.
fn passages(
    trees: &mut Trees,
    x: [&[DVec3]; 2],
    (body, faces): ([&[DVec3]; 2], &[[u32; 3]]),
    is_own: impl Fn(u32, u32) -> bool,
) -> usize {
    // What both do together needs no boxes.
    let n = body[0].len().max(1) as f64;
    let shift = body[1]
        .iter()
        .zip(body[0])
        .map(|(a, b)| *a - *b)
        .sum::<DVec3>()
        / n;
    let swept = |a: DVec3, b: DVec3| Aabb::of(&[a, b - shift]);
    let points: Vec<Aabb> = x[0].iter().zip(x[1]).map(|(a, b)| swept(*a, *b)).collect();
    let boxes = faces.iter().map(|f| {
        f.map(|i| swept(body[0][i as usize], body[1][i as usize]))
            .into_iter()
            .reduce(Aabb::union)
            .expect("three corners")
    });
    let boxes: Vec<Aabb> = boxes.collect();
    let trees = trees.get_or_insert_with(|| [&points, &boxes].map(|b| Bvh::over(b)));
    trees[0].refit(&points);
    trees[1].refit(&boxes);
    let near = trees[0].pairs(&trees[1], 0.0);
    let is_passed = |&&[i, f]: &&[u32; 2]| {
        let corners = faces[f as usize];
        let at = |s: f64| {
            let p = x[0][i as usize].lerp(x[1][i as usize], s);
            (
                p,
                corners.map(|c| body[0][c as usize].lerp(body[1][c as usize], s)),
            )
        };
        !is_own(i, f) && passes(at)
    };
    near.iter().filter(is_passed).count()
}

/// Whether the point changes sides within the triangle.
fn passes(at: impl Fn(f64) -> (DVec3, [DVec3; 3])) -> bool {
    let side = |s: f64| {
        let (p, [a, b, c]) = at(s);
        (b - a).cross(c - a).dot(p - a)
    };
    let before = side(0.0) > 0.0;
    if before == (side(1.0) > 0.0) {
        return false;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        match (side(middle) > 0.0) == before {
            true => low = middle,
            false => high = middle,
        }
    }
    let (p, corners) = at(high);
    on_triangle(p, &corners).point.distance(p) < 1e-9
}
