//! A bounding-volume tree over boxes: who is near whom, in logarithmic time.
//!
//! The tree keeps its shape when the boxes move ([`Bvh::refit`]); every answer comes in an order
//! that depends on the boxes alone, never on the number of threads.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

/// An axis-aligned box [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner; below `min` in an empty box.
    pub max: DVec3,
}

impl Aabb {
    /// The box of no points.
    pub const EMPTY: Aabb = Aabb {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    /// The smallest box around `points`.
    pub fn of(points: &[DVec3]) -> Aabb {
        points.iter().fold(Aabb::EMPTY, |b, &p| Aabb {
            min: b.min.min(p),
            max: b.max.max(p),
        })
    }

    /// The box of triangle corners.
    pub fn of_face(verts: &[DVec3], face: [u32; 3]) -> Aabb {
        Aabb::of(&face.map(|i| verts[i as usize]))
    }

    /// The smallest box around both.
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// The box larger by `margin` on every side.
    pub fn grown(self, margin: f64) -> Aabb {
        Aabb {
            min: self.min - margin,
            max: self.max + margin,
        }
    }

    /// Whether the closed boxes share a point.
    pub fn overlaps(&self, other: &Aabb) -> bool {
        self.min.x <= other.max.x
            && other.min.x <= self.max.x
            && self.min.y <= other.max.y
            && other.min.y <= self.max.y
            && self.min.z <= other.max.z
            && other.min.z <= self.max.z
    }

    /// Squared distance from `p` [m²]; zero inside.
    pub fn distance_squared(&self, p: DVec3) -> f64 {
        (self.min - p)
            .max(p - self.max)
            .max(DVec3::ZERO)
            .length_squared()
    }

    fn centre(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }
}

/// Boxes of triangles, in their order.
pub fn face_boxes(verts: &[DVec3], faces: &[[u32; 3]]) -> Vec<Aabb> {
    let faces = faces.par_iter().with_min_len(4096);
    faces.map(|&f| Aabb::of_face(verts, f)).collect()
}

/// `count` primitives from `first` in a leaf; otherwise the children are the next node and `first`.
#[derive(Clone, Debug)]
struct Node {
    bounds: Aabb,
    first: u32,
    count: u32,
}

/// A binary tree of boxes over primitives, in depth-first order.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    order: Arc<[u32]>,
    boxes: Vec<Aabb>,
}

const LEAF: usize = 4;
/// Primitives from which on both halves are split side by side.
const SHARED: usize = 2048;
/// Pieces a pair query is split into before it is shared among threads.
const TASKS: usize = 96;

/// How many nodes a tree over so many primitives has.
fn n_nodes(primitives: usize) -> usize {
    match primitives {
        0..=LEAF => 1,
        n => 1 + n_nodes(n / 2) + n_nodes(n - n / 2),
    }
}

/// A primitive that is sorted: where its box has its middle on the axis of the split, as a number in the same order, and
/// which it is.
type Placed = (i64, u32);

/// Splits the primitives in `all`, which start at `from` among all, into `nodes`, which start at `at`. `centres`: the
/// middles of all boxes [m].
fn split(
    centres: &[DVec3],
    (all, from): (&mut [Placed], usize),
    (nodes, at): (&mut [Node], usize),
) {
    let (node, below) = nodes.split_first_mut().expect("a node for every split");
    if all.len() <= LEAF {
        (node.first, node.count) = (from as u32, all.len() as u32);
        return;
    }
    let size = all.iter().fold(Aabb::EMPTY, |b, p| Aabb {
        min: b.min.min(centres[p.1 as usize]),
        max: b.max.max(centres[p.1 as usize]),
    });
    let axis = (size.max - size.min).max_position();
    for p in &mut *all {
        p.0 = ordered(centres[p.1 as usize][axis]);
    }
    let half = all.len() / 2;
    all.select_nth_unstable(half);
    let shared = all.len() > SHARED;
    let (left, right) = all.split_at_mut(half);
    let (left_nodes, right_nodes) = below.split_at_mut(n_nodes(half));
    let right_at = at + 1 + left_nodes.len();
    node.first = right_at as u32;
    let left = (left, from);
    let right = (right, from + half);
    if shared {
        rayon::join(
            || split(centres, left, (left_nodes, at + 1)),
            || split(centres, right, (right_nodes, right_at)),
        );
    } else {
        split(centres, left, (left_nodes, at + 1));
        split(centres, right, (right_nodes, right_at));
    }
}

