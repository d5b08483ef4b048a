//! Somebody else's character in our clothes, as a user types it.

mod common;

use std::path::Path;

use common::{Folder, errors, muslin, typed};
use glam::{DAffine3, DMat4, DVec3};
use muslin::{DressOptions, Playing, Wear};
use muslin_io::{read_character, read_clip};

/// Runs `muslin simulate` on coarse cloth, which must do.
fn simulated(options: &str) {
    let all = format!("simulate --edge 25 --fps 30 {options}");
    let done = typed(&all);
    assert_eq!(done.status.code(), Some(0), "{all}: {}", errors(&done));
}

/// A short animation, whose body serves as a character: a skin on bones.
fn character(folder: &Folder) -> String {
    let out = folder.at("hero.glb");
    simulated(&format!("--motion wave --seconds 0.2 -o {out}"));
    out
}

#[test]
fn a_character_wears_a_tee_in_its_own_animation_and_keeps_its_skeleton() {
    let folder = Folder::new("hero");
    let hero = character(&folder);
    let (out, npz) = (folder.at("dressed.glb"), folder.at("dressed.npz"));
    simulated(&format!(
        "--body {hero} --motion wave --seconds 0.2 --npz {npz} -o {out}"
    ));
    let report = std::fs::read_to_string(folder.at("dressed.report.json")).expect("written");
    for figure in ["\"uncovered_percent\"", "hero.glb", "\"name\": \"wave\""] {
        assert!(report.contains(figure), "{figure} is missing:\n{report}");
    }
    // The skeleton plays what it played before.
    let read = |p: &str| read_character(Path::new(p)).expect("it can be read");
    let (before, after) = (read(&hero), read(&out));
    assert_eq!(before.character.names, after.character.names);
    assert_eq!(before.character.faces, after.character.faces);
    assert_eq!(after.clips, ["wave"]);
    let play = |c: &muslin_io::CharacterFile| c.play(0, 30.0).expect("it plays");
    let (a, b) = (play(&before), play(&after));
    assert_eq!((a.len(), b.len()), (6, 6));
    let mut compared = 0;
    for (a, b) in a.iter().zip(&b) {
        for (name, (a, b)) in before.character.names.iter().zip(a.iter().zip(b)) {
            if ["upper", "lower", "foot", "wrist"]
                .iter()
                .any(|n| name.starts_with(n))
            {
                let off = a.translation.distance(b.translation);
                assert!(off < 5e-3, "{name}: {off}");
                compared += 1;
            }
        }
    }
    assert!(compared > 60, "{compared}");
    // The garment is the only thing to judge, in metres.
    let clip = read_clip(Path::new(&out)).expect("it can be read");
    let arrays = read_clip(Path::new(&npz)).expect("it can be read");
    assert_eq!(clip.garments().len(), 1);
    let pairs = clip.drape.frames[5].iter().zip(&arrays.drape.frames[5]);
    let off = pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(off < 1e-4, "{off}");
}

