//! Every command, as a user types it: what it prints, what it writes, how it ends.

mod common;

use common::{Folder, errors, muslin};
use std::path::Path;
use std::process::{Command, Stdio};

fn code(args: &[&str]) -> (Option<i32>, String) {
    let out = muslin(args);
    (out.status.code(), errors(&out))
}

fn names(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn the_demo_writes_a_figure_pictures_and_a_report() {
    let folder = Folder::new("demo");
    let out = folder.at("out");
    let done = muslin(&[
        "demo",
        "--garment",
        "tee",
        "--edge",
        "25",
        "--overlay",
        "--allow-crossings",
        "--height",
        "172",
        "-o",
        &out,
    ]);
    let errors = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(0), "{errors}");
    for stage in [
        "[1/5] pose",
        "[2/5] body",
        "[3/5] outfit",
        "[4/5] drape",
        "[5/5] write",
    ] {
        assert!(errors.contains(stage), "{stage} is not told:\n{errors}");
    }
    let files = [
        "front.png",
        "look.glb",
        "overlay.png",
        "report.json",
        "turntable.png",
    ];
    assert_eq!(names(&out), files);
    let glb = std::fs::read(Path::new(&out).join("look.glb")).expect("it was written");
    assert_eq!(&glb[..4], b"glTF");
    let report = std::fs::read_to_string(Path::new(&out).join("report.json")).expect("written");
    assert!(report.contains("\"height_cm\": 172"), "{report}");
    assert!(report.contains("\"body_intersections\": 0"), "{report}");
    let table = String::from_utf8_lossy(&done.stdout);
    assert!(table.contains("172 cm tall"), "{table}");
}

#[test]
fn a_built_in_pose_needs_no_photo_and_gives_the_same_bytes_twice() {
    let folder = Folder::new("pose");
    let run = |name: &str| {
        let out = folder.at(name);
        let args = [
            "dress",
            "--pose",
            "t-pose",
            "--garment",
            "tee",
            "--edge",
            "25",
            "--allow-crossings",
        ];
        let (status, errors) = code(&[&args[..], &["--json", "-q", "-o", &out]].concat());
        assert_eq!(status, Some(0), "{errors}");
        assert!(errors.is_empty(), "quiet means quiet: {errors}");
        std::fs::read(Path::new(&out).join("look.glb")).expect("it was written")
    };
    assert!(run("a") == run("b"), "two runs differ");
}

#[test]
fn a_failure_is_told_as_json_where_that_is_asked_for_and_nobody_need_read_what_is_told() {
    let done = muslin(&["dress", "nowhere.jpg", "--json"]);
    assert_eq!(done.status.code(), Some(5));
    let told = String::from_utf8_lossy(&done.stdout);
    assert!(
        told.contains("\"code\": \"cannot-read\"") && told.contains("\"exit\": 5"),
        "{told}"
    );
    let folder = Folder::new("unread");
    let out = folder.at("w.glb");
    let args = [
        "simulate",
        "--motion",
        "wave",
        "--edge",
        "25",
        "--seconds",
        "0.1",
        "-o",
        &out,
    ];
    let mut child = Command::new(env!("CARGO_BIN_EXE_muslin"))
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    drop(child.stderr.take());
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
    assert!(Path::new(&out).exists());
}

#[test]
fn lists_tell_what_there_is() {
    for (what, name) in [
        ("garments", "trousers"),
        ("fabrics", "cotton-jersey"),
        ("poses", "walk"),
    ] {
        let out = muslin(&["list", what]);
        assert_eq!(out.status.code(), Some(0));
        assert!(
            String::from_utf8_lossy(&out.stdout).contains(name),
            "{what}"
        );
    }
}

#[test]
fn bad_input_ends_with_its_code_a_hint_and_no_file() {
    let folder = Folder::new("bad");
    let out = folder.at("out");
    let photo = include_bytes!("../../../assets/examples/walk.jpg");
    let whole = folder.put("whole.jpg", photo);
    let cases: Vec<(&str, Vec<String>, i32)> = vec![
        ("not a photo", vec![folder.put("a.jpg", b"<svg></svg>")], 4),
        (
            "a cut photo",
            vec![folder.put("cut.jpg", &photo[..photo.len() / 2])],
            3,
        ),
        ("an empty file", vec![folder.put("empty.png", b"")], 3),
        ("no file", vec![folder.at("missing.jpg")], 5),
        ("a folder", vec![folder.at(".")], 5),
        (
            "a picture of nothing",
            vec![folder.put("grey.png", &grey())],
            3,
        ),
        (
            "no such garment",
            vec![whole.clone(), "--garment".into(), "kilt".into()],
            2,
        ),
        (
            "no such fabric",
            vec![whole.clone(), "--fabric".into(), "lead".into()],
            2,
        ),
        (
            "a giant",
            vec![whole.clone(), "--height".into(), "17200".into()],
            2,
        ),
        (
            "person 9",
            vec![whole.clone(), "--person".into(), "9".into()],
            3,
        ),
        ("no such pose", vec!["--pose".into(), "wlak".into()], 2),
    ];
    for (what, args, want) in cases {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let (status, errors) = code(&[&["dress"], &args[..], &["-o", &out]].concat());
        assert_eq!(status, Some(want), "{what}: {errors}");
        assert!(errors.contains("error["), "{what}: {errors}");
        assert!(errors.lines().count() <= 20, "{what}: {errors}");
        assert!(names(&out).is_empty(), "{what} left {:?}", names(&out));
    }
}

