//! Layers as they are played: one pose at a time, in room taken beforehand.

use muslin_net::learn::{Gru, Linear, Mlp, Nonlinear};
use pulp::Simd;

use crate::blocks::{WIDE, Wide};
use crate::decode::at;

/// Sums of so many are on their way at once, so that none waits for the one before.
const SIDE: usize = 4;

/// `y = W x + b`.
#[derive(Clone, Debug)]
pub(crate) struct Dense {
    inputs: usize,
    pub bias: Vec<f32>,
    /// In the order in which they are read: of [`SIDE`] blocks of [`WIDE`] outputs by input, and so of all such
    /// blocks; then of every block that is left, the last of which is filled up with nothing, by input.
    weights: Vec<Wide>,
}

impl Dense {
    pub fn new(l: Linear, params: &[f32]) -> Self {
        let (w, b) = params.split_at(l.inputs * l.outputs);
        let block = |first: usize, i: usize| {
            let of = |o: usize| {
                if o < l.outputs {
                    w[o * l.inputs + i]
                } else {
                    0.0
                }
            };
            Wide(std::array::from_fn(|k| of(first + k)))
        };
        let together = l.outputs / (SIDE * WIDE) * SIDE * WIDE;
        let lots = (0..together).step_by(SIDE * WIDE).flat_map(|lot| {
            (0..l.inputs).flat_map(move |i| (0..SIDE).map(move |k| (lot + k * WIDE, i)))
        });
        let rest = (together..l.outputs)
            .step_by(WIDE)
            .flat_map(|first| (0..l.inputs).map(move |i| (first, i)));
        Self {
            inputs: l.inputs,
            weights: lots.chain(rest).map(|(first, i)| block(first, i)).collect(),
            bias: match b.is_empty() {
                true => vec![0.0; l.outputs],
                false => b.to_vec(),
            },
        }
    }

    /// Of so many numbers: the rows of `W`, then `b`.
    pub fn of(inputs: usize, outputs: usize, params: &[f32]) -> Self {
        Self::new(
            Linear {
                inputs,
                outputs,
                bias: true,
            },
            params,
        )
    }

    pub fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// # Panics
    /// Where `x` or `out` is of another length.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, on: S, x: &[f32], out: &mut [f32]) {
        assert_eq!((x.len(), out.len()), (self.inputs, self.bias.len()));
        out.copy_from_slice(&self.bias);
        if x.is_empty() {
            return;
        }
        let (lots, rest) = out.as_chunks_mut::<{ SIDE * WIDE }>();
        let (wide, narrow) = self.weights.split_at(lots.len() * SIDE * x.len());
        for (out, w) in lots.iter_mut().zip(wide.chunks_exact(SIDE * x.len())) {
            for r in 0..WIDE / S::F32_LANES {
                let mut sums = [on.splat_f32s(0.0); SIDE];
                for (x, w) in x.iter().zip(w.as_chunks::<SIDE>().0) {
                    let x = on.splat_f32s(*x);
                    for (sum, w) in sums.iter_mut().zip(w) {
                        *sum = on.mul_add_e_f32s(x, at::<S>(w, r), *sum);
                    }
                }
                for (out, sum) in out.as_chunks_mut::<WIDE>().0.iter_mut().zip(sums) {
                    let out = &mut S::as_mut_simd_f32s(out).0[r];
                    *out = on.add_f32s(*out, sum);
                }
            }
        }
        for (out, w) in rest.chunks_mut(WIDE).zip(narrow.chunks_exact(x.len())) {
            let ((x, last), (w, w_last)) = (x.as_chunks::<SIDE>(), w.as_chunks::<SIDE>());
            let mut whole = Wide::default();
            for r in 0..WIDE / S::F32_LANES {
                let mut sums = [on.splat_f32s(0.0); SIDE];
                for (x, w) in x.iter().zip(w) {
                    for (sum, (x, w)) in sums.iter_mut().zip(x.iter().zip(w)) {
                        *sum = on.mul_add_e_f32s(on.splat_f32s(*x), at::<S>(w, r), *sum);
                    }
                }
                for (x, w) in last.iter().zip(w_last) {
                    sums[0] = on.mul_add_e_f32s(on.splat_f32s(*x), at::<S>(w, r), sums[0]);
                }
                let [a, b, c, d] = sums;
                S::as_mut_simd_f32s(&mut whole.0).0[r] =
                    on.add_f32s(on.add_f32s(a, b), on.add_f32s(c, d));
            }
            out.iter_mut().zip(&whole.0).for_each(|(y, s)| *y += s);
        }
    }

    /// `W`, by input, then output.
    #[cfg(any(test, feature = "cuda"))]
    pub fn by_input(&self) -> impl Iterator<Item = f32> {
        let (inputs, outputs) = (self.inputs, self.outputs());
        let together = outputs / (SIDE * WIDE) * SIDE;
        let of = move |i: usize, o: usize| {
            let (block, lane) = (o / WIDE, o % WIDE);
            let place = match block < together {
                true => (block / SIDE * inputs + i) * SIDE + block % SIDE,
                false => block * inputs + i,
            };
            self.weights[place].0[lane]
        };
        (0..inputs).flat_map(move |i| (0..outputs).map(move |o| of(i, o)))
    }
}

