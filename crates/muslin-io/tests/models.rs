//! GLB files, read back by a small reader of the tests' own.

use glam::{DVec2, DVec3};
use muslin_geom::{Image, Mesh};
use muslin_io::{GlbOptions, Maps, Material, Node, Scene, Sheen, glb, stored_positions};
use serde_json::Value;

/// A GLB taken apart.
struct Read {
    json: Value,
    bin: Vec<u8>,
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize
}

/// Takes the container apart and checks all that glTF 2.0 section 4 asks of it.
fn read(file: &[u8]) -> Read {
    assert_eq!(
        (&file[..4], word(file, 4), word(file, 8)),
        (&b"glTF"[..], 2, file.len())
    );
    let n_json = word(file, 12);
    let at = 20 + n_json;
    assert_eq!(
        (&file[16..20], &file[at + 4..at + 8]),
        (&b"JSON"[..], &b"BIN\0"[..])
    );
    assert_eq!(
        (n_json % 4, word(file, at) % 4, at + 8 + word(file, at)),
        (0, 0, file.len())
    );
    let json: Value = serde_json::from_slice(&file[20..at]).expect("the first chunk is JSON");
    let bin = file[at + 8..].to_vec();
    let claimed = json["buffers"][0]["byteLength"].as_u64().expect("a buffer") as usize;
    assert!(bin.len() - claimed < 4);
    Read { json, bin }
}

impl Read {
    /// All components of an accessor, normalised where it says so.
    fn numbers(&self, accessor: &Value) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][accessor.as_u64().expect("an index") as usize];
        let int = |v: &Value| v.as_u64().map(|n| n as usize);
        let view = &self.json["bufferViews"][int(&accessor["bufferView"]).expect("an index")];
        let (size, limit) = match int(&accessor["componentType"]) {
            Some(5122) => (2, 32_767.0),
            Some(5123) => (2, 65_535.0),
            _ => (4, 1.0),
        };
        let width = match accessor["type"].as_str() {
            Some("VEC3") => 3,
            Some("VEC2") => 2,
            _ => 1,
        };
        let stride = int(&view["byteStride"]).unwrap_or(size * width);
        let start = int(&view["byteOffset"]).expect("an offset");
        let count = int(&accessor["count"]).expect("a count");
        assert_eq!((start % 4, stride % size), (0, 0));
        assert!((count - 1) * stride + size * width <= int(&view["byteLength"]).expect("a length"));
        let unit = if accessor["normalized"] == true {
            limit
        } else {
            1.0
        };
        let number = |at: usize| {
            let b = &self.bin[at..at + size];
            match int(&accessor["componentType"]) {
                Some(5122) => f64::from(i16::from_le_bytes([b[0], b[1]])),
                Some(5123) => f64::from(u16::from_le_bytes([b[0], b[1]])),
                Some(5125) => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
                _ => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            }
        };
        let value = |i: usize, k: usize| number(start + i * stride + k * size) / unit;
        (0..count)
            .map(|i| (0..width).map(|k| value(i, k)).collect())
            .collect()
    }

    /// The node `i` as it was meant: positions, normals, coordinates (v up), triangles.
    fn node(&self, i: usize) -> (Vec<DVec3>, Vec<DVec3>, Vec<DVec2>, Vec<[u32; 3]>) {
        let node = &self.json["nodes"][i];
        let mesh = &self.json["meshes"][node["mesh"].as_u64().expect("a mesh") as usize];
        let primitive = &mesh["primitives"][0];
        let float = |v: &Value, or: f64| v.as_f64().unwrap_or(or);
        let (t, s) = (&node["translation"], &node["scale"]);
        let origin = DVec3::new(float(&t[0], 0.0), float(&t[1], 0.0), float(&t[2], 0.0));
        let step = float(&s[0], 1.0);
        let vec3 = |v: &Vec<f64>| DVec3::new(v[0], v[1], v[2]);
        let attribute = |name: &str| match &primitive["attributes"][name] {
            Value::Null => Vec::new(),
            accessor => self.numbers(accessor),
        };
        let offset = &node["extras"]["uv_offset"];
        let uv = |v: &Vec<f64>| {
            let stored = DVec2::new(v[0], v[1]) * float(&node["extras"]["uv_scale"], 1.0);
            let uv = stored + DVec2::new(float(&offset[0], 0.0), float(&offset[1], 0.0));
            DVec2::new(uv.x, 1.0 - uv.y)
        };
        let corners: Vec<u32> = self
            .numbers(&primitive["indices"])
            .iter()
            .map(|v| v[0] as u32)
            .collect();
        (
            attribute("POSITION")
                .iter()
                .map(|v| origin + step * vec3(v))
                .collect(),
            attribute("NORMAL").iter().map(vec3).collect(),
            attribute("TEXCOORD_0").iter().map(uv).collect(),
            corners.as_chunks::<3>().0.to_vec(),
        )
    }
}

