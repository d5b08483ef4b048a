//! A character's own file with the garments in it: its nodes, meshes, materials and pictures stay as
//! they were, its skeleton plays the motion.
//!
//! Its own animations are left out, for the garments do not follow them. Garments hang below a node
//! called `muslin`, which takes metres to the file's unit.

use std::collections::BTreeMap;

use glam::{DAffine3, DQuat, DVec3};
use muslin_body::blended;
use serde_json::{Value, json};

use super::bin::Bin;
use super::buffer::{Glb, int};
use super::character::{CharacterFile, Piece};
use super::json::Root;
use super::moving::{EXACT, Film, Moved, same_way};
use super::play::Stage;
use crate::clip::Clip;
use crate::error::IoError;

/// A character in motion.
#[derive(Clone, Debug)]
pub struct Dressed<'a> {
    /// Its file.
    pub file: &'a CharacterFile,
    /// From our places [m] to the file's.
    pub file_from_ours: DAffine3,
    /// `world_from_joint` of every joint in our places, frame by frame; none for joints that stay.
    pub joints: Vec<Vec<Option<DAffine3>>>,
    /// How far flesh gave way [m], for every vertex of the character, frame by frame.
    pub yielded: Vec<Vec<DVec3>>,
}

/// The bytes of the character's file as a `.glb`, with the clip's garments in order.
pub fn dressed_glb(
    (name, clip): (&str, &Clip),
    dressed: &Dressed,
    garments: &[Moved],
) -> Result<Vec<u8>, IoError> {
    clip.check()?;
    let (base, bin) = kept(&dressed.file.glb)?;
    let list = |key: &str| base[key].as_array().cloned().unwrap_or_default();
    let own = list("nodes").len();
    let root = Root::over(list("nodes"), list("meshes"), list("materials"));
    let mut film = Film::over(clip, (root, bin));
    film.skins = list("skins");
    film.garments(clip, garments)?;
    let (scale, turn, place) = dressed.file_from_ours.to_scale_rotation_translation();
    let wrapper = json!({
        "name": "muslin",
        "children": std::mem::take(&mut film.top),
        "scale": scale.to_array(),
        "rotation": turn.to_array(),
        "translation": place.to_array(),
    });
    let stage = Stage::still(&dressed.file.glb)?;
    film.skeleton(dressed, &stage);
    if garments.iter().all(|g| g.baked.is_none()) {
        film.flesh(dressed)?;
    }
    film.root.nodes.push(wrapper);
    film.into_glb(base, (name, own))
}

impl Film {
    /// The joints' tracks.
    fn skeleton(&mut self, dressed: &Dressed, stage: &Stage) {
        let file = dressed.file;
        let mut joint_of = BTreeMap::new();
        file.nodes.iter().enumerate().for_each(|(j, n)| {
            joint_of.insert(*n, j);
        });
        // Where a node is: a joint where it was taken, another below what it hangs from.
        let world = |t: usize, node: usize| {
            let (mut at, mut below) = (Some(node), DAffine3::IDENTITY);
            while let Some(n) = at {
                if let Some(place) = joint_of.get(&n).and_then(|j| dressed.joints[t][*j]) {
                    return dressed.file_from_ours * place * below;
                }
                (at, below) = (stage.parents[n], stage.local(n, 0.0) * below);
            }
            below
        };
        let n = dressed.joints.len();
        for (j, node) in file.nodes.iter().enumerate() {
            if dressed.joints[0][j].is_none() {
                continue;
            }
            let local = |t: usize| match stage.parents[*node] {
                Some(p) => world(t, p).inverse() * world(t, *node),
                None => world(t, *node),
            };
            let parts: Vec<(DVec3, DQuat, DVec3)> = (0..n)
                .map(|t| local(t).to_scale_rotation_translation())
                .collect();
            let (scale, turn, place) = parts[0];
            let slot = &mut self.root.nodes[*node];
            let Some(map) = slot.as_object_mut() else {
                continue;
            };
            map.remove("matrix");
            slot["scale"] = json!(scale.as_vec3().to_array());
            slot["rotation"] = json!(turn.as_quat().to_array());
            slot["translation"] = json!(place.as_vec3().to_array());
            if n > 1 {
                let turns = parts.iter().map(|p| p.1.normalize()).collect();
                self.turns(*node, &same_way(turns));
                let places: Vec<DVec3> = parts.iter().map(|p| p.2).collect();
                let reach = places[0].length().max(1e-9);
                if places.iter().any(|p| p.distance(places[0]) > 1e-6 * reach) {
                    self.places(*node, &places);
                }
                let scales: Vec<DVec3> = parts.iter().map(|p| p.0).collect();
                if scales
                    .iter()
                    .any(|s| s.distance(scale) > 1e-5 * scale.length())
                {
                    self.scales(*node, &scales);
                }
            }
        }
    }

