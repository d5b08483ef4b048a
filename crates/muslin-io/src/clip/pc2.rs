//! PC2: the point cache that Blender, 3ds Max, Maya and Houdini play; topology in an OBJ beside it.
//!
//! 32 bytes of header (`POINTCACHE2\0`, version 1, points, first frame, frames a sample, samples),
//! then `float32` positions frame by frame, all little-endian. The format has no rate, no names and
//! no triangles: comments in the OBJ tell the rate, the layer, the pins and the fabric, and that its texture coordinates are
//! the pattern's own metres.

use std::fmt::Write;
use std::path::Path;

use glam::{DVec2, DVec3};
use muslin_geom::{Drape, Mesh, Part};

use super::{Clip, RATE};
use crate::error::{Fault, IoError, Place, name};
use crate::input::{files_in, read_file};
use crate::obj::obj;
use crate::scene::{Node, Scene, shared_corners};

const MAGIC: &[u8; 12] = b"POINTCACHE2\0";
const HEADER: usize = 32;
const MAX_BYTES: u64 = 4 << 30;
const MAX_OBJ: u64 = 256 << 20;
/// Says that texture coordinates are places in the pattern [m]: other people's are anything.
const PATTERN: &str = "pattern in metres";
/// Pins in one comment.
const PINS_A_LINE: usize = 16;

/// The bytes of a `.pc2` file; all frames must have the same number of points.
pub fn write_pc2(frames: &[Vec<DVec3>]) -> Vec<u8> {
    let n = frames.first().map_or(0, Vec::len);
    let mut out = MAGIC.to_vec();
    out.extend(1i32.to_le_bytes());
    out.extend((n as i32).to_le_bytes());
    out.extend(0f32.to_le_bytes());
    out.extend(1f32.to_le_bytes());
    out.extend((frames.len() as i32).to_le_bytes());
    out.reserve(frames.len() * n * 12);
    for x in frames.iter().flatten() {
        x.as_vec3()
            .to_array()
            .iter()
            .for_each(|c| out.extend(c.to_le_bytes()));
    }
    out
}

/// The frames of a `.pc2` file; `name` is what errors call it.
pub fn read_pc2(name: &str, bytes: &[u8]) -> Result<Vec<Vec<DVec3>>, IoError> {
    let fault = |at: u64, what: &str| {
        let fault = Fault::new("pc2", name, what).at(Place::Byte(at));
        fault.hint("write the point cache again").invalid()
    };
    if bytes.get(..12) != Some(MAGIC) {
        return Err(fault(0, "not a point cache (POINTCACHE2)"));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|b| [b[0], b[1], b[2], b[3]]);
    let count = |at: usize| {
        let n = word(at).map(i32::from_le_bytes).filter(|&n| n > 0);
        n.map(|n| n as usize)
            .ok_or_else(|| fault(at as u64, "no positive count"))
    };
    let (n, frames) = (count(16)?, count(28)?);
    let want = n.checked_mul(12).and_then(|w| w.checked_mul(frames));
    let body = want.and_then(|w| bytes.get(HEADER..HEADER.checked_add(w)?));
    let body = body.ok_or_else(|| fault(bytes.len() as u64, "cut short"))?;
    let point = |b: &[u8; 12]| {
        let c = |k: usize| f64::from(f32::from_le_bytes([b[k], b[k + 1], b[k + 2], b[k + 3]]));
        DVec3::new(c(0), c(4), c(8))
    };
    let points: Vec<DVec3> = body.as_chunks::<12>().0.iter().map(point).collect();
    Ok(points.chunks(n).map(<[DVec3]>::to_vec).collect())
}

/// See [`Clip::pc2_files`].
pub fn files(clip: &Clip) -> Result<Vec<(String, Vec<u8>)>, IoError> {
    let mut out = Vec::new();
    for (layer, (name, one)) in clip.garments().into_iter().enumerate() {
        let mut head = format!("# fps {}\n# layer {layer}\n", clip.drape.fps);
        for pins in one.pins.chunks(PINS_A_LINE) {
            let pins: Vec<String> = pins.iter().map(|i| (i + 1).to_string()).collect();
            head.push_str(&format!("# pins {}\n", pins.join(" ")));
        }
        if let Some(fabric) = one.fabric(0) {
            head.push_str(&format!("# fabric {fabric}\n"));
        }
        if !one.corners.is_empty() {
            head.push_str(&format!("# {PATTERN}\n"));
        }
        let verts = match one.rest.is_empty() {
            true => one.drape.frames[0].clone(),
            false => one.rest,
        };
        let faces = one.drape.faces;
        out.push((format!("{name}.pc2"), write_pc2(&one.drape.frames)));
        out.push((
            format!("{name}.obj"),
            topology(&name, (Mesh { verts, faces }, &one.corners), &head)?,
        ));
    }
    if let Some(first) = clip.body.first() {
        let mesh = Mesh {
            verts: first.clone(),
            faces: clip.body_faces.clone(),
        };
        out.push(("body.pc2".into(), write_pc2(&clip.body)));
        out.push((
            "body.obj".into(),
            topology("body", (mesh, &[]), &format!("# fps {}\n", clip.drape.fps))?,
        ));
    }
    Ok(out)
}

