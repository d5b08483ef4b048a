//! What a training needs before its first step.

use muslin_body::Pose;
use muslin_model::{Reader, Skin};
use muslin_net::learn::{Mlp, Noise, Nonlinear};
use rayon::prelude::*;

use crate::TrainError;
use crate::lanes::LANES;
use crate::lesson::{Lesson, Plan};
use crate::pack::Pack;
use crate::wearer::Wearer;

/// A bone that turns less than this in all poses is taken as still [rad].
const TURNS: f64 = 0.01;
/// Inputs are divided by their deviation, or by this where it is less.
const LEAST: f64 = 0.15;

/// The bones that the cloth follows, in the rig's numbering, and how.
pub(crate) fn follow(lesson: &Lesson<'_>) -> Result<(Vec<usize>, Skin), TrainError> {
    let mut rig: Vec<usize> = lesson
        .weights
        .rows()
        .flatten()
        .map(|e| e.0 as usize)
        .collect();
    rig.sort_unstable();
    rig.dedup();
    if rig.len() > 255 {
        return Err(TrainError::ManyBones(rig.len()));
    }
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for row in lesson.weights.rows() {
        for &(b, w) in row {
            let at = rig
                .binary_search(&(b as usize))
                .expect("every bone was listed above");
            skin.bones.push(at as u8);
            skin.weights.push(w as f32);
        }
        skin.starts.push(skin.bones.len() as u32);
    }
    Ok((rig, skin))
}

/// The root, then the bones that move a noticeable share of the cloth and turn in some of the poses.
///
/// A bone that never turns says nothing that its parent does not.
pub(crate) fn drivers<'p>(
    lesson: &Lesson<'_>,
    pool: impl Iterator<Item = &'p Pose> + Clone,
) -> Vec<usize> {
    let mut share = vec![0.0; lesson.avatar.rig().n_bones()];
    let n = lesson.template.len() as f64;
    let all = lesson.weights.rows().flatten();
    all.for_each(|&(b, w)| share[b as usize] += w / n);
    let turns = |b: usize| {
        let mut turns = pool.clone().map(|p| p.rotations[b]);
        let first = turns.next();
        first.is_some_and(|first| turns.any(|q| q.angle_between(first) > TURNS))
    };
    let moving = (1..share.len()).filter(|b| share[*b] > 2e-3 && turns(*b));
    std::iter::once(0).chain(moving).collect()
}

pub(crate) fn encoder(inputs: usize, plan: &Plan) -> Mlp {
    let mut widths = vec![inputs];
    widths.extend(&plan.hidden);
    widths.push(plan.codes - 1);
    Mlp {
        widths,
        bend: Nonlinear::Silu,
        bias: true,
    }
}

/// All poses in packs, in random order, and the packs dealt to the wearers in turns; what does not fill
/// the last pack is left out.
pub(crate) fn packs(
    pool: &[Pose],
    how: (&[Wearer<'_>], &Reader, &[usize]),
    noise: &mut Noise,
) -> Vec<Pack> {
    let mut order: Vec<u32> = (0..pool.len() as u32).collect();
    noise.shuffle(&mut order);
    let lots: Vec<[u32; LANES]> = order.as_chunks::<LANES>().0.to_vec();
    let dealt = |(k, lot): (usize, [u32; LANES])| Pack::new((k % how.0.len(), lot), pool, how);
    lots.into_par_iter().enumerate().map(dealt).collect()
}

/// Brings all inputs to mean 0 and deviation 1; tells mean and 1/deviation of each.
///
/// Inputs that hardly change are not blown up: a pose that was never seen may well change them.
pub(crate) fn standardise(packs: &mut [Pack]) -> Vec<[f32; 2]> {
    let count = (packs.len() * LANES) as f64;
    let n = packs[0].inputs.len();
    let scale: Vec<[f32; 2]> = (0..n)
        .map(|i| {
            let sum = |f: &dyn Fn(f64) -> f64| {
                let all = packs.iter().flat_map(|p| p.inputs[i].iter());
                all.map(|x| f(f64::from(*x))).sum::<f64>() / count
            };
            let mean = sum(&|x| x);
            let deviation = sum(&|x| (x - mean) * (x - mean)).sqrt();
            let inverse = 1.0 / deviation.max(LEAST);
            [mean as f32, inverse as f32]
        })
        .collect();
    rescale(packs, &scale);
    scale
}

/// Applies means and 1/deviations to all inputs.
pub(crate) fn rescale(packs: &mut [Pack], scale: &[[f32; 2]]) {
    for pack in packs {
        for (row, [mean, inverse]) in pack.inputs.iter_mut().zip(scale) {
            row.iter_mut().for_each(|x| *x = (*x - mean) * inverse);
        }
    }
}
