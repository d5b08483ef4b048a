//! The still and the moving code of Neural Cloth Simulation over a window, and the way back.

use muslin_model::{Ncs, Reader};
use muslin_net::learn::GruTape;

use super::net::Bent;
use crate::lanes::LANES;

/// What a forward pass leaves: of the still code and the decoder that of the last pose, which
/// alone is learnt from.
#[derive(Default)]
pub(crate) struct NcsTape {
    still: Bent,
    joint: Bent,
    whole: Bent,
    steps: Vec<GruTape>,
    decoder: Bent,
    /// Lanes whose codes are taken as they are.
    detached: usize,
}

impl NcsTape {
    /// Codes (codes × lanes) of the last `decoded` poses. The first lanes get the motion of the
    /// lanes in `order`.
    pub fn forward(
        net: &Ncs,
        params: &[f32],
        (told, decoded): (&[Vec<f32>], usize),
        order: &[usize],
    ) -> (Vec<Vec<f32>>, Self) {
        let part = |k: usize| net.part(params, k);
        let mut tape = Self {
            detached: order.len(),
            ..Self::default()
        };
        let (n, steps) = (net.joints.len(), told.len());
        let split = Reader::n_inputs_of(n) * LANES;
        let x = by_joint(told, split, n);
        let batch = steps * n * LANES;
        let joint = tape.joint.forward(&net.joint, part(1), (&x, batch));
        let x = by_step(&joint, steps, n);
        let whole = tape.whole.forward(&net.whole, part(2), (&x, steps * LANES));
        let gru = net.gru();
        let mut state = vec![0.0; gru.size * LANES];
        let mut codes = Vec::new();
        for (t, told) in told.iter().enumerate() {
            let x = columns(&whole, steps, t);
            let mut next = vec![0.0; state.len()];
            let mut step = GruTape::default();
            gru.forward(part(3), (&x, &state, LANES), (&mut next, &mut step));
            tape.steps.push(step);
            state = next;
            if t + decoded >= steps {
                let still = (&told[..split], LANES);
                let mut z = tape.still.forward(&net.still, part(0), still);
                for (z, h) in z.chunks_mut(LANES).zip(state.chunks(LANES)) {
                    for (lane, z) in z.iter_mut().enumerate() {
                        *z += h[order.get(lane).copied().unwrap_or(lane)];
                    }
                }
                codes.push(tape.decoder.forward(&net.decoder, part(4), (&z, LANES)));
            }
        }
        (codes, tape)
    }

    /// From `∂/∂codes` of the last pose adds to `∂/∂params`.
    pub fn backward(&self, (net, params): (&Ncs, &[f32]), d_codes: Vec<f32>, d_params: &mut [f32]) {
        let ends = net.ends();
        let (d_still, rest) = d_params.split_at_mut(ends[0]);
        let (d_joint, rest) = rest.split_at_mut(ends[1] - ends[0]);
        let (d_whole, rest) = rest.split_at_mut(ends[2] - ends[1]);
        let (d_gru, d_decoder) = rest.split_at_mut(ends[3] - ends[2]);
        let part = |k: usize| net.part(params, k);
        let gru = net.gru();
        let mut dz = vec![0.0; gru.size * LANES];
        let decoder = (&net.decoder, part(4));
        (self.decoder).backward(decoder, d_codes, d_decoder, Some(&mut dz));
        dz.chunks_mut(LANES)
            .for_each(|row| row[..self.detached].fill(0.0));
        (self.still).backward((&net.still, part(0)), dz.clone(), d_still, None);
        let (n, steps) = (net.joints.len(), self.steps.len());
        let mut d_x = vec![0.0; gru.inputs * steps * LANES];
        for (t, step) in self.steps.iter().enumerate().rev() {
            let (mut dx, mut before) = (vec![0.0; gru.inputs * LANES], vec![0.0; dz.len()]);
            gru.backward(part(3), (step, &dz), d_gru, (&mut dx, &mut before));
            put_columns(&dx, (&mut d_x, steps), t);
            dz = before;
        }
        let mut d_features = vec![0.0; net.whole.widths[0] * steps * LANES];
        (self.whole).backward((&net.whole, part(2)), d_x, d_whole, Some(&mut d_features));
        let d = back_by_joint(&d_features, steps, n);
        (self.joint).backward((&net.joint, part(1)), d, d_joint, None);
    }
}

/// One column a step, joint and lane; what is told lies `[number][lane]`, joint after joint.
fn by_joint(told: &[Vec<f32>], split: usize, n: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(Ncs::MOVING * told.len() * n * LANES);
    for number in 0..Ncs::MOVING {
        for told in told {
            for joint in 0..n {
                let at = split + (Ncs::MOVING * joint + number) * LANES;
                out.extend_from_slice(&told[at..at + LANES]);
            }
        }
    }
    out
}

/// From `[feature][step][joint][lane]` to `[joint][feature][step][lane]`.
fn by_step(x: &[f32], steps: usize, n: usize) -> Vec<f32> {
    let features = x.len() / (steps * n * LANES);
    let mut out = Vec::with_capacity(x.len());
    for joint in 0..n {
        for feature in 0..features {
            for step in 0..steps {
                let at = ((feature * steps + step) * n + joint) * LANES;
                out.extend_from_slice(&x[at..at + LANES]);
            }
        }
    }
    out
}

/// The other way round.
fn back_by_joint(x: &[f32], steps: usize, n: usize) -> Vec<f32> {
    let features = x.len() / (steps * n * LANES);
    let mut out = Vec::with_capacity(x.len());
    for feature in 0..features {
        for step in 0..steps {
            for joint in 0..n {
                let at = ((joint * features + feature) * steps + step) * LANES;
                out.extend_from_slice(&x[at..at + LANES]);
            }
        }
    }
    out
}

/// The lanes of one step.
fn columns(x: &[f32], steps: usize, t: usize) -> Vec<f32> {
    let rows = x.chunks(steps * LANES);
    rows.flat_map(|row| &row[t * LANES..(t + 1) * LANES])
        .copied()
        .collect()
}

fn put_columns(x: &[f32], (out, steps): (&mut [f32], usize), t: usize) {
    for (row, x) in out.chunks_mut(steps * LANES).zip(x.chunks(LANES)) {
        row[t * LANES..(t + 1) * LANES].copy_from_slice(x);
    }
}
