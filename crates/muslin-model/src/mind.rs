//! An encoder as it is played, with what it remembers of a sequence.

use muslin_net::learn::Gru;
use pulp::Simd;

use crate::layers::{Cell, Chain};
use crate::{Encoder, Ncs};

/// An encoder ready to be played.
#[derive(Clone, Debug)]
pub(crate) enum Mind {
    /// What depends on the pose alone.
    Still(Chain),
    /// Recurrent layers, one on the other.
    Snug(Vec<Cell>),
    Ncs(Box<Moving>),
}

/// The still and the moving code of NCS.
#[derive(Clone, Debug)]
pub(crate) struct Moving {
    still: Chain,
    joint: Chain,
    whole: Chain,
    cell: Cell,
    decoder: Chain,
    features: Vec<f32>,
    code: Vec<f32>,
    /// How much the moving code counts.
    pub level: f32,
}

impl Mind {
    pub fn new(encoder: &Encoder, params: &[f32]) -> Self {
        match encoder {
            Encoder::Plain(m) => Self::Still(Chain::new(m, params, false)),
            Encoder::Pbns(m) => Self::Still(Chain::new(m, params, true)),
            Encoder::Snug(s) => {
                let mut rest = params;
                let one = |l: Gru| {
                    let (own, later) = rest.split_at(l.n_params());
                    rest = later;
                    Cell::new(&l, own)
                };
                Self::Snug(s.layers().map(one).collect())
            }
            Encoder::Ncs(n) => Self::Ncs(Box::new(Moving::new(n, params))),
        }
    }

    /// Forgets the poses before.
    pub fn begin(&mut self) {
        self.cells().iter_mut().for_each(|c| c.state.fill(0.0));
    }

    /// What remembers the poses before.
    pub fn cells(&mut self) -> &mut [Cell] {
        match self {
            Self::Still(_) => &mut [],
            Self::Snug(cells) => cells,
            Self::Ncs(m) => std::slice::from_mut(&mut m.cell),
        }
    }

    /// The codes of the next pose.
    #[inline(always)]
    pub fn codes<S: Simd>(&mut self, on: S, x: &[f32]) -> &[f32] {
        match self {
            Self::Still(chain) => chain.run(on, x),
            Self::Snug(cells) => {
                let (first, rest) = cells.split_first_mut().expect("a recurrent layer");
                first.step(on, x);
                let mut before = &*first;
                for cell in rest {
                    cell.step(on, &before.state);
                    before = cell;
                }
                &before.state
            }
            Self::Ncs(m) => m.codes(on, x),
        }
    }
}

impl Moving {
    fn new(n: &Ncs, params: &[f32]) -> Self {
        let part = |k: usize| n.part(params, k);
        Self {
            still: Chain::new(&n.still, part(0), true),
            joint: Chain::new(&n.joint, part(1), true),
            whole: Chain::new(&n.whole, part(2), true),
            cell: Cell::new(&n.gru(), part(3)),
            decoder: Chain::new(&n.decoder, part(4), true),
            features: vec![0.0; n.whole.widths[0]],
            code: vec![0.0; n.decoder.widths[0]],
            level: 1.0,
        }
    }

    #[inline(always)]
    fn codes<S: Simd>(&mut self, on: S, x: &[f32]) -> &[f32] {
        let joints = self.features.len();
        let each = self.joint.outputs();
        let (still, moving) = x.split_at(x.len() - Ncs::MOVING * (joints / each));
        let features = self.features.chunks_exact_mut(each);
        for (out, x) in features.zip(moving.chunks_exact(Ncs::MOVING)) {
            out.copy_from_slice(self.joint.run(on, x));
        }
        self.cell.step(on, self.whole.run(on, &self.features));
        let sum = self.still.run(on, still).iter().zip(&self.cell.state);
        for (z, (a, b)) in self.code.iter_mut().zip(sum) {
            *z = a + self.level * b;
        }
        self.decoder.run(on, &self.code)
    }
}
