//! Rows times packed weights: `out = hold(rows · weightsᵀ + bias + plus)`.
//!
//! Weights are packed once into panels of sixteen columns (eight for a short rest), so that the
//! inner loop reads them in order; six rows share every panel row it reads.

use super::Finish;
use crate::simd::{Kernel, Lanes, N_LANES, fastest};

/// Bytes of rows worked on before going to the next panel: half of a usual second-level cache.
const BLOCK_BYTES: usize = 128 << 10;

/// Weights `[n, k]` and bias `[n]`, laid out for [`multiply`].
pub(crate) struct Packed {
    n: usize,
    k: usize,
    wide: Vec<Panel<2>>,
    narrow: Option<Panel<1>>,
}

/// `P` times eight columns.
struct Panel<const P: usize> {
    bias: [Eight; P],
    rows: Vec<[Eight; P]>,
}

/// Eight columns of one row, where one load can fetch them.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Eight([f32; N_LANES]);

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

fn panel<const P: usize>(weights: &[f32], bias: &[f32], first: usize) -> Panel<P> {
    let k = weights.len() / bias.len();
    let at = |x: &[f32], i: usize| x.get(i).copied().unwrap_or(0.0);
    let columns = |f: &dyn Fn(usize) -> f32| -> [Eight; P] {
        std::array::from_fn(|p| Eight(std::array::from_fn(|c| f(first + p * N_LANES + c))))
    };
    let rows = (0..k)
        .map(|j| columns(&|c| at(weights, c * k + j)))
        .collect();
    Panel {
        bias: columns(&|c| at(bias, c)),
        rows,
    }
}

/// Multiplies every row of `rows` (each `w.k()` long) into a row of `out` (each `w.n()` long).
///
/// `finish.plus` is laid out like `out`.
pub(crate) fn multiply(w: &Packed, rows: &[f32], finish: Finish<'_>, out: &mut [f32]) {
    fastest(Multiply {
        w,
        rows,
        finish,
        out,
    });
}

struct Multiply<'a> {
    w: &'a Packed,
    rows: &'a [f32],
    finish: Finish<'a>,
    out: &'a mut [f32],
}

impl Kernel for Multiply<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self {
            w,
            rows,
            finish,
            out,
        } = self;
        let block = (BLOCK_BYTES / (4 * w.k)).max(6) / 6 * 6;
        for (b, rows) in rows.chunks(block * w.k).enumerate() {
            let from = b * block * w.n;
            let n = rows.len() / w.k * w.n;
            let plus = finish.plus.map(|p| &p[from..from + n]);
            let finish = Finish { plus, ..finish };
            let out = &mut out[from..from + n];
            for (p, panel) in w.wide.iter().enumerate() {
                stripe::<2, L>(panel, rows, finish, (out, w.n, p * 16));
            }
            if let Some(panel) = &w.narrow {
                stripe::<1, L>(panel, rows, finish, (out, w.n, w.wide.len() * 16));
            }
        }
    }
}

/// An output, its row length and the first value a panel makes.
type Target<'a> = (&'a mut [f32], usize, usize);

/// All rows times one panel.
#[inline(always)]
fn stripe<const P: usize, L: Lanes>(
    panel: &Panel<P>,
    rows: &[f32],
    finish: Finish<'_>,
    (out, n, col): Target<'_>,
) {
    let k = panel.rows.len();
    for (t, rows) in rows.chunks(6 * k).enumerate() {
        let target = (&mut *out, n, t * 6 * n + col);
        match rows.len() / k {
            6 => tile::<6, P, L>(panel, rows, finish, target),
            5 => tile::<5, P, L>(panel, rows, finish, target),
            4 => tile::<4, P, L>(panel, rows, finish, target),
            3 => tile::<3, P, L>(panel, rows, finish, target),
            2 => tile::<2, P, L>(panel, rows, finish, target),
            _ => tile::<1, P, L>(panel, rows, finish, target),
        }
    }
}

