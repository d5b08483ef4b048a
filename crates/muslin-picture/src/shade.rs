//! How a surface answers the light.

use std::f32::consts::{PI, TAU};
use std::sync::LazyLock;

use glam::{Vec2, Vec3};
use muslin_geom::widely;

use crate::fragment::Fragment;
use crate::light_map::LightMap;
use crate::project::{FAR, Flat};
use crate::studio::{KEY_RADIUS, Studio};
use crate::{Material, Scene, tone, weave};

/// All that shading needs beside the fragment.
pub(crate) struct Shader<'a> {
    pub scene: &'a Scene,
    pub flat: &'a Flat,
    pub studio: &'a Studio,
    pub key_map: &'a LightMap,
    /// The camera's place [m] and focal length [px].
    pub eye: Vec3,
    pub focal: f32,
    /// Factor on all light.
    pub exposure: f32,
}

impl Shader<'_> {
    /// Displayable light of a fragment in pixel `(x, y)`, whose crevice is `open`.
    pub fn colour(&self, f: &Fragment, x: usize, y: usize, open: f32) -> Vec3 {
        let material = &self.scene.parts[f.part as usize].material;
        let view = (self.eye - f.at).normalize_or(Vec3::Y);
        let (albedo, normal) = self.surface(f, material, view);
        let lit = self.key_share(f, x, y);
        let key = self.studio.key * lit;
        let l = self.studio.key_dir;
        let cos = normal.dot(l);
        let wrapped = ((cos + material.wrap) / (1.0 + material.wrap)).clamp(0.0, 1.0);
        // Light bounced inside a crevice takes on the cloth's colour.
        let bounced = Vec3::splat(open) + albedo * ((1.0 - open) * 0.6 * open);
        let dome = f.dome + bounce(f.dome, albedo);
        let diffuse = albedo * (key * wrapped * (0.4 + 0.6 * open) + dome * bounced);
        let gloss = key * highlight(material, normal, l, view);
        let fuzz = Vec3::from(material.sheen)
            * (key * fuzz(normal, l, view) + f.dome * (open * grazing(normal, view)));
        tone::film((diffuse + gloss + fuzz) * self.exposure)
    }

    /// Colour and normal with weave, hem and painted layer.
    fn surface(&self, f: &Fragment, material: &Material, view: Vec3) -> (Vec3, Vec3) {
        let across = f.depth / self.focal;
        let slant = f.normal.dot(view).abs().max(0.15);
        let mut colour = Vec3::from(material.colour) * f.colour;
        let mut normal = f.normal;
        if f.layer > -4.0 * across
            && let Some(layer) = &self.scene.parts[f.part as usize].layer
        {
            let inside = (0.5 + f.layer / across).clamp(0.0, 1.0);
            colour = colour.lerp(Vec3::from(layer.colour), inside);
            let seam = (1.0 - (f.layer / across.max(0.002)).abs()).max(0.0);
            colour *= 1.0 - 0.18 * seam;
        }
        if let Some(weave) = &material.weave
            && let Some([t, b]) = self.grain(f)
        {
            let texture = weave::texture(weave, f.uv, across / slant);
            colour *= texture.tint;
            normal = (normal - t * texture.slope.x - b * texture.slope.y).normalize_or(normal);
        }
        if f.hem < FAR && material.hem > 0.0 {
            colour *= 1.0 - 0.30 * stitches(f.hem, material.hem, across / slant);
        }
        (colour, normal)
    }

    /// Unit vectors along weft and warp on the side that is seen.
    fn grain(&self, f: &Fragment) -> Option<[Vec3; 2]> {
        let p = self.flat.corners(f.face);
        let uv = self.flat.uvs[f.face as usize];
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
        let det = d1.perp_dot(d2);
        let along = [
            (e1 * d2.y - e2 * d1.y) * det.signum(),
            (e2 * d1.x - e1 * d2.x) * det.signum(),
        ];
        (det.abs() > 1e-12).then(|| along.map(|v| v.normalize_or_zero()))
    }

    /// Share of the key light that reaches a fragment, 0 to 1.
    ///
    /// Percentage-closer soft shadows (Fernando 2005): a first look finds how far
    /// off the blockers are, a second blurs by what the lamp's size makes of it.
    fn key_share(&self, f: &Fragment, x: usize, y: usize) -> f32 {
        let receiver = Receiver::new(self.key_map, f);
        match receiver.turned_away {
            true => 0.0,
            false => widely(
                #[inline(always)]
                || receiver.unblocked(self.key_map, Vec2::from_angle(TAU * interleaved(x, y))),
            ),
        }
    }
}

