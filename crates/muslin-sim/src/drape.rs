//! A drape: along the body's path, then to rest, then made clean.

use std::cell::OnceCell;

use glam::DVec3;
use muslin_geom::Surface;

use crate::awake::awake;
use crate::{
    air::Air,
    carry::Carrier,
    clean,
    cloth::{Cloth, SimError, finite, same},
    dents::AROUND,
    loosen::{Lie, beyond, faults, let_go},
    quality::{self, Settled},
    relief::{Frame, relieve_path},
    stage::{CALM_ROUNDS, Grips, Pace, Stage, TORN, part_way},
    weave::Weave,
};

/// How a drape is made. The defaults suit a person in gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Acceleration [m/s²].
    pub gravity: DVec3,
    /// What moving cloth moves through; cloth that comes to rest feels none.
    pub air: Air,
    /// Time step [s].
    pub step: f64,
    /// Distance from skin to cloth at which the skin begins to push [m].
    pub gap: f64,
    /// Conjugate gradient iterations per step, at most.
    pub iterations: usize,
    /// Newton steps at most in each step on the way to the pose and to rest; the last two take up to three.
    pub rounds: usize,
    /// Steps before the body begins to move.
    pub first_steps: usize,
    /// Steps after the body has arrived, at most.
    pub last_steps: usize,
    /// Speed at which 99 % of the vertices count as resting [m/s].
    pub still: f64,
    /// Share of its velocity that cloth keeps from one step to the next.
    pub keep: f64,
    /// Stiffness of a pinned vertex [N/m]. The default holds the weight of trousers at the waist
    /// within a few millimetres, and lets bent hips pull it down some centimetres, as real ones do.
    pub pin: f64,
    /// Times that cloth which is caught in a fold of the body is let go, at most.
    pub tugs: usize,
    /// Whether what ends with a fault is tried a second time, with more care.
    pub again: bool,
    /// Whether cloth slides freely along the path, and a little longer, at the first attempt: what goes along with the skin
    /// that it is next to is then not held where a limb took it up. What hangs from the waist alone rides up.
    pub freely: bool,
    /// Whether waves of many edges' length are solved by a level of their own. What hangs freely
    /// comes to a false rest without; what lies on the body gains nothing and takes a third longer.
    /// Cloth in motion is always solved so.
    pub handles: bool,
    /// Whether moving cloth goes by BDF2, which keeps more of a swing, instead of implicit Euler.
    pub second_order: bool,
}

impl Options {
    /// The defaults.
    pub const USUAL: Self = Self {
        gravity: DVec3::new(0.0, -9.81, 0.0),
        air: Air::NONE,
        step: 1.0 / 30.0,
        gap: 3e-3,
        iterations: 25,
        rounds: CALM_ROUNDS,
        first_steps: 4,
        last_steps: 80,
        still: 0.03,
        keep: 0.8,
        pin: 15.0,
        tugs: 4,
        again: true,
        freely: false,
        handles: false,
        second_order: false,
    };
}

impl Default for Options {
    fn default() -> Self {
        Self::USUAL
    }
}

/// How much firmer the walls at the limits of stretch are where cloth is caught: what is beyond
/// them then pulls along what is not.
const FIRMER: f64 = 16.0;
/// Room in folds of the body on top of what cloth needs, at a careful attempt [m].
const CAREFUL_ROOM: f64 = 6e-3;
/// Share of the skin's friction that counts where cloth slides: what is pulled tight has to slide. Cloth that rests with
/// less friction rests with more.
const SLIPPERY: f64 = 0.1;
/// Steps in which cloth that slid along the path slides on where the body has arrived.
const SLIDING: usize = 4;
/// An attempt in which a face in a hundred stretches this far beyond its limit on the way would take long and come to
/// nothing: the first, and later ones.
const HOPELESS: [f64; 2] = [0.3, TORN];

/// Whether to go on; asked from any thread.
pub(crate) type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

impl Options {
    /// Room that cloth needs between two parts of the skin [m].
    pub(crate) fn room(&self, cloth: &Cloth) -> f64 {
        2.0 * self.gap + cloth.thickness_of_all()
    }
}

/// Drapes `cloth` from `start` over a body that moves along `path`, until it rests on the last
/// frame.
///
/// `start`: positions [m], outside the body's first frame as far as possible; `path`: the body per
/// step, first the pose of `start`; `body_faces`: its triangles, outward. Cloth that is caught or
/// starts inside is brought out where that can be done, and what ends with a fault is tried again,
/// three times at most and with more care, if the options say so; what remains is counted in the result, never hidden. Then, too,
/// cloth that the body would tear apart on the way is [`SimError::TooTight`].
pub fn drape(
    cloth: &Cloth,
    start: &[DVec3],
    (path, body_faces): (&[Frame], &[[u32; 3]]),
    options: &Options,
) -> Result<Settled, SimError> {
    drape_while(cloth, start, (path, body_faces), (options, &|| true))
}

