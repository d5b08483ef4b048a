//! What is worn: fabric, recipe, layers, binding to a body.

mod brought;
mod error;
mod fabric;
mod fitting;
mod form;
mod garment;
mod growing;
mod outfit;
mod panels;
mod pattern;
mod recipe;
mod relax;
mod settle;
mod sewing;
mod sheet;
mod stand;
mod stored;
mod tube;

pub use error::GarmentError;
pub use fabric::{Confidence, Fabric, FabricError, Look, STIFFEST, WEIGHTS, Weave};
pub use fitting::Tailored;
pub use garment::{Garment, Rim, Worn};
pub use outfit::Outfit;
pub use panels::{Curve, Panel, Seam, SewingPattern};
pub use recipe::{Cut, Dress, Opening, Recipe, Side, Skirt, Tee, Trousers};
pub use sewing::Sewn;
