//! One step in time: where everything drifts to, and Newton steps from there.

use glam::{DMat3, DVec3};
use muslin_energy::{contact::Barrier, point::Scheme};

use super::{Press, Stage};
use crate::awake::awake;
use crate::{
    air::{Air, Drag},
    body::Skin,
    cloth::SimError,
    matrix::Effort,
    newton::{Descent, Problem},
    ordered,
    pairs::{self, Pair, Rule},
    quality,
    safe::make_safe,
    slip,
    touch::Touch,
};

/// How a step goes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    /// Time step [s].
    pub step: f64,
    /// Share of its velocity that cloth keeps.
    pub keep: f64,
    /// No vertex starts a step faster than this [m/s].
    pub top_speed: f64,
    /// Whether velocities are smoothed over the cloth.
    pub smooth: bool,
    /// Newton steps at most.
    pub rounds: usize,
    /// How many times its inertia counts.
    pub inertia: f64,
}

impl Pace {
    /// For cloth that is to come to rest.
    pub fn calm(step: f64, keep: f64) -> Pace {
        Pace {
            step,
            keep,
            top_speed: SPEED,
            smooth: true,
            rounds: CALM_ROUNDS,
            inertia: 1.0,
        }
    }
}

/// Positions [m] and velocities [m/s] one step ago, and how long that step was [s].
#[derive(Clone)]
pub(super) struct Past {
    x: Vec<DVec3>,
    v: Vec<DVec3>,
    step: f64,
}

/// A step in the making: from where [m], how time goes on, and where everything goes unforced [m].
struct Way {
    from: Vec<DVec3>,
    scheme: Scheme,
    target: Vec<DVec3>,
    /// How many times its inertia counts.
    inertia: f64,
    /// Whether cloth comes to rest.
    is_calm: bool,
    drag: Option<Drag>,
}

impl Way {
    /// How far everything goes unforced [m].
    fn drift(&self) -> Vec<DVec3> {
        let both = self.target.iter().zip(&self.from);
        both.map(|(t, x)| *t - *x).collect()
    }
}

/// What a Newton step did.
struct Led {
    /// How far it led 98 % of the vertices at most [m].
    most: f64,
    /// How far the one that it led farthest [m].
    farthest: f64,
    /// Whether the energy fell as its matrix said, so that another has nothing to mend.
    as_promised: bool,
    /// The pairs as they were held.
    pairs: Vec<Pair>,
}

/// What a step met of the body.
struct Met {
    touches: Vec<Touch>,
    /// Which vertices skin pushed in one of its Newton steps.
    pushed: Vec<bool>,
    /// How strongly every vertex is pressed at its end [N], where cloth moves.
    pressed: Option<Press>,
}

