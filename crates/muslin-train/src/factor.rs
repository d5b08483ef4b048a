//! A sparse Cholesky factorisation with 3 × 3 blocks, and its solves for many right-hand sides.
//!
//! Vertices are ordered by nested dissection of their places (George 1973): a garment is a surface,
//! so that the factor stays within a few dozen blocks a column. Factored in double precision,
//! solved in single, 32 right-hand sides side by side.

use glam::{DMat3, DVec3};
use muslin_geom::widely;
use rayon::prelude::*;

use crate::rows::flat;

/// A symmetric matrix of blocks by rows; both halves are given.
#[derive(Clone, Debug)]
pub struct Matrix {
    pub starts: Vec<u32>,
    pub cols: Vec<u32>,
    pub blocks: Vec<DMat3>,
}

/// Which blocks of the factor are not zero, and the order of elimination.
#[derive(Clone, Debug)]
pub struct Pattern {
    /// From a place in the order to the vertex.
    order: Vec<u32>,
    /// And back.
    place: Vec<u32>,
    /// Rows below the diagonal of every column.
    starts: Vec<u32>,
    rows: Vec<u32>,
}

/// `A = L Lᵀ`.
#[derive(Clone, Debug)]
pub struct Factor {
    pattern: Pattern,
    /// By column, each block by rows.
    blocks: Vec<[f32; 9]>,
    /// Inverses of the diagonal blocks, lower triangles by rows.
    diagonal: Vec<[f32; 9]>,
}

/// Right-hand sides that are solved side by side.
const SIDE: usize = 32;
/// Fewer vertices than this are not divided further.
const LEAF: usize = 12;

impl Pattern {
    /// For vertices at `x` [m] that are coupled to those in `near`.
    pub fn new(x: &[DVec3], near: &[Vec<u32>]) -> Self {
        let mut order = Vec::with_capacity(x.len());
        dissect((0..x.len() as u32).collect(), x, near, &mut order);
        let mut place = vec![0; x.len()];
        order
            .iter()
            .enumerate()
            .for_each(|(k, v)| place[*v as usize] = k as u32);
        let mut columns: Vec<Vec<u32>> = vec![Vec::new(); x.len()];
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); x.len()];
        for j in 0..x.len() {
            let mut rows: Vec<u32> = near[order[j] as usize]
                .iter()
                .map(|v| place[*v as usize])
                .collect();
            for &c in &children[j] {
                rows.extend(&columns[c as usize]);
            }
            rows.retain(|i| *i as usize > j);
            rows.sort_unstable();
            rows.dedup();
            if let Some(parent) = rows.first() {
                children[*parent as usize].push(j as u32);
            }
            columns[j] = rows;
        }
        let (starts, rows) = flat(&columns);
        Self {
            order,
            place,
            starts,
            rows,
        }
    }

    fn span(&self, j: usize) -> std::ops::Range<usize> {
        self.starts[j] as usize..self.starts[j + 1] as usize
    }
}

/// Appends `part` to `order`: both halves, then what separates them.
fn dissect(mut part: Vec<u32>, x: &[DVec3], near: &[Vec<u32>], order: &mut Vec<u32>) {
    if part.len() <= LEAF {
        order.append(&mut part);
        return;
    }
    let at = |v: u32| x[v as usize];
    let low = part.iter().fold(DVec3::INFINITY, |m, v| m.min(at(*v)));
    let high = part.iter().fold(DVec3::NEG_INFINITY, |m, v| m.max(at(*v)));
    let axis = (high - low).max_position();
    part.sort_by(|a, b| at(*a)[axis].total_cmp(&at(*b)[axis]).then(a.cmp(b)));
    let upper = part.split_off(part.len() / 2);
    let mut is_upper = upper.clone();
    is_upper.sort_unstable();
    let (between, lower): (Vec<u32>, Vec<u32>) = (part.into_iter()).partition(|v| {
        near[*v as usize]
            .iter()
            .any(|n| is_upper.binary_search(n).is_ok())
    });
    dissect(lower, x, near, order);
    dissect(upper, x, near, order);
    order.extend(between);
}

impl Factor {
    /// Factors `a`; none if it is not positive definite.
    pub fn new(pattern: &Pattern, a: &Matrix) -> Option<Self> {
        widely(
            #[inline(always)]
            || Self::factored(pattern, a),
        )
    }

