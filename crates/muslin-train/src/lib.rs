//! Teaches a model with energies as its teacher.
//!
//! No frame is simulated. A [`Trainer`] shows poses to a small network, skins the cloth that it
//! predicts, asks the laws what that cloth costs on the body, and turns the answer into a better
//! network. Sixteen poses are worked on at a time, the pose innermost, so that one coordinate of
//! all of them is one wide register.
//!
//! The learnt shapes are stepped by the elastic operator: `ΔM = −H⁻¹ G S⁻¹`, with the mean
//! gradient `G`, the stiffness `H` of the cloth around the body at rest and the codes' second
//! moments `S`. It is Newton's step if the stiffness were the same in all poses, smooths like a
//! Sobolev gradient, and converges in hundreds of steps where a first-order method takes tens of
//! thousands.

mod around;
mod begin;
mod body;
#[cfg(any(test, feature = "cuda"))]
mod cuda;
mod cut;
mod elastic;
mod error;
mod factor;
mod folds;
mod ground;
mod kept;
mod lanes;
mod laws;
mod layers;
mod lesson;
mod pack;
mod place;
mod pool;
mod prepare;
pub mod published;
mod rows;
mod skin;
mod skinning;
mod state;
#[cfg(test)]
mod suite;
mod sway;
#[cfg(test)]
mod testing;
mod trainer;
mod training;
mod update;
mod wearer;
mod weights;
mod work;

pub use begin::{LEARNT, SKINNING, has_learnt_skinning};
pub use error::TrainError;
pub use kept::in_another_order;
pub use lesson::{Lesson, Plan};
pub use place::{Place, has_device, placed};
pub use pool::{mixed, sampled, thinned};
pub use sway::{hold_back, sway};
pub use trainer::{Energies, Told, Trainer};
pub use training::Training;
pub use weights::diffused;
