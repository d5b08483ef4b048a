//! Hems and cuffs that are turned in: modellers let cloth go on inside of an opening, where one layer of cloth has
//! nothing to be but in its own way.

use glam::DVec3;
use muslin_geom::{Mesh, neighbours};

use super::clean::middle;

/// How far from an opening along the cloth what is turned in is looked for [m].
const DEEP: f64 = 0.06;
/// Cloth that comes less than this share of its way nearer to the garment's inside, and does not go inwards, is
/// turned in.
const FLAT: f64 = 0.3;
/// Around a neck or a waist it has to go this share of its way out: around a neck, cloth lies flat.
const BACK: f64 = -0.2;
/// Openings whose depth is more than this share of their width have no direction: open fronts.
const LEVEL: f64 = 0.6;

/// The mesh [m] without what is turned in at its openings `rims`, and how many triangles that was.
pub fn turned_out(mesh: Mesh, rims: &[Vec<u32>]) -> (Mesh, usize) {
    let near = neighbours(mesh.verts.len(), &mesh.faces);
    let height = |rim: &Vec<u32>| middle(&mesh.verts, rim).y;
    let top = rims.iter().map(height).fold(f64::MIN, f64::max);
    let mut gone = vec![false; mesh.verts.len()];
    for rim in rims {
        let least = if height(rim) == top { BACK } else { FLAT };
        let rings = rings((&mesh.verts, &near), rim);
        for ring in &rings[..turned_in(&mesh.verts, &rings, least)] {
            ring.iter().for_each(|v| gone[*v as usize] = true);
        }
    }
    let before = mesh.faces.len();
    let kept = |f: &&[u32; 3]| f.iter().all(|v| !gone[*v as usize]);
    let faces: Vec<[u32; 3]> = mesh.faces.iter().filter(kept).copied().collect();
    let left_out = before - faces.len();
    let verts = mesh.verts;
    match left_out {
        0 => (Mesh { verts, faces }, 0),
        _ => (used(&verts, &faces), left_out),
    }
}

/// The vertices that are 0, 1, 2 and more edges from a rim, until twice as deep as is looked.
fn rings((x, near): (&[DVec3], &[Vec<u32>]), rim: &[u32]) -> Vec<Vec<u32>> {
    let mut seen = vec![false; x.len()];
    rim.iter().for_each(|v| seen[*v as usize] = true);
    let mut rings = vec![rim.to_vec()];
    let mut deep = 0.0;
    while deep < 2.0 * DEEP {
        let last = &rings[rings.len() - 1];
        let mut next = Vec::new();
        let mut way = 0.0;
        for &v in last {
            for &w in &near[v as usize] {
                if !std::mem::replace(&mut seen[w as usize], true) {
                    next.push(w);
                    way += x[v as usize].distance(x[w as usize]);
                }
            }
        }
        if next.is_empty() {
            break;
        }
        deep += way / next.len() as f64;
        rings.push(next);
    }
    rings
}

/// How many rings from a rim on are turned in, where a step is if it comes `least` of its way forward or less.
fn turned_in(x: &[DVec3], rings: &[Vec<u32>], least: f64) -> usize {
    let middles: Vec<DVec3> = rings.iter().map(|r| middle(x, r)).collect();
    let inward = middles[middles.len() - 1] - middles[0];
    let Some(inward) = inward.try_normalize() else {
        return 0;
    };
    // How far along the limb, and how far from its middle, a ring is on average [m].
    let place = |(ring, m): (&Vec<u32>, &DVec3)| {
        let wide = |v: &u32| (x[*v as usize] - *m).reject_from(inward).length();
        let wide = ring.iter().map(wide).sum::<f64>() / ring.len() as f64;
        ((*m - middles[0]).dot(inward), wide)
    };
    let places: Vec<(f64, f64)> = rings.iter().zip(&middles).map(place).collect();
    let depth = |v: &u32| (x[*v as usize] - middles[0]).dot(inward);
    let depths = rings[0].iter().map(depth);
    let (low, high) = depths.fold((f64::MAX, f64::MIN), |(l, h), d| (l.min(d), h.max(d)));
    if high - low > LEVEL * 2.0 * places[0].1 {
        return 0;
    }
    let (mut deep, mut last) = (0.0, 0);
    for (k, pair) in places.windows(2).enumerate() {
        let (along, wider) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
        let way = along.hypot(wider);
        deep += way;
        if deep > DEEP {
            break;
        }
        if along < least * way && wider > -FLAT * way {
            last = k + 1;
        }
    }
    last
}

/// A mesh of these faces, and the vertices they have.
fn used(verts: &[DVec3], faces: &[[u32; 3]]) -> Mesh {
    let mut number = vec![u32::MAX; verts.len()];
    faces
        .as_flattened()
        .iter()
        .for_each(|v| number[*v as usize] = 0);
    let mut kept = Vec::new();
    for (v, n) in verts.iter().zip(&mut number) {
        if *n == 0 {
            *n = kept.len() as u32;
            kept.push(*v);
        }
    }
    Mesh {
        verts: kept,
        faces: faces
            .iter()
            .map(|f| f.map(|v| number[v as usize]))
            .collect(),
    }
}
