//! General convolution: every window is a row of one product per output row.
//!
//! Windows inside the image are read where they lie; those that leave it are laid out first.

use std::ops::Range;

use super::Finish;
use super::matmul::{Packed, Rows, multiply};

/// How a window walks, with everything counted out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Walk {
    /// Rows, columns and channels of the image.
    pub image: [usize; 3],
    /// Rows and columns of the output.
    pub out: [usize; 2],
    /// Rows and columns of the window.
    pub size: [usize; 2],
    /// Steps down and right.
    pub stride: [usize; 2],
    /// Zeros above and to the left.
    pub before: [usize; 2],
}

impl Walk {
    /// Whether every window is one pixel and every pixel has one.
    pub(crate) fn is_pointwise(&self) -> bool {
        self.size == [1, 1] && self.stride == [1, 1] && self.out[..] == self.image[..2]
    }

    /// The output rows or columns (`axis` 0 or 1) whose windows stay within the image.
    fn inside(&self, axis: usize) -> Range<usize> {
        let start = self.before[axis].div_ceil(self.stride[axis]);
        let end = (self.image[axis] + self.before[axis])
            .checked_sub(self.size[axis])
            .map_or(0, |room| room / self.stride[axis] + 1)
            .min(self.out[axis]);
        start.min(end)..end
    }

    /// The image row or column (`axis` 0 or 1) under step `i` of window `o`, if it is inside.
    #[inline(always)]
    pub(crate) fn source(&self, axis: usize, o: usize, i: usize) -> Option<usize> {
        (o * self.stride[axis] + i)
            .checked_sub(self.before[axis])
            .filter(|&s| s < self.image[axis])
    }
}

/// Convolves `image`; `windows` is room for one row of windows and is overwritten.
///
/// The weights' rows are `[kh, kw, channels]`.
pub(crate) fn conv(
    (walk, w): (&Walk, &Packed),
    image: &[f32],
    windows: &mut Vec<f32>,
    (finish, out): (Finish<'_>, &mut [f32]),
) {
    if walk.is_pointwise() {
        return multiply(w, Rows::plain(image, w.k()), finish, out);
    }
    let n = walk.out[1] * w.n();
    windows.resize(walk.out[1] * w.k(), 0.0);
    let [rows, columns] = [walk.inside(0), walk.inside(1)];
    for (oy, out) in out.chunks_exact_mut(n).enumerate() {
        let plus = finish.plus.map(|p| &p[oy * n..][..n]);
        let inner = if rows.contains(&oy) {
            columns.clone()
        } else {
            0..0
        };
        let mut part = |columns: Range<usize>, rows: Rows<'_>| {
            let of = columns.start * w.n()..columns.end * w.n();
            let plus = plus.map(|p| &p[of.clone()]);
            multiply(w, rows, Finish { plus, ..finish }, &mut out[of]);
        };
        for outer in [0..inner.start, inner.end..walk.out[1]] {
            gather(walk, image, (oy, outer.clone()), windows);
            part(outer, Rows::plain(windows, w.k()));
        }
        if !inner.is_empty() {
            part(inner.clone(), in_place(walk, image, oy, inner.start));
        }
    }
}

/// The windows of output row `oy` from column `ox` on, all inside the image.
fn in_place<'a>(walk: &Walk, image: &'a [f32], oy: usize, ox: usize) -> Rows<'a> {
    let [_, width, c] = walk.image;
    let [y, x] = [(oy, 0), (ox, 1)].map(|(o, axis)| o * walk.stride[axis] - walk.before[axis]);
    Rows {
        from: &image[(y * width + x) * c..],
        step: walk.stride[1] * c,
        pieces: walk.size[0],
        jump: width * c,
        len: walk.size[1] * c,
    }
}

/// Lays out windows of output row `oy`, zeros where they leave the image.
fn gather(walk: &Walk, image: &[f32], (oy, columns): (usize, Range<usize>), windows: &mut [f32]) {
    let [_, width, c] = walk.image;
    let [kh, kw] = walk.size;
    for (ox, window) in columns.zip(windows.chunks_exact_mut(kh * kw * c)) {
        for (ky, row) in window.chunks_exact_mut(kw * c).enumerate() {
            let y = walk.source(0, oy, ky);
            for (kx, pixel) in row.chunks_exact_mut(c).enumerate() {
                match (y, walk.source(1, ox, kx)) {
                    (Some(y), Some(x)) => pixel.copy_from_slice(&image[(y * width + x) * c..][..c]),
                    _ => pixel.fill(0.0),
                }
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::kernels::noise::{assert_close, values};

    /// Walks that meet every edge: strides, uneven padding, one pixel, no padding.
    pub(crate) fn walks(c: usize) -> [Walk; 5] {
        let walk = |hw: [usize; 2], out, size, stride, before| Walk {
            image: [hw[0], hw[1], c],
            out,
            size,
            stride,
            before,
        };
        [
            walk([5, 7], [5, 7], [3, 3], [1, 1], [1, 1]),
            walk([6, 9], [3, 5], [5, 5], [2, 2], [1, 2]),
            walk([4, 4], [1, 1], [4, 4], [1, 1], [0, 0]),
            walk([3, 2], [3, 2], [1, 1], [1, 1], [0, 0]),
            walk([3, 20], [2, 20], [2, 5], [1, 1], [0, 2]),
        ]
    }

    /// Convolution as its definition reads; `w` is `[n, kh, kw, c]`.
    fn naive(walk: &Walk, image: &[f32], w: &[f32], bias: &[f32]) -> Vec<f32> {
        let [_, width, c] = walk.image;
        let [kh, kw] = walk.size;
        let mut out = Vec::new();
        for (oy, ox, n) in every(walk.out, bias.len()) {
            let mut sum = bias[n];
            for (ky, kx, i) in every([kh, kw], c) {
                if let (Some(y), Some(x)) = (walk.source(0, oy, ky), walk.source(1, ox, kx)) {
                    sum += image[(y * width + x) * c + i] * w[((n * kh + ky) * kw + kx) * c + i];
                }
            }
            out.push(sum);
        }
        out
    }

    /// All rows, columns and channels in order.
    pub(crate) fn every(hw: [usize; 2], c: usize) -> impl Iterator<Item = (usize, usize, usize)> {
        (0..hw[0] * hw[1] * c).map(move |i| (i / c / hw[1], i / c % hw[1], i % c))
    }

    #[test]
    fn every_edge_agrees_with_the_definition() {
        for (walk, n) in walks(3).into_iter().zip([4, 9, 1, 20, 8]) {
            let k = walk.size[0] * walk.size[1] * 3;
            let image = values(walk.image.iter().product(), 1);
            let (w, b) = (values(n * k, 2), values(n, 3));
            let mut out = vec![f32::NAN; walk.out[0] * walk.out[1] * n];
            let finish = Finish {
                limits: [f32::NEG_INFINITY, f32::INFINITY],
                plus: None,
            };
            conv(
                (&walk, &Packed::new(&w, &b)),
                &image,
                &mut vec![f32::NAN; 3],
                (finish, &mut out),
            );
            assert_close(&out, &naive(&walk, &image, &w, &b), 1e-5);
        }
    }
}
