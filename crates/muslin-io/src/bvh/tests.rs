use super::*;
use std::path::{Path, PathBuf};

const TINY: &str = "HIERARCHY\nROOT Base\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition \
    Zposition Zrotation Xrotation Yrotation\n JOINT Tip\n {\n  OFFSET 0 0 15\n  CHANNELS 3 \
    Zrotation Xrotation Yrotation\n  End Site\n  {\n   OFFSET 0 0 30\n  }\n }\n}\n";

fn tiny(motion: &str) -> Result<Bvh, IoError> {
    read("a.bvh", format!("{TINY}{motion}").as_bytes())
}

#[test]
fn known_values_come_back() {
    let bvh = tiny("MOTION\nFrames: 1\nFrame Time: 0.02\n1 2 3 90 0 0 0 90 0\n").expect("valid");
    let (skeleton, frame) = (&bvh.recording.skeleton, &bvh.recording.frames[0]);
    assert_eq!(skeleton.names, ["Base", "Tip"]);
    assert_eq!(skeleton.ends[1], Some(DVec3::new(0.0, 0.0, 30.0)));
    assert_eq!(frame.translations[0], DVec3::new(1.0, 2.0, 3.0));
    assert!((frame.rotations[0] * DVec3::X).distance(DVec3::Y) < 1e-12);
    assert!((frame.rotations[1] * DVec3::Y).distance(DVec3::Z) < 1e-12);
    assert!((bvh.recording.fps - 50.0).abs() < 1e-9 && bvh.warnings.is_empty());
}

#[test]
fn rotations_compose_in_channel_order() {
    let bvh = tiny("MOTION\nFrames: 1\nFrame Time: 1\n0 0 0 90 90 0 0 0 0").expect("valid");
    let want =
        DQuat::from_rotation_z(90f64.to_radians()) * DQuat::from_rotation_x(90f64.to_radians());
    assert!(bvh.recording.frames[0].rotations[0].angle_between(want) < 1e-9);
}

#[test]
fn frame_counts_may_lie_without_costing_memory() {
    let row = "0 0 0 0 0 0 0 0 0\n";
    let motion = format!("MOTION\nFrames: 99999999999\nFrame Time: 0.1\n{row}{row}1 2 3\n");
    let bvh = tiny(&motion).expect("readable");
    assert_eq!(bvh.recording.frames.len(), 2);
    assert_eq!(bvh.warnings.len(), 2, "{:?}", bvh.warnings);
}

#[test]
fn several_roots_and_crowded_lines_are_read() {
    let text = "HIERARCHY ROOT A\n{OFFSET 1 2 3 CHANNELS 1 Xrotation}\nROOT B{\nOFFSET 0 0 1\n\
                CHANNELS 3 Xposition,Yposition,Zposition}\nMOTION\nFrames:1\nFrame Time:0.5\n90 4 5 6";
    let bvh = read("a.bvh", text.as_bytes()).expect("valid");
    assert_eq!(bvh.recording.skeleton.parents, [None, None]);
    assert_eq!(
        bvh.recording.frames[0].translations[1],
        DVec3::new(4.0, 5.0, 7.0)
    );
}

#[test]
fn bad_files_are_named_by_line() {
    let deep = format!("HIERARCHY\n{}", "ROOT a\n{\n".repeat(400));
    let cases: Vec<(String, &str)> = vec![
        (String::new(), "file ends"),
        ("PK\u{3}\u{4}".into(), "HIERARCHY expected"),
        (
            format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0 nan 0 0 0 0 0 0"),
            "usable",
        ),
        (
            format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0 x 0 0 0 0 0 0"),
            "number",
        ),
        (
            format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0"),
            "whole frame",
        ),
        (format!("{TINY}}}\nMOTION"), "brace too many"),
        (TINY.replace('}', " "), "MOTION is missing"),
        (format!("{}MOTION", TINY.replace('}', " ")), "not closed"),
        (
            TINY.replace("CHANNELS 6", "CHANNELS 600000000"),
            "allowed 0 to 6",
        ),
        (TINY.replace("Xposition", "Xscale"), "unknown channel"),
        (TINY.replace("OFFSET 0 0 15", "OFFSET 0 0"), "number"),
        (deep, "levels"),
    ];
    for (text, want) in cases {
        let error = read("a.bvh", text.as_bytes()).expect_err(want);
        assert!(
            error.to_string().contains(want),
            "{error} should say {want:?}"
        );
    }
}

