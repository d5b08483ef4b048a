//! Characters in: the skinned meshes of a glTF file, their joints and their animations.
//!
//! `.glb`, `.vrm` (a GLB as well) and `.gltf` with what lies beside it. Where the skin was bound counts,
//! not how the file happens to stand: `bound = G IBM⁻¹`, with `G` from where the topmost joint is.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, DVec3};
use muslin_body::Character;
use serde_json::Value;

use super::baked::GARMENT;
use super::buffer::{Glb, int};
use super::pack;
use super::play::{Stage, matrix};
use crate::error::IoError;
use crate::input::read_file;

/// Files with more bytes are refused.
const MAX_BYTES: u64 = 512 << 20;
/// More vertices are refused.
const MAX_VERTS: usize = 2_000_000;

/// A character as its file has it.
#[derive(Clone, Debug)]
pub struct CharacterFile {
    /// The file as the user named it.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Joints and skin, in the file's unit.
    pub character: Character,
    /// The names of its animations; those without one are called by their number, from 1.
    pub clips: Vec<String>,
    pub(super) glb: Glb<'static>,
    /// The node of every joint.
    pub(super) nodes: Vec<usize>,
    pub(super) pieces: Vec<Piece>,
}

/// One primitive of a skinned mesh.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub node: usize,
    pub mesh: usize,
    pub part: usize,
    /// Its vertices among the character's.
    pub verts: Range<usize>,
    /// Inverse bind matrix of every joint of its skin, by the character's numbers.
    pub back: BTreeMap<usize, DAffine3>,
}

/// Reads a character.
///
/// Fails where no mesh is skinned, and on compressed meshes, which are not read.
pub fn read_character(path: &Path) -> Result<CharacterFile, IoError> {
    let input = read_file(path, MAX_BYTES)?;
    let glb = match input.bytes.starts_with(b"glTF") {
        true => Glb::owned(&input.file, input.bytes.clone())?,
        false => pack::packed(path, &input)?,
    };
    for extension in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let list = glb.json["extensionsRequired"].as_array();
        if list.is_some_and(|l| l.iter().any(|e| e == extension)) {
            let what = format!("its meshes are compressed by {extension}, which is not read");
            return Err(glb.fault("/extensionsRequired", &what));
        }
    }
    let mut reader = Reader::new(&glb)?;
    for (i, node) in glb.list("nodes").iter().enumerate() {
        if !node["mesh"].is_null() && !node["skin"].is_null() && !is_garment(node) {
            reader.mesh(i)?;
        }
    }
    let (character, nodes, pieces) = reader.finish()?;
    let named = |(i, a): (usize, &Value)| match a["name"].as_str() {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => (i + 1).to_string(),
    };
    Ok(CharacterFile {
        sha256: input.sha256(),
        file: input.file,
        character,
        clips: glb
            .list("animations")
            .iter()
            .enumerate()
            .map(named)
            .collect(),
        nodes,
        pieces,
        glb,
    })
}

impl CharacterFile {
    /// `world_from_joint` of every joint in animation number `clip`, `fps` times a second.
    pub fn play(&self, clip: usize, fps: f64) -> Result<Vec<Vec<DAffine3>>, IoError> {
        let stage = Stage::playing(&self.glb, clip)?;
        let frames = (stage.end() * fps).floor() as usize + 1;
        let at = |k: usize| {
            let time = k as f64 / fps;
            self.nodes.iter().map(|n| stage.world(*n, time)).collect()
        };
        Ok((0..frames).map(at).collect())
    }
}

struct Reader<'a> {
    glb: &'a Glb<'static>,
    stage: Stage<'a>,
    /// Joint number of every node that is one.
    joint_of: Vec<Option<usize>>,
    nodes: Vec<usize>,
    character: Character,
    pieces: Vec<Piece>,
}

/// Skins of garments that we have written: handles, no skeleton.
fn garments(glb: &Glb) -> Vec<usize> {
    let nodes = glb.list("nodes").iter().filter(|n| is_garment(n));
    nodes.filter_map(|n| int(&n["skin"])).collect()
}

fn is_garment(node: &Value) -> bool {
    node["extras"]["muslin"] == GARMENT
}

