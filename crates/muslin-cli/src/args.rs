//! The words of the command line.

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use muslin::bench::{Trials, Walks};
use muslin::{
    Against, AnimateOptions, Backdrop, Bake, Cut, DressOptions, EvaluateOptions, Person, Place,
    Precision, SimulateOptions, Size, Skinning, StretchLaw, System, TrainOptions, Wear,
};

/// Dresses any body in moving cloth: from a photo to a 3D figure wearing draped garments.
#[derive(Debug, Parser)]
#[command(version, about, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// The verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Dress the person in a photo.
    Dress(Dress),
    /// Dress the person in a built-in photo; needs no file.
    Demo(Demo),
    /// Move an outfit on a moving body: an animation of cloth.
    Simulate(Simulate),
    /// Teach a garment to lie on a moving body, without one simulated frame.
    Train(Train),
    /// Play a trained garment on a motion, each frame led to rest by a few solver iterations.
    Animate(Animate),
    /// Show what there is: garments, fabrics, poses or motions.
    List {
        /// What to list.
        what: Kind,
        /// Machine-readable.
        #[arg(long)]
        json: bool,
    },
    /// Say what files are, and whether garments, bodies, motions, fabrics, models and photos can be used.
    Check(Check),
    /// Judge animated cloth: energies, stretch, penetration, crossings, drift.
    Evaluate(Evaluate),
    /// Print the figures of merit, measured on this machine.
    Bench(Bench),
}

/// Options of `dress`.
#[derive(Debug, Args)]
pub struct Dress {
    /// Photo that shows one whole person (JPEG, PNG or WebP).
    #[arg(required_unless_present = "pose")]
    pub photo: Option<PathBuf>,
    /// Dress the standard body in a built-in pose instead of a photo (see `muslin list poses`).
    #[arg(long, conflicts_with = "photo")]
    pub pose: Option<String>,
    /// Options shared with `demo`.
    #[command(flatten)]
    pub common: Common,
}

/// Options of `demo`.
#[derive(Debug, Args)]
pub struct Demo {
    /// Options shared with `dress`.
    #[command(flatten)]
    pub common: Common,
}