/// A whole number that is in the same order, as [`f64::total_cmp`] has it.
fn ordered(x: f64) -> i64 {
    let bits = x.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// Gives all of `nodes`, which start at `at`, their boxes.
fn grow(boxes: &[Aabb], (nodes, at): (&mut [Node], usize)) {
    if nodes.len() > SHARED {
        let (node, below) = nodes.split_first_mut().expect("there are many");
        let right_at = node.first as usize;
        let (left, right) = below.split_at_mut(right_at - at - 1);
        rayon::join(
            || grow(boxes, (left, at + 1)),
            || grow(boxes, (right, right_at)),
        );
        node.bounds = left[0].bounds.union(right[0].bounds);
        return;
    }
    for i in (0..nodes.len()).rev() {
        let Node { first, count, .. } = nodes[i];
        nodes[i].bounds = if count > 0 {
            let leaf = &boxes[first as usize..(first + count) as usize];
            leaf.iter().fold(Aabb::EMPTY, |a, b| a.union(*b))
        } else {
            let right = &nodes[first as usize - at];
            nodes[i + 1].bounds.union(right.bounds)
        };
    }
}

impl Bvh {
    /// A tree over `boxes`, split at the median of the longest axis.
    pub fn over(boxes: &[Aabb]) -> Bvh {
        let nodes = if boxes.is_empty() {
            0
        } else {
            n_nodes(boxes.len())
        };
        let leaf = Node {
            bounds: Aabb::EMPTY,
            first: 0,
            count: 0,
        };
        let centres: Vec<DVec3> = boxes.iter().map(Aabb::centre).collect();
        let mut all: Vec<Placed> = (0..boxes.len() as u32).map(|i| (0, i)).collect();
        let mut bvh = Bvh {
            order: Arc::default(),
            nodes: vec![leaf; nodes],
            boxes: Vec::new(),
        };
        if !boxes.is_empty() {
            split(&centres, (&mut all, 0), (&mut bvh.nodes, 0));
        }
        bvh.order = all.into_iter().map(|p| p.1).collect();
        bvh.refit(boxes);
        bvh
    }

    /// The tree over other boxes of the same primitives: it keeps its shape.
    pub(crate) fn moved(&self, boxes: &[Aabb]) -> Bvh {
        let mut moved = Bvh {
            nodes: self.nodes.clone(),
            order: self.order.clone(),
            boxes: Vec::new(),
        };
        moved.refit(boxes);
        moved
    }

    /// Moves the tree to new boxes of the same primitives.
    pub fn refit(&mut self, boxes: &[Aabb]) {
        assert_eq!(
            boxes.len(),
            self.order.len(),
            "a refit keeps the primitives"
        );
        let order = self.order.par_iter().with_min_len(SHARED);
        order
            .map(|&i| boxes[i as usize])
            .collect_into_vec(&mut self.boxes);
        grow(&self.boxes, (&mut self.nodes, 0));
    }

    /// Calls `visit` with every primitive whose box meets `query`.
    pub fn near(&self, query: &Aabb, mut visit: impl FnMut(u32)) {
        self.each(|b| b.overlaps(query), &mut visit);
    }

    /// Calls `visit` with every primitive whose box, and all boxes around it, satisfy `wanted`.
    pub fn each(&self, wanted: impl Fn(&Aabb) -> bool, visit: &mut impl FnMut(u32)) {
        let mut i = 0;
        // Depth-first order: a rejected subtree is skipped by keeping the way back on a stack.
        let mut stack: Vec<usize> = Vec::with_capacity(64);
        while i < self.nodes.len() {
            let node = &self.nodes[i];
            if wanted(&node.bounds) {
                if node.count == 0 {
                    stack.push(node.first as usize);
                    i += 1;
                    continue;
                }
                for k in node.first as usize..(node.first + node.count) as usize {
                    if wanted(&self.boxes[k]) {
                        visit(self.order[k]);
                    }
                }
            }
            let Some(next) = stack.pop() else { return };
            i = next;
        }
    }

    /// The primitive nearest to `p` among those closer than `√bound` [m²].
    ///
    /// `distance` gives the squared distance to a primitive [m²]; among equals the first found in
    /// tree order wins.
    pub fn nearest(
        &self,
        p: DVec3,
        bound: f64,
        mut distance: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        let mut best = (u32::MAX, bound);
        // Halves differ by one at most, so that no tree is deeper than its count has bits.
        let mut stack = [(0usize, 0.0f64); 34];
        let (mut depth, mut i) = (0, 0);
        while let Some(node) = self.nodes.get(i) {
            if node.count == 0 {
                let (a, b) = (i + 1, node.first as usize);
                let to_a = self.nodes[a].bounds.distance_squared(p);
                let to_b = self.nodes[b].bounds.distance_squared(p);
                let (near, far) = match to_b >= to_a {
                    true => ((a, to_a), (b, to_b)),
                    false => ((b, to_b), (a, to_a)),
                };
                if far.1 < best.1 {
                    stack[depth] = far;
                    depth += 1;
                }
                if near.1 < best.1 {
                    i = near.0;
                    continue;
                }
            }
            for k in node.first as usize..(node.first + node.count) as usize {
                if self.boxes[k].distance_squared(p) < best.1 {
                    let d = distance(self.order[k]);
                    if d < best.1 {
                        best = (self.order[k], d);
                    }
                }
            }
            let next = loop {
                if depth == 0 {
                    break usize::MAX;
                }
                depth -= 1;
                let (waiting, at) = stack[depth];
                if at < best.1 {
                    break waiting;
                }
            };
            i = next;
        }
        (best.0 != u32::MAX).then_some(best)
    }

    /// Pairs `[mine, theirs]` whose boxes come within `margin` [m] on every axis.
    pub fn pairs(&self, other: &Bvh, margin: f64) -> Vec<[u32; 2]> {
        if self.nodes.is_empty() || other.nodes.is_empty() {
            return Vec::new();
        }
        Walk {
            a: self,
            b: other,
            margin,
            same: false,
        }
        .run()
    }

    /// Pairs `[i, j]`, `i < j`, of own primitives whose boxes come within `margin` [m].
    pub fn self_pairs(&self, margin: f64) -> Vec<[u32; 2]> {
        if self.nodes.is_empty() {
            return Vec::new();
        }
        Walk {
            a: self,
            b: self,
            margin,
            same: true,
        }
        .run()
    }
}

/// A descent through two trees at once.
struct Walk<'a> {
    a: &'a Bvh,
    b: &'a Bvh,
    margin: f64,
    same: bool,
}