/// An OBJ; `corners`: of every face in its pattern [m], or none.
fn topology(
    name: &str,
    (mesh, corners): (Mesh, &[[DVec2; 3]]),
    head: &str,
) -> Result<Vec<u8>, IoError> {
    let pattern = pattern(&mesh.faces, corners);
    let node = Node {
        name: name.into(),
        mesh,
        ..Node::default()
    };
    let scene = Scene {
        nodes: vec![node],
        ..Scene::default()
    };
    let text = obj(&scene)?;
    // Where a seam doubles a vertex in the pattern, it is one in space.
    let plain = text
        .lines()
        .filter(|l| pattern.is_empty() || !l.starts_with("f "));
    let plain: Vec<&str> = plain.collect();
    Ok(format!("{head}{}\n{pattern}", plain.join("\n")).into_bytes())
}

/// Texture coordinates and faces that use them.
fn pattern(faces: &[[u32; 3]], corners: &[[DVec2; 3]]) -> String {
    let (used, places) = shared_corners(faces, corners);
    let mut text = String::new();
    for p in places {
        writeln!(text, "vt {:.8} {:.8}", p.x, p.y).expect("a string takes all");
    }
    for (face, used) in faces.iter().zip(used) {
        let each = [0, 1, 2].map(|k| {
            let (v, t) = (face[k] + 1, used[k] + 1);
            format!("{v}/{t}/{v}")
        });
        writeln!(text, "f {}", each.join(" ")).expect("a string takes all");
    }
    text
}

/// What an OBJ beside a point cache tells.
struct Beside {
    mesh: Mesh,
    fps: Option<f64>,
    layer: f64,
    /// Of every face in its pattern [m], if that is told.
    corners: Vec<[DVec2; 3]>,
    /// Counted from 1, as in faces.
    pins: Vec<u32>,
    fabric: String,
}

/// Reads the point cache at `path`, or all of a folder; `body.pc2` is the body.
pub fn read(path: &Path) -> Result<Clip, IoError> {
    let folder = match path.is_dir() {
        true => path,
        false => path.parent().unwrap_or(Path::new("")),
    };
    let mut garments = Vec::new();
    let mut fps = None;
    for stem in stems(path, folder)? {
        let (frames, beside) = one(&folder.join(format!("{stem}.pc2")))?;
        fps = fps.or(beside.fps);
        garments.push((beside.layer, garment(stem, frames, beside)));
    }
    garments.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut clip = Clip::joined(garments.into_iter().map(|g| g.1).collect())?;
    let body = folder.join("body.pc2");
    if body.is_file() {
        let (frames, beside) = one(&body)?;
        fps = fps.or(beside.fps);
        (clip.body, clip.body_faces) = (frames, beside.mesh.faces);
    }
    clip.rate_unknown = fps.is_none();
    clip.drape.fps = fps.unwrap_or(RATE);
    Ok(clip)
}

/// Names, without ending, of the garments' caches.
fn stems(path: &Path, folder: &Path) -> Result<Vec<String>, IoError> {
    if !path.is_dir() {
        return Ok(vec![super::stem(path)]);
    }
    let caches = files_in(folder, &["pc2"])?;
    let mut stems: Vec<String> = caches.iter().map(|p| super::stem(p)).collect();
    stems.retain(|s| s != "body");
    if stems.is_empty() {
        let fault = Fault::new(
            "not-animated",
            name(folder),
            "neither point caches (.pc2) nor .npz in this folder",
        );
        return Err(fault
            .hint("name a folder that `muslin simulate --pc2` wrote, or one with the .npz of --npz")
            .invalid());
    }
    Ok(stems)
}

