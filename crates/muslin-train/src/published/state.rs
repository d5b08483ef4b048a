//! A training as named arrays, to go on from to the same bits.

use muslin_net::{Numbers, Weights};

use super::resizer::Resized;
use super::trainer::{Now, Published};
use crate::TrainError;
use crate::kept::{Common, Kept, add};

/// All that changes, and what it belongs to.
pub(super) fn keep(trainer: &Published) -> Weights {
    let now = &trainer.now;
    let all = Common {
        step: now.step,
        noise: &now.noise,
        params: &now.params,
        adam: &now.adam,
        queue: &now.queue,
        bad: now.bad,
    };
    let mut out = all.written("muslin-published-training 1", trainer.identity());
    if trainer.resizing.is_some() {
        let now = &now.resized;
        add(&mut out, "resizer.params", Numbers::F32(now.params.clone()));
        add(
            &mut out,
            "resizer.velocity",
            Numbers::F32(now.velocity.clone()),
        );
    }
    out
}

/// What [`keep`] gave, if it is of this training.
pub(super) fn restored(trainer: &Published, kept: &Weights) -> Result<Now, TrainError> {
    let kept = Kept::of(kept, &trainer.identity())?;
    let n = trainer.now.params.len();
    let queue = kept.counts("queue")?;
    if queue.iter().any(|k| *k as usize >= trainer.n_windows()) {
        return Err(TrainError::OtherTraining("queue"));
    }
    Ok(Now {
        step: kept.number("step")?,
        noise: kept.noise()?,
        params: kept.floats("params", n)?,
        adam: kept.adam(n)?,
        queue,
        bad: kept.number("bad")?,
        resized: match &trainer.resizing {
            None => Resized::default(),
            Some(_) => {
                let n = trainer.now.resized.params.len();
                // Nothing before the first step that was finite.
                let moved = kept.numbers("resizer.velocity")?.len();
                if ![0, n].contains(&moved) {
                    return Err(TrainError::OtherTraining("resizer.velocity"));
                }
                Resized {
                    params: kept.floats("resizer.params", n)?,
                    velocity: kept.floats("resizer.velocity", moved)?,
                }
            }
        },
    })
}
