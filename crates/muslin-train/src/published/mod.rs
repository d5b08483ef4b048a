//! The published self-supervised systems (PBNS, SNUG, NCS), faithfully, beside our own trainer.
//!
//! [`Published`] shows sixteen windows of poses to the network of a [`System`], decodes learnt
//! shapes, skins them, asks the published losses what that costs, and takes a step of Adam.
//! Constants and their sources are in one table, `recipe.rs`; where we mend what the published code
//! gets wrong, `docs/models.md` says so.

mod clips;
mod gravity;
mod laws;
mod layers;
mod ncs;
mod net;
mod recipe;
mod resizer;
mod sheet;
mod snug;
mod state;
#[cfg(test)]
mod tests;
mod trainer;
mod wearer;
mod work;

pub use recipe::{Isotropic, StretchLaw, System};
pub use trainer::{Course, Published};
