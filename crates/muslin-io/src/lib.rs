//! The only room that knows file formats and opens files.
//!
//! Readers take bytes and a name for messages, check limits before they allocate, and return
//! values that are whole. Writers build bytes in memory; [`Output`] puts them on disk so that
//! nobody ever sees half a file.

pub mod bvh;
mod clip;
mod error;
mod fabric_file;
pub mod garmentcode;
mod glb;
mod input;
mod journal;
mod lock;
pub mod npz;
mod obj;
mod obj_mesh;
mod output;
mod photo;
mod picture;
mod pose_models;
mod pose_npz;
mod report;
mod scene;
mod sha256;
mod sniff;
mod tensors;
#[cfg(test)]
mod testing;
mod tflite;
mod zip;

pub use clip::{Clip, read_clip, read_pc2, write_pc2};
pub use error::{Fault, IoError, Place, name, plain, quote};
pub use fabric_file::{FabricFile, parse_fabric, read_fabric};
pub use glb::{
    Animation, CharacterFile, Dressed, GlbOptions, Moved, Skinned, dressed_glb, glb, moving_glb,
    read_animation, read_character, read_moving, stored_positions,
};
pub use input::{Input, files_in, read_file};
pub use journal::Journal;
pub use lock::Lock;
pub use obj::obj;
pub use obj_mesh::{ObjMesh, read_obj};
pub use output::{Output, Written, as_name, writable, write_file};
pub use photo::{Photo, PhotoLimits, decode_photo, flatten, read_photo};
pub use picture::{animated_png, png};
pub use pose_models::{PoseGraphs, pose_graphs};
pub use pose_npz::{read_poses, write_poses};
pub use report::report_json;
pub use scene::{Maps, Material, Node, Scene, Sheen, shared_corners};
pub use sha256::sha256;
pub use sniff::{Kind, is_fbx, sniff};
pub use tensors::{read_weights, write_weights};
pub use tflite::{TfliteError, read_tflite};