    /// Targets where flesh gave way. Meshes with targets of their own, or in several places, go
    /// without.
    fn flesh(&mut self, dressed: &Dressed) -> Result<(), IoError> {
        let pieces = &dressed.file.pieces;
        let mut by_mesh: BTreeMap<usize, Vec<&Piece>> = BTreeMap::new();
        pieces
            .iter()
            .for_each(|p| by_mesh.entry(p.mesh).or_default().push(p));
        for (mesh, pieces) in by_mesh {
            let node = pieces[0].node;
            let parts = self.root.meshes[mesh]["primitives"]
                .as_array()
                .map_or(0, Vec::len);
            let is_plain = self.root.meshes[mesh]["primitives"]
                .as_array()
                .is_some_and(|all| all.iter().all(|p| p["targets"].is_null()));
            if !is_plain || pieces.len() != parts || pieces.iter().any(|p| p.node != node) {
                continue;
            }
            let mut owners = Vec::new();
            let mut targets = vec![Vec::new(); parts];
            for t in 0..dressed.joints.len() {
                let moves: Vec<_> = pieces.iter().map(|p| gaps(dressed, p, t)).collect();
                if moves.iter().all(Vec::is_empty) {
                    continue;
                }
                owners.push(t);
                for (piece, moves) in pieces.iter().zip(moves) {
                    let n = piece.verts.len();
                    let target = match moves.is_empty() {
                        true => self.bin.zeros(n),
                        false => self.bin.sparse(&moves, n),
                    };
                    targets[piece.part].push(json!({ "POSITION": target }));
                }
            }
            if owners.is_empty() {
                continue;
            }
            let slot = &mut self.root.meshes[mesh];
            slot["weights"] = vec![0.0; owners.len()].into();
            for (part, list) in targets.into_iter().enumerate() {
                slot["primitives"][part]["targets"] = list.into();
            }
            self.weights(node, &owners);
        }
        Ok(())
    }
}

/// How far vertices of a piece must move before they are skinned, to end where flesh gave way.
fn gaps(dressed: &Dressed, piece: &Piece, t: usize) -> Vec<(u32, DVec3)> {
    let character = &dressed.file.character;
    let off = |(k, i): (usize, usize)| {
        let gap = dressed.yielded[t][i];
        if gap.length() <= EXACT {
            return None;
        }
        let row: Vec<(u32, f64)> = (character.weights.row(i).iter().enumerate())
            .map(|(k, w)| (k as u32, w.1))
            .collect();
        let bones: Option<Vec<DAffine3>> = (character.weights.row(i).iter())
            .map(|w| {
                let place = dressed.joints[t][w.0 as usize]?;
                Some(dressed.file_from_ours * place * *piece.back.get(&(w.0 as usize))?)
            })
            .collect();
        let back = blended(&row, &bones?).matrix3.inverse() * dressed.file_from_ours.matrix3;
        let gap = back * gap;
        gap.is_finite().then_some((k as u32, gap))
    };
    piece.verts.clone().enumerate().filter_map(off).collect()
}

/// The file's JSON without its animations, and what of its bytes that still needs.
fn kept(glb: &Glb) -> Result<(Value, Bin), IoError> {
    let mut json = glb.json.clone();
    if let Some(map) = json.as_object_mut() {
        map.remove("animations");
    }
    let mut accessors = Vec::new();
    let mut known = BTreeMap::new();
    let mut keep = |value: &mut Value| {
        if let Some(i) = int(value) {
            let new = *known.entry(i).or_insert_with(|| {
                accessors.push(glb.list("accessors").get(i).cloned().unwrap_or_default());
                accessors.len() - 1
            });
            *value = new.into();
        }
    };
    fn each<'v>(value: &'v mut Value, key: &str) -> impl Iterator<Item = &'v mut Value> {
        let list = value.get_mut(key).and_then(Value::as_array_mut);
        list.into_iter().flatten()
    }
    let mut all = |map: Option<&mut Value>| {
        let map = map.and_then(Value::as_object_mut);
        map.into_iter().flatten().for_each(|(_, v)| keep(v));
    };
    for mesh in each(&mut json, "meshes") {
        for part in each(mesh, "primitives") {
            all(part.get_mut("attributes"));
            each(part, "targets").for_each(|target| all(Some(target)));
        }
    }
    for mesh in each(&mut json, "meshes") {
        each(mesh, "primitives")
            .filter_map(|p| p.get_mut("indices"))
            .for_each(&mut keep);
    }
    let skins = each(&mut json, "skins");
    skins
        .filter_map(|s| s.get_mut("inverseBindMatrices"))
        .for_each(&mut keep);
    json["accessors"] = accessors.into();
    let mut bin = Bin::default();
    let mut views = BTreeMap::new();
    let mut missing = false;
    each_view(&mut json, &mut |value| {
        let Some(i) = int(value) else { return };
        let new = *views.entry(i).or_insert_with(|| {
            let bytes = glb.view(value).map(|v| v.0);
            missing |= bytes.is_none();
            let mut shape = glb.list("bufferViews").get(i).cloned().unwrap_or_default();
            bin.copied(bytes.unwrap_or(&[]), &mut shape)
        });
        *value = new.into();
    });
    if missing {
        return Err(glb.fault("/bufferViews", "a view that reaches beyond its data"));
    }
    bin.accessors = json["accessors"].as_array().cloned().unwrap_or_default();
    Ok((json, bin))
}

/// Calls with every reference to a buffer view.
fn each_view(value: &mut Value, call: &mut impl FnMut(&mut Value)) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|v| each_view(v, call)),
        Value::Object(map) => {
            for (key, inner) in map.iter_mut() {
                match key == "bufferView" {
                    true => call(inner),
                    false => each_view(inner, call),
                }
            }
        }
        _ => {}
    }
}
