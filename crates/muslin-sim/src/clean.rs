//! The end of a drape: nothing of the body may show through, by exact predicates.
//!
//! Cloth that crosses itself is drawn apart as far as that goes. Where the body pokes through a
//! face, its flesh yields to the cloth: pushing the cloth off instead stretches what is tight. Only
//! what is too thin to yield, a finger on a knee, is covered better: the face's vertices keep more
//! distance, and its inside begins to touch as well.

use glam::DVec3;
use muslin_geom::{Surface, vertex_normals};

use crate::{cloth::SimError, quality::Settled, relief, stage::Stage, weave::Weave};

/// Rounds of untangling and covering at the end.
const CLEANINGS: usize = 8;
/// What a round adds to the distance kept from the skin, and the most it may add up to [m].
const LIFT: f64 = 0.7e-3;
const MOST_LIFT: f64 = 8e-3;
/// Rounds in which the flesh yields, what each takes, and the most that any place gives [m]:
/// where there is flesh, and where there is hardly any.
const YIELDS: usize = 40;
const GIVE: f64 = 1e-3;
const MOST_GIVE: [f64; 2] = [0.035, 0.004];
/// Between them, in the folds of armpits, a share of the way to the core, where that is no shorter than this [m]:
/// longer than in any hand.
const FOLD_GIVES: f64 = 0.5;
const FOLD: f64 = 0.018;
/// By how much files round cloth and skin together at most, stored in 16 bits over a body [m].
const ROUNDED: f64 = 6e-5;

/// Makes the cloth clean, and measures it as `weave`. `cores`: as in [`relief::Frame`].
pub(crate) fn finish(
    stage: &mut Stage<'_>,
    (weave, cores): (&Weave, &[DVec3]),
) -> Result<Settled, SimError> {
    let speed_p99 = stage.speed();
    let mut rounds = 0;
    let (tangles, hits) = loop {
        let (tangles, hits) = (stage.find_tangles(), stage.in_body());
        let thin = thin_hits(stage, &hits, cores);
        if rounds == CLEANINGS || (thin.is_empty() && tangles == 0) {
            break (tangles, hits);
        }
        rounds += 1;
        cover(stage, thin);
        for _ in 0..2 {
            stage.v.fill(DVec3::ZERO);
            stage.calm_step()?;
        }
    };
    let given = give(stage, hits, cores);
    // What is stored is rounded: cloth must be clear of the skin by more than that.
    let clear = nearer(stage);
    let lies = std::mem::replace(&mut stage.x, clear);
    let hits = stage.in_body();
    let cleared = give(stage, hits, cores);
    stage.x = lies;
    let left = match cleared.yielded > 0.0 {
        true => stage.in_body().len(),
        false => given.left,
    };
    let yielded = given.yielded.max(cleared.yielded);
    let measured = Settled::measure(weave, stage.x.clone(), &stage.body.now, (tangles, left));
    Ok(Settled {
        steps: stage.steps,
        speed_p99,
        yielded,
        ..measured
    })
}

/// The cloth, nearer to what is under it by what rounding may bring them together.
fn nearer(stage: &Stage<'_>) -> Vec<DVec3> {
    let normals = vertex_normals(&stage.x, &stage.weave.faces);
    let all = stage.x.iter().zip(normals);
    all.map(|(x, n)| *x - n * ROUNDED).collect()
}

/// A frame of a motion, made clean.
pub(crate) struct Tidy {
    /// The body to deliver [m].
    pub skin: Vec<DVec3>,
    /// How far it yielded for that [m].
    pub yielded: f64,
    /// The pairs of triangles that meet all the same.
    pub left: usize,
}

/// Makes a frame of a motion clean.
///
/// The next frame starts from the body as it was: a dent made here is this frame's own.
pub(crate) fn tidy(stage: &mut Stage<'_>, cores: &[DVec3]) -> Tidy {
    let mut skin = stage.body.now.verts().to_vec();
    let hits = stage.in_body();
    let Given { yielded, left } = give(stage, hits, cores);
    if yielded > 0.0 {
        let dented = stage.body.now.verts().to_vec();
        stage.body.now.refit(&skin);
        stage.body.forget();
        skin = dented;
    }
    Tidy {
        skin,
        yielded,
        left,
    }
}

