//! The step: poses, prediction, laws, and a better network.

use std::collections::BTreeMap;

use glam::DVec3;
use muslin_body::Pose;
use muslin_model::{Model, Reader, Skin};
use muslin_net::learn::{Adam, AdamState, Mlp, MlpTape, Noise, Nonlinear, View, multiply};
use rayon::prelude::*;

use crate::TrainError;
use crate::body::{self, Skinned, Wall as Plane};
use crate::cut::Cut;
use crate::elastic::Elastic;
use crate::factor::Factor;
use crate::folds::{Folds, gathered};
use crate::lanes::{LANES, Lane, Row, Vec3};
use crate::laws::{self, Wall};
use crate::lesson::{Lesson, Plan};
use crate::pack::Pack;
use crate::skin;

/// What a pose costs on the mean [J].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Stretch and shear.
    pub membrane: f64,
    /// Bending.
    pub bend: f64,
    /// Weight, against the height of the body's root.
    pub weight: f64,
    /// Contact with the body.
    pub contact: f64,
    /// Pins.
    pub pins: f64,
}

impl Energies {
    /// What is made small.
    pub fn total(&self) -> f64 {
        self.terms().iter().map(|t| t.1).sum()
    }

    /// By name.
    pub fn terms(&self) -> [(&'static str, f64); 5] {
        [
            ("membrane", self.membrane),
            ("bend", self.bend),
            ("weight", self.weight),
            ("contact", self.contact),
            ("pins", self.pins),
        ]
    }

    fn add(&mut self, other: &Self, share: f64) {
        self.membrane += share * other.membrane;
        self.bend += share * other.bend;
        self.weight += share * other.weight;
        self.contact += share * other.contact;
        self.pins += share * other.pins;
    }
}

/// What a step tells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// Steps taken so far.
    pub step: u64,
    /// Mean costs of its poses, before the step.
    pub energies: Energies,
    /// Share of the vertices behind their wall.
    pub under: f64,
}

/// A network that learns.
pub struct Trainer<'a> {
    pub(crate) lesson: Lesson<'a>,
    pub(crate) plan: Plan,
    body: Skinned<'a>,
    pool: Vec<Pose>,
    cut: Cut,
    elastic: Elastic,
    folds: Folds,
    factor: Factor,
    skin: Skin,
    bones: Vec<String>,
    drivers: Vec<String>,
    scale: Vec<[f32; 2]>,
    encoder: Mlp,
    template: Vec<[f32; 3]>,
    pub(crate) now: Now,
}

/// All that changes from step to step.
#[derive(Clone)]
pub(crate) struct Now {
    pub step: u64,
    pub noise: Noise,
    pub params: Vec<f32>,
    pub adam: AdamState,
    /// `M`, three rows a vertex, one column a code.
    pub modes: Vec<f32>,
    pub momentum: Vec<f32>,
    /// Second moments of the codes.
    pub moments: Vec<f64>,
    /// Mean stiffness of the walls at each vertex, and that which was factored last.
    pub walls: Vec<[f32; 6]>,
    pub factored: Vec<[f32; 6]>,
    pub packs: Vec<Pack>,
    /// Packs yet to come in this round, last first.
    pub queue: Vec<u32>,
    /// Batches in a row that were not finite.
    pub bad: u64,
}

/// Poses that a training needs at least.
const FEWEST: usize = 4 * LANES;
/// Stiffness of a pin [N/m], as in the solver.
const PIN: f32 = 100.0;
/// No learnt shape changes farther than this in a step [m].
const FARTHEST: f32 = 0.01;
/// Memory of the codes' moments and of the walls' stiffness.
const MEMORY: f64 = 0.95;
/// Batches in a row that may fail before the training does.
const MOST_BAD: u64 = 5;
/// Share of the steps at the end in which step sizes fall.
const FADE: f32 = 0.4;