/// What `dress` and `demo` share.
#[derive(Debug, Args)]
pub struct Common {
    /// Who wears what.
    #[command(flatten)]
    pub wearing: Wearing,
    /// Whom to dress when there are several: a number from 1 (the largest), or `all`.
    #[arg(long, value_parser = person)]
    pub person: Option<Person>,
    /// Solve the whole way from the body at rest, instead of starting from how trained garments of the
    /// wardrobe say that they lie.
    #[arg(long)]
    pub simulate: bool,
    /// Also draw the fitted body over the photo (overlay.png).
    #[arg(long)]
    pub overlay: bool,
    /// Folder for the results.
    #[arg(short, long, default_value = "out")]
    pub out: PathBuf,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

/// A body's build and its garments' size, as far as they are asked for.
#[derive(Debug, Args)]
pub struct Build {
    /// Standing height [cm]; kept exactly.
    #[arg(long)]
    pub height: Option<f64>,
    /// Body weight [kg].
    #[arg(long)]
    pub weight: Option<f64>,
    /// From 0 (male) to 1 (female) on the body's own scale.
    #[arg(long)]
    pub gender: Option<f64>,
    /// What the garments' label says, whoever wears them: XS, S, M, L, XL or XXL (EN 13402-3, by the chest)
    /// [default: made to measure; on our own body a garment of a file has the size of its file].
    #[arg(long, value_parser = Size::parse)]
    pub size: Option<Size>,
}

/// A body and its clothes.
#[derive(Debug, Args)]
pub struct Wearing {
    /// Garment or file (.json pattern, .obj mesh), or GARMENT:FABRIC; innermost first, repeated or comma-separated
    /// [default: trousers,tee; a tee for `simulate`].
    #[arg(long, visible_alias = "outfit", value_delimiter = ',')]
    pub garment: Vec<String>,
    /// Fabric of every garment that names none (see `muslin list fabrics`), or a file of your own:
    /// TOML, or the physics of a U3M or U3MA.
    #[arg(long)]
    pub fabric: Option<String>,
    /// Whose body.
    #[command(flatten)]
    pub build: Build,
    /// How loosely the garments are cut.
    #[arg(long, value_enum, default_value_t = CutName::Regular)]
    pub cut: CutName,
    /// Triangle edge of the garments [mm], 5 to 25.
    #[arg(long, default_value_t = 12.0)]
    pub edge: f64,
    /// Write the result even if the cloth crosses itself somewhere.
    #[arg(long)]
    pub allow_crossings: bool,
    /// What lies behind the figure.
    #[arg(long, value_enum, default_value_t = BackdropName::Studio)]
    pub backdrop: BackdropName,
}

/// What a job prints.
#[derive(Debug, Args)]
pub struct Telling {
    /// Print the report on standard output instead of the table.
    #[arg(long)]
    pub json: bool,
    /// No progress on standard error.
    #[arg(short, long)]
    pub quiet: bool,
}

/// What of a motion is made, and how an animation is written.
#[derive(Debug, Args)]
pub struct Shot {
    /// How garments are written in the animation: `frames` (each exactly as it is, a morph target),
    /// `morphs[:N]` (N targets that are mixed, else 32, above a few bones: a small file for the web) or
    /// `bones[:N]` (N bones of the garment's own, else 128, and no target: for phones and engines). Skin
    /// that stays covered is left out of a baked file.
    #[arg(long, value_name = "HOW", default_value = "frames", value_parser = Bake::parse)]
    pub bake: Bake,
    /// Also draw the last frame (OUT.png) and a film (OUT.film.png, animated).
    #[arg(long)]
    pub picture: bool,
    /// Let the film's camera go around the body once, as on a turntable.
    #[arg(long, requires = "picture")]
    pub turn: bool,
    /// How much of the motion [s] [default: all].
    #[arg(long)]
    pub seconds: Option<f64>,
    /// Where in the motion to start [s].
    #[arg(long, default_value_t = 0.0)]
    pub start: f64,
}

impl Shot {
    /// Its part of the library's options.
    fn of(&self, options: SimulateOptions) -> SimulateOptions {
        SimulateOptions {
            bake: self.bake,
            picture: self.picture,
            turn: self.turn,
            seconds: self.seconds,
            start: self.start,
            ..options
        }
    }
}

/// Options of `simulate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  muslin simulate -o walk.glb
  muslin simulate --motion dance.bvh --start 2 --seconds 4 --outfit tee,trousers:denim -o dance.glb
  muslin simulate --motion spin --npz spin.npz -o spin.glb && muslin evaluate spin.npz
  muslin simulate --motion takes/ --motion run -o out      one on each core, out/NAME.glb
  muslin simulate --body hero.glb --motion Idle -o hero-dressed.glb     a character, in its own animation

What is done is kept in OUT.part; after Ctrl-C or a crash the same command with --resume goes on
from there, to the same bits. OUT.report.json says how good the result is.")]
pub struct Simulate {
    /// Who wears it: our own body, or a rigged character, a .glb, .gltf or .vrm with a skeleton and a skin.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// A built-in motion (see `muslin list motions`), an animation of the character's file by name, a
    /// file (BVH, or NPZ with poses), or a folder
    /// of these; may be given several times.
    #[arg(long, default_value = "walk", value_name = "NAME|FILE|DIR")]
    pub motion: Vec<String>,
    /// Who wears what.
    #[command(flatten)]
    pub wearing: Wearing,
    /// The animation, a .glb file; with several motions a folder for NAME.glb each.
    #[arg(short, long, default_value = "walk.glb")]
    pub out: PathBuf,
    /// Also write arrays in the exchange layout; with several garments FILE.GARMENT.npz each, with
    /// several motions DIR/NAME.npz.
    #[arg(long, value_name = "FILE.npz")]
    pub npz: Option<PathBuf>,
    /// Also write a point cache and an OBJ of every garment and of the body into this folder.
    #[arg(long, value_name = "DIR")]
    pub pc2: Option<PathBuf>,
    /// What of it is made, and how.
    #[command(flatten)]
    pub shot: Shot,
    /// Frames a second, 12 to 240.
    #[arg(long, default_value_t = 60.0)]
    pub fps: f64,
    /// Second order in time (BDF2): swings and ripples keep more of their energy, frames take
    /// longer.
    #[arg(long)]
    pub bdf2: bool,
    /// Density of the air that cloth moves through [kg/m³]; 0 for none.
    #[arg(long, default_value_t = SimulateOptions::default().air)]
    pub air: f64,
    /// Wind [m/s], in the animation's axes, Y up: --wind 0,0,-6 blows into the face of who looks along Z.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, default_value = "0,0,0")]
    pub wind: [f64; 3],
    /// Go on with a simulation that was stopped.
    #[arg(long)]
    pub resume: bool,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

/// Options of `train`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  muslin train -o tee.muslin
  muslin train --garment tee --fabric cotton-jersey --motion clips/ --motion walk -o tee.muslin
  muslin train ncs --garment tee -o ncs.muslin     a published system on the same body and garment
  muslin train --garment trousers,tee -o look.muslin     several garments, one over the other

OUT.csv has the curve of the training, OUT.report.json what came of it. What is learnt is kept in
OUT.muslin.part; after Ctrl-C or a crash the same command with --resume goes on to the same bits.")]
pub struct Train {
    /// A published system to teach instead of our own trainer, with its published network, losses and
    /// constants; --codes is then not for the training, --fabric for that of snug alone.
    #[arg(value_enum)]
    pub system: Option<SystemName>,
    /// Who is learnt from: our own body, or a rigged character, a .glb, .gltf or .vrm with a skeleton and
    /// a skin.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// A built-in motion, an animation of the character's file by name, a file (BVH, or NPZ with poses),
    /// or a folder of these, to learn from; may
    /// be given several times [default: all built-in motions].
    #[arg(long, value_name = "NAME|FILE|DIR")]
    pub motion: Vec<String>,
    /// Who wears what; one garment, or several, one over the other (not for snug and ncs). `--fabric any` teaches one
    /// garment every fabric: between cloths of our list.
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
    /// another fabric, or of fewer motions. Network, `any`s and traits must be the same.
    #[arg(long, value_name = "FILE.muslin")]
    pub from: Option<PathBuf>,
    /// Teach the garment with edges this long first [mm], as many steps, and begin with what it knows: short
    /// trainings come farther.
    #[arg(long, value_name = "MM")]
    pub coarse: Option<f64>,
    /// Steps of learning.
    #[arg(long, default_value_t = TrainOptions::default().steps)]
    pub steps: u64,
    /// Learnt shapes of the cloth that are mixed for a pose [default: 64].
    #[arg(long)]
    pub codes: Option<usize>,
    /// Poses of the motions that are learnt from, at most; for snug and ncs, windows of poses.
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

/// Options of `animate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  muslin animate --model tee.muslin --motion walk -o walk.glb
  muslin animate --model tee.muslin --motion dance.bvh --npz dance.npz --picture -o dance.glb
  muslin animate --model tee.muslin --motion walk --refine 0 -o raw.glb      as predicted, unchecked
  muslin animate --garment skirt --motion spin --motion-level 0.7            with less swing
  muslin animate --garment trousers:denim,tee --motion run -o run.glb        one over the other
  muslin animate --garment tee --motion walk --bake morphs -o small.glb      a small file for the web
  muslin animate --body hero.glb --model hero-tee.muslin --motion walk       a character, taught with train --body

OUT.report.json says how good the result is.")]
pub struct Animate {
    /// Garments of the wardrobe, trained already: tee, trousers, shorts, skirt or dress; or GARMENT:FABRIC;
    /// innermost first, repeated or comma-separated [default: tee].
    #[arg(
        long,
        visible_alias = "outfit",
        value_name = "NAME",
        value_delimiter = ',',
        conflicts_with = "model"
    )]
    pub garment: Vec<String>,
    /// A model of your own, as `muslin train` wrote it; given several times, they are worn one over the
    /// other, innermost first.
    #[arg(long, value_name = "FILE.muslin")]
    pub model: Vec<PathBuf>,
    /// Who wears it: our own body, or a rigged character (.glb, .gltf, .vrm), as a rule the one that the
    /// model was taught on.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// Another fabric than it was taught in (see `muslin list fabrics`), or a file of your own: the
    /// solver's iterations turn its folds into that fabric's.
    #[arg(long)]
    pub fabric: Option<String>,
    /// Another body than it was taught on.
    #[command(flatten)]
    pub build: Build,
    /// A built-in motion (see `muslin list motions`) or a file (BVH, or NPZ with poses).
    #[arg(long, default_value = "walk", value_name = "NAME|FILE")]
    pub motion: String,
    /// Solver iterations a frame, or for each step in time of cloth that swings: 5 at least; 0 writes frames as
    /// predicted, unchecked.
    #[arg(long, default_value_t = 5)]
    pub refine: usize,
    /// How much motion counts, 0 to 10: 1 as in nature, 0 as if the body stood still in every pose. With
    /// --refine it is the cloth's inertia; not for models of `muslin train pbns|snug` [default: 1].
    #[arg(long)]
    pub motion_level: Option<f64>,
    /// The animation, a .glb file.
    #[arg(short, long, default_value = "walk.glb")]
    pub out: PathBuf,
    /// Also write arrays in the exchange layout.
    #[arg(long, value_name = "FILE.npz")]
    pub npz: Option<PathBuf>,
    /// Also write a point cache and an OBJ of the garment and of the body into this folder.
    #[arg(long, value_name = "DIR")]
    pub pc2: Option<PathBuf>,
    /// What of it is made, and how.
    #[command(flatten)]
    pub shot: Shot,
    /// Frames a second, 12 to 240.
    #[arg(long, default_value_t = 30.0)]
    pub fps: f64,
    /// Write the result even if cloth meets cloth or body somewhere.
    #[arg(long)]
    pub allow_crossings: bool,
    /// What lies behind the figure.
    #[arg(long, value_enum, default_value_t = BackdropName::Studio)]
    pub backdrop: BackdropName,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
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

/// Names of [`Skinning`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SkinningName {
    /// As the skin below it does, spread.
    Given,
    /// As training makes of that: cloth that no bone moves as it should is then stretched less. On cores; not for snug.
    Learnt,
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

/// The name of the embedded body.
const OWN: &str = "anny";

/// The character's file, if it is not the embedded body.
fn character(body: &Path) -> Option<PathBuf> {
    (body.as_os_str() != OWN).then(|| body.to_owned())
}

/// Options of `check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Garments (.obj, .json), fabrics (.toml, .u3m), motions (.bvh, .npz), characters (.glb, .gltf, .vrm), trained
    /// garments (.muslin), photos and animated cloth.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Who is to wear the garments and move as the motions say: our own body, or a character.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// Whose body, if it is our own.
    #[command(flatten)]
    pub build: Build,
    /// Triangle edge of the garments [mm], 5 to 25.
    #[arg(long, default_value_t = 12.0)]
    pub edge: f64,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

impl Check {
    /// Who wears and moves it, and how finely garments are cut.
    pub fn options(&self) -> DressOptions {
        self.build.of(DressOptions {
            body: character(&self.body),
            edge: self.edge / 1000.0,
            ..DressOptions::default()
        })
    }
}

/// Options of `evaluate`.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// GLB, NPZ in the exchange layout, PC2 with its OBJ beside it, or a folder of point caches or of the garments' NPZ;
    /// walk.npz also stands for all walk.GARMENT.npz.
    pub file: PathBuf,
    /// Whom distances and energies are told against: our solver at rest in single frames, our simulator on the file's
    /// body, or a file of the same cloth and motion.
    #[arg(long, value_name = "minimiser|simulator|FILE")]
    pub against: Option<PathBuf>,
    /// What minimiser and simulator take the cloth to be made of [default: what the file says, else
    /// paper-snug-cotton].
    #[arg(long)]
    pub fabric: Option<String>,
    /// Frames, evenly spread, that are led to the minimiser; 0 for all of them.
    #[arg(long, default_value_t = 9)]
    pub samples: usize,
    /// The same cloth and motion without swing, as `animate --motion-level 0` writes it: tells what cloth does beyond
    /// it, its dynamic content, here and in what it is held against.
    #[arg(long, value_name = "FILE")]
    pub still: Option<PathBuf>,
    /// Where the report goes [default: beside the file, as NAME.evaluation.json].
    #[arg(short, long)]
    pub out: Option<PathBuf>,
    /// Also write energies, stretch, penetration and crossings of every frame.
    #[arg(long, value_name = "FILE.csv")]
    pub frames: Option<PathBuf>,
    #[command(flatten)]
    pub telling: Telling,
}

impl Evaluate {
    /// As the library takes them.
    pub fn options(&self) -> EvaluateOptions {
        EvaluateOptions {
            against: self.against(),
            fabric: self.fabric.clone(),
            still: self.still.clone(),
            out: self.out.clone(),
            frames: self.frames.clone(),
        }
    }

