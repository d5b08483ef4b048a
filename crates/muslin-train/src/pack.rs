//! Sixteen poses side by side, with all that does not change while the network learns.

use std::ops::Range;

use muslin_body::Pose;
use muslin_model::Reader;

use crate::ground::Posed;
use crate::lanes::{LANES, Row};
use crate::layers::Near;
use crate::wearer::Wearer;

/// Sixteen poses.
#[derive(Clone, Debug)]
pub struct Pack {
    /// Who is posed, as an index into the trainer's wearers.
    pub wearer: usize,
    /// The poses, as indices into the pool.
    pub poses: [u32; LANES],
    /// What the network is told.
    pub inputs: Vec<Row>,
    /// Transforms of the bones that the cloth follows.
    pub bones: Vec<[Row; 12]>,
    /// The skin's triangle that each vertex was nearest to, in every pose. Empty until it is first
    /// asked for.
    pub faces: Vec<[u32; LANES]>,
    /// Walls where cloth meets cloth, by vertex in order.
    pub folds: Vec<(u32, [Row; 4])>,
    /// Vertices that cloth of other garments is near to, layer after layer.
    pub over: Vec<Near>,
    /// The skin around the cloth in every pose [m]. Empty until it is first asked for.
    pub skins: Vec<Posed>,
    /// How often it was learnt from.
    pub visits: u64,
}

impl Pack {
    /// From poses of the pool for one of the wearers; `rig` names the bones that the cloth follows.
    pub fn new(
        (wearer, poses): (usize, [u32; LANES]),
        pool: &[Pose],
        (wearers, reader, rig): (&[Wearer<'_>], &Reader, &[usize]),
    ) -> Self {
        let Wearer { body, lesson, .. } = &wearers[wearer];
        let mut inputs = vec![[0.0; LANES]; reader.n_inputs()];
        let mut bones = vec![[[0.0; LANES]; 12]; rig.len()];
        let mut told = vec![0.0; reader.n_inputs()];
        for (lane, p) in poses.iter().enumerate() {
            let pose = &pool[*p as usize];
            let all = body.bones(pose);
            reader.read(pose, &all, &mut told);
            inputs
                .iter_mut()
                .zip(&told)
                .for_each(|(row, x)| row[lane] = *x);
            for (bone, b) in bones.iter_mut().zip(rig) {
                let a = all[*b].to_cols_array();
                bone.iter_mut()
                    .zip(a)
                    .for_each(|(row, x)| row[lane] = x as f32);
            }
        }
        let traits = lesson.traits.iter();
        inputs.extend(traits.map(|t| [t.1 as f32; LANES]));
        Self {
            wearer,
            poses,
            inputs,
            bones,
            faces: Vec::new(),
            folds: Vec::new(),
            over: Vec::new(),
            skins: Vec::new(),
            visits: 0,
        }
    }

    /// Whether the nearest skin, and cloth that meets cloth, are to be looked for: often at first, when the cloth moves
    /// much. Between these looks skin is followed from triangle to triangle.
    pub fn is_due(&self) -> bool {
        due_after(self.visits)
    }

    /// Whether cloth may still be anywhere.
    pub fn is_new(&self) -> bool {
        new_after(self.visits)
    }
}

fn due_after(visits: u64) -> bool {
    new_after(visits) || visits.is_multiple_of(16)
}

fn new_after(visits: u64) -> bool {
    matches!(visits, 0 | 2 | 6)
}

/// How many of these steps meet packs that are due, where `each` of `packs` are met in a step and all of them in every
/// round.
pub(crate) fn looks(steps: &Range<u64>, packs: u64, each: u64) -> u64 {
    let (packs, each) = (packs.max(1), each.max(1));
    let met = |round: u64| (round * packs / each, ((round + 1) * packs - 1) / each + 1);
    let rounds = steps.start * each / packs..steps.end * each / packs + 1;
    let due = rounds.filter(|round| due_after(*round)).map(met);
    let within = due.map(|(first, end)| end.min(steps.end).saturating_sub(first.max(steps.start)));
    within
        .sum::<u64>()
        .min(steps.end.saturating_sub(steps.start))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_counted_as_packs_are_met() {
        for (packs, each) in [(5, 2), (125, 2), (4, 4), (3, 1)] {
            // As a trainer does: all packs once a round, and a step where one of them is due looks.
            let is_due = |step: u64| (step * each..(step + 1) * each).any(|k| due_after(k / packs));
            for steps in [0..1, 0..40, 17..18, 30..400] {
                let want = steps.clone().filter(|s| is_due(*s)).count() as u64;
                assert_eq!(
                    looks(&steps, packs, each),
                    want,
                    "{packs}, {each}, {steps:?}"
                );
            }
        }
    }
}
