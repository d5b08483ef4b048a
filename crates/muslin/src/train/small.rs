//! A model's file: as small as its frames allow.

use muslin_body::{Avatar, Motion, Pose};
use muslin_model::{Model, ModelError};
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

/// The arrays of a model, packed if that moves no vertex far from where 16-bit floats have it, and how far at most
/// [m]: on those who were learnt from, in these poses.
pub(super) fn stored(
    (model, avatar): (&Model, &Avatar),
    (pupils, poses): (&[Pupil], &[Pose]),
) -> Result<(Weights, Option<f64>), Failure> {
    let whole = model.to_weights();
    if !swings::are_ours(model) {
        return Ok((whole, None));
    }
    let small = model.to_packed();
    let read = |w: &Weights| Model::from_weights(w).map_err(|e| model_failure(&e));
    let (read, usual) = (read(&small)?, read(&whole)?);
    let mut worst = 0.0f64;
    for pupil in some(pupils, WEARERS) {
        let apart = apart((&usual, &read), (avatar, pupil), poses);
        worst = worst.max(apart.map_err(|e| model_failure(&e))?);
    }
    match worst <= MOST {
        true => Ok((small, Some(worst))),
        false => Ok((whole, None)),
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
