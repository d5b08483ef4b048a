//! Skinning of sixteen poses, and its transpose.

use muslin_model::Skin;

use crate::lanes::{Lane, Row, Vec3};

/// The blended transform of one vertex: three columns and a translation.
#[inline(always)]
pub fn blend(skin: &Skin, v: usize, bones: &[[Row; 12]]) -> [Lane; 12] {
    let mut a = [Lane::all(0.0); 12];
    for (b, w) in skin.row(v) {
        let bone = &bones[b];
        for k in 0..12 {
            a[k] += Lane(bone[k]) * w;
        }
    }
    a
}

/// Where the blend takes a point.
#[inline(always)]
pub fn carry(a: &[Lane; 12], p: Vec3) -> Vec3 {
    let [x, y, z] = p.0;
    Vec3([0, 1, 2].map(|i| a[i] * x + a[3 + i] * y + a[6 + i] * z + a[9 + i]))
}

/// A gradient in the world as one in the rest frame: the transpose of the blend's linear part.
#[inline(always)]
pub fn bring_back(a: &[Lane; 12], g: Vec3) -> Vec3 {
    Vec3([0, 1, 2].map(|c| Vec3([a[3 * c], a[3 * c + 1], a[3 * c + 2]]).dot(g)))
}
