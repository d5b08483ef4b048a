//! Depthwise convolution: every channel by itself, sixteen side by side.
//!
//! Four neighbouring outputs share every weight that is read. Windows that leave the image are
//! worked one at a time.

use std::ops::Range;

use super::conv::Walk;
use super::hold;
use crate::simd::{Kernel, fastest, madd};

/// Weights `[kh, kw, channels]` and bias `[channels]`.
pub(crate) struct Taps {
    /// One list of channels per step of the window.
    pub weights: Vec<f32>,
    /// One value per channel.
    pub bias: Vec<f32>,
    /// Least and greatest value stored.
    pub limits: [f32; 2],
}

/// Convolves every channel of `image` into `out`.
pub(crate) fn depthwise(walk: &Walk, taps: &Taps, image: &[f32], out: &mut [f32]) {
    fastest(Depthwise { walk, taps, image, out });
}

struct Depthwise<'a> {
    walk: &'a Walk,
    taps: &'a Taps,
    image: &'a [f32],
    out: &'a mut [f32],
}

impl Kernel for Depthwise<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { walk, taps, image, out } = self;
        let row = walk.out[1] * walk.image[2];
        let inside = inside(walk);
        for (oy, out) in out.chunks_exact_mut(row).enumerate() {
            let line = Line { walk, taps, image, oy };
            let mut ox = 0;
            while ox < walk.out[1] {
                if ox >= inside.start && ox + 4 <= inside.end {
                    line.channels::<4, FUSED>(ox, out);
                    ox += 4;
                } else {
                    line.channels::<1, FUSED>(ox, out);
                    ox += 1;
                }
            }
        }
    }
}

/// Output columns whose windows stay within the image's columns.
fn inside(walk: &Walk) -> Range<usize> {
    let [before, stride, size, width] =
        [walk.before[1], walk.stride[1], walk.size[1], walk.image[1]];
    let start = before.div_ceil(stride);
    let end = (width + before).checked_sub(size).map_or(0, |room| room / stride + 1);
    start..end.min(walk.out[1])
}

struct Line<'a> {
    walk: &'a Walk,
    taps: &'a Taps,
    image: &'a [f32],
    oy: usize,
}

impl Line<'_> {
    /// `W` outputs from column `ox`, all channels. Several at once must lie inside.
    #[inline(always)]
    fn channels<const W: usize, const FUSED: bool>(&self, ox: usize, out: &mut [f32]) {
        let n = self.walk.image[2];
        let mut c = 0;
        while c + 16 <= n {
            self.chunk::<W, 16, FUSED>(ox, c, out);
            c += 16;
        }
        while c + 8 <= n {
            self.chunk::<W, 8, FUSED>(ox, c, out);
            c += 8;
        }
        while c < n {
            self.chunk::<W, 1, FUSED>(ox, c, out);
            c += 1;
        }
    }

    /// `W` outputs of `C` channels from column `ox` and channel `c`.
    #[inline(always)]
    fn chunk<const W: usize, const C: usize, const FUSED: bool>(
        &self,
        ox: usize,
        c: usize,
        out: &mut [f32],
    ) {
        let Self { walk, taps, image, oy } = *self;
        let [_, width, n] = walk.image;
        let mut sum = [*block::<C>(&taps.bias, c); W];
        for ky in 0..walk.size[0] {
            let Some(y) = walk.source(0, oy, ky) else { continue };
            let row = &image[y * width * n..][..width * n];
            let weights = &taps.weights[ky * walk.size[1] * n..];
            for kx in 0..walk.size[1] {
                let Some(x) = walk.source(1, ox, kx) else { continue };
                let w = block::<C>(weights, kx * n + c);
                for i in 0..W {
                    let pixel = block::<C>(row, (x + i * walk.stride[1]) * n + c);
                    for j in 0..C {
                        sum[i][j] = madd::<FUSED>(pixel[j], w[j], sum[i][j]);
                    }
                }
            }
        }
        for i in 0..W {
            let held: [f32; C] = std::array::from_fn(|j| hold(sum[i][j], taps.limits));
            out[(ox + i) * n + c..][..C].copy_from_slice(&held);
        }
    }
}

#[inline(always)]
fn block<const C: usize>(x: &[f32], at: usize) -> &[f32; C] {
    x[at..].first_chunk().expect("shapes were checked when the net was made")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::conv::tests::{every, walks};
    use crate::kernels::noise::{assert_close, values};
    use crate::simd::plain;

    fn naive(walk: &Walk, taps: &Taps, image: &[f32]) -> Vec<f32> {
        let [_, width, c] = walk.image;
        let one = |(oy, ox, i): (usize, usize, usize)| {
            let mut sum = taps.bias[i];
            for (ky, kx, _) in every(walk.size, 1) {
                if let (Some(y), Some(x)) = (walk.source(0, oy, ky), walk.source(1, ox, kx)) {
                    sum += image[(y * width + x) * c + i] * taps.weights[(ky * walk.size[1] + kx) * c + i];
                }
            }
            sum.clamp(taps.limits[0], taps.limits[1])
        };
        every(walk.out, c).map(one).collect()
    }

    #[test]
    fn every_edge_and_channel_rest_agrees_with_the_definition() {
        for walk in [1, 8, 27, 40].into_iter().flat_map(walks) {
            let c = walk.image[2];
            let weights = values(walk.size[0] * walk.size[1] * c, 1);
            let taps = Taps { weights, bias: values(c, 2), limits: [0.0, 6.0] };
            let image = values(walk.image.iter().product(), 3);
            let mut out = vec![f32::NAN; walk.out[0] * walk.out[1] * c];
            depthwise(&walk, &taps, &image, &mut out);
            assert_close(&out, &naive(&walk, &taps, &image), 1e-5);
            let mut twin = out.clone();
            plain(Depthwise { walk: &walk, taps: &taps, image: &image, out: &mut twin });
            assert_close(&out, &twin, 1e-5);
        }
    }
}
