//! A training as named arrays, to go on from to the same bits.

use muslin_net::learn::{AdamState, Noise};
use muslin_net::{Array, Numbers, Weights};

use crate::TrainError;
use crate::lanes::LANES;
use crate::trainer::{Now, Trainer};

impl Trainer<'_> {
    /// All that changes, and what it belongs to.
    pub(crate) fn kept(&self) -> Weights {
        let now = &self.now;
        let mut out = Weights::default();
        let notes = [
            ("format", "muslin-training 1".to_owned()),
            ("identity", self.identity()),
            ("step", now.step.to_string()),
            ("noise", now.noise.state().to_string()),
            ("adam", now.adam.steps.to_string()),
            ("bad", now.bad.to_string()),
        ];
        out.notes.extend(notes.map(|(k, v)| (k.to_owned(), v)));
        let mut add = |name: &str, numbers: Numbers| {
            out.arrays
                .insert(name.into(), Array::new(&[numbers.len()], numbers));
        };
        add("params", Numbers::F32(now.params.clone()));
        add("adam.mean", Numbers::F32(now.adam.mean.clone()));
        add("adam.square", Numbers::F32(now.adam.square.clone()));
        add("modes", Numbers::F32(now.modes.clone()));
        add("momentum", Numbers::F32(now.momentum.clone()));
        add("moments", Numbers::F64(now.moments.clone()));
        add("walls", Numbers::F32(now.walls.as_flattened().to_vec()));
        add(
            "factored",
            Numbers::F32(now.factored.as_flattened().to_vec()),
        );
        add("queue", Numbers::U32(now.queue.clone()));
        let visits = now.packs.iter().map(|p| p.visits as u32).collect();
        add("visits", Numbers::U32(visits));
        let faces = now.packs.iter().flat_map(|p| p.faces.as_flattened());
        add("faces", Numbers::U32(faces.copied().collect()));
        let folds = now.packs.iter().flat_map(|p| p.folds.iter());
        let bits = folds.flat_map(|f| f.1.as_flattened().iter().copied());
        let counts = now.packs.iter().map(|p| p.folds.len() as u32);
        let verts = now.packs.iter().flat_map(|p| p.folds.iter().map(|f| f.0));
        add("folds", Numbers::F32(bits.collect()));
        add("folds.counts", Numbers::U32(counts.collect()));
        add("folds.verts", Numbers::U32(verts.collect()));
        out
    }

    /// Goes on from what [`Trainer::kept`] gave.
    pub(crate) fn go_on(&mut self, kept: &Weights) -> Result<(), TrainError> {
        if kept.notes.get("identity") != Some(&self.identity()) {
            return Err(TrainError::OtherTraining("garment, body, motion or plan"));
        }
        let number = |name: &'static str| {
            let note = kept.notes.get(name).and_then(|n| n.parse::<u64>().ok());
            note.ok_or(TrainError::OtherTraining(name))
        };
        let floats = |name: &'static str, len: Option<usize>| match kept
            .arrays
            .get(name)
            .map(|a| &a.numbers)
        {
            Some(Numbers::F32(v)) if len.is_none_or(|n| v.len() == n) => Ok(v.clone()),
            _ => Err(TrainError::OtherTraining(name)),
        };
        let counts = |name: &'static str| match kept.arrays.get(name).map(|a| &a.numbers) {
            Some(Numbers::U32(v)) => Ok(v.clone()),
            _ => Err(TrainError::OtherTraining(name)),
        };
        let sixes = |v: Vec<f32>| v.as_chunks::<6>().0.to_vec();
        let old = &self.now;
        let moments = match kept.arrays.get("moments").map(|a| &a.numbers) {
            Some(Numbers::F64(v)) if v.len() == old.moments.len() => v.clone(),
            _ => return Err(TrainError::OtherTraining("moments")),
        };
        let steps = number("adam")?;
        let moved = |n: usize| Some(if steps == 0 { 0 } else { n });
        let mut now = Now {
            step: number("step")?,
            noise: Noise::new(number("noise")?),
            params: floats("params", Some(old.params.len()))?,
            adam: AdamState {
                steps,
                mean: floats("adam.mean", moved(old.params.len()))?,
                square: floats("adam.square", moved(old.params.len()))?,
            },
            modes: floats("modes", Some(old.modes.len()))?,
            momentum: floats("momentum", Some(old.momentum.len()))?,
            moments,
            walls: sixes(floats("walls", Some(6 * old.walls.len()))?),
            factored: sixes(floats("factored", Some(6 * old.walls.len()))?),
            packs: old.packs.clone(),
            queue: counts("queue")?,
            bad: number("bad")?,
        };
        let visits = counts("visits")?;
        if visits.len() != now.packs.len() || now.queue.iter().any(|k| *k as usize >= visits.len())
        {
            return Err(TrainError::OtherTraining("visits"));
        }
        let faces = counts("faces")?;
        let mut rest = faces.as_chunks::<LANES>().0;
        let (fold_counts, fold_verts) = (counts("folds.counts")?, counts("folds.verts")?);
        let folds = floats("folds", Some(4 * LANES * fold_verts.len()))?;
        let fold_planes = folds.as_chunks::<LANES>().0.as_chunks::<4>().0;
        let mut folds = fold_verts.into_iter().zip(fold_planes.iter().copied());
        for (pack, count) in now.packs.iter_mut().zip(fold_counts) {
            pack.folds = folds.by_ref().take(count as usize).collect();
        }
        for (pack, visits) in now.packs.iter_mut().zip(visits) {
            pack.visits = u64::from(visits);
            let n = if visits == 0 { 0 } else { now.walls.len() };
            let (own, later) = rest
                .split_at_checked(n)
                .ok_or(TrainError::OtherTraining("faces"))?;
            if own.as_flattened().iter().any(|f| !self.body.has(*f)) {
                return Err(TrainError::OtherTraining("faces"));
            }
            pack.faces = own.to_vec();
            rest = later;
        }
        self.now = now;
        self.refactor();
        Ok(())
    }
}
