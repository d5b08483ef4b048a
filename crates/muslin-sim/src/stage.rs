//! One step after another: the cloth, the body it meets, and what is known about both.

use glam::{DAffine3, DVec3};
use muslin_geom::{Aabb, Surface};

use crate::{
    body::Body,
    carry::{self, Carrier},
    cloth::{Cloth, SimError},
    coarse::{Factor, Handles},
    crossings,
    drape::{GoOn, Options, asked},
    near::Neighbours,
    ordered, quality, relief,
    simulate::State,
    weave::Weave,
};

mod step;

use step::Past;
pub(crate) use step::{CALM_ROUNDS, LOWERED, Pace, ROUNDS};

/// A drape in the making.
pub(crate) struct Stage<'a> {
    pub weave: &'a Weave,
    options: Options,
    pub body: Body,
    carrier: Carrier,
    pins: Vec<(u32, Held)>,
    /// Where waves cross the cloth faster than iterations on vertices do.
    handles: Option<Handles>,
    /// What handles do to the energy, as far as that may be taken from an earlier solve.
    kept: Option<Factor>,
    /// The cloth where it was last asked what is near, or meets it.
    cloth: Surface,
    near: Neighbours,
    /// Whether the cloth is where a step's Newton steps begin, and was not yet led there.
    ahead: bool,
    /// Positions [m], velocities relative to the body [m/s].
    pub x: Vec<DVec3>,
    pub v: Vec<DVec3>,
    /// Where the last step began, before the cloth was carried [m].
    before: Vec<DVec3>,
    /// The start of the last step of moving cloth, if nothing happened since that it does not tell.
    past: Option<Past>,
    /// How strongly skin and cloth pushed each vertex when the last step of moving cloth ended [N], which is what friction
    /// goes by. Where a step begins the body has moved on, and skin that meets cloth would seem to press it
    /// thousands of times its weight; that is all there is to go by where no step is known.
    pressed: Option<Press>,
    /// Vertices of faces that passed through cloth.
    tangled: Vec<bool>,
    /// Faces that the body pokes through, or might: their insides touch as well.
    pub poked: Vec<u32>,
    /// Vertices of the skin that might poke through between two vertices of the cloth.
    thin: Vec<u32>,
    /// How far each vertex of the skin may move past nearby cloth in one piece of its way [m], where that is known.
    strides: Vec<f64>,
    /// Faces that the body ever came through, where that is asked for: cloth pulled tight round an elbow needs
    /// them all until it rests.
    met: Option<Vec<u32>>,
    /// Whether cloth could not slip back to its limit in the last step.
    wedged: bool,
    /// How much of friction counts.
    pub grips: Grips,
    /// Whether cloth that is to come to rest slides on where it is stopped, too.
    pub slides: bool,
    pub steps: usize,
}

/// How much of friction counts, of 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grips {
    /// Of the skin's on cloth.
    pub skin: f64,
    /// Of cloth's on cloth.
    pub cloth: f64,
}

impl Grips {
    pub const ALL: Self = Self {
        skin: 1.0,
        cloth: 1.0,
    };
    pub const NONE: Self = Self {
        skin: 0.0,
        cloth: 0.0,
    };
}

/// How moving cloth goes on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stride {
    /// For how long, and the longest step on the way [s].
    pub time: f64,
    pub longest: f64,
    /// Newton steps at most in each.
    pub rounds: usize,
    /// How many times its inertia counts.
    pub inertia: f64,
}

/// A state to come back to.
pub(crate) struct Mark {
    x: Vec<DVec3>,
    v: Vec<DVec3>,
    past: Option<Past>,
    pressed: Option<Press>,
    skin: Vec<DVec3>,
}

/// How strongly every vertex is pressed [N].
#[derive(Clone)]
struct Press {
    by_skin: Vec<f64>,
    by_cloth: Vec<f64>,
}

/// Where a pin sits in the frame of its skin [m].
type Held = DVec3;

