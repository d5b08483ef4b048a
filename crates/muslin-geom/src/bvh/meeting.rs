//! Who may meet whom while everything moves: a descent that sees relative motion alone.
//!
//! Boxes that travel together are as far apart at the end as at the start, however far they go. So
//! every node carries, beside the box of where its primitives are, the box of how they move, and
//! two nodes are compared by what one does as seen from the other.

use glam::{DVec3, Vec3A};
use rayon::prelude::*;

use super::{Bvh, TASKS};

/// Something on its way: its box, and the box of how its points move, in single precision [m].
#[derive(Clone, Copy, Debug)]
pub struct Swept {
    low: Vec3A,
    high: Vec3A,
    least: Vec3A,
    most: Vec3A,
}

/// Room for rounding at a few metres from the origin [m].
const ROUNDING: f64 = 2e-6;

impl Swept {
    /// A point that goes straight by `by` [m]. Two that come within `margin` [m] of each other, on
    /// every axis, count as meeting. `at` is best measured from something near.
    pub fn point(at: DVec3, by: DVec3, margin: f64) -> Swept {
        let (room, by) = (0.5 * margin + ROUNDING, by.as_vec3a());
        Swept {
            low: (at - room).as_vec3a(),
            high: (at + room).as_vec3a(),
            least: by,
            most: by,
        }
    }

    /// Both together.
    #[inline]
    pub fn union(self, other: Swept) -> Swept {
        Swept {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            least: self.least.min(other.least),
            most: self.most.max(other.most),
        }
    }

    /// Whether the two may touch on the way, axis by axis, as seen from the other.
    #[inline]
    pub fn meets(&self, other: &Swept) -> bool {
        let back = (self.least - other.most).min(Vec3A::ZERO);
        let forth = (self.most - other.least).max(Vec3A::ZERO);
        let apart = (self.low + back).cmpgt(other.high) | other.low.cmpgt(self.high + forth);
        !apart.any()
    }

    fn size(&self) -> f32 {
        (self.high - self.low).max_element()
    }
}

impl Bvh {
    /// Calls `visit` with every pair `i < j` of primitives that may meet on their straight ways, and
    /// gathers what it adds, in an order that does not depend on threads.
    ///
    /// The tree lends its shape alone; where its boxes were does not matter.
    pub fn meeting<T: Send>(
        &self,
        ways: &[Swept],
        visit: impl Fn(usize, usize, &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        assert_eq!(ways.len(), self.order.len(), "one way per primitive");
        if self.nodes.is_empty() {
            return Vec::new();
        }
        let walk = Walk::new(self, ways);
        let tasks = walk.tasks();
        let found: Vec<Vec<T>> = tasks
            .par_iter()
            .map(|&(i, j)| {
                let mut out = Vec::new();
                walk.visit((i, j), &mut |a, b| visit(a, b, &mut out));
                out
            })
            .collect();
        found.into_iter().flatten().collect()
    }
}

struct Walk<'a> {
    tree: &'a Bvh,
    leaves: Vec<Swept>,
    nodes: Vec<Swept>,
}