#[test]
fn joints_of_a_character_s_own_animation_move_apart_grow_and_turn_as_they_did() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(std::path::PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let (knight, punch) = (
        data.join("characters/kaykit/Knight.glb"),
        "Unarmed_Melee_Attack_Punch_B",
    );
    let folder = Folder::new("knight");
    let out = folder.at("knight.glb");
    let line = format!(
        "animate --body {} --garment tee --motion {punch} --seconds 0.5 --fps 30 --refine 0 -o {out}",
        knight.display()
    );
    let done = typed(&line);
    assert_eq!(done.status.code(), Some(0), "{line}: {}", errors(&done));
    let read = |p: &Path| read_character(p).expect("it can be read");
    let (before, after) = (read(&knight), read(Path::new(&out)));
    let clip = before.clips.iter().position(|c| c == punch);
    let clip = clip.expect("its animation");
    let had = before.play(clip, 30.0).expect("it plays");
    let has = after.play(0, 30.0).expect("it plays");
    // Seen from the joint that each hangs on; arms and legs as wholes are turned to make room.
    let (names, parents) = (&before.character.names, &before.character.parents);
    let own = |j: usize| {
        let stays = ["root", "hips", "control", "IK", "upper"];
        !stays.iter().any(|n| names[j].contains(n))
    };
    let joints: Vec<(usize, usize)> = (0..names.len())
        .filter(|j| own(*j))
        .filter_map(|j| Some((j, parents[j]?)))
        .collect();
    assert!(joints.len() >= 15 && has.len() == 15);
    let shoulder = names.iter().position(|n| n == "upperarm.r");
    let shoulder = shoulder.expect("a shoulder");
    let chest = parents[shoulder].expect("a chest");
    let inside = |all: &[DAffine3], parent: usize, j: usize| all[parent].inverse() * all[j];
    let place = |all: &[DAffine3]| inside(all, chest, shoulder).translation;
    let mut gone = 0.0f64;
    for (had, has) in had.iter().zip(&has) {
        for &(j, parent) in &joints {
            let (a, b) = (inside(had, parent, j), inside(has, parent, j));
            assert!(a.abs_diff_eq(b, 2e-4), "{}: {a:?} {b:?}", names[j]);
        }
        assert!(place(had).distance(place(has)) < 2e-4);
        gone = gone.max(place(has).distance(place(&before.character.bound)));
    }
    assert!(gone > 0.1, "a shoulder leaves its socket by {gone}");
}

#[test]
fn a_character_in_a_baked_garment_is_still_that_character() {
    let folder = Folder::new("hero-bake");
    let hero = character(&folder);
    let out = folder.at("baked.glb");
    simulated(&format!(
        "--body {hero} --motion wave --seconds 0.1 --bake bones:12 -o {out}"
    ));
    let read = |p: &str| read_character(Path::new(p)).expect("it can be read");
    let (before, after) = (read(&hero), read(&out));
    assert_eq!(
        before.character.names, after.character.names,
        "no handle of the tee"
    );
    assert_eq!(before.character.faces, after.character.faces);
    let clip = read_clip(Path::new(&out)).expect("it can be read");
    assert_eq!((clip.garments().len(), clip.drape.frames.len()), (1, 3));
}

/// The same file with another JSON.
fn with_json(bytes: &[u8], change: impl Fn(&str) -> String) -> Vec<u8> {
    let word =
        |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    let (old, rest) = (&bytes[20..20 + word(12)], &bytes[20 + word(12)..]);
    let mut json = change(std::str::from_utf8(old).expect("text")).into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = (20 + json.len() + rest.len()) as u32;
    let mut out = [&bytes[..8], &total.to_le_bytes()].concat();
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    [out, json, rest.to_vec()].concat()
}

#[test]
fn a_file_without_scenes_and_with_notes_of_its_own_is_dressed_as_well() {
    let folder = Folder::new("odd-hero");
    let bytes = std::fs::read(character(&folder)).expect("written");
    let odd = with_json(&bytes, |json| {
        let text = json
            .replace("\"scenes\":", "\"scenery\":")
            .replace("\"generator\":", "\"extras\":");
        assert_ne!(text, json);
        text
    });
    let (hero, out) = (folder.put("odd.glb", &odd), folder.at("dressed.glb"));
    simulated(&format!("--body {hero} --seconds 0.1 -o {out}"));
    let clip = read_clip(Path::new(&out)).expect("it can be read");
    assert_eq!(clip.garments().len(), 1);
}

/// A tube to the knee, to be worn as a skirt.
fn skirt(folder: &Folder) -> String {
    let (n, rows) = (56, 26);
    let mut text = String::new();
    for r in 0..rows {
        let share = f64::from(r) / f64::from(rows - 1);
        let wide = 0.24 - 0.105 * share;
        for k in 0..n {
            let t = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
            let (x, z) = (1.1 * wide * t.sin(), 0.85 * wide * t.cos());
            text += &format!("v {x} {} {z}\n", 0.5 * share);
        }
    }
    for r in 0..rows - 1 {
        for k in 0..n {
            let at = |r: i32, k: i32| r * n + k % n + 1;
            let (a, b, c, d) = (at(r, k), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k));
            text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
        }
    }
    folder.put("skirt.obj", text.as_bytes())
}

