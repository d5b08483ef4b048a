//! Moving GLB back in: what a viewer would show at each key of the animation.
//!
//! The first animation is played at the keys of its longest track; of several as long, of the one
//! that ends last. The node called `body` is the body; every other mesh is a garment.

use std::collections::BTreeMap;
use std::iter::successors;

use glam::{DAffine3, DMat4, DQuat, DVec2, DVec3, DVec4};
use muslin_body::blended;
use muslin_geom::{Drape, Part};
use serde_json::Value;

use super::buffer::{Glb, int};
use crate::clip::Clip;
use crate::error::IoError;

/// More positions in all frames together are refused.
const MAX_POINTS: usize = 1 << 28;
/// More joints are refused.
pub(super) const MAX_JOINTS: usize = 4096;
/// Longer animations are refused [s].
const MAX_SECONDS: f64 = 36_000.0;
/// More frames of an animation are refused.
const MAX_FRAMES: usize = 1 << 20;
/// Animations that need more memory are refused [bytes].
const MAX_PLAYED: usize = 8 << 30;
/// Nodes below more others are refused.
const MAX_DEPTH: usize = 1024;

/// The animation of a `.glb`; `name` is what errors call it. A still has one frame.
pub fn read_moving(name: &str, bytes: &[u8]) -> Result<Clip, IoError> {
    let glb = Glb::new(name, bytes)?;
    let stage = Stage::playing(&glb, 0)?;
    let (mut garments, mut body) = (Vec::new(), None);
    // A character's own nodes are no garments, and ours are in metres below a node that is not.
    let dressed = &glb.json["asset"]["extras"]["muslin"];
    let own = int(&dressed["character_nodes"]).unwrap_or(0);
    let mut stage = stage;
    if let Some(wrapper) = int(&dressed["wrapper"]) {
        let below = stage.parents.iter_mut().filter(|p| **p == Some(wrapper));
        below.for_each(|p| *p = None);
    }
    let mut points = 0usize;
    for (i, node) in glb.list("nodes").iter().enumerate() {
        if node["mesh"].is_null() || i < own {
            continue;
        }
        let actor = Actor::new(&glb, i)?;
        for node in actor.joints.iter().chain([&i]) {
            stage.check_depth(&glb, *node)?;
        }
        points = points.saturating_add(actor.places.len().saturating_mul(stage.times.len()));
        if points > MAX_POINTS {
            let what = "too many positions in all frames";
            return Err(glb.large(&format!("/nodes/{i}"), what, MAX_POINTS));
        }
        let frames = stage.play(&actor);
        match node["name"].as_str() {
            Some("body") => body = Some((frames, actor.faces)),
            _ => garments.push(garment(&glb, (node, actor), frames, stage.fps())?),
        }
    }
    if garments.is_empty() {
        return Err(glb.fault("/nodes", "no mesh besides the body"));
    }
    let mut clip = Clip::joined(garments)?;
    if let Some((frames, faces)) = body {
        (clip.body, clip.body_faces) = (frames, faces);
    }
    Ok(clip)
}

fn garment(
    glb: &Glb,
    (node, actor): (&Value, Actor),
    frames: Vec<Vec<DVec3>>,
    fps: f64,
) -> Result<Clip, IoError> {
    let mesh = &glb.list("meshes")[int(&node["mesh"]).unwrap_or(0)];
    let extras = &mesh["extras"];
    let rest = &extras["rest_corners"]["bufferView"];
    let corners = glb.view(rest).map(|(bytes, _)| {
        let float = |b: &[u8; 4]| f64::from(f32::from_le_bytes(*b));
        let floats: Vec<f64> = bytes.as_chunks::<4>().0.iter().map(float).collect();
        let corners: Vec<DVec2> = floats
            .as_chunks::<2>()
            .0
            .iter()
            .map(|c| DVec2::from_array(*c))
            .collect();
        corners.as_chunks::<3>().0.to_vec()
    });
    let corners = corners
        .filter(|c| c.len() == actor.faces.len())
        .unwrap_or_default();
    let part = Part {
        name: node["name"].as_str().unwrap_or("cloth").into(),
        verts: 0..frames[0].len(),
        faces: 0..actor.faces.len(),
    };
    // Somebody else's extras may be anything.
    let pin = |p: &Value| int(p).filter(|p| part.verts.contains(p));
    let pins = extras["pins"].as_array().into_iter().flatten();
    let fabric = extras["fabric"].as_str();
    Ok(Clip {
        pins: pins.filter_map(pin).map(|p| p as u32).collect(),
        fabrics: fabric.map(str::to_owned).into_iter().collect(),
        drape: Drape {
            parts: vec![part],
            faces: actor.faces,
            frames,
            fps,
        },
        corners,
        ..Clip::default()
    })
}