impl<'a> Reader<'a> {
    /// Joints of all skins, parents first.
    fn new(glb: &'a Glb<'static>) -> Result<Self, IoError> {
        let stage = Stage::still(glb)?;
        let n = glb.list("nodes").len();
        let mut is_joint = vec![false; n];
        let ours = garments(glb);
        for (s, skin) in glb.list("skins").iter().enumerate() {
            if ours.contains(&s) {
                continue;
            }
            for j in skin["joints"].as_array().into_iter().flatten() {
                let slot = int(j).and_then(|j| is_joint.get_mut(j));
                *slot.ok_or_else(|| {
                    glb.fault(&format!("/skins/{s}"), "a joint that is no node")
                })? = true;
            }
        }
        if !is_joint.contains(&true) {
            return Err(glb.fault(
                "/skins",
                "no mesh is skinned: a character needs a skeleton and skin weights",
            ));
        }
        let depth = |mut i: usize| {
            let mut d = 0;
            while let (Some(p), true) = (stage.parents[i], d <= n) {
                (i, d) = (p, d + 1);
            }
            d
        };
        let mut nodes: Vec<usize> = (0..n).filter(|i| is_joint[*i]).collect();
        if nodes.iter().any(|i| depth(*i) > n) {
            return Err(glb.fault("/nodes", "nodes that are their own ancestors"));
        }
        nodes.sort_by_key(|i| (depth(*i), *i));
        let mut joint_of = vec![None; n];
        nodes
            .iter()
            .enumerate()
            .for_each(|(j, i)| joint_of[*i] = Some(j));
        let above = |i: &usize| {
            let mut at = stage.parents[*i];
            while let Some(p) = at {
                if joint_of[p].is_some() {
                    return joint_of[p];
                }
                at = stage.parents[p];
            }
            None
        };
        let name = |i: &usize| {
            glb.list("nodes")[*i]["name"]
                .as_str()
                .unwrap_or("")
                .to_owned()
        };
        let character = Character {
            names: nodes.iter().map(name).collect(),
            parents: nodes.iter().map(above).collect(),
            bound: nodes.iter().map(|i| stage.world(*i, 0.0)).collect(),
            ..Character::default()
        };
        let mut reader = Self {
            glb,
            stage,
            joint_of,
            nodes,
            character,
            pieces: Vec::new(),
        };
        // Later skins do not move what an earlier one has bound.
        let mut set = vec![false; reader.nodes.len()];
        for s in (0..glb.list("skins").len()).filter(|s| !ours.contains(s)) {
            let (joints, back) = reader.skin(s)?;
            let first = joints.iter().zip(&back).min_by_key(|(j, _)| **j);
            let Some((first, inverse)) = first else {
                continue;
            };
            let ground = reader.stage.world(reader.nodes[*first], 0.0) * *inverse;
            for (j, inverse) in joints.iter().zip(&back) {
                if !std::mem::replace(&mut set[*j], true) {
                    reader.character.bound[*j] = ground * inverse.inverse();
                }
            }
        }
        Ok(reader)
    }

    /// Joint numbers and inverse bind matrices of a skin.
    fn skin(&self, s: usize) -> Result<(Vec<usize>, Vec<DAffine3>), IoError> {
        let pointer = format!("/skins/{s}");
        let skin = &self.glb.list("skins")[s];
        let joints = skin["joints"].as_array().into_iter().flatten();
        let joints: Vec<usize> = joints
            .filter_map(|j| int(j).and_then(|i| self.joint_of[i]))
            .collect();
        let back = match &skin["inverseBindMatrices"] {
            Value::Null => vec![DAffine3::IDENTITY; joints.len()],
            index => {
                let flat = self.glb.numbers(index)?.flat;
                flat.as_chunks::<16>()
                    .0
                    .iter()
                    .map(matrix)
                    .collect::<Vec<_>>()
            }
        };
        let is_sound = |m: &DAffine3| m.is_finite() && m.matrix3.determinant().abs() > 1e-18;
        if back.len() < joints.len() || !back.iter().all(is_sound) {
            return Err(self
                .glb
                .fault(&pointer, "a joint without a bind matrix that can be undone"));
        }
        Ok((joints, back))
    }

