//! Depthwise convolution: every channel by itself, sixteen side by side.
//!
//! Four neighbouring outputs share every weight that is read. Windows that leave the image are
//! worked one at a time.

use std::ops::Range;

use super::conv::Walk;
use super::hold;
use crate::simd::{Kernel, Lanes, N_LANES, fastest};

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
    fastest(Depthwise {
        walk,
        taps,
        image,
        out,
    });
}

struct Depthwise<'a> {
    walk: &'a Walk,
    taps: &'a Taps,
    image: &'a [f32],
    out: &'a mut [f32],
}

impl Kernel for Depthwise<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self {
            walk,
            taps,
            image,
            out,
        } = self;
        let row = walk.out[1] * walk.image[2];
        let inside = inside(walk);
        for (oy, out) in out.chunks_exact_mut(row).enumerate() {
            let line = Line {
                walk,
                taps,
                image,
                oy,
            };
            let mut ox = 0;
            while ox < walk.out[1] {
                if ox >= inside.start && ox + 4 <= inside.end {
                    line.channels::<4, L>(ox, out);
                    ox += 4;
                } else {
                    line.channels::<1, L>(ox, out);
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
    let end = (width + before)
        .checked_sub(size)
        .map_or(0, |room| room / stride + 1);
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
    fn channels<const W: usize, L: Lanes>(&self, ox: usize, out: &mut [f32]) {
        let n = self.walk.image[2];
        let mut c = 0;
        while c + 2 * N_LANES <= n {
            self.chunk::<W, 2, L>(ox, c, out);
            c += 2 * N_LANES;
        }
        if c + N_LANES <= n {
            self.chunk::<W, 1, L>(ox, c, out);
            c += N_LANES;
        }
        for i in 0..W {
            for c in c..n {
                out[(ox + i) * n + c] = self.one(ox + i, c);
            }
        }
    }

    /// `W` outputs of `P` times eight channels from column `ox` and channel `c`.
    #[inline(always)]
    fn chunk<const W: usize, const P: usize, L: Lanes>(
        &self,
        ox: usize,
        c: usize,
        out: &mut [f32],
    ) {
        let Self {
            walk,
            taps,
            image,
            oy,
        } = *self;
        let [_, width, n] = walk.image;
        let mut sum = [lanes::<P, L>(&taps.bias, c); W];
        for ky in 0..walk.size[0] {
            let Some(y) = walk.source(0, oy, ky) else {
                continue;
            };
            let row = &image[y * width * n..][..width * n];
            let weights = &taps.weights[ky * walk.size[1] * n..];
            for kx in 0..walk.size[1] {
                let Some(x) = walk.source(1, ox, kx) else {
                    continue;
                };
                let w = lanes::<P, L>(weights, kx * n + c);
                for i in 0..W {
                    let pixel = lanes::<P, L>(row, (x + i * walk.stride[1]) * n + c);
                    for p in 0..P {
                        sum[i][p] = sum[i][p].plus_product(pixel[p], w[p]);
                    }
                }
            }
        }
        let [low, high] = taps.limits.map(L::splat);
        for i in 0..W {
            for p in 0..P {
                let at = (ox + i) * n + c + p * N_LANES;
                let out = out[at..]
                    .first_chunk_mut()
                    .expect("the row holds all channels");
                sum[i][p].hold(low, high).store(out);
            }
        }
    }

    /// One output of one channel.
    fn one(&self, ox: usize, c: usize) -> f32 {
        let Self {
            walk,
            taps,
            image,
            oy,
        } = *self;
        let [_, width, n] = walk.image;
        let mut sum = taps.bias[c];
        for ky in 0..walk.size[0] {
            for kx in 0..walk.size[1] {
                if let (Some(y), Some(x)) = (walk.source(0, oy, ky), walk.source(1, ox, kx)) {
                    let w = taps.weights[(ky * walk.size[1] + kx) * n + c];
                    sum += image[(y * width + x) * n + c] * w;
                }
            }
        }
        hold(sum, taps.limits)
    }
}

/// `P` times eight neighbours.
#[inline(always)]
fn lanes<const P: usize, L: Lanes>(x: &[f32], at: usize) -> [L; P] {
    let x = &x[at..at + P * N_LANES];
    std::array::from_fn(|p| {
        L::load(
            x[p * N_LANES..]
                .first_chunk()
                .expect("cut to whole lanes above"),
        )
    })
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
                    sum += image[(y * width + x) * c + i]
                        * taps.weights[(ky * walk.size[1] + kx) * c + i];
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
            let taps = Taps {
                weights,
                bias: values(c, 2),
                limits: [0.0, 6.0],
            };
            let image = values(walk.image.iter().product(), 3);
            let mut out = vec![f32::NAN; walk.out[0] * walk.out[1] * c];
            depthwise(&walk, &taps, &image, &mut out);
            assert_close(&out, &naive(&walk, &taps, &image), 1e-5);
            let mut twin = out.clone();
            plain(Depthwise {
                walk: &walk,
                taps: &taps,
                image: &image,
                out: &mut twin,
            });
            assert_close(&out, &twin, 1e-5);
        }
    }
}