/// A track of a node: values at keys.
struct Track {
    times: Vec<f64>,
    values: Vec<f64>,
    width: usize,
    law: Law,
}

/// What is between keys (glTF 2.0, appendix C).
#[derive(Clone, Copy)]
enum Law {
    Step,
    Linear,
    /// Linear, but along the shorter arc of turns.
    Arc,
    /// At each key the slope before it, the value, and the slope after it.
    Cubic,
}

impl Law {
    /// Rows of values that each key has.
    fn rows(self) -> usize {
        match self {
            Law::Cubic => 3,
            _ => 1,
        }
    }
}

impl Track {
    /// The values at a time; cubic turns are made unit by the caller.
    fn at(&self, time: f64) -> Vec<f64> {
        let last = self.times.len() - 1;
        let each = self.law.rows();
        let part = |i: usize, k: usize| {
            let start = (i * each + k) * self.width;
            &self.values[start..start + self.width]
        };
        let row = |i: usize| part(i, each / 2);
        let next = self.times.partition_point(|&t| t <= time);
        if next == 0 || next > last {
            return row(next.min(last)).to_vec();
        }
        let (before, span) = (next - 1, self.times[next] - self.times[next - 1]);
        let t = (time - self.times[before]) / span;
        let pairs = row(before).iter().zip(row(next));
        let law = if t == 0.0 { Law::Step } else { self.law };
        match law {
            Law::Step => row(before).to_vec(),
            Law::Linear => pairs.map(|(x, y)| x + (y - x) * t).collect(),
            Law::Arc => {
                let turn = |i: usize| DQuat::from_slice(row(i)).normalize();
                turn(before).slerp(turn(next), t).to_array().to_vec()
            }
            Law::Cubic => {
                let (t2, t3) = (t * t, t * t * t);
                let slopes = part(before, 2).iter().zip(part(next, 0));
                let value = |((x, y), (out, into)): ((&f64, &f64), (&f64, &f64))| {
                    (2.0 * t3 - 3.0 * t2 + 1.0) * x
                        + (3.0 * t2 - 2.0 * t3) * y
                        + span * ((t3 - 2.0 * t2 + t) * out + (t3 - t2) * into)
                };
                pairs.zip(slopes).map(value).collect()
            }
        }
    }
}

/// Nodes and their tracks.
pub(super) struct Stage<'a> {
    nodes: &'a [Value],
    pub(super) parents: Vec<Option<usize>>,
    tracks: BTreeMap<(usize, String), Track>,
    times: Vec<f64>,
}

impl<'a> Stage<'a> {
    /// As the file stands.
    pub(super) fn still(glb: &'a Glb) -> Result<Self, IoError> {
        let nodes = glb.list("nodes");
        let mut parents = vec![None; nodes.len()];
        for (i, node) in nodes.iter().enumerate() {
            for child in node["children"].as_array().into_iter().flatten() {
                let slot = int(child).and_then(|c| parents.get_mut(c));
                *slot.ok_or_else(|| {
                    glb.fault(&format!("/nodes/{i}"), "a child that is no node")
                })? = Some(i);
            }
        }
        Ok(Self {
            nodes,
            parents,
            tracks: BTreeMap::new(),
            times: vec![0.0],
        })
    }

