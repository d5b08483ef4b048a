//! `cargo xtask check gltf [FILE...]`: our GLB files before other people's eyes.
//!
//! The Khronos validator (npm `gltf-validator`) must find no error and no warning, and trimesh
//! must load the same number of vertices and triangles within the same bounds. Both are installed
//! into a throw-away folder. Without files, samples of all that the writer can do are checked.

use crate::{Outcome, python};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const VALIDATOR: &str = "gltf-validator@2.0.0-dev.3.10";
const READER: [&str; 3] = ["trimesh==5.2.0", "numpy>=2,<3", "pillow"];

/// What trimesh's bounds may be off, as a share of the thing's size: it reckons in 32 bits.
const ALLOWED: f64 = 1e-6;

/// Checks the files, or fresh samples if there are none.
pub fn run(args: &[&str]) -> Outcome {
    let folder = std::env::temp_dir().join("muslin-xtask").join("check-gltf");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let files = match args {
        [] => samples(&folder.join("samples"))?,
        files => files.iter().map(|f| f.to_string()).collect(),
    };
    let validated = lines(&validate(&folder, &files)?)?;
    let loaded = lines(&load(&folder, &files)?)?;
    if validated.len() != files.len() || loaded.len() != files.len() {
        return Err("a checker passed over a file".into());
    }
    let mut n_bad = 0;
    for ((file, verdict), seen) in files.iter().zip(&validated).zip(&loaded) {
        let faults = [warned(verdict), differences(file, seen)?].concat();
        n_bad += usize::from(!faults.is_empty());
        println!("{}", summary(file, verdict, seen));
        for line in strings(&verdict["messages"]).chain(faults) {
            println!("  {line}");
        }
    }
    match n_bad {
        0 => Ok(()),
        n => Err(format!("{n} of {} files are not clean", files.len())),
    }
}

/// Lets the writer's own tests write a sample of each kind.
fn samples(folder: &Path) -> Result<Vec<String>, String> {
    // What a run before has left is nobody's any more.
    let _ = std::fs::remove_dir_all(folder);
    let mut cargo = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    cargo.args([
        "test",
        "-q",
        "-p",
        "muslin-io",
        "--test",
        "models",
        "--test",
        "moving",
        "files_for",
    ]);
    output(cargo.env("MUSLIN_GLTF_SAMPLES", folder))?;
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let path = |e: std::fs::DirEntry| e.path().display().to_string();
    let mut files: Vec<String> = entries.flatten().map(path).collect();
    files.retain(|f| f.ends_with(".glb"));
    files.sort();
    match files.is_empty() {
        true => Err("the tests that write samples wrote none".into()),
        false => Ok(files),
    }
}

/// What the validator says, a line a file.
fn validate(folder: &Path, files: &[String]) -> Result<String, String> {
    let words = ["install", "--silent", "--no-fund", "--no-audit", "--prefix"];
    output(Command::new("npm").args(words).arg(folder).arg(VALIDATOR))?;
    let mut node = Command::new("node");
    node.env("NODE_PATH", folder.join("node_modules"));
    output(node.arg("xtask/js/gltf_validate.js").args(files))
}

/// What trimesh sees, a line a file.
fn load(folder: &Path, files: &[String]) -> Result<String, String> {
    let python = python::environment(&folder.join("venv"), &READER)?;
    output(
        Command::new(&python)
            .arg("xtask/python/gltf_reader.py")
            .args(files),
    )
}

/// Runs a program and returns what it prints.
fn output(command: &mut Command) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let done = command.output().map_err(|e| format!("{program}: {e}"))?;
    if done.status.success() {
        return Ok(String::from_utf8_lossy(&done.stdout).into_owned());
    }
    let why = String::from_utf8_lossy(&done.stderr).into_owned();
    Err(format!("{program}: {}\n{why}", done.status))
}

fn lines(text: &str) -> Result<Vec<Value>, String> {
    let parse = |line| serde_json::from_str(line).map_err(|e| format!("{line}: {e}"));
    text.lines().map(parse).collect()
}

/// The validator's errors and warnings, as a fault.
fn warned(verdict: &Value) -> Vec<String> {
    match (&verdict["errors"], &verdict["warnings"]) {
        (e, w) if *e == 0 && *w == 0 => Vec::new(),
        (e, w) => vec![format!(
            "FAULT: the validator finds {e} errors and {w} warnings"
        )],
    }
}

