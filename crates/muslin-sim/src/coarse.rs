//! What the preconditioner does beyond single vertices: cloth moved in large parts.
//!
//! Either every connected piece of cloth as a whole, or by handles: places a few edges apart, each
//! of which moves the cloth around it, fully where it is and less and less towards its neighbours.
//! The shares of a vertex sum to one, so that handles that move alike move cloth as it is. What
//! handles do to the energy is `Pᵀ A P`, solved exactly (additive Schwarz with a coarse space:
//! Dryja and Widlund 1987, as used for cloth by Wu and others 2022).

use glam::{DMat3, Mat3A, Vec3, Vec3A};

use crate::{
    bending::Bending,
    matrix::{Matrix, STENCIL, narrow},
    ordered,
    pattern::{Pattern, Rows},
};

/// Edges from a handle to the places that the next one answers for, at least; handles reach a quarter farther.
const SPACING: u32 = 8;
/// Handles at most: their system is solved densely.
const MOST: usize = 110;

/// Handles on cloth, found once.
#[derive(Clone, Debug)]
pub(crate) struct Handles {
    /// For every vertex the handles that move it, and their shares in it: where they start, and they.
    start: Vec<u32>,
    of: Vec<(u32, f32)>,
    /// For every handle the vertices it moves, and their shares in it.
    moved: Vec<Vec<(u32, f32)>>,
    /// Bending across hinges as handles see it, which is the same in every pose: for every handle the
    /// numbers to those before it and itself [N/m].
    bent: Vec<Vec<f32>>,
}

impl Handles {
    /// Handles over cloth whose vertices have these neighbours, and bend with those across hinges; none
    /// where cloth is in too many pieces for few of them.
    pub fn new(near: &Rows, bending: &Bending) -> Option<Handles> {
        let spacings = (0..6).map(|k| SPACING << k);
        let (spacing, centres) = spacings
            .map(|s| (s, centres(near, s)))
            .find(|(_, c)| c.len() <= MOST)?;
        let n = near.start.len() - 1;
        let width = spacing * 5 / 4;
        let mut entries = Vec::new();
        let mut seen = Seen::new(n);
        for (c, &centre) in centres.iter().enumerate() {
            around(near, (centre, width), &mut seen, |v, far| {
                entries.push((v, c as u32, 1.0 - far as f32 / width as f32));
            });
        }
        let pairs: Vec<(u32, u32)> = (0..).zip(&entries).map(|(k, e)| (e.0, k)).collect();
        let Rows { start, items } = Rows::counted(n, &pairs);
        let entry = |k: &u32| (entries[*k as usize].1, entries[*k as usize].2);
        let mut of: Vec<(u32, f32)> = items.iter().map(entry).collect();
        let mut moved = vec![Vec::new(); centres.len()];
        for v in 0..n {
            let row = &mut of[start[v] as usize..start[v + 1] as usize];
            let total: f32 = row.iter().map(|e| e.1).sum();
            for (handle, share) in row {
                *share /= total;
                moved[*handle as usize].push((v as u32, *share));
            }
        }
        let handles = Handles {
            start,
            of,
            moved,
            bent: Vec::new(),
        };
        let bent = (0..handles.len()).map(|a| handles.bent(a, bending));
        Some(Handles {
            bent: bent.collect(),
            ..handles
        })
    }

    /// What handle `a` meets of the hinges' far ends.
    fn bent(&self, a: usize, bending: &Bending) -> Vec<f32> {
        let mut row = vec![0.0; a + 1];
        for &(i, share) in &self.moved[a] {
            for k in bending.far.span(i as usize) {
                let pull = bending.far_single[k] * share;
                for (j, sign) in [(bending.far.items[k], 1.0), (i, -1.0)] {
                    let before = self.row(j as usize).take_while(|h| h.0 <= a);
                    before.for_each(|(b, other)| row[b] += sign * pull * other);
                }
            }
        }
        row
    }

    fn len(&self) -> usize {
        self.moved.len()
    }

    /// The vertices that a handle moves, and its share in each.
    #[cfg(test)]
    pub fn moved(&self, handle: usize) -> &[(u32, f32)] {
        &self.moved[handle]
    }

