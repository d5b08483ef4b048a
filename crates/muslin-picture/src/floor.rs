//! The floor, seen only by the shadow on it.

use glam::{DVec3, Vec2, Vec3};
use muslin_geom::widely;
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
        let shadow = self.shade.shadow(key, at);
        if inside <= 0.0 && shadow == 0.0 {
            return 1.0;
        }
        let lit = self.key_share * (1.0 - shadow) + (1.0 - self.key_share) * dome;
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
    /// Covered share.
    levels: Vec<Level>,
    /// The widest disc that is looked at [texels], and the level where it is one texel.
    widest: f32,
    coarse: usize,
    /// Covered share times height towards the light [m], there.
    heights: Level,
}

/// A map of one number a texel, with a border of nothing around it.
struct Level {
    size: usize,
    texels: Vec<f32>,
}

impl Pyramid {
    fn new(key: &LightMap) -> Self {
        let cover = |x: usize, y: usize| f32::from(u8::from(key.top[y * key.size + x].is_finite()));
        let mut levels = vec![Level::of(key.size, cover)];
        while levels[levels.len() - 1].size > 4 {
            let next = levels[levels.len() - 1].halved();
            levels.push(next);
        }
        let widest = 0.10 / key.texel;
        let coarse = (widest.log2() as usize).min(levels.len() - 1);
        let side = 1 << coarse;
        let heights = Level::of(key.size >> coarse, |x, y| {
            let rows =
                (side * y..side * (y + 1)).map(|y| &key.top[y * key.size..][side * x..][..side]);
            let heights = rows.flatten().filter(|t| t.is_finite());
            heights.sum::<f32>() / (side * side) as f32
        });
        Self {
            levels,
            widest,
            coarse,
            heights,
        }
    }

    /// Share of the key light that is hidden from a floor point [m].
    fn shadow(&self, key: &LightMap, at: Vec3) -> f32 {
        let p = key.place(at);
        let level = self.coarse;
        let [cover] = self.levels[level].at([[p.x], [p.y]], level);
        if cover < 1e-4 {
            return 0.0;
        }
        let [sum] = self.heights.at([[p.x], [p.y]], level);
        let above = (sum / cover - p.z).max(0.0);
        let radius = (KEY_RADIUS * above / key.texel).clamp(1.5, 2.0 * self.widest);
        let hidden = widely(
            #[inline(always)]
            || self.blurred(p.truncate(), radius),
        );
        hidden / (1.0 + (above / FADE).powi(2))
    }

    /// Mean cover of a disc of `radius` texels of the finest level.
    #[inline(always)]
    fn blurred(&self, at: Vec2, radius: f32) -> f32 {
        let last = (self.levels.len() - 2) as f32;
        let level = (radius * 0.7).max(1.0).log2().min(last);
        let (fine, t) = (level as usize, level.fract());
        let [dx, dy, weights] = TAPS;
        let places = [dx.map(|d| at.x + d * radius), dy.map(|d| at.y + d * radius)];
        let a = self.levels[fine].at(places, fine);
        let b = self.levels[fine + 1].at(places, fine + 1);
        let mut sum = 0.0;
        for k in 0..weights.len() {
            sum += weights[k] * (a[k] + (b[k] - a[k]) * t);
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

/// A disc's middle and six places round it, across and up, and their weights.
const TAPS: [[f32; 7]; 3] = [
    [0.0, 0.6, 0.3, -0.3, -0.6, -0.3, 0.3],
    [0.0, 0.0, 0.52, 0.52, 0.0, -0.52, -0.52],
    [0.22, 0.13, 0.13, 0.13, 0.13, 0.13, 0.13],
];

impl Level {
    fn of(size: usize, texel: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let side = size + 2;
        let mut texels = vec![0.0; side * side];
        let rows = texels[side..side * (size + 1)].par_chunks_mut(side);
        rows.enumerate().for_each(|(y, row)| {
            for (x, out) in row[1..=size].iter_mut().enumerate() {
                *out = texel(x, y);
            }
        });
        Self { size, texels }
    }

    fn halved(&self) -> Self {
        let side = self.size + 2;
        Self::of(self.size / 2, |x, y| {
            let first = (2 * y + 1) * side + 2 * x + 1;
            let [above, below] = [first, first + side].map(|at| &self.texels[at..at + 2]);
            0.25 * (above[0] + above[1] + below[0] + below[1])
        })
    }

    /// The level between its texels at places counted in those of the finest; nothing outside.
    #[inline(always)]
    fn at<const N: usize>(&self, [x, y]: [[f32; N]; 2], level: usize) -> [f32; N] {
        let scale = 1.0 / (1 << level) as f32;
        let last = self.size as f32;
        // Counted with the border, whose outermost texels are nothing.
        let place = |v: f32| (v * scale + 0.5).clamp(0.0, last + 1.0);
        let (x, y) = (x.map(place), y.map(place));
        let whole = |v: f32| (v as u32).min(self.size as u32);
        let (i, j) = (x.map(whole), y.map(whole));
        let side = self.size + 2;
        let mut four = [[0.0; N]; 4];
        for k in 0..N {
            let first = j[k] as usize * side + i[k] as usize;
            let [above, below] = [first, first + side].map(|at| &self.texels[at..at + 2]);
            (four[0][k], four[1][k]) = (above[0], above[1]);
            (four[2][k], four[3][k]) = (below[0], below[1]);
        }
        std::array::from_fn(|k| {
            let (fx, fy) = (x[k] - i[k] as f32, y[k] - j[k] as f32);
            let above = four[0][k] * (1.0 - fx) + four[1][k] * fx;
            let below = four[2][k] * (1.0 - fx) + four[3][k] * fx;
            above * (1.0 - fy) + below * fy
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
        let solid = Level::of(8, |_, _| 1.0);
        let at = |x: f32| solid.at([[x], [4.0]], 0)[0];
        let mut last = at(4.0);
        for i in 0..=60 {
            let cover = at(4.0 + 0.1 * i as f32);
            assert!((last - cover).abs() < 0.11, "step from {last} to {cover}");
            last = cover;
        }
        assert_eq!(last, 0.0);
    }
}
