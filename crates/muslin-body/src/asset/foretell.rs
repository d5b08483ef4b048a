//! What a point does is foretold by its neighbours on the mesh.
//!
//! Points are visited breadth first, so that most have a quad whose other three corners are
//! known: the fourth is then where the parallelogram ends. Failing that, the mean of known
//! neighbours; failing that, the nearest known point.

use crate::BodyError;
use crate::packed::{Reader, Writer};

/// An order of points, and for each the points that foretell it.
#[derive(Debug)]
pub struct Mesh {
    order: Vec<u32>,
    rank: Vec<u32>,
    /// Where the sources of `order[i]` start in `sources`.
    starts: Vec<u32>,
    /// (point, how often it counts)
    sources: Vec<(u32, i32)>,
    /// What the sum over the sources is divided by; 0 without sources.
    share: Vec<i32>,
    n_verts: usize,
}

/// Moves of some points as they are written: their places in the order, and by how much they are not what was foretold, in
/// steps.
pub struct Moves {
    places: Vec<i32>,
    off: [Vec<i32>; 3],
}

/// How many times finer the steps of anchors are than those of vertices.
///
/// Where a joint is off, everything beyond it turns about the wrong point; anchors are few.
const FINER: i32 = 16;

impl Mesh {
    /// Points that the quads connect, then all others; those beyond `n_verts` are anchors.
    pub fn new(n_points: usize, n_verts: usize, quads: &[[u32; 4]]) -> Self {
        let around = around(n_points, quads);
        let order = breadth_first(&around, quads);
        let mut rank = vec![0; n_points];
        order
            .iter()
            .enumerate()
            .for_each(|(k, &i)| rank[i as usize] = k as u32);
        let mut mesh = Self {
            order,
            rank,
            starts: vec![0],
            sources: Vec::new(),
            share: Vec::new(),
            n_verts,
        };
        for k in 0..n_points {
            let i = mesh.order[k] as usize;
            mesh.foretell(i, &around[i], quads);
        }
        mesh
    }

    /// The same, where points without known neighbours follow the nearest known point.
    pub fn with_places(self, places: &[[i32; 3]]) -> Self {
        let Self {
            order,
            rank,
            starts,
            sources,
            share,
            n_verts,
        } = self;
        let mut mesh = Self {
            order,
            rank,
            starts: vec![0],
            sources: Vec::new(),
            share: Vec::new(),
            n_verts,
        };
        for (k, s) in share.into_iter().enumerate() {
            if s == 0 && k > 0 {
                let near = nearest(mesh.order[k], &mesh.order[..k], places);
                let scale = mesh.steps(mesh.order[k]) / mesh.steps(near);
                mesh.sources.push((near, scale.max(1)));
                mesh.share.push(1);
            } else {
                mesh.sources
                    .extend(&sources[starts[k] as usize..starts[k + 1] as usize]);
                mesh.share.push(s);
            }
            mesh.starts.push(mesh.sources.len() as u32);
        }
        mesh
    }

    fn foretell(&mut self, i: usize, around: &[u32], quads: &[[u32; 4]]) {
        let known = |j: u32| self.rank[j as usize] < self.rank[i];
        let (mut whole, mut sides) = (Vec::new(), Vec::new());
        for &q in around {
            let quad = quads[q as usize];
            let at = quad
                .iter()
                .position(|&j| j as usize == i)
                .expect("the quad is around it");
            let [a, far, b] = [1, 2, 3].map(|k| quad[(at + k) % 4]);
            if known(a) && known(b) && known(far) {
                whole.push([(a, 1), (b, 1), (far, -1)]);
            }
            sides.extend([a, b].into_iter().filter(|&j| known(j)));
        }
        if whole.is_empty() {
            self.share.push(sides.len() as i32);
            self.sources.extend(sides.into_iter().map(|j| (j, 1)));
        } else {
            self.share.push(whole.len() as i32);
            self.sources.extend(whole.into_iter().flatten());
        }
        self.starts.push(self.sources.len() as u32);
    }

    /// How many of a point's own steps make one step of a vertex.
    fn steps(&self, i: u32) -> i32 {
        if (i as usize) < self.n_verts {
            1
        } else {
            FINER
        }
    }

