//! Pictures of meshes without a GPU.
