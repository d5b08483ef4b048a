//! What the tests of the commands share: the program itself, and folders that clean up.
#![allow(dead_code, reason = "each test file uses a part")]

use std::path::PathBuf;
use std::process::{Command, Output};

/// Runs the program.
pub fn muslin(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_muslin"))
        .args(args)
        .output()
        .expect("the program starts")
}

/// Runs the program with arguments as they are typed, none of which has a space in it.
pub fn typed(line: &str) -> Output {
    muslin(&line.split_whitespace().collect::<Vec<_>>())
}

/// What it said on the error stream.
pub fn errors(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// A folder of its own, removed in the end.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("muslin-test-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a temporary folder can be made");
        Self(path)
    }

    pub fn at(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }

    pub fn put(&self, name: &str, bytes: &[u8]) -> String {
        std::fs::write(self.0.join(name), bytes).expect("a temporary file can be written");
        self.at(name)
    }

    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).expect("the folder").flatten();
        let mut names: Vec<String> = entries
            .map(|e| e.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A tube of 24 sides as OBJ, as wide below and above as the two radii, open at both ends or closed at one or both.
pub fn tube((below, above): (f64, f64), height: f64, lids: usize) -> String {
    let (mut text, rows, sides) = (String::new(), 10, 24);
    for r in 0..rows {
        let share = f64::from(r) / f64::from(rows - 1);
        let radius = below + share * (above - below);
        for k in 0..sides {
            let t = f64::from(k) / f64::from(sides) * std::f64::consts::TAU;
            let [x, y, z] = [radius * t.sin(), height * share, radius * t.cos()];
            text += &format!("v {x} {y} {z}\n");
        }
    }
    // From the end, so that several tubes may stand in one file.
    let at = |r: i32, k: i32| sides * (r - rows) + k % sides;
    for r in 0..rows - 1 {
        for k in 0..sides {
            let [a, b] = [at(r, k), at(r, k + 1)];
            text += &format!("f {a} {b} {} {}\n", at(r + 1, k + 1), at(r + 1, k));
        }
    }
    for r in [0, rows - 1].into_iter().take(lids) {
        for k in 1..sides - 1 {
            let [b, c] = if r == 0 { [k + 1, k] } else { [k, k + 1] };
            text += &format!("f {} {} {}\n", at(r, 0), at(r, b), at(r, c));
        }
    }
    text
}