    #[inline(always)]
    fn factored(pattern: &Pattern, a: &Matrix) -> Option<Self> {
        let n = pattern.order.len();
        let mut blocks = vec![Block::default(); pattern.rows.len()];
        let mut inverses = vec![DMat3::ZERO; n];
        let mut work = vec![Block::default(); n];
        // Columns whose next row is this one, as chains; and where each column has come to.
        let (mut head, mut next) = (vec![u32::MAX; n], vec![u32::MAX; n]);
        let mut at: Vec<usize> = (0..n).map(|j| pattern.span(j).start).collect();
        for j in 0..n {
            let v = pattern.order[j] as usize;
            for k in a.starts[v] as usize..a.starts[v + 1] as usize {
                let i = pattern.place[a.cols[k] as usize] as usize;
                if i >= j {
                    // Row v's block is A_vj; the column's is its transpose.
                    work[i] = Block::of(&a.blocks[k].transpose());
                }
            }
            let mut k = head[j];
            while k != u32::MAX {
                let (column, later) = (k as usize, next[k as usize]);
                let (from, end) = (at[column], pattern.span(column).end);
                let across = blocks[from].matrix().transpose();
                for q in from..end {
                    work[pattern.rows[q] as usize].subtract(&blocks[q].times(&across));
                }
                at[column] = from + 1;
                if from + 1 < end {
                    chain(&mut head, &mut next, (pattern.rows[from + 1], k));
                }
                k = later;
            }
            let lower = cholesky(std::mem::take(&mut work[j]).matrix())?;
            inverses[j] = lower.inverse();
            let right = inverses[j].transpose();
            for q in pattern.span(j) {
                let below = &mut work[pattern.rows[q] as usize];
                blocks[q] = std::mem::take(below).times(&right);
            }
            if let Some(first) = pattern.rows[pattern.span(j)].first() {
                chain(&mut head, &mut next, (*first, j as u32));
            }
        }
        let single = |m: &DMat3| m.transpose().to_cols_array().map(|x| x as f32);
        Some(Self {
            pattern: pattern.clone(),
            blocks: blocks.iter().map(|b| single(&b.matrix())).collect(),
            diagonal: inverses.iter().map(single).collect(),
        })
    }

    /// Solves `A X = B` for the columns of `b`, which has three rows a vertex and `width` columns.
    pub fn solve(&self, b: &[f32], width: usize) -> Vec<f32> {
        let n = self.pattern.order.len();
        let slabs: Vec<Vec<[[f32; SIDE]; 3]>> = (0..width.div_ceil(SIDE))
            .into_par_iter()
            .map(|s| {
                let span = s * SIDE..((s + 1) * SIDE).min(width);
                let mut x = vec![[[0.0; SIDE]; 3]; n];
                for (x, v) in x.iter_mut().zip(&self.pattern.order) {
                    for axis in 0..3 {
                        let row = &b[(3 * *v as usize + axis) * width..][span.clone()];
                        x[axis][..row.len()].copy_from_slice(row);
                    }
                }
                widely(
                    #[inline(always)]
                    || self.sweep(&mut x),
                );
                x
            })
            .collect();
        let mut out = vec![0.0; b.len()];
        for (s, slab) in slabs.iter().enumerate() {
            let span = s * SIDE..((s + 1) * SIDE).min(width);
            for (x, v) in slab.iter().zip(&self.pattern.order) {
                for axis in 0..3 {
                    let row = &mut out[(3 * *v as usize + axis) * width..][span.clone()];
                    let len = row.len();
                    row.copy_from_slice(&x[axis][..len]);
                }
            }
        }
        out
    }

    /// Forward, then back.
    #[inline(always)]
    fn sweep(&self, x: &mut [[[f32; SIDE]; 3]]) {
        for j in 0..x.len() {
            let own = times(&self.diagonal[j], &x[j], false);
            x[j] = own;
            for q in self.pattern.span(j) {
                let there = &mut x[self.pattern.rows[q] as usize];
                subtract(there, &self.blocks[q], &own, false);
            }
        }
        for j in (0..x.len()).rev() {
            let mut own = x[j];
            for q in self.pattern.span(j) {
                let there = &x[self.pattern.rows[q] as usize];
                subtract(&mut own, &self.blocks[q], there, true);
            }
            x[j] = times(&self.diagonal[j], &own, true);
        }
    }
}

/// The half of a solve that a device does at once: what each vertex waits for, and levels of those that wait for none of
/// their own.
#[cfg(any(test, feature = "cuda"))]
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    /// Where each level's members start, and they.
    pub levels: Vec<u32>,
    pub members: Vec<u32>,
    /// Where what each vertex waits for starts, and it, with its block by rows.
    pub starts: Vec<u32>,
    pub others: Vec<u32>,
    pub blocks: Vec<f32>,
    /// What is left is multiplied with, by rows.
    pub diagonal: Vec<f32>,
}

