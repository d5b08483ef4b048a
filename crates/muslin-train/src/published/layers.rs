//! Cloth over cloth: what PBNS's outer garments lie on.

use glam::DVec3;

use crate::ground::{Wall, plane};
use crate::lanes::Row;
use crate::layers::{DEEP, Layer};

/// A vertex that lies nearest to cloth below it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct On {
    pub vertex: u32,
    /// Corners of the triangle below, and their shares of the nearest point.
    pub corners: [u32; 3],
    pub shares: [f32; 3],
}

/// Where vertices of a garment lie nearer to the garments below than to the skin, whose `walls` are replaced then; the
/// cloth is at `x` [m].
pub(crate) fn lie(layer: &Layer, x: &[DVec3], walls: &mut [Wall]) -> Vec<On> {
    let below = layer.surface.moved(&x[layer.others()]);
    let mut out = Vec::new();
    for v in layer.verts.clone() {
        let [a, b, c, offset] = walls[v].map(f64::from);
        let skin = DVec3::new(a, b, c).dot(x[v]) - offset;
        let Some(hit) = below.closest(x[v], DEEP.min(skin.abs())) else {
            continue;
        };
        if layer.ground.rim()[hit.face as usize] {
            continue;
        }
        walls[v] = plane(&hit, x[v]);
        out.push(On {
            vertex: v as u32,
            corners: below.faces()[hit.face as usize],
            shares: hit.weights.map(|w| w as f32),
        });
    }
    out
}

/// Hands what pushes vertices of one lane back to the cloth that they lie on; `push` is the force on every vertex
/// along its wall's normal [N].
pub(crate) fn hand_back(
    (on, lane): (&[On], usize),
    (walls, push): (&[[Row; 4]], &[Row]),
    g: &mut [Row],
) {
    for o in on {
        let v = o.vertex as usize;
        for (corner, share) in o.corners.iter().zip(o.shares) {
            for axis in 0..3 {
                let normal = walls[v][axis][lane];
                g[3 * *corner as usize + axis][lane] -= share * push[v][lane] * normal;
            }
        }
    }
}
