//! Frames that are not clean, reached once more from the nearest clean ones along the motion.

use std::time::Instant;

use glam::DVec3;
use muslin_sim::{
    BEYOND_LIMIT, Cloth, Frame, Options, Refined, Settled, drape, drape_while, stretch,
};

use crate::drape::{LET_GO, to_rest};
use crate::failure::{Exit, Failure};
use crate::simulate::reel::Told;
use crate::simulate::set::Set;
use crate::watch::Watch;

/// Steps at the end of the way to a frame that is reached once more.
const AGAIN: usize = 25;
/// How a frame that is too tight there is let go: all the way to rest, for it is the last that is tried.
const FREED: Options = Options {
    still: 0.0,
    ..LET_GO
};

/// A frame as the solver left it.
pub(crate) struct Solved {
    /// Positions [m].
    pub cloth: Vec<DVec3>,
    /// The body it lies on [m].
    pub body: Vec<DVec3>,
    /// What the solver said.
    pub told: Told,
    /// Pairs of triangles that meet and should not.
    pub faults: usize,
    /// Whether it was reached once more.
    pub again: bool,
}

impl Solved {
    pub fn new(s: Settled, since: Instant, again: bool) -> Self {
        Self {
            faults: faults(&s),
            told: Told {
                yielded: s.yielded,
                body_intersections: s.body_intersections as f64,
                steps: s.steps as f64,
                seconds: since.elapsed().as_secs_f64(),
            },
            cloth: s.verts,
            body: s.body,
            again,
        }
    }
}

impl From<Refined> for Solved {
    fn from(r: Refined) -> Self {
        Self {
            faults: r.body_intersections + r.self_crossings,
            told: Told {
                yielded: r.yielded,
                body_intersections: r.body_intersections as f64,
                steps: r.steps as f64,
                seconds: r.seconds,
            },
            cloth: r.verts,
            body: r.body,
            again: false,
        }
    }
}

/// Reaches every frame that is not clean once more; what that does not better stays as it is.
pub(crate) fn once_more(
    set: &Set,
    solved: &mut [Solved],
    watch: &mut Watch,
) -> Result<(), Failure> {
    let bad: Vec<bool> = solved.iter().map(|s| s.faults > 0).collect();
    let (many, mut i) = (bad.iter().filter(|b| **b).count(), 0);
    inwards(&bad, |k| {
        watch.go_on()?;
        watch.progress(&format!(
            "frame {k} once more, {i} of {many} that are not clean"
        ));
        i += 1;
        reach(set, k, solved, watch)?;
        Ok(solved[k].faults == 0)
    })
}

/// Tries frames that are bad, from both ends of every run of them inwards, for as long as each becomes good: the way to those
/// behind one that does not leads through it.
fn inwards(
    bad: &[bool],
    mut becomes_good: impl FnMut(usize) -> Result<bool, Failure>,
) -> Result<(), Failure> {
    let n = bad.len();
    let mut next = 0;
    while let Some(first) = (next..n).find(|k| bad[*k]) {
        let end = (first..n).find(|k| !bad[*k]).unwrap_or(n);
        let mut left = first;
        // Nothing good lies before the first frame, unless nothing does anywhere.
        if first > 0 || end == n {
            while left < end && becomes_good(left)? {
                left += 1;
            }
            // The one that failed.
            left = (left + 1).min(end);
        }
        let mut right = end;
        while end < n && right > left && becomes_good(right - 1)? {
            right -= 1;
        }
        next = end;
    }
    Ok(())
}

/// Solves frame `k` from the nearest clean one, else from the rest pose; what is too tight there is let go.
pub(crate) fn reach(
    set: &Set,
    k: usize,
    solved: &mut [Solved],
    watch: &mut Watch,
) -> Result<(), Failure> {
    let since = Instant::now();
    let clean = (0..solved.len()).filter(|j| solved[*j].faults == 0);
    let from = clean.min_by_key(|j| j.abs_diff(k));
    let lead = set.moving.lead;
    let (start, way): (&[DVec3], Vec<usize>) = match from {
        Some(j) if j < k => (&solved[j].cloth, (j..=k).map(|i| lead + i).collect()),
        Some(j) => (&solved[j].cloth, (k..=j).rev().map(|i| lead + i).collect()),
        None => (&set.start, (0..=lead + k).collect()),
    };
    let path: Vec<Frame> = way.into_iter().map(|i| set.frame(i)).collect();
    let may_go_on = watch.may_go_on();
    let body = (path.as_slice(), set.avatar.collision_faces());
    let settled = drape_while(&set.cloth, start, body, (&to_rest(AGAIN), &may_go_on));
    watch.go_on()?;
    // What a drape gives up, as too tight, stays as it is.
    if let Some(better) = settled.ok().filter(|s| faults(s) < solved[k].faults) {
        let better = let_go(set, (better, &path[path.len() - 1..]), &may_go_on);
        solved[k] = Solved::new(better, since, true);
    }
    Ok(())
}

