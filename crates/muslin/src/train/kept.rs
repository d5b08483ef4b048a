//! What is kept of an unfinished training, and going on from it.

use std::path::{Path, PathBuf};

use muslin_io::{read_file, read_weights, write_file, write_weights};
use muslin_train::{TrainError, Training};

use super::log::Log;
use super::safe::Safe;
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};

/// Bytes that a kept training may have.
pub(crate) const MOST_BYTES: u64 = 8 << 30;

/// Goes on from what was kept, if there is anything.
pub(super) fn resume(
    trainer: &mut dyn Training,
    part: &Path,
    (log, safe): (&mut Log, &mut Safe),
) -> Result<(), Failure> {
    if !part.exists() {
        return Ok(());
    }
    let input = read_file(part, MOST_BYTES).map_err(|e| file_failure(&e))?;
    let kept = read_weights(&input.file, &input.bytes);
    let mut kept = kept.map_err(|e| file_failure(&e).hint("start again without --resume"))?;
    *safe = Safe::of(&mut kept);
    trainer
        .restore(&kept)
        .map_err(|e| failure(&e).at(part.display().to_string()))?;
    if let Some(text) = kept.notes.get("log") {
        *log = Log::read(text);
    }
    Ok(())
}

/// Writes all that changes, and the curve so far to `curve`, if that is said.
pub(super) fn keep(
    trainer: &dyn Training,
    (part, curve): (&Path, Option<&Path>),
    (log, safe): (&Log, &Safe),
) -> Result<(), Failure> {
    let mut kept = trainer.keep().map_err(|e| failure(&e))?;
    safe.add_to(&mut kept);
    let text = log.text();
    kept.notes.insert("log".into(), text.clone());
    let written = |path: &Path, bytes: &[u8]| {
        let written = write_file(path, bytes);
        written.map(|_| ()).map_err(|e| file_failure(&e))
    };
    written(part, &write_weights(&kept))?;
    curve.map_or(Ok(()), |path| written(path, text.as_bytes()))
}

/// Says how far it came.
pub(super) fn stopped(failure: Failure, part: &Path, step: u64, of: u64) -> Failure {
    Failure {
        what: format!(
            "stopped; {step} of {of} steps are kept in {}",
            part.display()
        ),
        ..failure
    }
    .hint("the same command with --resume goes on from there")
}

/// `OUT.EXT`.
pub(super) fn beside(out: &Path, extension: &str) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(format!(".{extension}"));
    name.into()
}

/// Why a training fails, in the words of the program.
pub(crate) fn failure(e: &TrainError) -> Failure {
    let (exit, code) = match e {
        TrainError::NotFinite { .. } => (Exit::Numbers, "not-finite"),
        TrainError::Device(_) => (Exit::Refused, "no-device"),
        TrainError::OtherTraining(_) => (Exit::Invalid, "cannot-resume"),
        _ => (Exit::Invalid, "train"),
    };
    Failure::new(exit, code, e.to_string())
}
