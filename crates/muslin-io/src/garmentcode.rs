//! GarmentCode patterns: panels and stitches as JSON.
//!
//! The format of the pattern makers around GarmentCode (Korosteleva and Sorkine-Hornung 2023):
//! `pattern.panels` maps names to outlines with a place in space, `pattern.stitches` pairs edges,
//! `properties.units_in_meter` scales. Other keys are left alone. What we accept beyond the
//! letter: bare lists as quadratic curves (old files), missing units (taken as centimetres, with
//! a warning), absolute curve coordinates. What we refuse: outlines that do not close, stitches
//! that point nowhere or share an edge, numbers that are not finite or beyond any garment.

mod at;

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use muslin_garment::{Curve, Panel, Seam, SewingPattern};
use serde_json::Value;

use crate::error::{Fault, IoError, Place};
use at::At;

/// A pattern, and what had to be guessed to read it.
#[derive(Clone, Debug, PartialEq)]
pub struct GarmentCode {
    /// Panels and seams [m].
    pub pattern: SewingPattern,
    /// One sentence for each thing that the file leaves open or that looks wrong.
    pub warnings: Vec<String>,
}

const MAX_BYTES: usize = 16 << 20;
/// More panels than this are no garment; also what one byte can number.
const MAX_PANELS: usize = 250;
const MAX_EDGES: usize = 1000;
/// Farther from the origin than this [m] is no garment.
const FAR: f64 = 10.0;
/// An edge shorter than this [m] cannot be sewn.
const SHORT: f64 = 1e-4;
/// Sides of a seam that differ by more than this factor are probably a mistake.
const UNEQUAL: f64 = 2.0;

/// Reads a GarmentCode specification; `name` is what errors call it.
pub fn read(name: &str, bytes: &[u8]) -> Result<GarmentCode, IoError> {
    if bytes.len() > MAX_BYTES {
        let fault = Fault::new("pattern-large", name, "too large for a pattern");
        return Err(fault.found(bytes.len()).allowed(MAX_BYTES).refused());
    }
    let root: Value = serde_json::from_slice(bytes).map_err(|e| not_json(name, &e))?;
    let root = At::root(name, &root);
    let pattern = root.need("pattern").map_err(|_| not_a_pattern(name))?;
    let mut warnings = Vec::new();
    let units = units(&root, &mut warnings)?;
    let panels = panels(&pattern, &units)?;
    let seams = match pattern.get("stitches")? {
        Some(list) => seams(&list, &panels, &mut warnings)?,
        None => {
            warnings.push(format!("{name}: no stitches: the panels stay apart"));
            Vec::new()
        }
    };
    let pattern = SewingPattern { panels, seams };
    Ok(GarmentCode { pattern, warnings })
}

fn not_json(name: &str, e: &serde_json::Error) -> IoError {
    Fault::new("pattern-json", name, "this is not JSON")
        .at(Place::Column(e.line(), e.column()))
        .found(e)
        .hint("export the pattern again; only GarmentCode's *_specification.json can be sewn")
        .invalid()
}

fn not_a_pattern(name: &str) -> IoError {
    Fault::new("pattern-kind", name, "JSON, but no sewing pattern")
        .at(Place::Pointer("/pattern".into()))
        .hint("name a GarmentCode file, usually called *_specification.json")
        .invalid()
}

/// How numbers of the file become metres.
struct Units {
    /// Metres per unit.
    scale: f64,
    /// Control points are given in units, not in shares of their edge.
    absolute: bool,
}

fn units(root: &At, warnings: &mut Vec<String>) -> Result<Units, IoError> {
    let properties = root.get("properties")?;
    let of = |key: &str| match &properties {
        Some(p) => p.get(key),
        None => Ok(None),
    };
    let scale = match of("units_in_meter")? {
        Some(n) => 1.0 / n.number_in(0.1, 10_000.0)?,
        None => {
            warnings.push("the pattern names no units; centimetres are assumed".into());
            0.01
        }
    };
    let absolute = match of("curvature_coords")? {
        Some(c) if c.text()? == "absolute" => true,
        Some(c) if c.text()? != "relative" => {
            let fault = c.fault("unknown kind of curve coordinates");
            return Err(fault.allowed("relative or absolute").invalid());
        }
        _ => false,
    };
    Ok(Units { scale, absolute })
}

