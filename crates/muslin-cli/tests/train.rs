//! `muslin train` and `muslin animate`, as a user types them.

mod common;

use std::io::{BufRead, BufReader};
use std::process::{Command, Output, Stdio};

use common::{Folder, errors, muslin, tube, typed};

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
    let more = ["--steps", "40", "--check", "squat", "--picture", "25"];
    let done = train(&model, &more);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let pictures = ["tee.000025.png", "tee.000040.png"];
    assert_eq!(
        folder.names(),
        [&pictures[..], &["tee.csv", "tee.muslin", "tee.report.json"]].concat()
    );
    let [first, last] = pictures.map(|name| {
        let bytes = std::fs::read(folder.at(name)).expect("written");
        assert_eq!(bytes[12..24], *b"IHDR\0\0\x05\0\0\0\x02\x80");
        bytes
    });
    assert!(first != last, "the garment has learnt between them");
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

    // It swings about where it rests, as predicted and as refined.
    let npz = folder.at("w.npz");
    let film = |refine: &str, level: &str| {
        let done = play(&["--refine", refine, "--motion-level", level, "--npz", &npz]);
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let clip = muslin_io::read_clip(&folder.0.join("w.npz"));
        clip.expect("it can be read").drape.frames
    };
    let too_few = play(&["--refine", "4"]);
    assert_eq!(too_few.status.code(), Some(2));
    assert!(
        errors(&too_few).contains("5 at least"),
        "{}",
        errors(&too_few)
    );
    for refine in ["0", "5"] {
        let [still, usual, more] = ["0", "1", "3"].map(|level| film(refine, level));
        assert!(
            still[0] == usual[0] && usual[0] == more[0],
            "they set off alike"
        );
        assert!(still[5] != usual[5] && usual[5] != more[5], "{refine}");
        if refine == "0" {
            let mut swings = [0.0, 0.0];
            for (v, rest) in still[5].iter().enumerate() {
                swings[0] += usual[5][v].distance(*rest);
                swings[1] += more[5][v].distance(*rest);
            }
            assert!((swings[1] / swings[0] - 3.0).abs() < 0.01, "{swings:?}");
        }
    }
}

/// Sends a signal to a process.
fn signal(id: u32, name: &str) {
    let sent = Command::new("kill")
        .args([format!("-{name}"), id.to_string()])
        .status();
    assert!(sent.expect("kill runs").success());
}

/// Starts the program, stops it by a signal as soon as a line `at` which it is told, and waits for its end.
fn interrupted(args: &[&str], at: impl Fn(&str) -> bool) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_muslin"));
    run.args(args).stderr(Stdio::piped()).stdout(Stdio::null());
    let mut child = run.spawn().expect("the program starts");
    let mut told = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let there = |l: &Result<String, _>| l.as_ref().is_ok_and(|l| at(l));
    if told.find(there).is_some() {
        signal(child.id(), "INT");
    }
    told.for_each(drop);
    let code = child.wait().expect("a child").code();
    assert!(matches!(code, Some(0 | 130)), "{code:?}");
}

/// What the first step cost, as a training's curve says.
fn first_cost(folder: &Folder, curve: &str) -> f64 {
    let curve = std::fs::read_to_string(folder.at(curve)).expect("written");
    let first = curve.lines().nth(1).expect("a step");
    let cost = first.split(',').nth(1).and_then(|x| x.parse().ok());
    cost.expect("a cost")
}