#[test]
fn what_a_character_wears_from_a_file_is_its_size_or_the_labels() {
    let folder = Folder::new("hero-size");
    let (hero, skirt) = (character(&folder), skirt(&folder));
    let (out, npz) = (folder.at("dressed.glb"), folder.at("dressed.npz"));
    let area = |more: &str| {
        simulated(&format!(
            "--body {hero} --garment {skirt} --motion walk --seconds 0.1 --npz {npz} -o {out} {more}"
        ));
        let clip = read_clip(Path::new(&npz)).expect("it can be read");
        let corners = clip.corners.iter();
        let area = corners.map(|c| 0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]).abs());
        let report = std::fs::read_to_string(folder.at("dressed.report.json")).expect("written");
        (area.sum::<f64>(), report)
    };
    let [tall, own, wide] = ["--height 210", "", "--size XXL"].map(area);
    // Our own body in its own likeness: nearly the size of the file.
    let cone = std::f64::consts::TAU * 0.975 * 0.1875 * 0.511;
    assert!((0.85..1.2).contains(&(own.0 / cone)), "{} {cone}", own.0);
    assert!(
        (1.2..2.0).contains(&(tall.0 / own.0)),
        "{} {}",
        tall.0,
        own.0
    );
    // Its band is taken in, and what hangs beside the legs grows less than hips do.
    assert!(
        (1.05..2.0).contains(&(wide.0 / own.0)),
        "{} {}",
        wide.0,
        own.0
    );
    assert!(wide.1.contains("\"label\": \"XXL\""), "{}", wide.1);
    assert!(!own.1.contains("\"label\""));
}

#[test]
fn a_model_of_a_character_knows_its_height_and_sizes_where_it_was_taught_any() {
    let folder = Folder::new("hero-sizes");
    let hero = character(&folder);
    let (model, out) = (folder.at("any.muslin"), folder.at("wide.glb"));
    for line in [
        format!(
            "train --body {hero} --height 185 --garment tee --edge 25 --sizes any --motion walk --motion run \
             --mixed 60 --steps 1 -o {model}"
        ),
        format!(
            "animate --body {hero} --model {model} --size XL --refine 0 --motion walk --seconds 0.1 -o {out}"
        ),
    ] {
        let done = typed(&line);
        assert_eq!(done.status.code(), Some(0), "{line}: {}", errors(&done));
    }
    let report = std::fs::read_to_string(folder.at("wide.report.json")).expect("written");
    // As tall as it was when it was taught.
    for told in [
        "\"label\": \"XL\"",
        "\"not_taught\": []",
        "\"height_cm\": 185",
    ] {
        assert!(report.contains(told), "{told} is missing:\n{report}");
    }
}

#[test]
fn in_a_program_a_model_of_a_file_s_garment_plays_where_the_file_is_named() {
    let folder = Folder::new("file-plays");
    let (skirt, model) = (skirt(&folder), folder.at("skirt.muslin"));
    let line = format!(
        "train --garment {skirt} --edge 25 --motion walk --motion run --mixed 60 --steps 1 -o {model}"
    );
    let done = typed(&line);
    assert_eq!(done.status.code(), Some(0), "{line}: {}", errors(&done));
    let bytes = std::fs::read(&model).expect("written");
    let open = |outfit: Vec<Wear>| {
        let options = DressOptions {
            outfit,
            ..DressOptions::default()
        };
        Playing::new(Some(&bytes), &options)
    };
    let fault = open(Vec::new()).expect_err("which file it is");
    assert!(fault.to_string().contains("from a file"), "{fault}");
    let mut playing = open(vec![Wear::parse(&skirt)]).expect("a garment of a file");
    let turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.bones().len()];
    let joint = |name: &str| {
        let bone = playing.bones().iter().position(|b| b.name == name);
        playing.joints()[bone.expect("a bone")].y
    };
    let (hip, knee) = (joint("upperleg01.L"), joint("lowerleg01.L"));
    let at = playing.frame(&turns, [0.0; 3]).expect("sound");
    let ys = at.iter().map(|p| f64::from(p[1]));
    let (low, high) = ys.fold((f64::MAX, f64::MIN), |(a, b), y| (a.min(y), b.max(y)));
    // From the waist to about the knee.
    assert!(
        high > hip && (low - knee).abs() < 0.15,
        "{low} {high} {hip} {knee}"
    );
}