impl Stage<'_> {
    /// One time step.
    pub fn step(&mut self, pace: &Pace) -> Result<(), SimError> {
        awake(|| self.step_alone(pace))
    }

    fn step_alone(&mut self, pace: &Pace) -> Result<(), SimError> {
        self.watch();
        if self.is_tangled() {
            self.untangle();
        }
        let mut h = pace.step;
        for _ in 0..5 {
            if pace.smooth || h < pace.step {
                (self.kept, self.past) = (None, None);
            }
            let way = self.way(h, pace);
            if way.target != way.from {
                self.drift(&way, way.drift());
            }
            if let Some(met) = self.newton(&way, pace) {
                self.finish_step((way, met), h, pace);
                return Ok(());
            }
            self.stay(&way);
            self.v.fill(DVec3::ZERO);
            h *= 0.5;
        }
        Err(SimError::Diverged(self.steps))
    }

    /// How a step of `h` [s] follows from those before.
    fn way(&self, h: f64, pace: &Pace) -> Way {
        let from = self.x.clone();
        let past = self.past.as_ref();
        let past = past.filter(|p| self.options.second_order && h < MOST_LONGER * p.step);
        let (scheme, x1, v1) = match past {
            Some(p) => (Scheme::bdf2(h, p.step), &p.x, &p.v),
            None => (Scheme::euler(h), &from, &self.v),
        };
        let (x, v) = (&from, &self.v);
        let target = ordered::map(x.len(), |i| scheme.target([x[i], x1[i]], [v[i], v1[i]]));
        let air = if pace.smooth {
            Air::NONE
        } else {
            self.options.air
        };
        Way {
            scheme,
            target,
            drag: Drag::new(self.weave, &from, &air, (h, pace.inertia)),
            from,
            inertia: pace.inertia,
            is_calm: pace.smooth,
        }
    }

    /// Newton steps, one if that is enough: another where cloth stretches beyond its limit and that helps, or
    /// where cloth in motion was led far from where it drifted to, unless the energy fell as promised and nothing
    /// struck it.
    ///
    /// Gives the touches of the first and what they pressed in the last, or nothing if no step was
    /// finite.
    fn newton(&mut self, way: &Way, pace: &Pace) -> Option<Met> {
        let tau = way.scheme.tau;
        let first = self.touches(tau);
        let (pairs, energy) = self.start((way, pace), &first);
        let mut from = self.x.clone();
        let mut led = self.correct((way, pace), (&first, &pairs), (energy, CLOSE))?;
        let mut pressed = self.pressure(&first, &from);
        let mut pushed: Vec<bool> = pressed.iter().map(|p| *p > 0.0).collect();
        let mut last = f64::INFINITY;
        let mut again = None;
        for _ in 1..pace.rounds {
            let beyond = quality::excess(self.weave, &self.x);
            let far = !pace.smooth && led.most > LED_FAR;
            let struck = far && self.is_struck(&pressed);
            let far = far && (struck || !led.as_promised || beyond >= BEYOND);
            if !far && (beyond < BEYOND || beyond > LOWERED * last) {
                break;
            }
            last = beyond;
            // Where nobody went far, the skin is where it was seen.
            if pace.smooth || led.farthest > TURNED {
                again = Some(self.touches(tau));
            }
            let pairs = self.pairs((way, pace));
            let touches = again.as_ref().unwrap_or(&first);
            from.clone_from(&self.x);
            let tolerance = if far && !struck { CLOSE } else { LOOSE };
            led = self.correct((way, pace), (touches, &pairs), (None, tolerance))?;
            pressed = self.pressure(touches, &from);
            let both = pushed.iter_mut().zip(&pressed);
            both.for_each(|(pushed, now)| *pushed |= *now > 0.0);
        }
        let pressed = (!pace.smooth).then(|| {
            let by_cloth = pairs::pushes(&led.pairs, (&from, &self.x), &self.barrier());
            self.slip(again.as_ref().unwrap_or(&first), true);
            Press {
                by_skin: pressed,
                by_cloth,
            }
        });
        Some(Met {
            touches: first,
            pushed,
            pressed,
        })
    }

    /// Lets what is wedged slip, so that less of it is beyond its limit, for as long as that comes of it.
    fn slip(&mut self, touches: &[Touch], slides: bool) {
        self.wedged = true;
        let (mut last, mut stuck) = (f64::INFINITY, 0);
        for _ in 0..SLIPS {
            let Some(moves) = slip::moves(self.weave, &self.x, (touches, &self.near.list)) else {
                self.wedged = false;
                return;
            };
            // Where pieces of cloth are in each other's way, a move goes only a small part of its way.
            self.go(moves, slides);
            let beyond = quality::excess(self.weave, &self.x);
            stuck = if beyond < SLIPPING * last {
                0
            } else {
                stuck + 1
            };
            if stuck == STUCK {
                return;
            }
            last = beyond;
        }
    }

    /// Lets cloth at rest slip back to its limit.
    pub fn slip_at_rest(&mut self) {
        let touches = self.touches(self.options.step);
        self.slip(&touches, false);
    }

    /// How strongly skin pushes every vertex after a Newton step from `from` [N].
    fn pressure(&self, touches: &[Touch], from: &[DVec3]) -> Vec<f64> {
        let mut pressed = vec![0.0; from.len()];
        for touch in touches.iter().filter(|t| t.face.is_none()) {
            pressed[touch.verts[0] as usize] = touch.pressure(from, &self.x);
        }
        pressed
    }

    /// Whether skin presses more than a little of the cloth otherwise [N] than when the last step ended.
    fn is_struck(&self, pressed: &[f64]) -> bool {
        let (mut struck, mut all) = (0.0, 0.0);
        for (i, (now, mass)) in pressed.iter().zip(&self.weave.mass).enumerate() {
            let before = self.pressed.as_ref().map_or(0.0, |p| p.by_skin[i]);
            let otherwise = (now - before).abs() > 0.5 * now.max(before);
            struck += if otherwise { *mass } else { 0.0 };
            all += mass;
        }
        struck > STRUCK * all
    }

    /// One Newton step. `known`: the energy where it begins [J], if that is; and what it should reach.
    fn correct(
        &mut self,
        on: (&Way, &Pace),
        met: (&[Touch], &[Pair]),
        known: (Option<f64>, f64),
    ) -> Option<Led> {
        let Descent {
            mut moves,
            fell,
            pairs,
        } = self.solve(on, met, known)?;
        let mut lengths: Vec<f64> = moves.iter().map(|m| m.length()).collect();
        let [most, farthest] = [0.98, 1.0].map(|share| quality::percentile(&mut lengths, share));
        if self.ahead {
            let both = self.x.iter().zip(&on.0.from);
            let both = moves.iter_mut().zip(both);
            both.for_each(|(m, (x, from))| *m += *x - *from);
            self.stay(on.0);
        }
        self.go(moves, !on.0.is_calm);
        Some(Led {
            most,
            farthest,
            as_promised: fell.is_some_and(|share| (share - 1.0).abs() < PROMISED),
            pairs,
        })
    }

    fn finish_step(&mut self, (way, met): (Way, Met), h: f64, pace: &Pace) {
        let (x, from) = (&self.x, &way.from);
        let before = self.past.as_ref().map_or(from, |p| &p.x);
        let raw = ordered::map(x.len(), |i| {
            let v = way.scheme.velocity(x[i], [from[i], before[i]]);
            (v * pace.keep).clamp_length_max(pace.top_speed)
        });
        let old = std::mem::take(&mut self.v);
        let near = &self.weave.pattern.near;
        self.v = if pace.smooth {
            near.smoothed(raw, SMOOTHINGS)
        } else {
            let calmed = near.smoother(&raw, (h / RUB).min(1.0));
            match met.touches.is_empty() && self.pins.is_empty() {
                true => self.weave.with_momentum_of(&raw, calmed),
                false => calmed,
            }
        };
        if !pace.smooth {
            // Who is not pushed goes where he is drawn to, however near the skin.
            let vertices = met.touches.iter().filter(|t| t.face.is_none());
            for touch in vertices.filter(|t| met.pushed[t.verts[0] as usize]) {
                let i = touch.verts[0] as usize;
                self.v[i] = touch.without_bounce((old[i], self.v[i]), (self.before[i], h));
            }
        }
        self.pressed = met.pressed;
        self.past = (!pace.smooth).then_some(Past {
            x: way.from,
            v: old,
            step: h,
        });
        self.before.clone_from(&self.x);
        self.body.stand();
        self.steps += 1;
    }

    /// Lets a step begin where that costs least of where everything drifted to, where it would had neighbours
    /// drifted alike, and where it was; the pairs that push each other where it begins, and the energy
    /// there [J], where that was asked.
    fn start(&mut self, (way, pace): (&Way, &Pace), touches: &[Touch]) -> (Vec<Pair>, Option<f64>) {
        let pairs = self.pairs((way, pace));
        if self.x == way.from {
            return (pairs, None);
        }
        let pins = self.pin_targets();
        let problem = self.problem(way, (touches, &pairs, &pins));
        let (energy, still) = (problem.energy(&self.x), problem.energy(&way.from));
        if still >= energy {
            return (pairs, Some(energy));
        }
        // A few neighbours that drift apart cost more than all that is won elsewhere.
        let near = &self.weave.pattern.near;
        let alike = near.smoothed(way.drift(), ALIKE);
        self.stay(way);
        self.drift(way, alike);
        let pairs = self.pairs((way, pace));
        let problem = self.problem(way, (touches, &pairs, &pins));
        let energy = problem.energy(&self.x);
        if energy < still {
            return (pairs, Some(energy));
        }
        self.stay(way);
        (self.pairs((way, pace)), None)
    }

    /// A Newton step from where the cloth is.
    fn solve(
        &mut self,
        (way, pace): (&Way, &Pace),
        (touches, pairs): (&[Touch], &[Pair]),
        (energy, tolerance): (Option<f64>, f64),
    ) -> Option<Descent> {
        let pins = self.pin_targets();
        let mut kept = self.kept.take();
        let problem = self.problem(way, (touches, pairs, &pins));
        let (iterations, tolerance) = match pace.smooth {
            true => (self.options.iterations, 1e-3),
            false => (ITERATIONS, tolerance),
        };
        let effort = Effort {
            iterations,
            handles: self.handles.as_ref(),
            tolerance,
        };
        let descent = problem.descend((&self.x, energy), &effort, &mut kept);
        self.kept = kept;
        descent
    }

    fn problem<'b>(
        &'b self,
        way: &'b Way,
        (touches, pairs, pins): (&'b [Touch], &'b [Pair], &'b [(u32, DVec3)]),
    ) -> Problem<'b> {
        Problem {
            weave: self.weave,
            target: &way.target,
            step: way.scheme.tau / way.inertia.sqrt(),
            gravity: self.options.gravity,
            drag: way.drag.as_ref(),
            touches,
            pairs,
            is_calm: way.is_calm,
            barrier: self.barrier(),
            pins,
            pin: self.options.pin,
        }
    }

    /// The Hessian of everything but inertia where the cloth is, as rows of blocks [N/m]: where each
    /// row starts, what its blocks couple the vertex with, and they. Cloth against cloth is left out.
    pub fn resistance(&mut self) -> (Vec<u32>, Vec<u32>, Vec<DMat3>) {
        let step = self.options.step;
        self.before.clone_from(&self.x);
        let way = Way {
            from: self.x.clone(),
            scheme: Scheme::euler(step),
            target: self.x.clone(),
            inertia: 1.0,
            is_calm: true,
            drag: None,
        };
        let touches = self.touches(way.scheme.tau);
        let pins = self.pin_targets();
        let problem = self.problem(&way, (&touches, &[], &pins));
        problem.resistance(&self.x)
    }

    fn skin(&self, h: f64) -> Skin {
        let barrier = Barrier {
            radius: self.options.gap,
            width: 1e-3,
            stiffness: BODY_STIFFNESS,
        };
        Skin {
            barrier,
            stick: STICK * h,
            reach: self.options.gap + 0.012,
        }
    }

    fn touches(&mut self, h: f64) -> Vec<Touch> {
        let skin = self.skin(h);
        let mut touches = self
            .body
            .touches(self.weave, (&self.x, &self.before), &skin);
        if let Some(pressed) = &self.pressed {
            let grip = |t: &Touch| {
                let v = t.verts[0] as usize;
                t.rub.grip.min(self.weave.friction[v] * pressed.by_skin[v])
            };
            touches.iter_mut().for_each(|t| t.rub.grip = grip(t));
        }
        touches
            .iter_mut()
            .for_each(|t| t.rub.grip *= self.grips.skin);
        for &f in &self.poked {
            for w in SAMPLES {
                touches.extend(self.body.face_touch(self.weave, (&self.x, f, w), &skin));
            }
        }
        touches
    }

    fn barrier(&self) -> Barrier {
        let radius = self.weave.radius;
        Barrier {
            radius,
            width: 0.5 * radius,
            stiffness: CLOTH_STIFFNESS,
        }
    }

    /// Takes cloth along `moves` [m] from where a step began to where its Newton steps begin.
    ///
    /// Where what is near in moving cloth hardly drifts as seen from each other, who is known to be near is near
    /// there, too, and to be led once, with what the first Newton step adds, is enough.
    fn drift(&mut self, way: &Way, mut moves: Vec<DVec3>) {
        self.ahead = !way.is_calm && self.near.drift(&self.x, &moves) <= HARDLY;
        if !self.ahead {
            return self.go(moves, !way.is_calm);
        }
        make_safe(&self.near.list, &self.x, &mut moves, true);
        self.shift(moves);
    }

    /// Goes back to where a step began.
    fn stay(&mut self, way: &Way) {
        self.x.clone_from(&way.from);
        self.ahead = false;
    }

    /// Pairs that push, or soon will: of those near, or, where cloth was not yet led to, of those known.
    fn pairs(&mut self, (way, pace): (&Way, &Pace)) -> Vec<Pair> {
        let barrier = self.barrier();
        if !self.ahead {
            let cloth = (self.weave, &self.tangled[..]);
            self.near.look(cloth, &self.x, barrier.radius);
        }
        let (x, h) = (&self.x, way.scheme.tau);
        // Cloth that comes to rest has no time in which it slid or fell.
        let (from, fall) = match pace.smooth {
            true => (x, DVec3::ZERO),
            false => (&way.from, self.options.gravity * (h * h)),
        };
        let rule = Rule {
            barrier,
            friction: &self.weave.friction,
            grip: self.grips.cloth,
            stick: STICK * h,
            from,
            pushed: self.pressed.as_ref().map(|p| &p.by_cloth[..]),
            fall,
        };
        pairs::gripping(&self.near.list, x, &rule)
    }
}

