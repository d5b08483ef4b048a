//! What colours a character has: of its materials, and of their pictures at its vertices.

use std::collections::HashMap;

use muslin_geom::Image;
use muslin_geom::colour::linear;
use serde_json::Value;

use super::buffer::{Glb, int};
use super::character::{CharacterFile, Piece};
use crate::input::Input;
use crate::photo::{PhotoLimits, decode_photo};

impl CharacterFile {
    /// Linear light of every vertex. A picture that cannot be read is left out: its material's colour is all there is.
    pub fn colours(&self) -> Vec<[f32; 3]> {
        self.glb.anew();
        let mut pictures = HashMap::new();
        let mut all = vec![[1.0; 3]; self.character.verts.len()];
        for piece in &self.pieces {
            let part = self.part(piece);
            let materials = self.glb.list("materials");
            let material = int(&part["material"]).and_then(|m| materials.get(m));
            let look = &material.unwrap_or(&Value::Null)["pbrMetallicRoughness"];
            let factor = factor(&look["baseColorFactor"]);
            all[piece.verts.clone()].fill(factor);
            let texture = &look["baseColorTexture"];
            let Some(source) = self.source(texture) else {
                continue;
            };
            let picture = pictures
                .entry(source)
                .or_insert_with(|| picture(&self.glb, source));
            let moved = &texture["extensions"]["KHR_texture_transform"];
            let set = int(&moved["texCoord"]).or_else(|| int(&texture["texCoord"]));
            let set = set.unwrap_or(0);
            let places = self
                .glb
                .numbers(&part["attributes"][format!("TEXCOORD_{set}")]);
            let (Some(picture), Ok(places)) = (picture, places) else {
                continue;
            };
            let own = all[piece.verts.clone()].iter_mut();
            for (colour, uv) in own.zip(places.flat.as_chunks::<2>().0) {
                let seen = at(picture, transformed(moved, *uv));
                *colour = [0, 1, 2].map(|k| colour[k] * seen[k]);
            }
        }
        all
    }

    fn part(&self, piece: &Piece) -> &Value {
        let mesh = self.glb.list("meshes").get(piece.mesh);
        &mesh.unwrap_or(&Value::Null)["primitives"][piece.part]
    }

    /// The picture that a texture shows.
    fn source(&self, texture: &Value) -> Option<usize> {
        let texture = self.glb.list("textures").get(int(&texture["index"])?)?;
        let newer = &texture["extensions"]["EXT_texture_webp"]["source"];
        int(&texture["source"]).or_else(|| int(newer))
    }
}

/// A material's own colour; white, if it has none.
fn factor(value: &Value) -> [f32; 3] {
    [0, 1, 2].map(|k| value[k].as_f64().unwrap_or(1.0).clamp(0.0, 1.0) as f32)
}

fn picture(glb: &Glb, source: usize) -> Option<Image> {
    let image = glb.list("images").get(source)?;
    let (bytes, _) = glb.view(&image["bufferView"])?;
    let input = Input {
        file: String::new(),
        bytes: bytes.to_vec(),
    };
    decode_photo(&input, &PhotoLimits::default()).ok()
}

/// Where in a picture a place is that it is scaled, turned and moved for (`KHR_texture_transform`).
fn transformed(how: &Value, uv: [f64; 2]) -> [f64; 2] {
    let pair = |name: &str, or: f64| [0, 1].map(|k| how[name][k].as_f64().unwrap_or(or));
    let (offset, scale) = (pair("offset", 0.0), pair("scale", 1.0));
    let (sin, cos) = how["rotation"].as_f64().unwrap_or(0.0).sin_cos();
    let [u, v] = [uv[0] * scale[0], uv[1] * scale[1]];
    // Counter-clockwise where `v` goes down.
    [cos * u + sin * v + offset[0], cos * v - sin * u + offset[1]]
}

/// Linear light of the pixel at a place, from the top left; pictures repeat.
fn at(picture: &Image, uv: [f64; 2]) -> [f32; 3] {
    let pixel = |x: f64, n: usize| ((x.rem_euclid(1.0) * n as f64) as usize).min(n - 1);
    let [x, y] = [pixel(uv[0], picture.width), pixel(uv[1], picture.height)];
    let [r, g, b, _] = picture.pixels[y * picture.width + x];
    linear([r, g, b])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use serde_json::json;

    use super::*;

    #[test]
    fn places_are_scaled_then_turned_then_moved() {
        let close = |a: [f64; 2], b: [f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-12);
        assert_eq!(transformed(&Value::Null, [0.3, 0.7]), [0.3, 0.7]);
        let atlas = json!({ "offset": [0.5, 0.25], "scale": [0.5, 0.25] });
        assert!(close(transformed(&atlas, [1.0, 1.0]), [1.0, 0.5]));
        let turned = json!({ "rotation": FRAC_PI_2, "scale": [2.0, 1.0], "offset": [0.0, 1.0] });
        assert!(close(transformed(&turned, [0.25, 0.0]), [0.0, 0.5]));
    }

    #[test]
    fn pictures_repeat_and_are_seen_from_the_top_left() {
        let picture = Image {
            width: 2,
            height: 1,
            pixels: vec![[255, 0, 0, 255], [0, 0, 255, 255]],
        };
        assert_eq!(at(&picture, [0.1, 0.9]), [1.0, 0.0, 0.0]);
        assert_eq!(at(&picture, [1.9, -3.0]), [0.0, 0.0, 1.0]);
        assert_eq!(at(&picture, [f64::NAN, 2.0]), [1.0, 0.0, 0.0]);
    }
}
