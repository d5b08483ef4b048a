//! What can go wrong with a body, and what to do about it.

/// Why a body could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BodyError {
    /// The bytes are not a whole avatar.
    #[error(
        "the avatar data is damaged ({0}); install again, or rebuild it with `cargo xtask assets body`"
    )]
    Corrupt(&'static str),
    /// No phenotype has this name.
    #[error("no phenotype is called {name:?}; there are {}", crate::PHENOTYPES.join(", "))]
    UnknownPhenotype {
        /// The name that was asked for.
        name: String,
    },
    /// No local target has this name.
    #[error("no body slider is called {name:?}; near it: {}", nearest.join(", "))]
    UnknownTarget {
        /// The name that was asked for.
        name: String,
        /// Names that exist, the most alike first.
        nearest: Vec<String>,
    },
    /// No built-in stance has this name.
    #[error("no pose is called {name:?}; near it: {}", nearest.join(", "))]
    UnknownStance {
        /// The name that was asked for.
        name: String,
        /// Names that exist, the most alike first.
        nearest: Vec<String>,
    },
    /// No built-in motion has this name.
    #[error("no motion is called {name:?}; there are {}", crate::motions::NAMES.join(", "))]
    UnknownMotion {
        /// The name that was asked for.
        name: String,
    },
    /// No bone has this name.
    #[error("no bone is called {name:?}; near it: {}", nearest.join(", "))]
    UnknownBone {
        /// The name that was asked for.
        name: String,
        /// Names that exist, the most alike first.
        nearest: Vec<String>,
    },
    /// A value lies outside its range, or is not a number.
    #[error("{name} is {value}, but must lie between {least} and {most}")]
    OutOfRange {
        /// Phenotype or target.
        name: String,
        /// What was given.
        value: f64,
        /// Smallest value allowed.
        least: f64,
        /// Largest value allowed.
        most: f64,
    },
    /// An age below adulthood.
    #[error(
        "age {0:.3} is a child's; this body is for adults, whose age runs from 0.667 (about 25 years) to 1 (about 90)"
    )]
    Child(f64),
    /// No value of the height phenotype gives this height.
    #[error(
        "a height of {:.1} cm is out of reach for this body, which can be {:.1} to {:.1} cm tall; another gender reaches further", asked * 100.0, least * 100.0, most * 100.0
    )]
    HeightOutOfReach {
        /// What was asked for [m].
        asked: f64,
        /// Smallest height this body can have [m].
        least: f64,
        /// Largest height this body can have [m].
        most: f64,
    },
    /// No value of the weight phenotype gives this mass.
    #[error(
        "{asked:.1} kg is out of reach for this body, which can weigh {least:.1} to {most:.1} kg at its height; another height or gender reaches further"
    )]
    MassOutOfReach {
        /// What was asked for [kg].
        asked: f64,
        /// Smallest mass this body can have [kg].
        least: f64,
        /// Largest mass this body can have [kg].
        most: f64,
    },
    /// A character that our body cannot be made to resemble.
    #[error("the character is no body: {0}")]
    NoBody(&'static str),
    /// A skeleton has no joint that plays a needed part.
    #[error(
        "the skeleton has no joint for the {missing}; {names}; name them as CMU, MakeHuman, Mixamo or Poser do"
    )]
    UnknownSkeleton {
        /// The part.
        missing: String,
        /// Some names that it does have, as a clause.
        names: String,
    },
}

impl From<crate::packed::Damaged> for BodyError {
    fn from(damaged: crate::packed::Damaged) -> Self {
        Self::Corrupt(damaged.0)
    }
}
