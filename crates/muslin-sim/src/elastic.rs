//! Stretch of all faces: energy, gradient, matrix blocks.

use glam::{DVec3, Mat3A};
use muslin_energy::{membrane, strain};

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

/// What a face answers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answer {
    /// Gradient at corners 1 and 2 [N]; that of corner 0 is what is missing to nothing.
    pulls: [DVec3; 2],
    /// How each corner is coupled with the next, as blocks of the matrix [N/m], which only have to be about
    /// right. The other way round it is the transpose, and rows sum to nothing.
    couplings: [Mat3A; 3],
}

/// What every face answers at `x` [m].
pub(crate) fn answers(weave: &Weave, x: &[DVec3]) -> Vec<Answer> {
    ordered::map(weave.faces.len(), |f| {
        let patch = &weave.patches[f];
        let ([su, sv], [uu, uv, vv]) = response(patch, &weave.corners(x, f));
        let slopes = [0, 1, 2].map(|a| patch.rest.slope(a));
        let pull = |[u, v]: [f64; 2]| (su * u + sv * v) * patch.rest.area;
        let vu = uv.transpose();
        let coupling = |a: usize| {
            let [u, v] = slopes[a].map(|s| (s * patch.rest.area) as f32);
            let [to_u, to_v] = slopes[(a + 1) % 3].map(|s| s as f32);
            (uu * u + vu * v) * to_u + (uv * u + vv * v) * to_v
        };
        Answer {
            pulls: [pull(slopes[1]), pull(slopes[2])],
            couplings: [coupling(0), coupling(1), coupling(2)],
        }
    })
}

/// Stress [N/m], and how it changes with the deformation [N/m].
fn response(patch: &Patch, corners: &[DVec3; 3]) -> ([DVec3; 2], [Mat3A; 3]) {
    let deformation = patch.rest.deformation(corners);
    let (mut stress, mut hessian) = membrane::response_single(&deformation, &patch.stretch);
    if let Some(limit) = patch.limit.filter(|l| !l.is_far_from(&deformation)) {
        let wall = strain::principal(&deformation, &limit);
        (0..2).for_each(|i| stress[i] += wall.stress[i]);
        (0..3).for_each(|i| hessian[i] += narrow(&wall.hessian[i]));
    }
    (stress, hessian)
}

/// Gradient at vertex `i` [N].
pub(crate) fn gradient(weave: &Weave, answers: &[Answer], i: usize) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for &corner in weave.pattern.corners.row(i) {
        let [one, two] = answers[corner as usize / 3].pulls;
        sum += match corner % 3 {
            0 => -(one + two),
            1 => one,
            _ => two,
        };
    }
    sum
}

/// Adds row `i`'s blocks but the one on the diagonal to `blocks`, whose places start at `first`.
pub(crate) fn add_row(
    weave: &Weave,
    answers: &[Answer],
    (i, first): (usize, usize),
    blocks: &mut [Mat3A],
) {
    for &corner in weave.pattern.corners.row(i) {
        let (f, a) = (corner as usize / 3, corner as usize % 3);
        let (next, last) = ((a + 1) % 3, (a + 2) % 3);
        let place = |b: usize| weave.pattern.places[f][a][b] as usize - first;
        blocks[place(next)] += answers[f].couplings[a];
        blocks[place(last)] += answers[f].couplings[last].transpose();
    }
}
