//! Guesses of where cloth lies on a moving body, led to rest frame after frame.
//!
//! What the solver changed in one frame is kept in the next: cloth goes from where it was led to by as
//! much as the guess goes on, what was changed turning with the body, never through itself, and is led
//! to rest from there. So a few steps are enough, and folds do not jump from frame to frame.
//!
//! With inertia, cloth goes on from where the first guess that led to a clean frame was led to, and swings as in a
//! simulation. With or without, clean cloth that hardly moves on a body that stands still, or came to rest on it in the
//! first frame, stays where it is until the body moves ([`Sleep`]), unless wind blows.

use std::time::Instant;

use glam::DVec3;
use muslin_geom::Surface;

use crate::awake::awake;
use crate::{
    again::Again,
    carry::Carrier,
    clean::{self, Tidy},
    cloth::{Cloth, SimError, finite, same},
    dents::Dents,
    drape::{GoOn, Options, asked},
    ordered,
    relief::Frame,
    simulate::Walk,
    sleep::Sleep,
    stage::{Pace, Stage, Stride},
    weave::Weave,
};

/// Where cloth may lie on a moving body, and how much is done to find where it does.
pub struct Guesses<'a> {
    /// Positions [m] in some frames, one after the other.
    pub frames: &'a [Vec<DVec3>],
    /// Where the cloth lies clean in the first of them already [m], if that is known: then no other
    /// guess is begun with, for guesses so far off are no help.
    pub begun: Option<&'a [DVec3]>,
    /// The number of the first of them, the lead-in not counted.
    pub first: usize,
    /// Steps that each is led by; with inertia, Newton steps at most of each of its steps in time.
    pub steps: usize,
    /// How many times its inertia counts; none, and every frame comes to rest.
    pub inertia: f64,
    /// Whether the first frame is led on until it lies still, in however many steps: else it would come to rest before
    /// everybody's eyes.
    pub begins_at_rest: bool,
    /// Whether a first frame that is not clean is all that is made: who asks will begin elsewhere. What crosses itself once it
    /// was led is then not led on until it lies still, for it does not come free by that.
    pub or_none: bool,
}

/// How many times as many steps the first of some frames needs: it knows of no frame before it.
const FIRST: usize = 3;

/// Steps at most until the first frame lies still, how long they are [s], and how far it goes in a step then, on the
/// mean [m]. As many steps of 0.06 s, as frames are led by, leave trousers three times as far from rest.
const SETTLED: usize = 90;
const SETTLING: f64 = 0.25;
const STILL: f64 = 5e-6;
/// Iterations on the linear system of each of these steps: what hangs freely comes to rest in half as many.
const THOROUGH: usize = 40;

/// The longest step in time of cloth that swings [s].
const LONGEST: f64 = 1.0 / 60.0 + 1e-9;

/// A frame that was led to rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refined {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// The body that the cloth rests on [m]: the given one, drawn back where it folds into itself.
    pub body: Vec<DVec3>,
    /// How far the skin drew back at most [m].
    pub yielded: f64,
    /// Pairs of cloth and body triangles that meet, by exact predicates.
    pub body_intersections: usize,
    /// Pairs of cloth triangles that cross, by exact predicates.
    pub self_crossings: usize,
    /// Steps that the frame took.
    pub steps: usize,
    /// How long they took [s].
    pub seconds: f64,
}

/// Leads `guesses` to rest on the body of `walk`, for as long as `go_on` says so, and hands every frame
/// to `deliver`.
pub fn refine(
    cloth: &Cloth,
    guesses: &Guesses<'_>,
    (walk, options, go_on): (&Walk<'_>, &Options, GoOn<'_>),
    deliver: impl FnMut(Refined) + Send,
) -> Result<(), SimError> {
    let weave = Weave::new(cloth)?;
    finite("body vertex", walk.rest)?;
    for guess in guesses.frames {
        same("guess", guess.len(), cloth.n_verts())?;
        finite("guessed vertex", guess)?;
    }
    if let Some(begun) = guesses.begun {
        same("beginning", begun.len(), cloth.n_verts())?;
        finite("vertex of the beginning", begun)?;
    }
    let Some(start) = guesses.frames.first() else {
        return Ok(());
    };
    let start = guesses.begun.unwrap_or(start);
    let begin = (walk.at)(walk.lead + guesses.first);
    begin.check(walk.rest.len())?;
    let skin = Surface::new(&begin.skin, walk.faces);
    let worn_on = Carrier::new(&skin, start).worn_on(&skin);
    let mut stage = Stage::new(&weave, start, skin, cloth, *options);
    stage.watch_thin(&begin.cores);
    let mut run = Run {
        dents: Dents::new(walk, worn_on, options.room(cloth)),
        stage,
        pace: Pace::calm(options.step, options.keep),
        is_calm: options.air.wind == DVec3::ZERO,
        deliver,
    };
    awake(|| run.all(guesses, (walk.lead, 1.0 / walk.fps, go_on)))
}

