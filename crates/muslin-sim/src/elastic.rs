//! Stretch of all faces: energy, gradient, matrix blocks.

use glam::{DVec3, Mat3A};
use muslin_energy::{InPlane, membrane, strain};

use crate::{
    matrix::narrow,
    ordered,
    weave::{Patch, Weave},
};

/// Energy of stretch and of the strain limit [J].
pub(crate) fn energy(weave: &Weave, x: &[DVec3]) -> f64 {
    ordered::sum(weave.faces.len(), |range| {
        range
            .map(|f| {
                let patch = &weave.patches[f];
                let deformation = patch.rest.deformation(&weave.corners(x, f));
                let limit = patch
                    .limit
                    .map_or(0.0, |l| strain::principal_density(&deformation, &l));
                (membrane::density(&deformation, &patch.stretch) + limit) * patch.rest.area
            })
            .sum()
    })
}

/// What a face answers: its stress [N/m], and as columns weft and warp the stiffness [N/m], which
/// only has to be about right.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answer {
    stress: [DVec3; 2],
    stiffness: [Mat3A; 3],
}

/// What every face answers at `x` [m].
pub(crate) fn answers(weave: &Weave, x: &[DVec3]) -> Vec<Answer> {
    ordered::map(weave.faces.len(), |f| {
        let InPlane {
            stress, hessian, ..
        } = response(&weave.patches[f], &weave.corners(x, f));
        Answer {
            stress,
            stiffness: hessian.map(|h| narrow(&h)),
        }
    })
}

fn response(patch: &Patch, corners: &[DVec3; 3]) -> InPlane {
    let deformation = patch.rest.deformation(corners);
    let mut out = membrane::response(&deformation, &patch.stretch);
    if let Some(limit) = &patch.limit {
        out.add(&strain::principal(&deformation, limit));
    }
    out
}

/// Gradient at vertex `i` [N].
pub(crate) fn gradient(weave: &Weave, answers: &[Answer], i: usize) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for &corner in weave.pattern.corners.row(i) {
        let (f, a) = (corner as usize / 3, corner as usize % 3);
        let [u, v] = weave.patches[f].rest.slope(a);
        let [su, sv] = answers[f].stress;
        sum += (su * u + sv * v) * weave.patches[f].rest.area;
    }
    sum
}

/// Adds row `i`'s blocks, whose places start at `first`, to `blocks`.
pub(crate) fn add_row(
    weave: &Weave,
    answers: &[Answer],
    (i, first): (usize, usize),
    blocks: &mut [Mat3A],
) {
    for &corner in weave.pattern.corners.row(i) {
        let (f, a) = (corner as usize / 3, corner as usize % 3);
        let rest = &weave.patches[f].rest;
        let [u, v] = rest.slope(a).map(|s| (s * rest.area) as f32);
        let [uu, uv, vv] = &answers[f].stiffness;
        let left = *uu * u + uv.transpose() * v;
        let right = *uv * u + *vv * v;
        for b in 0..3 {
            let [u, v] = rest.slope(b).map(|s| s as f32);
            let place = weave.pattern.places[f][a][b] as usize - first;
            blocks[place] += left * u + right * v;
        }
    }
}
