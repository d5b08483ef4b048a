//! Who may meet whom while everything moves: a descent that sees relative motion alone.
//!
//! Boxes that travel together are as far apart at the end as at the start, however far they go. So
//! every node carries, beside the box of where its primitives are, the box of how they move, and
//! two nodes are compared by what one does as seen from the other.

use rayon::prelude::*;

use super::{Aabb, Bvh, TASKS};

/// A box and the box of its contents' moves, in single precision, rounded outward [m].
#[derive(Clone, Copy)]
struct Cell {
    low: [f32; 4],
    high: [f32; 4],
    least: [f32; 4],
    most: [f32; 4],
}

/// Primitives on their way.
pub struct OnTheWay<'a> {
    /// Where each is [m].
    pub boxes: &'a [Aabb],
    /// How each goes [m]: the box of its corners' displacements.
    pub moves: &'a [Aabb],
    /// Pairs that come this near count as meeting [m].
    pub margin: f64,
}

impl Bvh {
    /// Calls `visit` with every pair `i < j` of primitives that may come within the margin on
    /// their straight way, and gathers what it adds, in an order that does not depend on threads.
    ///
    /// The tree lends its shape alone; where its boxes were does not matter.
    pub fn meeting<T: Send>(
        &self,
        way: &OnTheWay<'_>,
        visit: impl Fn(usize, usize, &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        assert_eq!(way.boxes.len(), self.order.len(), "one box per primitive");
        assert_eq!(way.moves.len(), self.order.len(), "one move per primitive");
        if self.nodes.is_empty() {
            return Vec::new();
        }
        let walk = Walk::new(self, way);
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
    leaves: Vec<Cell>,
    nodes: Vec<Cell>,
}

impl<'a> Walk<'a> {
    fn new(tree: &'a Bvh, way: &OnTheWay<'_>) -> Walk<'a> {
        let origin = way.boxes[0].min;
        // Half the margin on either side, and room for rounding at a few metres from the origin.
        let room = 0.5 * way.margin + 2e-6;
        let cell = |&i: &u32| {
            let (b, m) = (way.boxes[i as usize], way.moves[i as usize]);
            Cell {
                low: single((b.min - origin - room).to_array()),
                high: single((b.max - origin + room).to_array()),
                least: single(m.min.to_array()),
                most: single(m.max.to_array()),
            }
        };
        let leaves: Vec<Cell> = tree.order.iter().map(cell).collect();
        let mut nodes = vec![leaves[0]; tree.nodes.len()];
        for i in (0..nodes.len()).rev() {
            let node = &tree.nodes[i];
            let (first, count) = (node.first as usize, node.count as usize);
            nodes[i] = if count > 0 {
                let inside = &leaves[first + 1..first + count];
                inside.iter().fold(leaves[first], |a, b| a.union(b))
            } else {
                nodes[i + 1].union(&nodes[first])
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

/// Rounds a point to single precision; the last entry never decides.
fn single(p: [f64; 3]) -> [f32; 4] {
    [p[0] as f32, p[1] as f32, p[2] as f32, 0.0]
}

impl Cell {
    fn union(&self, other: &Cell) -> Cell {
        let least = |a: &[f32; 4], b: &[f32; 4]| std::array::from_fn(|k| a[k].min(b[k]));
        let most = |a: &[f32; 4], b: &[f32; 4]| std::array::from_fn(|k| a[k].max(b[k]));
        Cell {
            low: least(&self.low, &other.low),
            high: most(&self.high, &other.high),
            least: least(&self.least, &other.least),
            most: most(&self.most, &other.most),
        }
    }

    /// Whether the two may touch on the way, axis by axis, as seen from the other.
    #[inline]
    fn meets(&self, other: &Cell) -> bool {
        let mut apart = false;
        for k in 0..4 {
            let back = (self.least[k] - other.most[k]).min(0.0);
            let forth = (self.most[k] - other.least[k]).max(0.0);
            apart |= self.low[k] + back > other.high[k];
            apart |= other.low[k] > self.high[k] + forth;
        }
        !apart
    }

    fn size(&self) -> f32 {
        (0..3).fold(0.0, |size, k| (self.high[k] - self.low[k]).max(size))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::testing::Rng;

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
        let spread: Vec<Aabb> = moves.iter().map(|t| Aabb::of(t)).collect();
        let tree = Bvh::over(&boxes);
        let way = OnTheWay {
            boxes: &boxes,
            moves: &spread,
            margin: 0.01,
        };
        let got = tree.meeting(&way, |a, b, out| out.push([a, b]));
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
