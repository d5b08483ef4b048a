//! What may be asked of `animate`.

use std::path::{Path, PathBuf};

use crate::failure::{Exit, Failure};
use crate::options::within;
use crate::simulate::SimulateOptions;

/// Solver iterations at least in a file that is called checked.
const LEAST: usize = 5;

/// Options of `animate`; the default is what a stranger would want.
#[derive(Clone, Debug)]
pub struct AnimateOptions {
    /// The models, as `train` wrote them, innermost first; if there are none, those of the garments worn, from the
    /// wardrobe.
    pub models: Vec<PathBuf>,
    /// Motion, rate and files. The garments are the models'; body and fabrics are as well, as far as
    /// nothing else is asked for: fabrics in the outfit, one after the other.
    pub simulate: SimulateOptions,
    /// Solver iterations a frame, or for each step in time of cloth that swings, 5 at least; with none, frames are
    /// written as predicted.
    pub refine: usize,
    /// How much motion counts, 1 as in nature; for models that tell it from the pose.
    pub motion_level: Option<f64>,
}

impl Default for AnimateOptions {
    fn default() -> Self {
        Self {
            models: Vec::new(),
            simulate: SimulateOptions {
                fps: 30.0,
                ..SimulateOptions::default()
            },
            refine: LEAST,
            motion_level: None,
        }
    }
}

impl AnimateOptions {
    /// Refuses numbers out of range and files of kinds that are not written.
    pub fn check(&self, out: &Path) -> Result<(), Failure> {
        within("--refine", "", Some(self.refine as f64), (0.0, 1000.0))?;
        if (1..LEAST).contains(&self.refine) {
            let what = format!(
                "{} iterations are too few to call frames checked",
                self.refine
            );
            return Err(Failure::new(Exit::Usage, "too-few-iterations", what)
                .at("--refine")
                .hint("5 at least, or 0 for frames as predicted"));
        }
        within("--motion-level", "", self.motion_level, (0.0, 10.0))?;
        self.simulate.check(out)
    }
}
