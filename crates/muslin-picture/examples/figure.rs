//! A dressed mannequin, photographed: `figure BODY.obj OUT_DIR [GARMENT.obj ...]`.
//!
//! Meshes are in metres, Y up, facing +Z; without garments the body wears a wrinkled
//! copy of its own trunk. Writes `front.png`, `close.png`
//! and `turn.png` and prints how long each took.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use glam::{DVec2, DVec3};
use muslin_geom::colour::linear;
use muslin_geom::{Image, vertex_normals};
use muslin_picture::{
    Camera, Ground, Material, Options, Part, Scene, View, Weave, WeaveKind, render, turntable,
};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, body, out, garments @ ..] = args.as_slice() else {
        return Err("figure BODY.obj OUT_DIR [GARMENT.obj ...]".into());
    };
    let scene = match garments {
        [] => scene(read_obj(Path::new(body))?),
        worn => dressed(read_obj(Path::new(body))?, worn)?,
    };
    let faces: usize = scene.parts.iter().map(|p| p.faces.len()).sum();
    println!("{faces} triangles");
    let view = View::default();
    let camera = Camera::framing(&scene.points(), &view);
    let front = timed("front", || render(&scene, &camera, &Options::default()));
    save(&front, &Path::new(out).join("front.png"))?;
    let torso = Scene {
        parts: vec![scene.parts[1].clone()],
        ..Scene::default()
    }
    .points();
    let close = Camera::framing(&torso, &View { yaw: 0.5, ..view });
    save(
        &timed("close", || render(&scene, &close, &Options::default())),
        &Path::new(out).join("close.png"),
    )?;
    let small = View {
        width: 448,
        height: 448,
        ..view
    };
    let frames = timed("24 frames", || {
        turntable(&scene, &small, 24, &Options::quick())
    });
    save(&sheet(&frames[..24], 6), &Path::new(out).join("turn.png"))?;
    assert!(
        front.pixels.iter().any(|p| *p != front.pixels[0]),
        "the figure shows"
    );
    Ok(())
}

fn timed<T>(name: &str, job: impl Fn() -> T) -> T {
    let runs: usize = std::env::var("RUNS")
        .ok()
        .and_then(|r| r.parse().ok())
        .unwrap_or(1);
    let mut best = [f64::INFINITY; 2];
    let mut result = None;
    for _ in 0..runs {
        let (start, cpu) = (Instant::now(), cpu_seconds());
        result = Some(job());
        best[0] = best[0].min(start.elapsed().as_secs_f64());
        best[1] = best[1].min(cpu_seconds() - cpu);
    }
    println!(
        "{name}: {:.3} s, {:.2} s of processor (least of {runs})",
        best[0], best[1]
    );
    result.expect("at least one run")
}

/// Processor time of this process [s], where the system tells.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let ticks = stat
        .split_whitespace()
        .skip(13)
        .take(2)
        .filter_map(|t| t.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}

/// The body in garments from files, each of another colour.
fn dressed(body: Triangles, garments: &[String]) -> Result<Scene, Box<dyn Error>> {
    let lowest = body.0.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let mut parts = vec![Part::new(body.0, body.1, Material::mannequin())];
    for (path, colour) in garments
        .iter()
        .zip([[32, 118, 116], [40, 62, 104], [190, 180, 165]])
    {
        let (verts, faces) = read_obj(Path::new(path))?;
        let cloth = Material::cloth(linear(colour), Weave::usual(WeaveKind::Jersey));
        parts.push(Part::new(verts, faces, cloth));
    }
    let ground = Some(Ground::at(lowest));
    Ok(Scene {
        parts,
        ground,
        ..Scene::default()
    })
}

/// The body in an offset, wrinkled copy of its own trunk.
fn scene((verts, faces): Triangles) -> Scene {
    let normals = vertex_normals(&verts, &faces);
    let keep = |v: u32| {
        let p = verts[v as usize];
        (0.88..1.44).contains(&p.y) && p.x.abs() < 0.30 - 0.25 * (1.25 - p.y).max(0.0)
    };
    let top: Vec<[u32; 3]> = faces
        .iter()
        .copied()
        .filter(|f| f.iter().all(|&v| keep(v)))
        .collect();
    let wrinkle = |p: &DVec3| {
        let turn = p.x.atan2(p.z);
        let low = ((1.3 - p.y) / 0.4).clamp(0.0, 1.0);
        0.004 * (38.0 * p.y + 3.0 * turn).sin()
            + low * (0.014 * (7.0 * turn + 2.0 * p.y).sin() + 0.006 * (17.0 * turn).sin())
    };
    let cloth: Vec<DVec3> = verts
        .iter()
        .zip(&normals)
        .map(|(p, n)| *p + DVec3::new(n.x, 0.3 * n.y, n.z) * (0.024 + wrinkle(p)))
        .collect();
    let flat = |v: u32| {
        let p = cloth[v as usize];
        DVec2::new(p.x.atan2(p.z) * 0.15, p.y)
    };
    let uvs = top.iter().map(|f| f.map(flat)).collect();
    let lowest = verts.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let cloth = Part {
        uvs: Some(uvs),
        ..Part::new(
            cloth,
            top,
            Material::cloth(linear([58, 92, 128]), Weave::usual(WeaveKind::Jersey)),
        )
    };
    Scene {
        parts: vec![Part::new(verts, faces, Material::mannequin()), cloth],
        ground: Some(Ground::at(lowest)),
        ..Scene::default()
    }
}

/// Vertices [m] and corner indices.
type Triangles = (Vec<DVec3>, Vec<[u32; 3]>);

/// Vertices [m] and triangles of a Wavefront file.
fn read_obj(path: &Path) -> Result<Triangles, Box<dyn Error>> {
    let (mut verts, mut faces) = (Vec::new(), Vec::new());
    for line in std::fs::read_to_string(path)?.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.first() {
            Some(&"v") => {
                let at: Vec<f64> = words[1..4]
                    .iter()
                    .map(|w| w.parse())
                    .collect::<Result<_, _>>()?;
                verts.push(DVec3::from_slice(&at));
            }
            Some(&"f") => {
                let corner = |w: &&str| w.split('/').next().unwrap_or("").parse::<u32>();
                let at: Vec<u32> = words[1..].iter().map(corner).collect::<Result<_, _>>()?;
                faces.extend((2..at.len()).map(|i| [at[0] - 1, at[i - 1] - 1, at[i] - 1]));
            }
            _ => {}
        }
    }
    Ok((verts, faces))
}

/// Frames side by side.
fn sheet(frames: &[Image], cols: usize) -> Image {
    let (w, h) = (frames[0].width, frames[0].height);
    let mut out = Image::filled(w * cols, h * frames.len().div_ceil(cols), [0; 4]);
    for (i, frame) in frames.iter().enumerate() {
        for (y, row) in frame.pixels.chunks(w).enumerate() {
            let start = (i / cols * h + y) * out.width + i % cols * w;
            out.pixels[start..start + w].copy_from_slice(row);
        }
    }
    out
}

fn save(picture: &Image, path: &Path) -> Result<(), Box<dyn Error>> {
    let (w, h) = (picture.width as u32, picture.height as u32);
    image::save_buffer(
        path,
        picture.pixels.as_flattened(),
        w,
        h,
        image::ColorType::Rgba8,
    )?;
    Ok(())
}
