//! The end of a drape: nothing of the body may show through, by exact predicates.
//!
//! Where the body pokes through a face, its vertices keep more distance and its inside begins to
//! touch as well; what that does not solve is solved by the flesh, which yields to the cloth.

use glam::DVec3;

use crate::{
    cloth::SimError,
    crossings,
    pattern::Pattern,
    quality::{self, Settled},
    relief,
    stage::Stage,
};

/// Rounds of cleaning at the end.
const CLEANINGS: usize = 12;
/// What a round adds to the distance kept from the skin, and the most it may add up to [m].
const LIFT: f64 = 0.7e-3;
const MOST_LIFT: f64 = 8e-3;
/// Rounds before the flesh begins to yield.
const PATIENCE: usize = 4;
/// What a round takes from the flesh, and the most it may take from any place [m].
const GIVE: f64 = 1.5e-3;
const MOST_GIVE: f64 = 0.02;

/// Makes the cloth clean, and measures it.
pub(crate) fn finish(mut stage: Stage<'_>) -> Result<Settled, SimError> {
    let speed_p99 = stage.speed();
    let mut given = 0.0;
    for round in 0..CLEANINGS {
        let hits = quality::body_intersections(stage.weave, &stage.x, &stage.body.now);
        if hits.is_empty() && !stage.is_tangled() {
            break;
        }
        lift(&mut stage, &hits);
        if round >= PATIENCE && given < MOST_GIVE && !hits.is_empty() {
            give(&mut stage, &hits);
            given += GIVE;
        }
        for _ in 0..2 {
            stage.v.fill(DVec3::ZERO);
            stage.step(0.0)?;
        }
    }
    let crossing = crossings::crossing_faces(stage.weave, &mut stage.tree, &stage.x).len();
    let measured = Settled::measure(stage.weave, stage.x, &stage.body.now, crossing);
    Ok(Settled {
        steps: stage.steps,
        speed_p99,
        yielded: given,
        ..measured
    })
}

/// Keeps cloth farther away where the body pokes through it.
fn lift(stage: &mut Stage<'_>, hits: &[[u32; 2]]) {
    let mut faces: Vec<u32> = hits.iter().map(|h| h[0]).collect();
    faces.dedup();
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

/// Draws the skin back where it meets cloth.
fn give(stage: &mut Stage<'_>, hits: &[[u32; 2]]) {
    let skin = &stage.body.now;
    let mut depth = vec![0.0; skin.verts().len()];
    for hit in hits {
        for v in skin.faces()[hit[1] as usize].map(|v| v as usize) {
            if depth[v] == 0.0 && relief::is_soft(skin, v) {
                depth[v] = GIVE;
            }
        }
    }
    let pattern = Pattern::new(skin.verts().len(), skin.faces());
    let dented = relief::dented(skin, &pattern.near, depth, |_| true);
    stage.body.now.refit(&dented);
    stage.body.stand();
}
