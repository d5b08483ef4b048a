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

    /// A small map, rasterised by the calling thread alone.
    pub fn small(flat: &Flat, toward: Vec3, size: usize) -> Self {
        let mut map = Self::frame(flat, toward, size);
        let mut tile = Tile::<1>::new(0, 0, size, size);
        map.tris(flat).iter().for_each(|tri| tile.fill(tri));
        map.top = tile.near.as_flattened().to_vec();
        map
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
