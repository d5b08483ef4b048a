//! `muslin simulate`, as a user types it.

mod common;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use common::{Folder, errors, muslin, typed};
use muslin_io::npz::{Array, write};

/// A short simulation of a coarse tee, and more arguments.
fn wave(out: &str, more: &[&str]) -> Output {
    let args = [
        "simulate", "--motion", "wave", "--edge", "25", "--fps", "30",
    ];
    muslin(&[&args[..], &["--seconds", "0.2", "-o", out], more].concat())
}

#[test]
fn an_animation_comes_with_its_report_arrays_and_caches_that_can_be_judged() {
    let folder = Folder::new("all");
    let (out, npz, caches) = (folder.at("w.glb"), folder.at("a.npz"), folder.at("caches"));
    let done = wave(&out, &["--npz", &npz, "--pc2", &caches, "--outfit", "tee"]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    for stage in [
        "[1/5] body",
        "[2/5] motion",
        "[3/5] outfit",
        "[4/5] cloth",
        "[5/5] write",
    ] {
        assert!(
            errors(&done).contains(stage),
            "{stage} is not told:\n{}",
            errors(&done)
        );
    }
    assert!(
        errors(&done).contains("of them for frames"),
        "memory is told before the work"
    );
    assert_eq!(
        folder.names(),
        ["a.npz", "caches", "w.glb", "w.report.json"]
    );
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    for figure in [
        "\"frames\": 6",
        "\"limit_percent\"",
        "\"frame_median_ms\"",
        "\"seed\"",
        "\"licences\"",
    ] {
        assert!(report.contains(figure), "{figure} is missing:\n{report}");
    }
    let read = |p: &str| muslin_io::read_clip(Path::new(p)).expect("it can be read");
    let clips = [read(&out), read(&npz), read(&caches)];
    for clip in &clips {
        assert_eq!((clip.drape.frames.len(), clip.drape.fps.round()), (6, 30.0));
    }
    let tee = &clips[1].drape.frames[5];
    let far = |other: &[_]| {
        tee.iter()
            .zip(other)
            .map(|(a, b): (_, &_)| a.distance(*b))
            .fold(0.0, f64::max)
    };
    assert_eq!(far(&clips[2].drape.frames[5]), 0.0);
    assert!(far(&clips[0].drape.frames[5]) < 1e-4);
}

#[test]
fn a_film_follows_the_body_or_goes_around_it() {
    let folder = Folder::new("film");
    let shot = |name: &str, more: &[&str]| {
        let done = wave(&folder.at(&format!("{name}.glb")), more);
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        ["png", "film.png"]
            .map(|kind| std::fs::read(folder.at(&format!("{name}.{kind}"))).expect("written"))
    };
    let before = shot("a", &["--outfit", "tee", "--picture"]);
    let around = shot("b", &["--outfit", "tee", "--picture", "--turn"]);
    assert!(before[0] == around[0], "the same still");
    assert!(before[1] != around[1], "another film");
    assert!(around[1].windows(4).any(|w| w == b"acTL"), "animated");
    for alone in [&["--turn"][..], &["--backdrop", "white"]] {
        let alone = wave(&folder.at("c.glb"), &[&["--outfit", "tee"], alone].concat());
        assert_eq!(alone.status.code(), Some(2), "{}", errors(&alone));
        assert!(errors(&alone).contains("--picture"), "{}", errors(&alone));
    }
}

#[test]
fn an_animation_of_a_file_moves_another_body() {
    let folder = Folder::new("other");
    let (out, npz, again) = (folder.at("w.glb"), folder.at("a.npz"), folder.at("b.npz"));
    let done = wave(&out, &["--npz", &npz]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let line =
        format!("simulate --edge 25 --fps 30 --motion {out}#wave --npz {again} -o {out}.glb");
    let done = typed(&line);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: &str| muslin_io::read_clip(Path::new(p)).expect("it can be read");
    let (first, second) = (read(&npz), read(&again));
    assert_eq!((first.body.len(), second.body.len()), (6, 6));
    // Retargeted, and so not to the bit.
    for (a, b) in first.body.iter().zip(&second.body) {
        let off = a.iter().zip(b).map(|(a, b)| a.distance(*b)).sum::<f64>() / a.len() as f64;
        assert!(off < 0.02, "{off} m on the mean");
    }
    let none = typed(&format!("simulate --motion {out}#jump -o {out}.glb"));
    assert_eq!(none.status.code(), Some(3));
    assert!(errors(&none).contains("allowed wave"), "{}", errors(&none));
}

#[test]
fn a_baked_animation_has_bones_or_mixed_targets_and_says_how_far_off_it_is() {
    let folder = Folder::new("bake");
    for (how, farthest) in [("bones:24", 0.02), ("morphs:5", 2e-3)] {
        let (out, npz) = (folder.at("w.glb"), folder.at("a.npz"));
        let done = wave(&out, &["--npz", &npz, "--bake", how, "--outfit", "tee"]);
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
        for figure in ["off_mean_mm", "off_p99_mm", "pairs_through_shown_skin"] {
            assert!(report.contains(figure), "{figure} is missing:\n{report}");
        }
        let bytes = std::fs::read(&out).expect("written");
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("tee handle 0"), "{how}: bones of its own");
        assert_eq!(text.contains("\"targets\""), how == "morphs:5", "{how}");
        let read = |p: &str| muslin_io::read_clip(Path::new(p)).expect("it can be read");
        let (baked, all) = (read(&out), read(&npz));
        assert_eq!(baked.drape.faces, all.drape.faces);
        let mut off = 0.0f64;
        for (a, b) in baked.drape.frames.iter().zip(&all.drape.frames) {
            let pairs = a.iter().zip(b);
            off = pairs.map(|(a, b)| a.distance(*b)).fold(off, f64::max);
        }
        assert!(off > 1e-5 && off < farthest, "{how}: {off} m");
        assert!(
            baked.body_faces.len() + 200 < all.body_faces.len(),
            "{how}: covered skin is left out"
        );
    }
    let done = wave(&folder.at("x.glb"), &["--bake", "vat"]);
    assert_eq!(done.status.code(), Some(2));
    assert!(errors(&done).contains("morphs[:N]"), "{}", errors(&done));
}

#[test]
fn a_size_is_cut_for_others_than_the_wearer_and_says_how_much_wider_it_is() {
    let folder = Folder::new("size");
    let width = |size: &str| {
        let (out, npz) = (folder.at("w.glb"), folder.at("a.npz"));
        let done = wave(&out, &["--npz", &npz, "--outfit", "tee", "--size", size]);
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
        assert!(report.contains(&format!("\"label\": \"{}\"", size.to_uppercase())));
        assert!(report.contains("wider_than_wearer_chest_cm"), "{report}");
        let clip = muslin_io::read_clip(Path::new(&npz)).expect("it can be read");
        let area = clip
            .corners
            .iter()
            .map(|c| 0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]).abs());
        area.sum::<f64>()
    };
    let (medium, larger) = (width("m"), width("XXL"));
    assert!(
        (1.1..1.6).contains(&(larger / medium)),
        "{medium} {larger} m2"
    );
    let none: [(&[&str], i32, &str); 2] = [
        (&["--size", "38"], 2, "XXL"),
        (
            &["--size", "XS", "--height", "215", "--gender", "male"],
            3,
            "chest",
        ),
    ];
    for (more, code, what) in none {
        let done = wave(&folder.at("x.glb"), more);
        assert_eq!(done.status.code(), Some(code), "{}", errors(&done));
        assert!(errors(&done).contains(what), "{}", errors(&done));
    }
}

