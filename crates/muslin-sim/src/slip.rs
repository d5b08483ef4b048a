//! Cloth that is wedged slips before it stretches beyond its limit.
//!
//! Where two folds of the body hold cloth between them, friction is as strong as they press, and a
//! few triangles next to the fold pay for it. Whatever is beyond its limit is drawn back to it,
//! triangle by triangle, and its neighbours after it (the projections of position based dynamics:
//! Müller et al. 2007, on principal stretches).

use glam::DVec3;
use muslin_energy::strain;

use crate::{ordered, touch::Touch, weave::Weave};

/// What a face may be beyond its limit before anything slips, and what is left of that.
const BEYOND: f64 = 5e-3;
const LEFT: f64 = 5e-4;
/// Sweeps over what is beyond, and what is around it: along a fold of the body slack comes from afar.
const SWEEPS: usize = 300;

/// How cloth slips from `x` [m], so that less of it is beyond its limit; none where nothing is.
/// What holds a vertex to the skin gives way as well: skin stretches by more than a waistband does. But into the skin
/// nothing slips: what spans a fold of the body goes along it.
pub(crate) fn moves(weave: &Weave, x: &[DVec3], touches: &[Touch]) -> Option<Vec<DVec3>> {
    let is_beyond = |f: usize| beyond(weave, x, f).is_some_and(|b| b.0 > BEYOND);
    let mut known = ordered::map(weave.faces.len(), is_beyond);
    let mut asked: Vec<usize> = (0..known.len()).filter(|f| known[*f]).collect();
    if asked.is_empty() {
        return None;
    }
    let mut at = x.to_vec();
    let mut touching = vec![None; x.len()];
    for touch in touches.iter().filter(|t| t.face.is_none()) {
        touching[touch.verts[0] as usize] = Some(touch);
    }
    for _ in 0..SWEEPS {
        let mut moved = Vec::new();
        for &f in &asked {
            let Some((over, pull)) = beyond(weave, &at, f).filter(|b| b.0 > LEFT) else {
                continue;
            };
            let size: f64 = pull.iter().map(|p| p.length_squared()).sum();
            for (v, pull) in weave.faces[f].into_iter().zip(pull) {
                let v = v as usize;
                let to = at[v] - pull * (over / size);
                at[v] = to + touching[v].map_or(DVec3::ZERO, |t: &Touch| t.lift(x[v], to));
                moved.push(v);
            }
        }
        if moved.is_empty() {
            break;
        }
        let around = moved.iter().flat_map(|v| weave.pattern.corners.row(*v));
        asked.extend(
            around
                .map(|corner| *corner as usize / 3)
                .filter(|f| !std::mem::replace(&mut known[*f], true)),
        );
        asked.sort_unstable();
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
    use muslin_energy::contact::Barrier;

    use super::*;
    use crate::{quality, testing::sheets};

    /// Cloth that may stretch by 5 %, a little slack [m].
    fn slack() -> (Weave, Vec<DVec3>) {
        let (mut cloth, flat) = sheets(0.1);
        cloth.materials[0].limit = Some(0.05);
        let weave = Weave::new(&cloth).expect("a valid cloth");
        (weave, flat.iter().map(|p| *p * 0.99).collect())
    }

    #[test]
    fn a_pulled_vertex_shares_its_stretch_with_the_cloth_around_it() {
        let (weave, mut x) = slack();
        assert_eq!(moves(&weave, &x, &[]), None);
        x[66].z += 5e-3;
        assert!(quality::excess(&weave, &x) > 0.05);
        let moves = moves(&weave, &x, &[]).expect("it is far beyond its limit");
        let slipped: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        let left = quality::excess(&weave, &slipped);
        assert!(left < BEYOND, "{left}");
        // No more than needed, and nobody is carried away.
        assert_eq!(moves[0], DVec3::ZERO);
        assert!(moves.iter().all(|m| m.length() < 5e-3));
        assert!(moves.iter().sum::<DVec3>().length() < 1e-12);
    }

    #[test]
    fn what_skin_holds_up_stays_and_the_cloth_around_it_comes() {
        let (weave, mut x) = slack();
        x[66].z += 5e-3;
        let barrier = Barrier {
            radius: 3e-3,
            width: 1e-3,
            stiffness: 400.0,
        };
        let on_skin = Touch {
            verts: [66; 3],
            weights: [1.0, 0.0, 0.0],
            face: None,
            skin: x[66] - DVec3::Z * 1e-3,
            normal: DVec3::Z,
            stuck: x[66],
            barrier,
            grip: 0.0,
            stick: 1e-4,
        };
        let moves = moves(&weave, &x, &[on_skin]).expect("it is far beyond its limit");
        let slipped: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        let left = quality::excess(&weave, &slipped);
        assert!(left < BEYOND, "{left}");
        assert!(moves[66].z > -1e-9, "{}", moves[66]);
        assert!(moves.iter().all(|m| m.length() < 5e-3));
    }
}