    /// The handles that move a vertex, and their shares.
    fn row(&self, v: usize) -> impl Iterator<Item = (usize, f32)> {
        let row = &self.of[self.start[v] as usize..self.start[v + 1] as usize];
        row.iter().map(|&(handle, share)| (handle as usize, share))
    }
}

/// Vertices such that every other is within `spacing` edges of one.
fn centres(near: &Rows, spacing: u32) -> Vec<u32> {
    let n = near.start.len() - 1;
    let mut covered = vec![false; n];
    let mut centres = Vec::new();
    let mut seen = Seen::new(n);
    for v in 0..n {
        if !covered[v] {
            centres.push(v as u32);
            around(near, (v as u32, spacing + 1), &mut seen, |v, _| {
                covered[v as usize] = true
            });
        }
    }
    centres
}

/// Who was seen in the latest of many walks.
struct Seen {
    walk: u32,
    last: Vec<u32>,
}

impl Seen {
    fn new(n: usize) -> Seen {
        Seen {
            walk: 0,
            last: vec![0; n],
        }
    }

    /// Whether this is the first time in this walk.
    fn insert(&mut self, v: u32) -> bool {
        std::mem::replace(&mut self.last[v as usize], self.walk) != self.walk
    }
}

/// Visits everything fewer than `limit` edges from a vertex, with that number.
fn around(
    near: &Rows,
    (from, limit): (u32, u32),
    seen: &mut Seen,
    mut visit: impl FnMut(u32, u32),
) {
    seen.walk += 1;
    seen.insert(from);
    let mut ring = vec![from];
    for far in 0..limit {
        ring.iter().for_each(|&v| visit(v, far));
        let mut next = Vec::new();
        for &v in &ring {
            next.extend(near.row(v as usize).iter().filter(|&&w| seen.insert(w)));
        }
        ring = next;
    }
}

/// The second part of a preconditioner.
pub(crate) enum Far<'a> {
    /// Every piece as a whole: the inverse of the sum of its blocks.
    Wholes(&'a Pattern, Vec<Mat3A>),
    /// By handles.
    Handles(&'a Handles, &'a Factor),
}

impl<'a> Far<'a> {
    /// With handles, their factor is found for this matrix, or is the one that was `kept` from an
    /// earlier one: that preconditions too, if not as well.
    pub fn new(
        matrix: &'a Matrix<'_>,
        handles: Option<&'a Handles>,
        kept: &'a mut Option<Factor>,
    ) -> Far<'a> {
        if let Some(handles) = handles {
            if kept.is_none() {
                *kept = Factor::new(&seen(matrix, handles));
            }
            if let Some(factor) = kept {
                return Far::Handles(handles, factor);
            }
        }
        Far::Wholes(matrix.pattern, inverse_wholes(matrix))
    }

    /// How many parts there are.
    pub fn len(&self) -> usize {
        match self {
            Far::Wholes(_, inverses) => inverses.len(),
            Far::Handles(handles, _) => handles.len(),
        }
    }

    /// Adds what pulls at vertex `i` to the sums of its parts.
    pub fn gather(&self, i: usize, pull: Vec3A, sums: &mut [Vec3A]) {
        match self {
            Far::Wholes(pattern, _) => sums[pattern.pieces[i] as usize] += pull,
            Far::Handles(h, _) => h.row(i).for_each(|(a, share)| sums[a] += pull * share),
        }
    }

    /// How every part moves under these pulls.
    pub fn moves(&self, sums: &[Vec3A]) -> Vec<Vec3A> {
        match self {
            Far::Wholes(_, inverses) => inverses.iter().zip(sums).map(|(m, s)| *m * *s).collect(),
            Far::Handles(_, factor) => factor.solve(sums),
        }
    }

    /// What these moves of the parts are at vertex `i`.
    pub fn at(&self, i: usize, moves: &[Vec3A]) -> Vec3A {
        match self {
            Far::Wholes(pattern, _) => moves[pattern.pieces[i] as usize],
            Far::Handles(h, _) => h.row(i).map(|(a, share)| moves[a] * share).sum(),
        }
    }
}

