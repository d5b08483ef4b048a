//! Moving GLB: cloth as one morph target a frame, a body that follows its bones.
//!
//! Every viewer plays it and every editor opens it. A garment's node follows the cloth as a whole
//! (its middle, and the turn that fits it best), so that the targets hold only what is left:
//! 16-bit positions (a step of a hundredth of a millimetre or two) and 8-bit normals, 12 bytes a
//! vertex and frame. Between frames a viewer blends linearly. Frame 0 is the mesh itself. A frame whose
//! cloth lies so close that rounding it would bring it through itself is in single floats.
//!
//! The body is skinned with four bones a vertex at most. Where the given frames differ from that,
//! as where flesh gave way to cloth, sparse targets carry the difference.

use glam::{DAffine3, DQuat, DVec3, DVec4};
use muslin_body::{Rig, blended};
use muslin_geom::{Baked, Surface};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::baked::shorts;
use super::bin::Bin;
use super::json::Root;
use super::track::{Track, whole};
use super::{GlbOptions, container};
use crate::clip::Clip;
use crate::error::{Fault, IoError, Place};
use crate::scene::{Node, Scene};

/// A thing of the scene, and which vertex of the frames each of its vertices is.
///
/// Texture seams double vertices: see [`Node::with_corner_uvs_and_sources`].
#[derive(Clone, Debug, PartialEq)]
pub struct Moved {
    /// Looks, triangles and texture coordinates; positions and normals are taken from the frames.
    pub node: Node,
    /// Vertex of the garment's (or body's) frames.
    pub source: Vec<u32>,
    /// A garment's frames as handles and shapes; without, every frame is a target.
    pub baked: Option<Baked>,
}

impl Moved {
    /// Leaves out triangles all of whose corners are hidden, and vertices that none is left of.
    pub fn without(mut self, is_hidden: impl Fn(u32) -> bool) -> Self {
        let source = &self.source;
        let hidden = |i: &u32| is_hidden(source[*i as usize]);
        self.node.mesh.faces.retain(|f| !f.iter().all(hidden));
        self.source = self.node.used().iter().map(|i| source[*i]).collect();
        self.node = self.node.without_unused();
        self
    }
}

/// How the body moves.
#[derive(Clone, Debug)]
pub struct Skinned<'a> {
    /// Bones and weights over the body's vertices.
    pub rig: &'a Rig,
    /// Where each bone's head is at rest [m].
    pub heads: Vec<DVec3>,
    /// The body's vertices at rest [m].
    pub rest: &'a [DVec3],
    /// `world_from_rest` of every bone, frame by frame.
    pub bones: Vec<Vec<DAffine3>>,
}

/// A body beyond this from its skinned place gets a correction [m].
pub(super) const EXACT: f64 = 1e-5;

/// The bytes of an animated `.glb`: `body` with its skin, then the clip's garments in order.
///
/// Where a garment is baked, the body follows its bones alone.
///
/// `scene` lends its name and copyright; its nodes are not used.
pub fn moving_glb(
    scene: &Scene,
    clip: &Clip,
    body: Option<(&Moved, &Skinned)>,
    garments: &[Moved],
) -> Result<Vec<u8>, IoError> {
    clip.check()?;
    let mut film = Film::over(clip, (Root::default(), Bin::default()));
    if let Some((moved, skin)) = body {
        fits(moved, clip.body.first().map_or(0, Vec::len))?;
        let exact = garments.iter().all(|g| g.baked.is_none());
        film.body(moved, skin, &clip.body, exact)?;
    }
    film.garments(clip, garments)?;
    film.finish(scene)
}

