//! Cloth that is wedged slips before it stretches beyond its limit.
//!
//! Where two folds of the body hold cloth between them, friction is as strong as they press, and a
//! few triangles next to the fold pay for it. Whatever is beyond its limit is drawn back to it,
//! triangle by triangle, and its neighbours after it (the projections of position based dynamics:
//! Müller et al. 2007, on principal stretches).

use glam::DVec3;
use muslin_energy::strain;

use crate::{ordered, weave::Weave};

/// What a face may be beyond its limit before anything slips; it is drawn back to the limit.
const BEYOND: f64 = 5e-3;
/// Sweeps over what is beyond, and what is around it.
const SWEEPS: usize = 30;

/// How cloth slips from `x` [m], so that less of it is beyond its limit; none where nothing is.
/// What holds a vertex to the skin gives way as well: skin stretches by more than a waistband does.
pub(crate) fn moves(weave: &Weave, x: &[DVec3]) -> Option<Vec<DVec3>> {
    let is_beyond = |f: usize| beyond(weave, x, f).is_some_and(|b| b.0 > BEYOND);
    let mut asked = ordered::map(weave.faces.len(), is_beyond);
    if !asked.contains(&true) {
        return None;
    }
    let mut at = x.to_vec();
    for _ in 0..SWEEPS {
        let mut moved = Vec::new();
        for f in (0..asked.len()).filter(|f| asked[*f]) {
            let Some((over, pull)) = beyond(weave, &at, f).filter(|b| b.0 > 0.0) else {
                continue;
            };
            let size: f64 = pull.iter().map(|p| p.length_squared()).sum();
            for (v, pull) in weave.faces[f].into_iter().zip(pull) {
                at[v as usize] -= pull * (over / size);
                moved.push(v as usize);
            }
        }
        if moved.is_empty() {
            break;
        }
        for v in moved {
            for corner in weave.pattern.corners.row(v) {
                asked[*corner as usize / 3] = true;
            }
        }
    }
    Some(at.iter().zip(x).map(|(to, from)| *to - *from).collect())
}

/// By how much a face is beyond its limit, and how that grows with its corners [1/m].
fn beyond(weave: &Weave, x: &[DVec3], f: usize) -> Option<(f64, [DVec3; 3])> {
    let patch = &weave.patches[f];
    let limit = patch.limit.as_ref()?;
    let deformation = patch.rest.deformation(&weave.corners(x, f));
    if limit.is_far_from(&deformation) {
        return None;
    }
    let [u, v] = deformation;
    let [cos, sin] = strain::direction(&deformation);
    let along = u * cos + v * sin;
    let length = along.length();
    let pull = |k: usize| {
        let [to_u, to_v] = patch.rest.slope(k);
        along * ((cos * to_u + sin * to_v) / length)
    };
    Some((length - 1.0 - limit.limit, [0, 1, 2].map(pull)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{quality, testing::sheets};

    #[test]
    fn a_pulled_vertex_shares_its_stretch_with_the_cloth_around_it() {
        let (mut cloth, flat) = sheets(0.1);
        cloth.materials[0].limit = Some(0.05);
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let mut x: Vec<DVec3> = flat.iter().map(|p| *p * 0.99).collect();
        assert_eq!(moves(&weave, &x), None);
        x[66].z += 5e-3;
        assert!(quality::excess(&weave, &x) > 0.05);
        let moves = moves(&weave, &x).expect("it is far beyond its limit");
        let slipped: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        let left = quality::excess(&weave, &slipped);
        assert!(left < BEYOND, "{left}");
        // No more than needed, and nobody is carried away.
        assert_eq!(moves[0], DVec3::ZERO);
        assert!(moves.iter().all(|m| m.length() < 5e-3));
        assert!(moves.iter().sum::<DVec3>().length() < 1e-12);
    }
}