    /// Animation number `clip`, if there is one.
    pub(super) fn playing(glb: &'a Glb, clip: usize) -> Result<Self, IoError> {
        let mut stage = Self::still(glb)?;
        if let Some(animation) = glb.list("animations").get(clip) {
            for channel in animation["channels"].as_array().into_iter().flatten() {
                stage.track(glb, (animation, clip), channel)?;
            }
        }
        let keys = stage.tracks.values().map(|t| &t.times);
        let end = |t: &[f64]| t.last().copied().unwrap_or(0.0);
        let longest = keys.max_by(|a, b| {
            let by_end = end(a).total_cmp(&end(b));
            a.len().cmp(&b.len()).then(by_end)
        });
        if let Some(longest) = longest {
            stage.times = longest.clone();
        }
        Ok(stage)
    }

    fn track(
        &mut self,
        glb: &Glb,
        (animation, clip): (&Value, usize),
        channel: &Value,
    ) -> Result<(), IoError> {
        let fault = |what: &str| glb.fault(&format!("/animations/{clip}"), what);
        let sampler = int(&channel["sampler"]).and_then(|s| animation["samplers"].get(s));
        let sampler = sampler.ok_or_else(|| fault("a channel without a sampler"))?;
        let kind = sampler["interpolation"].as_str().unwrap_or("LINEAR");
        let times = glb.numbers(&sampler["input"])?.flat;
        let values = glb.numbers(&sampler["output"])?.flat;
        let is_growing = times.windows(2).all(|w| w[0] < w[1]);
        let target = int(&channel["target"]["node"]).filter(|&n| n < self.nodes.len());
        let path = channel["target"]["path"].as_str();
        let (Some(node), Some(path)) = (target, path) else {
            return Ok(());
        };
        let law = match (kind, path) {
            ("STEP", _) => Law::Step,
            ("CUBICSPLINE", _) => Law::Cubic,
            (_, "rotation") => Law::Arc,
            _ => Law::Linear,
        };
        let rows = law.rows() * times.len();
        let width = values.len().checked_div(rows).unwrap_or(0);
        let fits = match path {
            "rotation" => width == 4,
            "translation" | "scale" => width == 3,
            _ => width > 0,
        };
        if !is_growing || !fits || width * rows != values.len() {
            return Err(fault("a track whose keys and values do not go together"));
        }
        let track = Track {
            times,
            values,
            width,
            law,
        };
        self.tracks.insert((node, path.to_owned()), track);
        Ok(())
    }

    /// The time of the last key of all tracks [s].
    pub(super) fn end(&self) -> f64 {
        let lasts = self.tracks.values().filter_map(|t| t.times.last());
        lasts.copied().fold(0.0, f64::max)
    }

    /// How many frames animation number `clip` has at this rate, for so many joints.
    ///
    /// Refuses more than ten hours, 2²⁰ frames or 8 GiB.
    pub(super) fn frames(
        &self,
        glb: &Glb,
        (clip, fps): (usize, f64),
        joints: usize,
    ) -> Result<usize, IoError> {
        let (pointer, end) = (format!("/animations/{clip}"), self.end());
        if end > MAX_SECONDS {
            return Err(glb.large(&pointer, "it is too long", format!("{MAX_SECONDS} s")));
        }
        // Times are single floats: an end that is a frame's is there but for their rounding.
        let frames = ((end * fps * (1.0 + 1e-6)).floor() as usize).saturating_add(1);
        let most = MAX_PLAYED / (joints * size_of::<DAffine3>());
        let most = most.min(MAX_FRAMES);
        match frames <= most {
            true => Ok(frames),
            false => Err(glb.large(&pointer, "it has too many frames", most)),
        }
    }

