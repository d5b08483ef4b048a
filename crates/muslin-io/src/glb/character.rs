//! Characters in: the skinned meshes of a glTF file, their joints and their animations.
//!
//! `.glb`, `.vrm` (a GLB as well) and `.gltf` with what lies beside it. Where the skin was bound counts,
//! not how the file happens to stand: `bound = G IBM⁻¹`, with `G` from where the topmost joint is.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use glam::DAffine3;
use muslin_body::Character;
use serde_json::Value;

use super::baked::GARMENT;
use super::buffer::{Glb, int};
use super::pack;
use super::play::{MAX_JOINTS, Stage, matrix};
use crate::error::{Fault, IoError, Place};
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
    /// The names of garments that it wears already, of those that we have written.
    pub wears: Vec<String>,
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
    let glb = pack::open(path, &input)?;
    for extension in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let list = glb.json["extensionsRequired"].as_array();
        if list.is_some_and(|l| l.iter().any(|e| e == extension)) {
            return Err(compressed(&input.file, extension));
        }
    }
    let mut reader = Reader::new(&glb)?;
    for (i, node) in glb.list("nodes").iter().enumerate() {
        if !node["mesh"].is_null() && !node["skin"].is_null() && !is_garment(node) {
            reader.mesh(i)?;
        }
    }
    let (character, nodes, pieces) = reader.finish()?;
    Ok(CharacterFile {
        sha256: input.sha256(),
        file: input.file,
        wears: glb
            .list("nodes")
            .iter()
            .filter(|n| is_garment(n))
            .filter_map(|n| Some(n["name"].as_str()?.to_owned()))
            .collect(),
        character,
        clips: clips(&glb),
        nodes,
        pieces,
        glb,
    })
}

fn compressed(file: &str, extension: &str) -> IoError {
    let what = format!("its meshes are compressed by {extension}, which is not read");
    let fault = Fault::new("glb", file, what).at(Place::Pointer("/extensionsRequired".into()));
    let fault = fault.allowed("meshes without compression");
    fault.hint("export it without compression").refused()
}

impl CharacterFile {
    /// The number of the animation of a name: the first of that name, or else the one of that number, from 1.
    pub fn clip(&self, name: &str) -> Option<usize> {
        called(&self.clips, name)
    }

    /// `world_from_joint` of every joint in animation number `clip`, `fps` times a second.
    ///
    /// Refuses more than ten hours, 2²⁰ frames or 8 GiB.
    pub fn play(&self, clip: usize, fps: f64) -> Result<Vec<Vec<DAffine3>>, IoError> {
        self.glb.anew();
        let stage = Stage::playing(&self.glb, clip)?;
        let frames = stage.frames(&self.glb, (clip, fps), self.nodes.len())?;
        let at = |k: usize| {
            let time = k as f64 / fps;
            self.nodes.iter().map(|n| stage.world(*n, time)).collect()
        };
        Ok((0..frames).map(at).collect())
    }
}

/// The names of a file's animations; those without one are called by their number, from 1.
pub(super) fn clips(glb: &Glb) -> Vec<String> {
    let named = |(i, a): (usize, &Value)| match a["name"].as_str() {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => (i + 1).to_string(),
    };
    glb.list("animations")
        .iter()
        .enumerate()
        .map(named)
        .collect()
}