/// Sums kept side by side.
const LANES: usize = 4;

/// Light that hidden places get from the cloth around them, which hides the dome.
fn bounce(dome: Vec3, albedo: Vec3) -> Vec3 {
    const OPEN: f32 = 0.45;
    (albedo * 0.35 + Vec3::splat(0.11)) * (OPEN - dome.y).max(0.0)
}

/// Where blockers are looked for.
static SEARCH: LazyLock<[[f32; 20]; 2]> = LazyLock::new(spiral);
/// Where the shadow is looked at.
static TAPS: LazyLock<[[f32; 40]; 2]> = LazyLock::new(spiral);

/// A shaded point as the key light's map sees it.
struct Receiver {
    /// Texel coordinates, and height towards the light [m].
    at: Vec3,
    /// Rise of the surface per texel.
    slope: Vec2,
    margin: f32,
    turned_away: bool,
}

impl Receiver {
    fn new(map: &LightMap, f: &Fragment) -> Self {
        let n = Vec3::new(
            f.normal.dot(map.right),
            f.normal.dot(map.up),
            f.normal.dot(map.toward),
        );
        let slope = -n.truncate() / n.z.max(0.2) * map.texel;
        let at = map.place(f.at + f.normal * (1.5 * map.texel + 0.0008));
        Self {
            at,
            slope,
            margin: 0.7 * map.texel + 0.0006,
            turned_away: n.z < -0.25,
        }
    }

    /// Share of the lamp that is seen past what the map holds; `turn` (of unit length) turns where that is looked for.
    #[inline(always)]
    fn unblocked(&self, map: &LightMap, turn: Vec2) -> f32 {
        let widest = (KEY_RADIUS * 0.45 / map.texel).clamp(2.0, 40.0);
        let (places, heights) = self.around(&SEARCH, turn * widest);
        let tops = map.at(&places);
        let (mut sums, mut blockers) = ([0.0; LANES], 0);
        for k in 0..tops.len() {
            let blocks = tops[k] > heights[k];
            sums[k % LANES] += if blocks { tops[k] } else { 0.0 };
            blockers += usize::from(blocks);
        }
        if blockers == 0 {
            return 1.0;
        }
        let height = sums.iter().sum::<f32>() / blockers as f32;
        let gap = (height - self.at.z).max(0.0);
        let radius = (KEY_RADIUS * gap / map.texel).clamp(1.6, widest);
        let (places, heights) = self.around(&TAPS, turn * radius);
        let lit = map.lit(&places, &heights);
        let mut sums = [0.0; LANES];
        for k in 0..lit.len() {
            sums[k % LANES] += lit[k];
        }
        sums.iter().sum::<f32>() / lit.len() as f32
    }

    /// Texel coordinates of the points of a disc about it, each multiplied by `turn` as complex numbers are, and the height
    /// below which a texel there does not block.
    #[inline(always)]
    fn around<const N: usize>(
        &self,
        [x, y]: &[[f32; N]; 2],
        turn: Vec2,
    ) -> ([[f32; N]; 2], [f32; N]) {
        let (mut places, mut heights) = ([[0.0; N]; 2], [0.0; N]);
        for k in 0..N {
            let (dx, dy) = (turn.x * x[k] - turn.y * y[k], turn.y * x[k] + turn.x * y[k]);
            (places[0][k], places[1][k]) = (self.at.x + dx, self.at.y + dy);
            heights[k] = self.at.z + self.slope.x * dx + self.slope.y * dy + self.margin;
        }
        (places, heights)
    }
}

/// `N` points spread evenly over the unit disc, across and up.
fn spiral<const N: usize>() -> [[f32; N]; 2] {
    let point = |i: usize| {
        let r = ((i as f32 + 0.5) / N as f32).sqrt();
        Vec2::from_angle(i as f32 * 2.399_963) * r
    };
    [0, 1].map(|c| std::array::from_fn(|i| point(i)[c]))
}