impl<'a> Trainer<'a> {
    /// Gets ready to learn from `pool`.
    pub fn new(lesson: Lesson<'a>, plan: Plan, pool: Vec<Pose>) -> Result<Self, TrainError> {
        if pool.len() < FEWEST {
            return Err(TrainError::FewPoses(pool.len(), FEWEST));
        }
        let cut = Cut::new(lesson.cloth)?;
        let (rig, skin) = follow(&lesson)?;
        let name = |b: &usize| lesson.avatar.rig().bones[*b].name.clone();
        let bones: Vec<String> = rig.iter().map(name).collect();
        let drivers: Vec<String> = drivers(&lesson).iter().map(name).collect();
        let reader = Reader::new(lesson.avatar, &drivers)?;
        let body = Skinned::new((lesson.avatar, lesson.figure), lesson.template);
        let mut noise = Noise::new(plan.seed);
        let mut packs = packs(&pool, (&body, &reader, &rig), &mut noise);
        let scale = standardise(&mut packs);
        let encoder = encoder(reader.n_inputs(), &plan);
        let elastic = Elastic::new(lesson.cloth, &cut, lesson.template);
        let n = cut.n_verts();
        let walls = vec![[0.0; 6]; n];
        let k = plan.codes;
        Ok(Self {
            factor: factored(&elastic, &walls, &plan),
            now: Now {
                step: 0,
                params: encoder.start(&mut noise),
                noise,
                adam: AdamState::default(),
                modes: vec![0.0; 3 * n * k],
                momentum: vec![0.0; 3 * n * k],
                moments: vec![0.0; k * k],
                factored: walls.clone(),
                walls,
                packs,
                queue: Vec::new(),
                bad: 0,
            },
            template: lesson
                .template
                .iter()
                .map(|p| p.as_vec3().to_array())
                .collect(),
            lesson,
            plan,
            body,
            pool,
            cut,
            folds: Folds::new(&lesson.cloth.faces, lesson.template),
            elastic,
            skin,
            bones,
            drivers,
            scale,
            encoder,
        })
    }

    /// What the bits of the training depend on, in one line.
    pub(crate) fn identity(&self) -> String {
        let sum = |bytes: &mut dyn Iterator<Item = f64>| {
            bytes.fold(0u64, |h, x| {
                // FNV-1a over the bits: tells trainings apart, guards against nobody.
                (h ^ x.to_bits()).wrapping_mul(0x0100_0000_01b3)
            })
        };
        let poses = self
            .pool
            .iter()
            .flat_map(|p| p.rotations.iter().flat_map(|q| q.to_array()));
        let cloth = self.lesson.template.iter().flat_map(|p| p.to_array());
        let fabric = self
            .cut
            .patches
            .iter()
            .flat_map(|p| p.stretch.map(f64::from));
        let body = self.lesson.figure.verts.iter().flat_map(|p| p.to_array());
        let parts = [
            sum(&mut { poses }),
            sum(&mut { cloth }),
            sum(&mut { fabric }),
            sum(&mut { body }),
        ];
        format!("{parts:x?} {:?}", self.plan)
    }

    /// Steps taken so far.
    pub fn steps(&self) -> u64 {
        self.now.step
    }

    /// How many poses there are to learn from.
    pub fn n_poses(&self) -> usize {
        self.now.packs.len() * LANES
    }

    /// What has been learnt so far.
    pub fn model(&self, notes: BTreeMap<String, String>) -> Model {
        Model {
            notes,
            faces: self.lesson.cloth.faces.clone(),
            template: self.template.clone(),
            bones: self.bones.clone(),
            skin: self.skin.clone(),
            drivers: self.drivers.clone(),
            scale: self.scale.clone(),
            encoder: self.encoder.clone(),
            params: self.now.params.clone(),
            modes: self.now.modes.clone(),
        }
    }

    /// Learns from the next poses.
    pub fn step(&mut self) -> Result<Told, TrainError> {
        let chosen = self.choose();
        let mut packs: Vec<Pack> = chosen
            .iter()
            .map(|k| self.now.packs[*k as usize].clone())
            .collect();
        let works: Vec<Work> = packs.par_iter_mut().map(|p| self.work(p)).collect();
        for (k, pack) in chosen.into_iter().zip(packs) {
            self.now.packs[k as usize] = pack;
        }
        let told = self.told(&works);
        self.now.step += 1;
        if let Some(fault) = self.fault(&works) {
            // A batch that fails is left out; one after the other is a fault.
            self.now.bad += 1;
            return if self.now.bad > MOST_BAD {
                Err(fault)
            } else {
                Ok(told)
            };
        }
        self.now.bad = 0;
        self.learn(&works);
        Ok(told)
    }

