//! Cloth and bodies that need no asset: grids, tubes, spheres, capsules.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_sim::{Cloth, Material};

/// A light cotton: 150 g/m², 1000 N/m.
pub fn cotton() -> Material {
    Material {
        density: 0.15,
        stretch: Stretch {
            warp: 1000.0,
            weft: 1000.0,
            shear: 200.0,
            compression: 1.0,
        },
        bend: Bend {
            warp: 1e-5,
            weft: 1e-5,
        },
        limit: Some(0.06),
        friction: 0.3,
        thickness: 0.5e-3,
    }
}

/// Cloth of one material in one layer, nothing pinned.
pub fn cut(n_verts: usize, faces: Vec<[u32; 3]>, rest: Vec<[DVec2; 3]>, of: Material) -> Cloth {
    Cloth {
        material_of: vec![0; faces.len()],
        layers: vec![0; n_verts],
        materials: vec![of],
        pins: Vec::new(),
        faces,
        rest,
    }
}

/// A grid of `cols × rows` cells in material coordinates [m]; vertex `(c, r)` is `r (cols+1) + c`.
pub fn grid(size: DVec2, [cols, rows]: [usize; 2]) -> (Vec<DVec2>, Vec<[u32; 3]>) {
    let at = |c: usize, r: usize| (r * (cols + 1) + c) as u32;
    let mut points = Vec::new();
    let mut faces = Vec::new();
    for r in 0..=rows {
        for c in 0..=cols {
            points.push(size * DVec2::new(c as f64 / cols as f64, r as f64 / rows as f64));
            if r < rows && c < cols {
                let [a, b, d, e] = [at(c, r), at(c + 1, r), at(c, r + 1), at(c + 1, r + 1)];
                faces.extend(if (c + r) % 2 == 0 {
                    [[a, b, e], [a, e, d]]
                } else {
                    [[a, b, d], [b, e, d]]
                });
            }
        }
    }
    (points, faces)
}

/// A tube about the Y axis from `y0` upwards, `radius` [m] as placed, cut for `rest_radius`.
pub fn tube(
    (radius, rest_radius): (f64, f64),
    (y0, height): (f64, f64),
    edge: f64,
    of: Material,
) -> (Cloth, Vec<DVec3>) {
    let cols = (TAU * radius / edge).round() as usize;
    let rows = (height / edge).round() as usize;
    let width = TAU * rest_radius;
    let (flat, quads) = grid(DVec2::new(width, height), [cols, rows]);
    let wrap = |i: u32| {
        let (r, c) = (i as usize / (cols + 1), i as usize % (cols + 1));
        (r * cols + c % cols) as u32
    };
    let rest = quads.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let faces = quads.iter().map(|f| f.map(wrap)).collect();
    let n = cols * (rows + 1);
    let place = |i: usize| {
        let angle = TAU * (i % cols) as f64 / cols as f64;
        let y = y0 + height * (i / cols) as f64 / rows as f64;
        DVec3::new(radius * angle.sin(), y, radius * angle.cos())
    };
    (cut(n, faces, rest, of), (0..n).map(place).collect())
}

/// A closed capsule from `a` to `b`, facing outward.
pub fn capsule(a: DVec3, b: DVec3, radius: f64, cols: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let axis = (b - a).normalize_or(DVec3::Y);
    let (u, v) = axis.any_orthonormal_pair();
    let caps = (cols / 4).max(2);
    let side = (((b - a).length() * cols as f64 / (TAU * radius)).round() as usize).max(1);
    // Rings from the pole of `a` to the pole of `b`: (height along the axis, radius).
    let mut rings = Vec::new();
    for k in 1..=caps {
        let t = 0.5 * PI * k as f64 / caps as f64;
        rings.push((-radius * t.cos(), radius * t.sin()));
    }
    let length = (b - a).length();
    rings.extend((1..side).map(|k| (length * k as f64 / side as f64, radius)));
    for k in (1..=caps).rev() {
        let t = 0.5 * PI * k as f64 / caps as f64;
        rings.push((length + radius * t.cos(), radius * t.sin()));
    }
    rings.dedup_by(|p, q| (p.0 - q.0).abs() < 1e-9);
    let mut verts = vec![a - axis * radius];
    for &(h, r) in &rings {
        for c in 0..cols {
            let t = TAU * c as f64 / cols as f64;
            verts.push(a + axis * h + u * (r * t.cos()) + v * (r * t.sin()));
        }
    }
    verts.push(b + axis * radius);
    let at = |r: usize, c: usize| (1 + r * cols + c % cols) as u32;
    let last = verts.len() as u32 - 1;
    let mut faces = Vec::new();
    for c in 0..cols {
        faces.push([0, at(0, c + 1), at(0, c)]);
        for r in 0..rings.len() - 1 {
            faces.push([at(r, c), at(r, c + 1), at(r + 1, c + 1)]);
            faces.push([at(r, c), at(r + 1, c + 1), at(r + 1, c)]);
        }
        faces.push([at(rings.len() - 1, c), at(rings.len() - 1, c + 1), last]);
    }
    (verts, faces)
}

/// Writes an OBJ when `MUSLIN_SCENES` names a folder, to be looked at.
#[allow(dead_code, reason = "only called while a scene is being looked at")]
pub fn look(name: &str, parts: &[(&[DVec3], &[[u32; 3]])]) {
    let Ok(folder) = std::env::var("MUSLIN_SCENES") else {
        return;
    };
    let mut text = String::new();
    let mut base = 1;
    for (k, (verts, faces)) in parts.iter().enumerate() {
        text += &format!("o part{k}\n");
        for v in *verts {
            text += &format!("v {} {} {}\n", v.x, v.y, v.z);
        }
        for f in *faces {
            text += &format!("f {} {} {}\n", f[0] + base, f[1] + base, f[2] + base);
        }
        base += verts.len() as u32;
    }
    std::fs::write(format!("{folder}/{name}.obj"), text).expect("the folder can be written to");
}
