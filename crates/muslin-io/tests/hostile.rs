//! Characters and animations that are broken, or made to do harm: errors in words, at no cost.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use muslin_io::{CharacterFile, Input, IoError, read_animation, read_character, read_moving};
use serde_json::{Value, json};

/// The bytes of a `.glb`.
fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| u32::try_from(n).expect("small").to_le_bytes();
    let total = 28 + text.len() + bin.len();
    let head = [&b"glTF\x02\0\0\0"[..], &word(total), &word(text.len())].concat();
    let bin = [&word(bin.len()), &b"BIN\0"[..], bin].concat();
    [head, b"JSON".to_vec(), text, bin].concat()
}

fn character(json: &Value, bin: &[u8]) -> Result<CharacterFile, IoError> {
    static FILES: AtomicUsize = AtomicUsize::new(0);
    let n = FILES.fetch_add(1, Ordering::Relaxed);
    let name = format!("muslin-hostile-{}-{n}.glb", std::process::id());
    let path: PathBuf = std::env::temp_dir().join(name);
    std::fs::write(&path, glb(json, bin)).expect("a temporary file");
    let read = read_character(Path::new(&path));
    let _ = std::fs::remove_file(&path);
    read
}

fn refusal(json: &Value) -> IoError {
    character(json, &[]).expect_err("it is not sound")
}

/// An accessor of zeros, for which a file needs no data.
fn zeros(kind: &str, n: usize) -> Value {
    json!({ "type": kind, "componentType": 5126, "count": n })
}

/// A triangle on two joints, all of it at the origin.
fn hero() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "children": [1] }, {}, { "mesh": 0, "skin": 0 }],
        "skins": [{ "joints": [0, 1] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [zeros("VEC3", 3)],
    })
}

/// The same with an animation of this many keys, at these times [s], which are the file's data.
fn moving_hero(times: &[f32]) -> (Value, Vec<u8>) {
    let mut json = hero();
    let bin: Vec<u8> = times.iter().flat_map(|t| t.to_le_bytes()).collect();
    let keys =
        json!({ "type": "SCALAR", "componentType": 5126, "count": times.len(), "bufferView": 0 });
    json["bufferViews"] = json!([{ "buffer": 0, "byteLength": bin.len() }]);
    json["accessors"] = json!([zeros("VEC3", 3), keys, zeros("VEC3", times.len())]);
    json["animations"] = json!([{
        "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
        "samplers": [{ "input": 1, "output": 2 }],
    }]);
    (json, bin)
}

#[test]
fn a_small_character_is_read() {
    let read = character(&hero(), &[]).expect("sound");
    assert_eq!(read.character.parents, [None, Some(0)]);
    assert_eq!(
        (read.character.verts.len(), read.character.faces.len()),
        (3, 1)
    );
}

/// Vertices take the colour of their material and of its picture where they lie on it; one that cannot be read is none.
#[test]
fn a_character_has_the_colours_of_its_materials_and_of_their_pictures() {
    let picture = muslin_geom::Image {
        width: 2,
        height: 1,
        pixels: vec![[255, 0, 0, 255], [0, 0, 255, 255]],
    };
    let picture = muslin_io::png(&picture);
    let uvs: Vec<u8> = [[0.2f32, 0.5], [0.8, 0.5], [1.3, -0.5]]
        .concat()
        .into_iter()
        .flat_map(f32::to_le_bytes)
        .collect();
    let mut json = hero();
    let flat = json!({ "type": "VEC2", "componentType": 5126, "count": 3, "bufferView": 0 });
    json["accessors"] = json!([zeros("VEC3", 3), flat]);
    json["meshes"][0]["primitives"][0] =
        json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 });
    json["materials"] = json!([{ "pbrMetallicRoughness": {
        "baseColorFactor": [0.5, 1.0, 0.25, 1.0], "baseColorTexture": { "index": 0 },
    }}]);
    json["textures"] = json!([{ "source": 0 }]);
    json["images"] = json!([{ "bufferView": 1, "mimeType": "image/png" }]);
    json["bufferViews"] = json!([
        { "buffer": 0, "byteLength": uvs.len() },
        { "buffer": 0, "byteOffset": uvs.len(), "byteLength": picture.len() },
    ]);
    let colours = |bin: &[u8]| character(&json, bin).expect("sound").colours();
    let whole = colours(&[uvs.clone(), picture.clone()].concat());
    assert_eq!(whole, [[0.5, 0.0, 0.0], [0.0, 0.0, 0.25], [0.5, 0.0, 0.0]]);
    let torn = colours(&[uvs, vec![7; picture.len()]].concat());
    assert_eq!(torn, [[0.5, 1.0, 0.25]; 3]);
}