    /// The packs of the next step; every pack comes once a round.
    fn choose(&mut self) -> Vec<u32> {
        let now = &mut self.now;
        let one = |_| {
            if now.queue.is_empty() {
                now.queue = (0..now.packs.len() as u32).collect();
                now.noise.shuffle(&mut now.queue);
            }
            now.queue.pop().expect("there is a pack in every round")
        };
        let mut out: Vec<u32> = (0..self.plan.packs).map(one).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    fn told(&self, works: &[Work]) -> Told {
        let mut told = Told {
            step: self.now.step + 1,
            ..Told::default()
        };
        let share = 1.0 / works.len() as f64;
        for w in works {
            told.energies.add(&w.energies, share);
            told.under += share * w.under;
        }
        told
    }

    fn fault(&self, works: &[Work]) -> Option<TrainError> {
        works.iter().find_map(|w| {
            let vertex = w.broken?;
            let term = w.energies.terms().into_iter().find(|t| !t.1.is_finite());
            Some(TrainError::NotFinite {
                term: term.map_or("gradient", |t| t.0),
                step: self.now.step,
                vertex,
            })
        })
    }

    /// Slower and slower at the end.
    fn fading(&self) -> f32 {
        let done = self.now.step as f32 / self.plan.steps.max(1) as f32;
        ((1.0 - done) / FADE).clamp(0.01, 1.0)
    }

    fn learn(&mut self, works: &[Work]) {
        let share = 1.0 / works.len() as f32;
        let sum = |of: fn(&Work) -> &[f32]| {
            let mut out = vec![0.0f32; of(&works[0]).len()];
            for w in works {
                out.iter_mut().zip(of(w)).for_each(|(o, x)| *o += share * x);
            }
            out
        };
        let adam = Adam {
            rate: self.plan.rate * self.fading(),
            ..Adam::default()
        };
        adam.step(
            &mut self.now.adam,
            &mut self.now.params,
            &sum(|w| &w.d_params),
        );
        self.remember(&sum(|w| &w.moments), &sum(|w| w.walls.as_flattened()));
        let (d_modes, keep) = (sum(|w| &w.d_modes), self.plan.momentum);
        for (m, d) in self.now.momentum.iter_mut().zip(&d_modes) {
            *m = keep * *m + (1.0 - keep) * d;
        }
        let k = self.plan.codes;
        let solved = self.factor.solve(&self.now.momentum, k);
        let inverse = inverse(&self.now.moments, k, self.plan.rate_floor());
        let mut moves = vec![0.0; solved.len()];
        multiply(
            &mut moves,
            0.0,
            View::new(&solved, solved.len() / k, k),
            View::new(&inverse, k, k),
        );
        let rate = self.plan.shape_rate * self.fading();
        let largest = moves
            .chunks_exact(k)
            .map(|row| row.iter().map(|x| x * x).sum::<f32>());
        let largest = rate * largest.fold(0.0, f32::max).sqrt();
        let rate = rate * (FARTHEST / largest.max(1e-12)).min(1.0);
        self.now
            .modes
            .iter_mut()
            .zip(&moves)
            .for_each(|(m, d)| *m -= rate * d);
    }

    /// Takes codes and walls into the running means, and factors anew where that is due.
    fn remember(&mut self, moments: &[f32], walls: &[f32]) {
        let now = &mut self.now;
        let keep = if now.moments[now.moments.len() - 1] == 0.0 {
            0.0
        } else {
            MEMORY
        };
        for (m, x) in now.moments.iter_mut().zip(moments) {
            *m = keep * *m + (1.0 - keep) * f64::from(*x);
        }
        for (m, x) in now.walls.as_flattened_mut().iter_mut().zip(walls) {
            *m = keep as f32 * *m + (1.0 - keep as f32) * x;
        }
        if matches!(now.step, 1 | 5 | 20 | 60) || now.step.is_multiple_of(150) {
            now.factored.clone_from(&now.walls);
            self.refactor();
        }
    }

    /// Factors with the walls that were remembered last.
    pub(crate) fn refactor(&mut self) {
        self.factor = factored(&self.elastic, &self.now.factored, &self.plan);
    }

    /// Predicts, asks the laws, and goes back as far as the parameters.
    fn work(&self, pack: &mut Pack) -> Work {
        let mut tape = MlpTape::default();
        let inputs = (pack.inputs.as_flattened(), LANES);
        let mut codes = self
            .encoder
            .forward(&self.now.params, inputs, &mut tape)
            .to_vec();
        codes.extend([1.0; LANES]);
        let (n, k) = (self.cut.n_verts(), self.plan.codes);
        let modes = View::new(&self.now.modes, 3 * n, k);
        let codes = View::new(&codes, k, LANES);
        let mut x = vec![[0.0; LANES]; 3 * n];
        multiply(x.as_flattened_mut(), 0.0, modes, codes);
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.carry(pack, &mut x),
        );
        if pack.is_due() {
            self.find_walls(pack, &x);
        }
        pack.visits += 1;
        let mut work = Work::default();
        let mut g = vec![[0.0; LANES]; 3 * n];
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.ask(pack, (&x, &mut g), &mut work),
        );
        if work.broken.is_some() {
            return work;
        }
        let share = 1.0 / LANES as f32;
        g.as_flattened_mut().iter_mut().for_each(|g| *g *= share);
        let g = View::new(g.as_flattened(), 3 * n, LANES);
        work.d_modes = vec![0.0; 3 * n * k];
        multiply(&mut work.d_modes, 0.0, g, codes.transposed());
        let mut d_codes = vec![0.0; k * LANES];
        multiply(&mut d_codes, 0.0, modes.transposed(), g);
        work.d_params = vec![0.0; self.now.params.len()];
        d_codes.truncate((k - 1) * LANES);
        self.encoder
            .backward(&self.now.params, &tape, &d_codes, &mut work.d_params);
        work.moments = vec![0.0; k * k];
        multiply(&mut work.moments, 0.0, codes, codes.transposed());
        work.moments.iter_mut().for_each(|m| *m *= share);
        work
    }

    /// From corrections at rest to positions in the poses, in place.
    #[inline(always)]
    fn carry(&self, pack: &Pack, x: &mut [Row]) {
        for v in 0..self.template.len() {
            let a = skin::blend(&self.skin, v, &pack.bones);
            let t = self.template[v];
            let d = Vec3::of(x, v as u32);
            let p = Vec3([0, 1, 2].map(|i| d.0[i] + t[i]));
            skin::carry(&a, p).put(x, v as u32);
        }
    }

    fn find_walls(&self, pack: &mut Pack, x: &[Row]) {
        let n = self.cut.n_verts();
        if pack.skins.is_empty() {
            let pose = |p: &u32| self.body.skin(&self.pool[*p as usize]);
            pack.skins = pack.poses.par_iter().map(pose).collect();
        }
        let skins = &pack.skins;
        let each = |lane: usize| {
            let one = |p: &[Row; 3]| DVec3::from_array(p.map(|row| f64::from(row[lane])));
            let x: Vec<DVec3> = x.as_chunks::<3>().0.iter().map(one).collect();
            let mut planes: Vec<Plane> = vec![[0.0; 4]; n];
            body::walls(&mut self.body.surface(), &skins[lane], &x, &mut planes);
            (planes, self.folds.find(&x, self.plan.gap))
        };
        let all: Vec<(Vec<Plane>, Vec<(u32, Plane)>)> =
            (0..LANES).into_par_iter().map(each).collect();
        pack.walls = (0..n)
            .map(|v| [0, 1, 2, 3].map(|c| std::array::from_fn(|lane| all[lane].0[v][c])))
            .collect();
        let folds: Vec<Vec<(u32, Plane)>> = all.into_iter().map(|a| a.1).collect();
        pack.folds = gathered(&folds);
    }

    /// Costs of the positions `x`, and their gradient in the rest frame.
    #[inline(always)]
    fn ask(&self, pack: &Pack, (x, g): (&[Row], &mut [Row]), work: &mut Work) {
        let n = self.cut.n_verts();
        let membrane = laws::membrane(&self.cut, x, g);
        let mut sums = [
            membrane,
            Lane::all(0.0),
            Lane::all(0.0),
            Lane::all(0.0),
            Lane::all(0.0),
        ];
        let wall = Wall {
            radius: self.plan.gap as f32,
            width: 1e-3,
            stiffness: self.plan.skin as f32,
        };
        let mut under = Lane::all(0.0);
        work.walls = vec![[0.0; 6]; n];
        let mut folds = pack.folds.iter().peekable();
        let mut pins = self.cut.pins.iter().peekable();
        for v in 0..n {
            let here = Vec3::of(x, v as u32);
            let (bend, mut force) = laws::bending(&self.cut, x, v);
            // The pull is the gradient of the bending energy with the sign of Q's rows.
            sums[1] += bend;
            force = force + Vec3::of(g, v as u32);
            let weight = self.cut.mass[v] * laws::G;
            force.0[1] += Lane::all(weight);
            sums[2] += here.0[1] * weight;
            let a = skin::blend(&self.skin, v, &pack.bones);
            let mut stiff = [0.0; 6];
            let mut push = |plane: &[Row; 4], force: &mut Vec3| {
                let normal = Vec3([Lane(plane[0]), Lane(plane[1]), Lane(plane[2])]);
                let gap = normal.dot(here) - Lane(plane[3]);
                let [energy, slope, curvature] = wall.at(gap);
                sums[3] += energy;
                *force += normal.times(slope);
                let m = skin::bring_back(&a, normal);
                for (sum, (i, j)) in stiff.iter_mut().zip(PAIRS) {
                    *sum += (m.0[i] * m.0[j] * curvature).sum() as f32 / LANES as f32;
                }
                gap
            };
            let gap = push(&pack.walls[v], &mut force);
            under += gap.choose_below(0.0, 1.0, 0.0);
            if let Some(fold) = folds.next_if(|f| f.0 as usize == v) {
                push(&fold.1, &mut force);
            }
            work.walls[v] = stiff;
            if pins.next_if_eq(&&(v as u32)).is_some() {
                let t = self.template[v];
                let held = skin::carry(&a, Vec3(t.map(Lane::all)));
                let off = here - held;
                sums[4] += off.dot(off) * (0.5 * PIN);
                force += off * PIN;
            }
            skin::bring_back(&a, force).put(g, v as u32);
        }
        let mean = |s: Lane| s.sum() / LANES as f64;
        work.energies = Energies {
            membrane: mean(sums[0]),
            bend: mean(sums[1]),
            weight: mean(sums[2]),
            contact: mean(sums[3]),
            pins: mean(sums[4]),
        };
        work.under = mean(under) / n as f64;
        let sound = |row: &Row| row.iter().all(|x| x.is_finite());
        work.broken = g.iter().position(|row| !sound(row)).map(|at| at / 3);
    }
}

