//! Who seems to lean a little towards the camera stands upright; who seems to look down a little
//! looks ahead.
//!
//! A lean along the view hardly shows: fifteen degrees make a trunk 3 % shorter in the picture.
//! What remains are a detector's hints in space, and those lean. A lean that is large enough to be
//! seen, or one across the view, is left alone.

use crate::fold::Folded;
use crate::ground::{Step, at_rest};
use crate::guess::Placed;
use glam::DVec3;

/// Trunks that lean less than the first of these are upright; beyond the second they stay [rad].
const LEAN: [f64; 2] = [0.2, 0.45];
/// How exactly shoulders are over hips [m].
const LEAN_SPREAD: f64 = 0.04;
/// The same for the way from the ears to the nose, up or down [rad].
const GAZE: [f64; 2] = [0.3, 0.6];
/// How exactly [m].
const GAZE_SPREAD: f64 = 0.012;

/// Shoulders over hips: markers and weights.
const TRUNK: [(usize, f64); 4] = [(5, 0.5), (6, 0.5), (11, -0.5), (12, -0.5)];
/// The nose before the ears.
const FACE: [(usize, f64); 3] = [(0, 1.0), (3, -0.5), (4, -0.5)];

/// What brings a body that is nearly upright to it. `up`: in the camera's frame.
pub fn upright(folded: &Folded, features: &[DVec3], placed: &Placed, up: DVec3) -> Vec<Step> {
    let rest = Placed::new(folded, features, &at_rest(folded, features));
    let towards = DVec3::Z.reject_from_normalized(up).normalize_or(DVec3::Z);
    let turn = placed.turns[0];
    // Shoulders at rest are not straight over the hips: that goes where the body faces.
    let at_ease = sum(&TRUNK, &rest);
    let lean = turn * DVec3::new(at_ease.x, 0.0, at_ease.z);
    [
        nearly(
            &TRUNK,
            towards,
            lean.dot(towards),
            placed,
            (LEAN, LEAN_SPREAD),
        ),
        nearly(&FACE, up, sum(&FACE, &rest).y, placed, (GAZE, GAZE_SPREAD)),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Draws `along · Σ w x` to `apart` [m], the less the farther it is; none where it is far.
fn nearly(
    ends: &[(usize, f64)],
    along: DVec3,
    apart: f64,
    placed: &Placed,
    ([all, none], spread): ([f64; 2], f64),
) -> Option<Step> {
    let line = sum(ends, placed);
    let off = (along.dot(line) - apart) / line.length().max(1e-6);
    let share = ((none - off.abs()) / (none - all)).clamp(0.0, 1.0);
    (share > 0.0).then(|| Step {
        along,
        ends: ends.to_vec(),
        apart,
        spread: spread / share,
    })
}

fn sum(ends: &[(usize, f64)], placed: &Placed) -> DVec3 {
    ends.iter().map(|&(k, w)| w * placed.markers[k]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::Fitter;
    use glam::DQuat;
    use muslin_body::{Avatar, Shape};

    /// What is wanted of a body that leans this far [rad] and faces this way.
    fn wanted(lean: f64, facing: f64) -> Vec<f64> {
        let avatar = Avatar::embedded().expect("the embedded body");
        let fitter = Fitter::new(&avatar).expect("a human rig");
        let folded = fitter.folded();
        let mut features = vec![DVec3::ZERO; folded.n_features()];
        folded.add_phenotypes(&Shape::default().phenotypes, &mut features);
        let mut guess = at_rest(folded, &features);
        guess.turns[0] = DQuat::from_rotation_x(lean) * DQuat::from_rotation_y(facing);
        let placed = Placed::new(folded, &features, &guess);
        let steps = upright(folded, &features, &placed, DVec3::Y);
        steps.iter().map(|s| s.tie(&placed).miss).collect()
    }

    #[test]
    fn a_body_at_rest_is_upright_whichever_way_it_faces() {
        for facing in [0.0, 1.0, 3.0] {
            let misses = wanted(0.0, facing);
            assert!(
                misses.len() == 2 && misses.iter().all(|m| m.abs() < 1e-9),
                "{misses:?}"
            );
        }
    }

    #[test]
    fn a_small_lean_is_drawn_up_and_a_large_one_is_left() {
        let misses = wanted(0.15, 0.0);
        assert!(misses[0] > 0.5 && misses[1] < -0.5, "{misses:?}");
        assert_eq!(wanted(0.8, 0.0).len(), 0);
    }
}
