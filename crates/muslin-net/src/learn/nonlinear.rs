//! What bends between two linear layers.

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nonlinear {
    /// `max(x, 0)`.
    Relu,
    /// The hyperbolic tangent.
    Tanh,
    /// `x σ(x)`: a rectifier without a corner (Ramachandran et al. 2017).
    Silu,
    /// `λ x` above 0, `λ α (eˣ − 1)` below: keeps mean and deviation from layer to layer (Klambauer et al. 2017).
    Selu,
}

/// `λ` and `α` of [`Nonlinear::Selu`].
const SELU: [f32; 2] = [1.050_701, 1.673_263_2];

/// `1 / (1 + e⁻ˣ)`.
#[inline]
pub(super) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

impl Nonlinear {
    /// `y = f(x)`, number by number.
    pub fn forward(self, x: &[f32], y: &mut [f32]) {
        let pairs = y.iter_mut().zip(x);
        match self {
            Self::Relu => pairs.for_each(|(y, x)| *y = x.max(0.0)),
            Self::Tanh => pairs.for_each(|(y, x)| *y = x.tanh()),
            Self::Silu => pairs.for_each(|(y, x)| *y = x * sigmoid(*x)),
            Self::Selu => {
                let [scale, depth] = SELU;
                pairs.for_each(|(y, x)| *y = scale * (x.max(0.0) + depth * x.min(0.0).exp_m1()));
            }
        }
    }

    /// Turns `∂/∂y` into `∂/∂x` in place; `x` is what came in. The rectifier's slope at 0 is 0.
    pub fn backward(self, x: &[f32], d: &mut [f32]) {
        let slope = |x: f32| match self {
            Self::Relu => f32::from(x > 0.0),
            Self::Tanh => {
                let t = x.tanh();
                1.0 - t * t
            }
            Self::Silu => {
                let s = sigmoid(x);
                s * (1.0 + x * (1.0 - s))
            }
            Self::Selu if x > 0.0 => SELU[0],
            Self::Selu => SELU[0] * SELU[1] * x.exp(),
        };
        d.iter_mut().zip(x).for_each(|(d, x)| *d *= slope(*x));
    }

    /// A short stable name, for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relu => "relu",
            Self::Tanh => "tanh",
            Self::Silu => "silu",
            Self::Selu => "selu",
        }
    }

    /// The function of that name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Relu, Self::Tanh, Self::Silu, Self::Selu]
            .into_iter()
            .find(|f| f.name() == name)
    }
}
