//! The floor, seen only by the shadow on it.

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::Ground;
use crate::dome::Probe;
use crate::light_map::LightMap;
use crate::studio::KEY_RADIUS;

/// Points a side of the grid that gathers the dome's light.
const GRID: usize = 96;
/// How far the grid reaches beyond the figure [m].
const BORDER: f32 = 0.65;

/// Where on the floor the dome's light is gathered.
pub(crate) struct Patch {
    corner: Vec2,
    step: f32,
    height: f32,
}

impl Patch {
    /// A square of floor around a box.
    pub fn new(ground: &Ground, (lo, hi): (DVec3, DVec3)) -> Self {
        let (lo, hi) = (lo.as_vec3(), hi.as_vec3());
        let side = (hi.x - lo.x).max(hi.z - lo.z) + 2.0 * BORDER;
        let middle = Vec2::new(lo.x + hi.x, lo.z + hi.z) * 0.5;
        let step = side / (GRID - 1) as f32;
        Self {
            corner: middle - Vec2::splat(0.5 * side),
            step,
            height: ground.height as f32,
        }
    }

    /// Its grid points, facing up.
    pub fn probes(&self) -> Vec<Probe> {
        let at = |i: usize| {
            let p = self.corner + Vec2::new((i % GRID) as f32, (i / GRID) as f32) * self.step;
            Probe {
                at: Vec3::new(p.x, self.height, p.y),
                normal: Vec3::Y,
            }
        };
        (0..GRID * GRID).map(at).collect()
    }
}

/// The floor under one set of lights.
pub(crate) struct Floor {
    patch: Patch,
    /// Height [m].
    pub height: f32,
    strength: f32,
    /// Share of the dome's light that arrives, per grid point.
    open: Vec<f32>,
    shade: Pyramid,
    key_share: f32,
}

impl Floor {
    /// The floor of `patch` with the dome's light `dome` on it, darkened by `key`.
    pub fn new(
        ground: &Ground,
        patch: Patch,
        dome: &[Vec3],
        key: &LightMap,
        key_light: f32,
    ) -> Self {
        let clear = dome.iter().map(|l| l.y).fold(1e-6, f32::max);
        let open = softened(softened(dome.iter().map(|l| l.y / clear).collect()));
        let shade = Pyramid::new(key);
        let height = patch.height;
        let key_share = key_light / (key_light + clear);
        Self {
            patch,
            height,
            strength: ground.strength,
            open,
            shade,
            key_share,
        }
    }

    /// How much light is left at a point of the floor [m], 0 to 1; one far away.
    pub fn light(&self, at: Vec3, key: &LightMap) -> f32 {
        let q = (Vec2::new(at.x, at.z) - self.patch.corner) / self.patch.step;
        let last = (GRID - 1) as f32;
        let inside = q.min_element().min(last - q.max_element());
        let near = smooth(inside / (0.18 * last));
        let dome = if inside > 0.0 {
            1.0 + (self.dome(q) - 1.0) * near
        } else {
            1.0
        };
        let lit =
            self.key_share * (1.0 - self.shade.shadow(key, at)) + (1.0 - self.key_share) * dome;
        1.0 - self.strength * (1.0 - lit)
    }

    /// The grid between its points.
    fn dome(&self, q: Vec2) -> f32 {
        let cell = q.floor().clamp(Vec2::ZERO, Vec2::splat((GRID - 2) as f32));
        let f = q - cell;
        let at = |i: usize, j: usize| self.open[(cell.y as usize + j) * GRID + cell.x as usize + i];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        mix(
            mix(at(0, 0), at(1, 0), f.x),
            mix(at(0, 1), at(1, 1), f.x),
            f.y,
        )
    }
}

/// The key light's map blurred to every width: everything that stands is above
/// the floor, so its shadow is the share of the light's disc that it covers.
struct Pyramid {
    levels: Vec<Level>,
}

/// Per texel: covered share, and covered share times height towards the light.
struct Level {
    size: usize,
    texels: Vec<[f32; 2]>,
}

impl Pyramid {
    fn new(key: &LightMap) -> Self {
        let solid = |&t: &f32| if t.is_finite() { [1.0, t] } else { [0.0, 0.0] };
        let texels = key.top.par_iter().map(solid).collect();
        let mut levels = vec![Level {
            size: key.size,
            texels,
        }];
        while levels[levels.len() - 1].size > 4 {
            let next = levels[levels.len() - 1].halved();
            levels.push(next);
        }
        Self { levels }
    }