/// Refuses nodes whose vertices are not the frames'.
fn fits(moved: &Moved, n: usize) -> Result<(), IoError> {
    let node = &moved.node;
    let is_whole = moved.source.len() == node.mesh.verts.len()
        && moved.source.iter().all(|&i| (i as usize) < n)
        && node
            .mesh
            .faces
            .as_flattened()
            .iter()
            .all(|&i| (i as usize) < moved.source.len())
        && (node.uvs.is_empty() || node.uvs.len() == moved.source.len())
        && !node.mesh.faces.is_empty();
    match is_whole {
        true => Ok(()),
        false => {
            let place = Place::Pointer(format!("/nodes/{}", node.name));
            let what = "its vertices do not go with the frames";
            Err(Fault::new("bad-scene", "the scene to write", what)
                .at(place)
                .invalid())
        }
    }
}

/// Refuses handles that are not this garment's, or more than a vertex can name.
fn goes(baked: &Baked, part: &Clip) -> Result<(), IoError> {
    let fits = baked.rest.len() == part.n_verts()
        && baked.moves.len() == part.drape.frames.len()
        && (1..=255).contains(&baked.centres.len());
    match fits {
        true => Ok(()),
        false => {
            let what = "its handles do not go with the frames";
            Err(Fault::new("bad-scene", "the scene to write", what).invalid())
        }
    }
}

/// Frames in which cells bring cloth through cloth that it has not passed. The first is the mesh, which has no
/// other form.
fn tight(clip: &Clip, parts: &[(String, Clip)], tracks: &[&Track]) -> Vec<bool> {
    let (frames, faces) = (&clip.drape.frames, &clip.drape.faces);
    let Some(first) = frames.first() else {
        return Vec::new();
    };
    let cloth = Surface::new(first, faces);
    let crossings = |cloth: &mut Surface, x: &[DVec3]| {
        cloth.refit(x);
        cloth.self_intersections().len()
    };
    let one = |cloth: &mut Surface, t: usize| {
        let stored = parts.iter().zip(tracks).flat_map(|((_, part), track)| {
            let x = part.drape.frames[t].iter();
            x.map(move |x| track.stored(t, *x))
        });
        let after = crossings(cloth, &stored.collect::<Vec<_>>());
        after > 0 && crossings(cloth, &frames[t]) < after
    };
    let all = (0..frames.len()).into_par_iter();
    all.map_init(|| cloth.clone(), |cloth, t| t > 0 && one(cloth, t))
        .collect()
}

/// How a garment moves in the file.
enum Way<'a> {
    Baked(&'a Baked),
    Tracked(Track),
}

impl<'a> Way<'a> {
    fn of(moved: &'a Moved, part: &Clip) -> Self {
        match &moved.baked {
            Some(baked) => Self::Baked(baked),
            None => Self::Tracked(Track::of(&part.drape.frames)),
        }
    }

    fn track(&self) -> Option<&Track> {
        match self {
            Self::Baked(_) => None,
            Self::Tracked(track) => Some(track),
        }
    }
}

/// A file in the making.
pub(super) struct Film {
    pub bin: Bin,
    pub root: Root,
    channels: Vec<Value>,
    samplers: Vec<Value>,
    /// Skins, the body's first.
    pub skins: Vec<Value>,
    /// Nodes that are not below another of ours.
    pub top: Vec<usize>,
    /// Skinned garments, which stand where their joints are and so belong below nothing.
    pub free: Vec<usize>,
    times: usize,
    n_frames: usize,
}

/// What a garment's mesh says in its `extras`: which vertices the body holds, and what it is made of.
pub(super) fn told(clip: &Clip) -> Value {
    let mut extras = json!({});
    if !clip.pins.is_empty() {
        extras["pins"] = json!(clip.pins);
    }
    if let Some(fabric) = clip.fabric(0) {
        extras["fabric"] = json!(fabric);
    }
    extras
}

