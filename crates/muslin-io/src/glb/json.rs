//! The JSON half: nodes, meshes, materials, textures.

use glam::DVec2;
use muslin_geom::colour::linear;
use serde_json::{Map, Value, json};

use super::GlbOptions;
use super::bin::{Bin, UvFrame};
use crate::picture::png;
use crate::scene::{Maps, Node, Scene};

/// The arrays of a glTF file in the making.
#[derive(Default)]
pub struct Root {
    /// `nodes`.
    pub nodes: Vec<Value>,
    /// `meshes`.
    pub meshes: Vec<Value>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    extensions: Vec<&'static str>,
}

impl Root {
    /// Begun over another file's arrays.
    pub fn over(nodes: Vec<Value>, meshes: Vec<Value>, materials: Vec<Value>) -> Self {
        Self {
            nodes,
            meshes,
            materials,
            ..Self::default()
        }
    }

    /// The other file's JSON with these arrays in place of its own. What is added has no textures.
    pub fn over_finish(mut self, mut base: Value, bin: &Bin) -> Value {
        debug_assert!(self.textures.is_empty() && self.images.is_empty());
        self.uses("KHR_mesh_quantization");
        for (key, names) in [
            ("extensionsUsed", self.extensions.clone()),
            ("extensionsRequired", vec!["KHR_mesh_quantization"]),
        ] {
            let list = base[key].as_array().cloned().unwrap_or_default();
            let new = names.into_iter().map(Value::from);
            let new: Vec<Value> = new.filter(|n| !list.contains(n)).collect();
            base[key] = list.into_iter().chain(new).collect();
        }
        if !base["asset"].is_object() {
            base["asset"] = json!({ "version": "2.0" });
        }
        base["asset"]["generator"] = concat!("Muslin ", env!("CARGO_PKG_VERSION")).into();
        base["nodes"] = self.nodes.into();
        base["meshes"] = self.meshes.into();
        base["materials"] = self.materials.into();
        base["accessors"] = bin.accessors.clone().into();
        base["bufferViews"] = bin.views.clone().into();
        base["buffers"] = buffers(bin).into();
        base
    }

    /// Adds the node's material; the textures are laid out for its coordinates.
    pub fn material(&mut self, bin: &mut Bin, node: &Node) -> usize {
        let look = &node.material;
        let [r, g, b] = light(look.colour);
        let mut value = json!({
            "name": look.name,
            "doubleSided": look.double_sided,
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": look.roughness.clamp(0.0, 1.0),
            },
        });
        if let Some(sheen) = &look.sheen {
            value["extensions"]["KHR_materials_sheen"] = json!({
                "sheenColorFactor": light(sheen.colour),
                "sheenRoughnessFactor": sheen.roughness.clamp(0.0, 1.0),
            });
            self.uses("KHR_materials_sheen");
        }
        if let Some(maps) = look.maps.as_ref().filter(|_| !node.uvs.is_empty()) {
            self.maps(bin, &mut value, maps, &UvFrame::of(&node.uvs));
        }
        self.materials.push(value);
        self.materials.len() - 1
    }

    /// Adds the textures to a material.
    fn maps(&mut self, bin: &mut Bin, material: &mut Value, maps: &Maps, frame: &UvFrame) {
        if let Some(image) = &maps.colour {
            let texture = self.texture(bin, png(image), maps.tile, frame);
            material["pbrMetallicRoughness"]["baseColorTexture"] = texture;
        }
        if let Some(image) = &maps.normal {
            material["normalTexture"] = self.texture(bin, png(image), maps.tile, frame);
        }
    }

    /// Adds a picture and refers to it so that it repeats every `tile`.
    fn texture(&mut self, bin: &mut Bin, png: Vec<u8>, tile: DVec2, frame: &UvFrame) -> Value {
        let image = json!({ "bufferView": bin.blob(&png), "mimeType": "image/png" });
        self.images.push(image);
        self.textures
            .push(json!({ "sampler": 0, "source": self.images.len() - 1 }));
        let mut texture = json!({ "index": self.textures.len() - 1 });
        let (offset, scale) = (frame.offset / tile, DVec2::splat(frame.scale) / tile);
        if offset != DVec2::ZERO || scale != DVec2::ONE {
            texture["extensions"]["KHR_texture_transform"] =
                json!({ "offset": offset.fract_gl().to_array(), "scale": scale.to_array() });
            self.uses("KHR_texture_transform");
        }
        texture
    }

    /// The whole JSON.
    pub fn finish(mut self, scene: &Scene, bin: &Bin, options: &GlbOptions) -> Value {
        let mut root = Map::new();
        if options.quantised && !self.meshes.is_empty() {
            self.uses("KHR_mesh_quantization");
            root.insert(
                "extensionsRequired".into(),
                json!(["KHR_mesh_quantization"]),
            );
        }
        self.extensions.sort_unstable();
        if !self.textures.is_empty() {
            // Smooth near and far, repeating both ways.
            let sampler =
                json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 });
            root.insert("samplers".into(), json!([sampler]));
        }
        let mut stage = json!({ "name": scene.name });
        if !self.nodes.is_empty() {
            stage["nodes"] = (0..self.nodes.len()).collect();
        }
        root.insert("asset".into(), asset(scene));
        root.insert("scene".into(), json!(0));
        root.insert("scenes".into(), json!([stage]));
        // An empty array is an error in glTF.
        let mut put = |name: &str, values: Vec<Value>| {
            if !values.is_empty() {
                root.insert(name.into(), values.into());
            }
        };
        put("nodes", self.nodes);
        put("meshes", self.meshes);
        put("materials", self.materials);
        put("textures", self.textures);
        put("images", self.images);
        put("accessors", bin.accessors.clone());
        put("bufferViews", bin.views.clone());
        put(
            "extensionsUsed",
            self.extensions.into_iter().map(Value::from).collect(),
        );
        put("buffers", buffers(bin));
        root.into()
    }

    fn uses(&mut self, extension: &'static str) {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
    }
}

fn asset(scene: &Scene) -> Value {
    let mut asset = json!({
        "version": "2.0",
        "generator": concat!("Muslin ", env!("CARGO_PKG_VERSION")),
    });
    if let Some(copyright) = &scene.copyright {
        asset["copyright"] = copyright.as_str().into();
    }
    asset
}

fn buffers(bin: &Bin) -> Vec<Value> {
    match bin.bytes.len() {
        0 => Vec::new(),
        n => vec![json!({ "byteLength": n })],
    }
}

/// Whether the node shows a normal map, so that it needs tangents.
pub fn has_normal_map(node: &Node) -> bool {
    let maps = node.material.maps.as_ref();
    !node.uvs.is_empty() && maps.is_some_and(|m| m.normal.is_some())
}

/// Linear light, to five digits: finer than eight bits.
fn light(colour: [u8; 3]) -> [f64; 3] {
    linear(colour).map(|c| (f64::from(c) * 1e5).round() / 1e5)
}
