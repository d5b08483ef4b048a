//! The trainer of the published systems: windows, prediction, losses, and Adam.

use std::borrow::Cow;
use std::collections::BTreeMap;

use muslin_body::Motion;
use muslin_model::{Encoder, Model, Skin, Trait};
use muslin_net::Weights;
use muslin_net::learn::{Adam, AdamState, Noise};

use super::clips::{Clips, Span, Watched};
use super::gravity;
use super::net::{self, Chance};
use super::recipe::{Isotropic, NCS_WINDOW, Recipe, StretchLaw, System, sizes};
use super::resizer::{Resized, Resizing};
use super::wearer::Wearer;
use crate::lanes::LANES;
use crate::lesson::Lesson;
use crate::prepare::{drivers, follow};
use crate::skinning::{Skinning, Whose};
use crate::training::{Training, fault, fingerprints, left_out};
use crate::wearer::{of_one_cloth, traits};
use crate::{Told, TrainError};

/// How a published system is taught. The defaults are the published ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Which system.
    pub system: System,
    /// Poses a second of the motions [1/s].
    pub fps: f64,
    /// Windows that are learnt from, at most.
    pub windows: usize,
    /// Adam's step size.
    pub rate: f32,
    /// Recurrent layers of SNUG.
    pub layers: usize,
    /// Poses before a window at most that the state of SNUG goes through first; none as published.
    pub warm: usize,
    /// NCS: size of its codes.
    pub width: usize,
    /// NCS: whether it is told the direction of gravity, not turns alone.
    pub gravity: bool,
    /// NCS: share of a batch whose motions change places, from which the decoder alone learns.
    pub augmented: f64,
    /// SNUG: the cloth it is taught in, its own cotton if none is said.
    pub sheet: Option<Isotropic>,
    /// NCS: how its cloth resists stretch.
    pub stretch: StretchLaw,
    /// PBNS and NCS: whether skin weights are learnt as well.
    pub skinning: bool,
    /// PBNS: whether outer cloth does not push the cloth below it (`stop_gradient`).
    pub one_way: bool,
    /// Where random numbers start.
    pub seed: u64,
}

impl Course {
    /// As published.
    pub fn of(system: System) -> Self {
        Self {
            system,
            fps: 30.0,
            windows: usize::MAX,
            rate: 1e-3,
            layers: 4,
            warm: sizes::SNUG_WARM,
            width: sizes::NCS_CODE,
            gravity: true,
            augmented: 0.2,
            sheet: None,
            stretch: StretchLaw::BaraffWitkin,
            skinning: false,
            one_way: false,
            seed: 1,
        }
    }

    /// What it is taught by.
    pub(crate) fn recipe(&self) -> Recipe {
        let own = *self.system.recipe();
        match &self.sheet {
            Some(sheet) if self.system == System::Snug => own.of_sheet(sheet),
            _ if self.system == System::Ncs => own.by(self.stretch),
            _ => own,
        }
    }

    /// How long its windows are, where SNUG's state goes through `warm` poses first.
    pub(crate) fn span(&self, warm: usize) -> Span {
        let decoded = self.system.recipe().decoded;
        match self.system {
            System::Pbns => Span {
                lead: 0,
                told: 1,
                decoded,
            },
            // The first pose's velocity needs the pose before.
            System::Snug => Span {
                lead: 1,
                told: 3 + warm,
                decoded,
            },
            System::Ncs => {
                let (seconds, more) = NCS_WINDOW;
                let all = (seconds * self.fps).ceil() as usize + more;
                Span {
                    lead: 2,
                    told: all - 2,
                    decoded,
                }
            }
        }
    }
}

/// A published system that learns.
pub struct Published<'a> {
    /// Those that wear the cloth; models are of the first.
    pub(crate) wearers: Vec<Wearer<'a>>,
    /// How PBNS learns to lay it on the others.
    pub(crate) resizing: Option<Resizing>,
    pub(crate) course: Course,
    pub(crate) clips: Clips,
    /// The skin weights as they are now.
    pub(crate) skin: Skin,
    /// How they are learnt, where they are.
    pub(crate) skinning: Option<Skinning>,
    pub(crate) encoder: Encoder,
    traits: Vec<Trait>,
    bones: Vec<String>,
    drivers: Vec<String>,
    rig: Vec<usize>,
    pub(crate) now: Now,
}