    /// Moves [m] of all points in steps; a vertex's is `step`.
    pub fn in_steps(&self, moves: &[[f32; 3]], step: f64) -> Vec<[i32; 3]> {
        let one = |(i, d): (usize, &[f32; 3])| self.round(i as u32, d, step);
        moves.iter().enumerate().map(one).collect()
    }

    fn round(&self, i: u32, d: &[f32; 3], step: f64) -> [i32; 3] {
        d.map(|x| (f64::from(x) / step * f64::from(self.steps(i))).round() as i32)
    }

    /// The move [m] of point `i` that is `q` of its steps.
    pub fn metres(&self, i: usize, q: [i32; 3], step: f64) -> [f32; 3] {
        let own = step / f64::from(self.steps(i as u32));
        q.map(|q| (f64::from(q) * own) as f32)
    }

    /// The points as they are visited.
    pub fn order(&self) -> impl Iterator<Item = usize> + '_ {
        self.order.iter().map(|&i| i as usize)
    }

    /// What is foretold of the `k`-th point.
    fn guess(&self, k: usize, known: &[[i32; 3]]) -> [i32; 3] {
        let share = self.share[k];
        if share == 0 {
            return [0; 3];
        }
        let mut sum = [0i64; 3];
        for &(j, sign) in &self.sources[self.starts[k] as usize..self.starts[k + 1] as usize] {
            let x = &known[j as usize];
            for c in 0..3 {
                sum[c] += i64::from(sign) * i64::from(x[c]);
            }
        }
        // Floor division has no kink at zero; shifts are it, only faster.
        sum.map(|s| match share {
            1 => s as i32,
            2 => (s >> 1) as i32,
            4 => (s >> 2) as i32,
            _ => s.div_euclid(i64::from(share)) as i32,
        })
    }

    /// Writes a value for every point.
    pub fn put(&self, w: &mut Writer, values: &[[i32; 3]]) {
        for c in 0..3 {
            let off = |(k, i): (usize, usize)| values[i][c].wrapping_sub(self.guess(k, values)[c]);
            w.ints(self.order().enumerate().map(off));
        }
    }

    /// Reads a value for every point.
    pub fn get(&self, r: &mut Reader) -> Result<Vec<[i32; 3]>, BodyError> {
        let off = [r.ints()?, r.ints()?, r.ints()?];
        if off.iter().any(|o| o.len() != self.order.len()) {
            return Err(BodyError::Corrupt("values for other points"));
        }
        let mut values = vec![[0; 3]; self.order.len()];
        for k in 0..self.order.len() {
            let guess = self.guess(k, &values);
            values[self.order[k] as usize] = [0, 1, 2].map(|c| guess[c].wrapping_add(off[c][k]));
        }
        Ok(values)
    }

    /// Writes moves [m] of some points in steps of `step`; all others stay.
    pub fn put_some(&self, w: &mut Writer, moves: &[(u32, [f32; 3])], step: f64) {
        let mut values = vec![[0; 3]; self.order.len()];
        for (i, d) in moves {
            values[*i as usize] = self.round(*i, d, step);
        }
        let some: Vec<usize> = (0..self.order.len())
            .filter(|&k| values[self.order[k] as usize] != [0; 3])
            .collect();
        w.differences(some.iter().map(|&k| k as i32));
        for c in 0..3 {
            let value = |&k: &usize| values[self.order[k] as usize][c];
            w.ints(
                some.iter()
                    .map(|k| value(k).wrapping_sub(self.guess(*k, &values)[c])),
            );
        }
    }

    /// Reads moves of some points as they are written.
    pub fn read_some(r: &mut Reader) -> Result<Moves, BodyError> {
        let places = r.differences()?;
        let off = [r.ints()?, r.ints()?, r.ints()?];
        if off.iter().any(|o| o.len() != places.len()) {
            return Err(BodyError::Corrupt("moves of other points"));
        }
        Ok(Moves { places, off })
    }

    /// Moves [m] of some points, by point. `known` is all zeros, and is so again afterwards.
    pub fn get_some(
        &self,
        Moves { places, off }: &Moves,
        step: f64,
        known: &mut [[i32; 3]],
    ) -> Result<Vec<(u32, [f32; 3])>, BodyError> {
        let mut moves = Vec::with_capacity(places.len());
        for (n, &k) in places.iter().enumerate() {
            let k = usize::try_from(k).ok().filter(|&k| k < self.order.len());
            let k = k.ok_or(BodyError::Corrupt("a move beyond the points"))?;
            let (i, guess) = (self.order[k], self.guess(k, known));
            let value = [0, 1, 2].map(|c| guess[c].wrapping_add(off[c][n]));
            known[i as usize] = value;
            moves.push((i, self.metres(i as usize, value, step)));
        }
        moves.iter().for_each(|m| known[m.0 as usize] = [0; 3]);
        moves.sort_unstable_by_key(|m| m.0);
        Ok(moves)
    }
}

