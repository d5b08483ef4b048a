//! Garments from files, as a user brings them.

mod common;

use common::{Folder, errors, muslin};

/// Runs `dress` on a built-in pose with a garment file of this name and text.
fn with_file(name: &str, text: &str) -> (Option<i32>, String) {
    let folder = Folder::new(&name.replace('.', "-"));
    let file = folder.put(name, text.as_bytes());
    let out = folder.at("out");
    let done = muslin(&["dress", "--pose", "walk", "--garment", &file, "-o", &out]);
    (done.status.code(), errors(&done))
}

#[test]
fn files_that_cannot_be_worn_are_named_with_place_and_hint() {
    let broken = r#"{"pattern": {"panels": {"front": {"vertices": [[0,0],[10,0],[10,10]],
        "edges": [{"endpoints": [0,1]}, {"endpoints": [1,2]}, {"endpoints": [1,0]}]}}}}"#;
    let crossed = r#"{"pattern": {"panels": {"front": {"vertices": [[0,0],[40,40],[40,0],[0,40]],
        "edges": [{"endpoints": [0,1]}, {"endpoints": [1,2]}, {"endpoints": [2,3]},
                  {"endpoints": [3,0]}]}}, "stitches": []},
        "properties": {"units_in_meter": 100}}"#;
    let flat = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let cases = [
        ("cut.json", "{\"pattern\": {", "this is not JSON", 3),
        (
            "broken.json",
            broken,
            "#/pattern/panels/front/edges/2/endpoints: the outline breaks",
            3,
        ),
        (
            "crossed.json",
            crossed,
            "panel \"front\" cannot be cut: edges 0 and 2 cross",
            3,
        ),
        (
            "flat.obj",
            flat,
            "this mesh cannot be worn: there is no cloth in it",
            3,
        ),
        ("bad.obj", "v 0 0\n", "bad.obj:1: a number is missing", 3),
    ];
    for (name, text, want, exit) in cases {
        let (code, told) = with_file(name, text);
        assert_eq!(code, Some(exit), "{name}: {told}");
        assert!(told.contains(want) && told.contains(name), "{told}");
    }
}

#[test]
fn a_missing_file_and_an_unknown_kind_say_so() {
    let ends = |garment: &str| {
        let done = muslin(&["dress", "--pose", "walk", "--garment", garment, "-o", "out"]);
        (done.status.code(), errors(&done))
    };
    let (code, told) = ends("nowhere/shirt.json");
    assert_eq!(code, Some(5), "{told}");
    assert!(told.contains("no such file"), "{told}");
    let (code, told) = ends("./Cargo.toml");
    assert_eq!(code, Some(4), "{told}");
    assert!(told.contains(".obj"), "{told}");
}

#[test]
fn a_shared_pattern_is_sewn_and_worn() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(std::path::PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let shirt = data.join("garments/garmentcode-patterns/shirt_mean_specification.json");
    let (folder, shirt) = (Folder::new("shirt"), shirt.display().to_string());
    let out = folder.at("out");
    let mut args = vec!["dress", "--pose", "walk", "--garment", &shirt, "-o", &out];
    args.extend(["--edge", "20", "--allow-crossings"]);
    let done = muslin(&args);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let report = std::fs::read_to_string(folder.0.join("out/report.json")).expect("written");
    assert!(report.contains("\"garment\": \"shirt_mean\"") && report.contains("sha256"));
}

/// A jacket that is open in front with its skirt; cuffs turned in, one of which ends on the thumb; a collar folded over,
/// worn over other cloth; sleeves that hang.
#[test]
fn suits_and_dresses_of_others_walk_without_a_crossing() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(std::path::PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    for (name, told) in [
        ("makehuman/female_elegantsuit01", "turned in"),
        ("makehuman/male_casualsuit01", "turned in"),
        ("makehuman/male_elegantsuit01", "turned in"),
        ("diffcloth/dress-v5k-f10k-v3", "inches"),
    ] {
        let file = data.join(format!("garments/{name}.obj"));
        let (folder, file) = (Folder::new("worn"), file.display().to_string());
        let out = folder.at("walk.glb");
        let mut args = vec!["simulate", "--garment", &file, "--motion", "walk"];
        args.extend(["--seconds", "0.1", "--fps", "30", "-o", &out]);
        let done = muslin(&args);
        let said = errors(&done);
        assert_eq!(done.status.code(), Some(0), "{name}: {said}");
        assert!(said.contains(told), "{name}: {said}");
    }
}
