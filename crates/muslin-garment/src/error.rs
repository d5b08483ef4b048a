//! What can go wrong when a garment is made.

use muslin_body::BodyError;
use muslin_body::packed::Damaged;

/// Why a garment could not be made or put on.
#[derive(Debug, thiserror::Error)]
pub enum GarmentError {
    /// The avatar lacks something.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// Garments are cut from the tights around the body.
    #[error("this avatar has no tights to cut garments from; use the embedded avatar")]
    NoTights,
    /// The bytes are not a whole garment.
    #[error(
        "a garment cut beforehand is damaged ({0}); install again, or rebuild it with `cargo xtask assets garments`"
    )]
    Damaged(&'static str),
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
    /// A panel's outline cannot be cut.
    #[error("panel {panel:?} cannot be cut: {what}")]
    Outline {
        /// The panel.
        panel: String,
        /// What is wrong with its outline.
        what: String,
    },
    /// Seams join more than two pieces of cloth along one line, or a right side to a wrong one.
    #[error("the seams of panels {:?} and {:?} do not lie flat: three pieces meet, or one is turned over", panels[0], panels[1])]
    Seam {
        /// The panels that meet.
        panels: [String; 2],
    },
    /// A mesh that cannot be worn.
    #[error("this mesh cannot be worn: {what}")]
    Mesh {
        /// Why, and what to do.
        what: String,
    },
}

impl From<Damaged> for GarmentError {
    fn from(damaged: Damaged) -> Self {
        Self::Damaged(damaged.0)
    }
}