/// All that changes from step to step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Now {
    pub step: u64,
    pub noise: Noise,
    /// The network's, then the learnt shapes: a row for every coordinate of every vertex; then what skin weights follow
    /// from, where they are learnt.
    pub params: Vec<f32>,
    pub adam: AdamState,
    /// Windows yet to come in this round, last first.
    pub queue: Vec<u32>,
    /// Batches in a row that were not finite.
    pub bad: u64,
    /// What the resizer has learnt; nothing where there is none.
    pub resized: Resized,
}

impl<'a> Published<'a> {
    /// Gets ready to learn from `motions`, brought to the course's rate where they have another. Every batch is of
    /// one of the `lessons`, which are of one cloth and differ in the body and its traits: SNUG is told those. PBNS
    /// learns poses by the first alone, and from all at rest how to resize the cloth.
    ///
    /// All learnt shapes start at zero, so that the first prediction is the skinned garment.
    pub fn new(
        lessons: Vec<Lesson<'a>>,
        course: Course,
        motions: Vec<Motion>,
    ) -> Result<Self, TrainError> {
        let motions = motions.into_iter().map(|m| at_rate(m, course.fps));
        let clips = Clips::new(motions.collect(), course.windows);
        if clips.windows.len() < LANES {
            return Err(TrainError::FewPoses(clips.windows.len(), LANES));
        }
        let recipe = course.recipe();
        let traits = traits(&lessons);
        let lesson = *of_one_cloth(&lessons)?;
        let (rig, skin) = follow(&lesson)?;
        let name = |b: &usize| lesson.avatar.rig().bones[*b].name.clone();
        let driving = drivers(&lesson, clips.motions.iter().flat_map(|m| &m.poses));
        let joint = |b: &usize| lesson.figure.joints[*b].as_vec3().to_array();
        let joints = driving.iter().map(joint).collect();
        let body = traits.iter().map(Trait::level).collect();
        let encoder = net::encoder(&course, (joints, body));
        let drivers: Vec<String> = driving.iter().map(name).collect();
        let wearer = |lesson| Wearer::new(lesson, &course, (&encoder, &traits, &drivers));
        let wearers = lessons.into_iter().map(wearer);
        let wearers = wearers.collect::<Result<Vec<_>, TrainError>>()?;
        let mut noise = Noise::new(course.seed);
        let mut params = net::start(&encoder, &mut noise);
        if let (Encoder::Ncs(n), false) = (&encoder, course.gravity) {
            gravity::deafen(n, &mut params);
        }
        let codes = encoder.n_codes() + usize::from(recipe.has_constant);
        params.resize(params.len() + 3 * lesson.template.len() * codes, 0.0);
        let whose = match course.system {
            System::Pbns => Some(Whose::Pbns),
            System::Snug => None,
            System::Ncs => Some(Whose::Ncs),
        };
        let whose = whose.filter(|_| course.skinning);
        let skinning = whose.map(|whose| Skinning::new(whose, &skin, rig.len()));
        params.extend(skinning.iter().flat_map(Skinning::start));
        let resizes = course.system == System::Pbns && wearers.len() > 1;
        let resizing = resizes.then(|| Resizing::new(&wearers, &traits, &mut noise));
        let (resizing, resized) = resizing.unzip();
        let mut out = Self {
            resizing,
            skinning,
            now: Now {
                resized: resized.unwrap_or_default(),
                step: 0,
                noise,
                params,
                adam: AdamState::default(),
                queue: Vec::new(),
                bad: 0,
            },
            bones: rig.iter().map(name).collect(),
            wearers,
            course,
            clips,
            skin,
            encoder,
            traits,
            drivers,
            rig,
        };
        out.bind();
        Ok(out)
    }