fn panels(pattern: &At, units: &Units) -> Result<Vec<Panel>, IoError> {
    let all = pattern.need("panels")?;
    let mut entries = all.entries()?;
    if entries.is_empty() {
        return Err(all.fault("no panel to sew").invalid());
    }
    if entries.len() > MAX_PANELS {
        let fault = all.fault("too many panels").found(entries.len());
        return Err(fault.allowed(MAX_PANELS).refused());
    }
    // The file's own order of keys is not kept by JSON; names are the same everywhere.
    entries.sort_by(|a, b| a.0.cmp(b.0));
    let one = |(name, at): &(&str, At)| panel(name, at, units);
    entries.iter().map(one).collect()
}

fn panel(name: &str, at: &At, units: &Units) -> Result<Panel, IoError> {
    let points = at.need("vertices")?.items(MAX_EDGES)?;
    let point = |p: &At| Ok(p.numbers::<2>(FAR / units.scale)?.into());
    let points: Vec<DVec2> = points.iter().map(point).collect::<Result<_, IoError>>()?;
    let all = at.need("edges")?;
    let edges = all.items(MAX_EDGES)?;
    if edges.len() < 2 {
        let fault = all.fault("too few edges for a piece of cloth");
        return Err(fault.found(edges.len()).allowed("2 or more").invalid());
    }
    let ends = edges.iter().map(|e| ends(e, points.len()));
    let ends: Vec<[usize; 2]> = ends.collect::<Result<_, _>>()?;
    closed(&edges, &ends)?;
    let mut panel = Panel {
        name: name.to_owned(),
        corners: ends.iter().map(|e| points[e[0]] * units.scale).collect(),
        curves: Vec::with_capacity(edges.len()),
        world_from_panel: place(at, units)?,
    };
    for (edge, [a, b]) in edges.iter().zip(&ends) {
        let curve = curve(edge, [points[*a], points[*b]], units)?;
        panel.curves.push(curve);
    }
    for (k, edge) in edges.iter().enumerate() {
        let length = panel.length(k);
        if length < SHORT {
            let fault = edge.fault("an edge without length");
            return Err(fault.found(format!("{:.3} mm", length * 1e3)).invalid());
        }
    }
    Ok(panel)
}

fn place(at: &At, units: &Units) -> Result<DAffine3, IoError> {
    let three = |key: &str, most: f64| match at.get(key)? {
        Some(v) => v.numbers::<3>(most).map(DVec3::from),
        None => Ok(DVec3::ZERO),
    };
    let move_by = three("translation", FAR / units.scale)? * units.scale;
    let [x, y, z] = three("rotation", 1e4)?.to_array().map(f64::to_radians);
    // About fixed axes: x first, then y, then z.
    let turn = DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
    Ok(DAffine3::from_mat3_translation(
        DMat3::from_quat(turn),
        move_by,
    ))
}

fn ends(edge: &At, count: usize) -> Result<[usize; 2], IoError> {
    let at = edge.need("endpoints")?;
    let [a, b] = at.numbers::<2>(1e9)?;
    let index =
        |x: f64| (x >= 0.0 && x.fract() == 0.0 && (x as usize) < count).then_some(x as usize);
    match (index(a), index(b)) {
        (Some(a), Some(b)) if a != b => Ok([a, b]),
        (Some(_), Some(_)) => Err(at
            .fault("an edge must join two different vertices")
            .invalid()),
        _ => {
            let fault = at.fault("an edge ends at a vertex that does not exist");
            let allowed = format!("0 to {}", count.saturating_sub(1));
            Err(fault.found(format!("{a}, {b}")).allowed(allowed).invalid())
        }
    }
}

/// Each edge must start where the one before it ends.
fn closed(edges: &[At], ends: &[[usize; 2]]) -> Result<(), IoError> {
    for k in 0..ends.len() {
        let next = (k + 1) % ends.len();
        if ends[k][1] != ends[next][0] {
            let what = format!("the outline breaks: edge {k} does not lead to edge {next}");
            let fault = edges[next].need("endpoints")?.fault(&what);
            let fault = fault.found(format!("it starts at vertex {}", ends[next][0]));
            let fault = fault.allowed(format!("vertex {}", ends[k][1]));
            return Err(fault
                .hint("list the edges of a panel in the order of its outline")
                .invalid());
        }
    }
    Ok(())
}