#[test]
fn the_same_command_gives_the_same_bytes_and_json_when_asked() {
    let folder = Folder::new("twice");
    let run = |name: &str| {
        let done = wave(&folder.at(name), &["--json", "-q"]);
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let json = String::from_utf8_lossy(&done.stdout).into_owned();
        assert!(json.trim_start().starts_with('{'), "{json}");
        std::fs::read(folder.at(name)).expect("it was written")
    };
    assert!(run("a.glb") == run("b.glb"), "two runs differ");
}

/// Starts a simulation of 70 frames and kills it as it stands: at a line that it tells, or once `part` is there.
fn killed(folder: &Folder, args: &[&str], (line, part): (&str, Option<&str>)) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_muslin"));
    run.args(args).stderr(Stdio::piped()).stdout(Stdio::null());
    let mut child = run.spawn().expect("the program starts");
    let mut told = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let there = |l: &std::io::Result<String>| l.as_ref().is_ok_and(|l| l.contains(line));
    assert!(told.find(there).is_some(), "{line} is not told");
    let ended = |child: &mut Child| child.try_wait().expect("a child").is_some();
    while part.is_some_and(|p| !folder.0.join(p).exists()) && !ended(&mut child) {
        std::thread::yield_now();
    }
    child.kill().expect("it is ours");
    child.wait().expect("a child");
}

