//! Cloth on a moving body, frame after frame: inertia, not only rest.

use std::{cmp::Ordering, ops::ControlFlow};

use glam::DVec3;
use muslin_geom::Surface;

use crate::awake::awake;
use crate::{
    again::Again,
    clean,
    cloth::{Cloth, SimError, finite, same},
    dents::Dents,
    drape::{GoOn, Options, asked},
    relief::Frame,
    stage::{Pace, ROUNDS, Stage, Stride},
    weave::Weave,
};

/// A body that moves: its triangles, and where they are in every frame.
pub struct Walk<'a> {
    /// Outward triangles.
    pub faces: &'a [[u32; 3]],
    /// The body in the pose the cloth starts around [m].
    pub rest: &'a [DVec3],
    /// Number of frames.
    pub frames: usize,
    /// Frames of the lead-in, in which cloth follows without inertia and is not delivered.
    pub lead: usize,
    /// Frames per second.
    pub fps: f64,
    /// The body in a frame.
    pub at: &'a (dyn Fn(usize) -> Frame + Sync),
}

/// What a simulation must remember between two frames, to go on as if it had never stopped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// The next frame to be made.
    pub frame: usize,
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// Velocities [m/s].
    pub velocities: Vec<DVec3>,
    /// How strongly skin presses each vertex [N], which friction goes by; empty where that is not known.
    pub pressed: Vec<f64>,
    /// How strongly cloth pushes each [N], the same way.
    pub pushed: Vec<f64>,
}

/// One delivered frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment<'a> {
    /// Number of the frame, the lead-in not counted.
    pub frame: usize,
    /// Cloth [m].
    pub verts: &'a [DVec3],
    /// The body it lies on [m]: the given one, drawn back where it folds into itself.
    pub body: &'a [DVec3],
    /// How far the skin drew back at most [m].
    pub yielded: f64,
    /// Pairs of cloth and body triangles that meet, by exact predicates.
    pub body_intersections: usize,
    /// Steps that the frame took.
    pub steps: usize,
    /// To be kept, if the simulation is to go on from here later.
    pub state: Option<&'a State>,
}

/// Frames from one point where a simulation can be resumed to the next, at most.
pub const CHECKPOINT: usize = 30;
/// Steps of all vertices from one such point to the next, about: where frames take long there is one sooner. Counted,
/// not timed, so that every run forgets at the same frames.
const WORK: usize = 1_500_000;

