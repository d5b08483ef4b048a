//! Moving GLB files, written and read back: cloth and body must be where they were.

use glam::{DAffine3, DVec2, DVec3};
use muslin_body::{Avatar, ExportRig, Figure, Part as Of, Shape, motions};
use muslin_geom::{Bake, Baked, Mesh, Part, self_intersections};
use muslin_io::{Clip, Moved, Node, Scene, Skinned, moving_glb, read_clip};

struct Stage {
    avatar: Avatar,
    figure: Figure,
    rig: ExportRig,
}

impl Stage {
    fn new() -> Self {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.figure(&Shape::default()).expect("an adult");
        let rig = avatar.export_rig();
        Self {
            avatar,
            figure,
            rig,
        }
    }

    /// The tights as cloth that also breathes, on a body that moves; and the body's bones.
    fn clip(&self, name: &str, n: usize) -> (Clip, Vec<Vec<DAffine3>>) {
        let motion = motions::make(&self.avatar, &self.figure, name, 30.0).expect("built in");
        let tights = self.avatar.part(Of::Tights);
        let faces = self.avatar.tights_faces();
        let faces: Vec<[u32; 3]> = faces
            .iter()
            .map(|f| f.map(|i| i - tights.start as u32))
            .collect();
        let mut clip = Clip::default();
        let mut bones = Vec::new();
        let step = motion.poses.len() / n;
        for (t, pose) in motion.poses.iter().step_by(step).take(n).enumerate() {
            let posed = self.avatar.pose(&self.figure, pose);
            let breath = |x: &DVec3| *x + DVec3::Y * 0.003 * (30.0 * x.x + t as f64).sin();
            clip.drape
                .frames
                .push(posed.verts[tights.clone()].iter().map(breath).collect());
            clip.body
                .push(posed.verts[..self.avatar.part(Of::Eyes).end].to_vec());
            bones.push(self.rig.source.iter().map(|&b| posed.bones[b]).collect());
        }
        clip.drape.fps = 30.0;
        clip.drape.parts = vec![Part {
            name: "tights".into(),
            verts: 0..tights.len(),
            faces: 0..faces.len(),
        }];
        let corner =
            |f: &[u32; 3]| f.map(|i| DVec2::new(f64::from(i) * 1e-3, f64::from(f[0]) * 1e-3));
        clip.corners = faces.iter().map(corner).collect();
        clip.pins = vec![0, 7, tights.len() as u32 - 1];
        clip.fabrics = vec!["nylon-taffeta".into()];
        clip.drape.faces = faces;
        clip.body_faces = self.avatar.body_faces().to_vec();
        (clip, bones)
    }

    fn glb(&self, clip: &Clip, bones: Vec<Vec<DAffine3>>) -> Vec<u8> {
        self.baked_glb(clip, bones, None)
    }

    /// With the cloth as handles and shapes, and without the left half of the body, if `baked`.
    fn baked_glb(&self, clip: &Clip, bones: Vec<Vec<DAffine3>>, baked: Option<Baked>) -> Vec<u8> {
        let uvs: Vec<DVec2> = self
            .avatar
            .uvs()
            .iter()
            .map(|u| DVec2::new(u[0].into(), u[1].into()))
            .collect();
        let node = |name: &str, verts: &[DVec3], faces: &[[u32; 3]]| Node {
            name: name.into(),
            mesh: Mesh {
                verts: verts.to_vec(),
                faces: faces.to_vec(),
            },
            ..Node::default()
        };
        let body = node("body", &clip.body[0], &clip.body_faces);
        let (body, source) = body.with_corner_uvs_and_sources(self.avatar.body_face_uvs(), &uvs);
        let body = Moved {
            node: body,
            source,
            baked: None,
        };
        let is_left = |i: u32| clip.body[0][i as usize].x > 0.0;
        let body = match baked.is_some() {
            true => body.without(is_left),
            false => body,
        };
        let cloth = node("tights", &clip.drape.frames[0], &clip.drape.faces);
        // A seam through the middle: corners of faces on the left have coordinates of their own.
        let n = clip.n_verts() as u32;
        let left = |f: &[u32; 3]| clip.drape.frames[0][f[0] as usize].x > 0.0;
        let corners: Vec<[u32; 3]> = clip
            .drape
            .faces
            .iter()
            .map(|f| if left(f) { f.map(|i| i + n) } else { *f })
            .collect();
        let uvs: Vec<DVec2> = (0..2 * n)
            .map(|i| DVec2::new(f64::from(i) * 1e-4, 0.5))
            .collect();
        let (cloth, source) = cloth.with_corner_uvs_and_sources(&corners, &uvs);
        let cloth = Moved {
            node: cloth,
            source,
            baked,
        };
        let skin = Skinned {
            rig: &self.rig.rig,
            heads: self
                .rig
                .source
                .iter()
                .map(|&b| self.figure.joints[b])
                .collect(),
            rest: &self.figure.verts,
            bones,
        };
        let scene = Scene {
            name: "walk".into(),
            ..Scene::default()
        };
        moving_glb(&scene, clip, Some((&body, &skin)), &[cloth]).expect("a sound clip")
    }
}

