//! The figures of merit, measured on this machine.
//!
//! Times are the least of ten runs or more, wall and processor time, with the load named. Figures
//! that need test data take its folder (`photos/`, `motion/`) and say so without it.

mod clock;
mod cloth;
mod crowd;
mod fabrics;
mod garments;
mod rooms;
mod sphere;
mod swing;
mod whole;

use std::path::Path;

use crate::failure::{Exit, Failure};

pub use cloth::{cloth, peers};
pub use garments::{Trials, garments};
pub use rooms::{body, fit, pose};
pub use whole::{Drapes, drape, dress};

/// The data folder, or a failure that says how to name it.
fn needed(data: Option<&Path>) -> Result<&Path, Failure> {
    data.ok_or_else(|| {
        let what = "this figure needs a folder with photos/ and motion/";
        Failure::new(Exit::Usage, "no-data", what).hint("name it with --data or MUSLIN_DATA")
    })
}
