//! Gradient descent with momentum, in one pass over all parameters.

/// How a step is taken: `v = m v + g`, `p -= rate v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sgd {
    /// Step size.
    pub rate: f32,
    /// `m`: what is kept of the last step.
    pub momentum: f32,
}

impl Sgd {
    /// Moves `params` against `gradient`; `velocity` is remembered from step to step, empty before the first.
    pub fn step(&self, velocity: &mut Vec<f32>, params: &mut [f32], gradient: &[f32]) {
        velocity.resize(params.len(), 0.0);
        for ((p, g), v) in params.iter_mut().zip(gradient).zip(velocity) {
            *v = self.momentum * *v + g;
            *p -= self.rate * *v;
        }
    }
}