/// All cloth of a clip as one garment without looks.
fn alone(clip: &Clip) -> Moved {
    Moved {
        node: Node {
            mesh: Mesh {
                verts: clip.drape.frames[0].clone(),
                faces: clip.drape.faces.clone(),
            },
            ..Node::default()
        },
        source: (0..clip.n_verts() as u32).collect(),
        baked: None,
    }
}

fn farthest(a: &[Vec<DVec3>], b: &[Vec<DVec3>]) -> f64 {
    assert_eq!(a.len(), b.len());
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.map(|(x, y)| x.distance(*y)).fold(0.0, f64::max)
}

fn back(bytes: &[u8], name: &str) -> Clip {
    let path =
        std::env::temp_dir().join(format!("muslin-moving-{}-{name}.glb", std::process::id()));
    std::fs::write(&path, bytes).expect("a temporary file");
    let clip = read_clip(&path);
    let _ = std::fs::remove_file(&path);
    clip.expect("our own file")
}

#[test]
fn cloth_and_body_come_back_from_any_motion() {
    let stage = Stage::new();
    for name in ["walk", "cartwheel", "spin"] {
        let (clip, bones) = stage.clip(name, 7);
        let bytes = stage.glb(&clip, bones);
        let read = back(&bytes, name);
        assert_eq!(read.drape.parts, clip.drape.parts);
        assert_eq!(read.drape.faces, clip.drape.faces);
        assert_eq!(read.body_faces, clip.body_faces);
        assert_eq!(read.corners.len(), clip.corners.len());
        assert_eq!((&read.pins, &read.fabrics), (&clip.pins, &clip.fabrics));
        let (cloth, body) = (
            farthest(&read.drape.frames, &clip.drape.frames),
            farthest(&read.body, &clip.body),
        );
        println!(
            "{name}: {} bytes, cloth {cloth:.2e} m, body {body:.2e} m",
            bytes.len()
        );
        assert!(cloth < 6e-5, "{name}: cloth is off by {cloth} m");
        assert!(body < 1.2e-5, "{name}: the body is off by {body} m");
    }
}

#[test]
fn cloth_that_lies_close_is_not_rounded_through_itself() {
    // Two sheets a metre wide, a millionth of a metre apart in the second frame alone.
    let n = 24;
    let sheet = |shift: f64, gap: f64| {
        let at = move |k: usize| {
            let x = (k % n) as f64 / (n - 1) as f64 + shift;
            let z = (k / n) as f64 / (n - 1) as f64 + 0.3 * shift;
            DVec3::new(x, 0.11 * x + 0.07 * z + gap, z)
        };
        (0..n * n).map(at)
    };
    let frame = |gap: f64| sheet(0.0, 0.0).chain(sheet(0.013, gap)).collect();
    let quads = (0..2 * n * n).filter(|k| k % n < n - 1 && k % (n * n) < n * (n - 1));
    let faces = quads.flat_map(|k| [[k, k + n, k + 1], [k + 1, k + n, k + n + 1]]);
    let mut clip = Clip::default();
    clip.drape.frames = [0.01, 1e-6, 0.01].map(frame).to_vec();
    clip.drape.fps = 30.0;
    clip.drape.faces = faces.map(|f| f.map(|i| i as u32)).collect();
    let crossings = |verts: &[DVec3]| {
        let (verts, faces) = (verts.to_vec(), clip.drape.faces.clone());
        self_intersections(&Mesh { verts, faces }).len()
    };
    assert_eq!(crossings(&clip.drape.frames[1]), 0);
    let bytes = moving_glb(&Scene::default(), &clip, None, &[alone(&clip)]).expect("a sound clip");
    let read = back(&bytes, "close");
    let off = |t: usize| farthest(&read.drape.frames[t..=t], &clip.drape.frames[t..=t]);
    assert_eq!(crossings(&read.drape.frames[1]), 0);
    assert!(off(1) < 3e-7, "in single floats: {}", off(1));
    assert!(off(2) > 3e-6, "in cells: {}", off(2));
    // Off by as much as what is in cells, it would cross.
    let off = read.drape.frames[2].iter().zip(&clip.drape.frames[2]);
    let off = off.map(|(a, b)| *a - *b);
    let close = clip.drape.frames[1].iter().zip(off).map(|(x, r)| *x + r);
    assert!(crossings(&close.collect::<Vec<_>>()) > 0);
}