#[test]
fn a_skin_without_joints_is_an_error_where_a_mesh_has_it() {
    let mut json = hero();
    json["skins"] = json!([{ "joints": [0, 1] }, { "joints": [] }]);
    assert!(character(&json, &[]).is_ok(), "nothing has it");
    json["nodes"] = json!([{ "children": [1] }, {}, { "mesh": 0, "skin": 1 }]);
    let fault = refusal(&json);
    assert!(fault.to_string().contains("no joints"), "{fault}");
    assert_eq!(fault.exit_code(), 3, "{fault}");
}

#[test]
fn joints_of_a_skin_that_a_garment_shares_are_looked_at() {
    let garment = json!({ "mesh": 0, "skin": 0, "extras": { "muslin": "garment" } });
    for (joint, is_sound) in [(999, false), (3, false), (1, true)] {
        let mut json = hero();
        let mesh = json!({ "mesh": 0, "skin": 0 });
        json["nodes"] = json!([{ "children": [1] }, {}, mesh, {}, garment]);
        json["skins"] = json!([{ "joints": [joint] }, { "joints": [0, 1] }]);
        let read = character(&json, &[]);
        assert_eq!(read.is_ok(), is_sound, "joint {joint}");
        if let Err(fault) = read {
            assert!(fault.to_string().contains("/skins/0"), "{fault}");
            assert_eq!(fault.exit_code(), 3, "{fault}");
        }
    }
}

#[test]
fn animations_without_end_are_refused_before_a_frame_is_made() {
    let play = |end: f32, fps: f64| {
        let (json, bin) = moving_hero(&[0.0, end]);
        let file = character(&json, &bin).expect("sound as it stands");
        file.play(0, fps).map(|frames| frames.len())
    };
    assert_eq!(play(1.0, 30.0).expect("a second"), 31);
    for (end, fps, told) in [
        (1e9, 30.0, "too long"),
        (f32::INFINITY, 30.0, "too long"),
        (36_000.0, 60.0, "too many frames"),
    ] {
        let fault = play(end, fps).expect_err("beyond a limit");
        assert!(fault.to_string().contains(told), "{fault}");
        assert!(fault.to_string().contains("/animations/0"), "{fault}");
        assert_eq!(fault.exit_code(), 4, "{fault}");
    }
}

#[test]
fn frames_of_many_joints_are_refused_earlier() {
    let (mut json, bin) = moving_hero(&[0.0, 1000.0]);
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    nodes.resize(4003, json!({}));
    json["skins"] = json!([{ "joints": (0..2).chain(3..4003).collect::<Vec<usize>>() }]);
    let file = character(&json, &bin).expect("sound as it stands");
    let fault = file.play(0, 30.0).expect_err("11 GiB");
    assert!(fault.to_string().contains("too many frames"), "{fault}");
    assert_eq!(fault.exit_code(), 4, "{fault}");
    assert_eq!(file.play(0, 0.01).expect("eleven frames").len(), 11);
}