/// The entries of a symmetric 3 × 3 matrix that are kept.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// What one pack gives.
#[derive(Default)]
struct Work {
    d_modes: Vec<f32>,
    d_params: Vec<f32>,
    moments: Vec<f32>,
    walls: Vec<[f32; 6]>,
    energies: Energies,
    under: f64,
    /// The first vertex whose gradient is not finite.
    broken: Option<usize>,
}

impl Plan {
    /// Share of the codes' mean square that is added to all of them.
    fn rate_floor(&self) -> f64 {
        1e-2
    }
}

/// The bones that the cloth follows, in the rig's numbering, and how.
fn follow(lesson: &Lesson<'_>) -> Result<(Vec<usize>, Skin), TrainError> {
    let mut rig: Vec<usize> = lesson
        .weights
        .rows()
        .flatten()
        .map(|e| e.0 as usize)
        .collect();
    rig.sort_unstable();
    rig.dedup();
    if rig.len() > 255 {
        return Err(TrainError::ManyBones(rig.len()));
    }
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for row in lesson.weights.rows() {
        for &(b, w) in row {
            let at = rig
                .binary_search(&(b as usize))
                .expect("every bone was listed above");
            skin.bones.push(at as u8);
            skin.weights.push(w as f32);
        }
        skin.starts.push(skin.bones.len() as u32);
    }
    Ok((rig, skin))
}

