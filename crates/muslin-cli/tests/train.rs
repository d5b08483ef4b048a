//! `muslin train` and `muslin animate`, as a user types them.

mod common;

use std::io::{BufRead, BufReader};
use std::process::{Command, Output, Stdio};

use common::{Folder, errors, muslin};

/// A short training of a coarse tee.
const TRAIN: [&str; 14] = [
    "train",
    "--motion",
    "wave",
    "--motion",
    "walk",
    "--mixed",
    "0",
    "--edge",
    "25",
    "--codes",
    "8",
    "--fabric",
    "paper-snug-cotton",
    "-o",
];

fn train(out: &str, more: &[&str]) -> Output {
    muslin(&[&TRAIN[..], &[out], more].concat())
}

#[test]
fn a_garment_is_taught_played_and_led_to_rest() {
    let folder = Folder::new("taught");
    let (model, glb) = (folder.at("tee.muslin"), folder.at("w.glb"));
    let done = train(&model, &["--steps", "40", "--check", "squat"]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    assert_eq!(folder.names(), ["tee.csv", "tee.muslin", "tee.report.json"]);
    let report = std::fs::read_to_string(folder.at("tee.report.json")).expect("written");
    assert!(
        report.contains("\"not_learnt_from\"") && report.contains("built-in squat"),
        "{report}"
    );
    let curve = std::fs::read_to_string(folder.at("tee.csv")).expect("written");
    let cost = |line: &str| {
        line.split(',')
            .nth(1)
            .and_then(|x| x.parse::<f64>().ok())
            .expect("a number")
    };
    let costs: Vec<f64> = curve.lines().skip(1).map(cost).collect();
    assert_eq!(costs.len(), 40);
    assert!(costs[39] < 0.8 * costs[0], "{costs:?}");

    let play = |more: &[&str]| {
        let args = [
            "animate",
            "--model",
            &model,
            "--motion",
            "wave",
            "--seconds",
            "0.2",
            "-o",
            &glb,
        ];
        muslin(&[&args[..], more].concat())
    };
    let done = play(&["--npz", &folder.at("w.npz")]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    assert!(
        report.contains("\"checked\": \"exact\"")
            && report.contains("\"raw_vertices_inside_percent\""),
        "{report}"
    );
    let clip = muslin_io::read_clip(&folder.0.join("w.npz")).expect("it can be read");
    assert_eq!(clip.drape.frames.len(), 6);
    let raw = play(&["--refine", "0"]);
    assert_eq!(raw.status.code(), Some(0), "{}", errors(&raw));
    assert!(errors(&raw).contains("unchecked"), "{}", errors(&raw));
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    assert!(report.contains("\"checked\": \"unchecked\""), "{report}");
}

/// Sends a signal to a process.
fn signal(id: u32, name: &str) {
    let sent = Command::new("kill")
        .args([format!("-{name}"), id.to_string()])
        .status();
    assert!(sent.expect("kill runs").success());
}

#[test]
fn a_stopped_training_goes_on_to_the_same_bytes() {
    let folder = Folder::new("stopped");
    let (whole, broken) = (folder.at("whole.muslin"), folder.at("broken.muslin"));
    let steps = ["--steps", "30"];
    assert_eq!(train(&whole, &steps).status.code(), Some(0));
    let mut run = Command::new(env!("CARGO_BIN_EXE_muslin"));
    run.args(TRAIN).arg(&broken).args(steps);
    run.stderr(Stdio::piped()).stdout(Stdio::null());
    let mut child = run.spawn().expect("the program starts");
    let mut told = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    // Wherever it is stopped, the end is the same; what is not yet done is done again.
    let began = |l: &Result<String, _>| l.as_ref().is_ok_and(|l| l.contains("step "));
    if told.find(began).is_some() {
        signal(child.id(), "INT");
    }
    told.for_each(drop);
    let code = child.wait().expect("a child").code();
    assert!(matches!(code, Some(0 | 130)), "{code:?}");
    let done = train(&broken, &["--steps", "30", "--resume"]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: &str| std::fs::read(p).expect("written");
    assert!(read(&whole) == read(&broken), "the same bytes");
    assert!(
        !folder.names().iter().any(|n| n.ends_with(".part")),
        "{:?}",
        folder.names()
    );
    let other = train(&broken, &["--steps", "31", "--resume"]);
    assert_eq!(
        other.status.code(),
        Some(0),
        "nothing is left of the first to go on from"
    );
}

#[test]
fn what_cannot_be_taught_or_played_is_refused_in_words() {
    let folder = Folder::new("refused");
    let two = muslin(&[
        "train",
        "--garment",
        "tee,trousers",
        "-o",
        &folder.at("a.muslin"),
    ]);
    assert_eq!(two.status.code(), Some(2), "{}", errors(&two));
    assert!(errors(&two).contains("one by one"));
    let kind = muslin(&["train", "-o", &folder.at("a.glb")]);
    assert_eq!(kind.status.code(), Some(2), "{}", errors(&kind));
    let few = train(&folder.at("a.muslin"), &["--poses", "20"]);
    assert_eq!(few.status.code(), Some(3), "{}", errors(&few));
    assert!(errors(&few).contains("too few"), "{}", errors(&few));
    let none = muslin(&[
        "animate",
        "--model",
        &folder.at("no.muslin"),
        "-o",
        &folder.at("a.glb"),
    ]);
    assert_eq!(none.status.code(), Some(5), "{}", errors(&none));
    let bent = folder.put("bent.muslin", b"no model at all");
    let bent = muslin(&["animate", "--model", &bent, "-o", &folder.at("a.glb")]);
    assert_eq!(bent.status.code(), Some(3), "{}", errors(&bent));
    assert!(errors(&bent).contains("muslin train"), "{}", errors(&bent));
}