/// A cache and the OBJ beside it.
fn one(path: &Path) -> Result<(Vec<Vec<DVec3>>, Beside), IoError> {
    let input = read_file(path, MAX_BYTES)?;
    let frames = read_pc2(&input.file, &input.bytes)?;
    let beside = read_file(&path.with_extension("obj"), MAX_OBJ)?;
    let text = String::from_utf8_lossy(&beside.bytes);
    let beside = beside_from(&beside.file, &text)?;
    if beside.mesh.verts.len() != frames[0].len() {
        let fault = Fault::new("pc2", input.file, "the OBJ beside it is of another mesh");
        return Err(fault
            .found(format!("{} points", frames[0].len()))
            .allowed(format!("{} vertices", beside.mesh.verts.len()))
            .invalid());
    }
    Ok((frames, beside))
}

fn garment(name: String, frames: Vec<Vec<DVec3>>, beside: Beside) -> Clip {
    let mesh = beside.mesh;
    let known = !beside.fabric.is_empty();
    let part = Part {
        name,
        verts: 0..mesh.verts.len(),
        faces: 0..mesh.faces.len(),
    };
    Clip {
        drape: Drape {
            parts: vec![part],
            faces: mesh.faces,
            frames,
            fps: RATE,
        },
        rest: mesh.verts,
        corners: beside.corners,
        pins: beside.pins.iter().map(|i| i - 1).collect(),
        fabrics: known.then_some(beside.fabric).into_iter().collect(),
        ..Clip::default()
    }
}

/// Positions and triangles of an OBJ, and what our comments in it tell; polygons become fans.
fn beside_from(file: &str, text: &str) -> Result<Beside, IoError> {
    let mut out = Beside {
        mesh: Mesh::default(),
        fps: None,
        layer: 0.0,
        corners: Vec::new(),
        pins: Vec::new(),
        fabric: String::new(),
    };
    let (mut is_pattern, mut places) = (false, Vec::new());
    for (i, line) in text.lines().enumerate() {
        let fault = |what: &str| {
            Fault::new("obj", file, what)
                .at(Place::Line(i + 1))
                .invalid()
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |k: usize| words.get(k).and_then(|w| w.parse::<f64>().ok());
        match words.as_slice() {
            ["#", "fps", ..] => out.fps = number(2).filter(|&f| f > 0.0 && f.is_finite()),
            ["#", "layer", ..] => out.layer = number(2).unwrap_or(0.0),
            ["#", "fabric", name @ ..] => out.fabric = name.join(" "),
            ["#", "pins", pins @ ..] => {
                let pins = pins.iter().map(|p| p.parse().ok().filter(|&i| i > 0));
                let pins: Option<Vec<u32>> = pins.collect();
                out.pins
                    .extend(pins.ok_or_else(|| fault("a pin that is no vertex"))?);
            }
            ["#", words @ ..] if words.join(" ") == PATTERN => is_pattern = true,
            ["vt", ..] if is_pattern => {
                let p = number(1).zip(number(2));
                let (x, y) = p.ok_or_else(|| fault("a texture coordinate without two numbers"))?;
                places.push(DVec2::new(x, y));
            }
            ["v", ..] => {
                let v = number(1).zip(number(2)).zip(number(3));
                let ((x, y), z) = v.ok_or_else(|| fault("a vertex without three numbers"))?;
                out.mesh.verts.push(DVec3::new(x, y, z));
            }
            ["f", corners @ ..] => {
                if let (true, [a, b, c]) = (is_pattern, corners) {
                    let place = |w: &str| {
                        Some(places[corner(w.split('/').nth(1)?, places.len())? as usize])
                    };
                    let all = place(a).zip(place(b)).zip(place(c));
                    let ((a, b), c) =
                        all.ok_or_else(|| fault("a corner without its place in the pattern"))?;
                    out.corners.push([a, b, c]);
                }
                let n = out.mesh.verts.len();
                let corners: Option<Vec<u32>> = corners.iter().map(|c| corner(c, n)).collect();
                let corners = corners.ok_or_else(|| fault("a corner that is no vertex"))?;
                let fan = corners.windows(2).skip(1).map(|w| [corners[0], w[0], w[1]]);
                out.mesh.faces.extend(fan);
            }
            _ => {}
        }
    }
    Ok(out)
}

/// The vertex of a corner such as `7/1/3` or `-1`, counted from zero.
fn corner(word: &str, n: usize) -> Option<u32> {
    let index: i64 = word.split('/').next()?.parse().ok()?;
    let index = if index < 0 {
        n as i64 + index
    } else {
        index - 1
    };
    u32::try_from(index).ok().filter(|&i| (i as usize) < n)
}
