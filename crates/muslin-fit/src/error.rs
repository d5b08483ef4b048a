//! What can go wrong between a photo and a body.

/// Why a person could not be found or fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too little of the person is seen.
    #[error(
        "only {found} points of the person are usable; {need} are needed, both hips or both shoulders among them; choose a photo that shows the person from head to knee at least"
    )]
    TooFewPoints {
        /// Usable points found.
        found: usize,
        /// Usable points needed.
        need: usize,
    },
    /// The body cannot be as asked, or the avatar lacks a part.
    #[error(transparent)]
    Body(#[from] muslin_body::BodyError),
}