/// The root, then the bones that move a noticeable share of the cloth.
fn drivers(lesson: &Lesson<'_>) -> Vec<usize> {
    let mut share = vec![0.0; lesson.avatar.rig().n_bones()];
    let n = lesson.template.len() as f64;
    lesson
        .weights
        .rows()
        .flatten()
        .for_each(|&(b, w)| share[b as usize] += w / n);
    let moving = (1..share.len()).filter(|b| share[*b] > 2e-3);
    std::iter::once(0).chain(moving).collect()
}

fn encoder(inputs: usize, plan: &Plan) -> Mlp {
    let mut widths = vec![inputs];
    widths.extend(&plan.hidden);
    widths.push(plan.codes - 1);
    Mlp {
        widths,
        bend: Nonlinear::Silu,
        bias: true,
    }
}

/// All poses in packs, in random order; what does not fill the last pack is left out.
fn packs(pool: &[Pose], how: (&Skinned<'_>, &Reader, &[usize]), noise: &mut Noise) -> Vec<Pack> {
    let mut order: Vec<u32> = (0..pool.len() as u32).collect();
    noise.shuffle(&mut order);
    let lots: Vec<[u32; LANES]> = order.as_chunks::<LANES>().0.to_vec();
    lots.into_par_iter()
        .map(|lot| Pack::new(lot, pool, how))
        .collect()
}

/// Brings all inputs to mean 0 and deviation 1; tells mean and 1/deviation of each.
///
/// An input that never changes has no deviation: it becomes zero.
fn standardise(packs: &mut [Pack]) -> Vec<[f32; 2]> {
    let count = (packs.len() * LANES) as f64;
    let n = packs[0].inputs.len();
    let scale: Vec<[f32; 2]> = (0..n)
        .map(|i| {
            let sum = |f: &dyn Fn(f64) -> f64| {
                let all = packs.iter().flat_map(|p| p.inputs[i].iter());
                all.map(|x| f(f64::from(*x))).sum::<f64>() / count
            };
            let mean = sum(&|x| x);
            let deviation = sum(&|x| (x - mean) * (x - mean)).sqrt();
            let inverse = if deviation > 1e-3 {
                1.0 / deviation
            } else {
                0.0
            };
            [mean as f32, inverse as f32]
        })
        .collect();
    for pack in packs {
        for (row, [mean, inverse]) in pack.inputs.iter_mut().zip(&scale) {
            row.iter_mut().for_each(|x| *x = (*x - mean) * inverse);
        }
    }
    scale
}

fn factored(elastic: &Elastic, walls: &[[f32; 6]], plan: &Plan) -> Factor {
    let factor = elastic.factor(walls, plan.damping);
    factor.expect("springs and a positive damping are positive definite")
}

/// The inverse of the moments, with a floor of that share of their mean.
fn inverse(moments: &[f64], k: usize, floor: f64) -> Vec<f32> {
    let mean = (0..k).map(|i| moments[i * k + i]).sum::<f64>() / k as f64;
    let mut a = moments.to_vec();
    (0..k).for_each(|i| a[i * k + i] += floor * mean.max(1e-12));
    // Cholesky in place, then the inverse column by column.
    for j in 0..k {
        for i in j..k {
            let dot: f64 = (0..j).map(|q| a[i * k + q] * a[j * k + q]).sum();
            let value = a[i * k + j] - dot;
            a[i * k + j] = if i == j {
                value.sqrt()
            } else {
                value / a[j * k + j]
            };
        }
    }
    let mut out = vec![0.0f32; k * k];
    for c in 0..k {
        let mut x = vec![0.0; k];
        x[c] = 1.0;
        for i in 0..k {
            let dot: f64 = (0..i).map(|q| a[i * k + q] * x[q]).sum();
            x[i] = (x[i] - dot) / a[i * k + i];
        }
        for i in (0..k).rev() {
            let dot: f64 = (i + 1..k).map(|q| a[q * k + i] * x[q]).sum();
            x[i] = (x[i] - dot) / a[i * k + i];
        }
        (0..k).for_each(|r| out[r * k + c] = x[r] as f32);
    }
    out
}