#[cfg(any(test, feature = "cuda"))]
impl Sweep {
    /// Of rows of other vertices and blocks, told in an order in which no vertex waits for a later one.
    fn new(rows: &[Vec<(u32, [f32; 9])>], told: impl Iterator<Item = usize>) -> Self {
        let mut level = vec![0usize; rows.len()];
        let mut members: Vec<Vec<u32>> = Vec::new();
        for v in told {
            let waits = rows[v].iter().map(|e| level[e.0 as usize] + 1);
            level[v] = waits.max().unwrap_or(0);
            if members.len() == level[v] {
                members.push(Vec::new());
            }
            members[level[v]].push(v as u32);
        }
        let (levels, members) = flat(&members);
        let (starts, waited) = flat(rows);
        Self {
            levels,
            members,
            starts,
            others: waited.iter().map(|e| e.0).collect(),
            blocks: waited.iter().flat_map(|e| e.1).collect(),
            diagonal: Vec::new(),
        }
    }
}

#[cfg(any(test, feature = "cuda"))]
impl Factor {
    /// Vertices in the order of elimination.
    pub fn order(&self) -> &[u32] {
        &self.pattern.order
    }

    /// Where in it each vertex is.
    pub fn places(&self) -> &[u32] {
        &self.pattern.place
    }

    /// Both halves of a solve: down, then up.
    pub fn sweeps(&self) -> [Sweep; 2] {
        let n = self.pattern.order.len();
        let turned = |m: &[f32; 9]| std::array::from_fn(|i| m[3 * (i % 3) + i / 3]);
        let [mut down, mut up] = [(); 2].map(|()| vec![Vec::new(); n]);
        for (j, up) in up.iter_mut().enumerate() {
            for q in self.pattern.span(j) {
                let i = self.pattern.rows[q];
                down[i as usize].push((j as u32, self.blocks[q]));
                up.push((i, turned(&self.blocks[q])));
            }
        }
        let flat = |m: &mut dyn Iterator<Item = [f32; 9]>| m.flatten().collect();
        [
            Sweep {
                diagonal: flat(&mut self.diagonal.iter().copied()),
                ..Sweep::new(&down, 0..n)
            },
            Sweep {
                diagonal: flat(&mut self.diagonal.iter().map(turned)),
                ..Sweep::new(&up, (0..n).rev())
            },
        ]
    }
}

/// A 3 × 3 block by columns, each of which fills a wide register.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(32))]
struct Block([[f64; 4]; 3]);

impl Block {
    #[inline(always)]
    fn of(m: &DMat3) -> Self {
        Self(m.to_cols_array_2d().map(|[x, y, z]| [x, y, z, 0.0]))
    }

    #[inline(always)]
    fn matrix(&self) -> DMat3 {
        let column = |[x, y, z, _]: [f64; 4]| [x, y, z];
        DMat3::from_cols_array_2d(&self.0.map(column))
    }

    /// Its product with `m`, which stands on its right.
    #[inline(always)]
    fn times(&self, m: &DMat3) -> Self {
        let [a, b, c] = &self.0;
        let column = |m: [f64; 3]| {
            std::array::from_fn(
                #[inline(always)]
                |i| a[i] * m[0] + b[i] * m[1] + c[i] * m[2],
            )
        };
        let [x, y, z] = m.to_cols_array_2d();
        Self([column(x), column(y), column(z)])
    }

    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            own.iter_mut().zip(other).for_each(|(x, y)| *x -= y);
        }
    }
}

#[inline(always)]
fn chain(head: &mut [u32], next: &mut [u32], (row, column): (u32, u32)) {
    next[column as usize] = head[row as usize];
    head[row as usize] = column;
}

/// The lower factor of a 3 × 3 block; none if it is not positive definite.
fn cholesky(a: DMat3) -> Option<DMat3> {
    let [c0, c1, c2] = [a.x_axis, a.y_axis, a.z_axis];
    let l00 = c0.x.sqrt();
    let (l10, l20) = (c0.y / l00, c0.z / l00);
    let l11 = (c1.y - l10 * l10).sqrt();
    let l21 = (c1.z - l20 * l10) / l11;
    let l22 = (c2.z - l20 * l20 - l21 * l21).sqrt();
    let lower = DMat3::from_cols(
        DVec3::new(l00, l10, l20),
        DVec3::new(0.0, l11, l21),
        DVec3::new(0.0, 0.0, l22),
    );
    (lower.is_finite() && l00 * l11 * l22 > 0.0).then_some(lower)
}

