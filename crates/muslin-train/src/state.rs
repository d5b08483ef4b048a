//! A training as named arrays, to go on from to the same bits.

use muslin_net::{Numbers, Weights};

use crate::TrainError;
use crate::kept::{Common, Kept, add};
use crate::lanes::LANES;
use crate::layers::Near;
use crate::pack::Pack;
use crate::trainer::{Now, Trainer};

impl Trainer<'_> {
    /// All that changes, and what it belongs to.
    pub(crate) fn kept(&self) -> Weights {
        let now = &self.now;
        let all = Common {
            step: now.step,
            noise: &now.noise,
            params: &now.params,
            adam: &now.adam,
            queue: &now.queue,
            bad: now.bad,
        };
        let mut out = all.written("muslin-training 1", self.identity());
        let mut add = |name: &str, numbers: Numbers| add(&mut out, name, numbers);
        add("modes", Numbers::F32(now.modes.clone()));
        add("momentum", Numbers::F32(now.momentum.clone()));
        add("moments", Numbers::F64(now.moments.clone()));
        add("walls", Numbers::F32(now.walls.as_flattened().to_vec()));
        add(
            "factored",
            Numbers::F32(now.factored.as_flattened().to_vec()),
        );
        add("factored.at", Numbers::U32(vec![now.factored_at as u32]));
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
        let counts = now.packs.iter().map(|p| p.over.len() as u32);
        let over = || now.packs.iter().flat_map(|p| p.over.iter());
        add("over.counts", Numbers::U32(counts.collect()));
        let whose = over().flat_map(|n| [n.layer, n.vertex]);
        add("over.whose", Numbers::U32(whose.collect()));
        add("over", Numbers::U32(over().flat_map(|n| n.faces).collect()));
        out
    }

    /// Goes on from what [`Trainer::kept`] gave.
    pub(crate) fn go_on(&mut self, kept: &Weights) -> Result<(), TrainError> {
        let kept = Kept::of(kept, &self.identity())?;
        let sixes = |v: Vec<f32>| v.as_chunks::<6>().0.to_vec();
        let old = &self.now;
        let moments = match kept.numbers("moments")? {
            Numbers::F64(v) if v.len() == old.moments.len() => v.clone(),
            _ => return Err(TrainError::OtherTraining("moments")),
        };
        let mut now = Now {
            step: kept.number("step")?,
            noise: kept.noise()?,
            params: kept.floats("params", old.params.len())?,
            adam: kept.adam(old.params.len())?,
            modes: kept.floats("modes", old.modes.len())?,
            momentum: kept.floats("momentum", old.momentum.len())?,
            moments,
            walls: sixes(kept.floats("walls", 6 * old.walls.len())?),
            factored: sixes(kept.floats("factored", 6 * old.walls.len())?),
            factored_at: kept
                .counts("factored.at")?
                .first()
                .map_or(0, |s| u64::from(*s)),
            packs: old.packs.clone(),
            queue: kept.counts("queue")?,
            bad: kept.number("bad")?,
        };
        let visits = kept.counts("visits")?;
        if visits.len() != now.packs.len() || now.queue.iter().any(|k| *k as usize >= visits.len())
        {
            return Err(TrainError::OtherTraining("visits"));
        }
        let faces = kept.counts("faces")?;
        let mut rest = faces.as_chunks::<LANES>().0;
        let (fold_counts, fold_verts) = (kept.counts("folds.counts")?, kept.counts("folds.verts")?);
        let folds = kept.floats("folds", 4 * LANES * fold_verts.len())?;
        let fold_planes = folds.as_chunks::<LANES>().0.as_chunks::<4>().0;
        let mut folds = fold_verts.into_iter().zip(fold_planes.iter().copied());
        for (pack, count) in now.packs.iter_mut().zip(fold_counts) {
            pack.folds = folds.by_ref().take(count as usize).collect();
        }
        self.read_over(&kept, &mut now.packs)?;
        for (pack, visits) in now.packs.iter_mut().zip(visits) {
            pack.visits = u64::from(visits);
            let n = if visits == 0 { 0 } else { now.walls.len() };
            let (own, later) = rest
                .split_at_checked(n)
                .ok_or(TrainError::OtherTraining("faces"))?;
            if own
                .as_flattened()
                .iter()
                .any(|f| !self.wearers[pack.wearer].body.has(*f))
            {
                return Err(TrainError::OtherTraining("faces"));
            }
            pack.faces = own.to_vec();
            rest = later;
        }
        self.now = now;
        self.bind();
        self.refactor();
        Ok(())
    }

    /// What garments lie on that are worn with others.
    fn read_over(&self, kept: &Kept<'_>, packs: &mut [Pack]) -> Result<(), TrainError> {
        let [counts, whose, faces] =
            ["over.counts", "over.whose", "over"].map(|name| kept.counts(name));
        let (whose, faces) = (whose?, faces?);
        let whose = whose.as_chunks::<2>().0.iter();
        let mut rest = whose.zip(faces.as_chunks::<LANES>().0);
        for (pack, count) in packs.iter_mut().zip(counts?) {
            let own = rest.by_ref().take(count as usize);
            let near = |(&[layer, vertex], faces): (&[u32; 2], &[u32; LANES])| Near {
                layer,
                vertex,
                faces: *faces,
            };
            pack.over = own.map(near).collect();
            let layers = &self.wearers[pack.wearer].layers;
            let fits = |n: &Near| layers.get(n.layer as usize).is_some_and(|l| l.has(n));
            if pack.over.len() != count as usize || !pack.over.iter().all(fits) {
                return Err(TrainError::OtherTraining("over"));
            }
        }
        Ok(())
    }
}
