//! The header as a C compiler reads it, and a program that was linked to the library.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::Hero;
use muslin::{DressOptions, Playing, Size, Wear};

/// The static library that was built beside this test.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("a test is a file");
    let deps = test.parent().expect("it lies in a folder").to_owned();
    let out = deps.parent().expect("and that in another").to_owned();
    let named = |p: &PathBuf| {
        let name = p.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libmuslin_c") && name.ends_with(".a")
    };
    let files = [deps, out].into_iter().flat_map(|folder| {
        let entries = std::fs::read_dir(folder).expect("it can be listed");
        entries.flatten().map(|e| e.path())
    });
    let built = |p: &PathBuf| p.metadata().and_then(|m| m.modified()).ok();
    let all = files.filter(named).max_by_key(built);
    all.expect("cargo builds the library with its tests")
}

/// The example of that name, if there is a C compiler.
fn program(name: &str) -> Option<PathBuf> {
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    if Command::new("cc").arg("--version").output().is_err() {
        println!("skipped: no C compiler (cc)");
        return None;
    }
    let program = library().with_file_name(name);
    let built = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I"])
        .arg(room.join("include"))
        .arg(room.join(format!("examples/{name}.c")))
        .arg(library())
        .args(["-lm", "-lpthread", "-ldl", "-o"]) // as the header says
        .arg(&program)
        .output()
        .expect("it can be run");
    let said = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{said}");
    Some(program)
}

/// What a program says that is told these `words`.
fn run(program: &Path, words: &[&Path]) -> String {
    let ended = Command::new(program)
        .args(words)
        .output()
        .expect("it was built");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(ended.status.success(), "{:?}: {said}", ended.status);
    String::from_utf8(ended.stdout).expect("numbers")
}

/// Lowest, highest and mean height.
fn heights(at: &[[f32; 3]]) -> (f32, f32, f64) {
    let ys = at.iter().map(|p| p[1]);
    let low = ys.clone().fold(f32::MAX, f32::min);
    let high = ys.clone().fold(f32::MIN, f32::max);
    (low, high, ys.map(f64::from).sum::<f64>() / at.len() as f64)
}

#[test]
fn a_program_in_c_plays_the_same_frames() {
    let Some(program) = program("wave") else {
        return;
    };
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    let model = room.join("../../assets/wardrobe/tee.muslin");
    let told = run(&program, &[]);
    assert_eq!(told, run(&program, &[&model]), "the wardrobe's own file");

    let options = DressOptions {
        outfit: vec![Wear::parse("tee:silk-charmeuse")],
        size: Some(Size::L),
        height: Some(1.72),
        ..DressOptions::default()
    };
    let mut playing = Playing::new(None, &options).expect("a garment of the wardrobe");
    let arm = playing
        .bones()
        .iter()
        .position(|b| b.name == "upperarm01.L");
    let arm = arm.expect("a bone");
    let mut turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.bones().len()];
    playing.begin(f64::from(1.0f32 / 30.0));
    let mut means = Vec::new();
    for (k, line) in told.lines().enumerate() {
        turns[arm][2] = 0.5 * k as f32 / 30.0;
        let [at, normals] = playing
            .frame_with_normals(&turns, [0.0; 3])
            .expect("a turn a bone");
        let forwards = normals.iter().map(|n| f64::from(n[2].max(0.0)));
        let forwards = forwards.sum::<f64>() / at.len() as f64;
        let (low, high, mean) = heights(at);
        let told = format!("{k} {low:.5} {high:.5} {mean:.5} {forwards:.4}");
        assert_eq!(line, told);
        means.push(mean);
    }
    assert_eq!(means.len(), 30);
    // An arm that rises takes its sleeve along.
    assert!(means[29] > means[0] + 0.005, "{means:?}");
}

#[test]
fn a_character_in_c_wears_what_it_wears_in_rust_and_the_same_whichever_way_it_looks() {
    let Some(program) = program("turntable") else {
        return;
    };
    let hero = Hero::new("c");
    let told = run(&program, &[&hero.file]);
    let mut playing = Playing::new(None, &hero.options()).expect("a garment on a character");
    playing.set_motion_level(0.0);
    let bound = playing.character_bound().to_vec();
    let mut means = Vec::new();
    for (k, line) in told.lines().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / 12.0).sin_cos();
        let turned = |m: &[f32; 16]| {
            let mut m = *m;
            for a in m.chunks_exact_mut(4) {
                let (x, z) = (f64::from(a[0]), f64::from(a[2]));
                a[0] = (cos * x + sin * z) as f32;
                a[2] = (cos * z - sin * x) as f32;
            }
            m
        };
        let now: Vec<[f32; 16]> = bound.iter().map(turned).collect();
        let (low, high, mean) = heights(playing.frame_on(&now).expect("sound"));
        assert_eq!(line, format!("{k} {low:.4} {high:.4} {mean:.5}"));
        assert!((0.4..1.0).contains(&(high - low)), "{line}");
        means.push(mean);
    }
    assert_eq!(means.len(), 12);
    assert!(
        means.iter().all(|m| (m - means[0]).abs() < 1e-4),
        "{means:?}"
    );
}

#[test]
fn every_function_of_the_header_is_in_the_library_and_the_other_way_round() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |name: &str| std::fs::read_to_string(room.join(name)).expect("a source");
    let names = |text: &str, mark: &str| -> Vec<String> {
        let found = text.lines().filter(|l| l.contains(mark)).filter_map(|l| {
            let before = l.split('(').next()?;
            let name = before
                .rsplit(|c: char| !c.is_alphanumeric() && c != '_')
                .next()?;
            name.starts_with("muslin_").then(|| name.to_owned())
        });
        let mut all: Vec<String> = found.collect();
        all.sort();
        all
    };
    let header = read("include/muslin.h");
    let start = header
        .find("muslin_garment *muslin_open")
        .expect("a function");
    let declared = names(&header[start..], "muslin_");
    let declared: Vec<String> = declared.into_iter().collect();
    let made = names(&read("src/lib.rs"), "extern \"C\" fn");
    assert_eq!(declared, made);
    assert!(made.len() > 10);
}