impl Walk<'_> {
    fn run(&self) -> Vec<[u32; 2]> {
        let tasks = self.tasks();
        let found: Vec<Vec<[u32; 2]>> = tasks
            .par_iter()
            .map(|&(i, j)| {
                let mut out = Vec::new();
                self.visit(i, j, &mut out);
                out
            })
            .collect();
        found.concat()
    }

    /// Pairs of subtrees that together cover the whole question, in a fixed order.
    fn tasks(&self) -> Vec<(usize, usize)> {
        let mut tasks = vec![(0, 0)];
        loop {
            let mut next = Vec::new();
            for &(i, j) in &tasks {
                self.children(i, j, |i, j| next.push((i, j)));
            }
            if next.len() == tasks.len() || next.len() > TASKS {
                return next;
            }
            tasks = next;
        }
    }

    /// The pairs one level down that can hold an answer; a pair of leaves is its own child.
    fn children(&self, i: usize, j: usize, mut child: impl FnMut(usize, usize)) {
        let (m, n) = (&self.a.nodes[i], &self.b.nodes[j]);
        if !m.bounds.grown(self.margin).overlaps(&n.bounds) {
            return;
        }
        if m.count > 0 && n.count > 0 {
            child(i, j);
        } else if self.same && i == j {
            child(i + 1, i + 1);
            child(i + 1, m.first as usize);
            child(m.first as usize, m.first as usize);
        } else if n.count > 0 || (m.count == 0 && extent(&m.bounds) >= extent(&n.bounds)) {
            child(i + 1, j);
            child(m.first as usize, j);
        } else {
            child(i, j + 1);
            child(i, n.first as usize);
        }
    }

    fn visit(&self, i: usize, j: usize, out: &mut Vec<[u32; 2]>) {
        if self.a.nodes[i].count > 0 && self.b.nodes[j].count > 0 {
            self.leaves(i, j, out);
        } else {
            self.children(i, j, |i, j| self.visit(i, j, out));
        }
    }

    fn leaves(&self, i: usize, j: usize, out: &mut Vec<[u32; 2]>) {
        let span = |n: &Node| n.first as usize..(n.first + n.count) as usize;
        for k in span(&self.a.nodes[i]) {
            let grown = self.a.boxes[k].grown(self.margin);
            let theirs = span(&self.b.nodes[j]);
            let from = if self.same && i == j {
                k + 1
            } else {
                theirs.start
            };
            for l in from..theirs.end {
                if grown.overlaps(&self.b.boxes[l]) {
                    let (p, q) = (self.a.order[k], self.b.order[l]);
                    out.push(if self.same && q < p { [q, p] } else { [p, q] });
                }
            }
        }
    }
}