/// What moves every piece as a whole: inverses of the sums of its blocks, of which all but the
/// diagonal ones cancel.
fn inverse_wholes(matrix: &Matrix<'_>) -> Vec<Mat3A> {
    let pattern = matrix.pattern;
    let mut wholes = vec![DMat3::ZERO; pattern.n_pieces];
    for (piece, diagonal) in pattern.pieces.iter().zip(&pattern.diagonal) {
        wholes[*piece as usize] += matrix.blocks[*diagonal as usize].as_dmat3();
    }
    for link in &matrix.links {
        for a in 0..STENCIL {
            for b in 0..STENCIL {
                let [p, q] = [a, b].map(|k| pattern.pieces[link.verts[k] as usize]);
                if p == q {
                    let w = link.weights[a] * link.weights[b];
                    wholes[p as usize] += link.stiffness.as_dmat3() * f64::from(w);
                }
            }
        }
    }
    let inverse = |m: &DMat3| Some(m.inverse()).filter(|m| m.is_finite());
    wholes
        .iter()
        .map(|m| narrow(&inverse(m).unwrap_or(DMat3::ZERO)))
        .collect()
}

/// The matrix as handles see it: for every handle the blocks to those before it and itself.
pub(crate) fn seen(matrix: &Matrix<'_>, handles: &Handles) -> Vec<Vec<Mat3A>> {
    use rayon::prelude::*;
    let near = &matrix.pattern.near;
    let own = ordered::map(matrix.pattern.diagonal.len(), |i| matrix.stretched(i));
    let row = |a: usize| {
        let whole = |k: &f32| Mat3A::from_diagonal(Vec3::splat(*k));
        let mut row: Vec<Mat3A> = handles.bent[a].iter().map(whole).collect();
        let mut add = |j: u32, block: Mat3A| {
            let before = handles.row(j as usize).take_while(|h| h.0 <= a);
            before.for_each(|(b, other)| row[b] += block * other);
        };
        for &(i, share) in &handles.moved[a] {
            add(i, own[i as usize] * share);
            for k in near.span(i as usize).filter(|k| near.items[*k] != i) {
                add(near.items[k], matrix.blocks[k] * share);
            }
        }
        row
    };
    let mut rows: Vec<Vec<Mat3A>> = (0..handles.len()).into_par_iter().map(row).collect();
    let mut pulls: Vec<(usize, f32)> = Vec::new();
    for link in &matrix.links {
        pulls.clear();
        for k in (0..STENCIL).filter(|&k| link.weights[k] != 0.0) {
            let of = handles.row(link.verts[k] as usize);
            pulls.extend(of.map(|(h, share)| (h, share * link.weights[k])));
        }
        pulls.sort_by_key(|p| p.0);
        pulls.dedup_by(|b, a| {
            let same = a.0 == b.0;
            a.1 += if same { b.1 } else { 0.0 };
            same
        });
        for (k, &(a, wa)) in pulls.iter().enumerate() {
            for &(b, wb) in &pulls[..=k] {
                rows[a][b] += link.stiffness * (wa * wb);
            }
        }
    }
    rows
}

/// A Cholesky factor: the columns of `L`, from the diagonal on.
#[derive(Clone, Debug)]
pub(crate) struct Factor(Vec<Vec<f32>>);

impl Factor {
    /// Factors a matrix of 3×3 blocks given up to the diagonal; none if it is not positive.
    fn new(blocks: &[Vec<Mat3A>]) -> Option<Factor> {
        let n = 3 * blocks.len();
        let mut cols: Vec<Vec<f32>> = Vec::with_capacity(n);
        for j in 0..n {
            let below = (j..n).map(|i| blocks[i / 3][j / 3].col(j % 3)[i % 3]);
            let mut col: Vec<f32> = below.collect();
            // Four columns at a time: one alone spends its time on fetching and putting back.
            let (fours, rest) = cols.as_chunks::<4>();
            for (k, four) in fours.iter().enumerate() {
                let [a, b, c, d] = std::array::from_fn(|m| &four[m][j - 4 * k - m..]);
                let [ka, kb, kc, kd] = [a[0], b[0], c[0], d[0]];
                let four = a.iter().zip(b).zip(c.iter().zip(d));
                for (x, ((a, b), (c, d))) in col.iter_mut().zip(four) {
                    *x -= (ka * a + kb * b) + (kc * c + kd * d);
                }
            }
            for (k, one) in (cols.len() - rest.len()..).zip(rest) {
                less(&mut col, one[j - k], &one[j - k..]);
            }
            if col[0].is_nan() || col[0] <= 0.0 {
                return None;
            }
            let root = col[0].sqrt();
            col.iter_mut().for_each(|x| *x /= root);
            cols.push(col);
        }
        Some(Factor(cols))
    }