#[test]
fn joints_are_limited_in_number_and_depth_and_do_not_hang_from_themselves() {
    let chain = |n: usize| {
        let mut json = hero();
        let mut nodes: Vec<Value> = (1..n).map(|i| json!({ "children": [i] })).collect();
        nodes.extend([json!({}), json!({ "mesh": 0, "skin": 0 })]);
        json["nodes"] = nodes.into();
        json["skins"] = json!([{ "joints": [n - 1] }]);
        json
    };
    // What is deep is where it says: a node at the end of a chain of shifts.
    let mut deep = chain(1000);
    for node in deep["nodes"]
        .as_array_mut()
        .expect("nodes")
        .iter_mut()
        .take(1000)
    {
        node["translation"] = json!([0.0, 1.0, 0.0]);
    }
    deep["skins"][0]["joints"] = json!([0, 999]);
    let read = character(&deep, &[]).expect("sound");
    assert_eq!(
        read.play(0, 30.0).expect("a still")[0][1].translation.y,
        1000.0
    );
    let mut crowd = hero();
    crowd["nodes"]
        .as_array_mut()
        .expect("nodes")
        .resize(5000, json!({}));
    crowd["skins"] = json!([{ "joints": (0..5000).filter(|i| *i != 2).collect::<Vec<usize>>() }]);
    let mut twice = hero();
    twice["skins"] = json!([{ "joints": vec![0; 5000] }]);
    let mut looped = hero();
    looped["nodes"] = json!([{ "children": [1] }, { "children": [0] }, { "mesh": 0, "skin": 0 }]);
    for (json, told, exit) in [
        (chain(1100), "below too many others", 4),
        (chain(100_000), "below too many others", 4),
        (crowd, "too many joints", 4),
        (twice, "too many joints", 4),
        (looped, "their own ancestors", 3),
    ] {
        let fault = refusal(&json);
        assert!(fault.to_string().contains(told), "{fault}");
        assert_eq!(fault.exit_code(), exit, "{fault}");
    }
}

#[test]
fn what_is_too_much_or_of_another_kind_is_refused() {
    let mut many = hero();
    many["accessors"] = json!([zeros("VEC3", 2_000_001)]);
    let mut twice = hero();
    twice["accessors"] = json!([zeros("VEC3", 1_000_001)]);
    twice["meshes"][0]["primitives"] = json!(vec![hero()["meshes"][0]["primitives"][0].clone(); 2]);
    let mut numbers = hero();
    numbers["meshes"][0]["primitives"][0]["indices"] = json!(1);
    numbers["accessors"] = json!([zeros("VEC3", 3), zeros("SCALAR", 1 << 30)]);
    let mut draco = hero();
    draco["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    for (json, told) in [
        (many, "two million vertices"),
        (twice, "two million vertices"),
        (numbers, "too many numbers"),
        (draco, "KHR_draco_mesh_compression"),
    ] {
        let fault = refusal(&json);
        let text = fault.to_string();
        assert!(text.contains(told) && text.contains("allowed"), "{fault}");
        assert!(!fault.hint().is_empty(), "{fault}");
        assert_eq!(fault.exit_code(), 4, "{fault}");
    }
}

/// A cloth of one triangle and `n` vertices, all of it at the origin.
fn cloth(n: usize) -> Value {
    let part = json!({ "attributes": { "POSITION": 0 }, "indices": 1 });
    json!({
        "nodes": [{ "mesh": 0, "name": "tee" }, {}],
        "meshes": [{ "primitives": [part] }],
        "accessors": [zeros("VEC3", n), zeros("SCALAR", 3)],
    })
}

#[test]
fn targets_without_data_are_refused_before_one_is_made() {
    let targets = |n: usize, count: usize| {
        let mut json = cloth(count);
        let target = json!({ "POSITION": 0 });
        json["meshes"][0]["primitives"][0]["targets"] = json!(vec![target; n]);
        glb(&json, &[])
    };
    assert!(read_moving("a.glb", &targets(50, 3)).is_ok());
    let bytes = targets(50, 89_000_000);
    assert!(bytes.len() < 2000);
    let fault = read_moving("a.glb", &bytes).expect_err("100 GB");
    assert!(fault.to_string().contains("too many numbers"), "{fault}");
    assert_eq!(fault.exit_code(), 4, "{fault}");
}

