//! The jobs as plain functions.
//!
//! [`dress`] takes a photo and writes a 3D figure wearing draped garments; [`demo`] does it on a
//! built-in photo and [`dress_pose`] on a built-in stance.
//! [`simulate()`] moves an outfit on a moving body, [`train()`] teaches a garment to lie on it, [`animate()`] plays what was
//! taught to a file, and [`Playing`] frame by frame. [`check()`] says whether jobs can use a file. [`evaluate()`] judges animated cloth. [`list`] tells what there is, [`bench`]
//! measures it. Each job tells a [`Watch`] of its stages and fails with a [`Failure`].

mod anew;
mod animate;
mod apart;
mod begin;
pub mod bench;
mod brought;
mod check;
mod drape;
mod dress;
mod evaluate;
mod fabric;
mod failure;
mod figure;
mod files;
mod hero;
mod layers;
pub mod list;
mod look;
mod options;
mod outcome;
mod outfit;
mod play;
mod simulate;
mod size;
mod swings;
mod table;
mod tell;
mod train;
mod traits;
mod wardrobe;
mod watch;

pub use animate::{AnimateOptions, animate};
pub use check::check;
pub use drape::{Dressed, Quality, drape_outfit};
pub use dress::{demo, dress, dress_pose};
pub use evaluate::{Against, EvaluateOptions, Evaluation, evaluate, evaluate_file};
pub use failure::{Exit, Failure};
pub use muslin_garment::Cut;
pub use muslin_model::Precision;
pub use muslin_train::Place;
pub use muslin_train::published::{StretchLaw, System};
pub use options::{Backdrop, DressOptions, Person, Wear};
pub use outcome::Outcome;
pub use outfit::{Outfit, Piece, cut_beforehand};
pub use play::Playing;
pub use simulate::{Bake, SimulateOptions, simulate, simulate_several};
pub use size::Size;
pub use table::Table;
pub use train::{Skinning, TrainOptions, train};
pub use wardrobe::{swung_anew, under_terms};
pub use watch::{Stage, Watch};
