//! A graph in which every fold meets another, and unsound ones.

use super::*;
use crate::graph::{Padding, Tensor};
use crate::kernels::noise::{assert_close, values};
use crate::net::{Net, Scratch};

const SAME: Window = Window {
    stride: [1, 1],
    padding: Padding::Same,
};
const INNER: Window = Window {
    stride: [2, 2],
    padding: Padding::Valid,
};

/// Adds a node that makes a tensor of the shape it infers.
fn node(g: &mut Graph, kind: Kind, inputs: &[usize]) -> usize {
    let shapes: Vec<&[usize]> = inputs.iter().map(|&t| &g.tensors[t].shape[..]).collect();
    let shape = infer(&kind, &shapes).expect("the test's graph is sound");
    g.tensors.push(Tensor {
        shape,
        ..Default::default()
    });
    let output = g.tensors.len() - 1;
    g.nodes.push(Node {
        kind,
        inputs: inputs.to_vec(),
        output,
    });
    output
}

fn constant(g: &mut Graph, shape: &[usize], seed: u32) -> usize {
    let data = Some(values(shape.iter().product(), seed));
    g.tensors.push(Tensor {
        shape: shape.to_vec(),
        data,
        ..Default::default()
    });
    g.tensors.len() - 1
}

/// Pad, two windows that read it, a sum, an activation, joined: every fold meets another.
fn sample() -> Graph {
    let mut g = Graph::default();
    g.tensors.push(Tensor {
        shape: vec![1, 6, 8, 4],
        ..Default::default()
    });
    g.inputs = vec![0];
    let padded = node(
        &mut g,
        Kind::Pad(vec![[0, 0], [0, 1], [1, 0], [0, 0]]),
        &[0],
    );
    let (w, b) = (
        constant(&mut g, &[5, 3, 3, 4], 1),
        constant(&mut g, &[5], 2),
    );
    let (dw, db) = (
        constant(&mut g, &[1, 3, 3, 4], 3),
        constant(&mut g, &[4], 4),
    );
    let (pw, pb) = (
        constant(&mut g, &[5, 1, 1, 4], 5),
        constant(&mut g, &[5], 6),
    );
    let a = node(&mut g, Kind::Conv(INNER, Activation::None), &[padded, w, b]);
    let d = node(
        &mut g,
        Kind::Depthwise(INNER, Activation::Relu),
        &[padded, dw, db],
    );
    let p = node(&mut g, Kind::Conv(SAME, Activation::None), &[d, pw, pb]);
    let sum = node(&mut g, Kind::Add(Activation::Relu6), &[a, p]);
    let flat = node(&mut g, Kind::Reshape(vec![1, 60]), &[sum]);
    let both = node(&mut g, Kind::Concat(1), &[flat, flat]);
    g.outputs = vec![both, sum, padded];
    g
}

#[test]
fn folding_changes_no_value() {
    let g = sample();
    let x = values(6 * 8 * 4, 9);
    let mut scratch = Scratch::default();
    // With the padded tensor and both terms asked for, nothing can be folded.
    let mut open = g.clone();
    open.outputs.extend(g.nodes.iter().map(|n| n.output));
    let all: Vec<usize> = (0..open.outputs.len()).collect();
    let plain = Net::new(&open, &all).expect("sound");
    let want = plain.run(&[&x], &mut scratch).expect("sound")[0].to_vec();
    let net = Net::new(&g, &[0]).expect("sound");
    assert_eq!(
        net.plan.steps.len(),
        4,
        "conv, depthwise, conv with sum, join"
    );
    assert_eq!(plain.plan.steps.len(), 6);
    let got = net.run(&[&x], &mut scratch).expect("sound")[0];
    assert!(want.iter().any(|&v| v > 0.0 && v < 6.0));
    assert_close(got, &want, 1e-6);
}

#[test]
fn unwanted_branches_are_not_computed() {
    let net = Net::new(&sample(), &[2]).expect("sound");
    assert_eq!(net.plan.steps.len(), 1);
    assert_eq!(net.output_shapes(), [vec![1, 7, 9, 4]]);
}

#[test]
fn unsound_graphs_are_refused_by_name() {
    type Spoil = fn(&mut Graph);
    let cases: [(Spoil, &str); 8] = [
        (|g| g.nodes[1].inputs[1] = 99, "tensor 99"),
        (|g| g.nodes[1].inputs.truncate(1), "1 arguments"),
        (|g| g.nodes.swap(0, 1), "not computed before"),
        (|g| g.tensors[1].shape[1] = 3, "it makes [1, 7, 9, 4]"),
        (|g| g.tensors[2].data = Some(vec![0.0]), "tensor 2"),
        (|g| g.tensors[0].shape[1] = usize::MAX, "tensor 0"),
        (|g| g.outputs.push(400), "beyond"),
        (|g| g.inputs.push(0), "already given"),
    ];
    for (spoil, said) in cases {
        let mut g = sample();
        spoil(&mut g);
        let err = Net::new(&g, &[0]).err().expect("refused").to_string();
        assert!(err.contains(said), "{err:?} does not say {said:?}");
    }
    assert!(Net::new(&sample(), &[3]).is_err());
    let net = Net::new(&sample(), &[0]).expect("sound");
    assert!(net.run(&[], &mut Scratch::default()).is_err());
}
