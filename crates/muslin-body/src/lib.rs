//! Any rigged avatar: shape, skeleton, pose, motion, skinning, measurements.
//!
//! ```
//! use muslin_body::{Avatar, Pose, Shape};
//! let avatar = Avatar::embedded()?;
//! let shape = Shape::default().with("gender", 0.1)?.with_height(&avatar, 1.68)?;
//! let figure = avatar.figure(&shape)?;
//! let posed = avatar.pose(&figure, &Pose::rest(&avatar));
//! assert!((avatar.measure(&figure).height - 1.68).abs() < 1e-4);
//! assert_eq!(posed.verts.len(), figure.verts.len());
//! # Ok::<(), muslin_body::BodyError>(())
//! ```
//!
//! Metres, kilograms, radians; Y up, right-handed, the body faces +Z and its left arm is
//! at +X. The vertices of an avatar are, in this order: the body, the eyes, the
//! tights (a cloth-like second skin) and the skirt; see [`Avatar::part`].

mod asset;
mod avatar;
mod blend;
mod character;
mod cores;
mod cover;
mod error;
mod export;
mod figure;
mod groups;
mod hands;
mod keypoints;
mod measure;
mod motion;
pub mod motions;
pub mod names;
pub mod packed;
mod pose;
pub mod retarget;
mod rig;
mod room;
mod shape;
mod solve;
mod sparse;
mod stances;
mod stature;
mod twin;

pub use asset::{decode, encode};
pub use avatar::{Avatar, AvatarParts, Part, PartCounts, Target, Unwelded};
pub use blend::{Blend, TAGS};
pub use character::Character;
pub use cores::Cores;
pub use error::BodyError;
pub use export::ExportRig;
pub use figure::Figure;
pub use keypoints::{BODY25, COCO17, Keypoint, Keypoints, Layout, REGRESSED};
pub use measure::{DENSITY, GIRTHS, Measures};
pub use motion::Motion;
pub use pose::{Pose, Posed, blended, place_bones};
pub use rig::{Bone, Rig};
pub use room::Limbs;
pub use shape::{ADULT, PHENOTYPES, Shape};
pub use sparse::Sparse;
pub use twin::{Follower, Twin};
