//! From a graph to steps: checked, stripped, folded, packed, and given room.
//!
//! Zeros around an image are folded into the windows that read it, and a sum into the
//! convolution that makes one of its terms, so neither passes through memory of its own.

use std::collections::HashMap;

use crate::graph::{Activation, Graph, Kind, Node, Window};
use crate::kernels::conv::Walk;
use crate::kernels::depthwise::Taps;
use crate::kernels::matmul::Packed;
use crate::kernels::pixels::{Between, between};
use crate::net::NetError;
use crate::shape::{count, image, infer, slide};

/// Most values one tensor may hold: far beyond any picture this is for.
const MOST_VALUES: usize = 1 << 26;

/// Where a value lies: a slot and its length.
type Place = (usize, usize);

pub(crate) struct Plan {
    pub input_shapes: Vec<Vec<usize>>,
    pub output_shapes: Vec<Vec<usize>>,
    pub inputs: Vec<Place>,
    pub outputs: Vec<Place>,
    pub steps: Vec<Step>,
    /// Length every slot needs.
    pub slots: Vec<usize>,
}

pub(crate) struct Step {
    pub work: Work,
    pub args: Vec<Place>,
    /// Added to the result before it is held between its limits.
    pub plus: Option<Place>,
    pub output: Place,
}

pub(crate) enum Work {
    Conv {
        walk: Walk,
        weights: Packed,
        limits: [f32; 2],
    },
    Full {
        weights: Packed,
        limits: [f32; 2],
    },
    Depthwise {
        walk: Walk,
        taps: Taps,
    },
    Add([f32; 2]),
    Pad {
        shape: [usize; 3],
        before: [usize; 3],
        padded: [usize; 3],
    },
    MaxPool(Walk),
    Resize {
        line: [usize; 2],
        rows: Vec<Between>,
        cols: Vec<Between>,
    },
    DepthToSpace {
        shape: [usize; 3],
        block: usize,
    },
    Concat(Vec<usize>),
    Logistic,
    Prelu(Vec<f32>),
}

/// A node on its way to becoming a step; tensors, not slots.
struct Draft<'a> {
    node: &'a Node,
    args: Vec<usize>,
    /// Zeros folded in: before and after, rows and columns.
    zeros: [[usize; 2]; 2],
    activation: Activation,
    plus: Option<usize>,
    output: usize,
}

impl Plan {
    pub(crate) fn new(graph: &Graph, wanted: &[usize]) -> Result<Self, NetError> {
        check(graph)?;
        let outputs = wanted.iter().map(|&i| graph.outputs.get(i).copied());
        let outputs: Option<Vec<usize>> = outputs.collect();
        let outputs = outputs
            .ok_or_else(|| NetError::Broken(format!("it has {} outputs", graph.outputs.len())))?;
        let mut drafts = drafts(graph, &outputs);
        fuse_sums(&mut drafts, &roots(graph, &outputs));
        Ok(Self::place(graph, &drafts, &outputs))
    }

    /// Gives every tensor a slot for as long as it is needed.
    fn place(graph: &Graph, drafts: &[Draft<'_>], outputs: &[usize]) -> Self {
        let alias = aliases(graph);
        let mut room = Room::default();
        let len = |t: usize| graph.tensors[t].len();
        let inputs = graph.inputs.iter().map(|&t| room.take(t, len(t))).collect();
        let kept: Vec<usize> = outputs.iter().map(|&t| alias[t]).collect();
        let last = last_uses(drafts);
        let steps = drafts.iter().enumerate().map(|(i, draft)| {
            let at = |room: &Room, t: usize| (room.of[&t], len(t));
            let args = draft.args.iter().map(|&t| at(&room, t)).collect();
            let plus = draft.plus.map(|t| at(&room, t));
            let output = room.take(draft.output, len(draft.output));
            for t in draft.args.iter().chain(&draft.plus).chain([&draft.output]) {
                if last.get(t).is_none_or(|&l| l <= i) && !kept.contains(t) {
                    room.give_back(*t);
                }
            }
            Step {
                work: work(graph, draft),
                args,
                plus,
                output,
            }
        });
        let steps = steps.collect();
        let shapes = |ts: &[usize]| ts.iter().map(|&t| graph.tensors[t].shape.clone()).collect();
        Self {
            input_shapes: shapes(&graph.inputs),
            output_shapes: shapes(outputs),
            inputs,
            outputs: kept.iter().map(|&t| (room.of[&t], len(t))).collect(),
            steps,
            slots: room.slots,
        }
    }
}

/// Slots given out and free ones.
#[derive(Default)]
struct Room {
    slots: Vec<usize>,
    free: Vec<usize>,
    of: HashMap<usize, usize>,
}

impl Room {
    /// The free slot that needs least growth or wastes least, else a new one.
    fn take(&mut self, tensor: usize, len: usize) -> Place {
        let cost = |slot: &usize| self.slots[*slot].abs_diff(len);
        let best = (0..self.free.len()).min_by_key(|&i| cost(&self.free[i]));
        let slot = best.map(|i| self.free.swap_remove(i)).unwrap_or_else(|| {
            self.slots.push(0);
            self.slots.len() - 1
        });
        self.slots[slot] = self.slots[slot].max(len);
        self.of.insert(tensor, slot);
        (slot, len)
    }

