//! Motion in from a glTF file: the nodes that an animation moves, as a skeleton that was recorded.
//!
//! Neither skin nor mesh is needed, so that files of animations alone (`.vrma` among them) are motions as well as whole
//! characters. Where a VRM says which node is which bone of a human, that is what it is called.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};
use muslin_body::retarget::{Frame, Recording, Skeleton};
use serde_json::Value;

use super::buffer::{Glb, int};
use super::character::{called, clips, is_garment};
use super::pack;
use super::play::{MAX_JOINTS, Stage};
use crate::error::{Fault, IoError};
use crate::input::Input;

/// An animation of a glTF file.
#[derive(Clone, Debug)]
pub struct Animation {
    /// What moves, in the file's unit.
    pub recording: Recording,
    /// The names of all animations of the file; those without one are called by their number, from 1.
    pub clips: Vec<String>,
}

/// Reads the animation called `clip` of a `.glb`, `.vrm`, `.vrma` or `.gltf`, by its name or number, or the first; `fps`
/// times a second. `path`: where the file is, for what lies beside a `.gltf`.
///
/// Fails where there is no such animation, or where it moves no node.
pub fn read_animation(
    path: &Path,
    input: &Input,
    (clip, fps): (Option<&str>, f64),
) -> Result<Animation, IoError> {
    let glb = pack::open(path, input)?;
    let clips = clips(&glb);
    let number = chosen(&glb, &clips, clip)?;
    let still = Stage::still(&glb)?;
    let nodes = moved(&glb, &still, number)?;
    let stage = Stage::playing(&glb, number)?;
    let count = stage.frames(&glb, (number, fps), nodes.len())?;
    let parents: Vec<Option<usize>> = nodes.iter().map(|n| above(&still, &nodes, *n)).collect();
    let worlds = |stage: &Stage, time: f64| -> Vec<DAffine3> {
        nodes.iter().map(|n| stage.world(*n, time)).collect()
    };
    let rest = worlds(&still, 0.0);
    let moment = |worlds: &[DAffine3]| frame((worlds, &rest), &parents);
    let names = names(&glb);
    Ok(Animation {
        recording: Recording {
            skeleton: Skeleton {
                names: nodes.iter().map(|n| names[*n].clone()).collect(),
                offsets: moment(&rest).translations,
                ends: vec![None; nodes.len()],
                parents: parents.clone(),
            },
            fps,
            frames: (0..count)
                .map(|k| moment(&worlds(&stage, k as f64 / fps)))
                .collect(),
        },
        clips,
    })
}

/// Which animation is meant.
fn chosen(glb: &Glb, clips: &[String], clip: Option<&str>) -> Result<usize, IoError> {
    if clips.is_empty() {
        return Err(glb.fault("/animations", "no animation: nothing moves"));
    }
    let Some(name) = clip else { return Ok(0) };
    called(clips, name).ok_or_else(|| {
        let fault = Fault::new(
            "no-animation",
            glb.file(),
            "it has no animation of that name",
        );
        fault.found(name).allowed(clips.join(", ")).invalid()
    })
}