/// Moves the first two nodes, at times of their own [s].
fn moved(json: &mut Value, times: [&[f32]; 2]) -> Vec<u8> {
    let bin: Vec<u8> = times
        .concat()
        .iter()
        .flat_map(|t| t.to_le_bytes())
        .collect();
    json["bufferViews"] = json!([{ "buffer": 0, "byteLength": bin.len() }]);
    let first = json["accessors"].as_array().expect("accessors").len();
    let (mut channels, mut samplers) = (Vec::new(), Vec::new());
    for (k, start) in [0, 4 * times[0].len()].into_iter().enumerate() {
        let n = times[k].len();
        let keys = json!({ "type": "SCALAR", "componentType": 5126, "count": n, "bufferView": 0, "byteOffset": start });
        let accessors = json["accessors"].as_array_mut().expect("accessors");
        accessors.extend([keys, zeros("VEC3", n)]);
        samplers.push(json!({ "input": first + 2 * k, "output": first + 2 * k + 1 }));
        let target = json!({ "node": k, "path": "translation" });
        channels.push(json!({ "sampler": k, "target": target }));
    }
    json["animations"] = json!([{ "channels": channels, "samplers": samplers }]);
    bin
}

#[test]
fn of_tracks_of_equal_length_the_one_that_ends_last_is_played() {
    for times in [[&[0.0, 0.5][..], &[0.0, 2.0]], [&[0.0, 2.0], &[0.0, 0.5]]] {
        for _ in 0..20 {
            let mut json = cloth(3);
            let bin = moved(&mut json, times);
            let clip = read_moving("a.glb", &glb(&json, &bin)).expect("sound");
            assert_eq!(clip.drape.fps, 0.5);
        }
    }
}

#[test]
fn positions_in_all_frames_are_limited() {
    let times: Vec<f32> = (0..500).map(|k| k as f32).collect();
    let mut json = cloth(600_000);
    let bin = moved(&mut json, [&times, &times]);
    let fault = read_moving("a.glb", &glb(&json, &bin)).expect_err("7 GB");
    assert!(fault.to_string().contains("too many positions"), "{fault}");
    assert_eq!(fault.exit_code(), 4, "{fault}");
}

/// A body's hips and a leg, in frames that are turned at rest; the leg turns on by a right angle about X in a second.
fn turned_leg() -> (Value, Vec<u8>) {
    let half = 0.5f32.sqrt();
    let mut json = json!({
        "asset": { "version": "2.0" },
        "extensions": { "VRMC_vrm_animation": { "humanoid": { "humanBones": {
            "hips": { "node": 1 }, "leftUpperLeg": { "node": 2 },
        }}}},
        "nodes": [
            { "scale": [0.01, 0.01, 0.01], "children": [1] },
            { "name": "a", "translation": [0, 90, 0], "rotation": [half, 0, 0, half], "children": [2] },
            { "name": "b", "translation": [0, 0, 10], "rotation": [half, 0, 0, half] },
            { "name": "eyes", "translation": [0, 1, 5] },
        ],
        "animations": [
            { "channels": [{ "sampler": 0, "target": { "node": 3, "path": "translation" } }],
              "samplers": [{ "input": 0, "output": 1 }], "name": "look" },
            { "channels": [{ "sampler": 0, "target": { "node": 2, "path": "rotation" } }],
              "samplers": [{ "input": 0, "output": 2 }], "name": "kick" },
        ],
    });
    // Times, a place that stays, and turns of a quarter and of a half.
    let numbers = [
        &[0.0f32, 1.0][..],
        &[0.0; 6],
        &[half, 0.0, 0.0, half, 1.0, 0.0, 0.0, 0.0],
    ];
    let mut bin = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    for (k, (list, kind)) in numbers.iter().zip(["SCALAR", "VEC3", "VEC4"]).enumerate() {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": 4 * list.len() }));
        accessors.push(json!({ "type": kind, "componentType": 5126, "count": 2, "bufferView": k }));
        bin.extend(list.iter().flat_map(|x| x.to_le_bytes()));
    }
    (json["bufferViews"], json["accessors"]) = (views.into(), accessors.into());
    (json, bin)
}