/// Leads cloth on until it lies still.
fn settle(stage: &mut Stage<'_>, pace: &Pace, go_on: GoOn<'_>) -> Result<(), SimError> {
    let usual = stage.iterate(THOROUGH);
    let pace = &Pace {
        step: SETTLING,
        ..*pace
    };
    for _ in 0..SETTLED {
        asked(go_on)?;
        let before = stage.x.clone();
        stage.step(pace)?;
        if apart(&before, &stage.x) < STILL {
            break;
        }
    }
    stage.iterate(usual);
    Ok(())
}

/// How far apart two places of the cloth are, on the mean [m].
fn apart(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).sum::<f64>() / a.len().max(1) as f64
}

struct Run<'a, D> {
    dents: Dents<'a>,
    stage: Stage<'a>,
    pace: Pace,
    /// Whether cloth may sleep.
    is_calm: bool,
    deliver: D,
}

impl<D: FnMut(Refined)> Run<'_, D> {
    fn all(
        &mut self,
        guesses: &Guesses<'_>,
        (lead, time, go_on): (usize, f64, GoOn<'_>),
    ) -> Result<(), SimError> {
        let mut anew = true;
        let (mut again, mut sleep) = (Again::default(), Sleep::default());
        let mut asleep: Option<Refined> = None;
        for i in 0..guesses.frames.len() {
            asked(go_on)?;
            let since = Instant::now();
            let stage = &mut self.stage;
            let k = lead + guesses.first + i;
            let body = self.dents.frame(k)?;
            if !sleep.lasts(&body.skin) {
                asleep = None;
            }
            if let Some(asleep) = &asleep {
                (self.deliver)(Refined {
                    steps: 0,
                    seconds: since.elapsed().as_secs_f64(),
                    ..asleep.clone()
                });
                continue;
            }
            let (before, there) = (stage.steps, stage.x.clone());
            stage.body.slick = self.dents.slick(k);
            let swings = guesses.inertia > 0.0;
            let tidy = if swings && !anew {
                let stride = Stride {
                    time,
                    longest: LONGEST,
                    rounds: guesses.steps,
                    inertia: guesses.inertia,
                };
                again.live(stage, &body, &stride)?
            } else {
                self.led((guesses, i), (k, &body), (anew, time, go_on))?
            };
            let stage = &mut self.stage;
            let self_crossings = stage.in_itself().len();
            // Guesses for poses in which cloth gets caught are no place to begin from.
            anew &= swings && tidy.left + self_crossings > 0 && guesses.begun.is_none();
            let refined = Refined {
                self_crossings,
                verts: stage.x.clone(),
                body: tidy.skin,
                yielded: tidy.yielded + self.dents.depth(k),
                body_intersections: tidy.left,
                steps: stage.steps - before,
                seconds: since.elapsed().as_secs_f64(),
            };
            let is_clean = refined.body_intersections + self_crossings == 0;
            let (far, time) = match i {
                0 if guesses.begins_at_rest => (0.0, f64::INFINITY),
                _ => (apart(&there, &stage.x), time),
            };
            let far = if is_clean && self.is_calm {
                far
            } else {
                f64::INFINITY
            };
            if sleep.falls(far, time) {
                // In the first frame it has the body's own velocity.
                if i > 0 {
                    stage.halt();
                }
                asleep = Some(refined.clone());
            }
            (self.deliver)(refined);
            if i == 0 && guesses.or_none && !is_clean {
                break;
            }
        }
        Ok(())
    }
    /// Leads cloth along the way of its guesses to frame `i` of them, and to rest there; `anew`: whatever the one before was.
    fn led(
        &mut self,
        (guesses, i): (&Guesses<'_>, usize),
        (k, body): (usize, &Frame),
        (anew, time, go_on): (bool, f64, GoOn<'_>),
    ) -> Result<Tidy, SimError> {
        let (stage, guess) = (&mut self.stage, &guesses.frames[i]);
        let old = match anew {
            true => &stage.x,
            false => &guesses.frames[i - 1],
        };
        let turns = stage.motions_between(stage.body.now.verts(), &body.skin);
        let by = |v: usize| {
            if i == 0 && guesses.begun.is_some() {
                return DVec3::ZERO;
            }
            let led = turns[v].matrix3 * (stage.x[v] - old[v]);
            guess[v] + led - stage.x[v]
        };
        let by = ordered::map(guess.len(), by);
        stage.lead(&body.skin, by);
        let times = if anew { FIRST } else { 1 };
        for _ in 0..times * guesses.steps {
            stage.step(&self.pace)?;
        }
        if i == 0 && guesses.begins_at_rest {
            let is_vain = guesses.or_none && !stage.in_itself().is_empty();
            if !is_vain {
                settle(stage, &self.pace, go_on)?;
            }
        }
        if guesses.inertia > 0.0 {
            stage.slip_at_rest();
            if i + 1 < guesses.frames.len() {
                let next = self.dents.frame(k + 1)?;
                stage.set_off((&body.skin, &next.skin), time);
            }
        }
        Ok(clean::tidy(stage, &body.cores))
    }
}