/// Interleaved gradient noise (Jimenez 2014), 0 to 1.
fn interleaved(x: usize, y: usize) -> f32 {
    (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract()
}

/// GGX microfacet highlight times cosine (Walter 2007, Schlick's Fresnel).
fn highlight(material: &Material, n: Vec3, l: Vec3, v: Vec3) -> f32 {
    let h = (l + v).normalize_or(n);
    let (nl, nv, nh) = (n.dot(l).max(0.0), n.dot(v).max(0.05), n.dot(h).max(0.0));
    let a2 = material.roughness.clamp(0.1, 1.0).powi(4);
    let bulk = nh * nh * (a2 - 1.0) + 1.0;
    let d = a2 / (PI * bulk * bulk);
    let fresnel = material.specular + (1.0 - material.specular) * (1.0 - v.dot(h).max(0.0)).powi(5);
    // Fibres shade one another at grazing angles: no bright rim on rough cloth.
    let fresnel = fresnel.min(material.specular * 6.0);
    let visible =
        0.5 / (nl * (nv + (1.0 - nv) * a2.sqrt()) + nv * (nl + (1.0 - nl) * a2.sqrt()) + 1e-4);
    PI * d * visible * fresnel * nl
}

/// Fuzz lit by the key light, "Charlie" (Estevez and Kulla 2017) of roughness ½
/// times cosine.
fn fuzz(n: Vec3, l: Vec3, v: Vec3) -> f32 {
    let h = (l + v).normalize_or(n);
    let (nl, nv) = (n.dot(l).max(0.0), n.dot(v).max(0.0));
    let d = 4.0 * (1.0 - n.dot(h).powi(2)).max(0.0) / TAU;
    PI * d * nl / (4.0 * (nl + nv - nl * nv) + 1e-3)
}

/// Fuzz lit from all around.
fn grazing(n: Vec3, v: Vec3) -> f32 {
    (1.0 - n.dot(v).max(0.0)).powi(3)
}

/// Darkness of two rows of stitches at a hem of `width` [m], `d` [m] from the
/// edge, for a pixel that spans `footprint` [m].
fn stitches(d: f32, width: f32, footprint: f32) -> f32 {
    const THREAD: f32 = 0.0011;
    let blur = footprint.max(THREAD);
    let row = |at: f32| (1.0 - (d - at).abs() / blur).max(0.0) * (THREAD / blur).sqrt();
    row(width).max(row(width - 0.006))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How much light there is on a floor of a metre under a cover this high [m] all around, with a hole above the middle.
    fn lit_under(cover: f32, hole: f32) -> f32 {
        let mut flat = Flat::default();
        let corners = [[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]];
        flat.at.extend(corners.map(|[x, z]| Vec3::new(x, 0.0, z)));
        flat.faces.extend([[0, 1, 2], [0, 2, 3]]);
        let mut map = LightMap::new(&flat, Vec3::Y, 1004);
        let middle = map.place(Vec3::ZERO);
        for (k, top) in map.top.iter_mut().enumerate() {
            let texel = Vec2::new((k % map.size) as f32, (k / map.size) as f32) + 0.5;
            if texel.distance(middle.truncate()) * map.texel > hole {
                *top = cover;
            }
        }
        let receiver = Receiver {
            at: middle,
            slope: Vec2::ZERO,
            margin: 1e-3,
            turned_away: false,
        };
        receiver.unblocked(&map, Vec2::X)
    }

    #[test]
    fn light_through_a_small_hole_of_what_lies_close_is_seen() {
        assert_eq!(lit_under(0.004, 0.003), 1.0, "close cover, open middle");
        assert_eq!(lit_under(0.004, 0.0), 0.0, "close cover");
        assert_eq!(lit_under(0.3, 0.0), 0.0, "far cover");
        let far = lit_under(0.3, 0.003);
        assert!((0.0..0.3).contains(&far), "{far}: the lamp is wide");
        assert_eq!(lit_under(0.004, 2.0), 1.0, "no cover");
    }
}