/// A step this many times as long as the last has no use for the past: BDF2 is then unstable (the
/// bound is 1 + √2).
const MOST_LONGER: f64 = 2.0;
/// Newton steps at most in a step of moving cloth, and the stretch beyond the limit that asks for
/// another.
pub(crate) const ROUNDS: usize = 6;
/// Newton steps at most in a step of cloth that is to come to rest.
pub(crate) const CALM_ROUNDS: usize = 3;
const BEYOND: f64 = 0.008;
/// Share of it that a Newton step leaves at most, or shorter steps do, or another does no more: where cloth is
/// wedged, some triangle is always beyond.
pub(crate) const LOWERED: f64 = 0.75;
/// How often cloth slips in a step at most, and how often though less than a hundredth of the stretch beyond the limit
/// is gone by it.
const SLIPS: usize = 96;
const SLIPPING: f64 = 0.99;
const STUCK: usize = 8;
/// So does a correction of so much [m], what is left of which is lost motion, unless the energy fell by what was
/// promised but for this share.
const LED_FAR: f64 = 1e-3;
const PROMISED: f64 = 0.02;
/// Cloth of which skin presses more than this share otherwise than before is struck: friction goes by the blow, and
/// one step does not tell it well enough.
const STRUCK: f64 = 0.05;
/// A correction of so much asks where the skin is now [m].
const TURNED: f64 = 5e-3;
/// Iterations at most in a Newton step of moving cloth, and what they should reach: what swings is the last to be
/// solved. Less will do where cloth is only brought back to its limit, or struck.
const ITERATIONS: usize = 60;
const CLOSE: f64 = 0.02;
const LOOSE: f64 = 0.05;

