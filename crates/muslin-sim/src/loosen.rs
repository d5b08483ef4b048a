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
};

/// How far the body draws in [m].
const DEPTH: f64 = 0.015;
/// Steps of drawing in, of waiting, and of coming back.
const STEPS: [usize; 3] = [5, 15, 10];

/// Whether more than one in a hundred faces of some material stretches beyond its limit.
pub(crate) fn is_caught(cloth: &Cloth, x: &[DVec3]) -> bool {
    let all = stretch(&cloth.faces, &cloth.rest, x);
    let limits = cloth.materials.iter().map(|m| m.limit).enumerate();
    limits.filter_map(|(k, l)| Some((k, l?))).any(|(k, limit)| {
        let own = all.iter().zip(&cloth.material_of);
        let mut own: Vec<f64> = own
            .filter(|(_, of)| **of as usize == k)
            .map(|p| *p.0)
            .collect();
        percentile(&mut own, 0.99) > limit
    })
}

/// Takes the body in and out again, the cloth moving freely all the while.
pub(crate) fn loosen(stage: &mut Stage<'_>, body: &Frame, go_on: GoOn<'_>) -> Result<(), SimError> {
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