impl Film {
    /// Begun over what is there already.
    pub fn over(clip: &Clip, (root, mut bin): (Root, Bin)) -> Self {
        let n_frames = clip.drape.frames.len();
        let rate = if clip.drape.fps > 0.0 {
            clip.drape.fps
        } else {
            30.0
        };
        let times: Vec<f32> = (0..n_frames).map(|i| (i as f64 / rate) as f32).collect();
        let shape = json!({ "type": "SCALAR", "componentType": 5126, "min": [0.0], "max": [times[n_frames - 1]] });
        let times = bin.keys(times.iter().map(|&t| [t]), shape);
        Self {
            bin,
            root,
            channels: Vec::new(),
            samplers: Vec::new(),
            skins: Vec::new(),
            top: Vec::new(),
            free: Vec::new(),
            times,
            n_frames,
        }
    }

    /// Adds a channel whose values are the accessor `output`.
    pub(super) fn channel(&mut self, node: usize, path: &str, output: usize) {
        self.samplers
            .push(json!({ "input": self.times, "output": output, "interpolation": "LINEAR" }));
        self.channels.push(json!({
            "sampler": self.samplers.len() - 1,
            "target": { "node": node, "path": path },
        }));
    }

    pub fn places(&mut self, node: usize, places: &[DVec3]) {
        self.triples((node, "translation"), places);
    }

    pub fn scales(&mut self, node: usize, scales: &[DVec3]) {
        self.triples((node, "scale"), scales);
    }

    fn triples(&mut self, (node, path): (usize, &str), values: &[DVec3]) {
        let values = values.iter().map(|p| p.as_vec3().to_array());
        let output = self
            .bin
            .keys(values, json!({ "type": "VEC3", "componentType": 5126 }));
        self.channel(node, path, output);
    }

    pub fn turns(&mut self, node: usize, turns: &[DQuat]) {
        let values = turns.iter().map(|q| DVec4::from(*q).as_vec4().to_array());
        let output = self
            .bin
            .keys(values, json!({ "type": "VEC4", "componentType": 5126 }));
        self.channel(node, "rotation", output);
    }

    /// Weights that let target `k` stand alone in the frame `owners[k]`, and none elsewhere.
    pub fn weights(&mut self, node: usize, owners: &[usize]) {
        if owners.is_empty() {
            return;
        }
        let mut bytes = vec![0u8; self.n_frames * owners.len()];
        for (k, &frame) in owners.iter().enumerate() {
            bytes[frame * owners.len() + k] = 255;
        }
        let count = bytes.len();
        let view = self.bin.blob(&bytes);
        let shape = json!({ "type": "SCALAR", "componentType": 5121, "normalized": true });
        let output = self.bin.accessor((view, count), shape);
        self.channel(node, "weights", output);
    }

    /// All garments of the clip, in order.
    pub fn garments(&mut self, clip: &Clip, garments: &[Moved]) -> Result<(), IoError> {
        let parts = clip.garments();
        if parts.len() != garments.len() {
            let what = "one node a garment is needed";
            return Err(Fault::new("bad-scene", "the scene to write", what).invalid());
        }
        let ways = garments.iter().zip(&parts);
        let ways: Vec<Way> = ways.map(|(moved, part)| Way::of(moved, &part.1)).collect();
        let tracks: Option<Vec<&Track>> = ways.iter().map(Way::track).collect();
        let tight = match tracks {
            Some(tracks) => tight(clip, &parts, &tracks),
            None => vec![false; self.n_frames],
        };
        for ((moved, (_, part)), way) in garments.iter().zip(&parts).zip(&ways) {
            fits(moved, part.n_verts())?;
            match way {
                Way::Baked(baked) => {
                    goes(baked, part)?;
                    self.baked(moved, part, baked);
                }
                Way::Tracked(track) => self.garment(moved, part, (track, &tight)),
            }
        }
        Ok(())
    }

