//! Cloth that is caught, let go: in a deep fold of the body, between two legs, behind a knee.
//!
//! A person in a tight spot tugs at the cloth until it lies well. Here the body draws in for a
//! moment, the cloth finds its way through the wider folds, and the body comes back.

use glam::DVec3;

use crate::{
    cloth::{Cloth, SimError},
    drape::{GoOn, asked},
    quality::{Settled, percentile, stretch},
    relief::{Frame, given},
    stage::Stage,
    weave::Weave,
};

/// Stretch beyond a material's limit that is still let pass, for one face in a hundred.
pub const BEYOND_LIMIT: f64 = 0.01;
/// How far the body draws in [m].
const DEPTH: f64 = 0.015;
/// Steps of drawing in, of waiting, and of coming back.
const STEPS: [usize; 3] = [5, 15, 10];

/// How cloth came to lie.
pub(crate) struct Lie {
    /// Stretch beyond the limit: what one face in a hundred exceeds.
    beyond: f64,
    /// Positions [m].
    pub x: Vec<DVec3>,
    /// Whether it came to rest.
    pub converged: bool,
}

/// Tugs at cloth that is caught, up to `tugs` times; all the ways it lay, the least strained first. What a tug would
/// tear is not tugged at again.
///
/// `firm`: the same cloth with firmer walls, which it has from the first tug on. `converged`:
/// whether it has come to rest so far.
pub(crate) fn let_go<'a>(
    (stage, converged): (&mut Stage<'a>, bool),
    (cloth, body, firm): (&Cloth, &Frame, &dyn Fn() -> &'a Weave),
    (tugs, go_on): (usize, GoOn<'_>),
) -> Result<Vec<Lie>, SimError> {
    let lie = |stage: &Stage<'_>, converged: bool| Lie {
        beyond: beyond(cloth, &stage.x),
        x: stage.x.clone(),
        converged,
    };
    let mut lies = vec![lie(stage, converged)];
    while lies.len() <= tugs && lies.iter().all(|l| l.beyond > 0.0) {
        stage.weave = firm();
        stage.slip_pins();
        if !loosen(stage, body, go_on)? {
            break;
        }
        let converged = stage.settle(go_on)?;
        if stage.is_torn() {
            break;
        }
        lies.push(lie(stage, converged));
    }
    lies.sort_by(|a, b| a.beyond.total_cmp(&b.beyond));
    Ok(lies)
}

/// How bad cloth lies, worst first: in the body, stretched, through itself.
pub(crate) fn faults(cloth: &Cloth, settled: &Settled) -> [bool; 3] {
    [
        settled.body_intersections > 0,
        beyond(cloth, &settled.verts) > BEYOND_LIMIT,
        settled.self_crossings > 0,
    ]
}

/// What one face in a hundred of some material stretches by at least, less its limit: the
/// material's for which that is most.
pub(crate) fn beyond(cloth: &Cloth, x: &[DVec3]) -> f64 {
    let all = stretch(&cloth.faces, &cloth.rest, x);
    let limits = cloth.materials.iter().map(|m| m.limit).enumerate();
    let beyond = |(k, limit): (usize, f64)| {
        let own = all.iter().zip(&cloth.material_of);
        let mut own: Vec<f64> = own
            .filter(|(_, of)| **of as usize == k)
            .map(|p| *p.0)
            .collect();
        percentile(&mut own, 0.99) - limit
    };
    let limited = limits.filter_map(|(k, l)| Some((k, l?)));
    limited.map(beyond).fold(f64::NEG_INFINITY, f64::max)
}

/// Takes the body in and out again, the cloth moving freely all the while; no if that tears it.
fn loosen(stage: &mut Stage<'_>, body: &Frame, go_on: GoOn<'_>) -> Result<bool, SimError> {
    let normals = stage.body.now.vertex_normals();
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
        if stage.is_torn() {
            return Ok(false);
        }
    }
    Ok(true)
}
