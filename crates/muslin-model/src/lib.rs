//! Neural garments at inference: pose in, draped vertices out.
//!
//! A [`Model`] holds a garment's rest shape, skin weights and what was learnt; a [`Player`] plays
//! it, frame after frame, without allocating. It knows no energy and no solver: what it gives is a
//! prediction, which may stretch or touch where the training did not reach.
//!
//! `x = Σ w_b A_b (template + M z(pose))`: a small network reads the pose and mixes a few tens of
//! learnt shapes of the cloth (the rows of `M`), which are then skinned like the body. The network
//! is an [`Encoder`]: our own, or one of the published systems', some of which remember the poses
//! before. Cloth in motion swings about what the pose tells, as its [`Sway`] says.

mod blocks;
mod crowd;
#[cfg(feature = "cuda")]
mod cuda;
mod decode;
mod describe;
#[cfg(feature = "cuda")]
pub mod device;
mod encoder;
mod error;
mod fans;
mod group;
mod layers;
mod mind;
mod model;
mod packed;
mod player;
mod reading;
mod resizer;
mod steps;
mod stored;
mod stream;
mod sway;
mod swing;
#[cfg(any(test, feature = "cuda"))]
mod tables;
mod ties;
mod walls;

pub use crowd::{Crowd, CrowdError};
pub use describe::Reader;
pub use encoder::{Encoder, Ncs, Snug};
pub use error::ModelError;
pub use model::{Model, Skin, Trait};
pub use player::Player;
pub use resizer::Resizer;
pub use stored::Precision;
pub use stream::Stream;
pub use sway::{FOLLOWED, Sway, Wall};
