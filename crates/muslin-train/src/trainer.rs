//! The step: poses, prediction, laws, and a better network.

use std::collections::BTreeMap;

use muslin_body::Pose;
use muslin_model::{Model, Reader, Skin};
use muslin_net::learn::{AdamState, Mlp, Noise};
use rayon::prelude::*;

use crate::TrainError;
use crate::body::Skinned;
use crate::cut::Cut;
use crate::elastic::Elastic;
use crate::factor::Factor;
use crate::folds::Folds;
use crate::lanes::LANES;
use crate::lesson::{Lesson, Plan};
use crate::pack::Pack;
use crate::prepare::{drivers, encoder, follow, packs, rescale, standardise};
use crate::update::factored;
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
    pub(crate) body: Skinned<'a>,
    pub(crate) pool: Vec<Pose>,
    pub(crate) cut: Cut,
    pub(crate) elastic: Elastic,
    pub(crate) folds: Folds,
    pub(crate) factor: Factor,
    pub(crate) skin: Skin,
    pub(crate) bones: Vec<String>,
    pub(crate) drivers: Vec<String>,
    pub(crate) scale: Vec<[f32; 2]>,
    pub(crate) encoder: Mlp,
    pub(crate) template: Vec<[f32; 3]>,
    pub(crate) reader: Reader,
    /// The bones that the cloth follows, in the rig.
    pub(crate) rig: Vec<usize>,
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
/// Batches in a row that may fail before the training does.
const MOST_BAD: u64 = 5;

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
        let drivers: Vec<String> = drivers(&lesson, &pool).iter().map(name).collect();
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
            reader,
            rig,
            pool,
            cut,
            folds: Folds::new(&lesson.cloth.faces, lesson.template, lesson.weights),
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

    /// What poses that need not be learnt from cost; too few to fill a pack tell nothing.
    pub fn judge(&self, poses: &[Pose]) -> Told {
        let how = (&self.body, &self.reader, self.rig.as_slice());
        let mut packs = packs(poses, how, &mut Noise::new(0));
        rescale(&mut packs, &self.scale);
        packs.par_iter_mut().for_each(|pack| {
            let skin = |p: &u32| self.body.skin(&poses[*p as usize]);
            pack.skins = pack.poses.iter().map(skin).collect();
        });
        let works: Vec<Work> = packs.par_iter_mut().map(|p| self.work(p)).collect();
        match works.is_empty() {
            true => Told::default(),
            false => self.told(&works),
        }
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
}
