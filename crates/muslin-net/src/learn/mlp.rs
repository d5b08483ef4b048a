//! Linear layers with something bent between them.

use super::{Linear, Noise, Nonlinear};

/// A multilayer perceptron: `widths[0]` in, the last of them out, `bend` between, linear at the end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mlp {
    /// Sizes from the input to the output, two at least.
    pub widths: Vec<usize>,
    /// What stands between two layers.
    pub bend: Nonlinear,
    /// Whether layers have a bias. Without, zero in gives zero out.
    pub bias: bool,
}

/// What a forward pass leaves for the way back, and room to work in.
#[derive(Clone, Debug, Default)]
pub struct MlpTape {
    /// Into each layer.
    into: Vec<Vec<f32>>,
    /// Out of each layer, before it is bent.
    out: Vec<Vec<f32>>,
    batch: usize,
}

impl Mlp {
    /// The linear layers in order.
    pub fn layers(&self) -> impl DoubleEndedIterator<Item = Linear> + ExactSizeIterator {
        self.widths.windows(2).map(|w| Linear {
            inputs: w[0],
            outputs: w[1],
            bias: self.bias,
        })
    }

    /// How many parameters all layers have.
    pub fn n_params(&self) -> usize {
        self.layers().map(|l| l.n_params()).sum()
    }

    /// Random weights.
    pub fn start(&self, noise: &mut Noise) -> Vec<f32> {
        self.layers().flat_map(|l| l.start(noise)).collect()
    }

    /// The output (last width × batch) for `x` (first width × batch).
    pub fn forward<'t>(
        &self,
        params: &[f32],
        (x, batch): (&[f32], usize),
        tape: &'t mut MlpTape,
    ) -> &'t [f32] {
        let n = self.layers().len();
        tape.into.resize(n, Vec::new());
        tape.out.resize(n, Vec::new());
        tape.batch = batch;
        tape.into[0].clear();
        tape.into[0].extend_from_slice(x);
        let mut at = 0;
        for (k, layer) in self.layers().enumerate() {
            let own = &params[at..at + layer.n_params()];
            at += own.len();
            tape.out[k].resize(layer.outputs * batch, 0.0);
            layer.forward(own, (&tape.into[k], batch), &mut tape.out[k]);
            if k + 1 < n {
                tape.into[k + 1].resize(layer.outputs * batch, 0.0);
                self.bend.forward(&tape.out[k], &mut tape.into[k + 1]);
            }
        }
        &tape.out[n - 1]
    }

    /// From `∂/∂output` adds to `∂/∂params`.
    pub fn backward(&self, params: &[f32], tape: &MlpTape, d_out: &[f32], d_params: &mut [f32]) {
        self.backward_to(params, (tape, d_out), d_params, None);
    }

    /// [`Mlp::backward`], which also gives `∂/∂x` where that is wanted.
    pub fn backward_to(
        &self,
        params: &[f32],
        (tape, d_out): (&MlpTape, &[f32]),
        d_params: &mut [f32],
        dx: Option<&mut [f32]>,
    ) {
        let mut d = d_out.to_vec();
        let mut end = self.n_params();
        for (k, layer) in self.layers().enumerate().rev() {
            let span = end - layer.n_params()..end;
            end = span.start;
            let way = (tape.into[k].as_slice(), d.as_slice(), tape.batch);
            if k == 0 {
                layer.backward(&params[span.clone()], way, &mut d_params[span], dx);
                break;
            }
            let mut before = vec![0.0; layer.inputs * tape.batch];
            layer.backward(
                &params[span.clone()],
                way,
                &mut d_params[span],
                Some(&mut before),
            );
            self.bend.backward(&tape.out[k - 1], &mut before);
            d = before;
        }
    }
}
