//! Everything that moves or changes values one by one.

use super::conv::Walk;
use super::hold;

/// The sum of two lists, held between limits.
pub(crate) fn add(a: &[f32], b: &[f32], limits: [f32; 2], out: &mut [f32]) {
    for ((o, x), y) in out.iter_mut().zip(a).zip(b) {
        *o = hold(x + y, limits);
    }
}

/// `1 / (1 + e^-x)`.
pub(crate) fn logistic(x: &[f32], out: &mut [f32]) {
    for (o, x) in out.iter_mut().zip(x) {
        *o = 1.0 / (1.0 + (-x).exp());
    }
}

/// Negative values times their channel's slope.
pub(crate) fn prelu(x: &[f32], slopes: &[f32], out: &mut [f32]) {
    let c = slopes.len();
    for (o, x) in out.chunks_exact_mut(c).zip(x.chunks_exact(c)) {
        for ((o, &x), s) in o.iter_mut().zip(x).zip(slopes) {
            *o = if x < 0.0 { x * s } else { x };
        }
    }
}

/// An image `[h, w, c]` inside zeros: `before[i]` of them ahead of rows, columns, channels.
///
/// `shape` and `padded` are the three sizes without and with the zeros.
pub(crate) fn pad(
    x: &[f32],
    shape: [usize; 3],
    (before, padded): ([usize; 3], [usize; 3]),
    out: &mut [f32],
) {
    out.fill(0.0);
    let [_, w, c] = shape;
    for (i, pixel) in x.chunks_exact(c).enumerate() {
        let (y, x) = (i / w + before[0], i % w + before[1]);
        let at = (y * padded[1] + x) * padded[2] + before[2];
        out[at..at + c].copy_from_slice(pixel);
    }
}

/// The largest value under every window; a window wholly outside gives negative infinity.
pub(crate) fn max_pool(walk: &Walk, image: &[f32], out: &mut [f32]) {
    let [_, width, c] = walk.image;
    out.fill(f32::NEG_INFINITY);
    for (i, out) in out.chunks_exact_mut(c).enumerate() {
        let (oy, ox) = (i / walk.out[1], i % walk.out[1]);
        for y in (0..walk.size[0]).filter_map(|k| walk.source(0, oy, k)) {
            for x in (0..walk.size[1]).filter_map(|k| walk.source(1, ox, k)) {
                let pixel = &image[(y * width + x) * c..][..c];
                out.iter_mut()
                    .zip(pixel)
                    .for_each(|(o, &p)| *o = if p > *o { p } else { *o });
            }
        }
    }
}

/// Blocks of channels become blocks of pixels; `shape` is the image's before.
pub(crate) fn depth_to_space(x: &[f32], [_, w, c]: [usize; 3], block: usize, out: &mut [f32]) {
    let run = c / block;
    for (i, pixel) in x.chunks_exact(c).enumerate() {
        for (b, run_of) in pixel.chunks_exact(run).enumerate() {
            let at = ((i / w * block + b) * w + i % w) * run;
            out[at..at + run].copy_from_slice(run_of);
        }
    }
}

/// Lists joined: of every part, `runs[i]` values at a time.
pub(crate) fn concat(parts: &[&[f32]], runs: &[usize], out: &mut [f32]) {
    let total: usize = runs.iter().sum();
    let mut from = 0;
    for (part, &run) in parts.iter().zip(runs).filter(|(_, run)| **run > 0) {
        for (out, values) in out.chunks_exact_mut(total).zip(part.chunks_exact(run)) {
            out[from..from + run].copy_from_slice(values);
        }
        from += run;
    }
}

/// Where an output row or column lies between two of the input: both, and the second's share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Between {
    low: usize,
    high: usize,
    share: f32,
}

/// For `out` samples of an axis of `n`, where each lies.
///
/// Corners on corners, half-pixel centres or plain scaling, as TensorFlow Lite defines them.
pub(crate) fn between(n: usize, out: usize, align: bool, half_pixel: bool) -> Vec<Between> {
    let scale = match align && out > 1 {
        true => (n - 1) as f32 / (out - 1) as f32,
        false => n as f32 / out as f32,
    };
    let one = |i: usize| {
        let at = if half_pixel {
            (i as f32 + 0.5) * scale - 0.5
        } else {
            i as f32 * scale
        };
        let at = at.clamp(0.0, (n - 1) as f32);
        let low = at as usize;
        Between {
            low,
            high: (low + 1).min(n - 1),
            share: at - low as f32,
        }
    };
    (0..out).map(one).collect()
}