    /// Keys a second.
    fn fps(&self) -> f64 {
        let n = self.times.len();
        let span = self.times[n - 1] - self.times[0];
        // Times are single floats; rates are whole or nearly so.
        let rate = (n - 1) as f64 / span;
        match (n > 1 && span > 0.0, (rate - rate.round()).abs() < 1e-3) {
            (true, true) => rate.round(),
            (true, false) => rate,
            _ => 30.0,
        }
    }

    /// A property of a node at a time: from its track, or as the node says, or the default.
    fn value(&self, node: usize, path: &str, time: f64, or: &[f64]) -> Vec<f64> {
        if let Some(track) = self.tracks.get(&(node, path.to_owned())) {
            return track.at(time);
        }
        let said = self.nodes[node][path].as_array().map(|list| {
            let numbers = list.iter().map(|v| v.as_f64().unwrap_or(0.0));
            numbers.collect::<Vec<f64>>()
        });
        said.filter(|v| v.len() == or.len() || path == "weights")
            .unwrap_or_else(|| or.to_vec())
    }

    pub(super) fn local(&self, node: usize, time: f64) -> DAffine3 {
        if let Some(m) = self.nodes[node]["matrix"]
            .as_array()
            .filter(|m| m.len() == 16)
        {
            let m: Vec<f64> = m.iter().map(|v| v.as_f64().unwrap_or(0.0)).collect();
            return DAffine3::from_mat4(DMat4::from_cols_slice(&m));
        }
        let scale = DVec3::from_slice(&self.value(node, "scale", time, &[1.0; 3]));
        let turn = DVec4::from_slice(&self.value(node, "rotation", time, &[0.0, 0.0, 0.0, 1.0]));
        let turn = DQuat::from_vec4(turn.normalize_or(DVec4::W));
        let place = DVec3::from_slice(&self.value(node, "translation", time, &[0.0; 3]));
        DAffine3::from_scale_rotation_translation(scale, turn, place)
    }

    /// The nodes above one, the nearest first.
    pub(super) fn above(&self, node: usize) -> impl Iterator<Item = usize> {
        successors(self.parents[node], |p| self.parents[*p])
    }

    /// Refuses a node that hangs too deep, or from itself.
    pub(super) fn check_depth(&self, glb: &Glb, node: usize) -> Result<(), IoError> {
        if self.above(node).nth(MAX_DEPTH).is_none() {
            return Ok(());
        }
        match self.above(node).nth(self.parents.len()) {
            Some(_) => Err(glb.fault("/nodes", "nodes that are their own ancestors")),
            None => {
                let what = "a node below too many others";
                Err(glb.large(&format!("/nodes/{node}"), what, MAX_DEPTH))
            }
        }
    }

    /// `world_from_node` of a node whose depth was checked.
    pub(super) fn world(&self, node: usize, time: f64) -> DAffine3 {
        let above = self.above(node).take(MAX_DEPTH);
        above.fold(self.local(node, time), |world, parent| {
            self.local(parent, time) * world
        })
    }

    /// The actor's vertices at every key [m].
    fn play(&self, actor: &Actor) -> Vec<Vec<DVec3>> {
        self.times
            .iter()
            .map(|&time| self.frame(actor, time))
            .collect()
    }

    fn frame(&self, actor: &Actor, time: f64) -> Vec<DVec3> {
        let mut x = actor.places.clone();
        let weights = self.value(actor.node, "weights", time, &actor.weights);
        for (target, &weight) in actor.targets.iter().zip(&weights).filter(|p| *p.1 != 0.0) {
            x.iter_mut()
                .zip(target)
                .for_each(|(x, d)| *x += *d * weight);
        }
        if actor.joints.is_empty() {
            let world = self.world(actor.node, time);
            return x.iter().map(|&x| world.transform_point3(x)).collect();
        }
        let bone = |(&joint, back): (&usize, &DAffine3)| self.world(joint, time) * *back;
        let bones: Vec<DAffine3> = actor.joints.iter().zip(&actor.back).map(bone).collect();
        let rows = actor.rows.iter();
        x.iter()
            .zip(rows)
            .map(|(&x, row)| blended(row, &bones).transform_point3(x))
            .collect()
    }
}

