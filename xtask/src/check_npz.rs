//! `cargo xtask check npz [FILE...]`: our NPZ files before NumPy's eyes.
//!
//! NumPy, in a throw-away environment, must load every array without pickles, and must find the
//! exchange layout: types, shapes that go together, corners that are vertices, finite numbers.
//! Without files, a sample that the writer's own tests leave is checked.

use std::path::Path;
use std::process::Command;

use crate::{Outcome, python};

const READER: &str = "numpy>=2,<3";

/// Checks the files, or a fresh sample if there are none.
pub fn run(args: &[&str]) -> Outcome {
    let folder = std::env::temp_dir().join("muslin-xtask").join("check-npz");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let files = match args {
        [] => samples(&folder)?,
        files => files.iter().map(|f| f.to_string()).collect(),
    };
    let python = python::environment(&folder.join("venv"), &[READER])?;
    let text = output(
        Command::new(python)
            .arg("xtask/python/npz_reader.py")
            .args(&files),
    )?;
    print!("{text}");
    match text.lines().filter(|l| l.starts_with("sound")).count() == files.len() {
        true => Ok(()),
        false => Err("not all files are sound".into()),
    }
}

/// Lets the writer's own tests write samples.
fn samples(folder: &Path) -> Result<Vec<String>, String> {
    let samples = folder.join("samples");
    let mut cargo = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    cargo.args(["test", "-q", "-p", "muslin-io", "--lib", "files_for_numpy"]);
    // What a run before has left is nobody's any more.
    let _ = std::fs::remove_dir_all(&samples);
    output(cargo.env("MUSLIN_NPZ_SAMPLES", &samples))?;
    let entries = std::fs::read_dir(&samples).map_err(|e| format!("{}: {e}", samples.display()))?;
    let mut files: Vec<String> = entries
        .flatten()
        .map(|e| e.path().display().to_string())
        .collect();
    files.sort();
    match files.is_empty() {
        true => Err("the tests that write samples wrote none".into()),
        false => Ok(files),
    }
}

/// Runs a program and returns what it prints.
fn output(command: &mut Command) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let done = command.output().map_err(|e| format!("{program}: {e}"))?;
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    match done.status.success() {
        true => Ok(text),
        false => Err(format!(
            "{program}: {}\n{text}{}",
            done.status,
            String::from_utf8_lossy(&done.stderr)
        )),
    }
}
