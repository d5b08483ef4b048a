//! Networks from poses to codes: our own, and those of the published systems.

use muslin_net::learn::{Gru, Mlp};

use crate::Reader;

/// What turns poses into codes. Parameters of all parts lie in one slice, in the order of the
/// fields.
#[derive(Clone, Debug, PartialEq)]
pub enum Encoder {
    /// Our own: descriptors of the pose, and traits, through a perceptron.
    Plain(Mlp),
    /// PBNS (Bertiche et al. 2021): turns of the bones through a perceptron whose last layer is
    /// rectified as well.
    Pbns(Mlp),
    /// SNUG (Santesteban et al. 2022).
    Snug(Snug),
    /// Neural Cloth Simulation (Bertiche et al. 2022).
    Ncs(Ncs),
}

/// Recurrent layers over body, pose and speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Snug {
    /// What the body's shape is in numbers; told with every pose.
    pub body: Vec<f32>,
    /// Numbers in, then the size of every layer.
    pub widths: Vec<usize>,
}

/// A still and a moving code, added and decoded. All perceptrons rectify their last layer as well;
/// those of the moving code have no biases, so that without motion it is zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Ncs {
    /// Where the driving bones turn, on the body at rest [m].
    pub joints: Vec<[f32; 3]>,
    /// From the pose to the still code.
    pub still: Mlp,
    /// From one joint's motion to features; the same for all joints.
    pub joint: Mlp,
    /// From all joints' features to what the recurrent layer reads.
    pub whole: Mlp,
    /// From the sum of the codes to the codes that mix shapes.
    pub decoder: Mlp,
}

impl Snug {
    /// The recurrent layers in order.
    pub fn layers(&self) -> impl ExactSizeIterator<Item = Gru> {
        self.widths.windows(2).map(|w| Gru {
            inputs: w[0],
            size: w[1],
            bias: true,
        })
    }
}

impl Ncs {
    /// Numbers that tell a joint's motion.
    pub const MOVING: usize = 12;

    /// The recurrent layer, which stands between `whole` and `decoder`.
    pub fn gru(&self) -> Gru {
        Gru {
            inputs: last(&self.whole.widths),
            size: last(&self.still.widths),
            bias: false,
        }
    }

    /// Where the parameters of `still`, `joint`, `whole`, [`Ncs::gru`] and `decoder` end.
    pub fn ends(&self) -> [usize; 5] {
        let counts = [
            self.still.n_params(),
            self.joint.n_params(),
            self.whole.n_params(),
            self.gru().n_params(),
            self.decoder.n_params(),
        ];
        let mut end = 0;
        counts.map(|n| {
            end += n;
            end
        })
    }

    /// The parameters of `still`, `joint`, `whole`, [`Ncs::gru`] or `decoder`, by number.
    pub fn part<'a>(&self, params: &'a [f32], k: usize) -> &'a [f32] {
        let ends = self.ends();
        &params[if k == 0 { 0 } else { ends[k - 1] }..ends[k]]
    }
}

impl Encoder {
    /// Its short stable name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Plain(_) => "plain",
            Self::Pbns(_) => "pbns",
            Self::Snug(_) => "snug",
            Self::Ncs(_) => "ncs",
        }
    }

    /// Whether what it gives depends on the poses before.
    pub fn is_moving(&self) -> bool {
        matches!(self, Self::Snug(_) | Self::Ncs(_))
    }

    /// Whether its share of motion can be turned up and down.
    pub fn has_motion_level(&self) -> bool {
        matches!(self, Self::Ncs(_))
    }

    /// How many numbers it reads of a pose of `n` driving bones.
    pub fn n_inputs(&self, n: usize) -> usize {
        match self {
            Self::Plain(_) => Reader::n_inputs_of(n),
            Self::Pbns(_) => 3 * n,
            Self::Snug(s) => s.body.len() + 3 * n + 3,
            Self::Ncs(_) => Reader::n_inputs_of(n) + Ncs::MOVING * n,
        }
    }

    /// How many codes it gives.
    pub fn n_codes(&self) -> usize {
        match self {
            Self::Plain(m) | Self::Pbns(m) => last(&m.widths),
            Self::Snug(s) => last(&s.widths),
            Self::Ncs(n) => last(&n.decoder.widths),
        }
    }

    /// How many parameters it has.
    pub fn n_params(&self) -> usize {
        match self {
            Self::Plain(m) | Self::Pbns(m) => m.n_params(),
            Self::Snug(s) => s.layers().map(|l| l.n_params()).sum(),
            Self::Ncs(n) => n.ends()[4],
        }
    }

    /// How many of so many traits it reads after the pose.
    pub fn n_told(&self, traits: usize) -> usize {
        match self {
            Self::Plain(_) => traits,
            Self::Pbns(_) | Self::Snug(_) | Self::Ncs(_) => 0,
        }
    }

    /// Whether its parts fit each other, a pose of `n` driving bones and that many traits after it.
    pub fn fits(&self, n: usize, traits: usize) -> bool {
        match self {
            Self::Plain(m) => sound(&m.widths) && m.widths[0] == self.n_inputs(n) + traits,
            Self::Snug(s) => {
                let told = s.body.iter().all(|x| x.is_finite());
                let whole = traits == 0 || traits == s.body.len();
                told && whole && sound(&s.widths) && s.widths[0] == self.n_inputs(n)
            }
            _ if traits > 0 => false,
            Self::Pbns(m) => sound(&m.widths) && m.widths[0] == self.n_inputs(n),
            Self::Ncs(e) => {
                let parts = [&e.still, &e.joint, &e.whole, &e.decoder];
                parts.iter().all(|p| sound(&p.widths))
                    && !(e.joint.bias || e.whole.bias)
                    && e.joints.len() == n
                    && e.joints.as_flattened().iter().all(|x| x.is_finite())
                    && e.still.widths[0] == Reader::n_inputs_of(n)
                    && e.joint.widths[0] == Ncs::MOVING
                    && e.whole.widths[0] == n * last(&e.joint.widths)
                    && e.decoder.widths[0] == last(&e.still.widths)
            }
        }
    }
}

/// Whether a network may be of these widths.
pub(crate) fn sound(widths: &[usize]) -> bool {
    (2..=64).contains(&widths.len()) && widths.iter().all(|x| (1..=1 << 16).contains(x))
}

fn last(widths: &[usize]) -> usize {
    widths.last().copied().unwrap_or(0)
}