    /// The parameters of the network, the learnt shapes, and what skin weights follow from.
    pub(crate) fn parts(&self) -> [&[f32]; 3] {
        let (network, rest) = self.now.params.split_at(self.encoder.n_params());
        let bound = self.skinning.as_ref().map_or(0, Skinning::len);
        let (modes, skin) = rest.split_at(rest.len() - bound);
        [network, modes, skin]
    }

    /// Binds the cloth as it was learnt to be bound by now.
    pub(crate) fn bind(&mut self) {
        if let Some(skinning) = &self.skinning {
            self.skin = skinning.skin(self.parts()[2]);
        }
    }

    /// How many windows there are to learn from.
    pub fn n_windows(&self) -> usize {
        self.clips.windows.len()
    }

    /// What the bits of the training depend on, in one line.
    pub(crate) fn identity(&self) -> String {
        let lessons = self.wearers.iter().map(|w| &w.lesson);
        let poses = self.clips.motions.iter().flat_map(|m| &m.poses);
        format!("{} {:?}", fingerprints(lessons, poses), self.course)
    }

    /// Windows of a wearer ready to be worked on.
    pub(crate) fn watched(&self, wearer: usize, chance: &Chance) -> Watched<'_> {
        Watched {
            wearer,
            body: &self.wearers[wearer].body,
            stream: &self.wearers[wearer].stream,
            rig: &self.rig,
            n_inputs: self.encoder.n_inputs(self.drivers.len()),
            span: self.course.span(chance.warm),
        }
    }

    /// The ends of the next sixteen windows; every window comes once a round, but for those that
    /// do not fill a batch.
    fn choose(&mut self) -> [[u32; 2]; LANES] {
        let now = &mut self.now;
        if now.queue.len() < LANES {
            now.queue = (0..self.clips.windows.len() as u32).collect();
            now.noise.shuffle(&mut now.queue);
        }
        let lot = now.queue.split_off(now.queue.len() - LANES);
        std::array::from_fn(|lane| self.clips.windows[lot[lane] as usize])
    }

    /// Who wears it in the next batch.
    pub(crate) fn wearer(&mut self) -> usize {
        match self.wearers.len() {
            n if n > 1 && self.resizing.is_none() => self.now.noise.below(n),
            _ => 0,
        }
    }

    /// Where the cloth of a wearer lies at rest [m].
    pub(crate) fn laid(&self, who: usize) -> Cow<'_, [[f32; 3]]> {
        let wearer = &self.wearers[who];
        match &self.resizing {
            Some(resizing) => Cow::Owned(resizing.laid(&self.now.resized, (wearer, who))),
            None => Cow::Borrowed(&wearer.template),
        }
    }

    /// Learns from sixteen wearers at rest, if anything is to be learnt of them; gives the first vertex that is not
    /// finite.
    fn resize(&mut self) -> Option<usize> {
        let resizing = self.resizing.as_ref()?;
        let (n, now) = (self.wearers.len(), &mut self.now);
        let chosen = std::array::from_fn(|_| now.noise.below(n));
        let learnt = resizing.step(&mut now.resized, (&self.wearers, &chosen));
        learnt.err()
    }

    fn chance(&mut self) -> Chance {
        let noise = &mut self.now.noise;
        match &self.encoder {
            Encoder::Snug(s) => {
                // As well where a motion begins, which is but one of those lengths, as long after.
                let most = match noise.below(2) {
                    0 => self.course.warm.min(BEGINS),
                    _ => self.course.warm,
                };
                let warm = noise.below(most + 1);
                let mut state = |n: usize| {
                    let all = noise.normals(n * LANES).into_iter();
                    all.map(|x| x * sizes::SNUG_STATE as f32).collect()
                };
                Chance {
                    states: s.layers().map(|l| state(l.size)).collect(),
                    warm,
                    ..Chance::default()
                }
            }
            Encoder::Ncs(_) => {
                let n = (self.course.augmented * LANES as f64) as usize;
                let mut order: Vec<usize> = (0..n).collect();
                noise.shuffle(&mut order);
                Chance {
                    order,
                    ..Chance::default()
                }
            }
            Encoder::Plain(_) | Encoder::Pbns(_) => Chance::default(),
        }
    }
}

