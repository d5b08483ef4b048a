//! Stretch of all faces: energy, gradient, matrix blocks.

use glam::{DMat3, DVec3};
use muslin_energy::{InPlane, membrane, strain};

use crate::{
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

/// What every face answers at `x` [m].
pub(crate) fn responses(weave: &Weave, x: &[DVec3]) -> Vec<InPlane> {
    ordered::map(weave.faces.len(), |f| {
        let patch = &weave.patches[f];
        response(patch, &weave.corners(x, f))
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
pub(crate) fn gradient(weave: &Weave, answers: &[InPlane], i: usize) -> DVec3 {
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
    answers: &[InPlane],
    (i, first): (usize, usize),
    blocks: &mut [DMat3],
) {
    for &corner in weave.pattern.corners.row(i) {
        let (f, a) = (corner as usize / 3, corner as usize % 3);
        let rest = &weave.patches[f].rest;
        let [u, v] = rest.slope(a);
        let [uu, uv, vv] = &answers[f].hessian;
        let left = (*uu * u + uv.transpose() * v) * rest.area;
        let right = (*uv * u + *vv * v) * rest.area;
        for b in 0..3 {
            let [u, v] = rest.slope(b);
            let place = weave.pattern.places[f][a][b] as usize - first;
            blocks[place] += left * u + right * v;
        }
    }
}