/// Stiffness of skin [N/m] per touching vertex.
const BODY_STIFFNESS: f64 = 400.0;
/// Stiffness of cloth against cloth [N/m] per touching pair.
const CLOTH_STIFFNESS: f64 = 150.0;
/// How far most of what is near drifts in a step, as seen from each other, if it hardly does [m]: as far as the list of
/// pairs has slack; 2.5 mm are no faster in a dance, and without a bound thrown cloth stops dead.
const HARDLY: f64 = 1.5e-3;
/// Speed below which cloth sticks [m/s].
const STICK: f64 = 2e-3;
/// No vertex starts a step faster than this [m/s].
const SPEED: f64 = 0.4;

/// Points of a poked face that touch as well: its middle and the middles of its edges.
const SAMPLES: [[f64; 3]; 4] = [
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    [0.5, 0.5, 0.0],
    [0.0, 0.5, 0.5],
    [0.5, 0.0, 0.5],
];

/// How often velocities of cloth that is to come to rest are led to the mean of their neighbours'.
const SMOOTHINGS: usize = 3;
/// As often for cloth that drifts as its neighbours do.
const ALIKE: usize = 10;
/// Time in which a ripple of the size of the mesh calms [s]: stands for the air and the rubbing yarns, which calm it far
/// sooner than a swing, and takes out what one Newton step leaves unsolved between neighbours.
const RUB: f64 = 0.015;