#[test]
fn a_place_that_cannot_be_written_is_told_before_the_work() {
    let folder = Folder::new("unwritable");
    let file = folder.put("file", b"in the way");
    let inside = Path::new(&file).join("out").display().to_string();
    let (status, errors) = code(&["demo", "-o", &inside]);
    assert_eq!(status, Some(5), "{errors}");
    assert!(
        !errors.contains("[4/5]"),
        "the work was done for nothing: {errors}"
    );
}

/// Somebody who stands in a coarse skirt, written to a folder.
fn in_a_skirt(out: &str) -> (Option<i32>, String) {
    let who = "dress --pose stand --garment skirt --edge 25 -o".split(' ');
    code(&who.chain([out]).collect::<Vec<_>>())
}

#[test]
fn what_is_read_is_never_written_over_or_taken_away() {
    let folder = Folder::new("same");
    folder.put("front.png", &grey());
    let hero = folder.put("hero.glb", b"glTF");
    let fabric = folder.put("report.json", b"{}");
    let out = folder.at(".");
    for args in [
        vec!["dress", "--pose", "stand", "--fabric", &fabric, "-o", &out],
        vec!["simulate", "--body", &hero, "-o", &hero],
    ] {
        let (status, errors) = code(&args);
        assert_eq!(status, Some(2), "{args:?}: {errors}");
        assert!(errors.contains("error[same-file]"), "{args:?}: {errors}");
    }
    let (status, errors) = code(&["bench", "body", "--only", "nothing"]);
    assert_eq!(status, Some(2), "{errors}");
    assert!(errors.contains("--only"), "{errors}");
    assert_eq!(names(&out), ["front.png", "hero.glb", "report.json"]);
    // Somebody's picture that is called as a result was once.
    let out = folder.at("out");
    let (status, errors) = in_a_skirt(&out);
    assert_eq!(status, Some(0), "{errors}");
    let report = Path::new(&out).join("report.json");
    let told = std::fs::read_to_string(&report).expect("it was written");
    let told = told.replace("\"front.png\":", "\"overlay.png\": 5,\n    \"front.png\":");
    let mine = Path::new(&out).join("overlay.png");
    for (bytes, stays) in [(&b"other"[..], false), (&b"others"[..], true)] {
        std::fs::write(&report, &told).expect("our own file");
        std::fs::write(&mine, bytes).expect("our own file");
        let (status, errors) = in_a_skirt(&out);
        assert_eq!(status, Some(0), "{errors}");
        assert_eq!(mine.exists(), stays);
    }
}

#[test]
fn one_job_at_a_time_dresses_into_a_folder() {
    let folder = Folder::new("twice");
    let out = folder.at("out");
    std::fs::create_dir_all(&out).expect("our own folder");
    let look = Path::new(&out).join("look.glb");
    let other = muslin_io::Lock::hold(&look).expect("nobody has it");
    let (status, errors) = in_a_skirt(&out);
    assert_eq!(status, Some(8), "{errors}");
    assert!(errors.contains("look.glb"), "{errors}");
    drop(other);
    assert_eq!(names(&out), [""; 0]);
    let (status, errors) = in_a_skirt(&out);
    assert_eq!(status, Some(0), "{errors}");
}

#[test]
fn near_names_are_offered() {
    let (_, errors) = code(&["dress", "--pose", "stand", "--garment", "trouser"]);
    assert!(errors.contains("trousers"), "{errors}");
    let (_, errors) = code(&["dress", "--pose", "stand", "--fabric", "demin"]);
    assert!(errors.contains("denim"), "{errors}");
    // The case of a name's letters does not matter.
    let folder = Folder::new("case");
    let (status, errors) = code(&[
        "simulate",
        "--motion",
        "Wave",
        "--edge",
        "25",
        "--seconds",
        "0.02",
        "-o",
        &folder.at("w.glb"),
    ]);
    assert_eq!(status, Some(0), "{errors}");
    assert!(errors.contains("wave: 1 frames"), "{errors}");
}

/// A grey picture of 64 by 64 pixels: there is nobody in it.
fn grey() -> Vec<u8> {
    let image = muslin_geom::Image::filled(64, 64, [120, 120, 120, 255]);
    muslin_io::png(&image)
}
