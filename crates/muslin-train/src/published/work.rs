//! One batch: prediction, losses, and the way back to the parameters.

use std::sync::Arc;

use glam::DVec3;
use muslin_geom::widely;
use muslin_model::Encoder;
use muslin_net::learn::{View, multiply};
use rayon::prelude::*;

use super::clips::{Batch, Clips, Frame, Place};
use super::layers::{On, hand_back, lie};
use super::net::{self, Chance, Tape};
use super::recipe::Recipe;
use super::sheet::Sheet;
use super::trainer::Published;
use super::wearer::Wearer;
use super::{gravity, laws};
use crate::ground::{Posed, Wall};
use crate::lanes::{LANES, Lane, Row, Vec3, points};
use crate::laws::G;
use crate::skin;
use crate::trainer::Energies;

/// What a batch gives.
#[derive(Default)]
pub(crate) struct Work {
    /// `∂/∂params` of the mean cost of a pose; empty where something is not finite.
    pub slopes: Vec<f32>,
    pub energies: Energies,
    pub under: f64,
    /// The first vertex whose gradient is not finite.
    pub broken: Option<usize>,
}

/// What the network makes of a batch, for every decoded pose.
struct Guess {
    /// Codes (codes × lanes).
    codes: Vec<Vec<f32>>,
    tape: Tape,
    /// Corrections at rest and positions [m].
    rest: Vec<Vec<Row>>,
    x: Vec<Vec<Row>>,
}

/// What the still laws say of one pose of every window.
pub(crate) struct Asked {
    pub energies: Energies,
    under: f64,
    /// Gradient in the world, and that in the rest frame of what pins hold [N].
    pub g: Vec<Row>,
    pub held: Vec<(u32, Vec3)>,
}

