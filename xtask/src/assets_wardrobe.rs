//! `cargo xtask assets wardrobe CMU_DIR [NAME ...]`: the trained garments that come with the program;
//! `cargo xtask assets swings`: the same, and how they swing found anew; `cargo xtask assets terms`: the same, and the terms
//! of what they learnt from stated anew; and `cargo xtask assets garments`: all of them, as they are cut.
//!
//! Each learns by `muslin train` from the built-in motions, from nine recordings of the CMU Graphics Lab
//! Motion Capture Database, and from poses mixed of both. Nothing was simulated.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::Outcome;

/// Garments that are taught, and how steeply hard poses count for less.
const NAMES: [(&str, &str); 6] = [
    ("tee", "1.5"),
    ("long-sleeve", "1.5"),
    ("trousers", "1.5"),
    ("shorts", "1.5"),
    ("skirt", "1"),
    ("dress", "1.5"),
];
/// Edges of the cloth [mm] and how many steps, each going on from what the one before has learnt: coarse steps take a
/// quarter of the time and get farther. The last edge is that of the wardrobe.
const STAGES: [[&str; 2]; 3] = [["25", "6000"], ["17", "1500"], ["12", "2500"]];
/// What they learn from: the built-in motions, but for the cartwheel.
const MOTIONS: [&str; 9] = [
    "walk", "run", "turn", "wave", "squat", "arms-up", "sit", "spin", "dance",
];
/// Recordings of the CMU database: what a BVH file in the folder begins with.
const RECORDINGS: [&str; 9] = [
    "07_01", "55_01", "91_48", "91_49", "91_50", "91_51", "91_52", "91_53", "91_54",
];
/// Under what terms, as a model's notes say it.
const TERMS: &str = "the terms of the CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu, funded by NSF \
                     EIA-0196217): free for any use, also in products, not to be resold as motion data";
/// For whom, and of how many poses, shown and mixed.
const HOW: [&str; 12] = [
    "--fabric",
    "any",
    "--shape",
    "any",
    "--sizes",
    "any",
    "--poses",
    "600",
    "--mixed",
    "1400",
    "--skinning",
    "learnt",
];

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
    keep(&["cuts", FOLDER])
}

/// Finds anew how the trained garments swing, which nobody teaches.
pub fn swing() -> Outcome {
    keep(&["swings", FOLDER])
}

/// States anew under what terms the recordings are that the trained garments learnt from.
pub fn terms() -> Outcome {
    keep(&["terms", FOLDER, TERMS])
}

fn keep(what: &[&str]) -> Outcome {
    let mut run = Command::new("cargo");
    run.args(["run", "--release", "--package", "muslin", "--example"]);
    done(run.args(["keep_wardrobe", "--"]).args(what))
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
        let Some((_, fairness)) = NAMES.iter().find(|n| n.0 == *name) else {
            return Err(format!("{name}: not in the wardrobe ({})", all.join(", ")));
        };
        let model = folder.join(format!("{name}.muslin"));
        let mut before: Option<PathBuf> = None;
        for (k, [edge, steps]) in STAGES.iter().enumerate() {
            let to = match k + 1 == STAGES.len() {
                true => model.clone(),
                false => folder.join(format!("{name}-{k}.muslin")),
            };
            let how = ["--edge", edge, "--steps", steps, "--fairness", fairness];
            let mut how: Vec<OsString> = how.iter().map(OsString::from).collect();
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
    train.args(["--terms", TERMS]);
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
