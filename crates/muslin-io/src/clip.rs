//! Animated cloth and the body it hangs on, as files carry it: NPZ, PC2 with OBJ, and GLB.
//!
//! The NPZ layout is for exchange with other people's programs: `cloth` (T,V,3) and `body` (T,B,3)
//! as `float32` [m], `faces` (F,3) and `body_faces` as `int32`, `rest` (V,3) as `float32` [m],
//! `fps` as one `float64`. Cloth that was cut flat also has `rest_corners` (F,3,2) `float32` [m]:
//! each face's own corners in its pattern, which are its exact rest shape; `rest` is then near it
//! only. `pins` (P) as `int32` are vertices that the body holds, as at a waistband, and `fabric` (1)
//! is a word, the name of what the cloth is made of. Garments of one outfit are files of their own, each with its
//! `layer` (1) as `int32`, 0 next to the skin. What is not known is left out.

mod pc2;
mod several;

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use muslin_geom::{Drape, Part};

use crate::error::{Fault, IoError, Place, name};
use crate::input::{files_in, read_file};
use crate::npz::{self, Array, Npz, Values};

pub use pc2::{read_pc2, write_pc2};

/// Files with more bytes are refused.
const MAX_BYTES: u64 = 4 << 30;
/// Frames a second of files that tell none [1/s].
const RATE: f64 = 30.0;

/// A drape with the body that it was draped on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// The cloth.
    pub drape: Drape,
    /// The body's vertices [m], one list per frame of the cloth; empty if the body is not known.
    pub body: Vec<Vec<DVec3>>,
    /// The body's triangles.
    pub body_faces: Vec<[u32; 3]>,
    /// A shape of the cloth whose edges have (nearly) their rest lengths [m]; may be empty.
    pub rest: Vec<DVec3>,
    /// For cloth that was cut flat: each face's corners in its pattern [m]; may be empty.
    pub corners: Vec<[DVec2; 3]>,
    /// Vertices of the cloth that the body holds, as at a waistband.
    pub pins: Vec<u32>,
    /// For every garment the name of its fabric, empty where that is not known; may be empty as a whole.
    pub fabrics: Vec<String>,
    /// Whether the file told no frames a second, and [`Drape::fps`] is 30 for want of better.
    pub rate_unknown: bool,
}

impl Clip {
    /// Checks what writers and judges rely on: as many body frames as cloth frames, equal numbers
    /// of vertices in all frames, corners and pins that are vertices, a rest shape that is finite. Positions may be
    /// anything.
    pub fn check_shape(&self) -> Result<(), IoError> {
        let fault = |what: String| Err(Fault::new("bad-clip", "the animation", what).invalid());
        let (frames, n) = (&self.drape.frames, self.n_verts());
        let missing = [
            ("frames", frames.is_empty()),
            ("vertices", n == 0),
            ("triangles", self.drape.faces.is_empty()),
        ];
        if let Some((what, _)) = missing.iter().find(|m| m.1) {
            return fault(format!("no {what}"));
        }
        if let Some(i) = frames.iter().position(|f| f.len() != n) {
            return fault(format!(
                "frame {i} has {} vertices, frame 0 has {n}",
                frames[i].len()
            ));
        }
        let n_body = self.body.first().map_or(0, Vec::len);
        if !(self.body.is_empty() || self.body.len() == frames.len())
            || self.body.iter().any(|f| f.len() != n_body)
        {
            return fault("the body's frames do not go with the cloth's".into());
        }
        let inside =
            |faces: &[[u32; 3]], n: usize| faces.as_flattened().iter().all(|&i| (i as usize) < n);
        if !inside(&self.drape.faces, n) || !inside(&self.body_faces, n_body) {
            return fault("a triangle has a corner that is no vertex".into());
        }
        if self.pins.iter().any(|&i| i as usize >= n) {
            return fault("a pin is no vertex".into());
        }
        let fits = |len: usize, want: usize| len == 0 || len == want;
        if !fits(self.rest.len(), n) || !fits(self.corners.len(), self.drape.faces.len()) {
            return fault("the rest shape does not go with the cloth".into());
        }
        let known = self.corners.as_flattened().iter();
        if !self.rest.iter().all(|x| x.is_finite()) || !known.into_iter().all(|c| c.is_finite()) {
            return fault("the rest shape has a value that is not a finite number".into());
        }
        if !fits(self.fabrics.len(), self.drape.parts.len().max(1)) {
            return fault("there are not as many fabrics as garments".into());
        }
        match self.drape.fps > 0.0 && self.drape.fps.is_finite() || frames.len() == 1 {
            true => Ok(()),
            false => fault("frames per second are unknown".into()),
        }
    }

