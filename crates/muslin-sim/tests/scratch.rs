//! Scratch.
#[allow(dead_code)]
mod scenes;
use glam::{DVec2, DVec3};
use muslin_sim::{Options, Settled, drape};
use scenes::*;
fn show(s: &Settled, t: std::time::Instant) {
    println!(
        "steps {} conv {} speed {:.4} body {} inside {} self {} p50 {:.4} p99 {:.4} max {:.4} E {:?} t {:.2?}",
        s.steps,
        s.converged,
        s.speed_p99,
        s.body_intersections,
        s.vertices_inside,
        s.self_crossings,
        s.stretch_p50,
        s.stretch_p99,
        s.stretch_max,
        s.energies,
        t.elapsed()
    );
}
#[test]
fn sphere() {
    let v = |k: &str, d: f64| {
        std::env::var(k)
            .ok()
            .and_then(|s| s.parse().ok())
            .unwrap_or(d)
    };
    let (flat, faces) = grid(DVec2::splat(0.6), [50, 50]);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let place = |p: &DVec2| DVec3::new(p.x - 0.3, 0.21, 0.3 - p.y);
    let start: Vec<DVec3> = flat.iter().map(place).collect();
    let mut m = cotton();
    m.stretch.compression = v("COMP", 1.0);
    let b = v("BEND", 1e-5);
    m.bend = muslin_energy::hinge::Bend { warp: b, weft: b };
    m.friction = v("MU", 0.3);
    let cloth = cut(start.len(), faces, rest, m);
    let (body, body_faces) = capsule(DVec3::ZERO, DVec3::Y * 1e-6, 0.2, 48);
    let o = Options {
        iterations: v("IT", 30.0) as usize,
        last_steps: v("LAST", 90.0) as usize,
        still: v("STILL", 0.02),
        keep: v("KEEP", 0.9),
        step: v("STEP", 0.025),
        ..Options::default()
    };
    let t = std::time::Instant::now();
    let s = drape(&cloth, &start, (&[body.clone()], &body_faces), &o).expect("valid scene");
    show(&s, t);
    look("sphere", &[(&body, &body_faces), (&s.verts, &cloth.faces)]);
}