/// `M` rows times one panel, in registers.
#[inline(always)]
fn tile<const M: usize, const P: usize, L: Lanes>(
    panel: &Panel<P>,
    rows: &[f32],
    finish: Finish<'_>,
    (out, n, at): Target<'_>,
) {
    let k = panel.rows.len();
    let rows: [&[f32]; M] = std::array::from_fn(|i| &rows[i * k..][..k]);
    let mut sum = [std::array::from_fn::<L, P, _>(|p| L::load(&panel.bias[p].0)); M];
    for (j, w) in panel.rows.iter().enumerate() {
        for i in 0..M {
            let x = L::splat(rows[i][j]);
            for p in 0..P {
                sum[i][p] = sum[i][p].plus_product(x, L::load(&w[p].0));
            }
        }
    }
    let width = n - at % n;
    for i in 0..M {
        for p in (0..P).filter(|p| p * N_LANES < width) {
            let at = at + i * n + p * N_LANES;
            let end = at + N_LANES.min(width - p * N_LANES);
            let plus = finish.plus.map(|plus| &plus[at..end]);
            put(sum[i][p], plus, finish.limits, &mut out[at..end]);
        }
    }
}

/// Finishes up to eight sums.
#[inline(always)]
fn put<L: Lanes>(sum: L, plus: Option<&[f32]>, [low, high]: [f32; 2], out: &mut [f32]) {
    let plus = plus.map_or(L::splat(0.0), |plus| L::load(&eight(plus)));
    let held = sum.plus(plus).hold(L::splat(low), L::splat(high));
    match <&mut [f32; N_LANES]>::try_from(&mut *out) {
        Ok(out) => held.store(out),
        Err(_) => {
            let mut all = [0.0; N_LANES];
            held.store(&mut all);
            out.copy_from_slice(&all[..out.len()]);
        }
    }
}

/// Up to eight values, then zeros.
#[inline(always)]
fn eight(x: &[f32]) -> [f32; N_LANES] {
    x.first_chunk().copied().unwrap_or_else(|| {
        let mut all = [0.0; N_LANES];
        all[..x.len()].copy_from_slice(x);
        all
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::noise::{assert_close, values};
    use crate::simd::plain;

    fn naive(w: &[f32], bias: &[f32], rows: &[f32]) -> Vec<f32> {
        let (n, k) = (bias.len(), w.len() / bias.len());
        let dot = |r: &[f32], j: usize| (0..k).map(|i| r[i] * w[j * k + i]).sum::<f32>() + bias[j];
        rows.chunks(k)
            .flat_map(|r| (0..n).map(move |j| dot(r, j)))
            .collect()
    }

    #[test]
    fn every_remainder_of_rows_and_columns_agrees_with_plain_sums() {
        for (m, n, k) in [
            (1, 1, 1),
            (7, 8, 5),
            (13, 24, 3),
            (6, 17, 9),
            (40, 39, 48),
            (5, 30, 2),
        ] {
            let (w, b) = (values(n * k, 1), values(n, 2));
            let (rows, plus) = (values(m * k, 3), values(m * n, 4));
            let want: Vec<f32> = naive(&w, &b, &rows)
                .iter()
                .zip(&plus)
                .map(|(a, p)| (a + p).clamp(0.0, 6.0))
                .collect();
            let finish = Finish {
                limits: [0.0, 6.0],
                plus: Some(&plus),
            };
            let packed = Packed::new(&w, &b);
            let mut out = vec![f32::NAN; m * n];
            multiply(&packed, &rows, finish, &mut out);
            assert_close(&out, &want, 1e-5);
            let mut twin = vec![f32::NAN; m * n];
            plain(Multiply {
                w: &packed,
                rows: &rows,
                finish,
                out: &mut twin,
            });
            assert_close(&out, &twin, 1e-5);
        }
    }

    #[test]
    fn blocks_join_without_a_seam() {
        let (m, n, k) = (100, 20, 700);
        let (w, b, rows) = (values(n * k, 5), values(n, 6), values(m * k, 7));
        let mut out = vec![0.0; m * n];
        let finish = Finish {
            limits: [f32::NEG_INFINITY, f32::INFINITY],
            plus: None,
        };
        multiply(&Packed::new(&w, &b), &rows, finish, &mut out);
        assert_close(&out, &naive(&w, &b, &rows), 1e-3);
    }
}
