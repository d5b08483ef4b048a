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

/// Rows to multiply, wherever their numbers lie: a row is `pieces` runs of `len` numbers.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    /// What they are read from, the first row's first run first.
    pub from: &'a [f32],
    /// From a row to the next.
    pub step: usize,
    /// Runs in a row.
    pub pieces: usize,
    /// From a run to the next.
    pub jump: usize,
    /// Numbers in a run.
    pub len: usize,
}

impl<'a> Rows<'a> {
    /// Rows of `k` numbers, one after another.
    pub(crate) fn plain(from: &'a [f32], k: usize) -> Self {
        Self {
            from,
            step: k,
            pieces: 1,
            jump: 0,
            len: k,
        }
    }

    /// All but the first `n`.
    fn after(self, n: usize) -> Self {
        let from = &self.from[n * self.step..];
        Self { from, ..self }
    }
}

/// Multiplies rows (each `w.k()` long) into those of `out` (each `w.n()` long), as many as it has.
///
/// `finish.plus` is laid out like `out`.
pub(crate) fn multiply(w: &Packed, rows: Rows<'_>, finish: Finish<'_>, out: &mut [f32]) {
    assert_eq!(rows.pieces * rows.len, w.k, "rows fit their weights");
    fastest(Multiply {
        w,
        rows,
        finish,
        out,
    });
}

struct Multiply<'a> {
    w: &'a Packed,
    rows: Rows<'a>,
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
        for (b, out) in out.chunks_mut(block * w.n).enumerate() {
            let plus = finish.plus.map(|p| &p[b * block * w.n..][..out.len()]);
            let finish = Finish { plus, ..finish };
            let rows = rows.after(b * block);
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
    rows: Rows<'_>,
    finish: Finish<'_>,
    (out, n, col): Target<'_>,
) {
    let m = out.len() / n;
    for t in (0..m).step_by(6) {
        let target = (&mut *out, n, t * n + col);
        let rows = rows.after(t);
        match m - t {
            1 => tile::<1, P, L>(panel, rows, finish, target),
            2 => tile::<2, P, L>(panel, rows, finish, target),
            3 => tile::<3, P, L>(panel, rows, finish, target),
            4 => tile::<4, P, L>(panel, rows, finish, target),
            5 => tile::<5, P, L>(panel, rows, finish, target),
            _ => tile::<6, P, L>(panel, rows, finish, target),
        }
    }
}

/// `M` rows times one panel, in registers.
#[inline(always)]
fn tile<const M: usize, const P: usize, L: Lanes>(
    panel: &Panel<P>,
    rows: Rows<'_>,
    finish: Finish<'_>,
    (out, n, at): Target<'_>,
) {
    let mut sum = [[L::splat(0.0); P]; M];
    for (p, bias) in panel.bias.iter().enumerate() {
        sum.iter_mut().for_each(|sum| sum[p] = L::load(&bias.0));
    }
    for (s, panel) in panel.rows.chunks_exact(rows.len).enumerate() {
        let mut runs: [&[f32]; M] = [&[]; M];
        for (i, run) in runs.iter_mut().enumerate() {
            *run = &rows.from[i * rows.step + s * rows.jump..][..panel.len()];
        }
        for (j, w) in panel.iter().enumerate() {
            for i in 0..M {
                let x = L::splat(runs[i][j]);
                for p in 0..P {
                    sum[i][p] = sum[i][p].plus_product(x, L::load(&w[p].0));
                }
            }
        }
    }
    let limits = finish.limits;
    let width = (n - at % n).min(P * N_LANES);
    for (i, sum) in sum.iter().enumerate() {
        let from = at + i * n;
        let plus = finish.plus.map(|plus| &plus[from..from + width]);
        let out = &mut out[from..from + width];
        match (plus, width == P * N_LANES) {
            (None, true) => put_whole(sum, limits, out),
            _ => put(sum, plus, limits, out),
        }
    }
}

/// Finishes `P` times eight sums to which nothing is added.
#[inline(always)]
fn put_whole<const P: usize, L: Lanes>(sum: &[L; P], limits: [f32; 2], out: &mut [f32]) {
    let [low, high] = [L::splat(limits[0]), L::splat(limits[1])];
    for (sum, out) in sum.iter().zip(out.as_chunks_mut().0) {
        sum.hold(low, high).store(out);
    }
}

/// Finishes up to `P` times eight sums.
#[inline(always)]
fn put<const P: usize, L: Lanes>(
    sum: &[L; P],
    plus: Option<&[f32]>,
    limits: [f32; 2],
    out: &mut [f32],
) {
    let [low, high] = [L::splat(limits[0]), L::splat(limits[1])];
    for (p, out) in out.chunks_mut(N_LANES).enumerate() {
        let plus = plus.map_or(L::splat(0.0), |plus| L::load(&eight(&plus[p * N_LANES..])));
        let held = sum[p].plus(plus).hold(low, high);
        match <&mut [f32; N_LANES]>::try_from(&mut *out) {
            Ok(out) => held.store(out),
            Err(_) => {
                let mut all = [0.0; N_LANES];
                held.store(&mut all);
                out.copy_from_slice(&all[..out.len()]);
            }
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
            multiply(&packed, Rows::plain(&rows, k), finish, &mut out);
            assert_close(&out, &want, 1e-5);
            let mut twin = vec![f32::NAN; m * n];
            plain(Multiply {
                w: &packed,
                rows: Rows::plain(&rows, k),
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
        multiply(
            &Packed::new(&w, &b),
            Rows::plain(&rows, k),
            finish,
            &mut out,
        );
        assert_close(&out, &naive(&w, &b, &rows), 1e-3);
    }
}
