//! Going back to where a training was sound.

use muslin_net::{Numbers, Weights};
use muslin_train::{TrainError, Training, in_another_order};

/// Steps from one state that is kept to the next.
const EVERY: u64 = 50;
/// How often a training may go back.
const MOST: u64 = 3;
/// What the names of a kept state begin with, in the file of an unfinished training.
const PREFIX: &str = "safe.";
/// The note that says how often it went back.
const BACK: &str = "gone_back";

/// The last state of a training in which all numbers were finite.
#[derive(Clone, Debug, Default)]
pub(super) struct Safe {
    state: Option<Weights>,
    /// How often the training went back.
    pub gone_back: u64,
}

impl Safe {
    /// Keeps the state of a training now and then, so that the same training keeps the same states wherever it was
    /// stopped.
    pub fn mind(&mut self, trainer: &dyn Training) -> Result<(), TrainError> {
        if self.state.is_none() || trainer.steps().is_multiple_of(EVERY) {
            let state = trainer.keep()?;
            if is_finite(&state) {
                self.state = Some(state);
            }
        }
        Ok(())
    }

    /// Goes back to the state that was kept last, and on from there with its poses in another order; the step. A fault
    /// that comes again and again is given back, and the training stands where it was sound.
    pub fn go_back(
        &mut self,
        trainer: &mut dyn Training,
        fault: TrainError,
    ) -> Result<u64, TrainError> {
        let (TrainError::NotFinite { .. }, Some(state)) = (&fault, &self.state) else {
            return Err(fault);
        };
        self.gone_back += 1;
        let state = in_another_order(state.clone(), self.gone_back)?;
        trainer.restore(&state)?;
        match self.gone_back > MOST {
            true => Err(fault),
            false => Ok(trainer.steps()),
        }
    }

    /// Adds it to what is kept of an unfinished training.
    pub fn add_to(&self, kept: &mut Weights) {
        let state = self.state.clone().unwrap_or_default();
        let named = |name: String| format!("{PREFIX}{name}");
        let arrays = state.arrays.into_iter();
        kept.arrays.extend(arrays.map(|(k, v)| (named(k), v)));
        let notes = state.notes.into_iter();
        kept.notes.extend(notes.map(|(k, v)| (named(k), v)));
        kept.notes.insert(BACK.into(), self.gone_back.to_string());
    }

    /// Takes it out again.
    pub fn of(kept: &mut Weights) -> Self {
        let own = |name: &String| name.strip_prefix(PREFIX).map(str::to_owned);
        let mut state = Weights::default();
        let arrays = std::mem::take(&mut kept.arrays).into_iter();
        for (name, array) in arrays {
            match own(&name) {
                Some(name) => state.arrays.insert(name, array),
                None => kept.arrays.insert(name, array),
            };
        }
        for (name, note) in std::mem::take(&mut kept.notes) {
            match own(&name) {
                Some(name) => state.notes.insert(name, note),
                None => kept.notes.insert(name, note),
            };
        }
        let gone_back = kept.notes.remove(BACK).and_then(|n| n.parse().ok());
        Self {
            state: (!state.arrays.is_empty()).then_some(state),
            gone_back: gone_back.unwrap_or(0),
        }
    }
}

/// Whether all of a state can be gone on from.
fn is_finite(state: &Weights) -> bool {
    state.arrays.values().all(|a| match &a.numbers {
        Numbers::F32(v) => v.iter().all(|x| x.is_finite()),
        Numbers::F64(v) => v.iter().all(|x| x.is_finite()),
        _ => true,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use muslin_body::Motion;
    use muslin_model::Model;
    use muslin_net::Array;
    use muslin_train::Told;

    use super::*;

    /// A training that breaks at a step in some orders of its poses.
    struct Brittle {
        step: u64,
        order: String,
        value: f32,
        breaks: fn(u64, &str) -> bool,
    }

    impl Training for Brittle {
        fn steps(&self) -> u64 {
            self.step
        }
        fn step(&mut self) -> Result<Told, TrainError> {
            self.step += 1;
            if (self.breaks)(self.step, &self.order) {
                self.value = f32::NAN;
                return Err(TrainError::NotFinite {
                    term: "membrane",
                    step: self.step,
                    vertex: 7,
                });
            }
            Ok(Told::default())
        }
        fn judge(&self, _: &Motion) -> Result<Told, TrainError> {
            Ok(Told::default())
        }
        fn model(&self, _: BTreeMap<String, String>) -> Result<Model, TrainError> {
            unreachable!("nobody asks")
        }
        fn keep(&self) -> Result<Weights, TrainError> {
            let mut out = Weights::default();
            let array = Array::new(&[1], Numbers::F32(vec![self.value]));
            out.arrays.insert("params".into(), array);
            let queue = Array::new(&[2], Numbers::U32(vec![1, 0]));
            out.arrays.insert("queue".into(), queue);
            out.notes.insert("step".into(), self.step.to_string());
            out.notes.insert("noise".into(), self.order.clone());
            out.notes.insert("bad".into(), "0".into());
            Ok(out)
        }
        fn restore(&mut self, kept: &Weights) -> Result<(), TrainError> {
            self.step = kept.notes["step"].parse().expect("a number");
            self.order.clone_from(&kept.notes["noise"]);
            let Numbers::F32(value) = &kept.arrays["params"].numbers else {
                panic!("a float");
            };
            self.value = value[0];
            Ok(())
        }
    }

    fn brittle(breaks: fn(u64, &str) -> bool) -> Brittle {
        Brittle {
            step: 0,
            order: "5".into(),
            value: 1.0,
            breaks,
        }
    }

    #[test]
    fn a_training_that_breaks_goes_back_to_where_it_was_sound_and_on_in_another_order() {
        let mut trainer = brittle(|step, order| step == 130 && order == "5");
        let mut safe = Safe::default();
        let mut came = Vec::new();
        while trainer.steps() < 200 {
            safe.mind(&trainer).expect("it tells");
            match trainer.step() {
                Ok(_) => (),
                Err(e) => came.push(safe.go_back(&mut trainer, e).expect("it can go back")),
            }
        }
        assert_eq!((came, safe.gone_back), (vec![100], 1));
        assert_eq!(trainer.value, 1.0);
        assert_ne!(trainer.order, "5");
    }

    #[test]
    fn a_fault_that_comes_in_any_order_is_told_and_the_training_stands_where_it_was_sound() {
        let mut trainer = brittle(|step, _| step == 70);
        let mut safe = Safe::default();
        let fault = loop {
            safe.mind(&trainer).expect("it tells");
            if let Err(e) = trainer.step()
                && let Err(e) = safe.go_back(&mut trainer, e)
            {
                break e;
            }
        };
        assert!(
            matches!(fault, TrainError::NotFinite { vertex: 7, .. }),
            "{fault}"
        );
        assert_eq!((trainer.steps(), trainer.value), (50, 1.0));
        assert_eq!(safe.gone_back, MOST + 1);
    }

    #[test]
    fn what_is_kept_beside_an_unfinished_training_comes_back_as_it_was() {
        let trainer = brittle(|_, _| false);
        let mut safe = Safe::default();
        safe.mind(&trainer).expect("it tells");
        safe.gone_back = 2;
        let mut kept = trainer.keep().expect("it tells");
        safe.add_to(&mut kept);
        let read = Safe::of(&mut kept);
        assert_eq!(Ok(&kept), trainer.keep().as_ref());
        assert_eq!((read.state, read.gone_back), (safe.state, 2));
    }
}
