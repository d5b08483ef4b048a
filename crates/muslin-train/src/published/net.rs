//! Networks of sixteen windows at once: from what they are told to codes, and back.

use muslin_model::{Encoder, Ncs, Snug};
use muslin_net::learn::{Gru, Mlp, MlpTape, Noise, Nonlinear};

use super::ncs::NcsTape;
use super::recipe::{System, sizes};
use super::snug::SnugTape;
use super::trainer::Course;
use crate::lanes::LANES;

/// What chance decides in a step.
#[derive(Clone, Debug, Default)]
pub(crate) struct Chance {
    /// SNUG: the state of every layer before the window, size × lanes.
    pub states: Vec<Vec<f32>>,
    /// SNUG: poses before the window that the state goes through first.
    pub warm: usize,
    /// NCS: the lane whose motion each of the first lanes gets. From these the encoder does not
    /// learn, and they have no inertia.
    pub order: Vec<usize>,
}

/// What a forward pass leaves for the way back.
pub(crate) enum Tape {
    Pbns(Box<Bent>),
    Snug(SnugTape),
    Ncs(Box<NcsTape>),
}

/// A perceptron whose last layer is bent as well.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bent {
    tape: MlpTape,
    out: Vec<f32>,
}

impl Bent {
    /// Last width × batch.
    pub fn forward(&mut self, mlp: &Mlp, params: &[f32], x: (&[f32], usize)) -> Vec<f32> {
        self.out = mlp.forward(params, x, &mut self.tape).to_vec();
        let mut z = vec![0.0; self.out.len()];
        mlp.bend.forward(&self.out, &mut z);
        z
    }

    /// From `∂/∂z` adds to `∂/∂params`, and gives `∂/∂x` where that is wanted.
    pub fn backward(
        &self,
        (mlp, params): (&Mlp, &[f32]),
        mut dz: Vec<f32>,
        d_params: &mut [f32],
        dx: Option<&mut [f32]>,
    ) {
        mlp.bend.backward(&self.out, &mut dz);
        mlp.backward_to(params, (&self.tape, &dz), d_params, dx);
    }
}

/// The network of a course for `n` driving bones: `joints` as [`Ncs::joints`], `body` as [`Snug::body`].
pub(crate) fn encoder(course: &Course, (joints, body): (Vec<[f32; 3]>, Vec<f32>)) -> Encoder {
    let mlp = |first: usize, rest: &[usize], bias: bool| Mlp {
        widths: [&[first], rest].concat(),
        bend: Nonlinear::Relu,
        bias,
    };
    let n = joints.len();
    match course.system {
        System::Pbns => Encoder::Pbns(mlp(3 * n, &sizes::PBNS, true)),
        System::Snug => {
            let mut widths = vec![body.len() + 3 * n + 3];
            widths.resize(1 + course.layers, sizes::SNUG);
            Encoder::Snug(Snug { body, widths })
        }
        System::Ncs => {
            let code = course.width;
            let [.., feature] = sizes::NCS_JOINT;
            Encoder::Ncs(Ncs {
                still: mlp(
                    muslin_model::Reader::n_inputs_of(n),
                    &[&sizes::NCS_STILL[..], &[code]].concat(),
                    true,
                ),
                joint: mlp(Ncs::MOVING, &sizes::NCS_JOINT, false),
                whole: mlp(n * feature, &[code; sizes::NCS_WHOLE], false),
                decoder: mlp(code, &[code; sizes::NCS_DECODER], true),
                joints,
            })
        }
    }
}

/// The first weights: Glorot's deviation for PBNS, one for all perceptrons of NCS, biases zero.
pub(crate) fn start(encoder: &Encoder, noise: &mut Noise) -> Vec<f32> {
    match encoder {
        Encoder::Plain(m) => m.start(noise),
        Encoder::Pbns(m) => glorot(m, noise),
        Encoder::Snug(s) => s.layers().flat_map(|l| gated(&l, noise)).collect(),
        Encoder::Ncs(n) => {
            let mut part = |m: &Mlp| random(m, |_, _| sizes::NCS_START, noise);
            let mut out = [&n.still, &n.joint, &n.whole].map(&mut part).concat();
            let decoder = part(&n.decoder);
            out.extend(gated(&n.gru(), noise));
            out.extend(decoder);
            out
        }
    }
}

/// Weights of the deviations that recurrent layers start with in the published code's framework (Glorot's over all
/// three gates; orthogonal), biases zero.
fn gated(gru: &Gru, noise: &mut Noise) -> Vec<f32> {
    let gates = 3 * gru.size;
    let told = glorot_deviation(gru.inputs, gates);
    gru.start_with([told, 1.0 / (gates as f64).sqrt()], noise)
}

