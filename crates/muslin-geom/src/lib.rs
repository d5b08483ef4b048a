//! Shapes: rotations, triangle meshes, who is near whom, exact intersection.
//!
//! Everything is in metres, right-handed, Y up. This room knows no cloth and no people.

mod bake;
pub mod bvh;
pub mod ccd;
pub mod closest;
pub mod colour;
mod cut;
mod drape;
mod fill;
mod image;
pub mod intersect;
mod mesh;
mod remesh;
mod report;
mod swept;
#[cfg(test)]
mod testing;
mod turn;
mod wide;

pub use bake::{Bake, Baked};
pub use bvh::{Aabb, Bvh};
pub use closest::{Closest, Surface, number_edges};
pub use cut::{Cut, OnEdge, cut};
pub use drape::{Drape, Part};
pub use fill::{FillError, Filled, fill};
pub use image::Image;
pub use intersect::{intersecting_pairs, self_intersections};
pub use mesh::{Mesh, neighbours, vertex_normals};
pub use remesh::{OnFace, RemeshOptions, Remeshed, remesh};
pub use report::{Report, Value};
pub use swept::Swept;
pub use turn::{best_turn, turn_of};
pub use wide::widely;
