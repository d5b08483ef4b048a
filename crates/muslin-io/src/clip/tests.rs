use super::*;
use crate::testing::Folder;

/// Two garments of one square each over a body of one triangle, three frames.
fn sample() -> Clip {
    let frame = |t: f64| -> Vec<DVec3> {
        (0..8)
            .map(|i| DVec3::new(f64::from(i % 2), 0.25 * t, f64::from(i / 2)))
            .collect()
    };
    let part = |name: &str, k: usize| Part {
        name: name.into(),
        verts: 4 * k..4 * k + 4,
        faces: 2 * k..2 * k + 2,
    };
    let faces = vec![[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]];
    let corners = faces
        .iter()
        .map(|f: &[u32; 3]| f.map(|i| DVec2::new(f64::from(i % 2), f64::from(i / 2))))
        .collect();
    Clip {
        drape: Drape {
            parts: vec![part("trousers", 0), part("tee", 1)],
            faces,
            frames: (0..3).map(|t| frame(f64::from(t))).collect(),
            fps: 60.0,
        },
        body: (0..3)
            .map(|_| vec![DVec3::ZERO, DVec3::X, DVec3::Y])
            .collect(),
        body_faces: vec![[0, 1, 2]],
        rest: frame(0.0),
        corners,
        pins: vec![1, 2, 6],
        fabrics: vec!["my own twill".into(), String::new()],
        rate_unknown: false,
    }
}

#[test]
fn an_exchange_file_comes_back_garment_by_garment() {
    let clip = sample();
    let folder = Folder::new("clip-npz");
    let files = clip.npz_files("walk").expect("finite");
    let names: Vec<&str> = files.iter().map(|f| f.0.as_str()).collect();
    assert_eq!(names, ["walk.trousers.npz", "walk.tee.npz"]);
    for ((_, bytes), (_, want)) in files.iter().zip(clip.garments()) {
        let mut back = read_clip(&folder.put("a.npz", bytes)).expect("whole");
        back.drape.parts = want.drape.parts.clone();
        assert_eq!(back, want);
    }
    assert_eq!(
        clip.garments()[1].1.npz_files("walk").expect("finite")[0].0,
        "walk.npz"
    );
}

#[test]
fn garments_in_files_of_their_own_come_back_as_one_outfit_in_layer_order() {
    let clip = sample();
    let folder = Folder::new("clip-npz-all");
    for (name, bytes) in clip.npz_files("walk").expect("finite") {
        folder.put(&name, &bytes);
    }
    let as_folder = read_clip(folder.path()).expect("whole");
    let by_name = read_clip(&folder.path().join("walk.npz")).expect("whole");
    // Whatever rest shape not all of them have is left out, in files as in memory.
    let want = Clip::joined(clip.garments().into_iter().map(|g| g.1).collect());
    let want = want.expect("one rate");
    assert_eq!(as_folder, want);
    assert_eq!(by_name, want);
    let parts: Vec<&str> = as_folder
        .drape
        .parts
        .iter()
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(parts, ["trousers", "tee"], "not by name");

    let mut other = clip.garments().swap_remove(1).1;
    other.body[0][0].x += 0.5;
    folder.put("run.npz", &other.npz().expect("finite"));
    let fault = read_clip(folder.path())
        .expect_err("another motion")
        .to_string();
    assert!(
        fault.contains("run.npz") && fault.contains("body"),
        "{fault}"
    );
    let own = read_clip(&folder.path().join("walk.npz"));
    assert_eq!(own.expect("those of the walk"), want);
    assert!(read_clip(&folder.path().join("sit.npz")).is_err());
}

#[test]
fn point_caches_come_back_in_layer_order_with_rate_and_body() {
    let clip = sample();
    let folder = Folder::new("clip-pc2");
    for (name, bytes) in clip.pc2_files().expect("finite") {
        folder.put(&name, &bytes);
    }
    let back = read_clip(folder.path()).expect("whole");
    let corners = |c: &Clip| c.corners.as_flattened().to_vec();
    let pairs = corners(&back).into_iter().zip(corners(&clip));
    assert!(pairs.clone().count() > 0 && pairs.into_iter().all(|(a, b)| a.distance(b) < 1e-8));
    let want = Clip {
        corners: back.corners.clone(),
        ..clip.clone()
    };
    assert_eq!(back, want);
    // Texture coordinates of other people are no pattern.
    let own = folder.path().join("tee.obj");
    let text = std::fs::read_to_string(&own).expect("it is there");
    folder.put(
        "tee.obj",
        text.replace("# pattern in metres\n", "").as_bytes(),
    );
    assert!(read_clip(folder.path()).expect("whole").corners.is_empty());
    let tee = read_clip(&folder.path().join("tee.pc2")).expect("whole");
    assert_eq!(
        (tee.drape.frames[2].clone(), tee.body.len()),
        (clip.drape.frames[2][4..].to_vec(), 3)
    );
}

#[test]
fn every_second_frame_keeps_the_time() {
    let thin = sample().every(2);
    assert_eq!(
        (thin.drape.frames.len(), thin.body.len(), thin.drape.fps),
        (2, 2, 30.0)
    );
    assert_eq!(thin.drape.frames[1], sample().drape.frames[2]);
    assert_eq!(sample().every(1), sample());
}

#[test]
fn what_is_not_finite_is_not_written_but_may_be_read_for_judging() {
    let mut clip = sample();
    clip.drape.frames[1][3].y = f64::NAN;
    assert!(clip.npz().is_err() && clip.pc2_files().is_err());
    let error = clip.npz().expect_err("not finite");
    assert!(error.to_string().contains("/cloth/1"), "{error}");
    assert!(clip.check_shape().is_ok());
}

#[test]
fn cut_and_foreign_files_are_errors() {
    let folder = Folder::new("clip-bad");
    let pc2 = write_pc2(&sample().drape.frames);
    for end in [0, 11, 20, 31, 32, 50, pc2.len() - 1] {
        assert!(read_pc2("a.pc2", &pc2[..end]).is_err(), "{end}");
    }
    let huge = [&pc2[..16], &[0xff, 0xff, 0xff, 0x7f], &pc2[20..]].concat();
    assert!(read_pc2("a.pc2", &huge).is_err());
    assert!(
        read_clip(&folder.put("a.pc2", &pc2)).is_err(),
        "no OBJ beside it"
    );
    assert!(read_clip(&folder.put("a.npz", b"nothing")).is_err());
    folder.put("a.obj", b"v 0 0 0\nf 1 2 3\n");
    assert!(read_clip(&folder.path().join("a.pc2")).is_err());
}

#[test]
fn files_for_numpy() {
    // Opt-in: `cargo xtask check npz` looks at what this leaves in the folder named here.
    let Some(folder) = std::env::var_os("MUSLIN_NPZ_SAMPLES") else {
        return println!("skipped: needs MUSLIN_NPZ_SAMPLES");
    };
    use muslin_body::{Avatar, Shape, motions};
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let motion = motions::make(&avatar, &figure, "wave", 10.0).expect("built in");
    let poses = crate::write_poses(&avatar, &motion).expect("finite");
    let mut files = sample().npz_files("clip").expect("finite");
    files.push(("poses.npz".into(), poses));
    for (name, bytes) in files {
        let path = Path::new(&folder).join(name);
        crate::write_file(&path, &bytes).expect("the folder can be written");
    }
}