/// Poses at the beginning of a motion in which SNUG's state is still far from where it goes.
const BEGINS: usize = 2;

/// The motion with `fps` poses a second [1/s].
fn at_rate(motion: Motion, fps: f64) -> Motion {
    match motion.fps == fps {
        true => motion,
        false => motion.resampled(fps),
    }
}

impl Training for Published<'_> {
    fn steps(&self) -> u64 {
        self.now.step
    }

    fn step(&mut self) -> Result<Told, TrainError> {
        let torn = self.resize();
        let ends = self.choose();
        let chance = self.chance();
        let wearer = self.wearer();
        let batch = self.watched(wearer, &chance).batch(&self.clips, ends);
        let work = self.work((&self.clips, &batch), &chance);
        self.now.step += 1;
        let told = Told {
            step: self.now.step,
            energies: work.energies,
            under: work.under,
        };
        if let Some(vertex) = torn.or(work.broken) {
            let fault = fault(&work.energies, vertex, self.now.step);
            return left_out(&mut self.now.bad, fault, told);
        }
        self.now.bad = 0;
        let adam = Adam {
            rate: self.course.rate,
            ..Adam::default()
        };
        adam.step(&mut self.now.adam, &mut self.now.params, &work.slopes);
        self.bind();
        Ok(told)
    }

    fn judge(&self, motion: &Motion) -> Result<Told, TrainError> {
        let motion = at_rate(motion.clone(), self.course.fps);
        let clips = Clips::new(vec![motion], usize::MAX);
        let n = clips.windows.len();
        if n == 0 {
            let poses = clips.motions.iter().map(|c| c.poses.len()).sum();
            return Err(TrainError::FewPoses(poses, 2));
        }
        let ends = std::array::from_fn(|lane| clips.windows[lane * n / LANES]);
        let chance = Chance {
            warm: self.course.warm,
            ..Chance::default()
        };
        let batch = self.watched(0, &chance).batch(&clips, ends);
        let work = self.work((&clips, &batch), &chance);
        Ok(Told {
            step: self.now.step,
            energies: work.energies,
            under: work.under,
        })
    }

    fn model(&self, notes: BTreeMap<String, String>) -> Result<Model, TrainError> {
        let [network, shapes, _] = self.parts();
        let codes = self.encoder.n_codes();
        let own = codes + usize::from(self.course.system.recipe().has_constant);
        let mut modes = Vec::with_capacity(shapes.len() / own * (codes + 1));
        for row in shapes.chunks_exact(own) {
            modes.extend_from_slice(row);
            modes.resize(modes.len() + codes + 1 - own, 0.0);
        }
        Ok(Model {
            notes,
            faces: self.wearers[0].lesson.cloth.faces.clone(),
            template: self.wearers[0].template.clone(),
            bones: self.bones.clone(),
            skin: self.skin.clone(),
            drivers: self.drivers.clone(),
            scale: vec![[0.0, 1.0]; self.encoder.n_inputs(self.drivers.len())],
            encoder: self.encoder.clone(),
            params: network.to_vec(),
            modes,
            traits: match self.encoder {
                Encoder::Snug(_) => self.traits.clone(),
                Encoder::Pbns(_) if self.resizing.is_some() => self.traits.clone(),
                Encoder::Plain(_) | Encoder::Pbns(_) | Encoder::Ncs(_) => Vec::new(),
            },
            sway: None,
            resizer: (self.resizing.as_ref()).map(|r| r.model(&self.now.resized)),
        })
    }

    fn keep(&self) -> Result<Weights, TrainError> {
        Ok(super::state::keep(self))
    }

    fn restore(&mut self, kept: &Weights) -> Result<(), TrainError> {
        self.now = super::state::restored(self, kept)?;
        self.bind();
        Ok(())
    }
}
