//! The matrix product that all layers share, over the `gemm` crate.
//!
//! `gemm` picks the widest registers of the processor at run time. It is called on one thread for
//! blocks of rows of a fixed size, so that the bits do not depend on how many threads there are.

// gemm takes raw pointers; this is the only module that gives it any.
#![allow(unsafe_code)]

use rayon::prelude::*;

/// A matrix over somebody's slice, possibly seen transposed.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    strides: [usize; 2],
}

impl<'a> View<'a> {
    /// `rows × cols` numbers, row by row.
    ///
    /// # Panics
    /// If the slice holds another number of them.
    pub fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        assert_eq!(data.len(), rows * cols, "a {rows} × {cols} matrix");
        Self {
            data,
            rows,
            cols,
            strides: [cols, 1],
        }
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The same numbers with rows and columns exchanged.
    pub fn transposed(self) -> Self {
        let ([r, c], [rows, cols]) = (self.strides, [self.rows, self.cols]);
        Self {
            rows: cols,
            cols: rows,
            strides: [c, r],
            ..self
        }
    }

    #[cfg(test)]
    fn at(&self, row: usize, col: usize) -> f32 {
        self.data[row * self.strides[0] + col * self.strides[1]]
    }
}

/// Rows of a block; a constant, because it decides the bits.
const BLOCK: usize = 512;

/// `out = keep · out + a b`, `out` row by row; with `keep` zero, what was there does not matter.
///
/// # Panics
/// If the sizes do not fit each other.
pub fn multiply(out: &mut [f32], keep: f32, a: View, b: View) {
    assert_eq!(a.cols, b.rows, "inner sizes of a product");
    assert_eq!(out.len(), a.rows * b.cols, "size of a product");
    if out.is_empty() {
        return;
    }
    let block = |(k, part): (usize, &mut [f32])| one_block(part, keep, (a, k * BLOCK), b);
    let blocks = out.chunks_mut(BLOCK * b.cols).enumerate();
    if a.rows <= BLOCK {
        blocks.for_each(block);
    } else {
        out.par_chunks_mut(BLOCK * b.cols)
            .enumerate()
            .for_each(block);
    }
}

fn one_block(out: &mut [f32], keep: f32, (a, first): (View, usize), b: View) {
    if a.cols == 0 {
        out.iter_mut()
            .for_each(|x| *x = if keep == 0.0 { 0.0 } else { keep * *x });
        return;
    }
    let rows = out.len() / b.cols;
    // Every index that gemm may touch lies inside the slices: checked here, not trusted.
    assert!((first + rows - 1) * a.strides[0] + (a.cols - 1) * a.strides[1] < a.data.len());
    assert!((b.rows - 1) * b.strides[0] + (b.cols - 1) * b.strides[1] < b.data.len());
    let lhs = &a.data[first * a.strides[0]..];
    // SAFETY: `out` holds rows × b.cols numbers at strides (b.cols, 1) and is borrowed alone; the
    // asserts above bound the farthest element of both operands; no stride exceeds isize.
    unsafe {
        gemm::gemm(
            rows,
            b.cols,
            a.cols,
            out.as_mut_ptr(),
            1,
            b.cols as isize,
            keep != 0.0,
            lhs.as_ptr(),
            a.strides[1] as isize,
            a.strides[0] as isize,
            b.data.as_ptr(),
            b.strides[1] as isize,
            b.strides[0] as isize,
            keep,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::Noise;

    /// The safe twin.
    fn plainly(out: &mut [f32], keep: f32, a: View, b: View) {
        for i in 0..a.rows {
            for j in 0..b.cols {
                let sum: f64 = (0..a.cols)
                    .map(|k| f64::from(a.at(i, k)) * f64::from(b.at(k, j)))
                    .sum();
                let old = if keep == 0.0 {
                    0.0
                } else {
                    keep * out[i * b.cols + j]
                };
                out[i * b.cols + j] = old + sum as f32;
            }
        }
    }

    #[test]
    fn products_of_all_layouts_and_sizes_are_those_of_plain_loops() {
        let mut noise = Noise::new(1);
        for (m, k, n) in [
            (1, 1, 1),
            (3, 0, 2),
            (5, 7, 4),
            (64, 31, 16),
            (1100, 9, 16),
            (16, 700, 33),
        ] {
            let a = noise.normals(m * k);
            let b = noise.normals(k * n);
            for (ta, tb) in [(false, false), (true, false), (false, true), (true, true)] {
                let va = if ta {
                    View::new(&a, k, m).transposed()
                } else {
                    View::new(&a, m, k)
                };
                let vb = if tb {
                    View::new(&b, n, k).transposed()
                } else {
                    View::new(&b, k, n)
                };
                for keep in [0.0, 1.0, -0.5] {
                    let start = noise.normals(m * n);
                    let (mut got, mut want) = (start.clone(), start);
                    multiply(&mut got, keep, va, vb);
                    plainly(&mut want, keep, va, vb);
                    for (g, w) in got.iter().zip(&want) {
                        assert!((g - w).abs() < 2e-4, "{m} {k} {n}: {g} {w}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_stood_in_the_output_does_not_matter_when_nothing_is_kept() {
        let mut out = [f32::NAN; 4];
        let eye = [1.0, 0.0, 0.0, 1.0];
        multiply(&mut out, 0.0, View::new(&eye, 2, 2), View::new(&eye, 2, 2));
        assert_eq!(out, eye);
    }

    #[test]
    fn the_number_of_threads_does_not_show() {
        let mut noise = Noise::new(2);
        let (a, b) = (noise.normals(3000 * 40), noise.normals(40 * 16));
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut out = vec![0.0; 3000 * 16];
            pool.expect("threads").install(|| {
                multiply(
                    &mut out,
                    0.0,
                    View::new(&a, 3000, 40),
                    View::new(&b, 40, 16),
                );
            });
            out
        };
        assert_eq!(run(1), run(3));
    }
}