#[test]
fn a_stopped_training_goes_on_to_the_same_bytes() {
    let folder = Folder::new("stopped");
    let (whole, broken) = (folder.at("whole.muslin"), folder.at("broken.muslin"));
    let steps = ["--steps", "30"];
    assert_eq!(train(&whole, &steps).status.code(), Some(0));
    // Wherever it is stopped, the end is the same; what is not yet done is done again.
    let args = [&TRAIN[..], &[&broken], &steps].concat();
    interrupted(&args, |l| l.contains("step "));
    let done = train(&broken, &["--steps", "30", "--resume"]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: &str| std::fs::read(p).expect("written");
    assert!(read(&whole) == read(&broken), "the same bytes");
    assert!(
        !folder.names().iter().any(|n| n.ends_with(".part")),
        "{:?}",
        folder.names()
    );
    // What has ended is left as it is; another training begins anew.
    let again = train(&broken, &["--steps", "30", "--resume"]);
    let told = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(
        again.status.success() && told.contains("there already"),
        "{told}"
    );
    assert!(read(&whole) == read(&broken));
    let other = train(&broken, &["--steps", "31", "--resume"]);
    assert_eq!(other.status.code(), Some(0), "{}", errors(&other));
    assert!(errors(&other).contains("nothing to go on from"));
    assert!(read(&whole) != read(&broken));
}

#[test]
fn what_cannot_be_taught_or_played_is_refused_in_words() {
    let folder = Folder::new("refused");
    let two = muslin(&[
        "train",
        "ncs",
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

#[test]
fn one_model_is_taught_for_any_fabric_and_any_body_and_says_whom_it_knows() {
    let folder = Folder::new("any");
    let model = folder.at("any.muslin");
    let how = "train --motion wave --motion walk --edge 25 --codes 8 --steps 10 --mixed 80";
    let taught = |more: &str| {
        let done = typed(&format!("{how} --poses 40 {more} -o {model}"));
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    };
    let play = |more: &str| {
        let out = folder.at("w.glb");
        let done = typed(&format!(
            "animate --model {model} --motion walk --seconds 0.2 --refine 0 --motion-level 0 {more} -o {out}"
        ));
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let clip = muslin_io::read_clip(out.as_ref()).expect("just written");
        let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
        let from = report.find("\"not_taught\"").expect("it says so");
        let list = &report[from..];
        let list = list[..=list.find(']').expect("a list")].replace(char::is_whitespace, "");
        (clip.drape.frames[3].clone(), list)
    };
    taught("--fabric any --shape any");
    let known = "\"not_taught\":[]";
    let usual = play("");
    assert_eq!(usual.1, known);
    let other = play("--fabric cotton-shirting");
    assert_eq!(other.1, known);
    let moved = usual.0.iter().zip(&other.0).map(|(a, b)| a.distance(*b));
    assert!(
        moved.fold(0.0, f64::max) > 1e-5,
        "the network hears of the fabric"
    );
    // Stiffer than any cloth that it met.
    let paper = play("--fabric paper-vdp-cotton");
    assert_eq!(paper.1, "\"not_taught\":[\"fabric\"]");
    assert_eq!(play("--size XXL").1, "\"not_taught\":[\"size\"]");
    taught("--sizes any");
    let (made, large) = (play(""), play("--size L"));
    assert_eq!((made.1.as_str(), large.1.as_str()), (known, known));
    // Around the hem, away from sleeves.
    let mut wide = [0.0; 2];
    for (wide, x) in wide.iter_mut().zip([&made.0, &large.0]) {
        let low = x.iter().map(|p| p.y).fold(f64::MAX, f64::min);
        let hem = || x.iter().filter(|p| p.y < low + 0.1).map(|p| p.x);
        *wide = hem().fold(f64::MIN, f64::max) - hem().fold(f64::MAX, f64::min);
    }
    assert!(
        wide[1] > wide[0] + 0.02,
        "a larger shirt is wider: {wide:?}"
    );
    taught("--fabric any");
    assert_eq!(play("--fabric cotton-shirting").1, known);
    assert_eq!(play("--gender 0.9").1, "\"not_taught\":[\"body\"]");
}

#[test]
fn a_training_begins_with_what_coarser_cloth_has_learnt_and_tells_both_their_sources() {
    let folder = Folder::new("from");
    let (coarse, fine) = (folder.at("coarse.muslin"), folder.at("fine.muslin"));
    let how = "train --motion wave --edge 25 --codes 8 --mixed 80 --poses 40";
    let done = typed(&format!("{how} --steps 40 -o {coarse}"));
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let how = "train --motion wave --edge 18 --codes 8 --mixed 80 --poses 40 --steps 2";
    let stretch = |more: &str| {
        let done = typed(&format!("{how} {more} -o {fine}"));
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        first_cost(&folder, "fine.csv")
    };
    let (new, begun) = (stretch(""), stretch(&format!("--from {coarse}")));
    assert!(begun < 0.7 * new, "{begun} {new}");
    let done = typed(&format!(
        "{how} --motion walk --codes 9 --from {coarse} -o {fine}"
    ));
    assert_eq!(done.status.code(), Some(2), "an argument twice");
    let done = typed(&format!(
        "train --motion wave --edge 18 --codes 9 --poses 40 --steps 2 --from {coarse} -o {fine}"
    ));
    assert_eq!(done.status.code(), Some(3), "{}", errors(&done));
    assert!(errors(&done).contains("network"), "{}", errors(&done));
    let done = typed(&format!("train pbns --from {coarse} -o {fine}"));
    assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
}

#[test]
fn a_training_begins_coarse_and_goes_on_to_the_same_bytes_wherever_it_was_stopped() {
    let folder = Folder::new("coarse");
    let (whole, broken) = (folder.at("whole.muslin"), folder.at("broken.muslin"));
    let how = "train --motion wave --edge 18 --codes 8 --mixed 80 --poses 40 --steps 20";
    let first = |more: &str| {
        let done = typed(&format!("{how} {more} -o {whole}"));
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        first_cost(&folder, "whole.csv")
    };
    let (new, begun) = (first(""), first("--coarse 25"));
    assert!(begun < 0.7 * new, "{begun} {new}");
    let report = std::fs::read_to_string(folder.at("whole.report.json")).expect("written");
    assert!(report.contains("\"learnt_coarsely\""), "{report}");
    let read = |p: &str| std::fs::read(p).expect("written");
    for in_coarse in [true, false] {
        let args = how.split(' ').chain(["--coarse", "25", "-o", &broken]);
        interrupted(&args.collect::<Vec<_>>(), |l| {
            l.contains("step ") && l.contains("coarse") == in_coarse
        });
        let done = typed(&format!("{how} --coarse 25 --resume -o {broken}"));
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        assert!(read(&whole) == read(&broken), "{in_coarse}: the same bytes");
        let names = folder.names();
        assert!(!names.iter().any(|n| n.ends_with(".part")), "{names:?}");
    }
    for (wrong, of) in [
        ("--coarse 18", "no coarser"),
        ("--coarse 25 --from x.muslin", "not with both"),
        ("--coarse 80", "--coarse"),
    ] {
        let done = typed(&format!("{how} {wrong} -o {broken}"));
        assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
        assert!(errors(&done).contains(of), "{}", errors(&done));
    }
}

/// A short training of a published system on a coarse tee.
fn published(system: &str, out: &str, more: &[&str]) -> Output {
    let args = [
        "train", system, "--motion", "wave", "--poses", "16", "--edge", "25", "-o", out,
    ];
    muslin(&[&args[..], more].concat())
}

/// Frames that a model gives for a short wave, with more arguments.
fn raw(folder: &Folder, model: &str, more: &[&str]) -> muslin_io::Clip {
    let (glb, npz) = (folder.at("w.glb"), folder.at("w.npz"));
    let args = [
        "animate",
        "--model",
        model,
        "--motion",
        "wave",
        "--seconds",
        "0.2",
        "--refine",
        "0",
        "-o",
        &glb,
        "--npz",
        &npz,
    ];
    let done = muslin(&[&args[..], more].concat());
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    muslin_io::read_clip(&folder.0.join("w.npz")).expect("it can be read")
}

#[test]
fn a_file_has_the_numbers_that_are_asked_for_and_plays_alike_in_all_of_them() {
    let folder = Folder::new("weights");
    let model = folder.at("tee.muslin");
    let written = |more: &[&str], kind: &str| {
        let done = train(&model, &[&["--steps", "3"], more].concat());
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let report = std::fs::read_to_string(folder.at("tee.report.json")).expect("written");
        let told = format!("\"shapes_in\": \"{kind}\"");
        assert!(report.contains(&told), "{report}");
        let bytes = std::fs::metadata(&model).expect("written").len();
        (bytes, raw(&folder, &model, &[]).drape.frames)
    };
    let single = written(&["--weights", "f32"], "32-bit floats");
    let half = written(&["--weights", "f16"], "16-bit floats");
    let usual = written(&[], "12-bit steps");
    let eight = written(&["--weights", "i8"], "8-bit steps");
    assert!(single.0 > half.0 && half.0 > usual.0 && usual.0 > eight.0);
    for (other, most) in [(&half.1, 2e-5), (&usual.1, 1e-4), (&eight.1, 6e-4)] {
        let pairs = single.1.iter().flatten().zip(other.iter().flatten());
        let worst = pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(0.0 < worst && worst < most, "{worst} of {most}");
    }
    let given = written(&["--skinning", "given"], "12-bit steps");
    assert!(given.1 != usual.1);
    let learnt = written(&["--skinning", "learnt"], "12-bit steps");
    assert!(learnt.1 == usual.1, "learnt if nothing is said");
    for option in [["--relax", "2"], ["--device", "cuda"]] {
        let done = train(&model, &[&["--skinning", "learnt"], &option[..]].concat());
        assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
        assert!(
            errors(&done).contains("--skinning learnt"),
            "{}",
            errors(&done)
        );
    }
    // Where shapes are large, bytes are too coarse.
    let coarse = ["--steps", "40", "--skinning", "given", "--weights", "i8"];
    let done = train(&model, &coarse);
    assert!(errors(&done).contains("12-bit steps"), "{}", errors(&done));
    let refused = published("pbns", &model, &["--weights", "i8"]);
    assert_eq!(refused.status.code(), Some(2), "{}", errors(&refused));
}

#[test]
fn published_systems_are_taught_and_played_and_motion_has_a_level_where_it_is_told_apart() {
    let folder = Folder::new("published");
    for system in ["pbns", "snug", "ncs"] {
        let model = folder.at(&format!("{system}.muslin"));
        let own: &[&str] = match system {
            "pbns" => &["--mixed", "0", "--skinning", "learnt", "--stop-gradient"],
            "snug" => &["--shape", "any"],
            _ => &["--stretch", "stvk", "--skinning", "learnt"],
        };
        let done = published(system, &model, &[&["--steps", "2"], own].concat());
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let report = std::fs::read_to_string(folder.at(&format!("{system}.report.json")));
        assert!(
            report
                .expect("written")
                .contains(&format!("\"system\": \"{system}\""))
        );
        let curve = std::fs::read_to_string(folder.at(&format!("{system}.csv")));
        assert_eq!(curve.expect("written").lines().count(), 3);
        let frames = raw(&folder, &model, &[]).drape.frames;
        assert_eq!(frames.len(), 6);
        assert!(frames.iter().flatten().all(|p| p.is_finite()));
        match system {
            "ncs" => {
                let less = raw(&folder, &model, &["--motion-level", "0.5"])
                    .drape
                    .frames;
                assert!(less[0] == frames[0] && less[5] != frames[5]);
            }
            _ => {
                let args = ["animate", "--model", &model, "--motion-level", "0.5"];
                let none = muslin(&args);
                assert_eq!(none.status.code(), Some(2), "{}", errors(&none));
                assert!(errors(&none).contains("train ncs"), "{}", errors(&none));
            }
        }
    }
    for (model, not_taught) in [("snug", "[]"), ("ncs", "[\"body\"]")] {
        let model = folder.at(&format!("{model}.muslin"));
        raw(&folder, &model, &["--weight", "90"]);
        let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
        assert!(
            report.contains(&format!("\"not_taught\": {not_taught}")),
            "{report}"
        );
    }
    let other = [
        "animate",
        "--model",
        &folder.at("snug.muslin"),
        "--fps",
        "24",
        "--refine",
        "0",
    ];
    let glb = folder.at("slow.glb");
    let done = muslin(&[&other[..], &["--seconds", "0.1", "-o", &glb]].concat());
    assert!(errors(&done).contains("taught at 30"), "{}", errors(&done));
}

#[test]
fn a_published_training_that_was_stopped_goes_on_to_the_same_bytes() {
    let folder = Folder::new("published-stopped");
    let (whole, broken) = (folder.at("whole.muslin"), folder.at("broken.muslin"));
    let steps = ["--steps", "6", "--mixed", "0"];
    assert_eq!(published("pbns", &whole, &steps).status.code(), Some(0));
    let args = ["train", "pbns", "--motion", "wave", "--poses", "16"];
    let args = [&args[..], &["--edge", "25", "-o", &broken], &steps].concat();
    interrupted(&args, |l| l.contains("garment"));
    let done = published("pbns", &broken, &[&steps[..], &["--resume"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: &str| std::fs::read(p).expect("written");
    assert!(read(&whole) == read(&broken), "the same bytes");
}

#[test]
fn options_of_another_trainer_are_refused_by_name() {
    let folder = Folder::new("other-trainer");
    let out = folder.at("a.muslin");
    for (system, option, value) in [
        ("pbns", "--codes", "8"),
        ("snug", "--width", "64"),
        ("snug", "--mixed", "9"),
        ("pbns", "--layers", "5"),
        ("snug", "--augment", "0.1"),
        ("ncs", "--warm", "5"),
        ("pbns", "--stretch", "stvk"),
        ("pbns", "--fairness", "1"),
        ("pbns", "--fabric", "any"),
        ("ncs", "--shape", "any"),
        ("snug", "--sizes", "any"),
        ("ncs", "--coarse", "25"),
        ("snug", "--device", "cuda"),
        ("ncs", "--garment", "shorts,tee"),
    ] {
        let done = published(system, &out, &[option, value]);
        assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
        assert!(errors(&done).contains(option), "{}", errors(&done));
    }
    for (system, options) in [
        ("snug", &["--skinning", "learnt"][..]),
        ("ncs", &["--stop-gradient"]),
    ] {
        let done = published(system, &out, options);
        assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
        assert!(errors(&done).contains(options[0]), "{}", errors(&done));
    }
    let done = published("vae", &out, &[]);
    assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
}

#[test]
fn a_device_that_is_not_there_is_said_and_cores_are_named() {
    let folder = Folder::new("no-device");
    let out = folder.at("a.muslin");
    let done = train(&out, &["--steps", "1", "--device", "cuda"]);
    if done.status.code() == Some(0) {
        println!("skipped: there is a CUDA device");
        return;
    }
    assert_eq!(done.status.code(), Some(4), "{}", errors(&done));
    let said = errors(&done);
    assert!(
        said.contains("CUDA") && said.contains("--device cpu"),
        "{said}"
    );
    assert!(folder.names().is_empty(), "{:?}", folder.names());
    let done = train(&out, &["--steps", "1", "--device", "cpu"]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.at("a.report.json")).expect("written");
    assert!(
        report.contains("\"device\": \"") && report.contains("core"),
        "{report}"
    );
}

#[test]
fn an_outfit_is_taught_in_layers_and_its_garments_are_played_one_over_the_other() {
    let folder = Folder::new("layers");
    let out = folder.at("look.muslin");
    let more = ["--garment", "shorts,tee", "--steps", "3", "--mixed", "0"];
    let done = published("pbns", &out, &more);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let files = [
        "look.csv",
        "look.report.json",
        "look.shorts.muslin",
        "look.tee.muslin",
    ];
    assert_eq!(folder.names(), files);
    let (shorts, tee) = (folder.at(files[2]), folder.at(files[3]));
    let worn = |models: [&str; 2]| {
        let (glb, npz) = (folder.at("w.glb"), folder.at("w.npz"));
        let [inner, outer] = models;
        let args = [
            "animate",
            "--model",
            inner,
            "--model",
            outer,
            "--motion",
            "wave",
            "--seconds",
            "0.2",
        ];
        muslin(&[&args[..], &["--refine", "0", "-o", &glb, "--npz", &npz]].concat())
    };
    let done = worn([&shorts, &tee]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    assert!(report.contains("\"over\": \"shorts\""), "{report}");
    let layered = ["w.shorts.npz", "w.tee.npz"]
        .map(|name| muslin_io::read_clip(&folder.0.join(name)).expect("one file a garment"));
    assert!(layered.iter().all(|c| c.drape.frames.len() == 6));
    // Each plays alone as well, and the inner one as it did in the outfit.
    let alone = raw(&folder, &shorts, &[]);
    assert!(alone.drape.frames == layered[0].drape.frames);
    // An outfit is of one size.
    let other = folder.at("other.muslin");
    let large = [
        "--garment",
        "tee",
        "--size",
        "L",
        "--steps",
        "1",
        "--mixed",
        "0",
    ];
    let done = published("pbns", &other, &large);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let done = worn([&shorts, &other]);
    assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
    assert!(errors(&done).contains("another size"), "{}", errors(&done));
}

#[test]
fn our_own_network_learns_an_outfit_whose_garments_swing_and_are_judged_together() {
    let folder = Folder::new("own-layers");
    let out = folder.at("look.muslin");
    let outfit = ["--garment", "shorts,tee", "--steps", "3"];
    let done = train(&out, &outfit);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let models = ["look.shorts.muslin", "look.tee.muslin"];
    for (name, over) in models.into_iter().zip(["", "shorts"]) {
        let bytes = std::fs::read(folder.at(name)).expect("written");
        let weights = muslin_io::read_weights(name, &bytes).expect("whole");
        assert_eq!(weights.notes["over"], over);
        assert!(
            weights.arrays.keys().any(|k| k.starts_with("sway.")),
            "{name} swings"
        );
        let licence = &weights.notes["licence"];
        assert_eq!(
            licence,
            "body CC0; garment Apache-2.0 OR MIT; built-in motions Apache-2.0 OR MIT"
        );
    }
    let [shorts, tee] = models.map(|name| folder.at(name));
    let (glb, npz) = (folder.at("w.glb"), folder.at("w.npz"));
    let args = [
        "animate",
        "--model",
        &shorts,
        "--model",
        &tee,
        "--motion",
        "wave",
        "--seconds",
        "0.2",
        "--refine",
        "0",
        "-o",
        &glb,
        "--npz",
        &npz,
    ];
    let done = muslin(&args);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    // Both files are one outfit to the judge, by the name that was asked for.
    let done = muslin(&["evaluate", &npz]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(said.contains("wrong order layer percent"), "{said}");
    for more in [
        &["--fabric", "any"][..],
        &["--from", &tee],
        &["--coarse", "25"],
    ] {
        let args = [&["train", "-o", &out], &outfit[..], more].concat();
        let done = muslin(&args);
        assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
        let said = errors(&done);
        assert!(
            said.contains(more[0]) && said.contains("one by one"),
            "{said}"
        );
    }
}

#[test]
fn pbns_learns_to_resize_a_garment_and_plays_it_on_others() {
    let folder = Folder::new("resized");
    let model = folder.at("tee.muslin");
    let any = [
        "--shape", "any", "--sizes", "any", "--steps", "3", "--mixed", "0",
    ];
    let done = published("pbns", &model, &any);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let wide = raw(&folder, &model, &["--weight", "80", "--size", "XL"]);
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    assert!(report.contains("\"not_taught\": []"), "{report}");
    let own = raw(&folder, &model, &[]);
    assert!(wide.drape.frames[0] != own.drape.frames[0]);
}

#[test]
fn pieces_of_a_file_are_taught_one_by_one_by_their_numbers() {
    let folder = Folder::new("pieces");
    let [inner, outer] = [0.0, 0.03].map(|more| tube((0.22 + more, 0.125 + more), 0.5, 0));
    let file = folder.put("two.obj", format!("{inner}{outer}").as_bytes());
    let model = folder.at("two.muslin");
    let teach = |garment: &str| {
        let line = format!(
            "train --garment {garment} --motion walk --motion wave --mixed 0 --steps 4 --edge 25 --codes 4 -o {model}"
        );
        typed(&line)
    };
    let both = teach(&file);
    assert_eq!(both.status.code(), Some(2), "{}", errors(&both));
    for part in ["error[several-pieces]", "two-1, two-2", "FILE.obj#1"] {
        assert!(errors(&both).contains(part), "{part}: {}", errors(&both));
    }
    let third = teach(&format!("{file}#3"));
    assert!(
        errors(&third).contains("no-such-piece"),
        "{}",
        errors(&third)
    );
    let second = teach(&format!("{file}#2"));
    assert_eq!(second.status.code(), Some(0), "{}", errors(&second));
    let glb = folder.at("walk.glb");
    let played = typed(&format!(
        "animate --model {model} --motion walk --seconds 0.2 --refine 0 -o {glb}"
    ));
    assert_eq!(played.status.code(), Some(0), "{}", errors(&played));
}