    fn give_back(&mut self, tensor: usize) {
        let slot = self.of[&tensor];
        if !self.free.contains(&slot) {
            self.free.push(slot);
        }
    }
}

fn last_uses(drafts: &[Draft<'_>]) -> HashMap<usize, usize> {
    let mut last = HashMap::new();
    for (i, draft) in drafts.iter().enumerate() {
        last.extend(draft.args.iter().chain(&draft.plus).map(|&t| (t, i)));
    }
    last
}

/// Fails unless every node can run in order and makes what the graph says it makes.
fn check(graph: &Graph) -> Result<(), NetError> {
    let mut known: Vec<bool> = graph.tensors.iter().map(|t| t.data.is_some()).collect();
    for (i, t) in graph.tensors.iter().enumerate() {
        let n = count(&t.shape).filter(|&n| n <= MOST_VALUES);
        if n.is_none() || t.data.as_ref().is_some_and(|d| Some(d.len()) != n) {
            return Err(NetError::Broken(format!(
                "tensor {i} cannot have shape {:?}",
                t.shape
            )));
        }
    }
    let n = graph.tensors.len();
    let roots = graph.inputs.iter().chain(&graph.outputs);
    if roots
        .chain(graph.nodes.iter().map(|n| &n.output))
        .any(|&t| t >= n)
    {
        return Err(NetError::Broken(format!(
            "it names a tensor beyond its {n}"
        )));
    }
    for &t in &graph.inputs {
        if std::mem::replace(&mut known[t], true) {
            return Err(NetError::Broken(format!(
                "input tensor {t} is already given"
            )));
        }
    }
    for (i, node) in graph.nodes.iter().enumerate() {
        check_node(graph, node, &mut known).map_err(|what| {
            let kind = format!("{:?}", node.kind);
            NetError::Node {
                node: i,
                kind,
                what,
            }
        })?;
    }
    match graph
        .outputs
        .iter()
        .find(|&&t| !known[t] || graph.tensors[t].data.is_some())
    {
        Some(t) => Err(NetError::Broken(format!("nothing makes output tensor {t}"))),
        None => Ok(()),
    }
}

fn check_node(graph: &Graph, node: &Node, known: &mut [bool]) -> Result<(), String> {
    if let Some(t) = node.inputs.iter().find(|&&t| known.get(t) != Some(&true)) {
        return Err(format!(
            "its argument, tensor {t}, is not computed before it"
        ));
    }
    let shapes: Vec<&[usize]> = node
        .inputs
        .iter()
        .map(|&t| graph.tensors[t].shape.as_slice())
        .collect();
    let made = infer(&node.kind, &shapes)?;
    let stated = &graph.tensors[node.output].shape;
    if made != *stated {
        return Err(format!("it makes {made:?}, the network says {stated:?}"));
    }
    let constants = constants(&node.kind);
    for (i, &t) in node.inputs.iter().enumerate() {
        if graph.tensors[t].data.is_some() != (i >= constants) {
            let what = if i >= constants {
                "constant"
            } else {
                "computed"
            };
            return Err(format!("argument {i} must be {what}"));
        }
    }
    if std::mem::replace(&mut known[node.output], true) {
        return Err(format!("tensor {} is made twice", node.output));
    }
    Ok(())
}

/// From which argument on a kind needs constants.
fn constants(kind: &Kind) -> usize {
    match kind {
        Kind::Conv(..) | Kind::Depthwise(..) | Kind::FullyConnected(_) | Kind::Prelu => 1,
        _ => usize::MAX,
    }
}

/// For every tensor, the one whose memory it shares.
fn aliases(graph: &Graph) -> Vec<usize> {
    let mut alias: Vec<usize> = (0..graph.tensors.len()).collect();
    for node in graph
        .nodes
        .iter()
        .filter(|n| matches!(n.kind, Kind::Reshape(_)))
    {
        alias[node.output] = alias[node.inputs[0]];
    }
    alias
}

/// Nodes that the outputs need, in order.
fn live<'a>(graph: &'a Graph, outputs: &[usize]) -> Vec<&'a Node> {
    let mut needed = vec![false; graph.tensors.len()];
    outputs.iter().for_each(|&t| needed[t] = true);
    let mut nodes: Vec<&Node> = Vec::new();
    for node in graph.nodes.iter().rev() {
        if needed[node.output] {
            node.inputs.iter().for_each(|&t| needed[t] = true);
            nodes.push(node);
        }
    }
    nodes.reverse();
    nodes
}