    /// Whom the file is held against; a file that is called like the solver is named with its folder.
    fn against(&self) -> Option<Against> {
        let path = self.against.as_ref()?;
        let n = (self.samples > 0).then_some(self.samples);
        Some(match path.to_str() {
            Some("minimiser") => Against::Minimiser(n),
            Some("simulator") => Against::Simulator,
            _ => Against::File(path.clone()),
        })
    }
}

/// Options of `bench`.
#[derive(Debug, Args)]
pub struct Bench {
    /// Which figures.
    pub what: BenchKind,
    /// Folder with test data (photos/, motion/, garments/) for the figures that need it.
    #[arg(long, env = "MUSLIN_DATA")]
    pub data: Option<PathBuf>,
    /// The model in the garments figures, as `muslin train` wrote it; given several times, all stand
    /// side by side.
    #[arg(long)]
    pub model: Vec<PathBuf>,
    /// Bodies, and poses for each, in the drape figures, else 20; frames in the garments figures,
    /// else 9 (some three minutes a model).
    #[arg(long)]
    pub cases: Option<usize>,
    /// The fabric in the garments figures, where it is another than the models were taught in.
    #[arg(long)]
    pub fabric: Option<String>,
    /// Who wears it in the garments figures: our own body, or the character that the models were taught on.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// Our own body in the garments figures, where it is another.
    #[command(flatten)]
    pub build: Build,
    /// Only drapes whose name ("tee, body 3, sit01 frame 0") holds this, or parts of the garments figures
    /// ("tee, 02_01_walk, swing"; rest, swing, fabrics and speed; "sphere" needs no model), or of the cloth figures
    /// ("physics", "pace, tee, walk", "scaling, tee, 12 mm", "walk, shirt.json"; "sequence, " for two seconds of twenty
    /// recordings in three garments, which takes an hour or two and is left out else); may be given again.
    #[arg(long)]
    pub only: Vec<String>,
    /// Folder for pictures: of the drapes that went wrong, or of those named with --only; of the last frame of what
    /// moves in the cloth figures.
    #[arg(long)]
    pub pictures: Option<PathBuf>,
    /// In the cloth figures: our simulator beside the programs that `cargo xtask peers DIR` put
    /// here, on one moving skirt; with --only, the parts named, and Newton's shirt among what walks.
    #[arg(long, value_name = "DIR")]
    pub peers: Option<PathBuf>,
    /// How often every one of them runs, in turns, and what is timed in the cloth figures.
    #[arg(long, default_value_t = 3)]
    pub rounds: usize,
    /// Where scene and frames of the peers go [default: DIR/scene].
    #[arg(short, long)]
    pub out: Option<PathBuf>,
}

/// What `list` can show.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Kind {
    /// Garments and their parameters.
    Garments,
    /// Fabrics in SI units.
    Fabrics,
    /// Built-in poses.
    Poses,
    /// Built-in motions.
    Motions,
}