fn extent(b: &Aabb) -> f64 {
    (b.max - b.min).max_element()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Rng;

    fn soup(n: usize, seed: u64) -> Vec<Aabb> {
        let mut rng = Rng(seed);
        let one = |rng: &mut Rng| {
            let p = rng.vec();
            Aabb::of(&[p, p + rng.vec() * 0.1])
        };
        (0..n).map(|_| one(&mut rng)).collect()
    }

    #[test]
    fn pair_queries_agree_with_brute_force() {
        let (a, b) = (soup(300, 1), soup(200, 2));
        let (ta, tb) = (Bvh::over(&a), Bvh::over(&b));
        let grown = |x: &Aabb| x.grown(0.02);
        let mut want = Vec::new();
        for i in 0..a.len() {
            let hits = (0..b.len()).filter(|&j| grown(&a[i]).overlaps(&b[j]));
            want.extend(hits.map(|j| [i as u32, j as u32]));
        }
        let mut got = ta.pairs(&tb, 0.02);
        got.sort_unstable();
        assert_eq!(got, want);
        let mut want = Vec::new();
        for i in 0..a.len() {
            let hits = (i + 1..a.len()).filter(|&j| grown(&a[i]).overlaps(&a[j]));
            want.extend(hits.map(|j| [i as u32, j as u32]));
        }
        let mut got = ta.self_pairs(0.02);
        got.sort_unstable();
        assert_eq!(got, want);
    }

    #[test]
    fn a_tree_split_side_by_side_holds_everything_once_in_any_number_of_threads() {
        let boxes = soup(10_007, 7);
        let tree = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("threads can be started");
            pool.install(|| Bvh::over(&boxes))
        };
        let (one, three) = (tree(1), tree(3));
        assert_eq!(one.order, three.order);
        let mut all = Vec::new();
        three.each(|_| true, &mut |i| all.push(i));
        assert_eq!(all[..], one.order[..]);
        all.sort_unstable();
        assert_eq!(all, (0..10_007).collect::<Vec<u32>>());
        let query = Aabb::of(&[DVec3::splat(0.4), DVec3::splat(0.5)]);
        let mut got = Vec::new();
        three.near(&query, |i| got.push(i));
        got.sort_unstable();
        let hit = |i: &u32| boxes[*i as usize].overlaps(&query);
        assert_eq!(got, (0..10_007).filter(hit).collect::<Vec<u32>>());
        assert!(!got.is_empty());
    }

    #[test]
    fn a_refitted_tree_answers_for_the_new_boxes() {
        let (old, new) = (soup(250, 3), soup(250, 4));
        let mut tree = Bvh::over(&old);
        tree.refit(&new);
        let query = Aabb {
            min: DVec3::splat(0.3),
            max: DVec3::splat(0.6),
        };
        let mut got = Vec::new();
        tree.near(&query, |i| got.push(i));
        got.sort_unstable();
        let hit = |i: &u32| new[*i as usize].overlaps(&query);
        assert_eq!(got, (0..250).filter(hit).collect::<Vec<u32>>());
        assert!(!got.is_empty());
    }

    #[test]
    fn the_nearest_box_is_found_and_an_empty_tree_has_none() {
        let boxes = soup(300, 5);
        let tree = Bvh::over(&boxes);
        let mut rng = Rng(6);
        for _ in 0..100 {
            let p = rng.vec() * 1.5;
            let want = boxes
                .iter()
                .map(|b| b.distance_squared(p))
                .fold(f64::INFINITY, f64::min);
            let got = tree.nearest(p, 9.0, |i| boxes[i as usize].distance_squared(p));
            // A point inside a box finds it at distance zero.
            assert_eq!(got.map(|g| g.1), Some(want));
        }
        assert_eq!(Bvh::over(&[]).nearest(DVec3::ZERO, 1.0, |_| 0.0), None);
    }
}
