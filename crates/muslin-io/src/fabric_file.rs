//! Fabrics of one's own: a flat TOML file, or the physics of a U3M or U3MA file.
//!
//! A fabric file has one `key = value` a line, with the unit in the key's name. `like` names a
//! preset that supplies whatever is left out. Of TOML 1.0 we read what such a file needs: bare
//! keys, strings in either quotes, numbers, comments; tables, lists and dates are refused.
//!
//! U3M (Unified 3D Material 1.1, Vizoo and Browzwear) keeps physics as JSON under
//! `custom.browzwear`: g/m², mm, N/m, dyn cm, lengthwise the warp and widthwise the weft. U3MA is an
//! archive of it and all that it names.

mod archive;
mod flat;

use std::path::Path;

use muslin_garment::{Confidence, Fabric};
use muslin_geom::colour::{bytes_of, linear};
use serde_json::Value;

use crate::error::{Fault, IoError, Place};
use crate::input::read_file;
use crate::zip;
use flat::Flat;

/// A fabric, and what was left out of account to read it.
#[derive(Clone, Debug, PartialEq)]
pub struct FabricFile {
    /// The fabric.
    pub fabric: Fabric,
    /// One sentence for each thing that the file says and we do not use.
    pub warnings: Vec<String>,
}

/// Larger files are no fabric.
const CAP: u64 = 8 << 20;
/// Nor are archives that are larger, pictures and all.
const ARCHIVE_CAP: u64 = 512 << 20;

/// Every key of a fabric file.
const KEYS: [&str; 14] = [
    "name",
    "like",
    "source",
    "mass_g_m2",
    "thickness_mm",
    "stretch_warp_n_m",
    "stretch_weft_n_m",
    "shear_n_m",
    "bend_warp_unm",
    "bend_weft_unm",
    "friction",
    "strain_limit_percent",
    "colour",
    "roughness",
];

/// Newton metres in a dyne centimetre.
const DYNE_CM: f64 = 1e-7;

/// Reads the fabric at `path`: TOML, JSON as U3M has it, or an archive with such JSON in it, whatever the name ends in
/// (but that only U3MA may be larger than 8 MiB).
pub fn read_fabric(path: &Path) -> Result<FabricFile, IoError> {
    let may_be_large = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("u3ma"));
    let input = read_file(path, if may_be_large { ARCHIVE_CAP } else { CAP })?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    parse_fabric(&input.file, &stem, &input.bytes)
}

/// Reads a fabric from bytes; `file` is what errors call it, `stem` the name of one without any.
pub fn parse_fabric(file: &str, stem: &str, bytes: &[u8]) -> Result<FabricFile, IoError> {
    let read = match bytes.starts_with(zip::MAGIC) {
        true => archive::read(file, bytes)?,
        false => parse_text(file, stem, text_of(file, bytes)?)?,
    };
    read.fabric.check().map_err(|e| {
        let fault = Fault::new("fabric-figure", file, e.to_string());
        fault.hint("the unit is in the key's name").invalid()
    })?;
    Ok(read)
}

fn text_of<'a>(file: &str, bytes: &'a [u8]) -> Result<&'a str, IoError> {
    std::str::from_utf8(bytes).map_err(|e| {
        let fault = Fault::new("fabric-text", file, "this is not text in UTF-8");
        fault.at(Place::Byte(e.valid_up_to() as u64)).invalid()
    })
}

fn parse_text(file: &str, stem: &str, text: &str) -> Result<FabricFile, IoError> {
    match text.trim_start().starts_with('{') {
        true => u3m(file, text),
        false => Ok(FabricFile {
            fabric: toml(file, stem, text)?,
            warnings: Vec::new(),
        }),
    }
}

/// The preset that lends what is left out.
fn preset(file: &str, name: &str, line: usize) -> Result<Fabric, IoError> {
    Fabric::named(name).map_err(|e| {
        let fault = Fault::new("fabric-like", file, e.to_string());
        fault.at(Place::Line(line)).invalid()
    })
}

fn toml(file: &str, stem: &str, text: &str) -> Result<Fabric, IoError> {
    let flat = Flat::read(file, text, &KEYS)?;
    let like = flat.text("like")?;
    let mut fabric = match &like {
        Some((name, line)) => preset(file, name, *line)?,
        None => preset(file, "cotton-shirting", 0)?,
    };
    let name = flat.text("name")?.map_or(stem.to_owned(), |n| n.0);
    fabric.name = slug(&name);
    fabric.source = flat
        .text("source")?
        .map_or(format!("{file}, as given"), |s| s.0);
    fabric.confidence = Confidence::Chosen;
    let figures: [(&str, f64, &mut f64); 8] = [
        ("mass_g_m2", 1e3, &mut fabric.density),
        ("thickness_mm", 1e3, &mut fabric.thickness),
        ("stretch_warp_n_m", 1.0, &mut fabric.stretch_warp),
        ("stretch_weft_n_m", 1.0, &mut fabric.stretch_weft),
        ("shear_n_m", 1.0, &mut fabric.shear),
        ("bend_warp_unm", 1e6, &mut fabric.bend_warp),
        ("bend_weft_unm", 1e6, &mut fabric.bend_weft),
        ("friction", 1.0, &mut fabric.friction),
    ];
    for (key, per_si, figure) in figures {
        match flat.number(key)? {
            Some(value) => *figure = value / per_si,
            None if like.is_some() => {}
            None => return Err(missing(file, key)),
        }
    }
    match flat.number("strain_limit_percent")? {
        Some(percent) => fabric.strain_limit = Some(percent / 100.0),
        None if like.is_none() => fabric.strain_limit = None,
        None => {}
    }
    if let Some((colour, line)) = flat.text("colour")? {
        fabric.look.colour = light(file, &colour, line)?;
    }
    if let Some(roughness) = flat.number("roughness")? {
        fabric.look.roughness = roughness.clamp(0.0, 1.0) as f32;
    }
    Ok(fabric)
}

