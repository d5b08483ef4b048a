//! A graph made ready, and running it.

use crate::graph::Graph;
use crate::kernels::conv::conv;
use crate::kernels::depthwise::depthwise;
use crate::kernels::matmul::{Rows, multiply};
use crate::kernels::{Finish, pixels};
use crate::plan::{Plan, Step, Work};
use crate::room::Room;

/// A graph checked, folded and packed for one set of outputs.
///
/// Only what those outputs need is kept. It holds no mutable state: one net may serve many
/// threads, each with its own [`Scratch`]. The same input gives the same bits on the same kind of
/// processor, whatever else runs.
pub struct Net {
    pub(crate) plan: Plan,
}

/// Room for intermediate values, reused from run to run and from net to net.
#[derive(Default)]
pub struct Scratch {
    slots: Vec<Room>,
    windows: Vec<f32>,
    small: Room,
}

/// Why a graph cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NetError {
    /// A node cannot take its arguments.
    #[error("node {node} of the network ({kind}) cannot run: {what}")]
    Node {
        /// Its place in the graph.
        node: usize,
        /// What it was meant to do.
        kind: String,
        /// What is wrong.
        what: String,
    },
    /// The graph's lists do not fit together.
    #[error("the network is not whole: {0}")]
    Broken(String),
    /// An input of another size was given.
    #[error("input {input} of the network takes {want} values, not {got}")]
    Input {
        /// Which.
        input: usize,
        /// Values it has.
        want: usize,
        /// Values given.
        got: usize,
    },
}

impl Net {
    /// Prepares `graph` to compute the outputs at these places of its list of outputs.
    pub fn new(graph: &Graph, outputs: &[usize]) -> Result<Self, NetError> {
        Ok(Self {
            plan: Plan::new(graph, outputs)?,
        })
    }

    /// The shape of every input.
    pub fn input_shapes(&self) -> &[Vec<usize>] {
        &self.plan.input_shapes
    }

    /// The shape of every output asked for.
    pub fn output_shapes(&self) -> &[Vec<usize>] {
        &self.plan.output_shapes
    }

    /// Computes the outputs, in the order asked for.
    pub fn run<'a>(
        &self,
        inputs: &[&[f32]],
        scratch: &'a mut Scratch,
    ) -> Result<Vec<&'a [f32]>, NetError> {
        let plan = &self.plan;
        scratch.fit(&plan.slots);
        let given = inputs.iter().map(|x| x.len()).chain(std::iter::repeat(0));
        for (i, (&(slot, want), got)) in plan.inputs.iter().zip(given).enumerate() {
            if want != got {
                return Err(NetError::Input {
                    input: i,
                    want,
                    got,
                });
            }
            scratch.slots[slot]
                .head_mut(want)
                .copy_from_slice(inputs[i]);
        }
        for step in &plan.steps {
            run(step, scratch);
        }
        let slots = &scratch.slots;
        Ok(plan
            .outputs
            .iter()
            .map(|&(slot, len)| slots[slot].head(len))
            .collect())
    }
}

impl Scratch {
    fn fit(&mut self, lens: &[usize]) {
        if self.slots.len() < lens.len() {
            self.slots.resize_with(lens.len(), Room::default);
        }
        for (slot, &len) in self.slots.iter_mut().zip(lens) {
            slot.fit(len);
        }
    }
}

fn run(step: &Step, scratch: &mut Scratch) {
    let mut target = std::mem::take(&mut scratch.slots[step.output.0]);
    let out = target.head_mut(step.output.1);
    let arg = |i: usize| scratch.slots[step.args[i].0].head(step.args[i].1);
    let plus = step.plus.map(|(slot, len)| scratch.slots[slot].head(len));
    match &step.work {
        Work::Conv {
            walk,
            weights,
            limits,
        } => {
            let finish = Finish {
                limits: *limits,
                plus,
            };
            conv((walk, weights), arg(0), &mut scratch.windows, (finish, out));
        }
        Work::Full { weights, limits } => {
            multiply(
                weights,
                Rows::plain(arg(0), weights.k()),
                Finish {
                    limits: *limits,
                    plus,
                },
                out,
            );
        }
        Work::Depthwise { walk, taps } => {
            let image = scratch.slots[step.args[0].0].head(step.args[0].1);
            depthwise((walk, taps), image, &mut scratch.small, out);
        }
        Work::Add(limits) => pixels::add(arg(0), arg(1), *limits, out),
        Work::Pad {
            shape,
            before,
            padded,
        } => {
            pixels::pad(arg(0), *shape, (*before, *padded), out);
        }
        Work::MaxPool(walk) => pixels::max_pool(walk, arg(0), out),
        Work::Resize { line, rows, cols } => pixels::resize(arg(0), *line, (rows, cols), out),
        Work::DepthToSpace { shape, block } => {
            pixels::depth_to_space(arg(0), *shape, *block, out);
        }
        Work::Concat(runs) => {
            let parts: Vec<_> = (0..step.args.len()).map(arg).collect();
            pixels::concat(&parts, runs, out);
        }
        Work::Logistic => pixels::logistic(arg(0), out),
        Work::Prelu(slopes) => pixels::prelu(arg(0), slopes, out),
    }
    scratch.slots[step.output.0] = target;
}
