//! Why a training cannot go on.

use muslin_model::{CrowdError, ModelError};
use muslin_sim::SimError;

/// Why a training cannot start or go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrainError {
    /// The cloth's arrays do not fit each other.
    #[error("{0}")]
    Cloth(#[from] SimError),
    /// The body lacks what the model needs.
    #[error("{0}")]
    Body(#[from] ModelError),
    /// Lessons that are not of one cloth.
    #[error("the lessons are not of one cloth: their {0} differ")]
    OtherCloth(&'static str),
    /// Too few poses.
    #[error(
        "{0} poses are too few to learn from (at least {1}): give more motions, and ask for no fewer poses of them"
    )]
    FewPoses(usize, usize),
    /// More bones than a file can name.
    #[error("the cloth follows {0} bones; at most 255 can be stored")]
    ManyBones(usize),
    /// Numbers stopped being numbers.
    #[error(
        "{term} is not finite at step {step}, first at vertex {vertex}; lower --rate or check the fabric"
    )]
    NotFinite {
        /// The term of the loss.
        term: &'static str,
        /// The step.
        step: u64,
        /// The first vertex.
        vertex: usize,
    },
    /// There is no device that can, or it failed.
    #[error("{0}; --device cpu trains on the cores")]
    Device(String),
    /// A model that this training cannot begin with.
    #[error("the model to begin with is of another kind: its {0} differs")]
    OtherModel(&'static str),
    /// What was kept belongs to another training.
    #[error("what is kept is of another training: its {0} differs; start again without --resume")]
    OtherTraining(&'static str),
}

impl From<CrowdError> for TrainError {
    fn from(e: CrowdError) -> Self {
        Self::Device(e.to_string())
    }
}