/// Faces of the cloth that something thin of the body pokes through, of all `hits`.
fn thin_hits(stage: &Stage<'_>, hits: &[[u32; 2]], cores: &[DVec3]) -> Vec<u32> {
    let skin = &stage.body.now;
    let is_thin = |hit: &&[u32; 2]| {
        let corners = skin.faces()[hit[1] as usize];
        !corners
            .iter()
            .any(|&v| relief::is_soft(skin, cores, v as usize))
    };
    let mut faces: Vec<u32> = hits.iter().filter(is_thin).map(|h| h[0]).collect();
    faces.dedup();
    faces
}

/// Keeps cloth farther away where the body pokes through it.
fn cover(stage: &mut Stage<'_>, faces: Vec<u32>) {
    for &f in &faces {
        for v in stage.weave.faces[f as usize] {
            let extra = &mut stage.body.extra[v as usize];
            *extra = (*extra + LIFT).min(MOST_LIFT);
        }
    }
    stage.poked.extend(faces);
    stage.poked.sort_unstable();
    stage.poked.dedup();
    stage.body.forget();
}

/// How far the skin of a vertex that lies at `first` gives at most [m].
fn most_given(skin: &Surface, (cores, first): (&[DVec3], DVec3), v: usize) -> f64 {
    let way = cores.get(v).map(|core| core.distance(first));
    match way {
        Some(way) if way >= relief::SOFT => MOST_GIVE[0],
        Some(way) if way >= FOLD => FOLD_GIVES * way,
        Some(_) => MOST_GIVE[1],
        None => MOST_GIVE[usize::from(!relief::is_soft(skin, cores, v))],
    }
}

/// How skin was drawn back.
struct Given {
    /// How far at most [m].
    yielded: f64,
    /// The pairs of triangles that meet all the same.
    left: usize,
}

/// Draws the skin back where it still meets cloth; `hits`: the pairs of triangles that do.
fn give(stage: &mut Stage<'_>, mut hits: Vec<[u32; 2]>, cores: &[DVec3]) -> Given {
    let n = stage.body.now.verts().len();
    let mut given = vec![0.0; n];
    // As thick as the flesh is before it yields: it is pressed thinner on the way.
    let first = stage.body.now.verts().to_vec();
    let mut gives: Vec<Option<f64>> = vec![None; n];
    for _ in 0..YIELDS {
        if hits.is_empty() {
            break;
        }
        let skin = &stage.body.now;
        let mut depth = vec![0.0; n];
        for v in hits.iter().flat_map(|h| skin.faces()[h[1] as usize]) {
            let v = v as usize;
            let most = *gives[v].get_or_insert_with(|| most_given(skin, (cores, first[v]), v));
            if depth[v] == 0.0 && given[v] < most {
                depth[v] = GIVE;
            }
        }
        let dented = relief::dented(skin, (cores, stage.body.near()), depth, |v| {
            given[v] < MOST_GIVE[0]
        });
        for v in 0..n {
            given[v] += dented[v].distance(skin.verts()[v]);
        }
        stage.body.now.refit(&dented);
        hits = stage.in_body();
    }
    Given {
        yielded: given.into_iter().fold(0.0, f64::max),
        left: hits.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::balls;

    #[test]
    fn flesh_gives_as_far_as_it_was_thick_before_it_gave() {
        let (skin, faces) = balls(0.4);
        let skin = Surface::new(&skin, &faces);
        let at = skin.verts()[0];
        let most = |deep: f64| most_given(&skin, (&[at + DVec3::X * deep], at), 0);
        assert_eq!(most(0.03), 0.035);
        // The fold of an armpit; a finger.
        assert!((most(0.022) - 0.011).abs() < 1e-12);
        assert_eq!(most(0.009), 0.004);
        // Pressed to where it lies now, it was thicker before.
        let first = at - DVec3::X * 0.02;
        let pressed = most_given(&skin, (&[at + DVec3::X * 0.01], first), 0);
        assert_eq!(pressed, 0.035);
    }
}