    /// Share of the key light that is hidden from a floor point [m].
    fn shadow(&self, key: &LightMap, at: Vec3) -> f32 {
        let p = key.place(at);
        let widest = 0.10 / key.texel;
        let level = (widest.log2() as usize).min(self.levels.len() - 1);
        let [cover, sum] = self.levels[level].at(p.x, p.y, level);
        if cover < 1e-4 {
            return 0.0;
        }
        let above = (sum / cover - p.z).max(0.0);
        let radius = (KEY_RADIUS * above / key.texel).clamp(1.5, 2.0 * widest);
        self.blurred(p.x, p.y, radius)[0] / (1.0 + (above / FADE).powi(2))
    }

    /// Mean over a disc of `radius` texels of the finest level.
    fn blurred(&self, x: f32, y: f32, radius: f32) -> [f32; 2] {
        let level = (radius * 0.7)
            .max(1.0)
            .log2()
            .min((self.levels.len() - 2) as f32);
        let (fine, t) = (level.floor() as usize, level.fract());
        let mut sum = [0.0; 2];
        for (dx, dy, w) in TAPS {
            let (u, v) = (x + dx * radius, y + dy * radius);
            let a = self.levels[fine].at(u, v, fine);
            let b = self.levels[fine + 1].at(u, v, fine + 1);
            for k in 0..2 {
                sum[k] += w * (a[k] + (b[k] - a[k]) * t);
            }
        }
        sum
    }
}

/// Height above the floor at which a shadow has lost half its depth [m]: the lamp's
/// halo is wider than the lamp.
const FADE: f32 = 1.5;

/// The grid after one pass of a 3 × 3 binomial blur.
fn softened(grid: Vec<f32>) -> Vec<f32> {
    let at = |x: usize, y: usize| grid[y.min(GRID - 1) * GRID + x.min(GRID - 1)];
    let row = |x: usize, y: usize| at(x.saturating_sub(1), y) + 2.0 * at(x, y) + at(x + 1, y);
    let one = |i: usize| {
        let (x, y) = (i % GRID, i / GRID);
        (row(x, y.saturating_sub(1)) + 2.0 * row(x, y) + row(x, y + 1)) / 16.0
    };
    (0..GRID * GRID).map(one).collect()
}

/// A disc's middle and six places round it, with their weights.
const TAPS: [(f32, f32, f32); 7] = [
    (0.0, 0.0, 0.22),
    (0.6, 0.0, 0.13),
    (0.3, 0.52, 0.13),
    (-0.3, 0.52, 0.13),
    (-0.6, 0.0, 0.13),
    (-0.3, -0.52, 0.13),
    (0.3, -0.52, 0.13),
];

impl Level {
    fn halved(&self) -> Self {
        let size = self.size / 2;
        let texel = |i: usize| {
            let (x, y) = (i % size * 2, i / size * 2);
            let at = |dx: usize, dy: usize| self.texels[(y + dy) * self.size + x + dx];
            let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
            [0, 1].map(|k| 0.25 * (four[0][k] + four[1][k] + four[2][k] + four[3][k]))
        };
        Self {
            size,
            texels: (0..size * size).into_par_iter().map(texel).collect(),
        }
    }

    /// The level between its texels; nothing outside.
    fn at(&self, x: f32, y: f32, level: usize) -> [f32; 2] {
        let scale = 1.0 / (1 << level) as f32;
        let (x, y) = (x * scale - 0.5, y * scale - 0.5);
        let limit = self.size as f32;
        if !(x > -1.0 && y > -1.0 && x < limit && y < limit) {
            return [0.0; 2];
        }
        // One more than the texel to the left and above, so that both are counts.
        let (i, j) = ((x + 1.0) as usize, (y + 1.0) as usize);
        let (fx, fy) = (x + 1.0 - i as f32, y + 1.0 - j as f32);
        let texel = |di: usize, dj: usize| {
            let (u, v) = ((i + di).wrapping_sub(1), (j + dj).wrapping_sub(1));
            let inside = u < self.size && v < self.size;
            if inside {
                self.texels[v * self.size + u]
            } else {
                [0.0; 2]
            }
        };
        let (a, b, c, d) = (texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1));
        [0, 1].map(|k| {
            (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy
        })
    }
}

fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_edge_fades_to_nothing_without_a_step() {
        let solid = Level {
            size: 8,
            texels: vec![[1.0, 2.0]; 64],
        };
        let mut last = solid.at(4.0, 4.0, 0)[0];
        for i in 0..=60 {
            let cover = solid.at(4.0 + 0.1 * i as f32, 4.0, 0)[0];
            assert!((last - cover).abs() < 0.11, "step from {last} to {cover}");
            last = cover;
        }
        assert_eq!(last, 0.0);
    }
}
