//! Rows times packed weights: `out = hold(rows · weightsᵀ + bias + plus)`.
//!
//! Weights are packed once into panels of 16 columns (8 for a short rest), so that the inner
//! loop reads them in order; six rows share every panel row it reads.

use super::{Finish, hold};
use crate::simd::{Kernel, fastest, madd};

/// Bytes of rows worked on before going to the next panel: half of a usual second-level cache.
const BLOCK_BYTES: usize = 128 << 10;

/// Weights `[n, k]` and bias `[n]`, laid out for [`multiply`].
pub(crate) struct Packed {
    n: usize,
    k: usize,
    wide: Vec<Panel<16>>,
    narrow: Option<Panel<8>>,
}

struct Panel<const N: usize> {
    bias: [f32; N],
    rows: Vec<[f32; N]>,
}

impl Packed {
    /// Packs `weights`, `n` rows of `k` each, and their `bias`.
    pub(crate) fn new(weights: &[f32], bias: &[f32]) -> Self {
        let n = bias.len();
        let k = weights.len() / n.max(1);
        let narrow = (1..=8).contains(&(n % 16));
        let n_wide = if narrow { n / 16 } else { n.div_ceil(16) };
        Self {
            n,
            k,
            wide: (0..n_wide).map(|p| panel(weights, bias, p * 16)).collect(),
            narrow: narrow.then(|| panel(weights, bias, n_wide * 16)),
        }
    }

    /// Length of a row it multiplies.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Length of a row it makes.
    pub(crate) fn n(&self) -> usize {
        self.n
    }
}

fn panel<const N: usize>(weights: &[f32], bias: &[f32], first: usize) -> Panel<N> {
    let k = weights.len() / bias.len();
    let at = |x: &[f32], i: usize| x.get(i).copied().unwrap_or(0.0);
    let row = |j| std::array::from_fn(|c| at(weights, (first + c) * k + j));
    let bias = std::array::from_fn(|c| at(bias, first + c));
    Panel { bias, rows: (0..k).map(row).collect() }
}

/// Multiplies every row of `rows` (each `w.k()` long) into a row of `out` (each `w.n()` long).
///
/// `finish.plus` is laid out like `out`.
pub(crate) fn multiply(w: &Packed, rows: &[f32], finish: Finish<'_>, out: &mut [f32]) {
    fastest(Multiply { w, rows, finish, out });
}

struct Multiply<'a> {
    w: &'a Packed,
    rows: &'a [f32],
    finish: Finish<'a>,
    out: &'a mut [f32],
}

impl Kernel for Multiply<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { w, rows, finish, out } = self;
        let block = (BLOCK_BYTES / (4 * w.k)).max(6) / 6 * 6;
        for (b, rows) in rows.chunks(block * w.k).enumerate() {
            let from = b * block * w.n;
            let n = rows.len() / w.k * w.n;
            let plus = finish.plus.map(|p| &p[from..from + n]);
            let finish = Finish { plus, ..finish };
            let out = &mut out[from..from + n];
            for (p, panel) in w.wide.iter().enumerate() {
                stripe::<16, FUSED>(panel, rows, finish, (out, w.n, p * 16));
            }
            if let Some(panel) = &w.narrow {
                stripe::<8, FUSED>(panel, rows, finish, (out, w.n, w.wide.len() * 16));
            }
        }
    }
}

/// An output, its row length and the first column a panel makes.
type Target<'a> = (&'a mut [f32], usize, usize);

/// All rows times one panel.
#[inline(always)]
fn stripe<const N: usize, const FUSED: bool>(
    panel: &Panel<N>,
    rows: &[f32],
    finish: Finish<'_>,
    (out, n, col): Target<'_>,
) {
    let k = panel.rows.len();
    for (t, rows) in rows.chunks(6 * k).enumerate() {
        let target = (&mut *out, n, t * 6 * n + col);
        match rows.len() / k {
            6 => tile::<6, N, FUSED>(panel, rows, finish, target),
            5 => tile::<5, N, FUSED>(panel, rows, finish, target),
            4 => tile::<4, N, FUSED>(panel, rows, finish, target),
            3 => tile::<3, N, FUSED>(panel, rows, finish, target),
            2 => tile::<2, N, FUSED>(panel, rows, finish, target),
            _ => tile::<1, N, FUSED>(panel, rows, finish, target),
        }
    }
}

/// `M` rows times one panel, in registers.
#[inline(always)]
fn tile<const M: usize, const N: usize, const FUSED: bool>(
    panel: &Panel<N>,
    rows: &[f32],
    finish: Finish<'_>,
    (out, n, at): Target<'_>,
) {
    let k = panel.rows.len();
    let rows: [&[f32]; M] = std::array::from_fn(|i| &rows[i * k..][..k]);
    let mut sum = [panel.bias; M];
    for (j, w) in panel.rows.iter().enumerate() {
        for i in 0..M {
            let x = rows[i][j];
            for c in 0..N {
                sum[i][c] = madd::<FUSED>(x, w[c], sum[i][c]);
            }
        }
    }
    let width = N.min(n - at % n);
    for i in 0..M {
        let at = at + i * n;
        if let Some(plus) = finish.plus {
            for (s, p) in sum[i].iter_mut().zip(&plus[at..at + width]) {
                *s += p;
            }
        }
        let row: [f32; N] = std::array::from_fn(|c| hold(sum[i][c], finish.limits));
        out[at..at + width].copy_from_slice(&row[..width]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::noise::{assert_close, values};
    use crate::simd::plain;

    fn naive(w: &[f32], bias: &[f32], rows: &[f32]) -> Vec<f32> {
        let (n, k) = (bias.len(), w.len() / bias.len());
        let dot = |r: &[f32], j: usize| (0..k).map(|i| r[i] * w[j * k + i]).sum::<f32>() + bias[j];
        rows.chunks(k).flat_map(|r| (0..n).map(move |j| dot(r, j))).collect()
    }

    #[test]
    fn every_remainder_of_rows_and_columns_agrees_with_plain_sums() {
        for (m, n, k) in [(1, 1, 1), (7, 8, 5), (13, 24, 3), (6, 17, 9), (40, 39, 48), (5, 30, 2)] {
            let (w, b) = (values(n * k, 1), values(n, 2));
            let (rows, plus) = (values(m * k, 3), values(m * n, 4));
            let want: Vec<f32> =
                naive(&w, &b, &rows).iter().zip(&plus).map(|(a, p)| (a + p).clamp(0.0, 6.0)).collect();
            let finish = Finish { limits: [0.0, 6.0], plus: Some(&plus) };
            let packed = Packed::new(&w, &b);
            let mut out = vec![f32::NAN; m * n];
            multiply(&packed, &rows, finish, &mut out);
            assert_close(&out, &want, 1e-5);
            let mut twin = vec![f32::NAN; m * n];
            plain(Multiply { w: &packed, rows: &rows, finish, out: &mut twin });
            assert_close(&out, &twin, 1e-5);
        }
    }

    #[test]
    fn blocks_join_without_a_seam() {
        let (m, n, k) = (100, 20, 700);
        let (w, b, rows) = (values(n * k, 5), values(n, 6), values(m * k, 7));
        let mut out = vec![0.0; m * n];
        let finish = Finish { limits: [f32::NEG_INFINITY, f32::INFINITY], plus: None };
        multiply(&Packed::new(&w, &b), &rows, finish, &mut out);
        assert_close(&out, &naive(&w, &b, &rows), 1e-3);
    }
}
