//! Neural Cloth Simulation without the direction of gravity: told turns and accelerations alone.

use muslin_model::{Ncs, Reader};

use crate::lanes::LANES;

/// Numbers of the still descriptors of `n` joints that tell gravity: all that the root tells, three of every other.
fn of_still(n: usize) -> impl Iterator<Item = usize> {
    (0..n).flat_map(|j| (0..3).map(move |k| Reader::n_inputs_of(j + 1) - 3 + k))
}

/// Those of a joint's motion.
const OF_MOVING: std::ops::Range<usize> = 6..9;

/// Silences gravity in what is told of `n` joints (inputs × lanes).
pub(super) fn silence(told: &mut [f32], n: usize) {
    let moving = |j: usize| OF_MOVING.map(move |k| Reader::n_inputs_of(n) + Ncs::MOVING * j + k);
    for row in of_still(n).chain((0..n).flat_map(moving)) {
        told[row * LANES..(row + 1) * LANES].fill(0.0);
    }
}

/// The parameters of a network that does not hear gravity.
pub(super) fn unheard(net: &Ncs, params: &[f32]) -> Vec<f32> {
    let mut out = params.to_vec();
    let mut deafen = |start: usize, (inputs, outputs): (usize, usize), column: usize| {
        (0..outputs).for_each(|o| out[start + o * inputs + column] = 0.0);
    };
    let first = |widths: &[usize]| (widths[0], widths[1]);
    for column in of_still(net.joints.len()) {
        deafen(0, first(&net.still.widths), column);
    }
    for column in OF_MOVING {
        deafen(net.ends()[0], first(&net.joint.widths), column);
    }
    out
}
