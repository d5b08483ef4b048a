//! What the tests of this room share: a small random source and simple meshes.

use glam::DVec3;

use crate::Mesh;

/// SplitMix64: the same numbers on every machine.
pub(crate) struct Rng(pub u64);

impl Rng {
    /// A number in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A point in the unit cube.
    pub fn vec(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }
}

/// A unit sphere of latitudes and longitudes, facing outward.
pub(crate) fn sphere(rows: usize, cols: usize) -> Mesh {
    let mut verts = vec![DVec3::Y];
    for r in 1..rows {
        let lat = std::f64::consts::PI * r as f64 / rows as f64;
        for c in 0..cols {
            let lon = std::f64::consts::TAU * c as f64 / cols as f64;
            verts.push(DVec3::new(
                lat.sin() * lon.sin(),
                lat.cos(),
                lat.sin() * lon.cos(),
            ));
        }
    }
    verts.push(-DVec3::Y);
    let at = |r: usize, c: usize| (1 + (r - 1) * cols + c % cols) as u32;
    let mut faces = Vec::new();
    for c in 0..cols {
        faces.push([0, at(1, c), at(1, c + 1)]);
        for r in 1..rows - 1 {
            faces.push([at(r, c), at(r + 1, c), at(r + 1, c + 1)]);
            faces.push([at(r, c), at(r + 1, c + 1), at(r, c + 1)]);
        }
        faces.push([at(rows - 1, c), verts.len() as u32 - 1, at(rows - 1, c + 1)]);
    }
    Mesh { verts, faces }
}
