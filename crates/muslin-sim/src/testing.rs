//! Cloth that more than one test needs.

use glam::{DVec2, DVec3};
use muslin_energy::{hinge::Bend, membrane::Stretch};

use crate::cloth::{Cloth, Material};

/// Two sheets of 12 x 12 vertices, 1 cm apart each way, one `apart` [m] over the other.
pub(crate) fn sheets(apart: f64) -> (Cloth, Vec<DVec3>) {
    let flat = |v: u32| DVec2::new(f64::from(v % 12), f64::from(v / 12)) * 0.01;
    let cells = (0..132_u32).filter(|v| v % 12 < 11);
    let faces: Vec<[u32; 3]> = cells
        .flat_map(|v| [[v, v + 1, v + 13], [v, v + 13, v + 12]])
        .flat_map(|f| [f, f.map(|v| v + 144)])
        .collect();
    let material = Material {
        density: 0.2,
        stretch: Stretch {
            warp: 300.0,
            weft: 300.0,
            shear: 100.0,
            compression: 1.0,
        },
        bend: Bend {
            warp: 1e-5,
            weft: 1e-5,
        },
        limit: None,
        friction: 0.3,
        thickness: 1e-3,
    };
    let cloth = Cloth {
        rest: faces.iter().map(|f| f.map(|v| flat(v % 144))).collect(),
        materials: vec![material],
        material_of: vec![0; faces.len()],
        layers: vec![0; 288],
        pins: Vec::new(),
        faces,
    };
    let at = |v: u32| flat(v % 144).extend(if v < 144 { 0.0 } else { apart });
    (cloth, (0..288).map(at).collect())
}

/// Two balls of 10 cm, centred so far apart along X [m], as one mesh.
pub(crate) fn balls(apart: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (rows, cols) = (16, 24);
    let mut verts = Vec::new();
    let mut faces = Vec::new();
    for side in [-1.0, 1.0] {
        let base = verts.len() as u32;
        let at = |r: usize, c: usize| base + (1 + (r - 1) * cols + c % cols) as u32;
        let centre = DVec3::X * (0.5 * apart * side);
        verts.push(centre + DVec3::Y * 0.1);
        for r in 1..rows {
            let lat = std::f64::consts::PI * r as f64 / rows as f64;
            for c in 0..cols {
                let lon = std::f64::consts::TAU * c as f64 / cols as f64;
                let p = DVec3::new(lat.sin() * lon.sin(), lat.cos(), lat.sin() * lon.cos());
                verts.push(centre + p * 0.1);
            }
        }
        verts.push(centre - DVec3::Y * 0.1);
        let last = verts.len() as u32 - 1;
        for c in 0..cols {
            faces.push([base, at(1, c), at(1, c + 1)]);
            for r in 1..rows - 1 {
                faces.push([at(r, c), at(r + 1, c), at(r + 1, c + 1)]);
                faces.push([at(r, c), at(r + 1, c + 1), at(r, c + 1)]);
            }
            faces.push([at(rows - 1, c), last, at(rows - 1, c + 1)]);
        }
    }
    (verts, faces)
}
