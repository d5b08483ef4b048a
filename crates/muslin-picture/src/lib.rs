//! Pictures of meshes without a GPU.
//!
//! A [`Scene`] is photographed through a [`Camera`] in a small studio: one soft
//! key light with a shadow, a dome of softboxes whose shadows are gathered once
//! per scene, and a floor that only catches shadows. Pixels are visited in tiles
//! and are the same bits for any number of threads.
//!
//! World units are metres, Y up; colours are linear RGB until the last step.

mod background;
mod camera;
mod clip;
mod crevice;
mod dome;
mod floor;
mod fragment;
mod hem;
mod light_map;
mod overlay;
mod project;
mod raster;
mod scene;
mod shade;
mod stage;
mod studio;
mod tone;
mod weave;

pub use camera::{Camera, View};
pub use overlay::overlay;
pub use scene::{Background, Ground, Layer, Material, Part, Scene, Weave, WeaveKind};
pub use stage::{Options, Stage, render, turntable};
