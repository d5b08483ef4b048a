//! What can go wrong when a garment is made.

use muslin_body::BodyError;

/// Why a garment could not be made or put on.
#[derive(Debug, thiserror::Error)]
pub enum GarmentError {
    /// The avatar lacks something.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// Garments are cut from the tights around the body.
    #[error("this avatar has no tights to cut garments from; use the embedded avatar")]
    NoTights,
    /// A recipe's figure is out of range.
    #[error("{what} is {value}, allowed is {low} to {high}")]
    OutOfRange {
        /// Which figure.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The least allowed.
        low: f64,
        /// The most allowed.
        high: f64,
    },
}
