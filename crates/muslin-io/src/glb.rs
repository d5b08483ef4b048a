//! GLB out: a scene as binary glTF 2.0 that any viewer opens.
//!
//! Positions and normals are stored as 16-bit integers (`KHR_mesh_quantization`): 20 bytes a
//! vertex instead of 32, at 1/65,534 of the size of the thing, 0.03 mm for a person. Eight-bit
//! normals would save 4 bytes more, but their 0.4° show as bands on smooth skin.

mod baked;
mod bin;
mod buffer;
mod character;
mod dressed;
mod json;
mod moving;
mod pack;
mod paint;
mod play;
mod recording;
mod tangent;
mod track;

use glam::DVec3;
use serde_json::{Value, json};

use crate::error::IoError;
use crate::scene::{Node, Scene};
use bin::{Bin, Grid};

pub use character::{CharacterFile, read_character};
pub use dressed::{Dressed, dressed_glb};
pub use moving::{Moved, Skinned, moving_glb};
pub use play::read_moving;
pub use recording::{Animation, read_animation};

/// How a GLB is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GlbOptions {
    /// Store 16-bit integers; without it all is 32-bit floats, for readers that know no extension.
    pub quantised: bool,
}

impl Default for GlbOptions {
    fn default() -> Self {
        Self { quantised: true }
    }
}

/// The bytes of a `.glb` file.
///
/// Every node becomes a node of that name with one mesh. The order of vertices and triangles is
/// kept. The same scene gives the same bytes.
pub fn glb(scene: &Scene, options: &GlbOptions) -> Result<Vec<u8>, IoError> {
    scene.check()?;
    let mut bin = Bin::default();
    let mut root = json::Root::default();
    for node in &scene.nodes {
        let material = root.material(&mut bin, node);
        let (mesh, place) = mesh(&mut bin, node, material, options);
        root.meshes.push(mesh);
        root.nodes.push(placed(node, root.meshes.len() - 1, place));
    }
    Ok(container(
        &root.finish(scene, &bin, options).to_string(),
        &bin.bytes,
    ))
}

/// Positions [m] as a reader of the quantised file sees them; for checks of what is delivered.
pub fn stored_positions(node: &Node) -> Vec<DVec3> {
    let grid = Grid::around(&node.mesh.verts);
    node.mesh
        .verts
        .iter()
        .map(|&x| grid.world(grid.nearest(x)))
        .collect()
}

/// The mesh's JSON, and the grid its node must be scaled by.
fn mesh(
    bin: &mut Bin,
    node: &Node,
    material: usize,
    options: &GlbOptions,
) -> (Value, Option<Grid>) {
    let grid = options.quantised.then(|| Grid::around(&node.mesh.verts));
    let position = match &grid {
        Some(grid) => bin.grid_positions(&node.mesh.verts, grid),
        None => bin.positions(&node.mesh.verts),
    };
    let normals = node.normals_or_smooth();
    let normal = match options.quantised {
        true => bin.short_normals(&normals),
        false => bin.normals(&normals),
    };
    let mut attributes = json!({ "POSITION": position, "NORMAL": normal });
    if !node.uvs.is_empty() {
        attributes["TEXCOORD_0"] = bin.uvs(&node.uvs).into();
    }
    if json::has_normal_map(node) {
        let tangents = tangent::tangents(node, &normals);
        attributes["TANGENT"] = match options.quantised {
            true => bin.short_tangents(&tangents).into(),
            false => bin.tangents(&tangents).into(),
        };
    }
    let indices = bin.indices(&node.mesh.faces, node.mesh.verts.len());
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": material });
    (
        json!({ "name": node.name, "primitives": [primitive] }),
        grid,
    )
}

/// The node's JSON.
fn placed(node: &Node, mesh: usize, grid: Option<Grid>) -> Value {
    let mut value = json!({ "name": node.name, "mesh": mesh });
    if let Some(grid) = grid {
        value["translation"] = json!(grid.origin);
        value["scale"] = json!([grid.step, grid.step, grid.step]);
    }
    let extras = uv_extras(node);
    if !extras.is_null() {
        value["extras"] = extras;
    }
    value
}

/// What lets a reader find the tailor's coordinates again: uv = offset + scale * stored; null where
/// they are stored as they are.
fn uv_extras(node: &Node) -> Value {
    let frame = bin::UvFrame::of(&node.uvs);
    match node.uvs.is_empty() || frame.is_plain() {
        true => Value::Null,
        false => json!({ "uv_offset": frame.offset.to_array(), "uv_scale": frame.scale }),
    }
}

/// Wraps JSON and binary into the container (glTF 2.0, section 4); an empty binary is left out.
fn container(json: &str, bin: &[u8]) -> Vec<u8> {
    let chunks = [(b"JSON", json.as_bytes(), b' '), (b"BIN\0", bin, 0)];
    let chunks = chunks.into_iter().filter(|(_, body, _)| !body.is_empty());
    let padded = |len: usize| len.next_multiple_of(4);
    let total = 12
        + chunks
            .clone()
            .map(|(_, body, _)| 8 + padded(body.len()))
            .sum::<usize>();
    let mut out = Vec::with_capacity(total);
    let word = |out: &mut Vec<u8>, n: usize| {
        out.extend(
            u32::try_from(n)
                .expect("a scene stays below 4 GiB")
                .to_le_bytes(),
        );
    };
    out.extend(b"glTF");
    word(&mut out, 2);
    word(&mut out, total);
    for (kind, body, fill) in chunks {
        word(&mut out, padded(body.len()));
        out.extend(kind);
        out.extend(body);
        out.resize(out.len().next_multiple_of(4), fill);
    }
    out
}