fn curve(edge: &At, [a, b]: [DVec2; 2], units: &Units) -> Result<Curve, IoError> {
    let Some(at) = edge.get("curvature")? else {
        return Ok(Curve::Line);
    };
    let control = |p: &At| -> Result<DVec2, IoError> {
        let c: DVec2 = p.numbers::<2>(FAR / units.scale)?.into();
        let along = b - a;
        let c = if units.absolute {
            c
        } else {
            a + along * c.x + along.perp() * c.y
        };
        Ok(c * units.scale)
    };
    if at.is_list() {
        return Ok(Curve::Quadratic(control(&at)?));
    }
    let (kind, params) = (at.need("type")?, at.need("params")?);
    let list = params.items(3)?;
    let wants = |n: usize| match list.len() == n {
        true => Ok(()),
        false => {
            let fault = params.fault("another number of parameters than this curve has");
            Err(fault.found(list.len()).allowed(n).invalid())
        }
    };
    match kind.text()? {
        "quadratic" => wants(1).and_then(|()| Ok(Curve::Quadratic(control(&list[0])?))),
        "cubic" => wants(2).and_then(|()| Ok(Curve::Cubic(control(&list[0])?, control(&list[1])?))),
        "circle" => wants(3).and_then(|()| circle(&list, [a, b], units)),
        _ => {
            let fault = kind.fault("unknown kind of curve");
            let fault = fault.found(kind.text()?);
            Err(fault.allowed("quadratic, cubic or circle").invalid())
        }
    }
}

/// Radii may fall short of half the chord by rounding, not more.
const SLACK: f64 = 0.99;

fn circle(list: &[At], [a, b]: [DVec2; 2], units: &Units) -> Result<Curve, IoError> {
    let radius = list[0].number_in(0.0, FAR / units.scale)?;
    let least = 0.5 * a.distance(b);
    if radius < SLACK * least {
        let fault = list[0].fault("the circle is too small to reach from end to end");
        let allowed = format!("{least:.3} or more");
        return Err(fault.found(radius).allowed(allowed).invalid());
    }
    let [large, left] = [list[1].flag()?, list[2].flag()?];
    let radius = radius * units.scale;
    Ok(Curve::Arc {
        radius,
        large,
        left,
    })
}

fn seams(list: &At, panels: &[Panel], warnings: &mut Vec<String>) -> Result<Vec<Seam>, IoError> {
    let mut taken: HashMap<(u32, u32), usize> = HashMap::new();
    let mut seams = Vec::new();
    for (n, at) in list.items(MAX_PANELS * 100)?.iter().enumerate() {
        let parts = at.items(3)?;
        if parts.len() < 2 {
            return Err(at
                .fault("a stitch joins two edges")
                .found(parts.len())
                .invalid());
        }
        let flipped = match parts.get(2) {
            Some(flag) => flag.text()? == "right_wrong",
            None => false,
        };
        let mut sides = [(0, 0); 2];
        for k in 0..2 {
            sides[k] = side(&parts[k], panels)?;
            if let Some(before) = taken.insert(sides[k], n) {
                let fault = parts[k].fault("this edge is sewn twice");
                let fault = fault.found(format!("also in stitch {before}"));
                return Err(fault
                    .hint("split the edge in two, one for each stitch")
                    .invalid());
            }
        }
        warnings.extend(unequal(sides, panels));
        seams.push(Seam { sides, flipped });
    }
    Ok(seams)
}

fn side(at: &At, panels: &[Panel]) -> Result<(u32, u32), IoError> {
    let (named, edge) = (at.need("panel")?, at.need("edge")?);
    let name = named.text()?;
    // Sorted by name when they were read.
    let Ok(p) = panels.binary_search_by(|q| q.name.as_str().cmp(name)) else {
        let fault = named.fault("a stitch names a panel that does not exist");
        return Err(fault.found(name).invalid());
    };
    let (k, n) = (edge.number_in(-1e9, 1e9)?, panels[p].curves.len());
    if k < 0.0 || k.fract() != 0.0 || k as usize >= n {
        let what = format!("a stitch names an edge that panel {name} does not have");
        let fault = edge.fault(&what).found(k);
        return Err(fault.allowed(format!("0 to {}", n - 1)).invalid());
    }
    Ok((p as u32, k as u32))
}

fn unequal(sides: [(u32, u32); 2], panels: &[Panel]) -> Option<String> {
    let [a, b] = sides.map(|(p, k)| panels[p as usize].length(k as usize));
    let told = |(p, k): (u32, u32), l: f64| {
        let name = crate::quote(&panels[p as usize].name);
        format!("edge {k} of {name} ({:.1} cm)", l * 100.0)
    };
    (a.max(b) > UNEQUAL * a.min(b)).then(|| {
        let (one, other) = (told(sides[0], a), told(sides[1], b));
        format!("{one} is sewn to {other}: the longer side is gathered")
    })
}

#[cfg(test)]
mod tests;
