//! Shapes: rotations, triangle meshes, who is near whom, exact intersection.
//!
//! Everything is in metres, right-handed, Y up. This room knows no cloth and no people.

mod drape;
mod image;
mod mesh;
mod report;

pub use drape::{Drape, Part};
pub use image::Image;
pub use mesh::{Mesh, vertex_normals};
pub use report::{Report, Value};
