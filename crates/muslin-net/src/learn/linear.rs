//! The linear layer.

use super::{Noise, View, multiply};

/// `y = W x + b`; parameters are `W` (outputs × inputs, row by row), then `b` if there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Linear {
    /// Numbers in.
    pub inputs: usize,
    /// Numbers out.
    pub outputs: usize,
    /// Whether there is a `b`. Without one, zero in gives zero out.
    pub bias: bool,
}

impl Linear {
    /// How many parameters it has.
    pub fn n_params(&self) -> usize {
        self.outputs * (self.inputs + usize::from(self.bias))
    }

    /// Weights that keep the size of what passes a rectifier (He et al. 2015), no bias.
    pub fn start(&self, noise: &mut Noise) -> Vec<f32> {
        let scale = (2.0 / self.inputs.max(1) as f64).sqrt();
        let mut params = vec![0.0; self.n_params()];
        for w in &mut params[..self.inputs * self.outputs] {
            *w = (scale * noise.normal()) as f32;
        }
        params
    }

    /// `y` (outputs × batch) from `x` (inputs × batch).
    pub fn forward(&self, params: &[f32], (x, batch): (&[f32], usize), y: &mut [f32]) {
        let (w, b) = self.split(params);
        for (row, b) in y.chunks_exact_mut(batch).zip(b) {
            row.fill(*b);
        }
        let keep = if self.bias { 1.0 } else { 0.0 };
        multiply(y, keep, w, View::new(x, self.inputs, batch));
    }

    /// From `∂/∂y` adds to `∂/∂params`, and gives `∂/∂x` where that is wanted.
    pub fn backward(
        &self,
        params: &[f32],
        (x, dy, batch): (&[f32], &[f32], usize),
        d_params: &mut [f32],
        dx: Option<&mut [f32]>,
    ) {
        let (dw, db) = d_params.split_at_mut(self.inputs * self.outputs);
        let dy_view = View::new(dy, self.outputs, batch);
        multiply(
            dw,
            1.0,
            dy_view,
            View::new(x, self.inputs, batch).transposed(),
        );
        for (db, row) in db.iter_mut().zip(dy.chunks_exact(batch)) {
            *db += row.iter().sum::<f32>();
        }
        if let Some(dx) = dx {
            multiply(dx, 0.0, self.split(params).0.transposed(), dy_view);
        }
    }

    fn split<'a>(&self, params: &'a [f32]) -> (View<'a>, &'a [f32]) {
        assert_eq!(
            params.len(),
            self.n_params(),
            "parameters of a linear layer"
        );
        let (w, b) = params.split_at(self.inputs * self.outputs);
        (View::new(w, self.outputs, self.inputs), b)
    }
}
