//! Frames of a model, as predicted and as the solver leaves them.

use std::time::Instant;

use glam::DVec3;
use muslin_body::Pose;
use muslin_geom::{Mesh, Surface, intersecting_pairs};
use muslin_model::{Model, Player};
use muslin_sim::{Frame, Guesses, Options, Refined, Settled, drape_along, refine};
use rayon::prelude::*;

use crate::anew::{Solved, faults, once_more, reach};
use crate::begin::begin;
use crate::drape::{LAID, NEARLY_THERE};
use crate::failure::{Exit, Failure};
use crate::layers::{Lead, Predicted, stacked};
use crate::simulate::reel::Reel;
use crate::simulate::set::Set;
use crate::wardrobe::Known;
use crate::watch::Watch;

use super::{model_failure, note_of};

/// All frames of a motion.
pub(crate) struct Played {
    /// As they are delivered.
    pub reel: Reel,
    /// How the network did.
    pub raw: Raw,
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

/// Iterations on the linear system of a step: what they leave the next step finds again. With 40 in
/// place of 15 a tee is led to the same energy, to a tenth of what is left, in twice the time.
const ITERATIONS: usize = 15;
/// Predictions that are checked side by side, between two questions whether to go on.
const SIDE: usize = 8;

/// Plays all frames with that much motion and leads each by `refine` steps of the solver to rest.
///
/// A frame that is not clean then is reached once more from the nearest clean one, along the motion.
pub(crate) fn play(
    (set, models): (&Set, &[Model]),
    (refine, level): (usize, f64),
    watch: &mut Watch,
) -> Result<Played, Failure> {
    let raw = predict((set, models), (level, 1))?;
    let all_swing = models.iter().all(|m| m.sway.is_some());
    let inertia = if all_swing { level } else { 0.0 };
    let mut solved = match refine {
        0 => shown(set, &raw, watch)?,
        _ => {
            let guesses = Guesses {
                frames: &raw.frames,
                begun: None,
                first: 0,
                steps: refine,
                inertia,
                begins_at_rest: true,
                or_none: true,
            };
            let mut solved = led(set, &guesses, watch)?;
            if solved[0].faults > 0 {
                let begun = begun((set, models), &mut solved, watch)?;
                let guesses = Guesses {
                    begun: begun.as_deref(),
                    or_none: false,
                    ..guesses
                };
                solved = led(set, &guesses, watch)?;
            }
            solved
        }
    };
    if refine > 0 {
        once_more(set, &mut solved, watch)?;
    }
    Ok(Played {
        reel: solved.into_iter().collect(),
        raw,
    })
}

/// Frames as predicted, each of which took as long as that does in the mean.
fn shown(set: &Set, predicted: &Raw, watch: &mut Watch) -> Result<Vec<Solved>, Failure> {
    let raw = &predicted.frames;
    let one = |(k, x): (usize, &Vec<DVec3>)| {
        let body = set.frame(set.moving.lead + k).skin;
        let raw = Settled {
            body_intersections: meeting(set, x, &body),
            verts: x.to_vec(),
            body,
            ..Settled::default()
        };
        let mut solved = Solved::new(raw, Instant::now(), false);
        solved.told.seconds = predicted.rate.recip();
        solved
    };
    let mut out = Vec::with_capacity(raw.len());
    for (c, chunk) in raw.chunks(SIDE).enumerate() {
        watch.go_on()?;
        let numbered = chunk.par_iter().enumerate();
        out.par_extend(numbered.map(|(k, x)| one((c * SIDE + k, x))));
        watch.progress(&format!("frame {} of {}", out.len(), raw.len()));
    }
    Ok(out)
}

/// Leads predictions of the frames from `first` on to rest, `steps` each, one after the other; or lets the
/// cloth swing from where it lies still in the first of them, where inertia counts.
pub(crate) fn along(
    (set, steps, inertia): (&Set, usize, f64),
    (first, frames, begun): (usize, &[Vec<DVec3>], Option<&[DVec3]>),
    watch: &mut Watch,
) -> Result<Vec<Solved>, Failure> {
    let guesses = Guesses {
        frames,
        begun,
        first,
        steps,
        inertia,
        begins_at_rest: inertia > 0.0,
        or_none: false,
    };
    led(set, &guesses, watch)
}

fn led(set: &Set, guesses: &Guesses<'_>, watch: &mut Watch) -> Result<Vec<Solved>, Failure> {
    let (rest, at) = (set.rest(), |k: usize| set.frame(k));
    let walk = set.walk(&rest, &at);
    let options = Options {
        iterations: ITERATIONS,
        air: set.air,
        ..NEARLY_THERE
    };
    let may_go_on = watch.may_go_on();
    let many = guesses.frames.len();
    let mut out = Vec::with_capacity(many);
    let deliver = |r: Refined| {
        out.push(Solved::from(r));
        watch.progress(&format!("frame {} of {many}", out.len()));
    };
    let ended = refine(&set.cloth, guesses, (&walk, &options, &may_go_on), deliver);
    watch.go_on()?;
    ended.map_err(|e| Failure::new(Exit::Numbers, "refine", e.to_string()))?;
    Ok(out)
}

/// Where the cloth lies clean in the first frame [m], which was led there in vain: as where legs cross, or on a
/// body that the network never met.
fn begun(
    (set, models): (&Set, &[Model]),
    first: &mut [Solved],
    watch: &mut Watch,
) -> Result<Option<Vec<DVec3>>, Failure> {
    // What a character's shape does to garments the networks do not know on the way either.
    if set.hero.is_none() {
        watch.progress("on the way into the motion");
        if let Some(clean) = led_in((set, models), watch)? {
            return Ok(Some(clean));
        }
    }
    watch.progress("on the way from the rest pose into the motion");
    reach(set, 0, first, watch)?;
    Ok((first[0].faults == 0).then(|| first[0].cloth.clone()))
}

/// The cloth in the first frame [m], begun on the lead-in where the networks know it; nothing if they do not, or
/// if it does not come clean from there.
fn led_in(
    (set, models): (&Set, &[Model]),
    watch: &mut Watch,
) -> Result<Option<Vec<DVec3>>, Failure> {
    let (motion, lead) = (&set.moving.motion, set.moving.lead);
    let players = players((set, models), 0.0)?.into_iter().enumerate();
    let pieces = players.zip(&set.outfit.pieces);
    let pieces = pieces.map(|((k, player), piece)| (piece, player, led_out(models, k)));
    let known = Known::told((set.avatar, &set.figure), pieces.collect());
    let pose = |share: f64| (share * lead as f64).round() as usize;
    let still = || Surface::new(&set.rest(), set.avatar.collision_faces());
    let laid = begin(&set.cloth.faces, (&set.start, still), |share| {
        let k = pose(share);
        let skin = Surface::new(&set.skin(k), set.avatar.collision_faces());
        Some((known.laid(&motion.poses[k])?, skin))
    });
    watch.go_on()?;
    let Some((share, start)) = laid else {
        return Ok(None);
    };
    let first = pose(share);
    let path: Vec<Frame> = (first..=lead).map(|k| set.frame(k)).collect();
    let along = known.along(&path, |k| motion.poses[first + k].clone());
    let body = (path.as_slice(), set.avatar.collision_faces());
    let may_go_on = watch.may_go_on();
    let settled = drape_along(&set.cloth, (&start, &along), body, (&LAID, &may_go_on));
    watch.go_on()?;
    // Where it does not end well, the way from the rest pose is left.
    Ok(settled.ok().filter(|s| faults(s) == 0).map(|s| s.verts))
}

/// One player for each garment.
fn players((set, models): (&Set, &[Model]), level: f64) -> Result<Vec<Player>, Failure> {
    let one = |model| {
        let mut player = Player::new(model, set.avatar).map_err(|e| model_failure(&e))?;
        player.begin(1.0 / set.moving.motion.fps);
        player.set_motion_level(level as f32);
        Ok(player)
    };
    models.iter().map(one).collect()
}

/// Garments of a frame as one cloth [m], each led out of those below it.
fn one_over_the_other((set, models): (&Set, &[Model]), flat: &[Vec<[f32; 3]>]) -> Vec<DVec3> {
    let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
    let all = flat.iter().zip(&set.outfit.pieces).enumerate();
    stacked(all.map(|(k, (flat, piece))| Predicted {
        garment: &piece.garment,
        x: flat.iter().map(wide).collect(),
        lead: led_out(models, k),
    }))
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

/// How the garment of model `k` is led out of those below it, if it was not taught over just these all that it does.
fn led_out(models: &[Model], k: usize) -> Option<Lead> {
    let below = models[..k].iter().map(|m| note_of(m, "garment"));
    let taught_over = k > 0 && note_of(&models[k], "over") == below.collect::<Vec<_>>().join(",");
    match (taught_over, models[k].sway.is_some()) {
        (false, _) => Some(Lead::STRANGE),
        (true, true) => Some(Lead::SWINGING),
        (true, false) => None,
    }
}

/// What the networks say with that much motion, on one thread, each garment led out of those below it; frames
/// at multiples of `every` are searched for vertices in the body.
pub(crate) fn predict(
    (set, models): (&Set, &[Model]),
    (level, every): (f64, usize),
) -> Result<Raw, Failure> {
    let poses: Vec<&Pose> = set.moving.motion.poses[set.moving.lead..].iter().collect();
    let mut players = players((set, models), level)?;
    let blank = |player: &Player| vec![[0.0f32; 3]; player.n_verts()];
    let blank: Vec<_> = players.iter().map(blank).collect();
    let mut flat = vec![blank; poses.len()];
    let since = Instant::now();
    for (k, pose) in poses.iter().enumerate() {
        let bones = set.avatar.bones(&set.figure, pose);
        for (player, flat) in players.iter_mut().zip(&mut flat[k]) {
            player.frame(pose, &bones, flat);
        }
    }
    let seconds = since.elapsed().as_secs_f64();
    let sound = flat.iter().flatten().flatten().flatten();
    if !sound.clone().all(|x| x.is_finite()) {
        return Err(Failure::new(
            Exit::Numbers,
            "not-finite",
            "the network gives positions that are not finite",
        ));
    }
    let whole = |flat: &Vec<Vec<[f32; 3]>>| one_over_the_other((set, models), flat);
    let frames: Vec<Vec<DVec3>> = flat.par_iter().map(whole).collect();
    let looked: Vec<usize> = (0..frames.len()).step_by(every).collect();
    let count = |&k: &usize| {
        let skin = set.skin(set.moving.lead + k);
        let surface = Surface::new(&skin, set.avatar.collision_faces());
        let inside = |p: &&DVec3| surface.signed(**p, 0.05).is_some_and(|d| d < 0.0);
        frames[k].iter().filter(inside).count()
    };
    let inside: usize = looked.par_iter().map(count).sum();
    let all = (looked.len() * set.start.len()).max(1);
    Ok(Raw {
        rate: poses.len() as f64 / seconds.max(1e-9),
        inside: 100.0 * inside as f64 / all as f64,
        frames,
    })
}
