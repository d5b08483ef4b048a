//! What a light far away sees: the nearest surface in every texel.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::project::Flat;

/// Orthographic depths along one direction.
pub(crate) struct LightMap {
    /// Texels a side.
    pub size: usize,
    /// Side of a texel [m].
    pub texel: f32,
    /// Unit vectors across, up and towards the light.
    pub right: Vec3,
    pub up: Vec3,
    pub toward: Vec3,
    corner: Vec2,
    /// Height of the topmost surface along `toward` [m], per texel; -∞ for none.
    pub top: Vec<f32>,
}

/// Rows that one task draws.
const BAND: usize = 128;

impl LightMap {
    /// The map of a large light, drawn in parallel.
    pub fn new(flat: &Flat, toward: Vec3, size: usize) -> Self {
        let mut map = Self::frame(flat, toward, size);
        let placed = map.placed(flat);
        map.top = vec![f32::NEG_INFINITY; size * size];
        let bands = map.top.par_chunks_mut(BAND * size).enumerate();
        bands.for_each(|(k, top)| {
            let rows = BAND * k..(BAND * k + BAND).min(size);
            for corners in triangles(flat, &placed) {
                splat(corners, (size, rows.clone()), |at, height: [f32; 2]| {
                    top[at] = top[at].max(height[0]);
                });
            }
        });
        map
    }

    /// Two small maps, of a light and of the one opposite, drawn in one pass by the
    /// calling thread alone; triangles own the texels whose middle they cover.
    pub fn opposite(flat: &Flat, toward: Vec3, size: usize) -> [Self; 2] {
        let mut front = Self::frame(flat, toward, size);
        let mut ends = vec![[f32::NEG_INFINITY; 2]; size * size];
        for corners in triangles(flat, &front.placed(flat)) {
            splat(corners, (size, 0..size), |at, height| {
                let old = ends[at];
                ends[at] = [old[0].max(height[0]), old[1].max(height[1])];
            });
        }
        let mut back = Self {
            toward: -toward,
            top: Vec::new(),
            ..front
        };
        front.top = ends.iter().map(|e| e[0]).collect();
        back.top = ends.iter().map(|e| e[1]).collect();
        [front, back]
    }

    /// Fits a square around the scene, with two texels to spare on each side.
    fn frame(flat: &Flat, toward: Vec3, size: usize) -> Self {
        let right = toward.any_orthonormal_vector();
        let up = toward.cross(right);
        let across = |p: &Vec3| Vec2::new(p.dot(right), p.dot(up));
        let lo = flat
            .at
            .iter()
            .map(across)
            .reduce(Vec2::min)
            .unwrap_or_default();
        let hi = flat
            .at
            .iter()
            .map(across)
            .reduce(Vec2::max)
            .unwrap_or_default();
        let texel = ((hi - lo).max_element() / (size as f32 - 4.0)).max(1e-6);
        let corner = (lo + hi) * 0.5 - Vec2::splat(0.5 * texel * size as f32);
        Self {
            size,
            texel,
            right,
            up,
            toward,
            corner,
            top: Vec::new(),
        }
    }

    fn placed(&self, flat: &Flat) -> Vec<Vec3> {
        flat.at.iter().map(|&p| self.place(p)).collect()
    }

    /// Texel coordinates of a point [m] and its height along `toward` [m].
    pub fn place(&self, p: Vec3) -> Vec3 {
        let across = (Vec2::new(p.dot(self.right), p.dot(self.up)) - self.corner) / self.texel;
        across.extend(p.dot(self.toward))
    }

    /// Topmost surface of the texel around each `(x, y)`; -∞ outside.
    #[inline(always)]
    pub fn at<const N: usize>(&self, [x, y]: &[[f32; N]; 2]) -> [f32; N] {
        let limit = self.size as f32;
        let mut at = [usize::MAX; N];
        for k in 0..N {
            let inside = x[k] >= 0.0 && y[k] >= 0.0 && x[k] < limit && y[k] < limit;
            if inside {
                at[k] = y[k] as usize * self.size + x[k] as usize;
            }
        }
        at.map(|at| *self.top.get(at).unwrap_or(&f32::NEG_INFINITY))
    }

