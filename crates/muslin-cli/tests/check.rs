//! `muslin check`, as a user types it.

mod common;

use common::{Folder, errors, muslin, tube};

/// A file of the repository.
fn asset(name: &str) -> String {
    format!("{}/../../assets/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn what_can_be_used_is_told_in_a_table_and_as_json() {
    let folder = Folder::new("looked-at");
    let fabric = folder.put("own.toml", b"like = \"denim\"\nmass_g_m2 = 350\n");
    let (model, photo) = (asset("wardrobe/tee.muslin"), asset("examples/walk.jpg"));
    let out = muslin(&["check", &fabric, &model, &photo]);
    assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
    let table = String::from_utf8_lossy(&out.stdout).into_owned();
    for part in [
        "own.toml    fabric",
        "350 g/m2",
        "trained garment",
        "tee by muslin, for any fabric, any body, any size; 64 codes",
        "330 x 470, 1 person",
    ] {
        assert!(table.contains(part), "{part} is missing:\n{table}");
    }
    let out = muslin(&["check", &fabric, "--json", "-q"]);
    let json = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(
        json.contains("\"kind\": \"fabric\"") && json.contains("\"warnings\""),
        "{json}"
    );
    assert!(out.stderr.is_empty(), "{}", errors(&out));
}

#[test]
fn what_cannot_is_refused_in_words_all_of_it() {
    let folder = Folder::new("refused");
    let solid = folder.put("solid.obj", tube((0.3, 0.3), 0.5, 2).as_bytes());
    let hat = folder.put("hat.obj", tube((0.4, 0.4), 0.3, 1).as_bytes());
    let out = muslin(&["check", &solid]);
    assert_eq!(out.status.code(), Some(3), "{}", errors(&out));
    assert!(errors(&out).contains("it is closed"), "{}", errors(&out));
    let text = folder.put("notes.docx", b"nothing");
    let out = muslin(&["check", &hat, &text, &asset("examples/walk.jpg")]);
    assert_eq!(out.status.code(), Some(3), "{}", errors(&out));
    for part in [
        "2 files cannot be used",
        "neither a hand nor a foot fits into it",
        "error[unknown-kind]",
        "hint:",
        "1 person",
    ] {
        assert!(errors(&out).contains(part), "{part}:\n{}", errors(&out));
    }
    let out = muslin(&["check", &folder.at("gone.bvh")]);
    assert_eq!(out.status.code(), Some(5), "{}", errors(&out));
    let out = muslin(&["check"]);
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
}