/// Cloth that `lies` on the body `here`, let go if it is too tight, where that is no worse otherwise.
fn let_go(
    set: &Set,
    (lies, here): (Settled, &[Frame]),
    go_on: &(dyn Fn() -> bool + Sync),
) -> Settled {
    let tight = beyond(&set.cloth, &lies.verts);
    if tight <= BEYOND_LIMIT {
        return lies;
    }
    let body = (here, set.avatar.collision_faces());
    let freed = drape_while(&set.cloth, &lies.verts, body, (&FREED, go_on)).ok();
    let is_freed = |s: &Settled| faults(s) <= faults(&lies) && beyond(&set.cloth, &s.verts) < tight;
    freed.filter(is_freed).unwrap_or(lies)
}

/// How far the worst face of the cloth at `x` [m] stretches beyond its limit; nothing is beyond where there is none.
fn beyond(cloth: &Cloth, x: &[DVec3]) -> f64 {
    let all = stretch(&cloth.faces, &cloth.rest, x);
    let limit = |m: &u32| cloth.materials[*m as usize].limit;
    let faces = all.iter().zip(&cloth.material_of);
    let over = faces.filter_map(|(x, m)| Some(x - limit(m)?));
    over.fold(f64::NEG_INFINITY, f64::max)
}

pub(crate) fn faults(s: &Settled) -> usize {
    s.body_intersections + s.self_crossings
}

/// The cloth at `x` [m] after `k` steps of the solver on a still body, made clean and checked.
pub(crate) fn refined(
    set: &Set,
    x: &[DVec3],
    (body, k): (&Frame, usize),
) -> Result<Settled, Failure> {
    let body = (std::slice::from_ref(body), set.avatar.collision_faces());
    let settled = drape(&set.cloth, x, body, &to_rest(k));
    settled.map_err(|e| Failure::new(Exit::Numbers, "refine", e.to_string()))
}

#[cfg(test)]
mod tests {
    use muslin_body::Avatar;

    use super::*;
    use crate::options::{DressOptions, Wear};
    use crate::simulate::SimulateOptions;

    /// A leather skirt on somebody who squats, and a jersey tee, brought there in steps as few as make them tight.
    #[test]
    fn what_is_reached_too_tight_is_let_go_there() {
        let avatar = Avatar::embedded().expect("the embedded body");
        for (worn, is_tight) in [("skirt:nappa-leather", true), ("tee", false)] {
            let options = SimulateOptions {
                motion: "squat".into(),
                fps: 10.0,
                seconds: Some(1.0),
                dress: DressOptions {
                    edge: 0.025,
                    outfit: vec![Wear::parse(worn)],
                    ..SimulateOptions::default().dress
                },
                ..SimulateOptions::default()
            };
            let set = Set::asked(&avatar, &options);
            let last = set.moving.lead + set.moving.frames() - 1;
            let path: Vec<Frame> = (0..=last).map(|i| set.frame(i)).collect();
            let body = (path.as_slice(), avatar.collision_faces());
            let few = Options {
                again: false,
                ..to_rest(8)
            };
            let lies = drape(&set.cloth, &set.start, body, &few).expect("it lies");
            let before = beyond(&set.cloth, &lies.verts);
            assert_eq!(before > BEYOND_LIMIT, is_tight, "{worn}: {before}");
            let freed = let_go(&set, (lies.clone(), &path[last..]), &|| true);
            let after = beyond(&set.cloth, &freed.verts);
            match is_tight {
                true => assert!(after < 0.9 * before, "{worn}: {before} to {after}"),
                false => assert!(freed == lies),
            }
            assert!(faults(&freed) <= faults(&lies));
        }
    }

    /// Frames tried, in order, where those of `stay` do not become good.
    fn tried(bad: &str, stay: &[usize]) -> Vec<usize> {
        let bad: Vec<bool> = bad.chars().map(|c| c == 'x').collect();
        let mut all = Vec::new();
        let told = inwards(&bad, |k| {
            all.push(k);
            Ok(!stay.contains(&k))
        });
        told.expect("nobody stops it");
        all
    }

    #[test]
    fn frames_behind_one_that_stays_bad_are_tried_from_the_other_end() {
        assert_eq!(tried("..xxx.x.", &[]), [2, 3, 4, 6]);
        assert_eq!(tried("..xxxxx.", &[3]), [2, 3, 6, 5, 4]);
        assert_eq!(tried("..xxxxx.", &[3, 5]), [2, 3, 6, 5]);
        // No good frame before the first, or after the last.
        assert_eq!(tried("xxx..", &[]), [2, 1, 0]);
        assert_eq!(tried("xxx..", &[1]), [2, 1]);
        assert_eq!(tried("..xxx", &[2]), [2]);
        assert_eq!(tried("xxx", &[1]), [0, 1]);
        assert_eq!(tried("....", &[]), [0; 0]);
    }
}