    /// A garment along its track, in single floats in the frames that are tight.
    fn garment(&mut self, moved: &Moved, clip: &Clip, (track, tight): (&Track, &[bool])) {
        let frames = &clip.drape.frames;
        let options = GlbOptions::default();
        let mut node = moved.node.clone();
        node.mesh.verts = moved
            .source
            .iter()
            .map(|&i| track.local(0, frames[0][i as usize]))
            .collect();
        let normals = |t: usize| {
            smooth(
                &clip.drape.faces,
                &frames[t],
                moved,
                track.turns[t].inverse(),
            )
        };
        node.normals = normals(0);
        let material = self.root.material(&mut self.bin, &node);
        let cells = |t: usize| -> Vec<[i16; 3]> {
            moved
                .source
                .iter()
                .map(|&i| track.cell(t, frames[t][i as usize]))
                .collect()
        };
        let base = cells(0);
        let mut primitive = self.surface(&node, material, &options);
        primitive["attributes"]["POSITION"] = self.bin.cells(&base, true).into();
        primitive["attributes"]["_SOURCE"] = self.sources(&moved.source);
        let targets: Vec<Value> = (1..self.n_frames)
            .map(|t| {
                let moves = match tight[t] {
                    true => {
                        let exact = |(&i, b): (&u32, &[i16; 3])| {
                            track.in_cells(t, frames[t][i as usize]) - whole(*b)
                        };
                        let moves: Vec<DVec3> = moved.source.iter().zip(&base).map(exact).collect();
                        self.bin.positions(&moves)
                    }
                    false => {
                        let moves: Vec<[i16; 3]> = cells(t)
                            .iter()
                            .zip(&base)
                            .map(|(a, b)| std::array::from_fn(|k| a[k] - b[k]))
                            .collect();
                        self.bin.cells(&moves, true)
                    }
                };
                let bends: Vec<[i8; 3]> = normals(t)
                    .iter()
                    .zip(&node.normals)
                    .map(|(n, b)| bend(*n, *b))
                    .collect();
                json!({ "POSITION": moves, "NORMAL": self.bin.bytes(&bends) })
            })
            .collect();
        let mut extras = told(clip);
        if !clip.corners.is_empty() {
            let corners: Vec<u8> = clip
                .corners
                .as_flattened()
                .iter()
                .flat_map(|c| c.as_vec2().to_array())
                .flat_map(f32::to_le_bytes)
                .collect();
            extras["rest_corners"] = json!({ "bufferView": self.bin.blob(&corners) });
        }
        let mut mesh = json!({ "name": node.name, "primitives": [primitive], "extras": extras });
        if !targets.is_empty() {
            mesh["weights"] = vec![0.0; targets.len()].into();
            mesh["primitives"][0]["targets"] = targets.into();
        }
        self.root.meshes.push(mesh);
        let step = track.step;
        let mut value = json!({ "name": node.name, "mesh": self.root.meshes.len() - 1, "scale": [step, step, step] });
        value["translation"] = json!(track.middles[0].as_vec3().to_array());
        with_extras(&mut value, &node);
        let index = self.root.nodes.len();
        self.root.nodes.push(value);
        self.top.push(index);
        if self.n_frames > 1 {
            self.places(index, &track.middles);
            self.turns(index, &track.turns);
            self.weights(index, &(1..self.n_frames).collect::<Vec<_>>());
        }
    }

    /// Normals, texture coordinates and triangles of a node; positions are left to the caller.
    pub(super) fn surface(&mut self, node: &Node, material: usize, options: &GlbOptions) -> Value {
        debug_assert!(options.quantised);
        let mut attributes = json!({ "NORMAL": self.bin.short_normals(&node.normals) });
        if !node.uvs.is_empty() {
            attributes["TEXCOORD_0"] = self.bin.uvs(&node.uvs).into();
        }
        let indices = self.bin.indices(&node.mesh.faces, node.mesh.verts.len());
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }

    /// Which vertex of the frames each vertex is; single floats count exactly to 16 million.
    pub(super) fn sources(&mut self, source: &[u32]) -> Value {
        let values = source.iter().map(|&i| [i as f32]);
        self.bin
            .attribute(values, json!({ "type": "SCALAR", "componentType": 5126 }))
            .into()
    }