/// What `bench` can measure.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BenchKind {
    /// The posed body.
    Body,
    /// The detector and landmarks.
    Pose,
    /// The fit.
    Fit,
    /// Garments on random bodies and real poses.
    Drape,
    /// The whole job.
    Dress,
    /// Cloth against what physics says of it: falling, hanging, bending, sliding, draping; our own garments in motion,
    /// how fast and how clean; with --data, garments of files through a walk.
    Cloth,
    /// A trained garment on recordings it never learnt from.
    Garments,
}

/// Names of [`Cut`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum CutName {
    /// Close to the body.
    Slim,
    /// As sold by default.
    Regular,
    /// Wide.
    Loose,
}

/// Names of [`Backdrop`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BackdropName {
    /// A soft studio wall and floor.
    Studio,
    /// White, with a shadow.
    White,
    /// Transparent pixels.
    Transparent,
}

impl Common {
    /// The same in the library's words.
    pub fn options(&self) -> DressOptions {
        DressOptions {
            person: self.person.unwrap_or(Person::Largest),
            simulate: self.simulate,
            overlay: self.overlay,
            ..self.wearing.options(DressOptions::default())
        }
    }
}

impl Simulate {
    /// The same in the library's words.
    pub fn options(&self) -> SimulateOptions {
        let dress = self.wearing.options(SimulateOptions::default().dress);
        self.shot.of(SimulateOptions {
            dress: DressOptions {
                body: character(&self.body),
                ..dress
            },
            motion: self.motion[0].clone(),
            fps: self.fps,
            bdf2: self.bdf2,
            air: self.air,
            wind: self.wind,
            resume: self.resume,
            npz: self.npz.clone(),
            pc2: self.pc2.clone(),
            ..SimulateOptions::default()
        })
    }
}

