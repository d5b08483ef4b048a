//! What judges: `check`, `evaluate` and `bench`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use muslin::bench::{Trials, Walks};
use muslin::{Against, DressOptions, EvaluateOptions, Exit, Failure, Wear};

use super::common::{Build, OWN, Telling, character};

/// Options of `check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Garments (.obj, .json), fabrics (.toml, .json, .u3m, .u3ma), motions (.bvh, .npz, .vrma, FILE#NAME, a folder of
    /// them), characters (.glb, .gltf, .vrm), trained garments (.muslin), photos and animated cloth.
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
    #[arg(long, requires = "against")]
    pub fabric: Option<String>,
    /// Frames, evenly spread, that are led to the minimiser; 0 for all of them [default: 9].
    #[arg(long, requires = "against")]
    pub samples: Option<usize>,
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
            samples: self.samples,
            still: self.still.clone(),
            out: self.out.clone(),
            frames: self.frames.clone(),
        }
    }

    /// Whom the file is held against; a file that is called like the solver is named with its folder.
    fn against(&self) -> Option<Against> {
        let path = self.against.as_ref()?;
        Some(match path.to_str() {
            Some("minimiser") => Against::Minimiser,
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
    /// Bodies, and poses for each, in the drape figures, else 20; frames of all three clips together in the garments
    /// figures, else 9 (some three minutes a model).
    #[arg(long, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
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
    /// ("physics, cantilever", "pace, tee, walk", "scaling, tee, 12 mm", "walk, shirt.json"; "sequence, " for two seconds of twenty
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
    /// How often every one of them runs, in turns, and what is timed in the cloth figures [default: 3].
    #[arg(long, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    pub rounds: Option<usize>,
    /// Where scene and frames of the peers go [default: DIR/scene].
    #[arg(short, long)]
    pub out: Option<PathBuf>,
}

impl Bench {
    /// Refuses what the figures that are asked for do not go by: whoever says it believes that they do.
    pub fn check(&self) -> Result<(), Failure> {
        use BenchKind::{Cloth, Drape, Garments};
        let of = |kinds: &[BenchKind]| kinds.contains(&self.what);
        let (garments, cloth) = (of(&[Garments]), of(&[Cloth]));
        let build = &self.build;
        let wearer = build.height.is_some() || build.weight.is_some() || build.gender.is_some();
        let alone = cloth && self.peers.is_some() && self.only.is_empty();
        let wrong = [
            (
                "--only",
                !self.only.is_empty() && !of(&[Drape, Garments, Cloth]),
            ),
            (
                "--pictures",
                self.pictures.is_some() && !of(&[Drape, Cloth]),
            ),
            ("--cases", self.cases.is_some() && !of(&[Drape, Garments])),
            ("--model", !self.model.is_empty() && !garments),
            ("--fabric", self.fabric.is_some() && !garments),
            ("--body", character(&self.body).is_some() && !garments),
            ("--height, --weight or --gender", wearer && !garments),
            ("--size", build.size.is_some() && !garments),
            ("--peers", self.peers.is_some() && !cloth),
            ("--rounds", self.rounds.is_some() && !cloth),
            ("--out", self.out.is_some() && !alone),
        ];
        match wrong.into_iter().find(|w| w.1) {
            None => Ok(()),
            Some((option, _)) => {
                let what = "these figures do not go by it";
                let fault = Failure::new(Exit::Usage, "no-use", what).at(option);
                Err(fault.hint("leave it out; `muslin bench --help` says what it is for"))
            }
        }
    }

    /// How often whatever is timed runs.
    pub fn times(&self) -> usize {
        self.rounds.unwrap_or(3)
    }

    /// What is measured in the cloth figures.
    pub fn walks(&self) -> Walks {
        Walks {
            data: self.data.clone(),
            peers: self.peers.clone(),
            rounds: self.times(),
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

/// What `bench` can measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
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