    fn body(
        &mut self,
        moved: &Moved,
        skin: &Skinned,
        frames: &[Vec<DVec3>],
        exact: bool,
    ) -> Result<(), IoError> {
        let place = |what: &str| Err(Fault::new("bad-scene", "the body to write", what).invalid());
        let (n, n_bones) = (frames[0].len(), skin.rig.n_bones());
        if skin.rest.len() < n || skin.bones.len() != frames.len() || skin.heads.len() != n_bones {
            return place("bones, rest pose and frames do not go together");
        }
        if n_bones > 255 {
            return place("more than 255 bones");
        }
        let mut node = moved.node.clone();
        let pick = |verts: &[DVec3]| -> Vec<DVec3> {
            moved.source.iter().map(|&i| verts[i as usize]).collect()
        };
        node.mesh.verts = pick(skin.rest);
        let normals = muslin_geom::vertex_normals(&skin.rest[..n], &merged(moved));
        node.normals = pick(&normals);
        let material = self.root.material(&mut self.bin, &node);
        let mut primitive = self.surface(&node, material, &GlbOptions::default());
        primitive["attributes"]["POSITION"] = self.bin.positions(&node.mesh.verts).into();
        primitive["attributes"]["_SOURCE"] = self.sources(&moved.source);
        let rows: Vec<&[(u32, f64)]> = moved
            .source
            .iter()
            .map(|&i| skin.rig.weights.row(i as usize))
            .collect();
        if rows.iter().any(|r| r.len() > 4) {
            return place("a vertex follows more than four bones");
        }
        let (joints, weights) = match exact {
            true => {
                let joint =
                    |r: &&[(u32, f64)]| std::array::from_fn(|k| r.get(k).map_or(0, |w| w.0 as u8));
                let joints = self.bin.joints(rows.iter().map(joint));
                let shape = json!({ "type": "VEC4", "componentType": 5126 });
                let weights = rows.iter().map(|r| shares(r));
                (joints, self.bin.attribute(weights, shape))
            }
            false => {
                let rows: Vec<_> = rows.iter().map(|r| shorts(r)).collect();
                let joints = self.bin.joints(rows.iter().map(|r| r.0));
                (joints, self.bin.short_weights(rows.iter().map(|r| r.1)))
            }
        };
        primitive["attributes"]["JOINTS_0"] = joints.into();
        primitive["attributes"]["WEIGHTS_0"] = weights.into();
        let (owners, targets) = match exact {
            true => self.corrections(moved, skin, frames),
            false => Default::default(),
        };
        let mut mesh = json!({ "name": node.name, "primitives": [primitive] });
        if !targets.is_empty() {
            mesh["weights"] = vec![0.0; targets.len()].into();
            mesh["primitives"][0]["targets"] = targets.into();
        }
        self.root.meshes.push(mesh);
        let index = self.root.nodes.len();
        let mesh = self.root.meshes.len() - 1;
        let mut value = json!({ "name": node.name, "mesh": mesh, "skin": 0 });
        with_extras(&mut value, &node);
        self.root.nodes.push(value);
        self.top.push(index);
        self.weights(index, &owners);
        self.bones(skin);
        Ok(())
    }