/// Weights of Glorot's deviation, biases zero.
pub(crate) fn glorot(mlp: &Mlp, noise: &mut Noise) -> Vec<f32> {
    random(mlp, glorot_deviation, noise)
}

fn glorot_deviation(inputs: usize, outputs: usize) -> f64 {
    (2.0 / (inputs + outputs) as f64).sqrt()
}

fn random(mlp: &Mlp, deviation: impl Fn(usize, usize) -> f64, noise: &mut Noise) -> Vec<f32> {
    let mut out = Vec::with_capacity(mlp.n_params());
    for l in mlp.layers() {
        let scale = deviation(l.inputs, l.outputs);
        let weights = (0..l.inputs * l.outputs).map(|_| (scale * noise.normal()) as f32);
        out.extend(weights);
        out.resize(out.len() + if l.bias { l.outputs } else { 0 }, 0.0);
    }
    out
}

/// The codes (codes × lanes) of the poses that are decoded, from what is told of every pose of the
/// windows (inputs × lanes).
pub(crate) fn forward(
    encoder: &Encoder,
    params: &[f32],
    (told, decoded): (&[Vec<f32>], usize),
    chance: &Chance,
) -> (Vec<Vec<f32>>, Tape) {
    match encoder {
        Encoder::Plain(_) => unreachable!("no published system has a network of our own"),
        Encoder::Pbns(m) => {
            let mut tape = Box::<Bent>::default();
            let codes = tape.forward(m, params, (&told[0], LANES));
            (vec![codes], Tape::Pbns(tape))
        }
        Encoder::Snug(s) => {
            let (codes, tape) = SnugTape::forward(s, params, (told, decoded), &chance.states);
            (codes, Tape::Snug(tape))
        }
        Encoder::Ncs(n) => {
            let (codes, tape) = NcsTape::forward(n, params, (told, decoded), &chance.order);
            (codes, Tape::Ncs(Box::new(tape)))
        }
    }
}

/// From `∂/∂codes` of the poses that are judged, the last ones, adds to `∂/∂params`.
pub(crate) fn backward(
    (encoder, params): (&Encoder, &[f32]),
    tape: &Tape,
    d_codes: &mut Vec<Vec<f32>>,
    d_params: &mut [f32],
) {
    match (encoder, tape) {
        (Encoder::Pbns(m), Tape::Pbns(tape)) => {
            let d = d_codes.pop().unwrap_or_default();
            tape.backward((m, params), d, d_params, None);
        }
        (Encoder::Snug(s), Tape::Snug(tape)) => tape.backward((s, params), d_codes, d_params),
        (Encoder::Ncs(n), Tape::Ncs(tape)) => {
            let d = d_codes.pop().unwrap_or_default();
            tape.backward((n, params), d, d_params);
        }
        _ => unreachable!("a tape of the same network"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recurrent_layers_start_as_small_as_in_the_published_framework_and_without_biases() {
        let shape = (vec![[0.0; 3]; 24], vec![0.0; 10]);
        let net = encoder(&Course::of(System::Snug), shape);
        let first = start(&net, &mut Noise::new(3));
        let (told, own) = (768 * 85, 768 * 256);
        let deviation = |x: &[f32]| {
            let square: f64 = x.iter().map(|x| f64::from(*x).powi(2)).sum();
            (square / x.len() as f64).sqrt()
        };
        let glorot = (2.0_f64 / (85.0 + 768.0)).sqrt();
        assert!((deviation(&first[..told]) / glorot - 1.0).abs() < 0.02);
        let orthogonal = (1.0_f64 / 768.0).sqrt();
        assert!((deviation(&first[told..told + own]) / orthogonal - 1.0).abs() < 0.02);
        let biases = &first[told + own..told + own + 2 * 768];
        assert!(biases.iter().all(|b| *b == 0.0));
    }

    #[test]
    fn networks_have_as_many_parameters_as_the_published_ones() {
        // On the t-shirt of the published code: 4,424 vertices; 24 joints, or 15 of them.
        let rows = 3 * 4424;
        let count = |system: System, joints: usize, body: usize, constant: usize| {
            let shape = (vec![[0.0; 3]; joints], vec![0.0; body]);
            let net = encoder(&Course::of(system), shape);
            let first = start(&net, &mut Noise::new(1)).len();
            assert_eq!(first, net.n_params());
            first + rows * (net.n_codes() + constant)
        };
        assert_eq!(count(System::Pbns, 24, 0, 0), 430_208);
        assert_eq!(count(System::Snug, 24, 10, 1), 4_858_584);
        // The root tells gravity alone: six inputs of 64 units less.
        assert_eq!(count(System::Ncs, 15, 0, 0), 9_847_040 - 6 * 64);
    }
}