    fn solve(&self, b: &[Vec3A]) -> Vec<Vec3A> {
        let mut y: Vec<f32> = b.iter().flat_map(|b| b.to_array()).collect();
        for (j, col) in self.0.iter().enumerate() {
            y[j] /= col[0];
            let here = y[j];
            less(&mut y[j + 1..], here, &col[1..]);
        }
        for (j, col) in self.0.iter().enumerate().rev() {
            y[j] = (y[j] - dot(&col[1..], &y[j + 1..])) / col[0];
        }
        y.as_chunks().0.iter().map(|c| Vec3A::from(*c)).collect()
    }
}

/// Takes `k b` from `a`.
fn less(a: &mut [f32], k: f32, b: &[f32]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a -= k * b);
}

/// `a · b`, sixteen products side by side.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    let mut sums = [0.0; 16];
    for (a, b) in a.iter().zip(b) {
        for k in 0..16 {
            sums[k] += a[k] * b[k];
        }
    }
    for ((sum, a), b) in sums.iter_mut().zip(a_rest).zip(b_rest) {
        *sum += a * b;
    }
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            sums[k] += sums[k + half];
        }
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of 30 × 30 vertices.
    fn sheet() -> Vec<[u32; 3]> {
        let cells = (0..29 * 30).filter(|v| v % 30 < 29);
        cells
            .flat_map(|v| [[v, v + 1, v + 31], [v, v + 31, v + 30]])
            .collect()
    }

    /// Cloth of `n` vertices without hinges.
    fn unbent(n: usize) -> Bending {
        Bending {
            far: Rows::counted(n, &[]),
            ..Bending::default()
        }
    }

    #[test]
    fn shares_of_a_vertex_sum_to_one_and_every_vertex_has_a_handle() {
        let pattern = Pattern::new(900, &sheet());
        let handles = Handles::new(&pattern.near, &unbent(900)).expect("one sheet");
        assert!((6..60).contains(&handles.len()), "{}", handles.len());
        for v in 0..900 {
            let total: f32 = handles.row(v).map(|h| h.1).sum();
            assert!((total - 1.0).abs() < 1e-6, "vertex {v}: {total}");
            assert!(handles.row(v).is_sorted_by_key(|h| h.0));
        }
    }

    #[test]
    fn crumbs_get_no_handles() {
        let faces: Vec<[u32; 3]> = (0..200).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        assert!(Handles::new(&Pattern::new(600, &faces).near, &unbent(600)).is_none());
    }

    #[test]
    fn a_factor_solves_and_refuses_what_is_not_positive() {
        let m = |a: f32, b: f32| {
            Mat3A::from_diagonal(glam::Vec3::splat(a)) + Mat3A::from_cols_array(&[b; 9])
        };
        let blocks = [vec![m(4.0, 0.5)], vec![m(-1.0, 0.2), m(5.0, 0.1)]];
        let x = [Vec3A::new(1.0, -2.0, 0.5), Vec3A::new(0.3, 0.7, -1.1)];
        let b = [
            blocks[0][0] * x[0] + blocks[1][0].transpose() * x[1],
            blocks[1][0] * x[0] + blocks[1][1] * x[1],
        ];
        let got = Factor::new(&blocks).expect("it is positive").solve(&b);
        for (got, want) in got.iter().zip(x) {
            assert!((*got - want).length() < 1e-5, "{got} for {want}");
        }
        assert!(Factor::new(&[vec![m(-1.0, 0.0)]]).is_none());
    }
}
