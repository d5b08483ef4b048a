//! `simulate`.

use std::path::PathBuf;

use clap::Args;
use muslin::{DressOptions, SimulateOptions};

use super::common::{OWN, Shot, Telling, Wearing, character};

/// Options of `simulate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  muslin simulate -o walk.glb
  muslin simulate --motion dance.bvh --start 2 --seconds 4 --outfit tee,trousers:denim -o dance.glb
  muslin simulate --motion spin --npz spin.npz -o spin.glb && muslin evaluate spin.npz
  muslin simulate --motion takes/ --motion run -o out      one on each core, out/NAME.glb
  muslin simulate --body hero.glb --motion Idle -o hero-dressed.glb     a character, in its own animation

What is done is kept in OUT.glb.part; after Ctrl-C or a crash the same command with --resume goes on
from there, to the same bits. OUT.report.json says how good the result is.")]
pub struct Simulate {
    /// Who wears it: our own body, or a rigged character, a .glb, .gltf or .vrm with a skeleton and a skin.
    #[arg(long, value_name = "anny|FILE", default_value = OWN)]
    pub body: PathBuf,
    /// A built-in motion (see `muslin list motions`), an animation of the character's file by name, a file (BVH, glTF or
    /// VRM, as FILE#NAME for one animation of several, NPZ with poses), or a folder of BVH, NPZ and VRMA; may be given
    /// several times.
    #[arg(long, default_value = "walk", value_name = "NAME|FILE|DIR")]
    pub motion: Vec<String>,
    /// Who wears what.
    #[command(flatten)]
    pub wearing: Wearing,
    /// The animation, a .glb file; with several motions a folder for NAME.glb each.
    #[arg(short, long, default_value = "walk.glb")]
    pub out: PathBuf,
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
            ..SimulateOptions::default()
        })
    }
}

/// Three numbers with commas between them.
fn vector(text: &str) -> Result<[f64; 3], String> {
    let parts: Result<Vec<f64>, _> = text.split(',').map(|p| p.trim().parse()).collect();
    let three = parts.ok().and_then(|p| p.try_into().ok());
    three.ok_or_else(|| "three numbers with commas between, as in 0,0,-6".to_owned())
}