/// A file of so many joints below one root, of which the root alone has a channel.
fn broom(joints: usize, motion: &str) -> String {
    let joint = "JOINT a\n{\nOFFSET 0 0 1\n}\n".repeat(joints - 1);
    let root = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n";
    format!("{root}{joint}}}\nMOTION\n{motion}")
}

#[test]
fn what_is_too_large_is_refused_with_what_is_allowed() {
    let motion = |n: usize| {
        let numbers = "0 ".repeat(n);
        format!("Frames: {n}\nFrame Time: 0.1\n{numbers}")
    };
    let whole = read("a.bvh", broom(4096, &motion(9)).as_bytes()).expect("sound");
    assert_eq!(whole.recording.frames.len(), 9);
    let deep = format!("HIERARCHY\n{}", "ROOT a\n{\n".repeat(400));
    for (text, told) in [
        (broom(4096, &motion(9000)), "9000 frames of 4096 joints"),
        (broom(4097, &motion(1)), "joints"),
        (deep, "levels"),
    ] {
        let fault = read("a.bvh", text.as_bytes()).expect_err(told);
        let text = fault.to_string();
        assert!(text.contains(told) && text.contains("allowed"), "{fault}");
        assert_eq!((fault.code(), fault.exit_code()), ("bvh-large", 4));
    }
    let many = numbers(&mut Words::new("1 2\n3 4"), 3).expect_err("four");
    assert_eq!((many.line, many.allowed.as_deref()), (2, Some("3")));
}

#[test]
fn names_are_made_printable() {
    let text = TINY
        .replace("Tip", "\u{1b}[31mTip\u{7}")
        .replace("Base", "");
    let text = format!("{text}MOTION\nFrames: 1\nFrame Time: 1\n0 0 0 0 0 0 0 0 0");
    let names = read("a.bvh", text.as_bytes())
        .expect("valid")
        .recording
        .skeleton
        .names;
    assert_eq!(names, ["joint0", "[31mTip"]);
}

#[test]
fn no_prefix_of_a_file_panics() {
    let text = format!("{TINY}MOTION\nFrames: 1\nFrame Time: 0.02\n1 2 3 90 0 0 0 90 0\n");
    for end in 0..text.len() {
        let _ = read("a.bvh", &text.as_bytes()[..end]);
    }
}

#[test]
fn every_shared_recording_is_read() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let mut files = Vec::new();
    collect(&data.join("motion"), &mut files);
    assert!(files.len() > 50, "{} files", files.len());
    for file in files {
        let bvh = read("a.bvh", &std::fs::read(&file).expect("readable")).expect("valid");
        assert!(
            bvh.warnings.is_empty(),
            "{}: {:?}",
            file.display(),
            bvh.warnings
        );
    }
    let liar = std::fs::read(data.join("robustness/bvh/frame_count_lies.bvh")).expect("readable");
    let warnings = read("a.bvh", &liar).expect("readable").warnings;
    assert!(
        warnings.iter().any(|w| w == "3 frames declared, 4 found"),
        "{warnings:?}"
    );
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        match path.is_dir() {
            true => collect(&path, files),
            false if path.extension().is_some_and(|e| e == "bvh") => files.push(path),
            false => {}
        }
    }
}

/// Names of shoulder, elbow, wrist, hip, knee and ankle on the left side.
const SCHOOLS: [(&str, [&str; 6]); 7] = [
    (
        "cmu-bvh/02_01_walk",
        [
            "LeftArm",
            "LeftForeArm",
            "LeftHand",
            "LeftUpLeg",
            "LeftLeg",
            "LeftFoot",
        ],
    ),
    (
        "cmu-fbx-as-bvh/85_03_acrobatics",
        [
            "Neo_LeftArm",
            "Neo_LeftForeArm",
            "Neo_LeftHand",
            "Neo_LeftUpLeg",
            "Neo_LeftLeg",
            "Neo_LeftFoot",
        ],
    ),
    (
        "cmu-fbx-as-bvh/91_48_locomotion",
        ["lShldr", "lForeArm", "lHand", "lThigh", "lShin", "lFoot"],
    ),
    (
        "non-commercial/bandai-namco/dataset-1_kick_normal_001",
        [
            "UpperArm_L",
            "LowerArm_L",
            "Hand_L",
            "UpperLeg_L",
            "LowerLeg_L",
            "Foot_L",
        ],
    ),
    (
        "other-skeletons/boxing_toes_100fps",
        [
            "LeftShoulder",
            "LeftElbow",
            "LeftWrist",
            "LeftHip",
            "LeftKnee",
            "LeftAnkle",
        ],
    ),
    (
        "reactidle/000_genuine",
        [
            "upper_arm.L",
            "forearm.L",
            "forearm.L",
            "thigh.L",
            "shin.L",
            "foot.L",
        ],
    ),
    (
        "makehuman-poses/fight01",
        [
            "upperarm01.L",
            "lowerarm01.L",
            "wrist.L",
            "upperleg01.L",
            "lowerleg01.L",
            "foot.L",
        ],
    ),
];

