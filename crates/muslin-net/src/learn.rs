//! Layers that learn: forward, backward, and the step that follows.
//!
//! Everything is 32-bit, in plain slices that the caller owns. A matrix lies row by row; a batch
//! is the last axis, so that activations are `features × batch` and one feature of many samples is
//! one run of memory. Parameters of a whole network lie in one slice, so that [`Adam`] passes over
//! them once. Backward functions *add* to the gradient of the parameters.
//!
//! Sums have a fixed order: the same bits on any number of threads.

mod adam;
mod gru;
mod linear;
mod mlp;
mod nonlinear;
mod product;
mod sgd;
mod start;

pub use adam::{Adam, AdamState};
pub use gru::{Gru, GruTape};
pub use linear::Linear;
pub use mlp::{Mlp, MlpTape};
pub use nonlinear::Nonlinear;
pub use product::{View, multiply};
pub use sgd::Sgd;
pub use start::Noise;
