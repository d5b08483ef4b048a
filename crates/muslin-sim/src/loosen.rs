//! Cloth that is caught, let go: in a deep fold of the body, between two legs, behind a knee.
//!
//! A person in a tight spot tugs at the cloth until it lies well. Here the body draws in for a
//! moment, the cloth finds its way through the wider folds, and the body comes back.

use glam::DVec3;

use crate::{
    cloth::{Cloth, SimError},
    drape::{GoOn, asked},
    quality::{percentile, stretch},
    relief::{Frame, given},
    stage::Stage,
    weave::Weave,
};

/// How far the body draws in [m].
const DEPTH: f64 = 0.015;
/// Steps of drawing in, of waiting, and of coming back.
const STEPS: [usize; 3] = [5, 15, 10];

/// Tugs at cloth that is caught, up to `tugs` times, and leaves it as it lay best.
///
/// `firm`: the same cloth with firmer walls, which it has from the first tug on. `converged`:
/// whether it has come to rest; returns whether it has in the end.
pub(crate) fn let_go<'a>(
    (stage, converged): (&mut Stage<'a>, bool),
    (cloth, body, firm): (&Cloth, &Frame, &'a Weave),
    (tugs, go_on): (usize, GoOn<'_>),
) -> Result<bool, SimError> {
    let mut best = (strained(cloth, &stage.x), stage.x.clone(), converged);
    for _ in 0..tugs {
        if best.0 <= 1.0 {
            break;
        }
        stage.weave = firm;
        stage.slip_pins();
        loosen(stage, body, go_on)?;
        let converged = stage.settle(go_on)?;
        let now = strained(cloth, &stage.x);
        if now < best.0 {
            best = (now, stage.x.clone(), converged);
        }
    }
    if best.1 != stage.x {
        stage.restore(&best.1, &vec![DVec3::ZERO; best.1.len()]);
    }
    Ok(best.2)
}

/// What one face in a hundred of some material stretches by at least, as a share of its limit:
/// the material's for which that is most.
fn strained(cloth: &Cloth, x: &[DVec3]) -> f64 {
    let all = stretch(&cloth.faces, &cloth.rest, x);
    let limits = cloth.materials.iter().map(|m| m.limit).enumerate();
    let share = |(k, limit): (usize, f64)| {
        let own = all.iter().zip(&cloth.material_of);
        let mut own: Vec<f64> = own
            .filter(|(_, of)| **of as usize == k)
            .map(|p| *p.0)
            .collect();
        percentile(&mut own, 0.99) / limit
    };
    let limited = limits.filter_map(|(k, l)| Some((k, l?)));
    limited.map(share).fold(0.0, f64::max)
}

/// Takes the body in and out again, the cloth moving freely all the while.
fn loosen(stage: &mut Stage<'_>, body: &Frame, go_on: GoOn<'_>) -> Result<(), SimError> {
    let normals = stage.body.now.vertex_normals().to_vec();
    let drawn_in = |share: f64| -> Vec<DVec3> {
        let at = |i: usize| {
            let by = (body.cores.get(i), DEPTH * share);
            given(body.skin[i], normals[i], by)
        };
        (0..body.skin.len()).map(at).collect()
    };
    let [down, wait, up] = STEPS;
    let way = (1..=down).map(|k| k as f64 / down as f64);
    let way = way.chain(std::iter::repeat_n(1.0, wait));
    for share in way.chain((0..up).rev().map(|k| k as f64 / up as f64)) {
        asked(go_on)?;
        stage.give_way(&drawn_in(share))?;
    }
    Ok(())
}
