//! Cloth as bones of its own and few morph targets: small files, and such as play where a target a
//! frame does not.
//!
//! Positions are 16-bit cells of 0.05 mm about the middle, which the skin's inverse binds take to metres;
//! targets are 8-bit cells, one unit of weight the most that fits (6.35 mm). The bones' turns are 16-bit
//! fractions of one.

use glam::{DQuat, DVec3};
use muslin_geom::Baked;
use serde_json::{Value, json};

use super::GlbOptions;
use super::moving::{Film, Moved, same_way, told, with_extras};
use crate::clip::Clip;

/// What `extras.muslin` of a garment's node says, so that nobody takes its handles for a character's.
pub(super) const GARMENT: &str = "garment";
/// A cell [m], where the cloth is small enough.
const CELL: f64 = 5e-5;
/// Cells from the middle that 16 and 8 bits hold.
const HALF: f64 = 32_767.0;
const UNIT: f64 = 127.0;

impl Film {
    /// One garment as handles and shapes.
    pub(super) fn baked(&mut self, moved: &Moved, clip: &Clip, baked: &Baked) {
        let (low, high) = super::bin::bounds(&baked.rest);
        let middle = (0.5 * (low + high)).as_vec3().as_dvec3();
        let step = (0.5 * (high - low).max_element() / HALF).max(CELL);
        let step = f64::from((step as f32).next_up());
        let mut node = moved.node.clone();
        let source = || moved.source.iter().map(|i| *i as usize);
        let (normals, bends) = baked.normals(&clip.drape.frames, &clip.drape.faces);
        node.mesh.verts = source().map(|i| baked.rest[i]).collect();
        node.normals = source().map(|i| normals[i]).collect();
        let material = self.root.material(&mut self.bin, &node);
        let mut primitive = self.surface(&node, material, &GlbOptions::default());
        let cell = |i: usize| {
            ((baked.rest[i] - middle) / step)
                .to_array()
                .map(|c| c.round() as i16)
        };
        let cells: Vec<[i16; 3]> = source().map(cell).collect();
        let attributes = &mut primitive["attributes"];
        attributes["POSITION"] = self.bin.cells(&cells, true).into();
        attributes["_SOURCE"] = self.sources(&moved.source);
        let rows: Vec<_> = source().map(|i| shorts(&baked.weights[i])).collect();
        attributes["JOINTS_0"] = self.bin.joints(rows.iter().map(|r| r.0)).into();
        attributes["WEIGHTS_0"] = self.bin.short_weights(rows.iter().map(|r| r.1)).into();
        let unit = UNIT * step;
        let target = |(shape, bend): (&Vec<DVec3>, &Vec<DVec3>)| {
            let moves: Vec<[i8; 3]> = source().map(|i| eighth(shape[i])).collect();
            let bends: Vec<[i8; 3]> = source().map(|i| eighth(unit * bend[i])).collect();
            json!({ "POSITION": self.bin.byte_cells(&moves), "NORMAL": self.bin.bytes(&bends) })
        };
        let targets: Vec<Value> = baked.shapes.iter().zip(&bends).map(target).collect();
        let mut mesh =
            json!({ "name": node.name, "primitives": [primitive], "extras": told(clip) });
        if !targets.is_empty() {
            mesh["weights"] = vec![0.0; targets.len()].into();
            mesh["primitives"][0]["targets"] = targets.into();
        }
        self.root.meshes.push(mesh);
        let skin = self.handles((&node.name, baked), (middle, step));
        let mesh = self.root.meshes.len() - 1;
        let mut value = json!({ "name": node.name, "mesh": mesh, "skin": skin });
        with_extras(&mut value, &node);
        value["extras"]["muslin"] = GARMENT.into();
        let index = self.root.nodes.len();
        self.root.nodes.push(value);
        self.free.push(index);
        if baked.moves.len() > 1 && !baked.shapes.is_empty() {
            let codes = baked.codes.iter().flatten().map(|c| [(c / unit) as f32]);
            let shape = json!({ "type": "SCALAR", "componentType": 5126 });
            let output = self.bin.keys(codes.collect::<Vec<_>>().into_iter(), shape);
            self.channel(index, "weights", output);
        }
    }

