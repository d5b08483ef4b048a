//! `muslin evaluate`, as a user types it.

mod common;

use std::path::Path;
use std::process::Output;

use common::{Folder, muslin};
use muslin_io::npz::{Array, write};

fn evaluate(args: &[&str]) -> Output {
    muslin(&[&["evaluate"], args].concat())
}

/// A square of two triangles that falls for four frames, `lower` metres below.
fn falling(lower: f32) -> Vec<u8> {
    falls(lower, &[("fps", Array::number(60.0))])
}

fn falls(lower: f32, more: &[(&str, Array)]) -> Vec<u8> {
    let corner = |t: usize, k: usize| {
        let time = t as f32 / 60.0;
        let height = 2.0 - 4.905 * time * time - lower;
        [(k % 2) as f32 * 0.1, height, (k / 2) as f32 * 0.1]
    };
    let cloth = (0..4)
        .flat_map(|t| (0..4).flat_map(move |k| corner(t, k)))
        .collect();
    let own = [
        ("cloth", Array::f32(&[4, 4, 3], cloth)),
        ("faces", Array::int(&[2, 3], vec![0, 1, 2, 1, 3, 2])),
    ];
    write(&[&own, more].concat()).expect("finite")
}

#[test]
fn a_file_without_its_rate_is_remarked_on() {
    let folder = Folder::new("timeless");
    for (bytes, is_told) in [(falls(0.0, &[]), true), (falling(0.0), false)] {
        let out = evaluate(&[&folder.put("walk.npz", &bytes)]);
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(0), "{told}");
        assert_eq!(told.contains("frames a second (`fps`)"), is_told, "{told}");
    }
}

