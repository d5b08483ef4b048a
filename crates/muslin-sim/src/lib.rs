//! Moves cloth by minimising the energies around moving triangles.
//!
//! [`drape`] takes a [`Cloth`] (plain arrays: faces, rest shape, materials, pins, layers), a start
//! and the path of a body's vertices, and gives the cloth at rest on the last of them. It knows no
//! rig, no recipe and no file.
//!
//! Each step minimises inertia, stretch, bending, weight, contact and, where cloth moves, air by Newton's method: the
//! matrix is assembled, solved by conjugate gradients with inverted diagonal blocks, and the
//! result is moved along only as far as cloth does not pass through cloth. Steps start from where
//! the cloth already moves, without gravity, so that a settled state is a fixed point however few
//! iterations are spent (`x + h v`, not the usual inertial guess).
//!
//! Every sum has a fixed order: the same bits on any number of threads.

mod again;
mod air;
mod awake;
mod bending;
mod body;
mod carry;
mod clean;
mod cloth;
mod coarse;
mod crossings;
mod dents;
mod drape;
mod elastic;
mod fan;
mod hang;
mod loosen;
mod matrix;
mod near;
mod newton;
mod ordered;
mod pairs;
mod pattern;
mod quality;
mod refine;
mod region;
mod relief;
mod rub;
mod safe;
mod simulate;
mod sleep;
mod slip;
mod stage;
#[cfg(test)]
mod testing;
mod touch;
mod weave;

pub use air::Air;
pub use cloth::{Cloth, Material, SimError};
pub use drape::{Options, drape, drape_along, drape_while};
pub use hang::{Hanging, hang};
pub use loosen::BEYOND_LIMIT;
pub use quality::{Energies, Settled, stretch};
pub use refine::{Guesses, Refined, refine};
pub use relief::{Flesh, Frame, Relief};
pub use simulate::{CHECKPOINT, Moment, State, Walk, simulate, simulate_while};