impl Published<'_> {
    /// Predicts, asks the laws, and goes back as far as the parameters.
    pub(crate) fn work(&self, (clips, batch): (&Clips, &Batch), chance: &Chance) -> Work {
        let recipe = &self.course.recipe();
        let guess = self.guess(batch, chance);
        if let Some(vertex) = guess.x.iter().find_map(|x| broken(x)) {
            let energies = Energies {
                membrane: f64::NAN,
                ..Energies::default()
            };
            return Work {
                energies,
                broken: Some(vertex),
                ..Work::default()
            };
        }
        let first = batch.frames.len() - recipe.judged;
        let judged = &batch.frames[first..];
        let places: Vec<Place> = judged.iter().flat_map(|f| f.at).collect();
        let wearer = &self.wearers[batch.wearer];
        let skins = clips.skins((batch.wearer, &wearer.body), &places);
        let mut asked: Vec<Asked> = (skins.par_chunks(LANES).enumerate())
            .map(|(k, skins)| {
                let x = &guess.x[first + k];
                let met = Met::new(wearer, skins, x);
                let asked = (&x[..], &guess.rest[first + k][..]);
                ask(recipe, (&wearer.sheet, &met, self.course.one_way), asked)
            })
            .collect();
        let share = 1.0 / recipe.judged as f64;
        let mut work = Work::default();
        for a in &mut asked {
            work.energies.add(&a.energies, share);
            work.under += share * a.under;
            let share = share as f32 / LANES as f32;
            a.g.as_flattened_mut().iter_mut().for_each(|g| *g *= share);
            a.held.iter_mut().for_each(|h| h.1 = h.1 * share);
        }
        if recipe.has_inertia {
            let last = &mut asked.last_mut().expect("a pose is judged").g;
            work.energies.inertia = self.inertia(batch, &guess.x, (last, chance.order.len()));
        }
        work.broken = asked.iter().find_map(|a| broken(&a.g));
        if work.broken.is_none() {
            self.slopes(judged, (batch.wearer, &guess, &mut asked), &mut work);
        }
        work
    }

    /// What the network makes of a batch.
    fn guess(&self, batch: &Batch, chance: &Chance) -> Guess {
        let [network, modes, _] = self.parts();
        let told = (batch.told.as_slice(), batch.frames.len());
        let (mut codes, tape) = net::forward(&self.encoder, network, told, chance);
        if self.course.system.recipe().has_constant {
            codes.iter_mut().for_each(|c| c.extend([1.0; LANES]));
        }
        let template: &[[f32; 3]] = &self.laid(batch.wearer);
        let (rows, k) = (3 * template.len(), codes[0].len() / LANES);
        let shaped = |codes: &Vec<f32>| {
            let mut d = vec![[0.0; LANES]; rows];
            let (modes, codes) = (View::new(modes, rows, k), View::new(codes, k, LANES));
            multiply(d.as_flattened_mut(), 0.0, modes, codes);
            d
        };
        let rest: Vec<Vec<Row>> = codes.iter().map(shaped).collect();
        let x = (rest.par_iter().zip(&batch.frames))
            .map(|(d, frame)| self.carry((frame, template), d))
            .collect();
        Guess {
            codes,
            tape,
            rest,
            x,
        }
    }

    /// From the gradients of the judged `frames`, the last ones, to those of the parameters.
    fn slopes(
        &self,
        frames: &[Frame],
        (who, guess, asked): (usize, &Guess, &mut [Asked]),
        work: &mut Work,
    ) {
        let [network, modes, bound] = self.parts();
        let slopes = &mut work.slopes;
        slopes.resize(self.now.params.len(), 0.0);
        let (d_network, rest) = slopes.split_at_mut(network.len());
        let (d_modes, d_bound) = rest.split_at_mut(modes.len());
        let first = guess.codes.len() - frames.len();
        let (rows, k) = (guess.x[0].len(), guess.codes[0].len() / LANES);
        let mut d_codes = Vec::new();
        let all = asked.iter_mut().zip(frames).zip(&guess.codes[first..]);
        for (((a, frame), codes), d) in all.zip(&guess.rest[first..]) {
            if let Some(skinning) = &self.skinning {
                let laid = (&*self.laid(who), &d[..]);
                skinning.pull(&frame.bones, laid, &a.g, d_bound);
            }
            widely(
                #[inline(always)]
                || self.bring_back(frame, a),
            );
            let g = View::new(a.g.as_flattened(), rows, LANES);
            multiply(d_modes, 1.0, g, View::new(codes, k, LANES).transposed());
            let mut d = vec![0.0; k * LANES];
            let modes = View::new(modes, rows, k);
            multiply(&mut d, 0.0, modes.transposed(), g);
            d.truncate(self.encoder.n_codes() * LANES);
            d_codes.push(d);
        }
        net::backward(
            (&self.encoder, network),
            &guess.tape,
            &mut d_codes,
            d_network,
        );
        if let (Encoder::Ncs(n), false) = (&self.encoder, self.course.gravity) {
            gravity::deafen(n, d_network);
        }
        if let Some(skinning) = &self.skinning {
            let pins = &self.wearers[who].sheet.pins;
            work.energies.pins += skinning.slopes(bound, pins, d_bound);
        }
    }

    #[cfg(test)]
    pub(crate) fn positions(&self, batch: &Batch, chance: &Chance) -> Vec<Vec<Row>> {
        self.guess(batch, chance).x
    }

    /// From corrections at rest to positions in the poses.
    fn carry(&self, (frame, template): (&Frame, &[[f32; 3]]), d: &[Row]) -> Vec<Row> {
        let mut x = vec![[0.0; LANES]; d.len()];
        widely(
            #[inline(always)]
            || {
                for (v, t) in template.iter().enumerate() {
                    let a = skin::blend(&self.skin, v, &frame.bones);
                    let d = Vec3::of(d, v as u32);
                    let p = Vec3([0, 1, 2].map(|i| d.0[i] + t[i]));
                    skin::carry(&a, p).put(&mut x, v as u32);
                }
            },
        );
        x
    }

    /// From a gradient in the world to one in the rest frame, in place.
    #[inline(always)]
    fn bring_back(&self, frame: &Frame, asked: &mut Asked) {
        for v in 0..(asked.g.len() / 3) as u32 {
            let a = skin::blend(&self.skin, v as usize, &frame.bones);
            skin::bring_back(&a, Vec3::of(&asked.g, v)).put(&mut asked.g, v);
        }
        for (v, force) in &asked.held {
            force.add_to(&mut asked.g, *v);
        }
    }

    /// `m/(2 Δt²) |x_t − (2 x_{t−1} − x_{t−2})|²` [J], the poses before taken as they are; adds its
    /// gradient. The first lanes have none.
    fn inertia(&self, batch: &Batch, x: &[Vec<Row>], (g, without): (&mut [Row], usize)) -> f64 {
        let rate = (self.course.fps * self.course.fps) as f32;
        let mut counts = Lane::all(1.0);
        counts.0[..without].fill(0.0);
        // A mean over those that have one, as published.
        let counted = (LANES - without).max(1) as f32;
        let [two, one, now] = [3, 2, 1].map(|back| &x[x.len() - back]);
        let root = Vec3(batch.root.map(Lane));
        let mut energy = Lane::all(0.0);
        let mass = &self.wearers[batch.wearer].sheet.mass;
        for v in 0..mass.len() as u32 {
            let (a, b, c) = (Vec3::of(two, v), Vec3::of(one, v), Vec3::of(now, v));
            let change = ((c - b) - (b - a) + root).times(counts);
            let k = mass[v as usize] * rate;
            energy += change.dot(change) * (0.5 * k);
            (change * (k / counted)).add_to(g, v);
        }
        energy.sum() / f64::from(counted)
    }
}