/// How often every tensor's memory is read, outputs included.
fn roots(graph: &Graph, outputs: &[usize]) -> Vec<usize> {
    let alias = aliases(graph);
    let mut uses = vec![0; graph.tensors.len()];
    let live = live(graph, outputs);
    let reads = live.iter().filter(|n| !matches!(n.kind, Kind::Reshape(_)));
    for &t in reads.flat_map(|n| &n.inputs).chain(outputs) {
        uses[alias[t]] += 1;
    }
    uses
}

/// Live nodes, reshapes gone and zeros folded into the windows that read them.
fn drafts<'a>(graph: &'a Graph, outputs: &[usize]) -> Vec<Draft<'a>> {
    let alias = aliases(graph);
    let nodes = live(graph, outputs);
    let zeros = folded_zeros(&nodes, &alias, outputs);
    let mut drafts = Vec::new();
    for node in nodes {
        if matches!(node.kind, Kind::Reshape(_)) || zeros.contains_key(&node.output) {
            continue;
        }
        let computed = node.inputs.iter().take(constants(&node.kind));
        let mut args: Vec<usize> = computed.map(|&t| alias[t]).collect();
        let mut around = [[0; 2]; 2];
        if let Some(&(inner, zeros)) = zeros.get(&args[0]) {
            (args[0], around) = (inner, zeros);
        }
        let activation = activation(&node.kind);
        let output = node.output;
        drafts.push(Draft {
            node,
            args,
            zeros: around,
            activation,
            plus: None,
            output,
        });
    }
    drafts
}

/// Padded tensors that only convolutions read: what is inside, and the zeros around it.
fn folded_zeros(
    nodes: &[&Node],
    alias: &[usize],
    outputs: &[usize],
) -> HashMap<usize, (usize, [[usize; 2]; 2])> {
    let mut folded = HashMap::new();
    for node in nodes {
        let Kind::Pad(p) = &node.kind else { continue };
        let reads = |n: &&&Node| n.inputs.iter().any(|&t| alias[t] == node.output);
        let windows = |n: &&Node| matches!(n.kind, Kind::Conv(..) | Kind::Depthwise(..));
        let only_windows = nodes.iter().filter(reads).all(windows);
        let kept = outputs.iter().any(|&t| alias[t] == node.output);
        if let [[0, 0], rows, cols, [0, 0]] = p[..]
            && only_windows
            && !kept
        {
            folded.insert(node.output, (alias[node.inputs[0]], [rows, cols]));
        }
    }
    folded
}

fn activation(kind: &Kind) -> Activation {
    match kind {
        Kind::Conv(_, a) | Kind::Depthwise(_, a) | Kind::FullyConnected(a) | Kind::Add(a) => *a,
        _ => Activation::None,
    }
}

