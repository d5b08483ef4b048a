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
mod worn;

use std::path::Path;

use crate::failure::{Exit, Failure};
use crate::watch::Watch;

pub use cloth::peers;
pub use garments::{Trials, garments};
pub use rooms::{body, fit, pose};
pub use whole::{Drapes, drape, dress};
pub use worn::Walks;

/// Cloth against physics, our own garments in motion and those of files, as far as they are asked for.
///
/// # Errors
/// A name that no part has; interrupted.
pub fn cloth(walks: &Walks, watch: &mut Watch) -> Result<String, Failure> {
    let physics = cloth::cloth(|name| walks.asks(name));
    let moving = worn::worn(walks, watch)?;
    match physics {
        None if moving.is_empty() => {
            let what = format!(
                "no part of the figures is called {:?}",
                walks.only.join(", ")
            );
            let fault = Failure::new(Exit::Usage, "no-part", what).at("--only");
            Err(fault.hint(
                "they are called \"physics, cantilever\" (or free fall, thrown, hanging strip, slope, determinism, cusick), \"pace, tee, walk\", \"scaling, tee, 12 mm\" and, with data, \"walk, FILE\"",
            ))
        }
        physics => Ok(format!("{}\n{moving}", physics.unwrap_or_default())),
    }
}

/// The data folder, or a failure that says how to name it.
fn needed(data: Option<&Path>) -> Result<&Path, Failure> {
    data.ok_or_else(|| {
        let what = "this figure needs a folder with photos/ and motion/";
        Failure::new(Exit::Usage, "no-data", what).hint("name it with --data or MUSLIN_DATA")
    })
}
