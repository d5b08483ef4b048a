//! `train`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use muslin::{DressOptions, Place, Precision, Skinning, StretchLaw, System, TrainOptions, Wear};

use super::common::{OWN, Telling, Wearing, character};

/// Options of `train`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  muslin train -o tee.muslin
  muslin train --garment tee --fabric cotton-jersey --motion clips/ --motion walk -o tee.muslin
  muslin train ncs --garment tee -o ncs.muslin     a published system on the same body and garment
  muslin train --garment trousers,tee -o look.muslin     several garments, one over the other
  muslin train --garment tee --fabric any -o tee.muslin     one garment in every fabric between those of our list

Several garments are not for snug and ncs, --fabric any not for the published systems.
OUT.csv has the curve of the training, OUT.report.json what came of it. What is learnt is kept in
OUT.muslin.part; after Ctrl-C or a crash the same command with --resume goes on to the same bits.")]
pub struct Train {
    /// A published system to teach instead of our own trainer, with its published network, losses and
    /// constants; --codes is then refused, and --fabric is for the training of snug alone.
    #[arg(value_enum)]
    pub system: Option<SystemName>,
    /// Who is learnt from: our own body, or a rigged character, a .glb, .gltf or .vrm with a skeleton and
    /// a skin.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// A built-in motion, an animation of the character's file by name, a file (BVH, VRMA, glTF or VRM, NPZ with poses),
    /// or a folder of BVH, VRMA and NPZ, to learn from; may be given several times [default: all built-in motions].
    #[arg(long, value_name = "NAME|FILE|DIR")]
    pub motion: Vec<String>,
    /// Who wears what.
    #[command(flatten)]
    pub wearing: Wearing,
    /// Whether one body is taught or any adult shape of it.
    #[arg(long, value_enum, default_value_t = Which::One)]
    pub shape: Which,
    /// Whether one size is taught or any, from a little tight to several too large.
    #[arg(long, value_enum, default_value_t = Which::One)]
    pub sizes: Which,
    /// The model, a .muslin file; of several garments OUT.GARMENT.muslin for each.
    #[arg(short, long, default_value = "tee.muslin")]
    pub out: PathBuf,
    /// A model of the same garment to begin with: of coarser cloth (--edge), which is taught in less time, of
    /// another fabric, or of fewer motions. Network, `any`s and traits must be the same; not for published systems.
    #[arg(long, value_name = "FILE.muslin")]
    pub from: Option<PathBuf>,
    /// Teach the garment with edges this long first [mm], as many steps, and begin with what it knows: short
    /// trainings come farther; not for published systems.
    #[arg(long, value_name = "MM")]
    pub coarse: Option<f64>,
    /// Steps of learning.
    #[arg(long, default_value_t = TrainOptions::default().steps)]
    pub steps: u64,
    /// Learnt shapes of the cloth that are mixed for a pose [default: 64].
    #[arg(long)]
    pub codes: Option<usize>,
    /// Poses of the motions that are learnt from, at most, and mixed ones besides, 64 in all at least; for snug and ncs,
    /// windows of poses.
    #[arg(long, default_value_t = TrainOptions::default().poses)]
    pub poses: usize,
    /// Poses mixed of those of the motions (arms between one's and another's, on a third's trunk),
    /// besides them; not for snug and ncs, which learn from poses in time [default: 900].
    #[arg(long)]
    pub mixed: Option<usize>,
    /// Width of the network's two inner layers [default: 128]; of ncs the size of its codes [default: 512].
    #[arg(long)]
    pub width: Option<usize>,
    /// Recurrent layers of snug [default: 4].
    #[arg(long)]
    pub layers: Option<usize>,
    /// Poses before a window at most that the state of snug goes through first, so that it knows states as they are long
    /// after a motion began; none as published [default: 30].
    #[arg(long)]
    pub warm: Option<usize>,
    /// Share of the samples whose motions ncs exchanges, so that its decoder meets more of them
    /// [default: 0.2].
    #[arg(long)]
    pub augment: Option<f64>,
    /// How the cloth of ncs resists stretch [default: baraff-witkin].
    #[arg(long, value_enum, value_name = "LAW")]
    pub stretch: Option<StretchName>,
    /// How the cloth comes to follow the bones [default: learnt by our own network on cores and without --relax, else
    /// given].
    #[arg(long, value_enum, value_name = "HOW")]
    pub skinning: Option<SkinningName>,
    /// Let outer garments of pbns not push those below them.
    #[arg(long)]
    pub stop_gradient: bool,
    /// Tell ncs how joints turn, but not where gravity pulls in their frames.
    #[arg(long)]
    pub without_gravity: bool,
    /// Numbers in which the file has network and shapes [default: the smallest that change next to nothing].
    #[arg(long, value_enum, value_name = "NUMBERS")]
    pub weights: Option<WeightsName>,
    /// Motions that are not learnt from but judged at the end, named as with --motion.
    #[arg(long, value_name = "NAME|FILE|DIR")]
    pub check: Vec<String>,
    /// How steeply poses that cost much count for less, as a power of what they cost; stiff cloth is taught
    /// better at 1 [default: 1.5].
    #[arg(long, value_name = "POWER")]
    pub fairness: Option<f64>,
    /// Let the cloth go so many small steps by itself after every prediction, and learn from the mean of the forces on
    /// the way: what --refine would mend counts less [default: 0].
    #[arg(long, value_name = "STEPS")]
    pub relax: Option<usize>,
    /// Step size of the network [default: 0.003; of published systems as published].
    #[arg(long)]
    pub rate: Option<f64>,
    /// The terms of the files that are learnt from (body, garment, recordings), as the model is to say them.
    #[arg(long, value_name = "TEXT")]
    pub terms: Option<String>,
    /// Where random numbers start.
    #[arg(long, default_value_t = TrainOptions::default().seed)]
    pub seed: u64,
    /// Where the steps of our own training are taken: on a CUDA device if this program was built for one
    /// (`--features cuda`) and there is one, else on the cores.
    #[arg(long, value_enum, default_value_t = DeviceName::Auto)]
    pub device: DeviceName,
    /// Also draw the garment in four of the poses every so many steps: OUT.STEP.png.
    #[arg(long, value_name = "STEPS")]
    pub picture: Option<u64>,
    /// Go on with a training that was stopped.
    #[arg(long)]
    pub resume: bool,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

impl Train {
    /// The same in the library's words.
    pub fn options(&self) -> TrainOptions {
        let usual = TrainOptions::default();
        let mut dress = self.wearing.options(usual.dress);
        let is_any = |w: &Wear| w.fabric.as_deref() == Some(ANY);
        let any_fabric = dress.outfit.iter().any(is_any);
        for worn in dress.outfit.iter_mut().filter(|w| is_any(w)) {
            worn.fabric = None;
        }
        TrainOptions {
            system: self.system.map(System::from),
            dress: DressOptions {
                body: character(&self.body),
                ..dress
            },
            from: self.from.clone(),
            coarse: self.coarse.map(|mm| mm / 1000.0),
            any_fabric,
            any_shape: self.shape == Which::Any,
            any_size: self.sizes == Which::Any,
            motion: match self.motion.is_empty() {
                true => usual.motion,
                false => self.motion.clone(),
            },
            poses: self.poses,
            mixed: self.mixed,
            width: self.width,
            check: self.check.clone(),
            steps: self.steps,
            codes: self.codes,
            layers: self.layers,
            warm: self.warm,
            without_gravity: self.without_gravity,
            augment: self.augment,
            stretch: self.stretch.map(StretchLaw::from),
            skinning: self.skinning.map(Skinning::from),
            stop_gradient: self.stop_gradient,
            fairness: self.fairness,
            relaxed: self.relax,
            weights: self.weights.map(Precision::from),
            terms: self.terms.clone(),
            seed: self.seed,
            rate: self.rate,
            device: self.device.into(),
            picture: self.picture,
            resume: self.resume,
        }
    }
}

/// One of a kind, or any.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Which {
    /// The one that is named, or the usual one.
    One,
    /// Any.
    Any,
}