impl Bench {
    /// What is measured in the cloth figures.
    pub fn walks(&self) -> Walks {
        Walks {
            data: self.data.clone(),
            peers: self.peers.clone(),
            rounds: self.rounds,
            only: self.only.clone(),
            pictures: self.pictures.clone(),
        }
    }

    /// What is measured in the garments figures.
    pub fn trials(&self) -> Trials {
        let mut worn = Wear::parse("");
        worn.fabric.clone_from(&self.fabric);
        Trials {
            models: self.model.clone(),
            cases: self.cases.unwrap_or(9),
            worn: DressOptions {
                outfit: vec![worn],
                body: character(&self.body),
                ..self.build.of(DressOptions::default())
            },
            only: self.only.clone(),
        }
    }
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

impl Animate {
    /// The same in the library's words.
    pub fn options(&self) -> AnimateOptions {
        // A model's garment stands in its file.
        let named = match self.garment.as_slice() {
            [] => vec!["tee"; self.model.len().max(1)],
            named => named.iter().map(String::as_str).collect(),
        };
        let worn = |name: &str| {
            let worn = Wear::parse(name);
            Wear {
                fabric: worn.fabric.or_else(|| self.fabric.clone()),
                ..worn
            }
        };
        let dress = DressOptions {
            outfit: named.into_iter().map(worn).collect(),
            body: character(&self.body),
            allow_crossings: self.allow_crossings,
            backdrop: self.backdrop.into(),
            ..self.build.of(SimulateOptions::default().dress)
        };
        AnimateOptions {
            models: self.model.clone(),
            simulate: self.shot.of(SimulateOptions {
                dress,
                motion: self.motion.clone(),
                fps: self.fps,
                npz: self.npz.clone(),
                pc2: self.pc2.clone(),
                ..SimulateOptions::default()
            }),
            refine: self.refine,
            motion_level: self.motion_level,
        }
    }
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

impl From<WeightsName> for Precision {
    fn from(name: WeightsName) -> Self {
        match name {
            WeightsName::F32 => Precision::Single,
            WeightsName::F16 => Precision::Half,
            WeightsName::I8 => Precision::Eight,
        }
    }
}

impl From<SkinningName> for Skinning {
    fn from(name: SkinningName) -> Self {
        match name {
            SkinningName::Given => Skinning::Given,
            SkinningName::Learnt => Skinning::Learnt,
        }
    }
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

impl From<BackdropName> for Backdrop {
    fn from(name: BackdropName) -> Self {
        match name {
            BackdropName::Studio => Backdrop::Studio,
            BackdropName::White => Backdrop::White,
            BackdropName::Transparent => Backdrop::Transparent,
        }
    }
}

impl Build {
    /// The `other` options with this build.
    fn of(&self, other: DressOptions) -> DressOptions {
        DressOptions {
            height: self.height.map(|cm| cm / 100.0),
            weight: self.weight,
            gender: self.gender,
            size: self.size,
            ..other
        }
    }
}

impl Wearing {
    /// The same in the library's words; what is not asked for is as in `usual`.
    fn options(&self, usual: DressOptions) -> DressOptions {
        let mut options = DressOptions {
            cut: match self.cut {
                CutName::Slim => Cut::Slim,
                CutName::Regular => Cut::Regular,
                CutName::Loose => Cut::Loose,
            },
            edge: self.edge / 1000.0,
            allow_crossings: self.allow_crossings,
            backdrop: self.backdrop.into(),
            ..self.build.of(usual)
        };
        if !self.garment.is_empty() {
            options.outfit = self.garment.iter().map(|g| Wear::parse(g)).collect();
        }
        for wear in &mut options.outfit {
            wear.fabric = wear.fabric.take().or_else(|| self.fabric.clone());
        }
        options
    }
}

/// Three numbers with commas between them.
fn vector(text: &str) -> Result<[f64; 3], String> {
    let parts: Result<Vec<f64>, _> = text.split(',').map(|p| p.trim().parse()).collect();
    let three = parts.ok().and_then(|p| p.try_into().ok());
    three.ok_or_else(|| "three numbers with commas between, as in 0,0,-6".to_owned())
}

fn person(text: &str) -> Result<Person, String> {
    match text.parse::<usize>() {
        _ if text == "all" => Ok(Person::All),
        Ok(n) if n > 0 => Ok(Person::Nth(n)),
        _ => Err("a number from 1, or `all`".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn garments_take_the_common_fabric_unless_they_name_one() {
        let cli = Cli::parse_from([
            "muslin",
            "dress",
            "a.jpg",
            "--garment",
            "tee,trousers:denim",
            "--fabric",
            "silk-charmeuse",
        ]);
        let Verb::Dress(dress) = cli.verb else {
            panic!("dress")
        };
        let outfit = dress.common.options().outfit;
        assert_eq!(outfit[0].fabric.as_deref(), Some("silk-charmeuse"));
        assert_eq!(outfit[1].fabric.as_deref(), Some("denim"));
    }
}
