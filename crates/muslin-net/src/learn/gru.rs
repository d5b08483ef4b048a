//! The gated recurrent unit (Cho et al. 2014), reset after the product.
//!
//! `r = σ(W_r x + U_r h + b_r)`, `z = σ(W_z x + U_z h + b_z)`,
//! `n = tanh(W_n x + b_n + r ∘ (U_n h + c_n))`, `h′ = (1 − z) ∘ n + z ∘ h`.
//!
//! Without biases, zero input and zero state stay zero.

use super::nonlinear::sigmoid;
use super::{Noise, View, multiply};

/// A layer of such units; parameters are `W` (3·size × inputs: r, z, n), `U` (3·size × size), then
/// `b` and `c` (3·size each; of the first two gates only their sums count) if there are biases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gru {
    /// Numbers in.
    pub inputs: usize,
    /// Numbers of the state.
    pub size: usize,
    /// Whether there are biases.
    pub bias: bool,
}

/// What one step leaves for the way back.
#[derive(Clone, Debug, Default)]
pub struct GruTape {
    x: Vec<f32>,
    h: Vec<f32>,
    /// Gates r, z and candidate n, each size × batch.
    gates: Vec<f32>,
    /// `U_n h + c_n`.
    inner: Vec<f32>,
    batch: usize,
}

impl Gru {
    /// How many parameters it has.
    pub fn n_params(&self) -> usize {
        3 * self.size * (self.inputs + self.size + 2 * usize::from(self.bias))
    }

    /// Weights of variance `1/inputs` and `1/size`, biases zero.
    pub fn start(&self, noise: &mut Noise) -> Vec<f32> {
        let scale = |n: usize| 1.0 / (n.max(1) as f64).sqrt();
        self.start_with([scale(self.inputs), scale(self.size)], noise)
    }

    /// Weights of these deviations, those of the input and those of the state; biases zero.
    pub fn start_with(&self, [told, own]: [f64; 2], noise: &mut Noise) -> Vec<f32> {
        let mut params = vec![0.0; self.n_params()];
        let (w, u) = (3 * self.size * self.inputs, 3 * self.size * self.size);
        for (k, p) in params[..w + u].iter_mut().enumerate() {
            let scale = if k < w { told } else { own };
            *p = (scale * noise.normal()) as f32;
        }
        params
    }

    /// The next state (size × batch) from `x` (inputs × batch) and the state `h`.
    pub fn forward(
        &self,
        params: &[f32],
        (x, h, batch): (&[f32], &[f32], usize),
        (next, tape): (&mut [f32], &mut GruTape),
    ) {
        let (w, u, b, c) = self.split(params);
        let n = self.size * batch;
        tape.x = x.to_vec();
        tape.h = h.to_vec();
        tape.batch = batch;
        tape.gates = vec![0.0; 3 * n];
        let mut inner = vec![0.0; 3 * n];
        multiply(&mut tape.gates, 0.0, w, View::new(x, self.inputs, batch));
        multiply(&mut inner, 0.0, u, View::new(h, self.size, batch));
        add_rows(&mut tape.gates, b, batch);
        add_rows(&mut inner, c, batch);
        for i in 0..2 * n {
            tape.gates[i] = sigmoid(tape.gates[i] + inner[i]);
        }
        for i in 0..n {
            let (r, z) = (tape.gates[i], tape.gates[n + i]);
            let new = (tape.gates[2 * n + i] + r * inner[2 * n + i]).tanh();
            tape.gates[2 * n + i] = new;
            next[i] = (1.0 - z) * new + z * h[i];
        }
        tape.inner = inner.split_off(2 * n);
    }

    /// From `∂/∂next` adds to `∂/∂params`; gives `∂/∂x` and `∂/∂h`.
    pub fn backward(
        &self,
        params: &[f32],
        (tape, d_next): (&GruTape, &[f32]),
        d_params: &mut [f32],
        (dx, dh): (&mut [f32], &mut [f32]),
    ) {
        let (w, u, ..) = self.split(params);
        let (batch, n) = (tape.batch, self.size * tape.batch);
        // Slopes at what goes into the gates, through the input and through the state.
        let (mut outer, mut inner) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        for i in 0..n {
            let (r, z, new) = (tape.gates[i], tape.gates[n + i], tape.gates[2 * n + i]);
            let d_new = d_next[i] * (1.0 - z) * (1.0 - new * new);
            let d_r = d_new * tape.inner[i] * r * (1.0 - r);
            let d_z = d_next[i] * (tape.h[i] - new) * z * (1.0 - z);
            (outer[i], inner[i]) = (d_r, d_r);
            (outer[n + i], inner[n + i]) = (d_z, d_z);
            (outer[2 * n + i], inner[2 * n + i]) = (d_new, d_new * r);
            dh[i] = d_next[i] * z;
        }
        let rows = 3 * self.size;
        let (vo, vi) = (
            View::new(&outer, rows, batch),
            View::new(&inner, rows, batch),
        );
        let (x, h) = (
            View::new(&tape.x, self.inputs, batch),
            View::new(&tape.h, self.size, batch),
        );
        let (dw, rest) = d_params.split_at_mut(rows * self.inputs);
        let (du, rest) = rest.split_at_mut(rows * self.size);
        multiply(dw, 1.0, vo, x.transposed());
        multiply(du, 1.0, vi, h.transposed());
        multiply(dx, 0.0, w.transposed(), vo);
        multiply(dh, 1.0, u.transposed(), vi);
        if self.bias {
            let (db, dc) = rest.split_at_mut(rows);
            sum_rows(db, &outer, batch);
            sum_rows(dc, &inner, batch);
        }
    }

    fn split<'a>(&self, params: &'a [f32]) -> (View<'a>, View<'a>, &'a [f32], &'a [f32]) {
        assert_eq!(
            params.len(),
            self.n_params(),
            "parameters of a recurrent layer"
        );
        let rows = 3 * self.size;
        let (w, rest) = params.split_at(rows * self.inputs);
        let (u, rest) = rest.split_at(rows * self.size);
        let (b, c) = rest.split_at(rest.len() / 2);
        (
            View::new(w, rows, self.inputs),
            View::new(u, rows, self.size),
            b,
            c,
        )
    }
}

fn add_rows(x: &mut [f32], b: &[f32], batch: usize) {
    for (row, b) in x.chunks_exact_mut(batch).zip(b) {
        row.iter_mut().for_each(|x| *x += b);
    }
}

fn sum_rows(db: &mut [f32], d: &[f32], batch: usize) {
    for (db, row) in db.iter_mut().zip(d.chunks_exact(batch)) {
        *db += row.iter().sum::<f32>();
    }
}