/// The fabric that stands for all.
const ANY: &str = "any";

/// Names of [`System`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SystemName {
    /// Physically Based Neural Simulator (2021): pose in, cloth at rest out.
    Pbns,
    /// Self-Supervised Neural Dynamic Garments (2022): recurrent.
    Snug,
    /// Neural Cloth Simulation (2022): still and moving codes, with a motion level.
    Ncs,
}

impl From<SystemName> for System {
    fn from(name: SystemName) -> Self {
        match name {
            SystemName::Pbns => System::Pbns,
            SystemName::Snug => System::Snug,
            SystemName::Ncs => System::Ncs,
        }
    }
}

/// Names of [`StretchLaw`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum StretchName {
    /// Springs along edges, 10 N/m.
    MassSpring,
    /// Saint Venant and Kirchhoff's law, 11.1 and 20.9 N/m.
    Stvk,
    /// Yarns, 10 N/m, and shear, 1 N/m.
    BaraffWitkin,
}

impl From<StretchName> for StretchLaw {
    fn from(name: StretchName) -> Self {
        match name {
            StretchName::MassSpring => StretchLaw::MassSpring,
            StretchName::Stvk => StretchLaw::StVk,
            StretchName::BaraffWitkin => StretchLaw::BaraffWitkin,
        }
    }
}

/// Names of [`Skinning`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SkinningName {
    /// As the skin below it does, spread.
    Given,
    /// As training makes of that: cloth that no bone moves as it should is then stretched less. On cores; not for snug.
    Learnt,
}

impl From<SkinningName> for Skinning {
    fn from(name: SkinningName) -> Self {
        match name {
            SkinningName::Given => Skinning::Given,
            SkinningName::Learnt => Skinning::Learnt,
        }
    }
}

/// Names of [`Precision`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum WeightsName {
    /// 32-bit floats: as they were learnt.
    F32,
    /// 16-bit floats.
    F16,
    /// Shapes in 8-bit steps, if that moves no vertex by more than 0.5 mm; else as by default.
    I8,
}

impl From<WeightsName> for Precision {
    fn from(name: WeightsName) -> Self {
        match name {
            WeightsName::F32 => Precision::Single,
            WeightsName::F16 => Precision::Half,
            WeightsName::I8 => Precision::Eight,
        }
    }
}

/// Names of [`Place`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DeviceName {
    /// A CUDA device if there is one that can, else the cores.
    Auto,
    /// The cores.
    Cpu,
    /// The first CUDA device, or not at all.
    Cuda,
}

impl From<DeviceName> for Place {
    fn from(name: DeviceName) -> Self {
        match name {
            DeviceName::Auto => Self::Any,
            DeviceName::Cpu => Self::Cores,
            DeviceName::Cuda => Self::Cuda,
        }
    }
}