/// Skin this close to cloth must not jump [m], if it comes towards it and as close by as that [m].
const NEARBY: f64 = 0.025;
const BY: f64 = 0.018;
/// Thin parts of the body are watched from this far beyond the gap on [m].
const WATCHED: f64 = 4e-3;
/// Most that skin may move past nearby cloth in one piece of its way [m].
const FASTEST: f64 = 0.008;
/// The same where it is thinnest, as a finger: farther in, the nearest skin would be that of its other side. In between it is
/// the less the thinner it is.
const FASTEST_THIN: f64 = 0.003;
/// No vertex of a moving body's cloth starts a step faster than this [m/s].
const TOP_SPEED: f64 = 30.0;
/// Last steps of cloth that came to rest in haste.
const THOROUGH: usize = 2;
/// Stretch beyond the limit, of one face in a hundred, that cloth does not come back from.
pub(crate) const TORN: f64 = 0.6;
/// Most pieces that a step of the path is cut into.
const PIECES: usize = 32;

impl<'a> Stage<'a> {
    pub fn new(
        weave: &'a Weave,
        start: &[DVec3],
        skin: Surface,
        cloth: &Cloth,
        options: Options,
    ) -> Stage<'a> {
        let carrier = Carrier::new(&skin, start);
        let held = |&p: &u32| {
            let inverse = carrier.frame(p as usize, &carry::Skin::of(&skin)).inverse();
            (p, inverse.transform_point3(start[p as usize]))
        };
        let handles = options
            .handles
            .then(|| Handles::new(&weave.pattern.near, &weave.bending));
        let mut stage = Stage {
            pins: cloth.pins.iter().map(held).collect(),
            handles: handles.flatten(),
            kept: None,
            cloth: Surface::new(start, &weave.faces),
            body: Body::new(skin, start.len()),
            near: Neighbours::default(),
            ahead: false,
            x: start.to_vec(),
            v: vec![DVec3::ZERO; start.len()],
            before: start.to_vec(),
            past: None,
            pressed: None,
            tangled: vec![false; start.len()],
            poked: Vec::new(),
            thin: Vec::new(),
            strides: Vec::new(),
            met: None,
            wedged: false,
            grips: Grips::ALL,
            slides: false,
            steps: 0,
            weave,
            options,
            carrier,
        };
        stage.find_tangles();
        stage
    }

    /// From now on, where thin parts of the body come near the cloth it touches with its faces, not
    /// with its vertices alone, and they move past it in smaller pieces of their way. `cores`: as in [`relief::Frame`].
    pub fn watch_thin(&mut self, cores: &[DVec3]) {
        let skin = &self.body.now;
        let depths = ordered::map(skin.verts().len(), |i| relief::depth(skin, cores, i));
        let all = (0..).zip(&depths);
        self.thin = all
            .filter(|(_, depth)| **depth < relief::SOFT)
            .map(|(i, _)| i)
            .collect();
        let stride = |depth: f64| (FASTEST * depth / relief::SOFT).clamp(FASTEST_THIN, FASTEST);
        self.strides = depths.into_iter().map(stride).collect();
    }

    /// From now on cloth touches with the insides of its faces, too, wherever the body once came through one.
    pub fn watch_met(&mut self) {
        self.met = Some(Vec::new());
    }

    /// What is watched counts as poked through: near thin parts of the body before it is.
    fn watch(&mut self) {
        if self.thin.is_empty() && self.met.is_none() {
            return;
        }
        self.cloth.refit(&self.x);
        let tree = self.cloth.bvh();
        let reach = self.options.gap + WATCHED;
        let poked = |k: usize| {
            let at = self.body.now.verts()[self.thin[k] as usize];
            let mut near = Vec::new();
            tree.near(&Aabb::of(&[at]).grown(reach), |f| near.push(f));
            near
        };
        self.poked = ordered::map(self.thin.len(), poked).concat();
        if let Some(mut met) = self.met.take() {
            met.extend(self.in_body().iter().map(|hit| hit[0]));
            met.sort_unstable();
            met.dedup();
            self.poked.extend(&met);
            self.met = Some(met);
        }
        self.poked.sort_unstable();
        self.poked.dedup();
    }

    /// Takes the body to its next frame and the cloth along with it, in pieces so small that no skin jumps over cloth.
    pub fn follow(&mut self, frame: &[DVec3]) -> Result<(), SimError> {
        self.in_pieces(frame, |stage, to, _| {
            let motions = stage.motions_between(stage.body.now.verts(), to);
            let x = &stage.x;
            ordered::map(x.len(), |i| motions[i].transform_point3(x[i]) - x[i])
        })
    }

    /// Takes the body to its next frame and the cloth along `moves` [m], in such pieces.
    pub fn lead_in_pieces(&mut self, frame: &[DVec3], moves: &[DVec3]) -> Result<(), SimError> {
        self.in_pieces(frame, |_, _, share| {
            moves.iter().map(|m| *m * share).collect()
        })
    }

    /// Takes the body to its next frame; `moves` says how far the cloth goes along with it to a place on the way, which is
    /// so much of it away [m].
    fn in_pieces(
        &mut self,
        frame: &[DVec3],
        moves: impl Fn(&Self, &[DVec3], f64) -> Vec<DVec3>,
    ) -> Result<(), SimError> {
        let whole = moves(self, frame, 1.0);
        let pieces = self.pieces(frame, |v| whole[v]);
        if pieces == 1 {
            self.carry(frame, whole);
            return self.calm_step();
        }
        let from = self.body.now.verts().to_vec();
        for k in 1..=pieces {
            let between = part_way((&from, frame), k as f64 / pieces as f64);
            let part = moves(self, &between, 1.0 / pieces as f64);
            self.carry(&between, part);
            self.calm_step()?;
        }
        Ok(())
    }

    /// What the body's move from one place to another does to every vertex.
    pub fn motions_between(&self, from: &[DVec3], to: &[DVec3]) -> Vec<DAffine3> {
        let faces = self.body.now.faces();
        let now = carry::Skin { faces, verts: from };
        let next = carry::Skin { faces, verts: to };
        self.carrier.motions(&now, &next, &self.weave.pattern.near)
    }

    /// Into how many pieces the body's way to `frame` must be cut: skin that goes ahead, out of the body, must not
    /// jump over cloth on its way. What draws back does not, and what passes beside it does not either.
    fn pieces(&mut self, frame: &[DVec3], cloth: impl Fn(usize) -> DVec3 + Sync + Send) -> usize {
        self.cloth.refit(&self.x);
        let tree = self.cloth.bvh();
        let all = Aabb::of(&self.x).grown(NEARBY);
        let skin = self.body.now.verts();
        let needed = ordered::map(skin.len(), |i| {
            let around = Aabb::of(&[skin[i]]).grown(NEARBY);
            let allowed = self.strides.get(i).copied().unwrap_or(FASTEST);
            let (mut most, mut normal) = (allowed, None);
            if all.overlaps(&around) {
                tree.near(&around, |f| {
                    let corners = self.weave.faces[f as usize].map(|v| v as usize);
                    let way = frame[i] - skin[i] - cloth(corners[0]);
                    // A normal is dear, and nothing goes farther ahead than it goes at all.
                    if way.length_squared() <= most * most {
                        return;
                    }
                    let outward = || self.body.now.vertex_normal(i as u32);
                    let ahead = way.dot(*normal.get_or_insert_with(outward));
                    if ahead > most && comes_by(way, corners.map(|v| self.x[v] - skin[i])) {
                        most = ahead;
                    }
                });
            }
            most / allowed
        });
        let needed = needed.into_iter().fold(1.0, f64::max);
        (needed.ceil() as usize).min(PIECES)
    }

    /// Takes the body to `frame` and the cloth along `moves` [m].
    fn carry(&mut self, frame: &[DVec3], moves: Vec<DVec3>) {
        self.body.advance(frame);
        self.before.clone_from(&self.x);
        self.go(moves, false);
    }

    /// Finds what passed through cloth, and says how many pairs of faces cross.
    pub fn find_tangles(&mut self) -> usize {
        let pairs = self.in_itself();
        self.tangled.fill(false);
        for v in pairs
            .iter()
            .flatten()
            .flat_map(|f| self.weave.faces[*f as usize])
        {
            self.tangled[v as usize] = true;
        }
        self.near.gather(&self.tangled);
        pairs.len()
    }

    /// Skin vertices that the cloth is worn on.
    pub fn worn_on(&self) -> Vec<bool> {
        self.carrier.worn_on(&self.body.now)
    }

    /// Takes over a state, and knows nothing else of what was before.
    pub fn restore(&mut self, x: &[DVec3], v: &[DVec3]) {
        self.x = x.to_vec();
        self.v = v.to_vec();
        self.before = x.to_vec();
        (self.past, self.pressed) = (None, None);
        self.poked.clear();
        self.body.forget_all();
        self.body.stand();
        self.cloth = Surface::new(x, &self.weave.faces);
        self.near = Neighbours::default();
        self.find_tangles();
    }

    /// Forgets everything but the state, so that whoever resumes from it goes the same way.
    pub fn checkpoint(&mut self, frame: usize) -> State {
        let pressed = self.pressed.take().map(|p| (p.by_skin, p.by_cloth));
        let (pressed, pushed) = pressed.unwrap_or_default();
        let state = State {
            frame,
            verts: self.x.clone(),
            velocities: self.v.clone(),
            pressed,
            pushed,
        };
        self.resume(&state);
        state
    }

    /// Goes on from a state.
    pub fn resume(&mut self, state: &State) {
        self.restore(&state.verts, &state.velocities);
        let known = [&state.pressed, &state.pushed].map(|p| !p.is_empty());
        self.pressed = (known == [true; 2]).then(|| Press {
            by_skin: state.pressed.clone(),
            by_cloth: state.pushed.clone(),
        });
    }

    /// Pairs `[cloth face, body face]` that meet.
    pub fn in_body(&mut self) -> Vec<[u32; 2]> {
        self.cloth.refit(&self.x);
        self.cloth.intersections(&self.body.now)
    }

    /// Pairs of cloth faces that cross, exactly, in ascending order.
    pub fn in_itself(&mut self) -> Vec<[u32; 2]> {
        self.cloth.refit(&self.x);
        self.cloth.self_intersections()
    }

    pub fn is_tangled(&self) -> bool {
        self.tangled.contains(&true)
    }

    /// Goes on for some time, in which the body moves to `frame`, in as many steps as that needs, each of them
    /// `halved` so many times; says how many.
    pub fn live(
        &mut self,
        frame: &[DVec3],
        stride: &Stride,
        halved: usize,
    ) -> Result<usize, SimError> {
        self.kept = None;
        let drift: Vec<DVec3> = self.v.iter().map(|v| *v * stride.time).collect();
        let pieces = self.pieces(frame, |v| drift[v]);
        let pieces = pieces.max((stride.time / stride.longest).ceil() as usize) << halved;
        let from = self.body.now.verts().to_vec();
        let pace = Pace {
            step: stride.time / pieces as f64,
            keep: 1.0,
            top_speed: TOP_SPEED,
            smooth: false,
            rounds: stride.rounds,
            inertia: stride.inertia,
        };
        for k in 1..=pieces {
            let between = part_way((&from, frame), k as f64 / pieces as f64);
            self.body.advance(&between);
            self.before.clone_from(&self.x);
            self.step(&pace)?;
        }
        Ok(pieces)
    }

    /// How far the worst face is beyond its limit, if the last step could not let all slip back to it; else zero.
    pub fn wedged(&self) -> f64 {
        match self.wedged {
            true => quality::excess(self.weave, &self.x).max(0.0),
            false => 0.0,
        }
    }

    /// To come [`Stage::back`] to.
    pub fn mark(&self) -> Mark {
        Mark {
            x: self.x.clone(),
            v: self.v.clone(),
            past: self.past.clone(),
            pressed: self.pressed.clone(),
            skin: self.body.now.verts().to_vec(),
        }
    }

    /// Goes back to where all was at a mark; what a step began with, the next one sets.
    pub fn back(&mut self, mark: &Mark) {
        self.x.clone_from(&mark.x);
        self.v.clone_from(&mark.v);
        self.past.clone_from(&mark.past);
        self.pressed.clone_from(&mark.pressed);
        self.body.now.refit(&mark.skin);
        self.body.forget();
        self.find_tangles();
    }

    /// Gives the cloth the velocity that it has if it goes along with a body which goes from one place to
    /// another within `time` [s].
    pub fn set_off(&mut self, (from, to): (&[DVec3], &[DVec3]), time: f64) {
        let motions = self.motions_between(from, to);
        let by = |(x, m): (&DVec3, &DAffine3)| (m.transform_point3(*x) - *x) / time;
        self.v = self.x.iter().zip(&motions).map(by).collect();
    }

    /// Lets the cloth lie still where it is.
    pub fn halt(&mut self) {
        self.v.fill(DVec3::ZERO);
        self.past = None;
    }

    /// One step in which the body gives way or comes back; cloth is not taken along.
    pub fn give_way(&mut self, frame: &[DVec3]) -> Result<(), SimError> {
        self.body.advance(frame);
        self.before.clone_from(&self.x);
        self.step(&Pace::calm(self.options.step, 0.5))
    }

    /// Solves each step by so many iterations at most from now on; what it was.
    pub fn iterate(&mut self, iterations: usize) -> usize {
        std::mem::replace(&mut self.options.iterations, iterations)
    }

    /// One step from rest to rest.
    pub fn calm_step(&mut self) -> Result<(), SimError> {
        self.step(&self.hasty(0.0))
    }

    /// A step towards rest, with as many Newton steps as are asked for.
    pub fn hasty(&self, keep: f64) -> Pace {
        Pace {
            rounds: self.options.rounds,
            ..Pace::calm(self.options.step, keep)
        }
    }

    /// From now on every pin holds its vertex where it is, as a waistband slips that is pulled.
    pub fn slip_pins(&mut self) {
        let skin = carry::Skin::of(&self.body.now);
        for (p, held) in &mut self.pins {
            let inverse = self.carrier.frame(*p as usize, &skin).inverse();
            *held = inverse.transform_point3(self.x[*p as usize]);
        }
    }

    fn pin_targets(&self) -> Vec<(u32, DVec3)> {
        let at = |&(p, held): &(u32, Held)| {
            (
                p,
                self.carrier
                    .frame(p as usize, &carry::Skin::of(&self.body.now))
                    .transform_point3(held),
            )
        };
        self.pins.iter().map(at).collect()
    }

    /// Puts the body into its next frame, and leads the cloth along `moves` [m], as far as it can go
    /// without passing through itself. There both are at rest.
    pub fn lead(&mut self, frame: &[DVec3], moves: Vec<DVec3>) {
        self.body.advance(frame);
        self.go(moves, false);
        self.before.clone_from(&self.x);
        self.v.fill(DVec3::ZERO);
        self.past = None;
        self.body.stand();
    }

    /// Moves the cloth along `moves` [m], as far as it can go without passing through itself; whether it `slides` on there.
    fn go(&mut self, mut moves: Vec<DVec3>, slides: bool) {
        let cloth = (self.weave, &self.tangled[..]);
        let slides = slides || self.slides;
        self.near.lead(cloth, &self.x, &mut moves, slides);
        self.shift(moves);
    }

    /// Moves the cloth all the way along `moves` [m].
    fn shift(&mut self, moves: Vec<DVec3>) {
        self.x.iter_mut().zip(moves).for_each(|(x, m)| *x += m);
    }

    /// Shortens crossing lines a little, and looks again.
    fn untangle(&mut self) {
        let pairs = self.in_itself();
        let found = crossings::piercings(self.weave, &self.x, &pairs);
        let moves = crossings::way_back(self.weave, &self.x, &found, 1e-3);
        self.shift(moves);
        self.past = None;
        self.find_tangles();
    }

    /// Whether one face in a hundred is so far beyond its limit that further steps would take long and come to nothing.
    pub fn is_torn(&self) -> bool {
        quality::excess_p99(self.weave, &self.x) > TORN
    }

    /// Steps until the cloth rests, is torn or the steps run out; says whether it rests.
    pub fn settle(&mut self, go_on: GoOn<'_>) -> Result<bool, SimError> {
        let mut calm = 0;
        for k in 0..self.options.last_steps {
            asked(go_on)?;
            if k % 10 == 0 {
                self.find_tangles();
            }
            let late = k as f64 / self.options.last_steps as f64;
            let keep = self.options.keep * (1.0 - 0.5 * late * late);
            self.step(&self.hasty(keep))?;
            if self.is_torn() {
                return Ok(false);
            }
            calm = if self.speed() < self.options.still {
                calm + 1
            } else {
                0
            };
            if calm >= 3 && !self.is_tangled() {
                self.finish()?;
                return Ok(true);
            }
        }
        self.finish()?;
        Ok(false)
    }

    /// What was left undone by fewer Newton steps than [`Pace::calm`] has.
    fn finish(&mut self) -> Result<(), SimError> {
        if self.options.rounds >= CALM_ROUNDS {
            return Ok(());
        }
        let pace = Pace::calm(self.options.step, 0.5 * self.options.keep);
        (0..THOROUGH).try_for_each(|_| self.step(&pace))
    }

    /// Speed below which 99 % of the vertices are [m/s].
    pub fn speed(&self) -> f64 {
        let mut speeds: Vec<f64> = self.v.iter().map(|v| v.length()).collect();
        quality::percentile(&mut speeds, 0.99)
    }
}