/// Bilinear scaling of an image of `width` columns and `c` channels.
pub(crate) fn resize(
    image: &[f32],
    [width, c]: [usize; 2],
    (rows, cols): (&[Between], &[Between]),
    out: &mut [f32],
) {
    let line = |y: usize| &image[y * width * c..][..width * c];
    let mut mixed = vec![0.0; width * c];
    for (row, out) in rows.iter().zip(out.chunks_exact_mut(cols.len() * c)) {
        for ((m, a), b) in mixed.iter_mut().zip(line(row.low)).zip(line(row.high)) {
            *m = a + (b - a) * row.share;
        }
        for (col, out) in cols.iter().zip(out.chunks_exact_mut(c)) {
            let (a, b) = (&mixed[col.low * c..][..c], &mixed[col.high * c..][..c]);
            for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
                *o = a + (b - a) * col.share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::conv::tests::every;
    use crate::kernels::noise::{assert_close, values};

    #[test]
    fn value_by_value_kinds_do_what_their_names_say() {
        let mut out = [0.0; 4];
        add(
            &[1.0, -3.0, 5.0, 0.0],
            &[1.0, 1.0, 2.0, 0.5],
            [0.0, 6.0],
            &mut out,
        );
        assert_eq!(out, [2.0, 0.0, 6.0, 0.5]);
        logistic(&[0.0, 1.0, -1.0, 100.0], &mut out);
        assert_close(&out, &[0.5, 0.731_058_6, 0.268_941_43, 1.0], 1e-6);
        prelu(&[-2.0, -2.0, 2.0, 2.0], &[0.5, 0.1], &mut out);
        assert_close(&out, &[-1.0, -0.2, 2.0, 2.0], 1e-6);
    }

    #[test]
    fn padding_surrounds_the_image_with_zeros() {
        let mut out = [9.0; 24];
        pad(&[1.0, 2.0], [1, 2, 1], ([1, 1, 1], [2, 4, 3]), &mut out);
        let mut want = [0.0; 24];
        (want[16], want[19]) = (1.0, 2.0);
        assert_eq!(out, want);
    }

    #[test]
    fn pooling_takes_the_largest_inside_the_image() {
        let walk = Walk {
            image: [3, 3, 1],
            out: [2, 2],
            size: [2, 2],
            stride: [2, 2],
            before: [0, 0],
        };
        let image = [1.0, 5.0, -1.0, 2.0, 3.0, -4.0, -7.0, -8.0, -9.0];
        let mut out = [0.0; 4];
        max_pool(&walk, &image, &mut out);
        assert_eq!(out, [5.0, -1.0, -7.0, -9.0]);
    }

    #[test]
    fn depth_to_space_reads_blocks_row_by_row() {
        let (h, w, c, b) = (2, 3, 8, 2);
        let x = values(h * w * c, 1);
        let mut out = vec![0.0; x.len()];
        depth_to_space(&x, [h, w, c], b, &mut out);
        let n = c / (b * b);
        let from = |(y, col, i): (usize, usize, usize)| {
            x[(y / b * w + col / b) * c + (y % b * b + col % b) * n + i]
        };
        assert_eq!(out, every([h * b, w * b], n).map(from).collect::<Vec<_>>());
    }

    #[test]
    fn joining_keeps_every_part_in_order() {
        let mut out = [0.0; 6];
        concat(&[&[1.0, 2.0], &[3.0, 4.0, 5.0, 6.0]], &[1, 2], &mut out);
        assert_eq!(out, [1.0, 3.0, 4.0, 2.0, 5.0, 6.0]);
    }

    #[test]
    fn scaling_follows_all_three_conventions() {
        let x = [0.0, 1.0, 4.0];
        let to = |n, align, half| {
            let (rows, cols) = (between(1, 1, align, half), between(3, n, align, half));
            let mut out = vec![0.0; n];
            resize(&x, [3, 1], (&rows, &cols), &mut out);
            out
        };
        assert_close(&to(5, true, false), &[0.0, 0.5, 1.0, 2.5, 4.0], 1e-6);
        assert_close(&to(6, false, false), &[0.0, 0.5, 1.0, 2.5, 4.0, 4.0], 1e-6);
        assert_close(
            &to(6, false, true),
            &[0.0, 0.25, 0.75, 1.75, 3.25, 4.0],
            1e-6,
        );
    }
}
