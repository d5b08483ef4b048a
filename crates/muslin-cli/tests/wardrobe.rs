//! The trained garments that come with the program, as a user meets them.

mod common;

use common::{Folder, errors, muslin};

/// Plays a short wave in a garment of the wardrobe; the report, and what was said.
fn play(folder: &Folder, more: &[&str]) -> (Option<i32>, String, String) {
    let (glb, npz) = (folder.at("w.glb"), folder.at("w.npz"));
    let args = [
        "animate",
        "--motion",
        "wave",
        "--fps",
        "15",
        "--seconds",
        "0.2",
        "-o",
        &glb,
        "--npz",
        &npz,
    ];
    let done = muslin(&[&args[..], more].concat());
    let report = std::fs::read_to_string(folder.0.join("w.report.json")).unwrap_or_default();
    (done.status.code(), report, errors(&done))
}

#[test]
fn a_garment_of_the_wardrobe_is_played_without_training_on_other_bodies_and_in_other_fabrics() {
    let folder = Folder::new("wardrobe");
    let (code, report, said) = play(&folder, &["--garment", "tee"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(report.contains("\"not_taught\": []"), "{report}");
    assert!(report.contains("\"checked\": \"exact\""), "{report}");
    let (code, _, said) = play(&folder, &["--garment", "tee", "--refine", "0"]);
    assert_eq!(code, Some(0), "{said}");
    let own = muslin_io::read_clip(&folder.0.join("w.npz")).expect("it can be read");

    let other = [
        "--garment",
        "tee:denim",
        "--height",
        "185",
        "--weight",
        "95",
    ];
    let raw = [&other[..], &["--refine", "0"]].concat();
    let (code, report, said) = play(&folder, &raw);
    assert_eq!(code, Some(0), "{said}");
    assert!(report.contains("\"not_taught\": []"), "{report}");
    assert!(report.contains("denim"), "{report}");
    let larger = muslin_io::read_clip(&folder.0.join("w.npz")).expect("it can be read");
    let width = |clip: &muslin_io::Clip| {
        let x = clip.drape.frames[0].iter().map(|p| p.x);
        x.clone().fold(f64::MIN, f64::max) - x.fold(f64::MAX, f64::min)
    };
    let wider = width(&larger) / width(&own);
    assert!((1.05..1.5).contains(&wider), "{wider}");

    // A fabric unlike any cloth, on a body like none that was taught.
    let beyond = ["--garment", "tee:paper-vdp-silk", "--weight", "129"];
    let (code, _, said) = play(&folder, &[&beyond[..], &["--refine", "0"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("another body and fabric"), "{said}");
}

#[test]
fn garments_of_the_wardrobe_are_played_one_over_the_other() {
    let folder = Folder::new("outfit");
    let (code, report, said) = play(&folder, &["--garment", "trousers:denim,tee"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(report.contains("\"checked\": \"exact\""), "{report}");
    assert!(
        report.contains("\"frames_with_self_crossings\": 0"),
        "{report}"
    );
    let read = |name: &str| muslin_io::read_clip(&folder.0.join(name)).expect("it can be read");
    let [trousers, tee] = ["w.trousers.npz", "w.tee.npz"].map(read);
    // The shirt's hem hangs over the waistband.
    let ends = |clip: &muslin_io::Clip| {
        let y = clip.drape.frames[0].iter().map(|p| p.y);
        [
            y.clone().fold(f64::MAX, f64::min),
            y.fold(f64::MIN, f64::max),
        ]
    };
    assert!(ends(&tee)[0] < ends(&trousers)[1] - 0.05);
}

#[test]
fn what_is_not_in_the_wardrobe_is_said_with_what_is() {
    let folder = Folder::new("no-such-model");
    let (code, _, said) = play(&folder, &["--garment", "poncho"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("muslin train") && said.contains("--model"),
        "{said}"
    );
    let (code, _, said) = play(&folder, &["--garment", "tee", "--model", "tee.muslin"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(folder.names().is_empty());
}

#[test]
fn dress_starts_where_the_garment_was_taught_to_lie_unless_all_is_to_be_simulated() {
    let folder = Folder::new("laid");
    let out = folder.at("out");
    let from = |more: &[&str]| {
        let args = [
            "dress",
            "--pose",
            "walk",
            "--garment",
            "tee",
            "-q",
            "-o",
            &out,
        ];
        let done = muslin(&[&args[..], more].concat());
        assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
        let report = std::fs::read_to_string(folder.0.join("out/report.json")).expect("written");
        assert!(report.contains("\"body_intersections\": 0"), "{report}");
        let from = report.lines().find(|l| l.contains("\"from\""));
        let from = from.expect("it is said").trim().to_owned();
        assert_eq!(
            report.contains("mocap.cs.cmu.edu"),
            from.contains("wardrobe")
        );
        from
    };
    assert_eq!(from(&[]), "\"from\": \"wardrobe\",");
    assert_eq!(from(&["--simulate"]), "\"from\": \"rest\",");
    assert_eq!(from(&["--edge", "20"]), "\"from\": \"rest\",");
}