#[test]
fn a_file_is_judged_and_its_report_lies_beside_it() {
    let folder = Folder::new("judged");
    let file = folder.put("walk.npz", &falling(0.0));
    let frames = folder.0.join("walk.csv");
    let out = evaluate(&[&file, "--frames", &frames.to_string_lossy()]);
    let table = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(
        out.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    for line in [
        "strain J",
        "edge triangle crossings a frame",
        "acceleration mean m s2",
        "first frame",
    ] {
        assert!(table.contains(line), "{line} is missing:\n{table}");
    }
    let report = std::fs::read_to_string(folder.0.join("walk.evaluation.json")).expect("written");
    assert!(
        report.contains("\"edge_max\"") && report.contains("\"frames\": 4"),
        "{report}"
    );
    let lines = std::fs::read_to_string(frames).expect("written");
    assert!(
        lines.starts_with("frame,time_s,strain_J") && lines.lines().count() == 5,
        "{lines}"
    );
}

#[test]
fn another_answer_is_compared_and_json_is_printed() {
    let folder = Folder::new("against");
    let (a, b) = (
        folder.put("a.npz", &falling(0.0)),
        folder.put("b.npz", &falling(0.01)),
    );
    let report = folder.0.join("r.json").display().to_string();
    let out = evaluate(&[&a, "--against", &b, "--json", "-o", &report]);
    let json = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(
        out.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    assert!(
        json.contains("\"distance_mean_mm\": 10.0") || json.contains("\"distance_mean_mm\": 9.99"),
        "{json}"
    );
    assert!(Path::new(&report).exists() && !folder.0.join("a.evaluation.json").exists());
}

#[test]
fn what_cloth_does_beyond_a_still_body_is_told_here_and_there() {
    let folder = Folder::new("still");
    let put = |name: &str, aside: f32| folder.put(name, &falling(aside));
    let (a, b, still) = (
        put("a.npz", 0.01),
        put("b.npz", 0.03),
        put("still.npz", 0.0),
    );
    let out = evaluate(&[&a, "--against", &b, "--still", &still, "--json"]);
    assert_eq!(out.status.code(), Some(0));
    let json = String::from_utf8_lossy(&out.stdout).into_owned();
    let told = |name: &str| -> f64 {
        let after = json.split_once(&format!("\"{name}\": "));
        let number = after.and_then(|a| a.1.split([',', '\n', '}']).next());
        number.and_then(|n| n.trim().parse().ok()).expect(name)
    };
    assert!((told("dynamic_content_mm") - 10.0).abs() < 1e-3, "{json}");
    assert!(
        (told("their_dynamic_content_mm") - 30.0).abs() < 1e-3,
        "{json}"
    );
    // What never changes is no swing.
    assert!(told("swing_mm") < 1e-3, "{json}");
    let gone = evaluate(&[&a, "--still", "gone.npz"]);
    assert_eq!(gone.status.code(), Some(5));
}

#[test]
fn bad_files_end_with_their_code_a_hint_and_no_report() {
    let folder = Folder::new("bad");
    let whole = falling(0.0);
    let cases = [
        (folder.put("text.npz", b"nothing of the kind"), 3),
        (folder.put("text.docx", b"nothing of the kind"), 4),
        (folder.put("cut.npz", &whole[..whole.len() / 2]), 3),
        (folder.put("glb.glb", b"glTF\x02\0\0\0"), 3),
        (folder.0.join("missing.npz").display().to_string(), 5),
        (folder.0.display().to_string(), 3),
    ];
    for (file, want) in &cases {
        let out = evaluate(&[file]);
        let errors = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(*want), "{file}: {errors}");
        assert!(errors.contains("error["), "{file}: {errors}");
    }
    let left = std::fs::read_dir(&folder.0).expect("the folder").flatten();
    assert!(
        left.filter(|e| e.file_name().to_string_lossy().contains("evaluation"))
            .count()
            == 0
    );
}

#[test]
fn the_solver_is_somebody_to_hold_a_file_against() {
    let folder = Folder::new("solver");
    let ball = Array::f32(
        &[4, 6, 3],
        (0..4)
            .flat_map(|_| {
                let tip = |k: usize, s: f32| {
                    let mut tip = [0.05, 1.5, 0.05];
                    tip[k] += s;
                    tip
                };
                [
                    (0, 0.2),
                    (0, -0.2),
                    (1, 0.2),
                    (1, -0.2),
                    (2, 0.2),
                    (2, -0.2),
                ]
                .into_iter()
                .flat_map(move |(k, s)| tip(k, s))
            })
            .collect(),
    );
    let sides: [[i64; 3]; 8] = [
        [2, 4, 0],
        [2, 0, 5],
        [2, 5, 1],
        [2, 1, 4],
        [3, 0, 4],
        [3, 5, 0],
        [3, 1, 5],
        [3, 4, 1],
    ];
    let corners = |t: usize| {
        (0..4).flat_map(move |k: usize| {
            [
                (k % 2) as f32 * 0.1,
                1.72 + 0.01 * t as f32,
                (k / 2) as f32 * 0.1,
            ]
        })
    };
    let arrays = [
        (
            "cloth",
            Array::f32(&[4, 4, 3], (0..4).flat_map(corners).collect()),
        ),
        ("faces", Array::int(&[2, 3], vec![0, 2, 1, 1, 2, 3])),
        ("fps", Array::number(30.0)),
        ("body", ball),
        (
            "body_faces",
            Array::int(&[8, 3], sides.as_flattened().to_vec()),
        ),
        ("fabric", Array::text(vec!["denim".into()])),
    ];
    let file = folder.put("lies.npz", &write(&arrays).expect("finite"));
    for (whom, fabric, want) in [
        ("minimiser", None, "\"fabric\": \"denim\""),
        (
            "simulator",
            Some("silk-charmeuse"),
            "\"fabric\": \"silk-charmeuse\"",
        ),
    ] {
        let mut args = vec![&file[..], "--against", whom, "--json"];
        if whom == "minimiser" {
            args.extend(["--samples", "2"]);
        }
        args.extend(fabric.iter().flat_map(|f| ["--fabric", f]));
        let out = evaluate(&args);
        let json = String::from_utf8_lossy(&out.stdout).into_owned();
        let errors = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(0), "{errors}");
        for part in [
            want,
            &format!("\"by\": \"{whom}\""),
            "\"energy_gap_J\"",
            "\"distance_p95_mm\"",
        ] {
            assert!(json.contains(part), "{part} is missing:\n{json}");
        }
    }
    let out = evaluate(&[&file, "--against", "simulator", "--samples", "2"]);
    let errors = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{errors}");
    assert!(errors.contains("--samples"), "{errors}");
    let bare = folder.put("bare.npz", &falling(0.0));
    let out = evaluate(&[&bare, "--against", "minimiser"]);
    let errors = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(3), "{errors}");
    assert!(
        errors.contains("no-body") && errors.contains("hint:"),
        "{errors}"
    );
}
