//! Which pieces of cloth are near which: the list that contact and the safe step share.

use glam::DVec3;
use muslin_geom::{
    bvh::{Aabb, Bvh, face_boxes},
    closest::{on_segments, on_triangle},
};
use rayon::prelude::*;

use crate::weave::Weave;

/// Two features that may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Near {
    /// A vertex and a triangle, or two edges.
    pub verts: [u32; 4],
    pub is_edges: bool,
}

/// All pairs of features within reach, found at `at`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    pub list: Vec<Near>,
    /// Positions the list was made at [m].
    at: Vec<DVec3>,
    /// Distance below which every pair is in the list [m].
    reach: f64,
}

/// Pairs of triangles tested by one task.
const PAIRS: usize = 2048;

impl Neighbours {
    /// Finds the pairs within `reach` [m] at `x`. `tree` is a tree over the faces, of any shape.
    pub fn find(weave: &Weave, tree: &mut Bvh, x: &[DVec3], reach: f64) -> Neighbours {
        let boxes = face_boxes(x, &weave.faces);
        tree.refit(&boxes);
        let scene = Scene {
            weave,
            x,
            boxes: &boxes,
        };
        let pairs = tree.self_pairs(reach);
        let lists: Vec<Vec<Near>> = pairs
            .par_chunks(PAIRS)
            .map(|chunk| {
                let mut out = Vec::new();
                for &[f, g] in chunk {
                    scene.features((f as usize, g as usize), reach, &mut out);
                }
                out
            })
            .collect();
        Neighbours {
            list: lists.concat(),
            at: x.to_vec(),
            reach,
        }
    }

    /// Whether the list still holds every pair within `radius` [m] after the cloth moved to `x`.
    pub fn covers(&self, x: &[DVec3], radius: f64) -> bool {
        let room = 0.5 * (self.reach - radius);
        self.at.len() == x.len()
            && room >= 0.0
            && self
                .at
                .iter()
                .zip(x)
                .all(|(a, b)| a.distance_squared(*b) <= room * room)
    }
}

/// The pairs that could come within `reach` [m] while every vertex goes straight by its entry of
/// `moves` [m]; a list for where they arrive.
///
/// What neighbours do together does not bring them together: only the difference of their moves
/// counts against the distance between them.
pub(crate) fn on_the_way(
    weave: &Weave,
    tree: &mut Bvh,
    (x, moves): (&[DVec3], &[DVec3]),
    reach: f64,
) -> Neighbours {
    let still = face_boxes(x, &weave.faces);
    let there: Vec<DVec3> = x.iter().zip(moves).map(|(x, m)| *x + *m).collect();
    let swept: Vec<Aabb> = (still.iter().zip(&weave.faces))
        .map(|(b, f)| b.union(Aabb::of_face(&there, *f)))
        .collect();
    tree.refit(&swept);
    let scene = Scene {
        weave,
        x,
        boxes: &still,
    };
    let motions: Vec<Motion> = weave.faces.iter().map(|f| Motion::of(f, moves)).collect();
    let lists: Vec<Vec<Near>> = tree
        .self_pairs(reach)
        .par_chunks(PAIRS)
        .map(|chunk| {
            let mut out = Vec::new();
            for &[f, g] in chunk {
                let (f, g) = (f as usize, g as usize);
                let reach = motions[f].against(&motions[g]) + reach;
                if still[f].grown(reach).overlaps(&still[g]) {
                    scene.features((f, g), reach, &mut out);
                }
            }
            out
        })
        .collect();
    Neighbours {
        list: lists.concat(),
        at: there,
        reach,
    }
}

/// How a face moves: the mean of its corners, and how far a corner strays from it [m].
struct Motion {
    mean: DVec3,
    stray: f64,
}

impl Motion {
    fn of(face: &[u32; 3], moves: &[DVec3]) -> Motion {
        let m = face.map(|i| moves[i as usize]);
        let mean = (m[0] + m[1] + m[2]) / 3.0;
        let stray = m.iter().map(|v| v.distance(mean)).fold(0.0, f64::max);
        Motion { mean, stray }
    }

    /// Most that two faces can approach each other [m].
    fn against(&self, other: &Motion) -> f64 {
        self.mean.distance(other.mean) + self.stray + other.stray
    }
}

/// Where faces are, and what is asked about two of them.
struct Scene<'a> {
    weave: &'a Weave,
    x: &'a [DVec3],
    boxes: &'a [Aabb],
}

impl Scene<'_> {
    /// Adds the pairs of features of faces `f` and `g` that are within `reach` [m].
    fn features(&self, (f, g): (usize, usize), reach: f64, out: &mut Vec<Near>) {
        for (mine, other) in [(f, g), (g, f)] {
            let (t, around) = (self.weave.faces[other], self.boxes[other].grown(reach));
            for v in self.weave.owned[mine].verts {
                if v != u32::MAX && !t.contains(&v) && self.vertex_near(v, t, (&around, reach)) {
                    out.push(Near {
                        verts: [v, t[0], t[1], t[2]],
                        is_edges: false,
                    });
                }
            }
        }
        let (mine, theirs) = (&self.weave.owned[f].edges, &self.weave.owned[g].edges);
        let (near_f, near_g) = (self.boxes[f].grown(reach), self.boxes[g].grown(reach));
        for &e in mine.iter().filter(|e| self.edge_near(**e, &near_g)) {
            for &d in theirs.iter().filter(|d| self.edge_near(**d, &near_f)) {
                let ([a, b], [c, d]) = (self.weave.edges[e as usize], self.weave.edges[d as usize]);
                let apart = a != c && a != d && b != c && b != d;
                if apart && self.edges_near([a, b, c, d], reach) {
                    out.push(Near {
                        verts: [a, b, c, d],
                        is_edges: true,
                    });
                }
            }
        }
    }

    fn vertex_near(&self, v: u32, t: [u32; 3], (around, reach): (&Aabb, f64)) -> bool {
        let p = self.x[v as usize];
        if !around.overlaps(&Aabb { min: p, max: p }) {
            return false;
        }
        let t = t.map(|i| self.x[i as usize]);
        on_triangle(p, &t).point.distance_squared(p) <= reach * reach
    }

    /// Whether an edge, if there is one, meets a box.
    fn edge_near(&self, e: u32, around: &Aabb) -> bool {
        e != u32::MAX && {
            let [a, b] = self.weave.edges[e as usize].map(|i| self.x[i as usize]);
            around.overlaps(&Aabb {
                min: a.min(b),
                max: a.max(b),
            })
        }
    }

    fn edges_near(&self, v: [u32; 4], reach: f64) -> bool {
        let [a, b, c, d] = v.map(|i| self.x[i as usize]);
        (a.min(b) - reach).cmple(c.max(d)).all()
            && (c.min(d) - reach).cmple(a.max(b)).all()
            && on_segments([a, b], [c, d]).distance <= reach
    }
}