/// A wavy tube of rings, standing for a garment of about `rings * 50` vertices.
fn tube(name: &str, rings: u32) -> Node {
    let (mut verts, mut uvs, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..rings {
        for k in 0..50 {
            let angle = f64::from(k) * std::f64::consts::TAU / 50.0;
            let y = 0.012 * f64::from(i);
            let r = 0.2 + 0.02 * (7.0 * angle + 3.0 * y).sin();
            verts.push(DVec3::new(r * angle.sin(), y, r * angle.cos()));
            uvs.push(DVec2::new(0.2 * angle, y));
            let (a, b) = (50 * i + k, 50 * i + (k + 1) % 50);
            if i + 1 < rings {
                faces.extend([[a, b, a + 50], [b, b + 50, a + 50]]);
            }
        }
    }
    Node {
        name: name.into(),
        mesh: Mesh { verts, faces },
        uvs,
        ..Node::default()
    }
}

/// Cloth with all the looks that can be given.
fn cloth() -> Material {
    let picture = Image::filled(8, 8, [128, 128, 255, 255]);
    Material {
        name: "cotton".into(),
        colour: [30, 60, 120],
        roughness: 0.8,
        sheen: Some(Sheen {
            colour: [60, 60, 70],
            roughness: 0.5,
        }),
        double_sided: true,
        maps: Some(Maps {
            colour: Some(picture.clone()),
            normal: Some(picture),
            tile: DVec2::splat(0.01),
        }),
    }
}

fn scene() -> Scene {
    let body = tube("body", 270);
    let tee = Node {
        material: cloth(),
        ..tube("tee", 100)
    };
    Scene {
        name: "look".into(),
        copyright: Some("CC0".into()),
        nodes: vec![body, tee],
    }
}

#[test]
fn a_scene_reads_back_as_it_was_written() {
    let scene = scene();
    for quantised in [true, false] {
        let file = read(&glb(&scene, &GlbOptions { quantised }).expect("the scene is sound"));
        for (i, node) in scene.nodes.iter().enumerate() {
            let (verts, normals, uvs, faces) = file.node(i);
            assert_eq!(faces, node.mesh.faces);
            let near = |a: &[DVec3], b: &[DVec3], by: f64| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).length() <= by)
            };
            let off = if quantised { 5e-5 } else { 1e-6 };
            assert!(
                near(&verts, &node.mesh.verts, off),
                "positions of {}",
                node.name
            );
            assert!(
                near(&normals, &node.normals_or_smooth(), 4e-5),
                "normals of {}",
                node.name
            );
            assert!(
                uvs.iter()
                    .zip(&node.uvs)
                    .all(|(a, b)| (a - b).length() < 4e-5)
            );
            if quantised {
                assert!(
                    near(&verts, &stored_positions(node), 1e-12),
                    "what we say is stored"
                );
            }
        }
    }
}

