//! Adam (Kingma and Ba 2015), in one pass over all parameters.

/// How a step is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Step size.
    pub rate: f32,
    /// Memory of the mean of gradients and of their squares.
    pub memory: [f32; 2],
    /// Added to the root of the mean square.
    pub floor: f32,
}

impl Default for Adam {
    fn default() -> Self {
        Self {
            rate: 1e-3,
            memory: [0.9, 0.999],
            floor: 1e-8,
        }
    }
}

/// What is remembered from step to step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamState {
    /// Steps taken.
    pub steps: u64,
    /// Running means of the gradients.
    pub mean: Vec<f32>,
    /// Running means of their squares.
    pub square: Vec<f32>,
}

impl Adam {
    /// Step size and floor after so many steps, at least one: both corrections for the start at zero go into them.
    pub fn corrected(&self, steps: u64) -> [f32; 2] {
        let [a, b] = self.memory;
        let bias = |m: f32| 1.0 - f64::from(m).powf(steps as f64);
        let root = bias(b).sqrt();
        [
            (f64::from(self.rate) * root / bias(a)) as f32,
            (f64::from(self.floor) * root) as f32,
        ]
    }

    /// Moves `params` against `gradient`.
    pub fn step(&self, state: &mut AdamState, params: &mut [f32], gradient: &[f32]) {
        state.mean.resize(params.len(), 0.0);
        state.square.resize(params.len(), 0.0);
        state.steps += 1;
        let [a, b] = self.memory;
        let [rate, floor] = self.corrected(state.steps);
        let moments = state.mean.iter_mut().zip(&mut state.square);
        for ((p, g), (m, v)) in params.iter_mut().zip(gradient).zip(moments) {
            *m = a * *m + (1.0 - a) * g;
            *v = b * *v + (1.0 - b) * g * g;
            *p -= rate * *m / (v.sqrt() + floor);
        }
    }
}