/// A mesh node, its doubled vertices merged.
struct Actor {
    node: usize,
    faces: Vec<[u32; 3]>,
    places: Vec<DVec3>,
    /// Empty where one moves nothing.
    targets: Vec<Vec<DVec3>>,
    weights: Vec<f64>,
    joints: Vec<usize>,
    back: Vec<DAffine3>,
    rows: Vec<[(u32, f64); 4]>,
}

impl Actor {
    fn new(glb: &Glb, node: usize) -> Result<Self, IoError> {
        let pointer = format!("/nodes/{node}");
        let fault = |what: &str| glb.fault(&pointer, what);
        let value = &glb.list("nodes")[node];
        let mesh = int(&value["mesh"]).and_then(|m| glb.list("meshes").get(m));
        let mesh = mesh.ok_or_else(|| fault("no such mesh"))?;
        let parts = mesh["primitives"].as_array().map_or(&[][..], Vec::as_slice);
        let [part] = parts else {
            return Err(fault("a mesh of several primitives; join them"));
        };
        let attributes = &part["attributes"];
        let targets = part["targets"].as_array().map_or(&[][..], Vec::as_slice);
        let asked = targets.iter().chain([attributes]);
        let asked = asked.map(|a| glb.count(&a["POSITION"]));
        let asked = asked.fold(0, usize::saturating_add);
        glb.has_room(&pointer, asked.saturating_mul(3))?;
        let all = glb.points(&pointer, &attributes["POSITION"])?;
        let source: Vec<usize> = match &attributes["_SOURCE"] {
            Value::Null => (0..all.len()).collect(),
            index => glb
                .numbers(index)?
                .flat
                .iter()
                .map(|&s| s as usize)
                .collect(),
        };
        if source.len() != all.len() {
            return Err(fault("its _SOURCE is not its vertices'"));
        }
        let (keep, place) = firsts(&source);
        let pick = |list: Vec<DVec3>| -> Option<Vec<DVec3>> {
            keep.iter().map(|&i| list.get(i).copied()).collect()
        };
        let corners = glb.numbers(&part["indices"])?.flat;
        let corner = |&i: &f64| place.get(i as usize).copied();
        let corners: Option<Vec<u32>> = corners.iter().map(corner).collect();
        let corners = corners.ok_or_else(|| fault("a triangle has a corner that is no vertex"))?;
        let moves = |target: &Value| match &target["POSITION"] {
            Value::Null => Ok(Vec::new()),
            index => pick(glb.points(&pointer, index)?)
                .ok_or_else(|| fault("a morph target that is too short")),
        };
        let targets: Vec<Vec<DVec3>> = targets.iter().map(moves).collect::<Result<_, _>>()?;
        let weights = mesh["weights"]
            .as_array()
            .map_or(vec![0.0; targets.len()], |w| {
                w.iter().map(|v| v.as_f64().unwrap_or(0.0)).collect()
            });
        let mut actor = Self {
            node,
            faces: corners.as_chunks::<3>().0.to_vec(),
            places: pick(all).ok_or_else(|| fault("no vertices"))?,
            targets,
            weights,
            joints: Vec::new(),
            back: Vec::new(),
            rows: Vec::new(),
        };
        if !value["skin"].is_null() {
            actor.dress(glb, (value, attributes), &keep)?;
        }
        Ok(actor)
    }