/// Lets a convolution that only a sum reads make that sum itself.
fn fuse_sums(drafts: &mut Vec<Draft<'_>>, uses: &[usize]) {
    let mut i = 0;
    while i < drafts.len() {
        if let Some((p, term)) = fusable(drafts, i, uses) {
            let mut conv = drafts.remove(p);
            let sum = &drafts[i - 1];
            conv.plus = Some(sum.args[1 - term]);
            conv.activation = sum.activation;
            conv.output = sum.output;
            drafts[i - 1] = conv;
        } else {
            i += 1;
        }
    }
}

/// If draft `i` is a sum: the convolution that can make it, and which term that is.
fn fusable(drafts: &[Draft<'_>], i: usize, uses: &[usize]) -> Option<(usize, usize)> {
    let sum = &drafts[i];
    if !matches!(sum.node.kind, Kind::Add(_)) || sum.args[0] == sum.args[1] {
        return None;
    }
    let makes = |t: usize| {
        drafts[..i].iter().position(|d| {
            let plain = matches!(d.node.kind, Kind::Conv(_, Activation::None)) && d.plus.is_none();
            d.output == t && plain && uses[t] == 1
        })
    };
    [1, 0]
        .into_iter()
        .find_map(|term| Some((makes(sum.args[term])?, term)))
}

fn work(graph: &Graph, draft: &Draft<'_>) -> Work {
    let shape = |t: usize| graph.tensors[t].shape.as_slice();
    let whole = || image(shape(draft.args[0])).expect("checked to be an image");
    let made = || image(shape(draft.output)).expect("checked to be an image");
    let constant = |i: usize| {
        graph.tensors[draft.node.inputs[i]]
            .data
            .as_deref()
            .expect("checked to be constant")
    };
    let weights = || Packed::new(constant(1), constant(2));
    let limits = draft.activation.limits();
    let size = || [1, 2].map(|axis| shape(draft.node.inputs[1])[axis]);
    match &draft.node.kind {
        Kind::Conv(w, _) => Work::Conv {
            walk: walk(whole(), size(), *w, draft.zeros),
            weights: weights(),
            limits,
        },
        Kind::FullyConnected(_) => Work::Full {
            weights: weights(),
            limits,
        },
        Kind::Depthwise(w, _) => {
            let (weights, bias) = (constant(1).to_vec(), constant(2).to_vec());
            let walk = walk(whole(), size(), *w, draft.zeros);
            Work::Depthwise {
                walk,
                taps: Taps {
                    weights,
                    bias,
                    limits,
                },
            }
        }
        Kind::Add(_) => Work::Add(limits),
        Kind::Pad(p) => Work::Pad {
            shape: whole(),
            before: [p[1][0], p[2][0], p[3][0]],
            padded: made(),
        },
        Kind::MaxPool { window, size } => Work::MaxPool(walk(whole(), *size, *window, [[0; 2]; 2])),
        Kind::Resize {
            size,
            align_corners,
            half_pixel,
        } => {
            let [h, w, c] = whole();
            let axis = |n, out| between(n, out, *align_corners, *half_pixel);
            Work::Resize {
                line: [w, c],
                rows: axis(h, size[0]),
                cols: axis(w, size[1]),
            }
        }
        Kind::DepthToSpace(block) => Work::DepthToSpace {
            shape: whole(),
            block: *block,
        },
        Kind::Concat(axis) => {
            let run = |&t: &usize| shape(t)[*axis..].iter().product();
            Work::Concat(draft.node.inputs.iter().map(run).collect())
        }
        Kind::Logistic => Work::Logistic,
        Kind::Prelu => Work::Prelu(constant(1).to_vec()),
        Kind::Reshape(_) => unreachable!("reshapes share memory and make no step"),
    }
}

/// The walk of a window over an image with `zeros` around it.
fn walk(image: [usize; 3], size: [usize; 2], w: Window, zeros: [[usize; 2]; 2]) -> Walk {
    let axis = |i: usize| {
        let n = image[i] + zeros[i][0] + zeros[i][1];
        slide(n, size[i], w.stride[i], w.padding).expect("checked that the window fits")
    };
    let both = [axis(0), axis(1)];
    Walk {
        image,
        out: both.map(|a| a[0]),
        size,
        stride: w.stride,
        before: [0, 1].map(|i| zeros[i][0] + both[i][1]),
    }
}

#[cfg(test)]
mod tests;
