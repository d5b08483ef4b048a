//! The jobs as plain functions.

mod failure;
mod watch;

pub use failure::{Exit, Failure};
pub use watch::{Stage, Watch};
