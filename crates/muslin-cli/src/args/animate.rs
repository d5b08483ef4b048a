//! `animate`.

use std::path::PathBuf;

use clap::Args;
use muslin::{AnimateOptions, DressOptions, SimulateOptions, Wear};

use super::common::{Build, OWN, Shot, Telling, character, parted};

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
    /// Garments of the wardrobe, trained already (see `muslin list garments`), or GARMENT:FABRIC;
    /// innermost first, repeated or comma-separated [default: tee].
    #[arg(
        long,
        visible_alias = "outfit",
        value_name = "NAME",
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
    /// A built-in motion (see `muslin list motions`), an animation of the character's file by name, or a file (BVH, glTF
    /// or VRM, as FILE#NAME for one animation of several, NPZ with poses).
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
    /// What of it is made, and how.
    #[command(flatten)]
    pub shot: Shot,
    /// Frames a second, 12 to 240.
    #[arg(long, default_value_t = 30.0)]
    pub fps: f64,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

impl Animate {
    /// The same in the library's words.
    pub fn options(&self) -> AnimateOptions {
        // A model's garment stands in its file.
        let named = match self.garment.as_slice() {
            [] => vec!["tee"; self.model.len().max(1)],
            named => parted(named).collect(),
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
            ..self.build.of(SimulateOptions::default().dress)
        };
        AnimateOptions {
            models: self.model.clone(),
            simulate: self.shot.of(SimulateOptions {
                dress,
                motion: self.motion.clone(),
                fps: self.fps,
                ..SimulateOptions::default()
            }),
            refine: self.refine,
            motion_level: self.motion_level,
        }
    }
}
