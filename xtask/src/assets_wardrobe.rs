//! `cargo xtask assets wardrobe CMU_DIR [NAME ...]`: the trained garments that come with the program; and
//! `cargo xtask assets garments`: all of them, as they are cut.
//!
//! Each learns by `muslin train` from the built-in motions, from nine recordings of the CMU Graphics Lab
//! Motion Capture Database, and from poses mixed of both. Nothing was simulated.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::Outcome;

/// Garments that are taught, and whether first in coarse cloth and then for long: what hangs ends deeper in the
/// skin by either (docs/lab.md).
const NAMES: [(&str, bool); 4] = [
    ("tee", true),
    ("trousers", true),
    ("skirt", false),
    ("dress", false),
];
/// What they learn from: the built-in motions, but for the cartwheel.
const MOTIONS: [&str; 9] = [
    "walk", "run", "turn", "wave", "squat", "arms-up", "sit", "spin", "dance",
];
/// Recordings of the CMU database: what a BVH file in the folder begins with.
const RECORDINGS: [&str; 9] = [
    "07_01", "55_01", "91_48", "91_49", "91_50", "91_51", "91_52", "91_53", "91_54",
];
/// For whom, and of how many poses, shown and mixed.
const HOW: [&str; 10] = [
    "--fabric", "any", "--shape", "any", "--sizes", "any", "--poses", "600", "--mixed", "1400",
];
/// In coarse cloth, whose steps take a third of the time, and then in its own, and on from there, for a tenth to a
/// fifth less; or in its own alone.
const COARSE: [&str; 4] = ["--edge", "20", "--steps", "2500"];
const FINE: [&str; 2] = ["--steps", "1500"];
const ON: [&str; 2] = ["--steps", "4000"];
const ALONE: [&str; 2] = ["--steps", "6000"];

/// The recordings in a folder.
fn recordings(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let told = |e: &dyn std::fmt::Display| format!("{}: {e}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(|e| told(&e))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    files.sort();
    let one = |start: &&str| {
        let named = |p: &&PathBuf| {
            let name = p.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(*start) && name.ends_with(".bvh")
        };
        let found = files.iter().find(named).cloned();
        found.ok_or_else(|| told(&format!("no {start}*.bvh (CMU motion capture database)")))
    };
    RECORDINGS.iter().map(one).collect()
}

/// What everything of the wardrobe is written to.
const FOLDER: &str = "assets/wardrobe";

/// Cuts the garments, for whom nobody should wait later.
pub fn cut() -> Outcome {
    let mut cut = Command::new("cargo");
    cut.args(["run", "--release", "--package", "muslin", "--example"]);
    done(cut.args(["cut_garments", "--", FOLDER]))
}

fn done(command: &mut Command) -> Outcome {
    match command.status() {
        Ok(s) if s.success() => Ok(()),
        Ok(s) => Err(format!("{command:?}: {s}")),
        Err(e) => Err(format!("{command:?}: {e}")),
    }
}

/// Teaches the named garments, or all.
pub fn build(args: &[&str]) -> Outcome {
    let Some((folder, names)) = args.split_first() else {
        return Err("usage: cargo xtask assets wardrobe CMU_DIR [NAME ...]".into());
    };
    let recordings = recordings(Path::new(folder))?;
    let all: Vec<&str> = NAMES.iter().map(|n| n.0).collect();
    let names = if names.is_empty() { &all[..] } else { names };
    let folder = Path::new(FOLDER);
    for name in names {
        let Some((_, first_coarse)) = NAMES.iter().find(|n| n.0 == *name) else {
            return Err(format!("{name}: not in the wardrobe ({})", all.join(", ")));
        };
        let model = folder.join(format!("{name}.muslin"));
        let stages: &[&[&str]] = match first_coarse {
            true => &[&COARSE, &FINE, &ON],
            false => &[&ALONE],
        };
        let mut before: Option<PathBuf> = None;
        for (k, stage) in stages.iter().enumerate() {
            let last = k + 1 == stages.len();
            let to = match last {
                true => model.clone(),
                false => folder.join(format!("{name}-{k}.muslin")),
            };
            let mut how: Vec<OsString> = stage.iter().map(OsString::from).collect();
            if let Some(before) = &before {
                how.extend(["--from".into(), before.into()]);
            }
            teach(name, (&recordings, &to), &how)?;
            if let Some(before) = before.replace(to) {
                removed(&before)?;
            }
        }
    }
    Ok(())
}

/// One training of a garment.
fn teach(name: &str, (recordings, model): (&[PathBuf], &Path), how: &[OsString]) -> Outcome {
    let mut train = Command::new("cargo");
    train.args(["run", "--release", "--package", "muslin-cli", "--"]);
    train.args(["train", "--garment", name]).args(HOW).args(how);
    MOTIONS.iter().for_each(|m| {
        train.args(["--motion", m]);
    });
    recordings.iter().for_each(|r| {
        train.arg("--motion").arg(r);
    });
    done(train.arg("--out").arg(model))?;
    // The curve and the report stay with whoever made it.
    for kind in ["csv", "report.json"] {
        removed(&model.with_extension(kind))?;
    }
    Ok(())
}

fn removed(path: &Path) -> Outcome {
    std::fs::remove_file(path).map_err(|e| format!("{}: {e}", path.display()))
}