/// A perceptron, with room for what passes through it.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    pub layers: Vec<Dense>,
    pub bend: Nonlinear,
    /// Whether the last layer is bent as well.
    pub bends_last: bool,
    room: [Vec<f32>; 2],
}

impl Chain {
    pub fn new(mlp: &Mlp, params: &[f32], bends_last: bool) -> Self {
        let mut rest = params;
        let one = |l: Linear| {
            let (own, later) = rest.split_at(l.n_params());
            rest = later;
            Dense::new(l, own)
        };
        let widest = mlp.widths.iter().copied().max().unwrap_or(0);
        Self {
            layers: mlp.layers().map(one).collect(),
            bend: mlp.bend,
            bends_last,
            room: [vec![0.0; widest], vec![0.0; widest]],
        }
    }

    /// How many numbers it gives.
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, Dense::outputs)
    }

    #[inline(always)]
    pub fn run<S: Simd>(&mut self, on: S, x: &[f32]) -> &[f32] {
        let last = self.layers.len() - 1;
        let [from, to] = &mut self.room;
        from[..x.len()].copy_from_slice(x);
        let mut n = x.len();
        for (k, layer) in self.layers.iter().enumerate() {
            let out = &mut to[..layer.outputs()];
            layer.apply(on, &from[..n], out);
            n = out.len();
            match k < last || self.bends_last {
                true => self.bend.forward(out, &mut from[..n]),
                false => from[..n].copy_from_slice(out),
            }
        }
        &from[..n]
    }
}

/// A recurrent layer with its state.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    outer: Dense,
    inner: Dense,
    pub state: Vec<f32>,
    room: [Vec<f32>; 2],
}

impl Cell {
    pub fn new(gru: &Gru, params: &[f32]) -> Self {
        let rows = 3 * gru.size;
        let (w, rest) = params.split_at(rows * gru.inputs);
        let (u, rest) = rest.split_at(rows * gru.size);
        let (b, c) = rest.split_at(rest.len() / 2);
        let dense = |inputs: usize, w: &[f32], b: &[f32]| {
            let layer = Linear {
                inputs,
                outputs: rows,
                bias: gru.bias,
            };
            Dense::new(layer, &[w, b].concat())
        };
        Self {
            outer: dense(gru.inputs, w, b),
            inner: dense(gru.size, u, c),
            state: vec![0.0; gru.size],
            room: [vec![0.0; rows], vec![0.0; rows]],
        }
    }

    /// The next state: [`Gru`]'s formula.
    #[inline(always)]
    pub fn step<S: Simd>(&mut self, on: S, x: &[f32]) {
        let [outer, inner] = &mut self.room;
        self.outer.apply(on, x, outer);
        self.inner.apply(on, &self.state, inner);
        let n = self.state.len();
        let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
        for (i, h) in self.state.iter_mut().enumerate() {
            let r = sigmoid(outer[i] + inner[i]);
            let z = sigmoid(outer[n + i] + inner[n + i]);
            let new = (outer[2 * n + i] + r * inner[2 * n + i]).tanh();
            *h = (1.0 - z) * new + z * *h;
        }
    }
}

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;

    /// Whether a layer of that size gives what its rows and bias say, and tells its weights by input.
    fn agrees<S: Simd>(on: S, inputs: usize, outputs: usize) -> bool {
        let mut noise = Noise::new((inputs * 1000 + outputs) as u64);
        let params = noise.normals(inputs * outputs + outputs);
        let x = noise.normals(inputs);
        let (w, b) = params.split_at(inputs * outputs);
        let layer = Dense::of(inputs, outputs, &params);
        let mut out = vec![f32::NAN; outputs];
        layer.apply(on, &x, &mut out);
        let close = (0..outputs).all(|o| {
            let row = w[o * inputs..][..inputs].iter().zip(&x);
            let exact = f64::from(b[o]) + row.map(|(w, x)| f64::from(w * x)).sum::<f64>();
            (f64::from(out[o]) - exact).abs() < 1e-5 * (1 + inputs) as f64
        });
        let told = (layer.by_input().enumerate())
            .all(|(k, told)| told == w[k % outputs * inputs + k / outputs]);
        close && told && layer.by_input().count() == w.len()
    }

    #[test]
    fn layers_of_all_sizes_give_what_their_rows_say() {
        for inputs in [0, 1, 3, 4, 64, 111] {
            for outputs in [1, 15, 16, 17, 63, 64, 65, 128, 150, 209] {
                assert!(
                    agrees(pulp::Scalar::new(), inputs, outputs),
                    "{inputs} {outputs}"
                );
                #[cfg(target_arch = "x86_64")]
                if let Some(v3) = pulp::x86::V3::try_new() {
                    assert!(agrees(v3, inputs, outputs), "{inputs} {outputs}");
                }
            }
        }
    }
}
