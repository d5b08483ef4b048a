//! Who is coupled to whom: the places of the matrix, found once per cloth.

use glam::DVec3;

use crate::ordered;

/// Lists of entries, one list per row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    /// Where each row starts; one more entry than rows.
    pub start: Vec<u32>,
    /// Entries of all rows.
    pub items: Vec<u32>,
}

impl Rows {
    /// Rows of `(row, item)` pairs in any order, each in ascending order; an item given twice is kept once.
    pub fn sorted(n: usize, pairs: &[(u32, u32)]) -> Rows {
        let mut rows = Rows::counted(n, pairs);
        let (mut start, mut kept) = (vec![0; n + 1], 0);
        for row in 0..n {
            let (span, first) = (rows.span(row), kept);
            rows.items[span.clone()].sort_unstable();
            for k in span {
                let item = rows.items[k];
                if kept == first || rows.items[kept - 1] != item {
                    rows.items[kept] = item;
                    kept += 1;
                }
            }
            start[row + 1] = kept as u32;
        }
        rows.items.truncate(kept);
        Rows { start, ..rows }
    }

    /// Rows from `(row, item)` pairs in any order; each row keeps the order they came in.
    pub fn counted(n: usize, pairs: &[(u32, u32)]) -> Rows {
        let mut start = vec![0; n + 1];
        for &(row, _) in pairs {
            start[row as usize + 1] += 1;
        }
        for i in 0..n {
            start[i + 1] += start[i];
        }
        let (mut items, mut next) = (vec![0; pairs.len()], start.clone());
        for &(row, item) in pairs {
            let place = &mut next[row as usize];
            items[*place as usize] = item;
            *place += 1;
        }
        Rows { start, items }
    }

    pub fn span(&self, row: usize) -> std::ops::Range<usize> {
        self.start[row] as usize..self.start[row + 1] as usize
    }

    pub fn row(&self, row: usize) -> &[u32] {
        &self.items[self.span(row)]
    }

    /// Where `item` stands in a sorted row.
    pub fn find(&self, row: u32, item: u32) -> Option<usize> {
        let span = self.span(row as usize);
        self.items[span.clone()]
            .binary_search(&item)
            .ok()
            .map(|k| span.start + k)
    }

    /// Each of these, led by `share` to the mean of those in its row.
    pub fn smoother(&self, of: &[DVec3], share: f64) -> Vec<DVec3> {
        ordered::map(of.len(), |i| {
            let row = self.row(i);
            let mean = row.iter().map(|&j| of[j as usize]).sum::<DVec3>() / row.len() as f64;
            of[i].lerp(mean, share)
        })
    }

    /// Each led all the way to that mean, so many times.
    pub fn smoothed(&self, of: Vec<DVec3>, times: usize) -> Vec<DVec3> {
        (0..times).fold(of, |of, _| self.smoother(&of, 1.0))
    }
}

/// The places of the matrix that stretch uses.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    /// Vertices that share a face, the vertex itself included, in ascending order.
    pub near: Rows,
    /// For every vertex its corners, as `3 face + corner`.
    pub corners: Rows,
    /// For every face, the place of the block that couples corner a with corner b.
    pub places: Vec<[[u32; 3]; 3]>,
    /// The diagonal block's place in every row.
    pub diagonal: Vec<u32>,
    /// For every vertex, the number of the connected piece of cloth that it belongs to.
    pub pieces: Vec<u32>,
    /// How many there are.
    pub n_pieces: usize,
}

impl Pattern {
    pub fn new(n: usize, faces: &[[u32; 3]]) -> Pattern {
        let mut pairs: Vec<(u32, u32)> = (0..n as u32).map(|i| (i, i)).collect();
        let mut corners = Vec::with_capacity(faces.len() * 3);
        for (f, face) in faces.iter().enumerate() {
            for a in 0..3 {
                corners.push((face[a], (3 * f + a) as u32));
                pairs.extend((0..3).map(|b| (face[a], face[b])));
            }
        }
        let near = Rows::sorted(n, &pairs);
        let place = |i, j| near.find(i, j).expect("every pair of corners was entered") as u32;
        let places = faces
            .iter()
            .map(|f| f.map(|i| f.map(|j| place(i, j))))
            .collect();
        let diagonal = (0..n as u32).map(|i| place(i, i)).collect();
        let (pieces, n_pieces) = pieces(&near);
        Pattern {
            pieces,
            n_pieces,
            places,
            diagonal,
            corners: Rows::sorted(n, &corners),
            near,
        }
    }
}

/// Numbers of connected pieces, in the order of their first vertices, and how many there are.
fn pieces(near: &Rows) -> (Vec<u32>, usize) {
    let n = near.start.len() - 1;
    let (mut of, mut count) = (vec![u32::MAX; n], 0);
    for first in 0..n {
        let mut waiting = vec![first];
        while let Some(i) = waiting.pop() {
            if of[i] == u32::MAX {
                of[i] = count;
                waiting.extend(near.row(i).iter().map(|&j| j as usize));
            }
        }
        count += u32::from(of[first] == count);
    }
    (of, count as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hangs_together_is_one_piece() {
        let pattern = Pattern::new(8, &[[0, 5, 2], [1, 3, 4], [2, 5, 7]]);
        assert_eq!(pattern.pieces, [0, 1, 0, 1, 1, 0, 2, 0]);
        assert_eq!(pattern.n_pieces, 3);
    }
}