#[test]
fn recordings_of_every_school_move_our_limbs_alike() {
    use muslin_body::{Avatar, Shape, retarget::retarget};
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let ours = [
        "upperarm01.L",
        "lowerarm01.L",
        "wrist.L",
        "upperleg01.L",
        "lowerleg01.L",
        "foot.L",
    ];
    for (file, theirs) in SCHOOLS {
        let path = data.join("motion").join(format!("{file}.bvh"));
        let bvh = read(file, &std::fs::read(path).expect("readable"))
            .expect("valid")
            .recording;
        for frame in [0, bvh.frames.len() / 2] {
            let pose = retarget(&avatar, &figure, &bvh, frame).expect("a human");
            let posed = avatar.pose(&figure, &pose);
            let at = |name: &str| {
                let b = avatar.bone(name).expect("a bone");
                posed.bones[b].transform_point3(figure.joints[b])
            };
            let points = heads(&bvh, frame);
            let head = |name: &str| {
                points[bvh
                    .skeleton
                    .names
                    .iter()
                    .position(|n| n == name)
                    .expect(name)]
            };
            for (a, b) in [(0, 1), (1, 2), (3, 4), (4, 5)]
                .into_iter()
                .filter(|&(a, b)| theirs[a] != theirs[b])
            {
                let want = head(theirs[b]) - head(theirs[a]);
                let want = if file.starts_with("makehuman") {
                    DVec3::new(want.x, want.z, -want.y)
                } else {
                    want
                };
                let off = (at(ours[b]) - at(ours[a])).angle_between(want).to_degrees();
                assert!(
                    off < 0.01,
                    "{file} frame {frame}: {} is off by {off} degrees",
                    ours[a]
                );
            }
            let up = (at("head") - at("foot.L")).y;
            assert!(
                file.contains("acrobatics") || up > 0.5,
                "{file} stands on its head"
            );
        }
    }
}

/// Where the joints are, by the shortest road.
fn heads(recording: &Recording, frame: usize) -> Vec<DVec3> {
    let (skeleton, frame) = (&recording.skeleton, &recording.frames[frame]);
    let up = |mut joint: usize| {
        let mut point = frame.translations[joint];
        while let Some(parent) = skeleton.parents[joint] {
            point = frame.translations[parent] + frame.rotations[parent] * point;
            joint = parent;
        }
        point
    };
    (0..skeleton.names.len()).map(up).collect()
}

#[test]
fn every_shared_recording_moves_our_body_soundly() {
    use muslin_body::{Avatar, Part, Shape, retarget::retarget_all};
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let skin = avatar.part(Part::Body);
    let low = |verts: &[DVec3]| verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min);
    let floor = low(&figure.verts[skin.clone()]);
    let mut files = Vec::new();
    collect(&data.join("motion"), &mut files);
    files.retain(|f| !f.to_string_lossy().contains("non-commercial"));
    assert!(files.len() > 20, "{} files", files.len());
    for file in files {
        let name = file.display().to_string();
        let bvh = read("a.bvh", &std::fs::read(&file).expect("readable")).expect("valid");
        let Ok(motion) = retarget_all(&avatar, &figure, &bvh.recording) else {
            assert!(
                bvh.recording.skeleton.names.len() < 10,
                "{name} is no human"
            );
            continue;
        };
        assert!(motion.is_sound() && motion.poses.len() == bvh.recording.frames.len());
        let (motion, _) = motion.without_false_start();
        let rate = motion.largest_turn() * motion.fps;
        assert!(rate < 75.0, "{name}: a joint turns at {rate:.1} rad/s");
        let heights = motion
            .poses
            .iter()
            .step_by(1 + motion.poses.len() / 8)
            .map(|p| low(&avatar.pose(&figure, p).verts[skin.clone()]) - floor);
        let heights: Vec<f64> = heights.collect();
        let least = heights.iter().copied().fold(f64::INFINITY, f64::min);
        // The gymnast stands on hands, and only feet are held to the floor.
        let is_near = (-0.13..0.08).contains(&least) || name.contains("gym01");
        assert!(is_near, "{name}: the lowest point is at {least:.3} m");
    }
}
