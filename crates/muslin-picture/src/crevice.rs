//! The small dark places between folds, from the picture's own depths.

use std::f32::consts::TAU;
use std::sync::LazyLock;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::fragment::Fragments;

/// What is nearest in each pixel's middle.
pub(crate) struct Depths {
    /// Picture size [px].
    pub width: usize,
    pub height: usize,
    /// Distance along the axis [m]; ∞ where nothing stands.
    pub depth: Vec<f32>,
    /// World normal on the side seen.
    normal: Vec<Vec3>,
}

impl Depths {
    /// The heaviest fragment of every pixel.
    pub fn new(tiles: &[Fragments], width: usize, height: usize) -> Self {
        let mut depth = vec![f32::INFINITY; width * height];
        let mut normal = vec![Vec3::ZERO; width * height];
        for tile in tiles {
            let [x, y, w, h] = tile.frame;
            for at in 0..w * h {
                let heaviest = tile
                    .of(at)
                    .iter()
                    .max_by(|a, b| a.weight.total_cmp(&b.weight));
                if let Some(f) = heaviest {
                    let pixel = (y + at / w) * width + x + at % w;
                    (depth[pixel], normal[pixel]) = (f.depth, f.normal);
                }
            }
        }
        Self {
            width,
            height,
            depth,
            normal,
        }
    }
}

/// How far crevices reach [m].
const REACH: f32 = 0.035;
/// Taps per pixel, on a spiral.
const TAPS: usize = 12;
/// How dark a crevice gets.
const STRENGTH: f32 = 1.3;

/// Openness of every pixel, 0 to 1.
pub(crate) struct Crevices {
    width: usize,
    height: usize,
    open: Vec<f32>,
}

impl Crevices {
    /// Looks around every covered pixel; `rotation` is the camera's.
    pub fn new(depths: &Depths, focal: f32, centre: Vec2, rotation: Mat3) -> Self {
        let view = View {
            depths,
            focal,
            centre,
            camera_from_world: rotation.transpose(),
        };
        let row = |y: usize| {
            (0..depths.width)
                .map(|x| view.openness(x, y))
                .collect::<Vec<f32>>()
        };
        let rows: Vec<Vec<f32>> = (0..depths.height).into_par_iter().map(row).collect();
        Self {
            width: depths.width,
            height: depths.height,
            open: rows.concat(),
        }
    }

    /// Openness of a surface at `depth` [m] in a pixel: the mean over the 4 × 4
    /// pixels whose taps differ, as far as they show the same surface.
    pub fn at(&self, depths: &Depths, x: usize, y: usize, depth: f32) -> f32 {
        let (mut sum, mut weight) = (0.0, 1e-4);
        for j in y.saturating_sub(2)..(y + 2).min(self.height) {
            for i in x.saturating_sub(2)..(x + 2).min(self.width) {
                let at = j * self.width + i;
                let w = (1.0 - (depths.depth[at] - depth).abs() / 0.02).max(0.0);
                (sum, weight) = (sum + w * self.open[at], weight + w);
            }
        }
        (sum + 1e-4) / weight
    }
}

struct View<'a> {
    depths: &'a Depths,
    focal: f32,
    centre: Vec2,
    camera_from_world: Mat3,
}

impl View<'_> {
    fn point(&self, x: usize, y: usize) -> Option<Vec3> {
        let depth = self.depths.depth[y * self.depths.width + x];
        let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let on_plane = (pixel - self.centre) * (depth / self.focal);
        depth.is_finite().then(|| on_plane.extend(depth))
    }

    fn openness(&self, x: usize, y: usize) -> f32 {
        let Some(p) = self.point(x, y) else {
            return 1.0;
        };
        let n = self.camera_from_world * self.depths.normal[y * self.depths.width + x];
        let n = Vec3::new(n.x, -n.y, -n.z);
        let reach = (REACH * self.focal / p.z).clamp(2.0, 48.0);
        let turn = TURNS[y % 4][x % 4];
        let here = Vec2::new(x as f32, y as f32);
        let tap = |at: &Vec2| self.tap(turn.rotate(*at) * reach + here, p, n);
        let closed: f32 = SPIRAL.iter().map(tap).sum();
        (1.0 - STRENGTH * closed / TAPS as f32).clamp(0.0, 1.0)
    }

    fn tap(&self, at: Vec2, p: Vec3, n: Vec3) -> f32 {
        let (x, y) = (at.x + 0.5, at.y + 0.5);
        let (w, h) = (self.depths.width as f32, self.depths.height as f32);
        let inside = x >= 0.0 && y >= 0.0 && x < w && y < h;
        let Some(q) = inside.then(|| self.point(x as usize, y as usize)).flatten() else {
            return 0.0;
        };
        let to = q - p;
        let d2 = to.length_squared() + 1e-10;
        let near = (1.0 - d2 / (REACH * REACH)).max(0.0);
        (to.dot(n) / d2.sqrt() - 0.12).max(0.0) * near
    }
}

/// Three turns outwards.
static SPIRAL: LazyLock<[Vec2; TAPS]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let share = (i as f32 + 0.5) / TAPS as f32;
        Vec2::from_angle(3.0 * TAU * share) * share
    })
});

/// How the spiral is turned in each pixel of a 4 × 4 block: sixteen different ways.
static TURNS: LazyLock<[[Vec2; 4]; 4]> =
    LazyLock::new(|| BAYER.map(|row| row.map(|k| Vec2::from_angle(TAU / 3.0 * k / 16.0))));

/// Ordered thresholds, each of 0 to 15 once in every 4 × 4 block.
const BAYER: [[f32; 4]; 4] = [
    [0.0, 8.0, 2.0, 10.0],
    [12.0, 4.0, 14.0, 6.0],
    [3.0, 11.0, 1.0, 9.0],
    [15.0, 7.0, 13.0, 5.0],
];