fn missing(file: &str, key: &str) -> IoError {
    let fault = Fault::new("fabric-missing", file, format!("{key} is not given"));
    fault
        .hint(format!(
            "write a line \"{key} = ...\", or \"like = \\\"denim\\\"\" to take what is missing from a preset"
        ))
        .invalid()
}

/// `#rrggbb` as linear light.
fn light(file: &str, colour: &str, line: usize) -> Result<[f32; 3], IoError> {
    let digits = colour.strip_prefix('#').filter(|d| d.len() == 6);
    let whole = digits.and_then(|d| u32::from_str_radix(d, 16).ok());
    let whole = whole.ok_or_else(|| {
        Fault::new("fabric-colour", file, "this is no colour")
            .at(Place::Line(line))
            .found(colour)
            .allowed("six hexadecimal digits, as \"#2f6f73\"")
            .invalid()
    })?;
    Ok(linear(bytes_of(whole)))
}

/// A name as presets have it: lower case, words joined by dashes.
fn slug(name: &str) -> String {
    let lower = name.trim().to_lowercase();
    let words = lower.split(|c: char| !c.is_alphanumeric());
    let joined: Vec<&str> = words.filter(|w| !w.is_empty()).collect();
    joined.join("-")
}

fn without_physics(file: &str) -> Fault {
    let what = "it says how a fabric looks, not how it moves";
    Fault::new("fabric-physics", file, what)
}

fn u3m(file: &str, text: &str) -> Result<FabricFile, IoError> {
    let root: Value = serde_json::from_str(text).map_err(|e| {
        Fault::new("fabric-json", file, "this is not JSON")
            .at(Place::Column(e.line(), e.column()))
            .found(e)
            .invalid()
    })?;
    let places = ["", "/physics", "/material/physics"].map(|p| format!("{p}/custom/browzwear"));
    let found = places.iter().find_map(|p| Some((p, root.pointer(p)?)));
    let Some((place, physics)) = found else {
        let fault = without_physics(file);
        let hint = "export it with physics (U3M 1.1), or name the physics file beside it";
        return Err(fault
            .at(Place::Pointer(places[0].clone()))
            .hint(hint)
            .invalid());
    };
    let number = |key: &str| {
        let pointer = format!("{place}/{key}");
        root.pointer(&pointer)
            .and_then(Value::as_f64)
            .ok_or_else(|| {
                let fault = Fault::new("fabric-missing", file, format!("{key} is not a number"));
                fault.at(Place::Pointer(pointer.clone())).invalid()
            })
    };
    let knit = physics["category"].as_str() == Some("Knits");
    let look = preset(
        file,
        if knit {
            "cotton-jersey"
        } else {
            "cotton-shirting"
        },
        0,
    )?
    .look;
    let name = slug(physics["name"].as_str().unwrap_or("u3m-fabric"));
    let fabric = Fabric {
        name,
        density: number("mass")? / 1e3,
        thickness: number("thickness")? / 1e3,
        stretch_warp: number("stretch/length")?,
        stretch_weft: number("stretch/width")?,
        shear: number("shear")?,
        bend_warp: number("bend/length")? * DYNE_CM,
        bend_weft: number("bend/width")? * DYNE_CM,
        friction: number("friction")?,
        strain_limit: None,
        source: format!("{file}, measured for U3M"),
        confidence: Confidence::Measured,
        look,
    };
    Ok(FabricFile {
        warnings: unused(&fabric.name, physics),
        fabric,
    })
}

/// What the file says beyond the linear laws.
fn unused(name: &str, physics: &Value) -> Vec<String> {
    let says = |key: &str| {
        let at = &physics[key];
        let any = |v: &Value| v.as_f64().is_some_and(|x| x != 0.0);
        any(at) || ["length", "width"].iter().any(|side| any(&at[side]))
    };
    [
        ("stretch_linearity", "its stretch is taken as linear"),
        ("shear_linearity", "its shear is taken as linear"),
        ("hysteresis", "its hysteresis is left out"),
        ("shrink", "its shrinkage is left out"),
    ]
    .iter()
    .filter(|(key, _)| says(key))
    .map(|(_, what)| format!("fabric {name}: {what}"))
    .collect()
}

#[cfg(test)]
mod tests;
