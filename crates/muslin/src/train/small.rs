//! A model's file: as small as its frames allow.

use muslin_body::{Avatar, Motion, Pose};
use muslin_model::{Model, ModelError, Precision};
use muslin_net::Weights;

use super::lessons::Pupil;
use crate::animate::model_failure;
use crate::failure::Failure;
use crate::swings;

/// How far a vertex may be moved by packing shapes [m]; with more they stay 16-bit floats.
const MOST: f64 = 5e-4;
/// Poses and wearers that are looked at, at most.
const POSES: usize = 64;
const WEARERS: usize = 8;

/// So many of a list at most, evenly spread.
fn some<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let n = all.len().min(most);
    (0..n).map(move |k| &all[k * all.len() / n])
}

/// Poses of the motions that the file is judged by.
pub(super) fn shown(motions: &[Motion]) -> Vec<Pose> {
    let all: Vec<&Pose> = motions.iter().flat_map(|m| &m.poses).collect();
    some(&all, POSES).map(|p| (*p).clone()).collect()
}

/// A model as arrays.
pub(super) struct Stored {
    pub weights: Weights,
    pub precision: Precision,
    /// How far packing its shapes moves a vertex from where 16-bit floats have it, at most [m], where they are packed.
    pub off: Option<f64>,
    /// The same of what was asked for and moves one too far.
    pub too_far: Option<f64>,
}

/// The arrays of a model in numbers of the precision that is asked for, of 12-bit steps if none is; but shapes are in
/// steps only where that moves no vertex far: on those who were learnt from, in these poses.
pub(super) fn stored(
    (model, avatar): (&Model, &Avatar),
    (pupils, poses): (&[Pupil], &[Pose]),
    asked: Option<Precision>,
) -> Result<Stored, Failure> {
    let read = |w: &Weights| Model::from_weights(w).map_err(|e| model_failure(&e));
    let (steps, floats) = match (asked, swings::are_ours(model)) {
        (Some(Precision::Single), _) => (&[][..], Precision::Single),
        (Some(Precision::Half), _) | (_, false) => (&[][..], Precision::Half),
        (Some(Precision::Eight), true) => {
            (&[Precision::Eight, Precision::Twelve][..], Precision::Half)
        }
        (Some(Precision::Twelve) | None, true) => (&[Precision::Twelve][..], Precision::Half),
    };
    let usual = read(&model.to_weights())?;
    let mut too_far = None;
    for &precision in steps {
        let weights = model.to_weights_in(precision);
        let packed = read(&weights)?;
        let mut worst = 0.0f64;
        for pupil in some(pupils, WEARERS) {
            let apart = apart((&usual, &packed), (avatar, pupil), poses);
            worst = worst.max(apart.map_err(|e| model_failure(&e))?);
        }
        if worst <= MOST {
            return Ok(Stored {
                weights,
                precision,
                off: Some(worst),
                too_far,
            });
        }
        too_far.get_or_insert(worst);
    }
    Ok(Stored {
        weights: model.to_weights_in(floats),
        precision: floats,
        off: None,
        too_far,
    })
}

/// What numbers of a precision are called.
pub(super) fn name(precision: Precision) -> &'static str {
    match precision {
        Precision::Single => "32-bit floats",
        Precision::Half => "16-bit floats",
        Precision::Twelve => "12-bit steps",
        Precision::Eight => "8-bit steps",
    }
}

/// How far apart two models put a vertex, at most [m].
fn apart(
    (one, other): (&Model, &Model),
    (avatar, pupil): (&Avatar, &Pupil),
    poses: &[Pose],
) -> Result<f64, ModelError> {
    let player = |model: &Model| pupil.player(model.clone(), avatar);
    let (mut one, mut other) = (player(one)?, player(other)?);
    let mut at = [0, 1].map(|_| vec![[0.0f32; 3]; one.n_verts()]);
    let mut worst = 0.0f32;
    for pose in poses {
        let bones = avatar.bones(&pupil.figure, pose);
        for (player, at) in [&mut one, &mut other].into_iter().zip(&mut at) {
            player.begin(0.1);
            player.frame(pose, &bones, at);
        }
        for (p, q) in at[0].iter().zip(&at[1]) {
            let off: f32 = p.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum();
            worst = worst.max(off);
        }
    }
    Ok(f64::from(worst).sqrt())
}
