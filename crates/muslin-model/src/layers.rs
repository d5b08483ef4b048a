//! Layers as they are played: one pose at a time, in room taken beforehand.

use muslin_net::learn::{Gru, Linear, Mlp, Nonlinear};

/// `y = W x + b`.
#[derive(Clone, Debug)]
pub(crate) struct Dense {
    /// By input, then output.
    pub weights: Vec<f32>,
    pub bias: Vec<f32>,
}

impl Dense {
    pub fn new(l: Linear, params: &[f32]) -> Self {
        let (w, b) = params.split_at(l.inputs * l.outputs);
        let by_input = (0..l.inputs * l.outputs).map(|k| {
            let (i, o) = (k / l.outputs, k % l.outputs);
            w[o * l.inputs + i]
        });
        Self {
            weights: by_input.collect(),
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

    #[inline(always)]
    pub fn apply(&self, x: &[f32], out: &mut [f32]) {
        out.copy_from_slice(&self.bias);
        for (lot, rows) in x.chunks(4).zip(self.weights.chunks(4 * out.len())) {
            gather(out, lot, rows);
        }
    }
}

/// Adds up to four inputs, each times its row of weights.
#[inline(always)]
fn gather(out: &mut [f32], x: &[f32], rows: &[f32]) {
    let n = out.len();
    match (x, rows.len() == 4 * n) {
        ([a, b, c, d], true) => {
            let (r, s) = (&rows[..n], &rows[n..2 * n]);
            let (t, u) = (&rows[2 * n..3 * n], &rows[3 * n..]);
            for i in 0..n {
                out[i] += (r[i] * a + s[i] * b) + (t[i] * c + u[i] * d);
            }
        }
        _ => {
            for (x, row) in x.iter().zip(rows.chunks_exact(n)) {
                out.iter_mut().zip(row).for_each(|(y, w)| *y += w * x);
            }
        }
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
    pub fn run(&mut self, x: &[f32]) -> &[f32] {
        let last = self.layers.len() - 1;
        let [from, to] = &mut self.room;
        from[..x.len()].copy_from_slice(x);
        let mut n = x.len();
        for (k, layer) in self.layers.iter().enumerate() {
            let out = &mut to[..layer.outputs()];
            layer.apply(&from[..n], out);
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
    pub fn step(&mut self, x: &[f32]) {
        let [outer, inner] = &mut self.room;
        self.outer.apply(x, outer);
        self.inner.apply(&self.state, inner);
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