/// The nodes that an animation turns or takes somewhere, those that are joints of a skin or bones of a human, and all
/// above them, parents first: of several trees the one with most of them. Where a file says of no node what it is, those
/// that hang from what moves are joints that stand still.
fn moved(glb: &Glb, still: &Stage, clip: usize) -> Result<Vec<usize>, IoError> {
    let nodes = glb.list("nodes");
    let channels = glb.list("animations")[clip]["channels"].as_array();
    let channels = channels.into_iter().flatten().map(|c| &c["target"]);
    let turned = channels
        .filter(|t| t["path"] != "weights")
        .map(|t| &t["node"]);
    let skins = glb.list("skins").iter();
    let joints = skins.flat_map(|s| s["joints"].as_array().into_iter().flatten());
    let human = bones(glb);
    let all = turned.chain(joints).chain(human.iter().map(|b| b.1));
    let all = all.filter_map(int);
    let [mut is_moved, mut is_turned] = [(); 2].map(|()| vec![false; nodes.len()]);
    for node in all.filter(|n| *n < nodes.len() && !hangs_below_ours(still, nodes, *n)) {
        still.check_depth(glb, node)?;
        (is_moved[node], is_turned[node]) = (true, true);
        still.above(node).for_each(|n| is_moved[n] = true);
    }
    if glb.list("skins").is_empty() && human.is_empty() {
        for node in 0..nodes.len() {
            let shows = ["mesh", "camera"].iter().any(|k| !nodes[node][k].is_null());
            let hangs = || still.above(node).take(nodes.len()).any(|n| is_turned[n]);
            if !shows && hangs() && !hangs_below_ours(still, nodes, node) {
                still.check_depth(glb, node)?;
                is_moved[node] = true;
            }
        }
    }
    let mut all: Vec<usize> = (0..nodes.len()).filter(|n| is_moved[*n]).collect();
    // What is looked at, cameras and faces move beside the one who moves.
    let top = |n: &usize| still.above(*n).last().unwrap_or(*n);
    let mut trees: BTreeMap<usize, usize> = BTreeMap::new();
    all.iter()
        .for_each(|n| *trees.entry(top(n)).or_default() += 1);
    let whole = trees
        .into_iter()
        .max_by_key(|(top, many)| (*many, Reverse(*top)));
    all.retain(|n| whole.is_some_and(|w| w.0 == top(n)));
    all.sort_by_key(|n| (still.above(*n).count(), *n));
    let pointer = format!("/animations/{clip}");
    match all.len() {
        0 => Err(glb.fault(&pointer, "it moves no node")),
        1..=MAX_JOINTS => Ok(all),
        _ => Err(glb.large(&pointer, "it moves too many nodes", MAX_JOINTS)),
    }
}

/// Whether a node is a garment's that we have written, or below one.
fn hangs_below_ours(still: &Stage, nodes: &[Value], node: usize) -> bool {
    let mut way = still.above(node).take(nodes.len()).chain([node]);
    way.any(|n| is_garment(&nodes[n]))
}

/// Which of `nodes` a node hangs from.
fn above(still: &Stage, nodes: &[usize], node: usize) -> Option<usize> {
    let parent = still.above(node).next()?;
    nodes.iter().position(|n| *n == parent)
}

/// Places and turns in the frames of the parents, all of which are the world's at `rest`, as recordings have them; what
/// grows is left out, so that all lengths are the file's.
fn frame((worlds, rest): (&[DAffine3], &[DAffine3]), parents: &[Option<usize>]) -> Frame {
    let turn = |w: &DAffine3| w.to_scale_rotation_translation().1;
    let pairs = worlds.iter().zip(rest);
    let turns: Vec<DQuat> = pairs.map(|(w, r)| turn(w) * turn(r).inverse()).collect();
    let local = |(j, parent): (usize, &Option<usize>)| match parent {
        None => (worlds[j].translation, turns[j]),
        Some(p) => {
            let (back, way) = (
                turns[*p].inverse(),
                worlds[j].translation - worlds[*p].translation,
            );
            (back * way, back * turns[j])
        }
    };
    let (translations, rotations): (Vec<DVec3>, Vec<DQuat>) =
        parents.iter().enumerate().map(local).unzip();
    Frame {
        translations,
        rotations,
    }
}

/// What every node is called: as the bone of a human that a VRM says it is, else as it calls itself.
fn names(glb: &Glb) -> Vec<String> {
    let own = |n: &Value| n["name"].as_str().unwrap_or("").to_owned();
    let mut all: Vec<String> = glb.list("nodes").iter().map(own).collect();
    for (bone, node) in bones(glb) {
        if let Some(slot) = int(node).and_then(|n| all.get_mut(n)) {
            bone.clone_into(slot);
        }
    }
    all
}

/// The bones of a human that a VRM or its animation names, and their nodes.
fn bones<'g>(glb: &'g Glb) -> Vec<(&'g str, &'g Value)> {
    let said = &glb.json["extensions"];
    let mut all = Vec::new();
    for kind in ["VRMC_vrm_animation", "VRMC_vrm", "VRM"] {
        match &said[kind]["humanoid"]["humanBones"] {
            Value::Object(bones) => all.extend(bones.iter().map(|(b, v)| (b.as_str(), &v["node"]))),
            Value::Array(bones) => {
                let named = bones
                    .iter()
                    .filter_map(|v| Some((v["bone"].as_str()?, &v["node"])));
                all.extend(named);
            }
            _ => {}
        }
    }
    all
}