    /// Frames whose body is not where its bones take it, and the sparse targets that mend it.
    fn corrections(
        &mut self,
        moved: &Moved,
        skin: &Skinned,
        frames: &[Vec<DVec3>],
    ) -> (Vec<usize>, Vec<Value>) {
        let (mut owners, mut targets) = (Vec::new(), Vec::new());
        for (t, frame) in frames.iter().enumerate() {
            let blends: Vec<DAffine3> = (0..frame.len())
                .map(|i| blended(skin.rig.weights.row(i), &skin.bones[t]))
                .collect();
            let off = |i: usize| {
                let gap = frame[i] - blends[i].transform_point3(skin.rest[i]);
                (gap.length() > EXACT).then(|| blends[i].matrix3.inverse() * gap)
            };
            let list: Vec<(u32, DVec3)> = moved
                .source
                .iter()
                .enumerate()
                .filter_map(|(k, &i)| off(i as usize).map(|d| (k as u32, d)))
                .collect();
            if !list.is_empty() {
                owners.push(t);
                targets.push(json!({ "POSITION": self.bin.sparse(&list, moved.source.len()) }));
            }
        }
        (owners, targets)
    }

    /// The joints below the body's node list, their skin and their tracks.
    fn bones(&mut self, skin: &Skinned) {
        let first = self.root.nodes.len();
        let bones = &skin.rig.bones;
        let local = |t: usize, b: usize| {
            let world = |b: usize| skin.bones[t][b] * DAffine3::from_translation(skin.heads[b]);
            match bones[b].parent {
                Some(p) => world(p).inverse() * world(b),
                None => world(b),
            }
        };
        for (b, bone) in bones.iter().enumerate() {
            let place = local(0, b).translation.as_vec3().to_array();
            let mut node = json!({ "name": bone.name, "translation": place });
            let children: Vec<usize> = (0..bones.len())
                .filter(|&c| bones[c].parent == Some(b))
                .map(|c| first + c)
                .collect();
            if !children.is_empty() {
                node["children"] = children.into();
            }
            self.root.nodes.push(node);
        }
        self.top.push(first);
        let back = skin.heads.iter().map(|h| {
            let [x, y, z] = (-*h).as_vec3().to_array();
            [
                1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0f32,
            ]
        });
        let inverse = self
            .bin
            .keys(back, json!({ "type": "MAT4", "componentType": 5126 }));
        let joints: Vec<usize> = (first..first + bones.len()).collect();
        self.skins
            .push(json!({ "inverseBindMatrices": inverse, "joints": joints, "skeleton": first }));
        for b in 0..bones.len() {
            let tracks: Vec<DAffine3> = (0..self.n_frames).map(|t| local(t, b)).collect();
            let turns = tracks
                .iter()
                .map(|a| DQuat::from_mat3(&a.matrix3).normalize());
            let turns = same_way(turns.collect());
            let places: Vec<DVec3> = tracks.iter().map(|a| a.translation).collect();
            if places.iter().any(|p| p.distance(places[0]) > 1e-7) {
                self.places(first + b, &places);
            }
            self.turns(first + b, &turns);
        }
    }

    fn finish(self, scene: &Scene) -> Result<Vec<u8>, IoError> {
        let bare = Scene {
            name: scene.name.clone(),
            copyright: scene.copyright.clone(),
            nodes: Vec::new(),
        };
        let mut json = self.root.finish(&bare, &self.bin, &GlbOptions::default());
        json["scenes"][0]["nodes"] = [self.top, self.free].concat().into();
        if !self.skins.is_empty() {
            json["skins"] = self.skins.into();
        }
        if !self.channels.is_empty() {
            json["animations"] = json!([{ "name": bare.name, "channels": self.channels, "samplers": self.samplers }]);
        }
        sealed(&json, &self.bin)
    }

