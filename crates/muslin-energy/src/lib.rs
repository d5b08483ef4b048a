//! The laws: each cloth energy with gradient and Hessian.
//!
//! Every law takes positions [m] and gives its energy [J], gradient [N] and a Hessian [N/m] that
//! is never indefinite, so that a Newton step always descends. A force is the negative gradient;
//! the caller negates. Three shapes of law share three shapes of answer:
//!
//! - on one weighted point ([`AtPoint`]): [`mod@point`] (inertia, gravity, pins, drag),
//!   [`contact`], [`friction`], [`air`];
//! - on a triangle's deformation ([`InPlane`]): [`membrane`], [`stvk`], [`neo`], [`strain`];
//! - on the vertices of an edge, a hinge or a patch ([`Local`]): [`spring`], [`hinge`], [`flat`], [`plate`].
//!
//! [`check`] is the suite that each of them passes, exported for every faster variant.

pub mod air;
pub mod check;
pub mod contact;
pub mod flat;
pub mod friction;
pub mod hinge;
mod local;
pub mod membrane;
pub mod neo;
pub mod plate;
pub mod point;
pub mod proximity;
pub mod spring;
pub mod strain;
pub mod stvk;
mod triangle;

pub use local::{AtPoint, InPlane, Local, outer};
pub use triangle::RestTriangle;
