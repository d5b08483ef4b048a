//! Small networks, forward, over one matrix product of our own.
//!
//! A [`Graph`] is data: tensors, constants and operations as a file states them. A [`Net`] is
//! that graph checked, folded and packed, ready to run on one core in 32-bit floats. Images lie
//! as rows, columns, channels (NHWC) with a batch of one.
//!
//! [`learn`] has the layers that networks are trained with.

mod graph;
mod kernels;
pub mod learn;
mod net;
mod plan;
mod room;
mod shape;
mod simd;
mod weights;

pub use graph::{Activation, Graph, Kind, Node, Padding, Tensor, Window};
pub use net::{Net, NetError, Scratch};
pub use weights::{Array, Numbers, Weights};
