//! Which pieces of cloth are near which: the list that contact and the safe step share.

use glam::DVec3;
use muslin_geom::{
    bvh::{Bvh, Swept},
    closest::{on_segments, on_triangle},
};

use crate::{fan, ordered, region::Distances, weave::Weave};

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
    /// How far apart regions of the cloth were.
    distances: Distances,
}

impl Neighbours {
    /// Finds the pairs within `reach` [m] at `x`. `tree` is a tree over the faces, of any shape.
    pub fn find(weave: &Weave, tree: &Bvh, x: &[DVec3], reach: f64) -> Neighbours {
        on_the_way(weave, tree, (x, &vec![DVec3::ZERO; x.len()]), reach)
    }

    /// Whether the list still holds every pair within `radius` [m] after the cloth moved to `x`.
    ///
    /// What neighbours do together does not count.
    pub fn covers(
        &self,
        weave: &Weave,
        x: impl Fn(usize) -> DVec3 + Sync + Send,
        radius: f64,
    ) -> bool {
        let gone = |v: usize| x(v) - self.at[v];
        let regions = (&weave.regions, self.reach);
        self.at.len() == weave.n_verts() && self.distances.hold(regions, gone, radius)
    }
}

/// The pairs that could come within `reach` [m] while every vertex goes straight by its entry of
/// `moves` [m]; a list for where they arrive.
///
/// What neighbours do together does not bring them together: only the difference of their moves
/// counts against the distance between them.
pub(crate) fn on_the_way(
    weave: &Weave,
    tree: &Bvh,
    (x, moves): (&[DVec3], &[DVec3]),
    reach: f64,
) -> Neighbours {
    let open = fan::open(weave, (x, moves), reach);
    let verts = ordered::map(x.len(), |i| Swept::point(x[i] - x[0], moves[i], reach));
    let around = |v: &[u32]| {
        let ways = v.iter().map(|i| verts[*i as usize]);
        ways.reduce(Swept::union).expect("features have vertices")
    };
    let faces = ordered::map(weave.faces.len(), |f| around(&weave.faces[f]));
    let scene = Scene {
        edges: &ordered::map(weave.edges.len(), |e| around(&weave.edges[e])),
        verts: &verts,
        faces: &faces,
        weave,
        x,
        moves,
        reach,
    };
    let list = tree.meeting(&faces, |f, g, out| {
        let (mine, theirs) = (weave.faces[f], weave.faces[g]);
        let apart = |v: u32| theirs.contains(&v) && open[v as usize];
        if !mine.into_iter().any(apart) {
            scene.features((f, g), out);
        }
    });
    let at = ordered::map(x.len(), |i| x[i] + moves[i]);
    Neighbours {
        list,
        distances: Distances::between(&weave.regions, &at),
        at,
        reach,
    }
}

/// Where everything is and goes, and what is asked about two faces.
struct Scene<'a> {
    weave: &'a Weave,
    x: &'a [DVec3],
    moves: &'a [DVec3],
    verts: &'a [Swept],
    edges: &'a [Swept],
    faces: &'a [Swept],
    reach: f64,
}

impl Scene<'_> {
    /// Adds the pairs of features of faces `f` and `g` that may come within reach.
    fn features(&self, (f, g): (usize, usize), out: &mut Vec<Near>) {
        self.vertices((f, g), out);
        self.vertices((g, f), out);
        let mut theirs = [0; 3];
        let mut n = 0;
        for e in self
            .edges(g)
            .filter(|e| self.edges[*e].meets(&self.faces[f]))
        {
            theirs[n] = e;
            n += 1;
        }
        if n == 0 {
            return;
        }
        for e in self.edges(f) {
            let [a, b] = self.weave.edges[e];
            for &other in &theirs[..n] {
                let [c, d] = self.weave.edges[other];
                let apart = a != c && a != d && b != c && b != d;
                let meet = || self.edges[e].meets(&self.edges[other]);
                if apart && meet() && self.edges_near([a, b, c, d]) {
                    out.push(Near {
                        verts: [a, b, c, d],
                        is_edges: true,
                    });
                }
            }
        }
    }

    /// Adds the vertices of face `f` that may come near face `g`.
    fn vertices(&self, (f, g): (usize, usize), out: &mut Vec<Near>) {
        let t = self.weave.faces[g];
        for v in self.weave.owned[f].verts {
            if v == u32::MAX || t.contains(&v) {
                continue;
            }
            let meet = self.verts[v as usize].meets(&self.faces[g]);
            if meet && self.vertex_near(v, t) {
                out.push(Near {
                    verts: [v, t[0], t[1], t[2]],
                    is_edges: false,
                });
            }
        }
    }

    /// The edges that face `f` answers for.
    fn edges(&self, f: usize) -> impl Iterator<Item = usize> {
        let owned = self.weave.owned[f].edges.into_iter();
        owned.filter(|e| *e != u32::MAX).map(|e| e as usize)
    }

    /// Largest of the relative moves of two vertices, squared [m²].
    fn drift(&self, a: u32, b: u32) -> f64 {
        self.moves[a as usize].distance_squared(self.moves[b as usize])
    }

    fn vertex_near(&self, v: u32, t: [u32; 3]) -> bool {
        let p = self.x[v as usize];
        let drift = t.map(|c| self.drift(v, c)).into_iter().fold(0.0, f64::max);
        let reach = self.reach + drift.sqrt();
        let t = t.map(|i| self.x[i as usize]);
        on_triangle(p, &t).point.distance_squared(p) <= reach * reach
    }

    fn edges_near(&self, v: [u32; 4]) -> bool {
        let [a, b, c, d] = v;
        let drift = [(a, c), (a, d), (b, c), (b, d)].map(|(i, j)| self.drift(i, j));
        let reach = self.reach + drift.into_iter().fold(0.0, f64::max).sqrt();
        let [a, b, c, d] = v.map(|i| self.x[i as usize]);
        on_segments([a, b], [c, d]).distance <= reach
    }
}