    /// The handles as joints below one node, with their tracks; their skin's index.
    fn handles(&mut self, (name, baked): (&str, &Baked), (middle, step): (DVec3, f64)) -> usize {
        let root = self.root.nodes.len();
        let joints: Vec<usize> = (1..=baked.centres.len()).map(|h| root + h).collect();
        self.root
            .nodes
            .push(json!({ "name": format!("{name} handles"), "children": joints }));
        self.top.push(root);
        for (h, centre) in baked.centres.iter().enumerate() {
            let place = baked.moves[0][h].transform_point3(*centre);
            self.root.nodes.push(json!({
                "name": format!("{name} handle {h}"),
                "translation": place.as_vec3().to_array(),
            }));
        }
        let s = step as f32;
        let back = baked.centres.iter().map(|c| {
            let [x, y, z] = (middle - *c).as_vec3().to_array();
            [
                s, 0.0, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, 0.0, s, 0.0, x, y, z, 1.0f32,
            ]
        });
        let inverse = self
            .bin
            .keys(back, json!({ "type": "MAT4", "componentType": 5126 }));
        if baked.moves.len() > 1 {
            for (h, joint) in joints.iter().enumerate() {
                let moves = || baked.moves.iter().map(|m| m[h]);
                let places: Vec<DVec3> = moves()
                    .map(|m| m.transform_point3(baked.centres[h]))
                    .collect();
                self.places(*joint, &places);
                let turns = moves().map(|m| DQuat::from_mat3(&m.matrix3).normalize());
                let turns = same_way(turns.collect());
                let output = self.bin.short_turns(&turns);
                self.channel(*joint, "rotation", output);
            }
        }
        self.skins
            .push(json!({ "inverseBindMatrices": inverse, "joints": joints, "skeleton": root }));
        self.skins.len() - 1
    }
}

/// A part of one in 127ths.
fn eighth(d: DVec3) -> [i8; 3] {
    d.to_array()
        .map(|c| (c.clamp(-1.0, 1.0) * UNIT).round() as i8)
}

/// Four bones and their weights in 65,535ths, which sum to one; a bone without weight is the first.
pub(super) fn shorts(row: &[(u32, f64)]) -> ([u8; 4], [u16; 4]) {
    let weight = |k: usize| row.get(k).map_or(0, |w| (w.1 * 65_535.0).round() as u16);
    let mut out: [u16; 4] = std::array::from_fn(weight);
    let most = (0..4).fold(0, |best, k| if out[k] > out[best] { k } else { best });
    let others: u32 = (0..4)
        .filter(|k| *k != most)
        .map(|k| u32::from(out[k]))
        .sum();
    out[most] = (65_535 - others.min(65_535)) as u16;
    let bone = |k: usize| match out[k] {
        0 => 0,
        _ => row[k].0 as u8,
    };
    (std::array::from_fn(bone), out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_weights_sum_to_one() {
        let rows: [&[(u32, f64)]; 4] = [
            &[(0, 1.0)],
            &[(3, 0.5), (1, 0.5)],
            &[(0, 0.333), (1, 0.333), (2, 0.333), (9, 0.001)],
            &[(7, 2e-6), (8, 0.999_998)],
        ];
        for row in rows {
            let (bones, weights) = shorts(row);
            let sum: u32 = weights.iter().map(|b| u32::from(*b)).sum();
            assert_eq!(sum, 65_535, "{row:?}");
            for k in 0..4 {
                let own = row.get(k).filter(|_| weights[k] > 0);
                assert_eq!(u32::from(bones[k]), own.map_or(0, |w| w.0), "{row:?}");
            }
        }
    }
}
