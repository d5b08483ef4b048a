//! `cargo xtask check pose [PHOTOS] [--python PROGRAM] [--bless]`: our detector against the
//! reference, MediaPipe 0.10.14 and LiteRT.
//!
//! Compares whole tensors for made-up inputs, the 33 points on every photo of a folder (by
//! default `$MUSLIN_DATA/photos`), and the time of both networks, run in turn; time only means
//! something in a release build (`cargo run --release -p xtask -- check pose`). `--python` names
//! an interpreter that has the packages; else they are installed into a throw-away environment.
//! `--bless` rewrites the golden values of the ordinary tests.

mod reference;
mod tensors;
mod timing;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use muslin_fit::detect::{Found, Models, find_people};
use muslin_io::{PhotoLimits, PoseGraphs, png, pose_graphs, read_photo};

use crate::Outcome;
use reference::{Reference, Seen};

/// Largest mean distance from the reference's points [px].
const MEAN_PX: f64 = 0.25;
/// What the ordinary tests compare with.
const GOLDEN: &str = "crates/muslin-fit/tests/golden/photos.txt";
const HEAD: &str = "\
# MediaPipe 0.10.14, static_image_mode, model_complexity 1, on the pixels our reader decodes:
# 33 points [px: right, down], a bar, 33 places [mm: right, down, away]; or nobody.
# Printed by `cargo xtask check pose --bless`.
";

/// Compares everything and prints it.
pub fn run(args: &[&str]) -> Outcome {
    let bless = args.contains(&"--bless");
    let after = |flag: &str| args.iter().skip_while(|a| **a != flag).nth(1).copied();
    let python = after("--python");
    let plain = args
        .iter()
        .find(|a| !a.starts_with("--") && Some(**a) != python);
    let data = std::env::var_os("MUSLIN_DATA").map(|d| PathBuf::from(d).join("photos"));
    let folder = plain.map(PathBuf::from).or(data);
    let folder = folder.ok_or("name a folder of photos, or set MUSLIN_DATA")?;
    let graphs = pose_graphs().map_err(|e| e.to_string())?;
    let mut reference = Reference::start(python)?;
    let faults = [
        tensors::compare(&graphs, &mut reference, bless)?,
        photos(&graphs, &mut reference, (&folder, bless))?,
        timing::compare(&graphs, &mut reference)?,
    ]
    .concat();
    if faults.is_empty() {
        Ok(())
    } else {
        Err(faults.join("\n  "))
    }
}

/// Prints a row per photo; returns what is too far off.
fn photos(
    graphs: &PoseGraphs,
    reference: &mut Reference,
    (folder, bless): (&Path, bool),
) -> Result<Vec<String>, String> {
    let models = Models::new(&graphs.detector, &graphs.landmarks).map_err(|e| e.to_string())?;
    let (mut faults, mut golden) = (Vec::new(), HEAD.to_owned());
    println!(
        "{:<62} {:>8} {:>7} {:>6} {:>12}",
        "photo", "px", "mm", "people", "own decoder"
    );
    for path in pictures(folder)? {
        let name = path
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        let image = read_photo(&path, &PhotoLimits::default())
            .map_err(|e| e.to_string())?
            .image;
        let same = std::env::temp_dir().join("muslin-xtask-check-pose.png");
        std::fs::write(&same, png(&image)).map_err(|e| format!("{}: {e}", same.display()))?;
        let want = reference.photo(&same)?;
        let own = reference.photo(&path)?;
        let found = find_people(&models, &image);
        let row = compare(&found, want.as_ref());
        let decoder =
            compare(&found, own.as_ref()).map_or("-".into(), |d| format!("{:.3} px", d.0));
        match row {
            Some((px, mm)) => {
                let n = found.people.len();
                println!("{name:<62} {px:>8.4} {mm:>7.3} {n:>6} {decoder:>12}");
                if px > MEAN_PX {
                    faults.push(format!("{name}: {px:.3} px off"));
                }
            }
            None if want.is_none() => println!("{name:<62} nobody; we {}", found.people.len()),
            None => faults.push(format!("{name}: we find nobody")),
        }
        line(&mut golden, &name, want.as_ref());
    }
    if bless {
        std::fs::write(GOLDEN, golden).map_err(|e| format!("{GOLDEN}: {e}"))?;
    }
    Ok(faults)
}

fn pictures(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let picture = |p: &PathBuf| p.extension().is_some_and(|e| e == "jpg" || e == "png");
    let mut paths: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(picture)
        .collect();
    paths.sort();
    Ok(paths)
}

/// Mean distances [px, mm] of the surest person from the reference's, if both found one.
fn compare(found: &Found, want: Option<&Seen>) -> Option<(f64, f64)> {
    let person = found
        .people
        .iter()
        .max_by(|a, b| a.score.total_cmp(&b.score))?;
    let want = want?;
    let pixels = person.keypoints.points.iter().map(|p| p.pixel);
    let px: f64 = pixels.zip(&want.points).map(|(p, q)| p.distance(*q)).sum();
    let ours = person.keypoints.world.as_ref()?;
    let turned = |q: &DVec3| DVec3::new(q.x, -q.y, -q.z);
    let m: f64 = ours
        .iter()
        .zip(&want.world)
        .map(|(p, q)| p.distance(turned(q)))
        .sum();
    Some((px / 33.0, 1e3 * m / 33.0))
}

/// Appends a golden line.
fn line(golden: &mut String, name: &str, want: Option<&Seen>) {
    let Some(seen) = want else {
        golden.push_str(&format!("{name} nobody\n"));
        return;
    };
    let px = |p: &DVec2| format!("{:.2} {:.2}", p.x, p.y);
    let mm = |p: &DVec3| format!("{:.1} {:.1} {:.1}", p.x * 1e3, p.y * 1e3, p.z * 1e3);
    let px: Vec<String> = seen.points.iter().map(px).collect();
    let mm: Vec<String> = seen.world.iter().map(mm).collect();
    writeln!(golden, "{name} {} | {}", px.join(" "), mm.join(" ")).expect("strings take all");
}