    fn mesh(&mut self, node: usize) -> Result<(), IoError> {
        let glb = self.glb;
        let value = &glb.list("nodes")[node];
        let pointer = format!("/nodes/{node}");
        let fault = |what: &str| glb.fault(&pointer, what);
        let mesh = int(&value["mesh"]).and_then(|m| glb.list("meshes").get(m));
        let mesh = mesh.ok_or_else(|| fault("no such mesh"))?;
        let s = int(&value["skin"]).filter(|s| *s < glb.list("skins").len());
        let (joints, back) = self.skin(s.ok_or_else(|| fault("no such skin"))?)?;
        // To where the first skin has bound the joints; as a rule the same for all.
        let place: Vec<DAffine3> = joints
            .iter()
            .zip(&back)
            .map(|(j, b)| self.character.bound[*j] * *b)
            .collect();
        for (k, part) in mesh["primitives"]
            .as_array()
            .into_iter()
            .flatten()
            .enumerate()
        {
            if int(&part["mode"]).unwrap_or(4) != 4 {
                continue;
            }
            let attributes = &part["attributes"];
            let verts = glb.numbers(&attributes["POSITION"])?;
            let verts: Vec<DVec3> = match verts.width {
                3 => verts
                    .flat
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .map(|c| DVec3::from_array(*c))
                    .collect(),
                _ => return Err(fault("positions that are not in space")),
            };
            let first = self.character.verts.len();
            if first + verts.len() > MAX_VERTS {
                return Err(fault("more than two million vertices"));
            }
            let mut rows = vec![Vec::new(); verts.len()];
            for set in 0..4 {
                let (bones, shares) = (
                    &attributes[format!("JOINTS_{set}")],
                    &attributes[format!("WEIGHTS_{set}")],
                );
                if bones.is_null() || shares.is_null() {
                    break;
                }
                let (bones, shares) = (glb.numbers(bones)?.flat, glb.numbers(shares)?.flat);
                if bones.len() != 4 * verts.len() || shares.len() != bones.len() {
                    return Err(fault("weights that are not its vertices'"));
                }
                for (k, (b, w)) in bones.iter().zip(&shares).enumerate() {
                    if *w > 0.0 {
                        rows[k / 4].push((*b as usize, *w));
                    }
                }
            }
            for (v, row) in verts.iter().zip(&rows) {
                let total: f64 = row.iter().map(|w| w.1).sum();
                if !v.is_finite() || !total.is_finite() || row.iter().any(|w| w.0 >= joints.len()) {
                    return Err(fault(
                        "a vertex that is not a number, or that follows no joint",
                    ));
                }
                // Some exporters leave sums off one; a vertex without weights follows the first joint.
                let row: Vec<(usize, f64)> = match total > 0.0 {
                    true => row.iter().map(|w| (w.0, w.1 / total)).collect(),
                    false => vec![(0, 1.0)],
                };
                let at: DVec3 = row
                    .iter()
                    .map(|w| place[w.0].transform_point3(*v) * w.1)
                    .sum();
                self.character.verts.push(at);
                self.character
                    .weights
                    .push(row.iter().map(|w| (joints[w.0] as u32, w.1)));
            }
            self.pieces.push(Piece {
                node,
                mesh: int(&value["mesh"]).unwrap_or(0),
                part: k,
                verts: first..first + verts.len(),
                back: joints.iter().copied().zip(back.iter().copied()).collect(),
            });
            let corners: Vec<u32> = match &part["indices"] {
                Value::Null => (0..verts.len() as u32).collect(),
                index => glb.numbers(index)?.flat.iter().map(|c| *c as u32).collect(),
            };
            if corners.iter().any(|c| *c as usize >= verts.len()) {
                return Err(fault("a triangle has a corner that is no vertex"));
            }
            let faces = corners.as_chunks::<3>().0.iter();
            self.character
                .faces
                .extend(faces.map(|f| f.map(|c| c + first as u32)));
        }
        Ok(())
    }

    fn finish(self) -> Result<(Character, Vec<usize>, Vec<Piece>), IoError> {
        if self.character.faces.is_empty() {
            return Err(self.glb.fault("/meshes", "no skinned mesh has triangles"));
        }
        Ok((self.character, self.nodes, self.pieces))
    }
}
