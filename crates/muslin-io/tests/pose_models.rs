//! The embedded networks compute what LiteRT computes.

use muslin_io::{PoseGraphs, pose_graphs, read_tflite};
use muslin_net::{Graph, Net, Scratch};

/// Largest error, as a share of an output's largest magnitude.
const TOLERANCE: f32 = 5e-4;

/// Values any language makes exactly: hashed counters, or triangle waves.
fn made_up(kind: &str, shape: &[usize], low: f32) -> Vec<f32> {
    let (w, c) = (shape[2], shape[3]);
    let unit = |i: usize| match kind {
        "noise" => ((i as u32).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32,
        _ => {
            let (y, x, k) = (i / c / w, i / c % w, i % c);
            (((3 * x + 5 * y + 40 * k) % 64) as f32 / 32.0 - 1.0).abs()
        }
    };
    (0..shape.iter().product())
        .map(|i| unit(i) * (1.0 - low) + low)
        .collect()
}

/// All outputs of a network for a made-up input.
fn outputs(graph: &Graph, kind: &str, low: f32) -> Vec<Vec<f32>> {
    let all: Vec<usize> = (0..graph.outputs.len()).collect();
    let net = Net::new(graph, &all).expect("the embedded network is sound");
    let input = made_up(kind, &net.input_shapes()[0], low);
    let mut scratch = Scratch::default();
    let out = net.run(&[&input], &mut scratch).expect("the input fits");
    out.into_iter().map(<[f32]>::to_vec).collect()
}

/// Fails unless one line of the stored reference agrees with `got`.
fn assert_line(line: &str, got: &[Vec<f32>]) {
    let words: Vec<&str> = line.split(' ').collect();
    let number = |w: &str| w.parse::<f32>().expect("the stored values are numbers");
    let out = &got[number(words[2]) as usize];
    let (size, stride) = (number(words[3]), number(words[4]) as usize);
    assert_eq!(
        words.len() - 5,
        out.len().div_ceil(stride),
        "{}",
        &line[..20]
    );
    for (want, got) in words[5..].iter().zip(out.iter().step_by(stride)) {
        let off = (number(want) - got).abs() / size;
        assert!(
            off <= TOLERANCE,
            "{}: {got} instead of {want}, off by {off:.1e}",
            &line[..20]
        );
    }
}

#[test]
fn tensors_agree_with_the_reference() {
    let PoseGraphs {
        detector,
        landmarks,
    } = pose_graphs().expect("the program is whole");
    let stored = include_str!("golden/pose_tensors.txt");
    for (which, graph, low) in [
        ("detector", &detector, -1.0),
        ("landmarks", &landmarks, 0.0),
    ] {
        for kind in ["noise", "waves"] {
            let got = outputs(graph, kind, low);
            let start = format!("{which} {kind} ");
            let lines: Vec<&str> = stored.lines().filter(|l| l.starts_with(&start)).collect();
            assert_eq!(lines.len(), got.len());
            lines.iter().for_each(|line| assert_line(line, &got));
        }
    }
}

#[test]
fn an_unwanted_mask_changes_nothing_else() {
    let graph = pose_graphs().expect("the program is whole").landmarks;
    let all = outputs(&graph, "waves", 0.0);
    let few = Net::new(&graph, &[0, 1, 3, 4]).expect("sound");
    let input = made_up("waves", &few.input_shapes()[0], 0.0);
    let mut scratch = Scratch::default();
    let got = few.run(&[&input], &mut scratch).expect("the input fits");
    assert_eq!(got, [&all[0], &all[1], &all[3], &all[4]]);
}

#[test]
fn a_damaged_network_is_refused_without_harm() {
    let whole = include_bytes!("../../../assets/pose/pose_detection.tflite");
    for i in 0..24 {
        assert!(read_tflite(&whole[..whole.len() * i / 24]).is_err());
        let mut spoilt = whole.to_vec();
        let at = i * 7919 * 31 % whole.len();
        spoilt[at..at + 4].fill(0xEE);
        if let Ok(graph) = read_tflite(&spoilt) {
            let _ = Net::new(&graph, &[0]);
        }
    }
}
