//! The step: poses, prediction, laws, and a better network.

use std::collections::BTreeMap;
use std::ops::Range;

use muslin_body::{Motion, Pose};
use muslin_model::{Encoder, Model, Reader, Skin};
use muslin_net::Weights;
use muslin_net::learn::{AdamState, Mlp, Noise};
use rayon::prelude::*;

use crate::TrainError;
use crate::begin::{self, Near};
use crate::elastic::Elastic;
use crate::factor::Factor;
use crate::lanes::{LANES, Row};
use crate::lesson::{Lesson, Plan};
use crate::pack::{Pack, looks};
use crate::pool::thinned;
use crate::prepare::{drivers, encoder, follow, packs, rescale, standardise};
use crate::skinning::{Skinning, Whose};
use crate::training::{Training, fault, fingerprints, left_out};
use crate::update::{factored, firm_at};
use crate::wearer::{Wearer, traits, wearers};
use crate::work::Work;

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
    /// Inertia; none where poses are learnt from one by one.
    pub inertia: f64,
}

impl Energies {
    /// What is made small.
    pub fn total(&self) -> f64 {
        self.terms().iter().map(|t| t.1).sum()
    }

    /// By name.
    pub fn terms(&self) -> [(&'static str, f64); 6] {
        [
            ("membrane", self.membrane),
            ("bend", self.bend),
            ("weight", self.weight),
            ("contact", self.contact),
            ("pins", self.pins),
            ("inertia", self.inertia),
        ]
    }

    pub(crate) fn add(&mut self, other: &Self, share: f64) {
        self.membrane += share * other.membrane;
        self.bend += share * other.bend;
        self.weight += share * other.weight;
        self.contact += share * other.contact;
        self.pins += share * other.pins;
        self.inertia += share * other.inertia;
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
    /// Those that wear the cloth; models are of the first.
    pub(crate) wearers: Vec<Wearer<'a>>,
    pub(crate) plan: Plan,
    pub(crate) pool: Vec<Pose>,
    pub(crate) elastic: Elastic,
    pub(crate) factor: Factor,
    /// The skin weights as they are now.
    pub(crate) skin: Skin,
    /// How they are learnt, where they are.
    pub(crate) skinning: Option<Skinning>,
    pub(crate) bones: Vec<String>,
    pub(crate) drivers: Vec<String>,
    pub(crate) scale: Vec<[f32; 2]>,
    pub(crate) encoder: Mlp,
    pub(crate) reader: Reader,
    /// The bones that the cloth follows, in the rig.
    pub(crate) rig: Vec<usize>,
    /// The model that it began with, in short.
    pub(crate) begun: Option<u64>,
    pub(crate) now: Now,
}

/// All that changes from step to step.
#[derive(Clone)]
pub(crate) struct Now {
    pub step: u64,
    pub noise: Noise,
    /// The network's, then what skin weights follow from, where they are learnt.
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
    /// The step in which that was.
    pub factored_at: u64,
    pub packs: Vec<Pack>,
    /// Packs yet to come in this round, last first.
    pub queue: Vec<u32>,
    /// Batches in a row that were not finite.
    pub bad: u64,
}

/// Keeps what seeds and steps begin apart (any large odd number).
const NEXT_SEED: u64 = 0xd6e8_feb8_6659_fd93;
/// Poses that a training needs at least.
const FEWEST: usize = 4 * LANES;
/// Poses that a motion is judged by, at most.
const JUDGED: usize = 32;

impl<'a> Trainer<'a> {
    /// Gets ready to learn from `pool`, whose poses the wearers of the `lessons` share between them. All
    /// lessons are of one cloth on one family of bodies, and differ in body, rest shape, fabric and
    /// traits; motions are judged on the first, and models are of it.
    pub fn new(lessons: Vec<Lesson<'a>>, plan: Plan, pool: Vec<Pose>) -> Result<Self, TrainError> {
        Self::ready(lessons, plan, pool, None)
    }

    /// As [`Trainer::new`], beginning with what a `model` of the same garment knows, whose triangles may be
    /// others: coarser cloth is taught in less time. Skin has all of its stiffness from the first step on.
    pub fn begun(
        lessons: Vec<Lesson<'a>>,
        plan: Plan,
        pool: Vec<Pose>,
        model: &Model,
    ) -> Result<Self, TrainError> {
        Self::ready(lessons, plan, pool, Some(model))
    }

    fn ready(
        mut lessons: Vec<Lesson<'a>>,
        plan: Plan,
        pool: Vec<Pose>,
        model: Option<&Model>,
    ) -> Result<Self, TrainError> {
        if pool.len() < FEWEST {
            return Err(TrainError::FewPoses(pool.len(), FEWEST));
        }
        // Who has no pose is not learnt from.
        lessons.truncate(pool.len() / LANES);
        let wearers = wearers(lessons, &plan)?;
        let lesson = wearers[0].lesson;
        let (rig, mut skin) = follow(&lesson)?;
        let name = |b: &usize| lesson.avatar.rig().bones[*b].name.clone();
        let bones: Vec<String> = rig.iter().map(name).collect();
        let drivers: Vec<String> = match model {
            Some(m) => m.drivers.clone(),
            None => drivers(&lesson, pool.iter()).iter().map(name).collect(),
        };
        let reader = Reader::new(lesson.avatar, &drivers)?;
        let mut noise = Noise::new(plan.seed);
        let mut packs = packs(&pool, (&wearers, &reader, &rig), &mut noise);
        let encoder = encoder(reader.n_inputs() + lesson.traits.len(), &plan);
        let scale = match model {
            Some(m) => {
                begin::fits(m, &encoder, &lesson)?;
                rescale(&mut packs, &m.scale);
                m.scale.clone()
            }
            None => standardise(&mut packs),
        };
        let elastic = Elastic::new(&wearers, firm_at(&plan, model.is_some(), 0));
        let n = lesson.template.len();
        let walls = vec![[0.0; 6]; n];
        let k = plan.codes;
        let (mut params, mut modes) = (encoder.start(&mut noise), vec![0.0; 3 * n * k]);
        if let Some(m) = model {
            let near = Near::new(m, lesson.template)?;
            modes = near.shapes(m);
            params.clone_from(&m.params);
            if plan.skinning || begin::has_learnt_skinning(m) {
                skin = near.skin(m, (&skin, &bones), &lesson.cloth.pins);
            }
        }
        let skinning = plan
            .skinning
            .then(|| Skinning::new(Whose::Ours, &skin, rig.len()));
        params.extend(skinning.iter().flat_map(Skinning::start));
        Ok(Self {
            skinning,
            factor: factored(&elastic, &walls, &plan),
            begun: model.map(begin::identity),
            now: Now {
                step: 0,
                params,
                noise,
                adam: AdamState::default(),
                modes,
                momentum: vec![0.0; 3 * n * k],
                moments: vec![0.0; k * k],
                factored: walls.clone(),
                factored_at: 0,
                walls,
                packs,
                queue: Vec::new(),
                bad: 0,
            },
            wearers,
            plan,
            reader,
            rig,
            pool,
            elastic,
            skin,
            bones,
            drivers,
            scale,
            encoder,
        })
    }

    /// The parameters of the network, and what skin weights follow from.
    pub(crate) fn parts(&self) -> (&[f32], &[f32]) {
        self.now.params.split_at(self.encoder.n_params())
    }

    /// Binds the cloth as it was learnt to be bound by now.
    pub(crate) fn bind(&mut self) {
        if let Some(skinning) = &self.skinning {
            self.skin = skinning.skin(self.parts().1);
        }
    }

    /// What the bits of the training depend on, in one line.
    pub(crate) fn identity(&self) -> String {
        let lessons = self.wearers.iter().map(|w| &w.lesson);
        let all = fingerprints(lessons, self.pool.iter());
        let begun = self.begun.map(|sum| format!(" begun {sum:016x}"));
        let begun = begun.unwrap_or_default();
        format!("{all} {:?}{begun}", self.plan)
    }

    /// How many poses there are to learn from.
    pub fn n_poses(&self) -> usize {
        self.now.packs.len() * LANES
    }

    /// The packs of the next step; every pack comes once a round.
    pub(crate) fn choose(&mut self) -> Vec<u32> {
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

    /// What a pack says of the network that is told its poses inexactly, by something else in every step.
    pub(crate) fn blurred(&self, pack: &mut Pack) -> Work {
        let blurred = self.blur(pack);
        let clear = std::mem::replace(&mut pack.inputs, blurred);
        let work = self.work(pack);
        pack.inputs = clear;
        work
    }

    /// What the network is told of a pack in this step.
    pub(crate) fn blur(&self, pack: &Pack) -> Vec<Row> {
        // The same in a training that was stopped and went on.
        let place = (self.now.step << 32) | u64::from(pack.poses[0]);
        let mut noise = Noise::new(self.plan.seed.wrapping_mul(NEXT_SEED) ^ place);
        let mut told = pack.inputs.clone();
        for x in told[..self.reader.n_inputs()].as_flattened_mut() {
            *x += self.plan.blur * noise.normal() as f32;
        }
        told
    }

    pub(crate) fn told(&self, works: &[Work]) -> Told {
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

    pub(crate) fn fault(&self, works: &[Work]) -> Option<TrainError> {
        works.iter().find_map(|w| {
            let vertex = w.broken?;
            Some(fault(&w.energies, vertex, self.now.step))
        })
    }
}

impl Training for Trainer<'_> {
    fn steps(&self) -> u64 {
        self.now.step
    }

    fn looks(&self, steps: Range<u64>) -> u64 {
        looks(&steps, self.now.packs.len() as u64, self.plan.packs as u64)
    }

    fn step(&mut self) -> Result<Told, TrainError> {
        let chosen = self.choose();
        let mut packs: Vec<Pack> = chosen
            .iter()
            .map(|k| self.now.packs[*k as usize].clone())
            .collect();
        let works: Vec<Work> = packs.par_iter_mut().map(|p| self.blurred(p)).collect();
        for (k, pack) in chosen.into_iter().zip(packs) {
            self.now.packs[k as usize] = pack;
        }
        let told = self.told(&works);
        self.now.step += 1;
        if let Some(fault) = self.fault(&works) {
            return left_out(&mut self.now.bad, fault, told);
        }
        self.now.bad = 0;
        self.learn(&works);
        Ok(told)
    }

    fn judge(&self, motion: &Motion) -> Result<Told, TrainError> {
        let some = thinned(motion.poses.clone(), JUDGED);
        if some.is_empty() {
            return Err(TrainError::FewPoses(0, 1));
        }
        // The last pack is filled up with the first poses again.
        let whole = some.len().next_multiple_of(LANES);
        let poses = &some.iter().cycle().take(whole).cloned().collect::<Vec<_>>();
        let how = (&self.wearers[..1], &self.reader, self.rig.as_slice());
        let mut packs = packs(poses, how, &mut Noise::new(0));
        rescale(&mut packs, &self.scale);
        packs.par_iter_mut().for_each(|pack| {
            let skin = |p: &u32| self.wearers[0].body.skin(&poses[*p as usize]);
            pack.skins = pack.poses.iter().map(skin).collect();
        });
        let works: Vec<Work> = packs.par_iter_mut().map(|p| self.work(p)).collect();
        Ok(self.told(&works))
    }

    fn model(&self, notes: BTreeMap<String, String>) -> Result<Model, TrainError> {
        Ok(Model {
            notes,
            faces: self.wearers[0].lesson.cloth.faces.clone(),
            template: self.wearers[0].template.clone(),
            traits: traits(&self.wearers.iter().map(|w| w.lesson).collect::<Vec<_>>()),
            bones: self.bones.clone(),
            skin: self.skin.clone(),
            drivers: self.drivers.clone(),
            scale: self.scale.clone(),
            encoder: Encoder::Plain(self.encoder.clone()),
            params: self.parts().0.to_vec(),
            modes: self.now.modes.clone(),
            sway: None,
            resizer: None,
        })
    }

    fn keep(&self) -> Result<Weights, TrainError> {
        Ok(self.kept())
    }

    fn restore(&mut self, kept: &Weights) -> Result<(), TrainError> {
        self.go_on(kept)
    }
}