#[test]
fn bounds_are_those_of_the_stored_numbers() {
    for quantised in [true, false] {
        let file = read(&glb(&scene(), &GlbOptions { quantised }).expect("the scene is sound"));
        for mesh in file.json["meshes"].as_array().expect("meshes") {
            let index = &mesh["primitives"][0]["attributes"]["POSITION"];
            let accessor = &file.json["accessors"][index.as_u64().expect("an index") as usize];
            let numbers = file.numbers(index);
            for k in 0..3 {
                // As 32 bits, for that is what the numbers are.
                let claimed = |end: &str| accessor[end][k].as_f64().map(|x| x as f32);
                let column = || numbers.iter().map(|v| v[k] as f32);
                assert_eq!(claimed("min"), column().reduce(f32::min));
                assert_eq!(claimed("max"), column().reduce(f32::max));
            }
        }
    }
}

#[test]
fn cloth_shines_like_cloth_and_its_weave_repeats_every_centimetre() {
    let file = read(&glb(&scene(), &GlbOptions::default()).expect("the scene is sound"));
    let tee = &file.json["materials"][1];
    assert_eq!(tee["doubleSided"], true);
    assert_eq!(
        tee["extensions"]["KHR_materials_sheen"]["sheenRoughnessFactor"],
        0.5
    );
    let transform =
        &tee["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"];
    let scale = transform["scale"][0].as_f64().expect("a scale");
    let width = file.json["nodes"][1]["extras"]["uv_scale"]
        .as_f64()
        .expect("the real width");
    assert!(
        (scale * 0.01 - width).abs() < 1e-12,
        "{scale} tiles over {width} m"
    );
    let view = file.json["images"][1]["bufferView"]
        .as_u64()
        .expect("an embedded picture");
    let start = file.json["bufferViews"][view as usize]["byteOffset"]
        .as_u64()
        .expect("an offset");
    assert_eq!(&file.bin[start as usize + 1..][..3], b"PNG");
    let used: Vec<&str> = file.json["extensionsUsed"]
        .as_array()
        .expect("extensions")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert_eq!(
        used,
        [
            "KHR_materials_sheen",
            "KHR_mesh_quantization",
            "KHR_texture_transform"
        ]
    );
}

#[test]
fn a_person_in_a_shirt_stays_far_below_a_megabyte() {
    let scene = scene();
    let verts: usize = scene.nodes.iter().map(|n| n.mesh.verts.len()).sum();
    assert_eq!(verts, 18_500);
    let size = glb(&scene, &GlbOptions::default())
        .expect("the scene is sound")
        .len();
    assert!((630_000..640_000).contains(&size), "{size} bytes");
}

#[test]
fn a_large_mesh_gets_wide_indices() {
    let large = Scene {
        nodes: vec![tube("large", 1400)],
        ..Scene::default()
    };
    let file = read(&glb(&large, &GlbOptions::default()).expect("the scene is sound"));
    assert_eq!(file.node(0).3, large.nodes[0].mesh.faces);
}

#[test]
fn the_same_scene_gives_the_same_bytes() {
    let write = || glb(&scene(), &GlbOptions::default()).expect("the scene is sound");
    assert_eq!(write(), write());
}

#[test]
fn files_for_the_validator() {
    // Opt-in: `cargo xtask check gltf` looks at what this leaves in the folder named here.
    let Some(folder) = std::env::var_os("MUSLIN_GLTF_SAMPLES") else {
        println!("skipped: needs MUSLIN_GLTF_SAMPLES");
        return;
    };
    let folder = std::path::PathBuf::from(folder);
    let plain = Node {
        uvs: Vec::new(),
        ..tube("plain", 20)
    };
    let samples = [
        ("look", scene(), true),
        ("look-floats", scene(), false),
        (
            "plain",
            Scene {
                nodes: vec![plain],
                ..Scene::default()
            },
            true,
        ),
        (
            "large",
            Scene {
                nodes: vec![tube("large", 1400)],
                ..Scene::default()
            },
            true,
        ),
        ("empty", Scene::default(), true),
    ];
    for (name, scene, quantised) in samples {
        let bytes = glb(&scene, &GlbOptions { quantised }).expect("the scene is sound");
        let path = folder.join(format!("{name}.glb"));
        muslin_io::write_file(&path, &bytes).expect("the folder can be written");
    }
}
