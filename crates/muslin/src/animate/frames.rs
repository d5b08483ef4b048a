//! Frames of a model, as predicted and as the solver leaves them.

use std::time::Instant;

use glam::DVec3;
use muslin_body::Pose;
use muslin_geom::{Mesh, Surface, intersecting_pairs};
use muslin_model::{Model, Player};
use muslin_sim::{Frame, Options, Settled, drape};
use rayon::prelude::*;

use crate::drape::NEARLY_THERE;
use crate::failure::{Exit, Failure};
use crate::simulate::reel::{Reel, Told};
use crate::simulate::set::Set;
use crate::watch::Watch;

use super::model_failure;

/// All frames of a motion.
pub(crate) struct Played {
    /// As they are delivered.
    pub reel: Reel,
    /// How the network did.
    pub raw: Raw,
    /// Frames that were solved more than once.
    pub again: usize,
}

/// The network alone.
pub(crate) struct Raw {
    /// Predictions [m].
    pub frames: Vec<Vec<DVec3>>,
    /// Frames a second, bones included, on one thread.
    pub rate: f64,
    /// Share of the vertices inside the body [%].
    pub inside: f64,
}

/// Frames that are solved side by side, between two questions whether to go on.
const SIDE: usize = 8;
/// Iterations of the second attempt at a frame that is not clean, and at the end of the third.
const AGAIN: usize = 25;

/// Plays all frames with that much motion and leads each by `refine` iterations of the solver to rest.
///
/// A frame that is not clean then gets more iterations; one that still is not is reached from the
/// nearest clean one, along the motion.
pub(crate) fn play(
    (set, model): (&Set, &Model),
    (refine, level): (usize, f64),
    watch: &mut Watch,
) -> Result<Played, Failure> {
    let raw = predict((set, model), (level, 1))?;
    let n = raw.frames.len();
    let mut solved: Vec<Solved> = Vec::with_capacity(n);
    for (c, chunk) in raw.frames.chunks(SIDE).enumerate() {
        watch.go_on()?;
        let solve = |(k, x): (usize, &Vec<DVec3>)| one(set, (c * SIDE + k, x), refine);
        let done: Result<Vec<Solved>, Failure> = chunk.par_iter().enumerate().map(solve).collect();
        solved.extend(done?);
        watch.progress(&format!("frame {} of {n}", solved.len()));
    }
    if refine > 0 {
        let bad: Vec<usize> = (0..n).filter(|k| solved[*k].faults > 0).collect();
        for (i, k) in bad.iter().enumerate() {
            watch.go_on()?;
            watch.progress(&format!("frame {k} once more, {i} of {}", bad.len()));
            reach(set, *k, &mut solved)?;
        }
    }
    let (mut reel, mut again) = (Reel::default(), 0);
    for s in solved {
        again += usize::from(s.again);
        reel.push(&s.cloth, &s.body, s.told);
    }
    Ok(Played { reel, raw, again })
}

struct Solved {
    cloth: Vec<DVec3>,
    body: Vec<DVec3>,
    told: Told,
    /// Pairs of triangles that meet and should not.
    faults: usize,
    again: bool,
}