/// [`drape`], for as long as `go_on` says so: it is asked between steps, and where it says no the
/// answer is [`SimError::Stopped`].
pub fn drape_while(
    cloth: &Cloth,
    start: &[DVec3],
    body: (&[Frame], &[[u32; 3]]),
    options: (&Options, GoOn<'_>),
) -> Result<Settled, SimError> {
    drape_along(cloth, (start, &[]), body, options)
}

/// [`drape_while`] of cloth that goes along as `laid` [m] goes from frame to frame of the path, not with the skin that it is
/// next to, and slides freely until shortly after the body has arrived: a shirt's hem is not taken up by a thigh, nor held
/// there. Where `laid` is empty this is [`drape_while`].
pub fn drape_along(
    cloth: &Cloth,
    (start, laid): (&[DVec3], &[Vec<DVec3>]),
    body: (&[Frame], &[[u32; 3]]),
    options: (&Options, GoOn<'_>),
) -> Result<Settled, SimError> {
    if !laid.is_empty() {
        same("frames of laid cloth", laid.len(), body.0.len())?;
    }
    for one in laid {
        same("laid cloth", one.len(), cloth.n_verts())?;
        finite("laid vertex", one)?;
    }
    awake(|| drape_inside(cloth, (start, laid), body, options))
}

fn drape_inside(
    cloth: &Cloth,
    (start, laid): (&[DVec3], &[Vec<DVec3>]),
    (path, body_faces): (&[Frame], &[[u32; 3]]),
    (options, go_on): (&Options, GoOn<'_>),
) -> Result<Settled, SimError> {
    cloth.check()?;
    same("start", start.len(), cloth.n_verts())?;
    finite("start vertex", start)?;
    let first = path.first().ok_or(SimError::EmptyPath)?;
    for frame in path {
        frame.check(first.skin.len())?;
    }
    let worn_on = || {
        let skin = Surface::new(&first.skin, body_faces);
        Carrier::new(&skin, start).worn_on(&skin)
    };
    let (weave, worn_on) = rayon::join(|| Weave::new(cloth), worn_on);
    let job = Job {
        cloth,
        start,
        laid,
        path,
        body_faces,
        worn_on,
        firm: OnceCell::new(),
        weave: weave?,
        options,
        go_on,
    };
    match job.best()? {
        Attempted::Lies(.., settled) => Ok(settled),
        Attempted::GivenUp(beyond) => Err(SimError::TooTight(beyond)),
    }
}

/// What stays the same however often a drape is tried.
struct Job<'j> {
    cloth: &'j Cloth,
    start: &'j [DVec3],
    /// What it goes along with from frame to frame of the path [m]; empty if with the skin.
    laid: &'j [Vec<DVec3>],
    path: &'j [Frame],
    body_faces: &'j [[u32; 3]],
    /// Skin vertices that the cloth is worn on.
    worn_on: Vec<bool>,
    weave: Weave,
    /// The same with firmer walls, made only where something is caught.
    firm: OnceCell<Weave>,
    options: &'j Options,
    go_on: GoOn<'j>,
}

/// How a drape is tried.
#[derive(Clone, Copy, PartialEq)]
enum Attempt {
    /// As most cloth needs it.
    First,
    /// The body gives way by more where it folds; thin parts are watched, and what came through cloth; cloth slides.
    Sliding,
    /// The body gives way by more and thin parts are watched, but cloth keeps its grip: what hands lean on stays.
    Gripping,
    /// As sliding, and cloth slides on where cloth stops it: bunched cloth comes through folds less stretched.
    Parting,
    /// As gripping, in half steps of the body: for cloth that all others tore on the way.
    Slow,
}

/// How bad cloth lies, and how it lies.
type Outcome = ([bool; 3], Settled);

/// What came of a drape.
enum Attempted {
    /// How bad cloth lies, how far one face in a hundred is beyond its limit, and how it lies.
    Lies([bool; 3], f64, Settled),
    /// By how much one face in a hundred was beyond its limit where it was given up.
    GivenUp(f64),
}

impl Attempted {
    /// What is least is best; of what is as bad, what stretches least.
    fn badness(&self) -> (bool, [bool; 3], f64) {
        match self {
            Self::Lies(faults, beyond, _) => (false, *faults, *beyond),
            Self::GivenUp(beyond) => (true, [true; 3], *beyond),
        }
    }

    fn is_faultless(&self) -> bool {
        matches!(self, Self::Lies([false, false, false], ..))
    }
}

impl Job<'_> {
    /// The first attempt without fault, or the least bad of all, where there may be more than one.
    fn best(&self) -> Result<Attempted, SimError> {
        let mut best = self.attempt(Attempt::First)?;
        for attempt in [
            Attempt::Sliding,
            Attempt::Gripping,
            Attempt::Parting,
            Attempt::Slow,
        ] {
            if best.is_faultless() || !self.options.again {
                break;
            }
            if attempt == Attempt::Slow && matches!(best, Attempted::Lies(..)) {
                break;
            }
            let other = self.attempt(attempt)?;
            if other.badness() < best.badness() {
                best = other;
            }
        }
        Ok(best)
    }

    /// One drape.
    fn attempt(&self, attempt: Attempt) -> Result<Attempted, SimError> {
        let (path, options) = (self.path, self.options);
        let careful = attempt != Attempt::First;
        let extra = if careful { CAREFUL_ROOM } else { 0.0 };
        let room = options.room(self.cloth) + extra;
        let near = (&self.worn_on[..], AROUND);
        let (way, relief) = relieve_path(path, self.body_faces, near, room);
        let skin = Surface::new(&way[0], self.body_faces);
        let mut stage = Stage::new(&self.weave, self.start, skin, self.cloth, *options);
        if careful {
            stage.watch_thin(&path[0].cores);
        }
        if matches!(attempt, Attempt::Sliding | Attempt::Parting) {
            stage.watch_met();
            stage.grips.skin = SLIPPERY;
        }
        stage.slides = attempt == Attempt::Parting;
        let held = stage.grips;
        let freely = !self.laid.is_empty() || options.freely && attempt == Attempt::First;
        if freely {
            stage.grips = Grips::NONE;
        }
        for _ in 0..options.first_steps {
            stage.step(&Pace::calm(options.step, 0.5))?;
        }
        for (k, (before, frame)) in way.iter().zip(&way[1..]).enumerate() {
            asked(self.go_on)?;
            if attempt == Attempt::Slow {
                self.go_along(&mut stage, (k, 0.5), &part_way((before, frame), 0.5))?;
                self.go_along(&mut stage, (k, 0.5), frame)?;
            } else {
                self.go_along(&mut stage, (k, 1.0), frame)?;
            }
            if options.again {
                let beyond = quality::excess_p99(&self.weave, &stage.x);
                if beyond > HOPELESS[usize::from(careful)] {
                    return Ok(Attempted::GivenUp(beyond));
                }
            }
        }
        if freely && way.len() > 1 {
            for _ in 0..SLIDING {
                asked(self.go_on)?;
                stage.step(&stage.hasty(options.keep))?;
            }
        }
        stage.grips = held;
        let converged = stage.settle(self.go_on)?;
        let body = Frame {
            skin: way[way.len() - 1].clone(),
            cores: path[path.len() - 1].cores.clone(),
        };
        let firm = || self.firm.get_or_init(|| self.weave.firmer(FIRMER));
        let tugs = (options.tugs, self.go_on);
        let lies = let_go((&mut stage, converged), (self.cloth, &body, &firm), tugs)?;
        let (faults, best) = self.finished(&mut stage, &lies, &body)?;
        let yielded = relief.deepest + best.yielded;
        let beyond = beyond(self.cloth, &best.verts);
        Ok(Attempted::Lies(faults, beyond, Settled { yielded, ..best }))
    }

    /// Takes the body so much of its way from frame `k` of the path to the next, to `frame`, and the cloth along.
    fn go_along(
        &self,
        stage: &mut Stage<'_>,
        (k, share): (usize, f64),
        frame: &[DVec3],
    ) -> Result<(), SimError> {
        if let Some([from, to]) = self.laid.get(k..k + 2) {
            let moves = from.iter().zip(to).map(|(a, b)| (*b - *a) * share);
            return stage.lead_in_pieces(frame, &moves.collect::<Vec<_>>());
        }
        stage.follow(frame)
    }

    /// The first way to lie that ends without fault, or the one whose faults are least.
    fn finished(
        &self,
        stage: &mut Stage<'_>,
        lies: &[Lie],
        body: &Frame,
    ) -> Result<Outcome, SimError> {
        let mut best: Option<Outcome> = None;
        for lie in lies {
            if stage.x != lie.x || best.is_some() {
                stage.body.advance(&body.skin);
                stage.restore(&lie.x, &vec![DVec3::ZERO; lie.x.len()]);
            }
            let settled = Settled {
                converged: lie.converged,
                ..clean::finish(stage, (&self.weave, &body.cores))?
            };
            let faults = faults(self.cloth, &settled);
            if best.as_ref().is_none_or(|b| faults < b.0) {
                best = Some((faults, settled));
            }
            if faults == [false; 3] {
                break;
            }
        }
        Ok(best.expect("cloth lies in some way"))
    }
}

/// Stops where `go_on` says no.
pub(crate) fn asked(go_on: GoOn<'_>) -> Result<(), SimError> {
    if go_on() {
        Ok(())
    } else {
        Err(SimError::Stopped)
    }
}
