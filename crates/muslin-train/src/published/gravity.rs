//! Neural Cloth Simulation without the direction of gravity: told turns and accelerations alone.

use muslin_model::{Ncs, Reader};

/// Numbers of a joint's motion that tell gravity.
const OF_MOVING: std::ops::Range<usize> = 6..9;

/// Silences the weights that hear gravity, or their slopes: where both are nothing at first, they stay so.
pub(super) fn deafen(net: &Ncs, params: &mut [f32]) {
    let mut silence = |start: usize, widths: &[usize], column: usize| {
        let rows = params[start..].chunks_mut(widths[0]);
        rows.take(widths[1]).for_each(|row| row[column] = 0.0);
    };
    // All that the root tells, and the last three numbers of every other joint.
    for joint in 1..=net.joints.len() {
        let end = Reader::n_inputs_of(joint);
        (end - 3..end).for_each(|column| silence(0, &net.still.widths, column));
    }
    OF_MOVING.for_each(|column| silence(net.ends()[0], &net.joint.widths, column));
}
