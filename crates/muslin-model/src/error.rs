//! Why a model cannot be used.

/// Why weights are no model, or a model fits no body.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// An array or note that every model has.
    #[error("the model has no {0:?}; it is of another kind, or damaged")]
    Missing(String),
    /// An array of a kind or size that does not fit the others.
    #[error("{name:?} of the model {what}")]
    Wrong {
        /// The array or note.
        name: String,
        /// What is wrong with it.
        what: String,
    },
    /// The body lacks a bone.
    #[error(
        "the model was trained on a body with the bone {0:?}, which this one lacks; use the body it was trained on"
    )]
    NoBone(String),
}

impl ModelError {
    pub(crate) fn wrong(name: &str, what: impl Into<String>) -> Self {
        Self::Wrong {
            name: name.into(),
            what: what.into(),
        }
    }
}