/// `M x`, or `Mᵀ x`; `m` by rows.
#[inline(always)]
fn times(m: &[f32; 9], x: &[[f32; SIDE]; 3], transposed: bool) -> [[f32; SIDE]; 3] {
    let mut out = [[0.0; SIDE]; 3];
    for r in 0..3 {
        for c in 0..3 {
            let k = if transposed {
                m[3 * c + r]
            } else {
                m[3 * r + c]
            };
            for i in 0..SIDE {
                out[r][i] += k * x[c][i];
            }
        }
    }
    out
}

/// `out -= M x`, or `Mᵀ x`.
#[inline(always)]
fn subtract(out: &mut [[f32; SIDE]; 3], m: &[f32; 9], x: &[[f32; SIDE]; 3], transposed: bool) {
    for r in 0..3 {
        for c in 0..3 {
            let k = if transposed {
                m[3 * c + r]
            } else {
                m[3 * r + c]
            };
            for i in 0..SIDE {
                out[r][i] -= k * x[c][i];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;
    use muslin_geom::neighbours;

    /// A grid's springs with random directions, plus a little.
    fn spring_grid(side: u32) -> (Vec<DVec3>, Vec<Vec<u32>>, Matrix) {
        let mut noise = Noise::new(4);
        let x: Vec<DVec3> = (0..side * side)
            .map(|i| {
                DVec3::new(
                    f64::from(i % side),
                    f64::from(i / side),
                    0.1 * noise.normal(),
                )
            })
            .collect();
        let mut faces = Vec::new();
        for r in 0..side - 1 {
            for c in 0..side - 1 {
                let a = r * side + c;
                faces.extend([[a, a + 1, a + side], [a + 1, a + side + 1, a + side]]);
            }
        }
        let near = neighbours(x.len(), &faces);
        let mut dense = std::collections::BTreeMap::new();
        for i in 0..x.len() {
            *dense.entry((i, i)).or_insert(DMat3::ZERO) += DMat3::IDENTITY * 0.05;
            for &j in near[i].iter().filter(|j| (**j as usize) > i) {
                let j = j as usize;
                let d = (x[j] - x[i]).normalize();
                let k = DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (1.0 + noise.unit());
                *dense.entry((i, i)).or_insert(DMat3::ZERO) += k;
                *dense.entry((j, j)).or_insert(DMat3::ZERO) += k;
                *dense.entry((i, j)).or_insert(DMat3::ZERO) -= k;
                *dense.entry((j, i)).or_insert(DMat3::ZERO) -= k;
            }
        }
        let mut m = Matrix {
            starts: vec![0],
            cols: vec![],
            blocks: vec![],
        };
        for i in 0..x.len() {
            for ((_, j), b) in dense.range((i, 0)..(i + 1, 0)) {
                m.cols.push(*j as u32);
                m.blocks.push(*b);
            }
            m.starts.push(m.cols.len() as u32);
        }
        (x, near, m)
    }

    #[test]
    fn what_is_solved_gives_back_the_right_hand_sides() {
        let (x, near, a) = spring_grid(23);
        let factor = Factor::new(&Pattern::new(&x, &near), &a).expect("positive definite");
        let width = 37;
        let b = Noise::new(9).normals(3 * x.len() * width);
        let s = factor.solve(&b, width);
        for v in 0..x.len() {
            for k in 0..width {
                let at = |list: &[f32], v: usize| {
                    DVec3::from_array([0, 1, 2].map(|c| f64::from(list[(3 * v + c) * width + k])))
                };
                let mut back = DVec3::ZERO;
                for e in a.starts[v] as usize..a.starts[v + 1] as usize {
                    back += a.blocks[e] * at(&s, a.cols[e] as usize);
                }
                assert!(
                    back.distance(at(&b, v)) < 1e-3,
                    "{back} against {}",
                    at(&b, v)
                );
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let (x, near, mut a) = spring_grid(5);
        let middle = (a.starts[12]..a.starts[13])
            .find(|k| a.cols[*k as usize] == 12)
            .expect("a diagonal");
        a.blocks[middle as usize] = DMat3::IDENTITY * -1.0;
        assert!(Factor::new(&Pattern::new(&x, &near), &a).is_none());
    }

    #[test]
    fn a_surface_fills_in_little() {
        let (x, near, _) = spring_grid(60);
        let pattern = Pattern::new(&x, &near);
        assert!(
            pattern.rows.len() < 40 * x.len(),
            "{} blocks a column",
            pattern.rows.len() / x.len()
        );
        let mut sorted = pattern.order.clone();
        sorted.sort_unstable();
        assert!(
            sorted.iter().enumerate().all(|(i, v)| i == *v as usize),
            "a permutation"
        );
    }
}
