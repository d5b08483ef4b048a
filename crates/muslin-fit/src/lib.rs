//! From a photo or keypoints to a posed, measured body.

mod camera;
mod descend;
pub mod detect;
mod doubts;
mod error;
mod evidence;
mod exact;
mod figure;
mod fold;
mod ground;
mod guess;
mod joint;
mod place;
mod problem;
pub mod solve;
mod start;
mod system;
mod touch;
pub mod trial;
mod upright;

pub use camera::Camera;
pub use doubts::UNSEEN;
pub use error::FitError;
