//! The figures of merit, measured on this machine.
//!
//! Times are the least of ten runs or more, wall and processor time, with the load named. Figures
//! that need test data take its folder (`photos/`, `motion/`) and say so without it.

mod clock;

use std::path::Path;

use crate::failure::Failure;

/// The posed body.
pub fn body() -> Result<String, Failure> {
    Ok(clock::load())
}
/// The detector.
pub fn pose(_data: Option<&Path>) -> Result<String, Failure> {
    Ok(clock::least_of(1, || ()).text())
}
/// The fit.
pub fn fit(_data: Option<&Path>) -> Result<String, Failure> {
    Ok(format!("{:?}", clock::peak_memory()))
}
/// Garments.
pub fn drape(_data: Option<&Path>, _cases: usize) -> Result<String, Failure> {
    Ok(String::new())
}
/// The whole job.
pub fn dress(_data: Option<&Path>) -> Result<String, Failure> {
    Ok(String::new())
}