/// Which of `clips` is meant: the first of that name, or else the one of that number, from 1.
pub(super) fn called(clips: &[String], name: &str) -> Option<usize> {
    let number = || name.parse::<usize>().ok()?.checked_sub(1);
    let named = clips.iter().position(|c| c == name);
    named.or_else(number).filter(|i| *i < clips.len())
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

pub(super) fn is_garment(node: &Value) -> bool {
    node["extras"]["muslin"] == GARMENT
}

/// The nodes that are joints of a skin, but for those of `ours`; parents first.
fn joints(glb: &Glb, stage: &Stage, ours: &[usize]) -> Result<Vec<usize>, IoError> {
    let n = glb.list("nodes").len();
    let mut is_joint = vec![false; n];
    for (s, skin) in glb.list("skins").iter().enumerate() {
        if ours.contains(&s) {
            continue;
        }
        for j in skin["joints"].as_array().into_iter().flatten() {
            let slot = int(j).and_then(|j| is_joint.get_mut(j));
            let slot = slot.ok_or_else(|| no_node(glb, s))?;
            *slot = true;
        }
    }
    let mut nodes: Vec<usize> = (0..n).filter(|i| is_joint[*i]).collect();
    if nodes.is_empty() {
        return Err(glb.fault(
            "/skins",
            "no mesh is skinned: a character needs a skeleton and skin weights",
        ));
    }
    if nodes.len() > MAX_JOINTS {
        return Err(glb.large("/skins", "too many joints", MAX_JOINTS));
    }
    for node in &nodes {
        stage.check_depth(glb, *node)?;
    }
    nodes.sort_by_cached_key(|i| (stage.above(*i).count(), *i));
    Ok(nodes)
}

fn no_node(glb: &Glb, skin: usize) -> IoError {
    glb.fault(&format!("/skins/{skin}"), "a joint that is no node")
}

/// The joints that a mesh may follow, in its skin's order.
struct Bones {
    /// Their numbers.
    joints: Vec<usize>,
    /// Inverse bind matrices.
    back: Vec<DAffine3>,
    /// To where the first skin has bound them; as a rule the same for all.
    places: Vec<DAffine3>,
}

impl<'a> Reader<'a> {
    /// Joints of all skins, parents first.
    fn new(glb: &'a Glb<'static>) -> Result<Self, IoError> {
        let (stage, ours) = (Stage::still(glb)?, garments(glb));
        let nodes = joints(glb, &stage, &ours)?;
        let mut joint_of = vec![None; glb.list("nodes").len()];
        nodes
            .iter()
            .enumerate()
            .for_each(|(j, i)| joint_of[*i] = Some(j));
        let above = |i: &usize| stage.above(*i).find_map(|p| joint_of[p]);
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
        reader.bind(&ours)?;
        Ok(reader)
    }

    /// Where skins bind the joints. Later skins do not move what an earlier one has bound.
    fn bind(&mut self, ours: &[usize]) -> Result<(), IoError> {
        let mut set = vec![false; self.nodes.len()];
        for s in (0..self.glb.list("skins").len()).filter(|s| !ours.contains(s)) {
            let (joints, back) = self.skin(s)?;
            let first = joints.iter().zip(&back).min_by_key(|(j, _)| **j);
            let Some((first, inverse)) = first else {
                continue;
            };
            let ground = self.stage.world(self.nodes[*first], 0.0) * *inverse;
            for (j, inverse) in joints.iter().zip(&back) {
                if !std::mem::replace(&mut set[*j], true) {
                    self.character.bound[*j] = ground * inverse.inverse();
                }
            }
        }
        Ok(())
    }

    /// Joint numbers and inverse bind matrices of a skin.
    fn skin(&self, s: usize) -> Result<(Vec<usize>, Vec<DAffine3>), IoError> {
        let pointer = format!("/skins/{s}");
        let skin = &self.glb.list("skins")[s];
        let joints = skin["joints"].as_array().map_or(&[][..], Vec::as_slice);
        if joints.len() > MAX_JOINTS {
            return Err(self.glb.large(&pointer, "too many joints", MAX_JOINTS));
        }
        // A skin that a garment shares is none of those whose joints were numbered.
        let number = |j: &Value| int(j).and_then(|i| *self.joint_of.get(i)?);
        let joints: Option<Vec<usize>> = joints.iter().map(number).collect();
        let joints =
            joints.ok_or_else(|| self.glb.fault(&pointer, "a joint of no character's skin"))?;
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
        let index = int(&value["mesh"]).filter(|m| *m < glb.list("meshes").len());
        let index = index.ok_or_else(|| fault("no such mesh"))?;
        let s = int(&value["skin"]).filter(|s| *s < glb.list("skins").len());
        let (joints, back) = self.skin(s.ok_or_else(|| fault("no such skin"))?)?;
        if joints.is_empty() {
            return Err(fault("its skin has no joints"));
        }
        let place = |(j, b): (&usize, &DAffine3)| self.character.bound[*j] * *b;
        let bones = Bones {
            places: joints.iter().zip(&back).map(place).collect(),
            joints,
            back,
        };
        let parts = glb.list("meshes")[index]["primitives"].as_array();
        for (k, part) in parts.into_iter().flatten().enumerate() {
            if int(&part["mode"]).unwrap_or(4) != 4 {
                continue;
            }
            glb.take(&pointer, 16 * bones.joints.len())?;
            let verts = self.verts(&pointer, &part["attributes"], &bones)?;
            self.faces(&pointer, &part["indices"], &verts)?;
            let back = bones.back.iter().copied();
            self.pieces.push(Piece {
                node,
                mesh: index,
                part: k,
                verts,
                back: bones.joints.iter().copied().zip(back).collect(),
            });
        }
        Ok(())
    }

    /// Takes the vertices of a primitive and what they follow; which of the character's they are.
    fn verts(
        &mut self,
        pointer: &str,
        attributes: &Value,
        bones: &Bones,
    ) -> Result<Range<usize>, IoError> {
        let (glb, first) = (self.glb, self.character.verts.len());
        if glb.count(&attributes["POSITION"]) > MAX_VERTS - first {
            return Err(glb.large(pointer, "more than two million vertices", MAX_VERTS));
        }
        let verts = glb.points(pointer, &attributes["POSITION"])?;
        let rows = rows(glb, (pointer, attributes), verts.len())?;
        for (v, row) in verts.iter().zip(&rows) {
            let total: f64 = row.iter().map(|w| w.1).sum();
            let is_strange = row.iter().any(|w| w.0 >= bones.joints.len());
            if !v.is_finite() || !total.is_finite() || is_strange {
                let what = "a vertex that is not a number, or that follows no joint";
                return Err(glb.fault(pointer, what));
            }
            // Some exporters leave sums off one; a vertex without weights follows the first joint.
            let row: Vec<(usize, f64)> = match total > 0.0 {
                true => row.iter().map(|w| (w.0, w.1 / total)).collect(),
                false => vec![(0, 1.0)],
            };
            let at = |w: &(usize, f64)| bones.places[w.0].transform_point3(*v) * w.1;
            self.character.verts.push(row.iter().map(at).sum());
            let row = row.iter().map(|w| (bones.joints[w.0] as u32, w.1));
            self.character.weights.push(row);
        }
        Ok(first..first + verts.len())
    }

    /// Takes the triangles between some vertices.
    fn faces(
        &mut self,
        pointer: &str,
        indices: &Value,
        verts: &Range<usize>,
    ) -> Result<(), IoError> {
        let corners: Vec<u32> = match indices {
            Value::Null => (0..verts.len() as u32).collect(),
            index => {
                let flat = self.glb.numbers(index)?.flat;
                flat.iter().map(|c| *c as u32).collect()
            }
        };
        if corners.iter().any(|c| *c as usize >= verts.len()) {
            let what = "a triangle has a corner that is no vertex";
            return Err(self.glb.fault(pointer, what));
        }
        let faces = corners.as_chunks::<3>().0.iter();
        let first = verts.start as u32;
        self.character
            .faces
            .extend(faces.map(|f| f.map(|c| c + first)));
        Ok(())
    }

    fn finish(self) -> Result<(Character, Vec<usize>, Vec<Piece>), IoError> {
        if self.character.faces.is_empty() {
            return Err(self.glb.fault("/meshes", "no skinned mesh has triangles"));
        }
        Ok((self.character, self.nodes, self.pieces))
    }
}

/// What each of `n` vertices follows, by the numbers of its skin, and how much; up to sixteen joints each.
fn rows(
    glb: &Glb,
    (pointer, attributes): (&str, &Value),
    n: usize,
) -> Result<Vec<Vec<(usize, f64)>>, IoError> {
    let mut rows = vec![Vec::new(); n];
    for set in 0..4 {
        let (bones, shares) = (
            &attributes[format!("JOINTS_{set}")],
            &attributes[format!("WEIGHTS_{set}")],
        );
        if bones.is_null() || shares.is_null() {
            break;
        }
        let (bones, shares) = (glb.numbers(bones)?.flat, glb.numbers(shares)?.flat);
        if bones.len() != 4 * n || shares.len() != bones.len() {
            return Err(glb.fault(pointer, "weights that are not its vertices'"));
        }
        for (k, (b, w)) in bones.iter().zip(&shares).enumerate() {
            if *w > 0.0 {
                rows[k / 4].push((*b as usize, *w));
            }
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn animations_of_one_name_are_told_apart_by_number() {
        let clips = ["mixamo.com", "mixamo.com", "1", "mixamo.com"].map(String::from);
        for (name, clip) in [
            ("mixamo.com", Some(0)),
            ("2", Some(1)),
            ("4", Some(3)),
            // A name goes before a number.
            ("1", Some(2)),
            ("0", None),
            ("5", None),
            ("walk", None),
        ] {
            assert_eq!(called(&clips, name), clip, "{name}");
        }
    }
}