/// Whether a straight way from the origin comes by one of these points [m].
fn comes_by(way: DVec3, points: [DVec3; 3]) -> bool {
    let by = |p: DVec3| {
        let t = p.dot(way) / way.length_squared();
        p.distance_squared(way * t.clamp(0.0, 1.0)) < BY * BY
    };
    points.into_iter().any(by)
}

/// Positions [m] at the share `t` of the straight way between two.
pub(crate) fn part_way((from, to): (&[DVec3], &[DVec3]), t: f64) -> Vec<DVec3> {
    from.iter().zip(to).map(|(a, b)| a.lerp(*b, t)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{balls, sheets};

    #[test]
    fn skin_passes_cloth_in_the_more_pieces_the_thinner_what_it_covers_is() {
        let (cloth, flat) = sheets(0.05);
        let weave = Weave::new(&cloth).expect("valid");
        let (skin, faces) = balls(0.4);
        let middle = DVec3::X * 0.2;
        let before = middle + DVec3::new(-0.055, -0.055, 0.105);
        let x: Vec<DVec3> = flat.iter().map(|p| *p + before).collect();
        let ahead: Vec<DVec3> = skin.iter().map(|p| *p + DVec3::Z * 0.016).collect();
        let pieces = |depth: f64| {
            let core = |p: &DVec3| {
                let centre = middle * p.x.signum();
                *p + (centre - *p).normalize() * depth
            };
            let cores: Vec<DVec3> = skin.iter().map(core).collect();
            let body = Surface::new(&skin, &faces);
            let mut stage = Stage::new(&weave, &x, body, &cloth, Options::USUAL);
            stage.watch_thin(&cores);
            assert_eq!(stage.thin.is_empty(), depth >= relief::SOFT);
            stage.pieces(&ahead, |_| DVec3::ZERO)
        };
        // 16 mm at 8, a little under 4 and 3 mm a piece: a thigh, a wrist, a finger.
        assert_eq!([0.04, 0.0124, 0.005].map(pieces), [2, 5, 6]);
    }
}
