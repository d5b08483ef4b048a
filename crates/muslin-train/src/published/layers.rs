//! Cloth over cloth: garments of an outfit from the inside out.

use std::ops::Range;

use glam::DVec3;
use muslin_geom::Surface;
use muslin_sim::Cloth;

use crate::body::{Wall, plane, rim};
use crate::lanes::Row;

/// Cloth this deep under another garment is no longer led out of it [m]: where cloth below is crumpled, its inside
/// looks outwards, and with 4 cm a spike and what lay over it drove each other on.
const DEEP: f64 = 0.01;

/// A garment with all that it is worn over.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    verts: Range<usize>,
    /// The garments below, as one, at rest.
    below: Surface,
    /// Which of their triangles lie at an opening: which side one is on cannot be told there.
    rim: Vec<bool>,
}

/// A vertex that lies nearest to cloth below it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct On {
    pub vertex: u32,
    /// Corners of the triangle below, and their shares of the nearest point.
    pub corners: [u32; 3],
    pub shares: [f32; 3],
}

/// The outer garments of a cloth that lies at `template` [m] at rest.
pub(crate) fn layers(cloth: &Cloth, template: &[DVec3]) -> Vec<Layer> {
    let most = cloth.layers.iter().copied().max().unwrap_or(0);
    let one = |k: u32| {
        let start = cloth.layers.partition_point(|l| *l < k);
        let end = cloth.layers.partition_point(|l| *l <= k);
        let is_below = |f: &&[u32; 3]| (f[0] as usize) < start;
        let faces: Vec<[u32; 3]> = cloth.faces.iter().filter(is_below).copied().collect();
        Layer {
            verts: start..end,
            rim: rim(&faces),
            below: Surface::new(&template[..start], &faces),
        }
    };
    (1..=most).map(one).collect()
}

impl Layer {
    /// Where vertices of this garment lie nearer to the garments below than to the skin, whose `walls` are replaced
    /// then; the cloth is at `x` [m].
    pub fn lie(&self, x: &[DVec3], walls: &mut [Wall]) -> Vec<On> {
        let below = self.below.moved(&x[..self.verts.start]);
        let mut out = Vec::new();
        for v in self.verts.clone() {
            let [a, b, c, offset] = walls[v].map(f64::from);
            let skin = DVec3::new(a, b, c).dot(x[v]) - offset;
            let Some(hit) = below.closest(x[v], DEEP.min(skin.abs())) else {
                continue;
            };
            if self.rim[hit.face as usize] {
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
