//! Depthwise convolution: every channel by itself, sixteen side by side.
//!
//! Sixteen channels of some rows are copied into a small image of their own, with zeros around
//! them. It stays in the nearest caches, has no edges to look out for, and four neighbouring
//! outputs share what is read from it.

use super::conv::Walk;
use super::hold;
use crate::room::Room;
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

/// Convolves every channel of `image` into `out`; `room` is overwritten.
pub(crate) fn depthwise(
    (walk, taps): (&Walk, &Taps),
    image: &[f32],
    room: &mut Room,
    out: &mut [f32],
) {
    fastest(Depthwise {
        walk,
        taps,
        image,
        room,
        out,
    });
}

struct Depthwise<'a> {
    walk: &'a Walk,
    taps: &'a Taps,
    image: &'a [f32],
    room: &'a mut Room,
    out: &'a mut [f32],
}

/// Most bytes of the small image: a fraction of a usual second-level cache.
const BAND_BYTES: usize = 64 << 10;
/// Outputs worked side by side.
const SIDE: usize = 4;

impl Kernel for Depthwise<'_> {
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        match (self.walk.size, self.walk.stride) {
            ([3, 3], [1, 1]) => self.blocks::<3, 6, L>(),
            ([3, 3], [2, 2]) => self.blocks::<3, 9, L>(),
            ([5, 5], [1, 1]) => self.blocks::<5, 8, L>(),
            ([5, 5], [2, 2]) => self.blocks::<5, 11, L>(),
            _ => self.thin(0),
        }
    }
}

/// `P` times eight channels, from `c` on.
#[derive(Clone, Copy)]
struct Block<const P: usize> {
    c: usize,
}

impl Depthwise<'_> {
    /// Windows of `K × K`; `SIDE` of them side by side cover `J` columns.
    #[inline(always)]
    fn blocks<const K: usize, const J: usize, L: Lanes>(&mut self) {
        let n = self.walk.image[2];
        let pairs = n / (2 * N_LANES);
        let rest = pairs * 2 * N_LANES;
        self.several::<2, K, J, L>((0..rest).step_by(2 * N_LANES));
        self.several::<1, K, J, L>((rest..n / N_LANES * N_LANES).step_by(N_LANES));
        self.thin(n / N_LANES * N_LANES);
    }

    /// Blocks of `P` times eight channels; `firsts` are their first channels.
    #[inline(always)]
    fn several<const P: usize, const K: usize, const J: usize, L: Lanes>(
        &mut self,
        firsts: impl Iterator<Item = usize>,
    ) {
        let walk = self.walk;
        let stride = (J - K) / (SIDE - 1);
        let line = ((walk.out[1].max(SIDE) - 1) * stride + K) * P * N_LANES;
        let rows = BAND_BYTES / (4 * line * stride);
        let rows = rows.saturating_sub(K).clamp(1, walk.out[0]);
        let small = ((rows - 1) * stride + K) * line;
        self.room.fit(small);
        self.room.head_mut(small).fill(0.0);
        for c in firsts {
            self.block::<P, K, J, L>(Block { c }, (rows, line));
        }
    }

    /// A block, `rows` of the output at a time; `line` values are in a row of the small image.
    #[inline(always)]
    fn block<const P: usize, const K: usize, const J: usize, L: Lanes>(
        &mut self,
        block: Block<P>,
        (rows, line): (usize, usize),
    ) {
        let Self { walk, taps, .. } = *self;
        let n = walk.image[2];
        let stride = (J - K) / (SIDE - 1);
        let mut weights = [[[0.0; 2 * N_LANES]; K]; K];
        let each = taps.weights.chunks_exact(n);
        for (to, from) in weights.as_flattened_mut().iter_mut().zip(each) {
            to[..P * N_LANES].copy_from_slice(&from[block.c..][..P * N_LANES]);
        }
        for from in (0..walk.out[0]).step_by(rows) {
            let to = (from + rows).min(walk.out[0]);
            let taken = (to - from - 1) * stride + K;
            self.take::<P, L>(block, (from * stride, line), taken);
            for oy in from..to {
                let band = Band {
                    small: &self.room.head(taken * line)[(oy - from) * stride * line..],
                    line,
                    weights: weights.as_flattened().as_flattened(),
                };
                let row = walk.out[1] * n;
                band.row::<P, K, J, L>((walk, taps), block, &mut self.out[oy * row..][..row]);
            }
        }
    }

    /// Fills the small image with `count` rows of the padded one, from row `first` on.
    #[inline(always)]
    fn take<const P: usize, L: Lanes>(
        &mut self,
        block: Block<P>,
        (first, line): (usize, usize),
        count: usize,
    ) {
        let [height, width, n] = self.walk.image;
        let [above, left] = self.walk.before;
        let columns = width.min((line / (P * N_LANES)).saturating_sub(left));
        let small = self.room.head_mut(count * line);
        for (i, to) in small.chunks_exact_mut(line).enumerate() {
            let to = &mut to[left * P * N_LANES..][..columns * P * N_LANES];
            match (first + i).checked_sub(above).filter(|&y| y < height) {
                Some(y) => {
                    let pixels = self.image[y * width * n..][..width * n].chunks_exact(n);
                    for (to, from) in to.chunks_exact_mut(P * N_LANES).zip(pixels) {
                        to.copy_from_slice(&from[block.c..][..P * N_LANES]);
                    }
                }
                None => to.fill(0.0),
            }
        }
    }

    /// Channels from `first` on, one by one.
    fn thin(&mut self, first: usize) {
        let Self {
            walk, taps, image, ..
        } = *self;
        let n = walk.image[2];
        for (i, out) in self.out.chunks_exact_mut(n).enumerate() {
            let (oy, ox) = (i / walk.out[1], i % walk.out[1]);
            for c in first..n {
                out[c] = one(walk, taps, image, [oy, ox, c]);
            }
        }
    }
}