/// Moves `cloth` with a body; hands every frame to `deliver`, which may stop the work.
///
/// `start`: positions [m] around the body at rest. With `resume`, the state of an earlier run of
/// the same cloth and body, the frames from there on are the same to the last bit.
pub fn simulate(
    cloth: &Cloth,
    (start, resume): (&[DVec3], Option<&State>),
    (walk, options): (&Walk<'_>, &Options),
    deliver: impl FnMut(&Moment<'_>) -> ControlFlow<()> + Send,
) -> Result<(), SimError> {
    simulate_while(cloth, (start, resume), (walk, options, &|| true), deliver)
}

/// [`simulate`], for as long as `go_on` says so: it is asked before every frame, those of the
/// lead-in included, and where it says no the answer is [`SimError::Stopped`].
pub fn simulate_while(
    cloth: &Cloth,
    (start, resume): (&[DVec3], Option<&State>),
    (walk, options, go_on): (&Walk<'_>, &Options, GoOn<'_>),
    mut deliver: impl FnMut(&Moment<'_>) -> ControlFlow<()> + Send,
) -> Result<(), SimError> {
    let weave = Weave::new(cloth)?;
    same("start", start.len(), cloth.n_verts())?;
    finite("start vertex", start)?;
    finite("body vertex", walk.rest)?;
    awake(|| {
        let run = Run::new(&weave, cloth, (start, resume), (walk, options))?;
        run.all(go_on, &mut deliver)
    })
}

struct Run<'a> {
    stage: Stage<'a>,
    walk: &'a Walk<'a>,
    dents: Dents<'a>,
    frame: usize,
    again: Again,
    /// Steps of all vertices since the last point where it can be resumed.
    work: usize,
}

impl<'a> Run<'a> {
    fn new(
        weave: &'a Weave,
        cloth: &'a Cloth,
        (start, resume): (&[DVec3], Option<&State>),
        (walk, options): (&'a Walk<'a>, &Options),
    ) -> Result<Run<'a>, SimError> {
        let skin = Surface::new(walk.rest, walk.faces);
        let options = Options {
            handles: true,
            ..*options
        };
        let mut stage = Stage::new(weave, start, skin, cloth, options);
        let dents = Dents::new(walk, stage.worn_on(), options.room(cloth));
        let frame = resume.map_or(0, |s| s.frame);
        stage.watch_thin(&(walk.at)(0).cores);
        let mut run = Run {
            stage,
            walk,
            dents,
            frame,
            again: Again::default(),
            work: 0,
        };
        if let Some(state) = resume {
            same("state", state.verts.len(), weave.n_verts())?;
            same("state", state.velocities.len(), weave.n_verts())?;
            for force in [&state.pressed, &state.pushed] {
                if !force.is_empty() {
                    same("state", force.len(), weave.n_verts())?;
                }
            }
            let before = run.dents.frame(frame.saturating_sub(1))?;
            run.stage.body.advance(&before.skin);
            run.stage.resume(state);
        } else {
            for _ in 0..options.first_steps {
                run.stage.step(&Pace::calm(options.step, 0.5))?;
            }
        }
        Ok(run)
    }

    /// How the cloth goes on from one frame to the next.
    fn stride(&self) -> Stride {
        let time = 1.0 / self.walk.fps;
        Stride {
            time,
            longest: time,
            rounds: ROUNDS,
            inertia: 1.0,
        }
    }

    /// Gives the cloth the velocity that the body has when the lead-in is over.
    fn set_off(&mut self) -> Result<(), SimError> {
        let [k, next] = [0, 1].map(|n| (self.frame + n).min(self.walk.frames - 1));
        let [from, to] = [self.dents.frame(k)?, self.dents.frame(next)?];
        let time = 1.0 / self.walk.fps;
        self.stage.set_off((&from.skin, &to.skin), time);
        Ok(())
    }

    fn all(
        mut self,
        go_on: GoOn<'_>,
        deliver: &mut impl FnMut(&Moment<'_>) -> ControlFlow<()>,
    ) -> Result<(), SimError> {
        while self.frame < self.walk.frames {
            asked(go_on)?;
            let body = self.dents.frame(self.frame)?;
            let before = self.stage.steps;
            self.stage.body.slick = self.dents.slick(self.frame);
            let tidy = match self.frame.cmp(&self.walk.lead) {
                Ordering::Less => {
                    self.stage.follow(&body.skin)?;
                    None
                }
                Ordering::Equal => {
                    self.stage.follow(&body.skin)?;
                    self.stage.settle(go_on)?;
                    self.stage.slip_at_rest();
                    self.set_off()?;
                    Some(clean::tidy(&mut self.stage, &body.cores))
                }
                Ordering::Greater => {
                    let stride = self.stride();
                    Some(self.again.live(&mut self.stage, &body, &stride)?)
                }
            };
            self.frame += 1;
            let Some(tidy) = tidy else {
                continue;
            };
            let delivered = self.frame - self.walk.lead;
            let steps = self.stage.steps - before;
            self.work += steps * self.stage.x.len();
            let keeps = delivered.is_multiple_of(CHECKPOINT) || self.work > WORK;
            let state = keeps.then(|| {
                (self.again, self.work) = (Again::default(), 0);
                self.stage.checkpoint(self.frame)
            });
            let moment = Moment {
                frame: delivered - 1,
                verts: &self.stage.x,
                body: &tidy.skin,
                yielded: tidy.yielded + self.dents.depth(self.frame - 1),
                body_intersections: tidy.left,
                steps,
                state: state.as_ref(),
            };
            if deliver(&moment).is_break() {
                return Ok(());
            }
        }
        Ok(())
    }
}
