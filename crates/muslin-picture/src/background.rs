//! What is seen where nothing stands.

use glam::{Vec2, Vec3, Vec4};
use muslin_geom::widely;
use rayon::prelude::*;

use crate::{Background, tone};

/// Colour and opacity of the backdrop at a pixel, under a floor that lets
/// `light` (0 to 1) through; colour is premultiplied.
pub(crate) fn backdrop(background: &Background, pixel: Vec2, size: Vec2, light: f32) -> Vec4 {
    match *background {
        Background::Transparent => Vec4::new(0.0, 0.0, 0.0, 1.0 - light),
        Background::Plain(colour) => (Vec3::from(colour) * shadow_tint(light)).extend(1.0),
        Background::Gradient { centre, edge } => {
            let colour = Vec3::from(centre).lerp(Vec3::from(edge), pool(pixel / size));
            (colour * shadow_tint(light)).extend(1.0)
        }
    }
}

/// How far from the pool of light a place of the picture is, 0 to 1 both ways.
#[inline(always)]
fn pool(at: Vec2) -> f32 {
    let off = (at - Vec2::new(0.5, 0.46)) * Vec2::new(1.25, 1.1);
    let t = (off.length() / 0.78).min(1.0);
    t * t * (3.0 - 2.0 * t)
}

/// All pixels of a backdrop of `width` and `height` on which no shadow falls.
pub(crate) fn bare(background: &Background, width: usize, height: usize) -> Vec<[u8; 4]> {
    match *background {
        Background::Transparent => vec![[0; 4]; width * height],
        Background::Plain(colour) => {
            let [r, g, b] = tone::bytes(Vec3::from(colour), 0.0);
            vec![[r, g, b, 255]; width * height]
        }
        Background::Gradient { centre, edge } => {
            let ends = [centre, edge].map(Vec3::from);
            let size = Vec2::new(width as f32, height as f32);
            let mut pixels = vec![[0; 4]; width * height];
            let rows = pixels.par_chunks_mut(width.max(1)).enumerate();
            rows.for_each(|(y, row)| {
                widely(
                    #[inline(always)]
                    || graded(ends, size, y, row),
                );
            });
            pixels
        }
    }
}

/// Pixels made together, side by side in the processor's registers.
const LANES: usize = 16;

/// Row `y` of a graded backdrop of this `size` [px].
#[inline(always)]
fn graded([centre, edge]: [Vec3; 2], size: Vec2, y: usize, row: &mut [[u8; 4]]) {
    for (k, out) in row.chunks_mut(LANES).enumerate() {
        let x = |i: usize| LANES * k + i;
        let (mut share, mut noise) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            share[i] = pool(Vec2::new(x(i) as f32 + 0.5, y as f32 + 0.5) / size);
            noise[i] = tone::dither(x(i), y);
        }
        let mut levels = [[0; LANES]; 3];
        for c in 0..3 {
            let light = share.map(|t| centre[c] + (edge[c] - centre[c]) * t);
            levels[c] = tone::levels(light, noise);
        }
        for (i, pixel) in out.iter_mut().enumerate() {
            *pixel = [levels[0][i], levels[1][i], levels[2][i], 255];
        }
    }
}

/// Shadows on a studio floor are a little cool: the key light is warm.
fn shadow_tint(light: f32) -> Vec3 {
    let shade = 1.0 - light;
    Vec3::new(1.0 - shade, 1.0 - 0.985 * shade, 1.0 - 0.965 * shade)
}

/// Whether the backdrop needs dithering against bands.
pub(crate) fn is_graded(background: &Background) -> bool {
    matches!(background, Background::Gradient { .. })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_made_together_are_those_made_one_by_one() {
        let [width, height] = [37, 5];
        let size = Vec2::new(width as f32, height as f32);
        for background in [
            Background::default(),
            Background::Plain([0.2, 0.5, 1.0]),
            Background::Transparent,
        ] {
            let all = bare(&background, width, height);
            for (i, got) in all.iter().enumerate() {
                let [x, y] = [i % width, i / width];
                let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let colour = backdrop(&background, at, size, 1.0);
                let noise = match is_graded(&background) {
                    true => tone::dither(x, y),
                    false => 0.0,
                };
                let [r, g, b] = tone::bytes(colour.truncate(), noise);
                assert_eq!(*got, [r, g, b, (colour.w * 255.0) as u8], "{x} {y}");
            }
        }
    }
}
