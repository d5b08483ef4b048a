//! The reference: a Python program that answers commands.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use glam::{DVec2, DVec3};
use serde_json::Value;

use crate::python;

/// What the reference needs.
const PACKAGES: [&str; 3] = ["mediapipe==0.10.14", "ai-edge-litert", "pillow"];

/// The running program.
pub struct Reference {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

/// What the reference sees in a photo.
pub struct Seen {
    /// 33 points [px].
    pub points: Vec<DVec2>,
    /// 33 places [m]: right, down, away.
    pub world: Vec<DVec3>,
}

impl Reference {
    /// Starts the program with `python`, or in an environment made for it.
    pub fn start(python: Option<&str>) -> Result<Self, String> {
        let python = python.map_or_else(environment, |p| Ok(PathBuf::from(p)))?;
        let mut command = Command::new(&python);
        command
            .arg("xtask/python/pose_reference.py")
            .stderr(Stdio::null());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command
            .spawn()
            .map_err(|e| format!("{}: {e}", python.display()))?;
        let to = child.stdin.take().ok_or("no way to ask the reference")?;
        let from = child.stdout.take().ok_or("no way to hear the reference")?;
        Ok(Self {
            child,
            to,
            from: BufReader::new(from),
        })
    }

    fn ask(&mut self, question: &str) -> Result<Value, String> {
        let silent = |e: &dyn std::fmt::Display| format!("the reference fell silent: {e}");
        writeln!(self.to, "{question}").map_err(|e| silent(&e))?;
        let mut answer = String::new();
        self.from.read_line(&mut answer).map_err(|e| silent(&e))?;
        serde_json::from_str(&answer).map_err(|e| silent(&e))
    }

    /// The surest person of a photo.
    pub fn photo(&mut self, path: &Path) -> Result<Option<Seen>, String> {
        let answer = self.ask(&format!("photo {}", path.display()))?;
        if answer.is_null() {
            return Ok(None);
        }
        let rows = |key: &str| answer[key].as_array().cloned().unwrap_or_default();
        let point = |r: &Value| DVec2::new(number(&r[0]), number(&r[1]));
        let place = |r: &Value| DVec3::new(number(&r[0]), number(&r[1]), number(&r[2]));
        Ok(Some(Seen {
            points: rows("points").iter().map(point).collect(),
            world: rows("world").iter().map(place).collect(),
        }))
    }

    /// All outputs of a network for a made-up input.
    pub fn tensors(&mut self, model: &str, input: &str) -> Result<Vec<Vec<f64>>, String> {
        let answer = self.ask(&format!("tensor {model} {input}"))?;
        let outputs = answer.as_array().ok_or("the reference gave no tensors")?;
        let list = |o: &Value| o.as_array().map(|o| o.iter().map(number).collect());
        outputs
            .iter()
            .map(|o| list(o).ok_or("not a tensor".into()))
            .collect()
    }

    /// CPU milliseconds of one run of a network.
    pub fn time(&mut self, model: &str) -> Result<f64, String> {
        Ok(number(&self.ask(&format!("time {model}"))?))
    }
}

impl Drop for Reference {
    fn drop(&mut self) {
        // It waits for questions forever; nothing is lost.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// A throw-away virtual environment with the reference's packages.
fn environment() -> Result<PathBuf, String> {
    let home = std::env::temp_dir().join("muslin-xtask").join("check-pose");
    python::environment(&home, &PACKAGES)
}