    /// As [`Clip::check_shape`], and every position is a finite number.
    pub fn check(&self) -> Result<(), IoError> {
        self.check_shape()?;
        for (what, frames) in [("cloth", &self.drape.frames), ("body", &self.body)] {
            let bad = |f: &Vec<DVec3>| !f.iter().all(|v| v.is_finite());
            if let Some(i) = frames.iter().position(bad) {
                let place = Place::Pointer(format!("/{what}/{i}"));
                let fault = Fault::new(
                    "bad-clip",
                    "the animation",
                    "a position is not a finite number",
                );
                return Err(fault.at(place).invalid());
            }
        }
        Ok(())
    }

    /// How many vertices the cloth has.
    pub fn n_verts(&self) -> usize {
        self.drape.frames.first().map_or(0, Vec::len)
    }

    /// Each garment on its own, with the body. Cloth without parts is one garment, `cloth`.
    pub fn garments(&self) -> Vec<(String, Clip)> {
        let whole = Part {
            name: "cloth".into(),
            verts: 0..self.n_verts(),
            faces: 0..self.drape.faces.len(),
        };
        let parts = match self.drape.parts.is_empty() {
            true => std::slice::from_ref(&whole),
            false => &self.drape.parts,
        };
        parts
            .iter()
            .enumerate()
            .map(|(k, p)| (p.name.clone(), self.part(k, p)))
            .collect()
    }

    fn part(&self, k: usize, part: &Part) -> Clip {
        let first = part.verts.start as u32;
        let faces = &self.drape.faces[part.faces.clone()];
        let cut = |list: &[DVec3]| list[part.verts.clone()].to_vec();
        let (n, f) = (part.verts.len(), part.faces.len());
        let alone = Part {
            name: part.name.clone(),
            verts: 0..n,
            faces: 0..f,
        };
        Clip {
            drape: Drape {
                parts: vec![alone],
                faces: faces.iter().map(|t| t.map(|i| i - first)).collect(),
                frames: self.drape.frames.iter().map(|x| cut(x)).collect(),
                fps: self.drape.fps,
            },
            body: self.body.clone(),
            body_faces: self.body_faces.clone(),
            rest: if self.rest.is_empty() {
                Vec::new()
            } else {
                cut(&self.rest)
            },
            corners: match self.corners.is_empty() {
                true => Vec::new(),
                false => self.corners[part.faces.clone()].to_vec(),
            },
            pins: (self.pins.iter())
                .filter(|&&i| part.verts.contains(&(i as usize)))
                .map(|i| i - first)
                .collect(),
            fabrics: self.fabric(k).map(str::to_owned).into_iter().collect(),
            rate_unknown: self.rate_unknown,
        }
    }

    /// The name of garment `k`'s fabric, if it is known.
    pub fn fabric(&self, k: usize) -> Option<&str> {
        let name = self.fabrics.get(k).map(String::as_str);
        name.filter(|f| !f.is_empty())
    }

    /// Every `n`-th frame, from the first, at the rate that keeps the time; `n` ≥ 1.
    pub fn every(&self, n: usize) -> Clip {
        let thin = |frames: &[Vec<DVec3>]| frames.iter().step_by(n.max(1)).cloned().collect();
        let mut out = Clip {
            drape: Drape {
                frames: Vec::new(),
                ..self.drape.clone()
            },
            body: Vec::new(),
            ..self.clone()
        };
        (out.drape.frames, out.body) = (thin(&self.drape.frames), thin(&self.body));
        out.drape.fps /= n.max(1) as f64;
        out
    }

    /// One clip of several: garments in layer order, innermost first, over one body.
    ///
    /// A rest shape is kept if all have it. Fails if frames or rates differ.
    pub fn joined(garments: Vec<Clip>) -> Result<Clip, IoError> {
        let named = garments.iter().any(|g| g.fabric(0).is_some());
        let fabric = |g: &Clip| g.fabric(0).unwrap_or_default().to_owned();
        let fabrics: Vec<String> = garments.iter().filter(|_| named).map(fabric).collect();
        let mut all = garments.into_iter();
        let Some(mut out) = all.next() else {
            return Err(Fault::new("bad-clip", "the animation", "no garment").invalid());
        };
        for one in all {
            let same =
                one.drape.frames.len() == out.drape.frames.len() && one.drape.fps == out.drape.fps;
            if !same {
                let fault = Fault::new("bad-clip", "the garments", "they differ in frames or rate");
                return Err(fault.invalid());
            }
            let (n, f) = (out.n_verts(), out.drape.faces.len());
            out.drape.parts.extend(one.drape.parts.iter().map(|p| Part {
                name: p.name.clone(),
                verts: n + p.verts.start..n + p.verts.end,
                faces: f + p.faces.start..f + p.faces.end,
            }));
            out.drape
                .faces
                .extend(one.drape.faces.iter().map(|t| t.map(|i| i + n as u32)));
            for (frame, more) in out.drape.frames.iter_mut().zip(&one.drape.frames) {
                frame.extend(more);
            }
            append(&mut out.rest, &one.rest);
            append(&mut out.corners, &one.corners);
            out.pins.extend(one.pins.iter().map(|i| i + n as u32));
        }
        out.fabrics = fabrics;
        Ok(out)
    }