/// The quads around every point.
fn around(n_points: usize, quads: &[[u32; 4]]) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); n_points];
    for (q, quad) in quads.iter().enumerate() {
        for &i in quad {
            if around[i as usize].last() != Some(&(q as u32)) {
                around[i as usize].push(q as u32);
            }
        }
    }
    around
}

/// All points, neighbour after neighbour, each island from its lowest index.
fn breadth_first(around: &[Vec<u32>], quads: &[[u32; 4]]) -> Vec<u32> {
    let mut seen = vec![false; around.len()];
    let mut order: Vec<u32> = Vec::with_capacity(around.len());
    for start in 0..around.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut next = order.len();
        order.push(start as u32);
        while next < order.len() {
            let i = order[next];
            next += 1;
            for &q in &around[i as usize] {
                let quad = quads[q as usize];
                let at = quad
                    .iter()
                    .position(|&j| j == i)
                    .expect("the quad is around it");
                // Sides before the far corner: it then closes a parallelogram.
                for j in [1, 3, 2].map(|k| quad[(at + k) % 4]) {
                    if !std::mem::replace(&mut seen[j as usize], true) {
                        order.push(j);
                    }
                }
            }
        }
    }
    order
}

/// Whichever of `known` lies nearest to `point`; the first of equals.
fn nearest(point: u32, known: &[u32], places: &[[i32; 3]]) -> u32 {
    let p = places[point as usize];
    let far = |j: u32| {
        let q = places[j as usize];
        (0..3)
            .map(|c| (i64::from(p[c]) - i64::from(q[c])).pow(2))
            .fold(0i64, i64::saturating_add)
    };
    known.iter().copied().min_by_key(|&j| far(j)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of three quads, and two loose points.
    fn strip() -> Vec<[u32; 4]> {
        vec![[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 7, 6]]
    }

    #[test]
    fn values_come_back_and_planes_cost_nothing() {
        let places: Vec<[i32; 3]> = (0..10).map(|i| [i / 2 * 100, i % 2 * 70, 5]).collect();
        let mesh = Mesh::new(10, 9, &strip()).with_places(&places);
        let mut w = Writer::default();
        mesh.put(&mut w, &places);
        let packed = crate::packed::pack(b"12345678", 1, w);
        let raw = crate::packed::unpack(b"12345678", 1, &packed, 1 << 20).expect("whole");
        assert_eq!(mesh.get(&mut Reader::new(&raw)).expect("values"), places);
        let foretold = (3..8).filter(|&k| mesh.guess(k, &places) == places[mesh.order[k] as usize]);
        // Points 3, 5 and 7 close a quad; 4 and 6 open one.
        assert_eq!(foretold.count(), 3);
    }

    #[test]
    fn a_sparse_move_comes_back_by_point() {
        let places: Vec<[i32; 3]> = (0..10).map(|i| [i, 0, 0]).collect();
        let mesh = Mesh::new(10, 9, &strip()).with_places(&places);
        let moves = vec![
            (1, [0.25, 0.0, -0.5]),
            (6, [0.0, 0.125, 0.0]),
            (9, [1.0, 1.0, 1.0]),
        ];
        let mut w = Writer::default();
        mesh.put_some(&mut w, &moves, 1.0 / 64.0);
        let packed = crate::packed::pack(b"12345678", 1, w);
        let raw = crate::packed::unpack(b"12345678", 1, &packed, 1 << 20).expect("whole");
        let mut known = vec![[0; 3]; 10];
        let read = Mesh::read_some(&mut Reader::new(&raw)).expect("written");
        let read = mesh.get_some(&read, 1.0 / 64.0, &mut known);
        assert_eq!(read.expect("moves"), moves);
        assert_eq!(known, vec![[0; 3]; 10]);
    }
}
