//! A figure drawn over the photo it was fitted to.

use muslin_geom::Image;

use crate::{Background, Camera, Options, Scene, Stage, tone};
use glam::{Vec3, Vec4};

/// Largest side at which the figure is drawn; larger photos get it enlarged [px].
const LARGEST: usize = 2048;
/// Colour of the outline, linear RGB.
const OUTLINE: Vec3 = Vec3::new(0.02, 0.55, 0.85);

/// `photo` with the scene laid over it through `camera`, which need not have the
/// photo's size: its picture is stretched over the whole photo.
///
/// `opacity` (0 to 1) is that of the surface; outlines are always opaque. Pixels
/// that the figure does not touch keep their bytes. Floor and backdrop are left out.
pub fn overlay(photo: &Image, scene: &Scene, camera: &Camera, opacity: f64) -> Image {
    let mut out = photo.clone();
    let longest = photo.width.max(photo.height);
    if longest == 0 {
        return out;
    }
    let scale = (LARGEST as f64 / longest as f64).min(1.0);
    let shrunk = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    let figure = Figure::new(
        scene,
        &camera.scaled(shrunk(photo.width), shrunk(photo.height)),
    );
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        let x = ((i % photo.width) as f64 + 0.5) * figure.width as f64 / photo.width as f64;
        let y = ((i / photo.width) as f64 + 0.5) * figure.height as f64 / photo.height as f64;
        if let Some([colour, line]) = figure.at(x as f32 - 0.5, y as f32 - 0.5) {
            *pixel = blend(
                *pixel,
                colour,
                line.w * colour.w,
                opacity.clamp(0.0, 1.0) as f32,
            );
        }
    }
    out
}

/// Lays a premultiplied colour, thinned to `opacity`, and the outline over a pixel.
fn blend(pixel: [u8; 4], colour: Vec4, line: f32, opacity: f32) -> [u8; 4] {
    // What stands behind a transparent pixel is no colour of the photo.
    let under = f32::from(pixel[3]) / 255.0 * (1.0 - colour.w * opacity);
    let covered = under + colour.w * opacity;
    let body = tone::light(pixel) * under + colour.truncate() * opacity;
    let alpha = covered + line * (1.0 - covered);
    if alpha <= 0.0 {
        return pixel;
    }
    let light = (body * (1.0 - line) + OUTLINE * line) / alpha;
    let [r, g, b] = tone::bytes(light, 0.0);
    [r, g, b, (alpha * 255.0 + 0.5) as u8]
}

/// The figure alone: premultiplied linear colour, and how much outline, per pixel.
struct Figure {
    width: usize,
    height: usize,
    colour: Vec<Vec4>,
    line: Vec<f32>,
}

impl Figure {
    fn new(scene: &Scene, camera: &Camera) -> Self {
        let scene = Scene {
            parts: scene.parts.clone(),
            ground: None,
            background: Background::Transparent,
        };
        let options = Options {
            supersampling: 3,
            ..Options::default()
        };
        let stage = Stage::new(&scene, &options);
        let bare = stage.bare(camera.width, camera.height);
        let exposure = stage.expose(camera, &bare);
        let picture = exposure.develop();
        let premultiplied = |p: &[u8; 4]| {
            let alpha = f32::from(p[3]) / 255.0;
            (tone::light(*p) * alpha).extend(alpha)
        };
        let colour = picture.pixels.iter().map(premultiplied).collect();
        let radius = (camera.width.max(camera.height) as f32 / 900.0).max(0.8);
        let line = softened(
            &outlines(&exposure.depths.depth, camera.width, camera.height, radius),
            camera.width,
        );
        Self {
            width: camera.width,
            height: camera.height,
            colour,
            line,
        }
    }

    /// Colour and outline between pixel middles; none beside the figure.
    fn at(&self, x: f32, y: f32) -> Option<[Vec4; 2]> {
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        let mut sum = [Vec4::ZERO; 2];
        for (di, dj, w) in [
            (0.0, 0.0, (1.0 - fx) * (1.0 - fy)),
            (1.0, 0.0, fx * (1.0 - fy)),
            (0.0, 1.0, (1.0 - fx) * fy),
            (1.0, 1.0, fx * fy),
        ] {
            let u = (i + di).clamp(0.0, (self.width - 1) as f32) as usize;
            let v = (j + dj).clamp(0.0, (self.height - 1) as f32) as usize;
            let at = v * self.width + u;
            sum[0] += self.colour[at] * w;
            sum[1] += Vec4::splat(self.line[at]) * w;
        }
        (sum[0].w > 0.0).then_some(sum)
    }
}

/// How much of each covered pixel's disc of `radius` [px] lies on something
/// farther away, from none (0) to the outline's full strength (1).
fn outlines(depth: &[f32], width: usize, height: usize, radius: f32) -> Vec<f32> {
    let reach = radius.ceil() as i64 + 1;
    let line = |at: usize| {
        let (x, y) = ((at % width) as i64, (at / width) as i64);
        let mut nearest = f32::INFINITY;
        for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
            let (u, v) = (x + dx, y + dy);
            if u >= 0 && v >= 0 && u < width as i64 && v < height as i64 {
                let other = depth[v as usize * width + u as usize];
                if other - depth[at] > STEP {
                    nearest = nearest.min(((dx * dx + dy * dy) as f32).sqrt());
                }
            }
        }
        (radius + 1.0 - nearest).clamp(0.0, 1.0)
    };
    (0..depth.len())
        .map(|at| if depth[at].is_finite() { line(at) } else { 0.0 })
        .collect()
}

/// A line after a 3 × 3 binomial blur; rows are `width` long.
fn softened(line: &[f32], width: usize) -> Vec<f32> {
    let last = line.len() / width - 1;
    let across = |x: usize, y: usize| {
        let row = &line[y * width..(y + 1) * width];
        row[x.saturating_sub(1)] + 2.0 * row[x] + row[(x + 1).min(width - 1)]
    };
    let one = |at: usize| {
        let (x, y) = (at % width, at / width);
        let beside = across(x, y.saturating_sub(1)) + across(x, (y + 1).min(last));
        (beside + 2.0 * across(x, y)) / 16.0
    };
    (0..line.len()).map(one).collect()
}

/// A jump in depth that counts as an outline [m].
const STEP: f32 = 0.06;
