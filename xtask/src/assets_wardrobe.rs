//! `cargo xtask assets wardrobe [NAME ...]`: the trained garments that come with the program.
//!
//! Each learns from the built-in motions and poses mixed of them, by `muslin train`: nothing is fetched,
//! nothing was simulated.

use std::path::Path;
use std::process::Command;

use crate::Outcome;

/// Garments that are taught.
const NAMES: [&str; 2] = ["tee", "skirt"];
/// What they learn from: the built-in motions, but for the cartwheel.
const MOTIONS: [&str; 9] = [
    "walk", "run", "turn", "wave", "squat", "arms-up", "sit", "spin", "dance",
];
/// How long, and of how many poses, shown and mixed.
const HOW: [&str; 6] = ["--steps", "3000", "--poses", "600", "--mixed", "1000"];

/// Teaches the named garments, or all.
pub fn build(names: &[&str]) -> Outcome {
    let names = if names.is_empty() { &NAMES[..] } else { names };
    let folder = Path::new("assets/wardrobe");
    for name in names {
        if !NAMES.contains(name) {
            return Err(format!(
                "{name}: not in the wardrobe ({})",
                NAMES.join(", ")
            ));
        }
        let model = folder.join(format!("{name}.muslin"));
        let mut train = Command::new("cargo");
        train.args(["run", "--release", "--package", "muslin-cli", "--"]);
        train.args(["train", "--garment", name]).args(HOW);
        MOTIONS.iter().for_each(|m| {
            train.args(["--motion", m]);
        });
        let status = train.arg("--out").arg(&model).status();
        match status {
            Ok(s) if s.success() => {}
            Ok(s) => return Err(format!("{train:?}: {s}")),
            Err(e) => return Err(format!("{train:?}: {e}")),
        }
        // The curve and the report stay with whoever made it.
        for kind in ["csv", "report.json"] {
            let path = model.with_extension(kind);
            std::fs::remove_file(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        }
    }
    Ok(())
}
