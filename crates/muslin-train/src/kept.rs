//! Trainings as named arrays: what all of them keep, and reading it back.

use muslin_net::learn::{AdamState, Noise};
use muslin_net::{Array, Numbers, Weights};

use crate::TrainError;

/// Keeps orders apart (any large odd number).
const ORDER: u64 = 0x9e37_79b9_7f4a_7c15;

/// What changes in every training.
pub(crate) struct Common<'a> {
    pub step: u64,
    pub noise: &'a Noise,
    pub params: &'a [f32],
    pub adam: &'a AdamState,
    pub queue: &'a [u32],
    pub bad: u64,
}

impl Common<'_> {
    /// As arrays, of a training of this `format` and `identity`.
    pub fn written(&self, format: &str, identity: String) -> Weights {
        let mut out = Weights::default();
        let notes = [
            ("format", format.to_owned()),
            ("identity", identity),
            ("step", self.step.to_string()),
            ("noise", self.noise.state().to_string()),
            ("adam", self.adam.steps.to_string()),
            ("bad", self.bad.to_string()),
        ];
        out.notes.extend(notes.map(|(k, v)| (k.to_owned(), v)));
        add(&mut out, "params", Numbers::F32(self.params.to_vec()));
        add(&mut out, "adam.mean", Numbers::F32(self.adam.mean.clone()));
        let square = Numbers::F32(self.adam.square.clone());
        add(&mut out, "adam.square", square);
        add(&mut out, "queue", Numbers::U32(self.queue.to_vec()));
        out
    }
}

/// Adds a list by its name.
pub(crate) fn add(out: &mut Weights, name: &str, numbers: Numbers) {
    let array = Array::new(&[numbers.len()], numbers);
    out.arrays.insert(name.into(), array);
}

/// What was kept of a training, but that its next poses come in another order, the `nth` one.
///
/// # Errors
/// [`TrainError::OtherTraining`] if it is none.
pub fn in_another_order(mut kept: Weights, nth: u64) -> Result<Weights, TrainError> {
    let noise = Kept(&kept).number("noise")?;
    let other = noise ^ nth.wrapping_mul(ORDER);
    kept.notes.insert("noise".into(), other.to_string());
    kept.notes.insert("bad".into(), 0.to_string());
    add(&mut kept, "queue", Numbers::U32(Vec::new()));
    Ok(kept)
}

/// What was kept, to be read.
pub(crate) struct Kept<'k>(&'k Weights);

impl<'k> Kept<'k> {
    /// Refuses what another training kept.
    pub fn of(kept: &'k Weights, identity: &String) -> Result<Self, TrainError> {
        match kept.notes.get("identity") == Some(identity) {
            true => Ok(Self(kept)),
            false => Err(TrainError::OtherTraining("garment, body, motion or plan")),
        }
    }

    /// A number among the notes.
    pub fn number(&self, name: &'static str) -> Result<u64, TrainError> {
        let note = self.0.notes.get(name).and_then(|n| n.parse().ok());
        note.ok_or(TrainError::OtherTraining(name))
    }

    /// An array of any kind.
    pub fn numbers(&self, name: &'static str) -> Result<&'k Numbers, TrainError> {
        let array = self.0.arrays.get(name).map(|a| &a.numbers);
        array.ok_or(TrainError::OtherTraining(name))
    }

    /// `len` numbers.
    pub fn floats(&self, name: &'static str, len: usize) -> Result<Vec<f32>, TrainError> {
        match self.numbers(name)? {
            Numbers::F32(v) if v.len() == len => Ok(v.clone()),
            _ => Err(TrainError::OtherTraining(name)),
        }
    }

    /// Counts, however many.
    pub fn counts(&self, name: &'static str) -> Result<Vec<u32>, TrainError> {
        match self.numbers(name)? {
            Numbers::U32(v) => Ok(v.clone()),
            _ => Err(TrainError::OtherTraining(name)),
        }
    }

    /// Where random numbers stand.
    pub fn noise(&self) -> Result<Noise, TrainError> {
        Ok(Noise::new(self.number("noise")?))
    }

    /// What Adam remembers of `n` parameters; nothing before the first step.
    pub fn adam(&self, n: usize) -> Result<AdamState, TrainError> {
        let steps = self.number("adam")?;
        let moved = if steps == 0 { 0 } else { n };
        Ok(AdamState {
            steps,
            mean: self.floats("adam.mean", moved)?,
            square: self.floats("adam.square", moved)?,
        })
    }
}
