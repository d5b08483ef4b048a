//! What trainings have in common.

use std::collections::BTreeMap;
use std::ops::Range;

use muslin_body::{Motion, Pose};
use muslin_model::Model;
use muslin_net::Weights;
use muslin_sim::Material;

use crate::{Energies, Lesson, Told, TrainError};

/// Batches in a row that may fail before a training does.
const MOST_BAD: u64 = 5;

/// Something that learns step by step, and can be kept and gone on with to the same bits.
///
/// What it knows may lie on a device: [`TrainError::Device`] where that does not tell it.
pub trait Training {
    /// Steps taken so far.
    fn steps(&self) -> u64;

    /// How many of these steps look anew for what is near cloth, which takes several times as long as to follow it.
    fn looks(&self, _steps: Range<u64>) -> u64 {
        0
    }

    /// Learns from the next poses. A batch that is not finite is left out; six in a row are an
    /// error.
    fn step(&mut self) -> Result<Told, TrainError>;

    /// What a motion costs that need not be learnt from, by poses evenly taken.
    fn judge(&self, motion: &Motion) -> Result<Told, TrainError>;

    /// What has been learnt so far.
    fn model(&self, notes: BTreeMap<String, String>) -> Result<Model, TrainError>;

    /// All that changes, and what it belongs to.
    fn keep(&self) -> Result<Weights, TrainError>;

    /// Goes on from what [`Training::keep`] gave.
    fn restore(&mut self, kept: &Weights) -> Result<(), TrainError>;
}

/// Why a batch is left out, where `vertex` is the first that is not finite.
pub(crate) fn fault(energies: &Energies, vertex: usize, step: u64) -> TrainError {
    let terms = energies.terms();
    let term = terms.into_iter().find(|t| !t.1.is_finite());
    TrainError::NotFinite {
        term: term.map_or("gradient", |t| t.0),
        step,
        vertex,
    }
}

/// Counts batches in a row that were left out; gives the fault once there are too many.
pub(crate) fn left_out(bad: &mut u64, fault: TrainError, told: Told) -> Result<Told, TrainError> {
    *bad += 1;
    match *bad > MOST_BAD {
        true => Err(fault),
        false => Ok(told),
    }
}

/// FNV-1a over the bytes: tells trainings apart, guards against nobody.
pub(crate) fn sum(numbers: &mut dyn Iterator<Item = f64>) -> u64 {
    let bytes = numbers.flat_map(|x| x.to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// What the bits of a training depend on, in short: poses, which are the same for all lessons, cloths and bodies.
pub(crate) fn fingerprints<'l, 'a: 'l, 'p>(
    lessons: impl Iterator<Item = &'l Lesson<'a>>,
    poses: impl Iterator<Item = &'p Pose>,
) -> String {
    let mut poses = Some(poses);
    let one = |l: &Lesson<'_>| fingerprint(l, poses.take().into_iter().flatten());
    lessons.map(one).collect::<Vec<_>>().join(" ")
}

fn fingerprint<'a>(lesson: &Lesson<'_>, poses: impl Iterator<Item = &'a Pose>) -> String {
    let turns = |p: &Pose| -> Vec<f64> {
        let root = p.root.to_array().into_iter();
        root.chain(p.rotations.iter().flat_map(|q| q.to_array()))
            .chain(p.shifts.iter().flat_map(|s| s.to_array()))
            .chain(p.beyond.iter().flat_map(|a| a.to_cols_array()))
            .collect()
    };
    let cloth = lesson.cloth;
    let stuff = |m: &Material| {
        let (k, b) = (m.stretch, m.bend);
        let planar = [k.weft, k.warp, k.shear, k.compression];
        planar
            .into_iter()
            .chain([b.weft, b.warp, m.density, m.thickness])
    };
    let counts = [&cloth.material_of, &cloth.pins, &cloth.layers];
    let counts = counts.into_iter().flatten();
    let whole = cloth.faces.as_flattened().iter().chain(counts);
    let traits = lesson.traits.iter().map(|t| t.1);
    let parts = [
        sum(&mut traits.into_iter()),
        sum(&mut poses.flat_map(turns)),
        sum(&mut lesson.template.iter().flat_map(|p| p.to_array())),
        sum(&mut cloth.materials.iter().flat_map(stuff)),
        sum(&mut cloth.rest.as_flattened().iter().flat_map(|p| p.to_array())),
        sum(&mut whole.map(|n| f64::from(*n))),
        sum(&mut lesson.figure.verts.iter().flat_map(|p| p.to_array())),
        sum(&mut { (lesson.weights.rows().flatten()).flat_map(|e| [f64::from(e.0), e.1]) }),
    ];
    format!("{parts:x?}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pair_of_signs_and_no_zero_is_lost_in_a_sum() {
        let of = |numbers: &[f64]| sum(&mut numbers.iter().copied());
        let all = [0.1, 0.3, -0.2, 0.9, 0.1, 0.35];
        let mut other = all;
        (other[1], other[5]) = (-0.3, -0.35);
        assert_ne!(of(&all), of(&other));
        assert_ne!(of(&[0.0, 0.0, 1.5]), of(&[1.5]));
    }
}
