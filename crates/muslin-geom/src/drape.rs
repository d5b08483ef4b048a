//! The end of every job: an outfit's vertices over time on a known topology.

use std::ops::Range;

use glam::DVec3;

/// One garment's share of a [`Drape`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The garment's name.
    pub name: String,
    /// Its vertices in every frame.
    pub verts: Range<usize>,
    /// Its triangles.
    pub faces: Range<usize>,
}

/// Vertices over time; nobody downstream asks where they came from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drape {
    /// Garments in layer order, innermost first.
    pub parts: Vec<Part>,
    /// Corner indices into a frame, all garments together.
    pub faces: Vec<[u32; 3]>,
    /// Positions [m], one list per frame; a still has one frame.
    pub frames: Vec<Vec<DVec3>>,
    /// Frames per second [1/s]; irrelevant for a still.
    pub fps: f64,
}
