//! Whole tensors for made-up inputs.

use std::fmt::Write;

use muslin_io::PoseGraphs;
use muslin_net::{Graph, Net, Scratch};

use super::reference::Reference;

/// Largest error, as a share of an output's largest magnitude.
const TOLERANCE: f64 = 5e-4;
/// What the ordinary tests compare with.
const GOLDEN: &str = "crates/muslin-io/tests/golden/pose_tensors.txt";
const HEAD: &str = "\
# LiteRT: network, input, output, its largest magnitude, a stride, and every so many-th value.
# Printed by `cargo xtask check pose --bless`.
";

/// Prints a row per output; returns what is too far off.
pub fn compare(
    graphs: &PoseGraphs,
    reference: &mut Reference,
    bless: bool,
) -> Result<Vec<String>, String> {
    let (mut faults, mut golden) = (Vec::new(), HEAD.to_owned());
    for (model, graph, low) in [
        ("detector", &graphs.detector, -1.0),
        ("landmarks", &graphs.landmarks, 0.0),
    ] {
        for input in ["noise", "waves"] {
            let want = reference.tensors(model, input)?;
            let got = outputs(graph, input, low)?;
            for (i, (want, got)) in want.iter().zip(&got).enumerate() {
                let size = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let off = want.iter().zip(got).map(|(w, g)| (w - f64::from(*g)).abs());
                let off = off.fold(0.0, f64::max) / size;
                println!(
                    "{model} {input} output {i}: {:>6} values, off by {off:.1e}",
                    got.len()
                );
                if off > TOLERANCE || want.len() != got.len() {
                    faults.push(format!("{model} {input} output {i}: off by {off:.1e}"));
                }
                line(&mut golden, &format!("{model} {input} {i} {size:.6}"), want);
            }
        }
    }
    if bless {
        std::fs::write(GOLDEN, golden).map_err(|e| format!("{GOLDEN}: {e}"))?;
    }
    Ok(faults)
}

/// About 120 values of a tensor.
fn line(golden: &mut String, name: &str, values: &[f64]) {
    let stride = (values.len() / 120) | 1;
    let some: Vec<String> = values
        .iter()
        .step_by(stride)
        .map(|x| format!("{x:.6}"))
        .collect();
    writeln!(golden, "{name} {stride} {}", some.join(" ")).expect("strings take all");
}

/// All outputs of a network for a made-up input.
fn outputs(graph: &Graph, kind: &str, low: f32) -> Result<Vec<Vec<f32>>, String> {
    let all: Vec<usize> = (0..graph.outputs.len()).collect();
    let net = Net::new(graph, &all).map_err(|e| e.to_string())?;
    let input = made_up(kind, &net.input_shapes()[0], low);
    let mut scratch = Scratch::default();
    let out = net
        .run(&[&input], &mut scratch)
        .map_err(|e| e.to_string())?;
    Ok(out.into_iter().map(<[f32]>::to_vec).collect())
}

/// Values any language makes exactly: hashed counters, or triangle waves.
pub fn made_up(kind: &str, shape: &[usize], low: f32) -> Vec<f32> {
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