    /// The bytes of an `.npz` in the exchange layout, all garments as one cloth.
    pub fn npz(&self) -> Result<Vec<u8>, IoError> {
        self.npz_of(None)
    }

    fn npz_of(&self, layer: Option<usize>) -> Result<Vec<u8>, IoError> {
        self.check()?;
        let (t, n) = (self.drape.frames.len(), self.n_verts());
        let mut arrays = vec![
            (
                "cloth",
                Array::f32(&[t, n, 3], flat(self.drape.frames.iter().flatten())),
            ),
            ("faces", triangles(&self.drape.faces)),
            ("fps", Array::number(self.drape.fps)),
        ];
        if let Some(first) = self.body.first() {
            arrays.push((
                "body",
                Array::f32(&[t, first.len(), 3], flat(self.body.iter().flatten())),
            ));
            arrays.push(("body_faces", triangles(&self.body_faces)));
        }
        if !self.rest.is_empty() {
            arrays.push(("rest", Array::f32(&[n, 3], flat(self.rest.iter()))));
        }
        if !self.corners.is_empty() {
            let corners = self.corners.as_flattened().iter();
            let corners = corners.flat_map(|c| c.as_vec2().to_array()).collect();
            let shape = [self.corners.len(), 3, 2];
            arrays.push(("rest_corners", Array::f32(&shape, corners)));
        }
        if !self.pins.is_empty() {
            let pins: Vec<i64> = self.pins.iter().map(|&i| i.into()).collect();
            arrays.push(("pins", Array::int(&[pins.len()], pins)));
        }
        if self.fabric(0).is_some() {
            arrays.push(("fabric", Array::text(self.fabrics.clone())));
        }
        if let Some(layer) = layer {
            arrays.push((several::LAYER, Array::int(&[1], vec![layer as i64])));
        }
        npz::write(&arrays)
    }

    /// Names and bytes of `.npz` files: `STEM.npz`, or with several garments `STEM.GARMENT.npz`
    /// each, all with the body.
    pub fn npz_files(&self, stem: &str) -> Result<Vec<(String, Vec<u8>)>, IoError> {
        let garments = self.garments();
        let alone = garments.len() == 1;
        let file = |(layer, (name, clip)): (usize, (String, Clip))| match alone {
            true => Ok((format!("{stem}.npz"), clip.npz()?)),
            false => Ok((format!("{stem}.{name}.npz"), clip.npz_of(Some(layer))?)),
        };
        garments.into_iter().enumerate().map(file).collect()
    }

    /// Names and bytes of point caches for other programs: for every garment `GARMENT.pc2` and
    /// `GARMENT.obj` (rest shape or first frame, whose comments tell rate and layer), and
    /// `body.pc2` with `body.obj`.
    pub fn pc2_files(&self) -> Result<Vec<(String, Vec<u8>)>, IoError> {
        self.check()?;
        pc2::files(self)
    }

    /// Reads the exchange layout; `name` is what errors call the file. Without `fps` it is 30.
    pub fn from_npz(name: &str, bytes: &[u8]) -> Result<Clip, IoError> {
        Self::of_npz(name, &npz::read(name, bytes)?)
    }