/// The small image from the first row under a row of windows on.
struct Band<'a> {
    small: &'a [f32],
    /// Values in one of its rows.
    line: usize,
    /// Sixteen for every step of the window.
    weights: &'a [f32],
}

impl Band<'_> {
    #[inline(always)]
    fn row<const P: usize, const K: usize, const J: usize, L: Lanes>(
        &self,
        (walk, taps): (&Walk, &Taps),
        Block { c }: Block<P>,
        out: &mut [f32],
    ) {
        let n = walk.image[2];
        let [low, high] = [L::splat(taps.limits[0]), L::splat(taps.limits[1])];
        let bias = L::load_every::<P>(&taps.bias, c, N_LANES);
        let last = walk.out[1].saturating_sub(SIDE);
        for ox in (0..walk.out[1]).step_by(SIDE) {
            // The last ones may be worked twice.
            let ox = ox.min(last);
            let sum = self.four::<P, K, J, L>(ox, bias);
            for i in 0..SIDE.min(walk.out[1]) {
                let out = &mut out[(ox + i) * n + c..][..P * N_LANES];
                for (p, out) in out.as_chunks_mut().0.iter_mut().enumerate() {
                    sum[i][p].hold(low, high).store(out);
                }
            }
        }
    }

    /// Four sums from column `ox` on.
    #[inline(always)]
    fn four<const P: usize, const K: usize, const J: usize, L: Lanes>(
        &self,
        ox: usize,
        bias: [L; P],
    ) -> [[L; P]; SIDE] {
        let stride = (J - K) / (SIDE - 1);
        let mut sum = [bias; SIDE];
        for ky in 0..K {
            for p in 0..P {
                let at = ky * self.line + ox * stride * P * N_LANES + p * N_LANES;
                let pixels = L::load_every::<J>(self.small, at, P * N_LANES);
                let at = ky * K * 2 * N_LANES + p * N_LANES;
                let w = L::load_every::<K>(self.weights, at, 2 * N_LANES);
                for kx in 0..K {
                    for i in 0..SIDE {
                        sum[i][p] = sum[i][p].plus_product(pixels[i * stride + kx], w[kx]);
                    }
                }
            }
        }
        sum
    }
}

/// One output of one channel.
fn one(walk: &Walk, taps: &Taps, image: &[f32], [oy, ox, c]: [usize; 3]) -> f32 {
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
            depthwise((&walk, &taps), &image, &mut Room::default(), &mut out);
            assert_close(&out, &naive(&walk, &taps, &image), 1e-5);
            let mut twin = out.clone();
            plain(Depthwise {
                walk: &walk,
                taps: &taps,
                image: &image,
                room: &mut Room::default(),
                out: &mut twin,
            });
            assert_close(&out, &twin, 1e-5);
        }
    }
}