#[test]
fn killed_at_any_moment_it_leaves_nothing_half_written_and_goes_on_to_the_same_bits() {
    let folder = Folder::new("killed");
    let (whole, out) = (folder.at("whole.glb"), folder.at("w.glb"));
    let args = |out| {
        let how = "simulate --motion wave --edge 25 --fps 30 --seconds 2.3 -o";
        how.split(' ').chain([out]).collect::<Vec<&str>>()
    };
    let done = muslin(&args(&whole));
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let moments = [
        ("[2/5]", None),
        ("[3/5]", Some("w.glb.part")),
        ("[4/5]", None),
    ];
    for moment in moments {
        let resumed = [&args(&out)[..], &["--resume"]].concat();
        killed(&folder, &resumed, moment);
        // Either all is there or nothing but what is kept to go on from.
        let names = folder.names();
        let is_there = names.iter().any(|n| n == "w.glb");
        let report = names.iter().any(|n| n == "w.report.json");
        assert!(
            is_there == report || moment.0 == "[4/5]",
            "{moment:?}: {names:?}"
        );
        if is_there {
            assert!(muslin_io::read_clip(Path::new(&out)).is_ok(), "{moment:?}");
        }
    }
    let done = muslin(&[&args(&out)[..], &["--resume"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: &str| std::fs::read(p).expect("it was written");
    assert!(read(&out) == read(&whole), "they differ");
    // What has ended is not done again, unless some of it is gone.
    let again = muslin(&[&args(&out)[..], &["--resume"]].concat());
    let told = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(told.contains("there already"), "{told}{}", errors(&again));
    std::fs::write(&out, "").expect("our own file");
    let again = muslin(&[&args(&out)[..], &["--resume"]].concat());
    assert_eq!(again.status.code(), Some(0), "{}", errors(&again));
    assert!(read(&out) == read(&whole), "they differ");
    assert!(
        !folder.names().iter().any(|n| n.ends_with(".part")),
        "{:?}",
        folder.names()
    );
}

/// A stick figure that stands, in the words of a recording.
fn recording() -> String {
    let joint = |name: &str, at: [f64; 3], inner: &str| {
        let [x, y, z] = at;
        let inner = match inner {
            "" => "End Site { OFFSET 0 -10 0 }",
            inner => inner,
        };
        format!(
            "JOINT {name} {{ OFFSET {x} {y} {z} CHANNELS 3 Zrotation Xrotation Yrotation {inner} }}\n"
        )
    };
    let leg = |side: &str, x: f64| {
        let foot = joint(
            &format!("{side}Foot"),
            [0.0, -40.0, 0.0],
            "End Site { OFFSET 0 -8 12 }",
        );
        let shin = joint(&format!("{side}Leg"), [0.0, -42.0, 0.0], &foot);
        joint(&format!("{side}UpLeg"), [x, 0.0, 0.0], &shin)
    };
    let arm = |side: &str, s: f64| {
        let hand = joint(&format!("{side}Hand"), [s * 12.0, -21.0, 0.0], "");
        let fore = joint(&format!("{side}ForeArm"), [s * 14.0, -24.0, 0.0], &hand);
        joint(&format!("{side}Arm"), [s * 17.0, -6.0, 0.0], &fore)
    };
    let upper = [
        arm("Left", 1.0),
        arm("Right", -1.0),
        joint("Head", [0.0, 10.0, 0.0], ""),
    ]
    .concat();
    let body = [
        leg("Left", 9.0),
        leg("Right", -9.0),
        joint("Neck", [0.0, 52.0, 0.0], &upper),
    ]
    .concat();
    let root = format!(
        "ROOT Hips {{ OFFSET 0 0 0 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n{body} }}"
    );
    let joints = root.matches("CHANNELS 3").count();
    let frame = |k: usize| format!("0 90 {} 0 0 0{}\n", k, " 0".repeat(3 * joints));
    let frames: String = (0..6).map(frame).collect();
    format!("HIERARCHY\n{root}\nMOTION\nFrames: 6\nFrame Time: 0.0333333\n{frames}")
}

#[test]
fn a_recording_moves_the_body_too() {
    let folder = Folder::new("bvh");
    let file = folder.put("step.bvh", recording().as_bytes());
    let out = folder.at("step.glb");
    let args = ["simulate", "--motion", &file, "--edge", "25", "--fps", "30"];
    let done = muslin(
        &[
            &args[..],
            &["--seconds", "0.1", "--start", "0.05", "-o", &out],
        ]
        .concat(),
    );
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.at("step.report.json")).expect("written");
    assert!(
        report.contains("\"sha256\"") && report.contains("\"frames\": 3"),
        "{report}"
    );
}

#[test]
fn bad_input_ends_with_its_code_a_hint_and_no_file() {
    let folder = Folder::new("bad");
    let smpl = write(&[("poses", Array::f32(&[1, 3], vec![0.0; 3]))]).expect("finite");
    let smpl = folder.put("smpl.npz", &smpl);
    let text = folder.put("text.bvh", b"nothing of the kind");
    let glb = folder.put("idle.vrma", b"glTF\x02\0\0\0");
    let whole = recording();
    let cut = folder.put("cut.bvh", &whole.as_bytes()[..whole.len() / 2]);
    let (missing, left) = (folder.at("missing.bvh"), folder.names());
    let cases: [(&[&str], i32, &str); 16] = [
        (&["--motion", "wlak"], 2, "walk"),
        (&["--outfit", "tea"], 2, "tee"),
        (&["--outfit", "tee:demin"], 2, "denim"),
        (&["--fps", "1"], 2, "--fps"),
        (&["--air=-1"], 2, "--air"),
        (&["--wind", "0,0"], 2, "--wind"),
        (&["--wind", "0,0,-300"], 2, "--wind"),
        (&["--start", "100"], 2, "--start"),
        (&["--npz", "a.npy"], 2, "--npz"),
        (&["--body", "smpl"], 2, "anny"),
        (&["--height", "17200"], 2, "--height"),
        (&["--motion", &smpl], 4, "BVH"),
        (&["--motion", &text], 3, "hint"),
        (&["--motion", &glb], 3, "cut short"),
        (&["--motion", &cut], 3, "hint"),
        (&["--motion", &missing], 5, "missing.bvh"),
    ];
    for (args, want, says) in cases {
        let out = folder.at("w.glb");
        let done = muslin(&[&["simulate"], args, &["-o", &out]].concat());
        let told = errors(&done);
        assert_eq!(done.status.code(), Some(want), "{args:?}: {told}");
        assert!(
            told.contains(says) && told.contains("error"),
            "{args:?}: {told}"
        );
        assert_eq!(folder.names(), left, "{args:?} left a file");
    }
    let done = muslin(&["simulate", "-o", &folder.at("w.fbx")]);
    assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
    let inside = Path::new(&text).join("w.glb").display().to_string();
    assert_eq!(muslin(&["simulate", "-o", &inside]).status.code(), Some(5));
}

#[test]
fn wind_carries_a_skirt_along_and_is_told() {
    let folder = Folder::new("wind");
    // Where the hindmost of the cloth is.
    let back = |name: &str, wind: &str| {
        let npz = folder.at(name);
        let out = folder.at("w.glb");
        let what = [
            "simulate",
            "--outfit",
            "skirt:silk-charmeuse",
            "--edge",
            "25",
        ];
        let how = ["--motion", "wave", "--seconds", "0.6", "--wind", wind];
        let done = muslin(&[&what[..], &how, &["--npz", &npz, "-o", &out]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let clip = muslin_io::read_clip(Path::new(&npz)).expect("it was written");
        let last = clip.drape.frames.last().expect("frames");
        last.iter().map(|p| p.z).fold(f64::INFINITY, f64::min)
    };
    let (still, blown) = (back("still.npz", "0,0,0"), back("blown.npz", "0,0,-6"));
    assert!(still - blown > 0.05, "{still} {blown} m");
    let report = std::fs::read_to_string(folder.at("w.report.json")).expect("written");
    assert!(report.contains("\"air_kg_m3\": 1.2"), "{report}");
    assert!(report.contains("\"wind_m_s\""), "{report}");
}

/// Folds of the hip hold shorts: in steps of a frame some triangle of a few frames is left 1.8 % beyond its limit.
#[test]
fn shorts_in_a_run_keep_to_their_limit_of_stretch() {
    let folder = Folder::new("run");
    let out = folder.at("run.glb");
    let mut args = vec!["simulate", "--motion", "run", "--garment", "shorts"];
    args.extend(["--seconds", "1", "--edge", "14", "-o", &out]);
    let done = muslin(&args);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.at("run.report.json")).expect("written");
    assert!(report.contains("\"frames_beyond_limit\": 0"), "{report}");
}

#[test]
fn several_motions_get_a_file_each_and_the_same_as_alone() {
    let folder = Folder::new("several");
    folder.put("step.bvh", recording().as_bytes());
    let (takes, out) = (folder.0.display().to_string(), folder.at("out"));
    let args = [
        "simulate",
        "--edge",
        "25",
        "--fps",
        "30",
        "--seconds",
        "0.1",
    ];
    let many = ["--motion", "wave", "--motion", &takes, "-o", &out];
    let done = muslin(&[&args[..], &many].concat());
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    assert!(
        errors(&done).contains("memory  2 motions, "),
        "{}",
        errors(&done)
    );
    for name in [
        "wave.glb",
        "wave.report.json",
        "step.glb",
        "step.report.json",
    ] {
        assert!(
            folder.0.join("out").join(name).exists(),
            "{name} is missing"
        );
    }
    let alone = folder.at("alone.glb");
    let done = muslin(&[&args[..], &["--motion", "wave", "-o", &alone]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let read = |p: PathBuf| std::fs::read(p).expect("it was written");
    assert!(
        read(folder.0.join("out/wave.glb")) == read(alone.into()),
        "they differ"
    );
    let none = folder.at("none");
    std::fs::create_dir(&none).expect("a folder");
    let done = muslin(&["simulate", "--motion", &none, "-o", &folder.at("x")]);
    assert_eq!(done.status.code(), Some(3), "{}", errors(&done));
}

#[test]
fn motions_are_listed() {
    let out = muslin(&["list", "motions"]);
    assert_eq!(out.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&out.stdout).contains("cartwheel"));
}