    /// The whole file over another's JSON, whose first `own` nodes are not ours.
    pub fn into_glb(self, base: Value, (name, own): (&str, usize)) -> Result<Vec<u8>, IoError> {
        let wrapper = self.root.nodes.len() - 1;
        let mut json = self.root.over_finish(base, &self.bin);
        if !json["asset"]["extras"].is_object() {
            json["asset"]["extras"] = json!({});
        }
        json["asset"]["extras"]["muslin"] = json!({ "character_nodes": own, "wrapper": wrapper });
        let scene = super::buffer::int(&json["scene"]).unwrap_or(0);
        let shown = json.pointer_mut(&format!("/scenes/{scene}/nodes"));
        match shown.and_then(Value::as_array_mut) {
            Some(nodes) => {
                nodes.push(wrapper.into());
                nodes.extend(self.free.iter().map(|i| Value::from(*i)));
            }
            None => {
                let nodes = json["nodes"].as_array().map_or(&[][..], Vec::as_slice);
                let children = nodes.iter().filter_map(|n| n["children"].as_array());
                let below: Vec<&Value> = children.flatten().collect();
                let tops = (0..nodes.len()).filter(|i| !below.contains(&&Value::from(*i)));
                let tops: Vec<usize> = tops.collect();
                json["scenes"] = json!([{ "nodes": tops }]);
                json["scene"] = 0.into();
            }
        }
        if !self.skins.is_empty() {
            json["skins"] = self.skins.into();
        }
        if !self.channels.is_empty() {
            json["animations"] =
                json!([{ "name": name, "channels": self.channels, "samplers": self.samplers }]);
        }
        sealed(&json, &self.bin)
    }
}

/// Turns of which none goes the long way round from the one before.
pub(super) fn same_way(mut turns: Vec<DQuat>) -> Vec<DQuat> {
    for t in 1..turns.len() {
        if turns[t].dot(turns[t - 1]) < 0.0 {
            turns[t] = -turns[t];
        }
    }
    turns
}

fn sealed(json: &Value, bin: &Bin) -> Result<Vec<u8>, IoError> {
    if bin.bytes.len() > 0xf000_0000 {
        let fault = Fault::new("glb-large", "the animation to write", "too large for a GLB");
        return Err(fault
            .allowed("3.75 GiB")
            .hint("write --npz or --pc2, or fewer frames")
            .refused());
    }
    Ok(container(&json.to_string(), &bin.bytes))
}

pub(super) fn with_extras(value: &mut Value, node: &Node) {
    let extras = super::uv_extras(node);
    if !extras.is_null() {
        value["extras"] = extras;
    }
}

/// Smooth normals of a frame, turned, for the node's vertices; seams stay smooth.
fn smooth(faces: &[[u32; 3]], frame: &[DVec3], moved: &Moved, turn: DQuat) -> Vec<DVec3> {
    let normals = muslin_geom::vertex_normals(frame, faces);
    let unit = |&i: &u32| {
        (turn * normals[i as usize])
            .try_normalize()
            .unwrap_or(DVec3::Y)
    };
    moved.source.iter().map(unit).collect()
}

/// The node's triangles over the frames' vertices.
fn merged(moved: &Moved) -> Vec<[u32; 3]> {
    let faces = moved.node.mesh.faces.iter();
    faces.map(|f| f.map(|i| moved.source[i as usize])).collect()
}

/// What added to the unit normal `base` points along `n`, in 127ths: as long as 8 bits allow.
fn bend(n: DVec3, base: DVec3) -> [i8; 3] {
    // Only the direction of the sum counts, so it may be shorter than one.
    let room = |n: f64, b: f64| match n > 0.0 {
        true => (1.0 + b) / n,
        false => (1.0 - b) / -n,
    };
    let pairs = n.to_array().into_iter().zip(base.to_array());
    let length = pairs
        .filter(|(n, _)| n.abs() > 1e-9)
        .map(|(n, b)| room(n, b))
        .fold(1.0, f64::min);
    let d = n * length.clamp(0.1, 1.0) - base;
    d.to_array()
        .map(|c| (c.clamp(-1.0, 1.0) * 127.0).round() as i8)
}

/// Four weights that sum to one in single precision.
fn shares(row: &[(u32, f64)]) -> [f32; 4] {
    let mut w: [f32; 4] = std::array::from_fn(|k| row.get(k).map_or(0.0, |w| w.1 as f32));
    let rest = w[1] + w[2] + w[3];
    w[0] = 1.0 - rest;
    w
}