#[test]
fn in_a_program_a_character_s_joints_lead_the_cloth_that_animate_writes() {
    let folder = Folder::new("hero-plays");
    let hero = character(&folder);
    let (out, npz) = (folder.at("dressed.glb"), folder.at("dressed.npz"));
    let mut options = DressOptions {
        outfit: vec![Wear::parse("tee")],
        body: Some(hero.clone().into()),
        ..DressOptions::default()
    };
    let file = read_character(Path::new(&hero)).expect("it can be read");
    let frames = file.play(0, 30.0).expect("it plays");
    let own = file.character.height();
    for height in [None, Some(2.1)] {
        let asked = height.map_or(String::new(), |h| format!("--height {}", h * 100.0));
        let line = format!(
            "animate --body {hero} --garment tee --motion wave --fps 30 --motion-level 0 --refine 0 {asked} --npz {npz} -o {out}"
        );
        let done = typed(&line);
        assert_eq!(done.status.code(), Some(0), "{line}: {}", errors(&done));
        let clip = read_clip(Path::new(&npz)).expect("it can be read");
        assert_eq!(clip.drape.frames.len(), frames.len());
        options.height = height;
        let mut playing = Playing::new(None, &options).expect("a garment on a character");
        playing.set_motion_level(0.0);
        assert_eq!(playing.character_joints(), file.character.names);
        let scale = height.map_or(1.0, |h| h / own);
        let mut shift = None;
        for (joints, cloth) in frames.iter().zip(&clip.drape.frames) {
            let joints: Vec<[f32; 16]> = (joints.iter())
                .map(|j| DMat4::from(*j).to_cols_array().map(|x| x as f32))
                .collect();
            let at = playing.frame_on(&joints).expect("sound");
            assert_eq!(at.len(), cloth.len());
            // In its file's places, which differ from ours by its size and where it stands.
            let ours = |p: &[f32; 3]| scale * DVec3::from_array(p.map(f64::from));
            let shift = *shift.get_or_insert(cloth[0] - ours(&at[0]));
            let apart = |(p, q): (&[f32; 3], &DVec3)| (ours(p) + shift).distance(*q);
            let worst = at.iter().zip(cloth).map(apart).fold(0.0, f64::max);
            assert!(worst < 5e-5, "{height:?}: {worst}");
        }
    }
}

#[test]
fn what_cannot_be_dressed_is_refused_in_words() {
    let folder = Folder::new("no-hero");
    let (out, bad) = (folder.at("a.glb"), folder.at("bad.gltf"));
    std::fs::write(
        &bad,
        br#"{"asset":{"version":"2.0"},"nodes":[{"name":"box"}]}"#,
    )
    .expect("written");
    for (args, exit, told) in [
        (vec!["--body", &bad], 3, "a character needs a skeleton"),
        (vec!["--body", &folder.at("none.glb")], 5, "no such file"),
        (
            vec!["--body", &bad, "--weight", "70"],
            2,
            "a character has a shape of its own",
        ),
    ] {
        let all = [&["simulate", "-o", &out][..], &args[..]].concat();
        let done = muslin(&all);
        assert_eq!(
            done.status.code(),
            Some(exit),
            "{args:?}: {}",
            errors(&done)
        );
        assert!(errors(&done).contains(told), "{args:?}: {}", errors(&done));
    }
    assert!(!Path::new(&out).exists());
    let args = ["train", "--body", &bad, "--shape", "any", "-o", "a.muslin"];
    let done = muslin(&args);
    assert_eq!(done.status.code(), Some(2), "{}", errors(&done));
    assert!(errors(&done).contains("--shape"), "{}", errors(&done));
    let far = typed(&format!(
        "simulate --body {} --height 230 --size XS -o {out}",
        character(&folder)
    ));
    assert_eq!(far.status.code(), Some(3), "{}", errors(&far));
    assert!(
        errors(&far).contains("this character has"),
        "{}",
        errors(&far)
    );
}