/// The still laws at positions `x`, which come of the corrections `d`.
pub(crate) fn ask(
    recipe: &Recipe,
    (sheet, met, one_way): (&Sheet, &Met, bool),
    (x, d): (&[Row], &[Row]),
) -> Asked {
    let on = if one_way { &[][..] } else { &met.on };
    let mut push = vec![[0.0; LANES]; if on.is_empty() { 0 } else { x.len() / 3 }];
    let mut asked = widely(
        #[inline(always)]
        || sum(recipe, (sheet, &met.walls), (x, d), &mut push),
    );
    for (on, lane) in on {
        hand_back((on, *lane), (&met.walls, &push), &mut asked.g);
    }
    asked
}

#[inline(always)]
fn sum(
    recipe: &Recipe,
    (sheet, walls): (&Sheet, &[[Row; 4]]),
    (x, d): (&[Row], &[Row]),
    push: &mut [Row],
) -> Asked {
    let mut g = vec![[0.0; LANES]; x.len()];
    let stretch = laws::stretch(recipe, sheet, x, &mut g);
    let bend = laws::bend(recipe, sheet, x, &mut g);
    let [mut weight, mut contact, mut pins] = [Lane::all(0.0); 3];
    let mut under = Lane::all(0.0);
    for v in 0..x.len() / 3 {
        let here = Vec3::of(x, v as u32);
        let mut force = Vec3::of(&g, v as u32);
        let heavy = sheet.mass[v] * G;
        force.0[1] += Lane::all(heavy);
        weight += here.0[1] * heavy;
        let [nx, ny, nz, offset] = walls[v].map(Lane);
        let normal = Vec3([nx, ny, nz]);
        let gap = normal.dot(here) - offset;
        let [energy, slope] = recipe.touch.at(gap);
        contact += energy;
        force += normal.times(slope);
        if let Some(push) = push.get_mut(v) {
            *push = slope.0;
        }
        under += gap.choose_below(0.0, 1.0, 0.0);
        force.put(&mut g, v as u32);
    }
    let mut held = Vec::new();
    for &v in &sheet.pins {
        let off = Vec3::of(d, v);
        pins += off.dot(off) * recipe.pin;
        held.push((v, off * (2.0 * recipe.pin)));
    }
    let mean = |s: Lane| s.sum() / LANES as f64;
    Asked {
        energies: Energies {
            membrane: mean(stretch),
            bend: mean(bend),
            weight: mean(weight),
            contact: mean(contact),
            pins: mean(pins),
            inertia: 0.0,
        },
        under: mean(under) / (x.len() / 3) as f64,
        g,
        held,
    }
}

/// What the cloth meets in sixteen poses.
pub(crate) struct Met {
    /// The wall at every vertex: normal and offset of the nearest skin, or of the nearest cloth below, by exact
    /// distance.
    walls: Vec<[Row; 4]>,
    /// Where that is cloth, by lane.
    on: Vec<(Vec<On>, usize)>,
}

impl Met {
    /// The same in all lanes: a wearer in one `skin`, the cloth at `x` [m].
    pub fn alone(wearer: &Wearer<'_>, skin: &Posed, x: &[DVec3]) -> Self {
        let (walls, on) = meet(wearer, skin, x);
        let all = (0..LANES).map(|lane| (on.clone(), lane));
        Self {
            walls: walls.iter().map(|w| w.map(|c| [c; LANES])).collect(),
            on: all.filter(|o| !o.0.is_empty()).collect(),
        }
    }

    fn new(wearer: &Wearer<'_>, skins: &[Arc<Posed>], x: &[Row]) -> Self {
        let one = |lane: usize| meet(wearer, &skins[lane], &points(x, lane));
        let lanes: Vec<(Vec<Wall>, Vec<On>)> = (0..LANES).into_par_iter().map(one).collect();
        let of = |v: usize| [0, 1, 2, 3].map(|c| std::array::from_fn(|l| lanes[l].0[v][c]));
        let walls = (0..x.len() / 3).map(of).collect();
        let on = lanes.into_iter().enumerate().map(|(l, lane)| (lane.1, l));
        Self {
            walls,
            on: on.filter(|o| !o.0.is_empty()).collect(),
        }
    }
}

/// Walls of a cloth at `x` [m], and where they are cloth.
fn meet(wearer: &Wearer<'_>, skin: &Posed, x: &[DVec3]) -> (Vec<Wall>, Vec<On>) {
    let mut walls = wearer.body.walls(skin, x);
    let layers = wearer.layers.iter();
    let on = layers.flat_map(|l| lie(l, x, &mut walls)).collect();
    (walls, on)
}

/// The first vertex that is not finite.
pub(crate) fn broken(x: &[Row]) -> Option<usize> {
    let sound = |row: &Row| row.iter().all(|x| x.is_finite());
    x.iter().position(|row| !sound(row)).map(|at| at / 3)
}