    /// Reads the skin.
    fn dress(
        &mut self,
        glb: &Glb,
        (node, attributes): (&Value, &Value),
        keep: &[usize],
    ) -> Result<(), IoError> {
        let fault = || glb.fault("/skins", "a skin that does not go with its mesh");
        let skin = int(&node["skin"])
            .and_then(|s| glb.list("skins").get(s))
            .ok_or_else(fault)?;
        let joints = skin["joints"].as_array().ok_or_else(fault)?;
        if joints.len() > MAX_JOINTS {
            return Err(glb.large("/skins", "too many joints", MAX_JOINTS));
        }
        let n_nodes = glb.list("nodes").len();
        let joint = |j: &Value| int(j).filter(|&j| j < n_nodes);
        let joints: Option<Vec<usize>> = joints.iter().map(joint).collect();
        self.joints = joints.ok_or_else(fault)?;
        self.back = match &skin["inverseBindMatrices"] {
            Value::Null => vec![DAffine3::IDENTITY; self.joints.len()],
            index => {
                let flat = glb.numbers(index)?.flat;
                flat.as_chunks::<16>().0.iter().map(matrix).collect()
            }
        };
        let (bones, shares) = (
            glb.numbers(&attributes["JOINTS_0"])?.flat,
            glb.numbers(&attributes["WEIGHTS_0"])?.flat,
        );
        let n = self.joints.len();
        let row = |&i: &usize| -> Option<[(u32, f64); 4]> {
            let (b, w) = (bones.get(4 * i..4 * i + 4)?, shares.get(4 * i..4 * i + 4)?);
            b.iter()
                .all(|&b| (b as usize) < n)
                .then(|| std::array::from_fn(|k| (b[k] as u32, w[k])))
        };
        let rows: Option<Vec<_>> = keep.iter().map(row).collect();
        self.rows = rows.filter(|_| self.back.len() == n).ok_or_else(fault)?;
        Ok(())
    }
}

/// An affine map of its sixteen numbers, column by column.
pub(super) fn matrix(m: &[f64; 16]) -> DAffine3 {
    DAffine3::from_mat4(DMat4::from_cols_array(m))
}

/// For each source that there is, in order, the first vertex that is a copy of it; and for each vertex
/// the place of its source in that order.
fn firsts(source: &[usize]) -> (Vec<usize>, Vec<u32>) {
    let mut order: Vec<usize> = (0..source.len()).collect();
    order.sort_by_key(|i| source[*i]);
    let (mut first, mut place) = (Vec::new(), vec![0; source.len()]);
    for (k, i) in order.iter().enumerate() {
        if k == 0 || source[order[k - 1]] != source[*i] {
            first.push(*i);
        }
        place[*i] = first.len() as u32 - 1;
    }
    (first, place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_take_the_shorter_way_and_cubic_tracks_are_cubic() {
        // The same turn is told by two quaternions: the second key has the other sign.
        let quarter = DQuat::from_rotation_y(1.0);
        let turns = Track {
            times: vec![0.0, 2.0],
            values: [DQuat::IDENTITY.to_array(), (-quarter).to_array()].concat(),
            width: 4,
            law: Law::Arc,
        };
        let half = DQuat::from_slice(&turns.at(0.5));
        assert!(half.angle_between(DQuat::from_rotation_y(0.25)) < 1e-7);
        // A cubic's own slopes give it back: t³ − 2t² + 1 at 1 and 3, in two rows.
        let (value, slope) = (
            |t: f64| t * t * t - 2.0 * t * t + 1.0,
            |t: f64| 3.0 * t * t - 4.0 * t,
        );
        let key = |t: f64| [0.0, slope(t), 0.0, value(t), 0.0, slope(t)];
        let track = Track {
            times: vec![1.0, 3.0],
            values: [key(1.0), key(3.0)].concat(),
            width: 2,
            law: Law::Cubic,
        };
        for t in [0.0, 1.0, 1.3, 2.0, 2.9, 3.0, 4.0] {
            let at = track.at(t);
            let want = value(t.clamp(1.0, 3.0));
            assert!(
                at[0] == 0.0 && (at[1] - want).abs() < 1e-12,
                "{t}: {at:?} {want}"
            );
        }
        let plain = [Law::Step, Law::Linear].map(|law| Track {
            times: vec![1.0, 3.0],
            values: vec![4.0, 8.0],
            width: 1,
            law,
        });
        assert_eq!(plain.map(|t| t.at(2.5)[0]), [4.0, 7.0]);
    }
}