impl<'a> Walk<'a> {
    fn new(tree: &'a Bvh, ways: &[Swept]) -> Walk<'a> {
        let leaves: Vec<Swept> = tree.order.iter().map(|&i| ways[i as usize]).collect();
        let mut nodes = vec![leaves[0]; tree.nodes.len()];
        for i in (0..nodes.len()).rev() {
            let node = &tree.nodes[i];
            let (first, count) = (node.first as usize, node.count as usize);
            nodes[i] = if count > 0 {
                let inside = &leaves[first + 1..first + count];
                inside.iter().fold(leaves[first], |a, b| a.union(*b))
            } else {
                nodes[i + 1].union(nodes[first])
            };
        }
        Walk {
            tree,
            leaves,
            nodes,
        }
    }

    /// Pairs of subtrees that together cover the whole question, in a fixed order.
    fn tasks(&self) -> Vec<(usize, usize)> {
        let mut tasks = vec![(0, 0)];
        loop {
            let mut next = Vec::new();
            for &pair in &tasks {
                self.children(pair, |pair| next.push(pair));
            }
            if next.len() == tasks.len() || next.len() > TASKS {
                return next;
            }
            tasks = next;
        }
    }

    /// The pairs one level down that can hold an answer; a pair of leaves is its own child.
    fn children(&self, (i, j): (usize, usize), mut child: impl FnMut((usize, usize))) {
        if i != j && !self.nodes[i].meets(&self.nodes[j]) {
            return;
        }
        let (m, n) = (&self.tree.nodes[i], &self.tree.nodes[j]);
        if m.count > 0 && n.count > 0 {
            child((i, j));
        } else if i == j {
            child((i + 1, i + 1));
            child((i + 1, m.first as usize));
            child((m.first as usize, m.first as usize));
        } else if n.count > 0 || (m.count == 0 && self.nodes[i].size() >= self.nodes[j].size()) {
            child((i + 1, j));
            child((m.first as usize, j));
        } else {
            child((i, j + 1));
            child((i, n.first as usize));
        }
    }

    fn visit(&self, (i, j): (usize, usize), visit: &mut impl FnMut(usize, usize)) {
        let mut stack = vec![(i, j)];
        while let Some((i, j)) = stack.pop() {
            if self.tree.nodes[i].count > 0 && self.tree.nodes[j].count > 0 {
                self.pairs(i, j, visit);
                continue;
            }
            let from = stack.len();
            self.children((i, j), |pair| stack.push(pair));
            stack[from..].reverse();
        }
    }

    fn pairs(&self, i: usize, j: usize, visit: &mut impl FnMut(usize, usize)) {
        let span = |k: usize| {
            let node = &self.tree.nodes[k];
            node.first as usize..(node.first + node.count) as usize
        };
        for k in span(i).filter(|&k| self.leaves[k].meets(&self.nodes[j])) {
            let theirs = span(j);
            let from = if i == j { k + 1 } else { theirs.start };
            for l in from..theirs.end {
                if self.leaves[k].meets(&self.leaves[l]) {
                    let (p, q) = (self.tree.order[k], self.tree.order[l]);
                    visit(p.min(q) as usize, p.max(q) as usize);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{bvh::Aabb, testing::Rng};

    /// Random small triangles that fly about, most of them together.
    fn swarm(n: usize, seed: u64) -> (Vec<[DVec3; 3]>, Vec<[DVec3; 3]>) {
        let mut rng = Rng(seed);
        let wind = DVec3::new(5.0, -3.0, 2.0);
        (0..n)
            .map(|_| {
                let p = rng.vec();
                let own = (rng.vec() - 0.5) * 0.2;
                let corner = |rng: &mut Rng| p + (rng.vec() - 0.5) * 0.05;
                let at = [corner(&mut rng), corner(&mut rng), corner(&mut rng)];
                (at, [wind + own, wind + own * 1.1, wind + own * 0.9])
            })
            .unzip()
    }

    #[test]
    fn every_pair_that_comes_near_is_visited_and_the_wind_wakes_nobody() {
        let (at, moves) = swarm(500, 3);
        let boxes: Vec<Aabb> = at.iter().map(|t| Aabb::of(t)).collect();
        let tree = Bvh::over(&boxes);
        let way = |(at, moves): (&[DVec3; 3], &[DVec3; 3])| {
            let [a, b, c] = [0, 1, 2].map(|k| Swept::point(at[k], moves[k], 0.01));
            a.union(b).union(c)
        };
        let ways: Vec<Swept> = at.iter().zip(&moves).map(way).collect();
        let got = tree.meeting(&ways, |a, b, out| out.push([a, b]));
        let set: std::collections::BTreeSet<_> = got.iter().copied().collect();
        assert_eq!(set.len(), got.len(), "no pair twice");
        let boxes_at = |i: usize, s: f64| {
            let moved: [DVec3; 3] = std::array::from_fn(|k| at[i][k] + moves[i][k] * s);
            Aabb::of(&moved)
        };
        let mut met = 0;
        for i in 0..at.len() {
            for j in i + 1..at.len() {
                let near = (0..=50).any(|s| {
                    let s = f64::from(s) / 50.0;
                    boxes_at(i, s).grown(0.01).overlaps(&boxes_at(j, s))
                });
                met += usize::from(near);
                assert!(!near || set.contains(&[i, j]), "{i} and {j} meet");
            }
        }
        assert!(met > 50 && got.len() < 4 * met, "{} for {met}", got.len());
    }
}
