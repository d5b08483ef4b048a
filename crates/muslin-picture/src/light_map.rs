//! What a light far away sees: the nearest surface in every texel.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use crate::project::Flat;
use crate::raster::{Bins, Tile, Tri};

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

/// Texels a side that one task rasterises.
const SIDE: usize = 128;

impl LightMap {
    /// The map of a large light, rasterised in parallel.
    pub fn new(flat: &Flat, toward: Vec3, size: usize) -> Self {
        let mut map = Self::frame(flat, toward, size);
        let tris = map.tris(flat);
        let bins = Bins::new(&tris, [size; 2], SIDE);
        let tiles = (0..bins.cols * bins.rows).into_par_iter().map(|bin| {
            let [x, y, w, h] = bins.frame(bin);
            let mut tile = Tile::<1>::new(x, y, w, h);
            bins.members(bin)
                .iter()
                .for_each(|&i| tile.fill(&tris[i as usize]));
            (x, y, w, tile.near)
        });
        let tiles: Vec<_> = tiles.collect();
        map.top = vec![f32::NEG_INFINITY; size * size];
        for (x, y, w, near) in tiles {
            for (row, texels) in near.chunks(w).enumerate() {
                let start = (y + row) * size + x;
                map.top[start..start + w].copy_from_slice(texels.as_flattened());
            }
        }
        map
    }

    /// Two small maps, of a light and of the one opposite, drawn in one pass by the
    /// calling thread alone; triangles own the texels whose middle they cover.
    pub fn opposite(flat: &Flat, toward: Vec3, size: usize) -> [Self; 2] {
        let mut front = Self::frame(flat, toward, size);
        let mut ends = vec![[f32::NEG_INFINITY; 2]; size * size];
        let placed: Vec<Vec3> = flat.at.iter().map(|&p| front.place(p)).collect();
        for f in &flat.faces {
            let corners = [
                placed[f[0] as usize],
                placed[f[1] as usize],
                placed[f[2] as usize],
            ];
            splat(corners, size, &mut ends);
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

    fn tris(&self, flat: &Flat) -> Vec<Tri> {
        let placed: Vec<Vec3> = flat.at.iter().map(|&p| self.place(p)).collect();
        let tri = |f: &[u32; 3]| {
            let [a, b, c] = [
                placed[f[0] as usize],
                placed[f[1] as usize],
                placed[f[2] as usize],
            ];
            let flat = |p: Vec3| DVec2::new(p.x.into(), p.y.into());
            Tri::new([flat(a), flat(b), flat(c)], [a.z, b.z, c.z], 0)
        };
        flat.faces.iter().filter_map(tri).collect()
    }

    /// Texel coordinates of a point [m] and its height along `toward` [m].
    pub fn place(&self, p: Vec3) -> Vec3 {
        let across = (Vec2::new(p.dot(self.right), p.dot(self.up)) - self.corner) / self.texel;
        across.extend(p.dot(self.toward))
    }

    /// Topmost surface of the texel around `(x, y)`; -∞ outside.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let limit = self.size as f32;
        match x >= 0.0 && y >= 0.0 && x < limit && y < limit {
            true => self.top[y as usize * self.size + x as usize],
            false => f32::NEG_INFINITY,
        }
    }

    /// Share of the four texels around `(x, y)` that let light through to `height`,
    /// weighted by nearness.
    pub fn lit(&self, x: f32, y: f32, height: f32) -> f32 {
        let (x, y) = (x - 0.5, y - 0.5);
        let limit = (self.size - 1) as f32;
        if !(x >= 0.0 && y >= 0.0 && x < limit && y < limit) {
            return 1.0;
        }
        let (i, j) = (x as u32, y as u32);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let first = j as usize * self.size + i as usize;
        let open = |at: usize| f32::from(u8::from(self.top[at] <= height));
        let above = open(first) * (1.0 - fx) + open(first + 1) * fx;
        let next = first + self.size;
        let below = open(next) * (1.0 - fx) + open(next + 1) * fx;
        above * (1.0 - fy) + below * fy
    }
}

/// Raises `[highest, -lowest]` of every texel whose middle lies in a triangle of
/// (texel x, texel y, height); triangles seen edge-on are left to their neighbours.
fn splat([a, b, c]: [Vec3; 3], size: usize, ends: &mut [[f32; 2]]) {
    let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
    // Texel coordinates are positive: the map has a border.
    let cols = (lo.x + 0.5) as usize..((hi.x + 0.5) as usize).min(size);
    let rows = (lo.y + 0.5) as usize..((hi.y + 0.5) as usize).min(size);
    let (ab, ac) = (b - a, c - a);
    let area = ab.truncate().perp_dot(ac.truncate());
    if cols.is_empty() || rows.is_empty() || area.abs() < 1e-9 {
        return;
    }
    let inv = 1.0 / area;
    for y in rows {
        for x in cols.clone() {
            let d = Vec2::new(x as f32 + 0.5 - a.x, y as f32 + 0.5 - a.y);
            let u = d.perp_dot(ac.truncate()) * inv;
            let v = ab.truncate().perp_dot(d) * inv;
            if u >= -1e-4 && v >= -1e-4 && u + v <= 1.0001 {
                let height = a.z + u * ab.z + v * ac.z;
                let texel = &mut ends[y * size + x];
                *texel = [texel[0].max(height), texel[1].max(-height)];
            }
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
        let below = back.place(at(0.0, 0.0, -0.4));
        assert_eq!(back.lit(below.x, below.y, below.z), 1.0);
        let inside = back.place(at(0.0, 0.0, 0.0));
        assert_eq!(back.lit(inside.x, inside.y, inside.z), 0.0);
    }
}
