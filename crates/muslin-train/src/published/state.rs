//! A training as named arrays, to go on from to the same bits.

use muslin_net::learn::{AdamState, Noise};
use muslin_net::{Array, Numbers, Weights};

use super::trainer::{Now, Published};
use crate::TrainError;

/// All that changes, and what it belongs to.
pub(super) fn keep(trainer: &Published) -> Weights {
    let now = &trainer.now;
    let mut out = Weights::default();
    let notes = [
        ("format", "muslin-published-training 1".to_owned()),
        ("identity", trainer.identity()),
        ("step", now.step.to_string()),
        ("noise", now.noise.state().to_string()),
        ("adam", now.adam.steps.to_string()),
        ("bad", now.bad.to_string()),
    ];
    out.notes.extend(notes.map(|(k, v)| (k.to_owned(), v)));
    let arrays = [
        ("params", Numbers::F32(now.params.clone())),
        ("adam.mean", Numbers::F32(now.adam.mean.clone())),
        ("adam.square", Numbers::F32(now.adam.square.clone())),
        ("queue", Numbers::U32(now.queue.clone())),
    ];
    for (name, numbers) in arrays {
        let array = Array::new(&[numbers.len()], numbers);
        out.arrays.insert(name.into(), array);
    }
    out
}

/// What [`keep`] gave, if it is of this training.
pub(super) fn restored(trainer: &Published, kept: &Weights) -> Result<Now, TrainError> {
    if kept.notes.get("identity") != Some(&trainer.identity()) {
        return Err(TrainError::OtherTraining("garment, body, motion or plan"));
    }
    let number = |name: &'static str| {
        let note = kept.notes.get(name).and_then(|n| n.parse::<u64>().ok());
        note.ok_or(TrainError::OtherTraining(name))
    };
    let numbers = |name: &'static str| {
        let array = kept.arrays.get(name).map(|a| &a.numbers);
        array.ok_or(TrainError::OtherTraining(name))
    };
    let floats = |name: &'static str, len: usize| match numbers(name)? {
        Numbers::F32(v) if v.len() == len => Ok(v.clone()),
        _ => Err(TrainError::OtherTraining(name)),
    };
    let n = trainer.now.params.len();
    let steps = number("adam")?;
    let moved = if steps == 0 { 0 } else { n };
    let queue = match numbers("queue")? {
        Numbers::U32(v) if v.iter().all(|k| (*k as usize) < trainer.n_windows()) => v.clone(),
        _ => return Err(TrainError::OtherTraining("queue")),
    };
    Ok(Now {
        step: number("step")?,
        noise: Noise::new(number("noise")?),
        params: floats("params", n)?,
        adam: AdamState {
            steps,
            mean: floats("adam.mean", moved)?,
            square: floats("adam.square", moved)?,
        },
        queue,
        bad: number("bad")?,
    })
}