impl Solved {
    fn new(s: Settled, since: Instant, again: bool) -> Self {
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

fn one(set: &Set, (k, x): (usize, &[DVec3]), refine: usize) -> Result<Solved, Failure> {
    let since = Instant::now();
    let body = set.frame(set.moving.lead + k);
    if refine == 0 {
        let raw = Settled {
            body_intersections: meeting(set, x, &body.skin),
            verts: x.to_vec(),
            body: body.skin,
            ..Settled::default()
        };
        return Ok(Solved::new(raw, since, false));
    }
    let way = (std::slice::from_ref(&body), refine);
    let first = solve(set, x, way, false)?;
    if faults(&first) == 0 {
        return Ok(Solved::new(first, since, false));
    }
    let next = refined(set, &first.verts, (&body, AGAIN.max(refine)))?;
    let best = if faults(&next) < faults(&first) {
        next
    } else {
        first
    };
    Ok(Solved::new(best, since, true))
}

/// Solves frame `k` from the nearest clean one, else from the rest pose.
fn reach(set: &Set, k: usize, solved: &mut [Solved]) -> Result<(), Failure> {
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
    let settled = solve(set, start, (&path, AGAIN), true)?;
    if faults(&settled) < solved[k].faults {
        solved[k] = Solved::new(settled, since, true);
    }
    Ok(())
}

fn faults(s: &Settled) -> usize {
    s.body_intersections + s.self_crossings
}

/// The cloth at `x` [m] after `k` steps of the solver on a still body, made clean and checked.
pub(crate) fn refined(
    set: &Set,
    x: &[DVec3],
    (body, k): (&Frame, usize),
) -> Result<Settled, Failure> {
    solve(set, x, (std::slice::from_ref(body), k), true)
}

/// `again`: whether what ends with a fault is tried a second time with more care.
fn solve(
    set: &Set,
    x: &[DVec3],
    (path, k): (&[Frame], usize),
    again: bool,
) -> Result<Settled, Failure> {
    let options = Options {
        again,
        last_steps: k,
        still: 0.0,
        ..NEARLY_THERE
    };
    let settled = drape(
        &set.cloth,
        x,
        (path, set.avatar.collision_faces()),
        &options,
    );
    settled.map_err(|e| Failure::new(Exit::Numbers, "refine", e.to_string()))
}

/// Pairs of cloth and body triangles that meet.
fn meeting(set: &Set, x: &[DVec3], skin: &[DVec3]) -> usize {
    let mesh = |verts: &[DVec3], faces: &[[u32; 3]]| Mesh {
        verts: verts.to_vec(),
        faces: faces.to_vec(),
    };
    let body = mesh(skin, set.avatar.collision_faces());
    intersecting_pairs(&mesh(x, &set.cloth.faces), &body).len()
}

/// What the network says with that much motion, on one thread: every frame is played, and those
/// at multiples of `every` are told.
pub(crate) fn predict(
    (set, model): (&Set, &Model),
    (level, every): (f64, usize),
) -> Result<Raw, Failure> {
    let mut player = Player::new(model, set.avatar).map_err(|e| model_failure(&e))?;
    player.begin(1.0 / set.moving.motion.fps);
    player.set_motion_level(level as f32);
    let poses: Vec<&Pose> = set.moving.motion.poses[set.moving.lead..].iter().collect();
    let mut flat = vec![vec![[0.0f32; 3]; player.n_verts()]; poses.len()];
    let since = Instant::now();
    for (pose, out) in poses.iter().zip(&mut flat) {
        player.frame(pose, &set.avatar.bones(&set.figure, pose), out);
    }
    let rate = poses.len() as f64 / since.elapsed().as_secs_f64().max(1e-9);
    let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
    let told = flat.iter().step_by(every);
    let frames: Vec<Vec<DVec3>> = told.map(|f| f.iter().map(wide).collect()).collect();
    let sound = frames.iter().flatten().all(|p| p.is_finite());
    if !sound {
        return Err(Failure::new(
            Exit::Numbers,
            "not-finite",
            "the network gives positions that are not finite",
        ));
    }
    let count = |(k, x): (usize, &Vec<DVec3>)| {
        let skin = set.skin(set.moving.lead + k * every);
        let surface = Surface::new(&skin, set.avatar.collision_faces());
        let inside = |p: &&DVec3| {
            surface
                .closest(**p, 0.05)
                .is_some_and(|hit| hit.signed < 0.0)
        };
        x.iter().filter(inside).count()
    };
    let inside: usize = frames.par_iter().enumerate().map(count).sum();
    let all = (frames.len() * player.n_verts()).max(1);
    Ok(Raw {
        rate,
        inside: 100.0 * inside as f64 / all as f64,
        frames,
    })
}