#[test]
fn an_animation_without_skin_is_a_recording_in_the_worlds_axes_and_the_files_lengths() {
    let (json, bin) = turned_leg();
    let input = Input {
        file: "kick.vrma".into(),
        bytes: glb(&json, &bin),
    };
    let read = |clip: Option<&str>| read_animation(Path::new("kick.vrma"), &input, (clip, 2.0));
    let animation = read(Some("kick")).expect("sound");
    assert_eq!(animation.clips, ["look", "kick"]);
    let recording = animation.recording;
    // What is looked at hangs from nobody who moves.
    assert_eq!(recording.skeleton.names, ["", "hips", "leftUpperLeg"]);
    assert_eq!(recording.skeleton.parents, [None, Some(0), Some(1)]);
    let close = |a: DVec3, b: [f64; 3]| a.distance(b.into()) < 1e-6;
    // At rest the leg's place is 10 cm down its parent's Z, which points down.
    assert!(close(recording.skeleton.offsets[1], [0.0, 0.9, 0.0]));
    assert!(close(recording.skeleton.offsets[2], [0.0, -0.1, 0.0]));
    assert_eq!((recording.fps, recording.frames.len()), (2.0, 3));
    for (k, frame) in recording.frames.iter().enumerate() {
        assert!(close(frame.translations[2], [0.0, -0.1, 0.0]), "{frame:?}");
        let turn = frame.rotations[2] * DVec3::Y;
        let angle = 0.25 * std::f64::consts::PI * k as f64;
        assert!(close(turn, [0.0, angle.cos(), angle.sin()]), "{turn}");
        assert!(frame.rotations[1].angle_between(glam::DQuat::IDENTITY) < 1e-6);
    }
    assert_eq!(
        read(Some("2")).expect("by number").recording.frames.len(),
        3
    );
    let fault = read(Some("jump")).expect_err("there is none");
    assert_eq!((fault.code(), fault.exit_code()), ("no-animation", 3));
    assert!(fault.to_string().contains("look, kick"), "{fault}");
}

#[test]
fn joints_that_stand_still_below_what_moves_are_joints() {
    let (mut json, bin) = turned_leg();
    // Exporters leave out what does not change; here nobody says what the nodes are, either.
    let said = json.as_object_mut().expect("an object");
    said.remove("extensions");
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    nodes[2]["children"] = json!([4, 5]);
    nodes.push(json!({ "name": "shin", "translation": [0, 40, 0] }));
    nodes.push(json!({ "name": "boot", "mesh": 0 }));
    let input = Input {
        file: "kick.glb".into(),
        bytes: glb(&json, &bin),
    };
    let kick = read_animation(Path::new("kick.glb"), &input, (Some("kick"), 2.0));
    let skeleton = kick.expect("sound").recording.skeleton;
    assert_eq!(skeleton.names, ["", "a", "b", "shin"]);
}

#[test]
fn an_animation_that_ends_with_a_frame_has_that_frame() {
    for last in 1..=600u16 {
        let end = f32::from(last) / 30.0;
        let (mut json, mut bin) = turned_leg();
        bin[4..8].copy_from_slice(&end.to_le_bytes());
        json["animations"].as_array_mut().expect("two").remove(0);
        let input = Input {
            file: "kick.vrma".into(),
            bytes: glb(&json, &bin),
        };
        for fps in [30.0, 60.0] {
            let kick = read_animation(Path::new("kick.vrma"), &input, (None, fps));
            let frames = kick.expect("sound").recording.frames.len();
            assert_eq!(frames, usize::from(last) * fps as usize / 30 + 1, "{last}");
        }
    }
}
