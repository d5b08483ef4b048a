//! The small dark places between folds, from the picture's own depths.

use std::f32::consts::TAU;
use std::sync::LazyLock;

use glam::{Mat3, Vec2, Vec3};
use muslin_geom::widely;
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
            widely(
                #[inline(always)]
                || {
                    let mut row = vec![1.0; depths.width];
                    for (x, open) in row.iter_mut().enumerate() {
                        *open = view.openness(x, y);
                    }
                    row
                },
            )
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
    #[inline(always)]
    fn openness(&self, x: usize, y: usize) -> f32 {
        let here = y * self.depths.width + x;
        let depth = self.depths.depth[here];
        if !depth.is_finite() {
            return 1.0;
        }
        let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let across = (middle - self.centre) / self.focal;
        let n = self.camera_from_world * self.depths.normal[here];
        let n = Vec3::new(n.x, -n.y, -n.z);
        let reach = (REACH * self.focal / depth).clamp(2.0, 48.0);
        let spiral = &SPIRALS[y % 4][x % 4];
        // Where the taps look, in pixels from here, and what is there.
        let (mut off, mut seen) = ([[0.0; TAPS]; 2], [f32::INFINITY; TAPS]);
        for k in 0..TAPS {
            let at = [x as f32, y as f32].map(|c| c + 0.5);
            let [u, v] = [0, 1].map(|c| (spiral[c][k] * reach + at[c]).floor());
            [off[0][k], off[1][k]] = [u + 0.5 - at[0], v + 0.5 - at[1]];
            let inside = u >= 0.0 && v >= 0.0;
            let (u, v) = (u as usize, v as usize);
            if inside && u < self.depths.width && v < self.depths.height {
                seen[k] = self.depths.depth[v * self.depths.width + u];
            }
        }
        let mut closed = [0.0; TAPS];
        for k in 0..TAPS {
            // What is not there is out of reach.
            let z = seen[k].min(depth + 2.0 * REACH);
            let dx = across.x * (z - depth) + off[0][k] * (z / self.focal);
            let dy = across.y * (z - depth) + off[1][k] * (z / self.focal);
            let dz = z - depth;
            let d2 = dx * dx + dy * dy + dz * dz + 1e-10;
            let near = (1.0 - d2 / (REACH * REACH)).max(0.0);
            let ahead = dx * n.x + dy * n.y + dz * n.z;
            closed[k] = (ahead / d2.sqrt() - 0.12).max(0.0) * near;
        }
        let closed: f32 = closed.iter().sum();
        (1.0 - STRENGTH * closed / TAPS as f32).clamp(0.0, 1.0)
    }
}

/// Three turns outwards, across and down, turned in each pixel of a 4 × 4 block in one of sixteen ways.
static SPIRALS: LazyLock<[[[[f32; TAPS]; 2]; 4]; 4]> = LazyLock::new(|| {
    let tap = |turn: f32, k: usize| {
        let share = (k as f32 + 0.5) / TAPS as f32;
        Vec2::from_angle(TAU / 3.0 * turn / 16.0)
            .rotate(Vec2::from_angle(3.0 * TAU * share) * share)
    };
    BAYER.map(|row| row.map(|turn| [0, 1].map(|c| std::array::from_fn(|k| tap(turn, k)[c]))))
});

/// Ordered thresholds, each of 0 to 15 once in every 4 × 4 block.
const BAYER: [[f32; 4]; 4] = [
    [0.0, 8.0, 2.0, 10.0],
    [12.0, 4.0, 14.0, 6.0],
    [3.0, 11.0, 1.0, 9.0],
    [15.0, 7.0, 13.0, 5.0],
];