#[test]
fn baked_cloth_comes_back_as_handles_and_shapes_have_it() {
    let stage = Stage::new();
    for (name, handles, shapes) in [("walk", 40, 0), ("cartwheel", 12, 6)] {
        let (clip, bones) = stage.clip(name, 12);
        let baked = Baked::new(
            &clip.drape.frames,
            &clip.drape.faces,
            Bake { handles, shapes },
        );
        let meant: Vec<Vec<DVec3>> = (0..12).map(|t| baked.frame(t)).collect();
        assert!(
            farthest(&meant, &clip.drape.frames) > 2e-4,
            "{name}: something is lost"
        );
        let (whole, bytes) = (
            stage.glb(&clip, bones.clone()).len(),
            stage.baked_glb(&clip, bones, Some(baked)),
        );
        let read = back(&bytes, &format!("{name}-baked"));
        assert_eq!(read.drape.parts, clip.drape.parts);
        assert_eq!(read.drape.faces, clip.drape.faces);
        // Shapes are stored in 127ths.
        let off = farthest(&read.drape.frames, &meant);
        println!(
            "{name}: {} of {whole} bytes, off by {off:.2e} m",
            bytes.len()
        );
        assert!(off < 5e-4, "{name}: the file is off by {off} m");
        let half = read.body_faces.len() as f64 / clip.body_faces.len() as f64;
        assert!((0.45..0.6).contains(&half), "{name}: {half} of the body");
        let rightmost = |x: &DVec3| x.x < 0.05;
        assert!(
            read.body[0].iter().filter(|x| !rightmost(x)).count() < 20,
            "{name}"
        );
    }
}

#[test]
fn a_still_is_one_frame_and_the_rate_is_kept() {
    let stage = Stage::new();
    let (mut clip, mut bones) = stage.clip("wave", 3);
    clip.drape.fps = 59.94;
    let bytes = stage.glb(&clip, bones.clone());
    assert!((back(&bytes, "rate").drape.fps - 59.94).abs() < 1e-3);
    clip.drape.frames.truncate(1);
    clip.body.truncate(1);
    bones.truncate(1);
    assert_eq!(
        back(&stage.glb(&clip, bones), "still").drape.frames.len(),
        1
    );
}

#[test]
fn what_does_not_go_together_or_is_not_finite_is_not_written() {
    let stage = Stage::new();
    let (mut clip, _) = stage.clip("wave", 2);
    let moved = alone(&clip);
    let write = |clip: &Clip, moved: &Moved| {
        moving_glb(&Scene::default(), clip, None, std::slice::from_ref(moved))
    };
    assert!(write(&clip, &moved).is_ok());
    let mut short = moved.clone();
    short.source.pop();
    assert!(write(&clip, &short).is_err());
    clip.drape.frames[1][5].z = f64::INFINITY;
    assert!(write(&clip, &moved).is_err());
}

#[test]
fn no_cut_or_damaged_file_panics() {
    let stage = Stage::new();
    let (clip, bones) = stage.clip("wave", 2);
    let whole = stage.glb(&clip, bones);
    let path = std::env::temp_dir().join(format!("muslin-moving-{}-cut.glb", std::process::id()));
    let json = u32::from_le_bytes([whole[12], whole[13], whole[14], whole[15]]) as usize;
    let ends = [
        5,
        12,
        19,
        25,
        20 + json / 2,
        20 + json,
        30 + json,
        whole.len() / 2,
        whole.len() - 1,
    ];
    for end in ends {
        std::fs::write(&path, &whole[..end]).expect("a temporary file");
        assert!(read_clip(&path).is_err(), "{end}");
    }
    // Digits of the JSON changed: counts, offsets, indices out of range.
    let digits: Vec<usize> = (20..20 + json)
        .filter(|&i| whole[i].is_ascii_digit())
        .step_by(211)
        .collect();
    for at in digits {
        let mut bytes = whole.clone();
        bytes[at] = b'9';
        std::fs::write(&path, &bytes).expect("a temporary file");
        let _ = read_clip(&path);
    }
    let _ = std::fs::remove_file(&path);
}

#[test]
fn files_for_the_validator() {
    // Opt-in: `cargo xtask check gltf` looks at what this leaves in the folder named here.
    let Some(folder) = std::env::var_os("MUSLIN_GLTF_SAMPLES") else {
        println!("skipped: needs MUSLIN_GLTF_SAMPLES");
        return;
    };
    let folder = std::path::PathBuf::from(folder);
    std::fs::create_dir_all(&folder).expect("the folder can be made");
    let stage = Stage::new();
    for (name, n) in [("walk", 40), ("cartwheel", 9), ("wave", 1)] {
        let (clip, bones) = stage.clip(name, n);
        let file = folder.join(format!("moving-{name}.glb"));
        std::fs::write(file, stage.glb(&clip, bones.clone())).expect("the folder can be written");
        for (kind, handles, shapes) in [("bones", 40, 0), ("morphs", 12, 6)] {
            let bake = Bake { handles, shapes };
            let baked = Baked::new(&clip.drape.frames, &clip.drape.faces, bake);
            let bytes = stage.baked_glb(&clip, bones.clone(), Some(baked));
            let file = folder.join(format!("{kind}-{name}.glb"));
            std::fs::write(file, bytes).expect("the folder can be written");
        }
    }
}