    /// Share of the four texels around each `(x, y)` that let light through to `height`, weighted by nearness.
    #[inline(always)]
    pub fn lit<const N: usize>(&self, [x, y]: &[[f32; N]; 2], height: &[f32; N]) -> [f32; N] {
        let last = (self.size - 1) as f32;
        let (mut inside, mut first) = ([false; N], [0; N]);
        let mut between = [[0.0; N]; 2];
        for k in 0..N {
            let (u, v) = (x[k] - 0.5, y[k] - 0.5);
            inside[k] = u >= 0.0 && v >= 0.0 && u < last && v < last;
            let (i, j) = (u as u32, v as u32);
            (between[0][k], between[1][k]) = (u - i as f32, v - j as f32);
            first[k] = j as usize * self.size + i as usize;
        }
        let mut tops = [[f32::NEG_INFINITY; N]; 4];
        for k in 0..N {
            if inside[k] {
                let [above, below] =
                    [first[k], first[k] + self.size].map(|at| &self.top[at..at + 2]);
                (tops[0][k], tops[1][k]) = (above[0], above[1]);
                (tops[2][k], tops[3][k]) = (below[0], below[1]);
            }
        }
        let mut out = [0.0; N];
        for k in 0..N {
            let open = |c: usize| if tops[c][k] <= height[k] { 1.0 } else { 0.0 };
            let (fx, fy) = (between[0][k], between[1][k]);
            let above = open(0) * (1.0 - fx) + open(1) * fx;
            let below = open(2) * (1.0 - fx) + open(3) * fx;
            let lit = above * (1.0 - fy) + below * fy;
            out[k] = if inside[k] { lit } else { 1.0 };
        }
        out
    }
}

/// All faces, their corners `placed`.
fn triangles<'a>(flat: &'a Flat, placed: &'a [Vec3]) -> impl Iterator<Item = [Vec3; 3]> + 'a {
    let corners = |f: &[u32; 3]| f.map(|v| placed[v as usize]);
    flat.faces.iter().map(corners)
}

/// Says of the texels about a triangle of (texel x, texel y, height), counted from the first of these rows of a map of
/// `size` a side, how high it is over their middles and the same from below; -∞ where it is not. Triangles seen edge-on are
/// left to their neighbours.
#[inline(always)]
fn splat(
    [a, b, c]: [Vec3; 3],
    (size, band): (usize, Range<usize>),
    mut raise: impl FnMut(usize, [f32; 2]),
) {
    let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
    // Texel coordinates are positive: the map has a border.
    let cols = (lo.x + 0.5) as usize..((hi.x + 0.5) as usize).min(size);
    let rows = ((lo.y + 0.5) as usize).max(band.start)..((hi.y + 0.5) as usize).min(band.end);
    if cols.is_empty() || rows.is_empty() {
        return;
    }
    let (ab, ac) = (b - a, c - a);
    let area = ab.truncate().perp_dot(ac.truncate());
    if area.abs() < 1e-9 {
        return;
    }
    let inv = 1.0 / area;
    for y in rows {
        for x in cols.clone() {
            let d = Vec2::new(x as f32 + 0.5 - a.x, y as f32 + 0.5 - a.y);
            let u = d.perp_dot(ac.truncate()) * inv;
            let v = ab.truncate().perp_dot(d) * inv;
            let height = a.z + u * ab.z + v * ac.z;
            // Half of them are not in it: to guess which costs more than to raise all.
            let inside = (u >= -1e-4) & (v >= -1e-4) & (u + v <= 1.0001);
            let or_not = |height: f32| if inside { height } else { f32::NEG_INFINITY };
            raise(
                (y - band.start) * size + x,
                [or_not(height), or_not(-height)],
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_maps_see_the_two_ends_of_a_slab() {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let mut flat = Flat::default();
        for z in [0.2, -0.3] {
            let first = flat.at.len() as u32;
            flat.at.extend([
                at(-1.0, -1.0, z),
                at(1.0, -1.0, z),
                at(1.0, 1.0, z),
                at(-1.0, 1.0, z),
            ]);
            flat.faces
                .extend([[0, 1, 2], [0, 2, 3]].map(|f| f.map(|v: u32| v + first)));
        }
        let [front, back] = LightMap::opposite(&flat, Vec3::Z, 32);
        let solid = front.top.iter().filter(|t| t.is_finite()).count();
        assert_eq!(solid, 28 * 28, "all but the border of two texels");
        assert!(front.top.iter().all(|&t| !t.is_finite() || t == 0.2));
        assert!(back.top.iter().all(|&t| !t.is_finite() || t == 0.3));
        assert_eq!(LightMap::new(&flat, Vec3::Z, 32).top, front.top);
        let below = back.place(at(0.0, 0.0, -0.4));
        let lit = |p: Vec3| back.lit(&[[p.x], [p.y]], &[p.z])[0];
        assert_eq!(lit(below), 1.0);
        let inside = back.place(at(0.0, 0.0, 0.0));
        assert_eq!(lit(inside), 0.0);
    }
}