/// Where what trimesh loaded differs from what the file says of itself.
fn differences(file: &str, seen: &Value) -> Result<Vec<String>, String> {
    let json = json_chunk(file)?;
    let nodes = json["nodes"].as_array().cloned().unwrap_or_default();
    let mut faults = Vec::new();
    // Bones have no mesh to compare.
    for node in nodes.iter().filter(|n| !n["mesh"].is_null()) {
        let name = node["name"].as_str().unwrap_or_default();
        let (want, got) = (
            Extent::claimed(&json, node),
            Extent::seen(&seen["nodes"][name]),
        );
        if !got
            .as_ref()
            .is_some_and(|got| want.as_ref().is_some_and(|want| want.is(got)))
        {
            faults.push(format!(
                "FAULT: node {name} is {want:?} but trimesh sees {got:?}"
            ));
        }
    }
    Ok(faults)
}

/// Size and place of a node in the world.
#[derive(Debug)]
struct Extent {
    verts: u64,
    faces: u64,
    min: [f64; 3],
    max: [f64; 3],
}

impl Extent {
    /// From the file's own JSON.
    fn claimed(json: &Value, node: &Value) -> Option<Self> {
        let at = |list: &str, i: &Value| json[list].get(i.as_u64()? as usize);
        let primitive = &at("meshes", &node["mesh"])?["primitives"][0];
        let position = at("accessors", &primitive["attributes"]["POSITION"])?;
        let indices = at("accessors", &primitive["indices"])?;
        let place = |v: [f64; 3]| {
            let scale = vec3(&node["scale"]).unwrap_or([1.0; 3]);
            let origin = vec3(&node["translation"]).unwrap_or_default();
            std::array::from_fn(|k| origin[k] + scale[k] * v[k])
        };
        Some(Self {
            verts: position["count"].as_u64()?,
            faces: indices["count"].as_u64()? / 3,
            min: place(vec3(&position["min"])?),
            max: place(vec3(&position["max"])?),
        })
    }

    /// From the independent reader.
    fn seen(node: &Value) -> Option<Self> {
        Some(Self {
            verts: node["verts"].as_u64()?,
            faces: node["faces"].as_u64()?,
            min: vec3(&node["min"])?,
            max: vec3(&node["max"])?,
        })
    }

    fn is(&self, other: &Self) -> bool {
        let size = (0..3).map(|k| self.max[k].abs().max(self.min[k].abs()));
        let allowed = ALLOWED * size.fold(0.0, f64::max);
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|k| (a[k] - b[k]).abs() <= allowed);
        (self.verts, self.faces) == (other.verts, other.faces)
            && near(self.min, other.min)
            && near(self.max, other.max)
    }
}

fn vec3(value: &Value) -> Option<[f64; 3]> {
    Some([value[0].as_f64()?, value[1].as_f64()?, value[2].as_f64()?])
}

/// The JSON chunk of a GLB.
fn json_chunk(file: &str) -> Result<Value, String> {
    let bytes = std::fs::read(file).map_err(|e| format!("{file}: {e}"))?;
    let length = bytes.get(12..16).and_then(|b| b.try_into().ok());
    let length = u32::from_le_bytes(length.ok_or("no header")?) as usize;
    let json = bytes.get(20..20 + length).ok_or("cut JSON")?;
    serde_json::from_slice(json).map_err(|e| format!("{file}: {e}"))
}

/// One line a file.
fn summary(file: &str, verdict: &Value, seen: &Value) -> String {
    let sum = |what: &str| {
        let nodes = seen["nodes"]
            .as_object()
            .into_iter()
            .flat_map(|o| o.values());
        nodes.filter_map(|n| n[what].as_u64()).sum::<u64>()
    };
    format!(
        "{file}: {} errors, {} warnings, {} infos; trimesh: {} vertices, {} triangles",
        verdict["errors"],
        verdict["warnings"],
        verdict["infos"],
        sum("verts"),
        sum("faces"),
    )
}

fn strings(list: &Value) -> impl Iterator<Item = String> {
    let list = list.as_array().into_iter().flatten();
    list.filter_map(|v| v.as_str().map(str::to_owned))
}
