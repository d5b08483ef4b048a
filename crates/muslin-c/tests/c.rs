//! The header as a C compiler reads it, and a program that was linked to the library.

use std::path::{Path, PathBuf};
use std::process::Command;

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

#[test]
fn a_program_in_c_plays_the_same_frames() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    if Command::new("cc").arg("--version").output().is_err() {
        println!("skipped: no C compiler (cc)");
        return;
    }
    let program = library().with_file_name("wave");
    let built = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I"])
        .arg(room.join("include"))
        .arg(room.join("examples/wave.c"))
        .arg(library())
        .args(["-lm", "-lpthread", "-ldl", "-o"]) // as the header says
        .arg(&program)
        .output()
        .expect("it can be run");
    let said = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{said}");
    let model = room.join("../../assets/wardrobe/tee.muslin");
    let run = |words: &[&Path]| {
        let ended = Command::new(&program)
            .args(words)
            .output()
            .expect("it was built");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(ended.status.success(), "{:?}: {said}", ended.status);
        String::from_utf8(ended.stdout).expect("numbers")
    };
    let told = run(&[]);
    assert_eq!(told, run(&[&model]), "the wardrobe's own file");

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
    let mut heights = Vec::new();
    for (k, line) in told.lines().enumerate() {
        turns[arm][2] = 0.5 * k as f32 / 30.0;
        let [at, normals] = playing
            .frame_with_normals(&turns, [0.0; 3])
            .expect("a turn a bone");
        let forwards = normals.iter().map(|n| f64::from(n[2].max(0.0)));
        let forwards = forwards.sum::<f64>() / at.len() as f64;
        let ys = at.iter().map(|p| p[1]);
        let low = ys.clone().fold(f32::MAX, f32::min);
        let high = ys.clone().fold(f32::MIN, f32::max);
        let mean = ys.map(f64::from).sum::<f64>() / at.len() as f64;
        let told = format!("{k} {low:.5} {high:.5} {mean:.5} {forwards:.4}");
        assert_eq!(line, told);
        heights.push(mean);
    }
    assert_eq!(heights.len(), 30);
    // An arm that rises takes its sleeve along.
    assert!(heights[29] > heights[0] + 0.005, "{heights:?}");
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