    fn of_npz(name: &str, npz: &Npz) -> Result<Clip, IoError> {
        let cloth = npz.floats("cloth", &[None, None, Some(3)])?;
        let shape = npz.shaped("cloth", &[None, None, Some(3)])?.shape.clone();
        let (frames, n) = (shape[0], shape[1]);
        let fps = fps(npz)?;
        let mut clip = Clip {
            drape: Drape {
                parts: Vec::new(),
                faces: npz.triangles("faces", n)?,
                frames: split(&cloth, n),
                fps: fps.unwrap_or(RATE),
            },
            rate_unknown: fps.is_none(),
            ..Clip::default()
        };
        clip.drape.parts.push(Part {
            name: stem(Path::new(name)),
            verts: 0..n,
            faces: 0..clip.drape.faces.len(),
        });
        if npz.get("body").is_some() {
            let body = npz.floats("body", &[Some(frames), None, Some(3)])?;
            let n_body = npz.shaped("body", &[None, None, Some(3)])?.shape[1];
            clip.body = split(&body, n_body);
            clip.body_faces = npz.triangles("body_faces", n_body)?;
        }
        if npz.get("rest").is_some() {
            clip.rest = vectors(&npz.floats("rest", &[Some(n), Some(3)])?);
        }
        if npz.get("rest_corners").is_some() {
            let shape = [Some(clip.drape.faces.len()), Some(3), Some(2)];
            let flat = npz.floats("rest_corners", &shape)?;
            let corner = |c: &[f64; 2]| DVec2::from_array(*c);
            let corners: Vec<DVec2> = flat.as_chunks::<2>().0.iter().map(corner).collect();
            clip.corners = corners.as_chunks::<3>().0.to_vec();
        }
        if npz.get("pins").is_some() {
            clip.pins = npz.indices("pins", (&[None], n))?;
        }
        if let Some(array) = npz.get("fabric") {
            // Somebody else's `fabric` may be anything.
            if let (Values::Text(words), [] | [1]) = (&array.values, &array.shape[..]) {
                clip.fabrics = words.clone();
            }
        }
        Ok(clip)
    }
}

/// Reads an animation: `.npz` in the exchange layout, `.glb`, `.pc2` with its OBJ beside it, or a
/// folder of point caches or of the garments' `.npz`; as `walk.npz` also all `walk.GARMENT.npz`, if it is not there itself.
/// A `body.pc2` beside a point cache is taken as the body.
pub fn read_clip(path: &Path) -> Result<Clip, IoError> {
    let garments = match path.is_dir() {
        true if files_in(path, &["pc2"])?.is_empty() => files_in(path, &["npz"])?,
        true => Vec::new(),
        false => several::beside(path),
    };
    let clip = if !garments.is_empty() {
        several::read(&garments)?
    } else if path.is_dir() || is_kind(path, "pc2") {
        pc2::read(path)?
    } else {
        let input = read_file(path, MAX_BYTES)?;
        match input.bytes.get(..4) {
            Some(crate::zip::MAGIC) => Clip::from_npz(&input.file, &input.bytes)?,
            Some(b"glTF") => crate::glb::read_moving(&input.file, &input.bytes)?,
            _ if is_kind(path, "npz") || is_kind(path, "glb") => return Err(another(&name(path))),
            _ => return Err(unknown(&name(path))),
        }
    };
    clip.check_shape().map_err(|e| e.of(path))?;
    Ok(clip)
}

/// Whether a file's name ends so, such as `npz`.
fn is_kind(path: &Path, kind: &str) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(kind))
}

fn another(file: &str) -> IoError {
    let fault = Fault::new(
        "not-animated",
        file,
        "it is called NPZ or GLB, but is neither",
    );
    fault.hint("write it again").invalid()
}

fn unknown(file: &str) -> IoError {
    let fault = Fault::new("not-animated", file, "no animation that is read here");
    fault
        .allowed("NPZ, GLB, PC2 with OBJ, or a folder of NPZ or PC2")
        .hint("write it with `muslin simulate`")
        .refused()
}

fn append<T: Clone>(list: &mut Vec<T>, more: &[T]) {
    match list.is_empty() || more.is_empty() {
        true => list.clear(),
        false => list.extend_from_slice(more),
    }
}

fn flat<'a>(points: impl Iterator<Item = &'a DVec3>) -> Vec<f32> {
    points.flat_map(|p| p.as_vec3().to_array()).collect()
}

fn triangles(faces: &[[u32; 3]]) -> Array {
    let corners = faces.as_flattened().iter().map(|&i| i.into());
    Array::int(&[faces.len(), 3], corners.collect())
}

fn vectors(flat: &[f64]) -> Vec<DVec3> {
    flat.as_chunks::<3>()
        .0
        .iter()
        .map(|c| DVec3::from_array(*c))
        .collect()
}

fn split(flat: &[f64], n: usize) -> Vec<Vec<DVec3>> {
    vectors(flat)
        .chunks(n.max(1))
        .map(<[DVec3]>::to_vec)
        .collect()
}

fn fps(npz: &Npz) -> Result<Option<f64>, IoError> {
    let Some(array) = npz.get("fps") else {
        return Ok(None);
    };
    let one = array.floats().filter(|f| f.len() == 1).map(|f| f[0]);
    let sound = one.filter(|&f| f > 0.0 && f.is_finite());
    let fault = || npz.fault("fps", "is no positive number");
    sound.ok_or_else(fault).map(Some)
}

/// The bare name of a file.
fn stem(path: &Path) -> String {
    let stem: PathBuf = path.file_stem().unwrap_or_default().into();
    name(&stem)
}

#[cfg(test)]
mod tests;
