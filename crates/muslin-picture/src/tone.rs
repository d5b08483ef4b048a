//! From light to pixels: the film curve and sRGB.

use glam::Vec3;
use muslin_geom::colour::linear;

/// Where the shoulder starts.
const SHOULDER: f32 = 0.76;
/// How fast colours beyond the shoulder turn white.
const BLEACH: f32 = 0.15;

/// Scene light to displayable light: straight below a shoulder, hue kept above it.
///
/// The Khronos PBR Neutral tone mapper (2024), made for colours of goods,
/// without its toe: our surfaces add too little gloss for one.
pub(crate) fn film(light: Vec3) -> Vec3 {
    let light = light.max(Vec3::ZERO);
    let peak = light.max_element();
    if peak < SHOULDER {
        return light;
    }
    let d = 1.0 - SHOULDER;
    let new_peak = 1.0 - d * d / (peak + d - SHOULDER);
    let white = 1.0 - 1.0 / (BLEACH * (peak - new_peak) + 1.0);
    (light * (new_peak / peak)).lerp(Vec3::splat(new_peak), white)
}

/// The sRGB curve on [0, 1], within 1/100 of a byte step: least squares over
/// roots, which cost a tenth of a power. Several at once, as processors take them.
#[inline(always)]
pub(crate) fn encode<const N: usize>(c: [f32; N]) -> [f32; N] {
    let mut out = [0.0; N];
    for (out, c) in out.iter_mut().zip(c) {
        let half = c.sqrt();
        let fourth = half.sqrt();
        let eighth = fourth.sqrt();
        let curved = 0.653_979_07 * half + 0.688_729_14 * fourth
            - 0.318_488_72 * eighth
            - 0.020_187_25 * c
            - 0.004_063_6;
        *out = if c <= 0.003_130_8 { 12.92 * c } else { curved };
    }
    out
}

/// Displayable light to sRGB bytes; `dither` in (-0.5, 0.5) shifts the rounding.
pub(crate) fn bytes(colour: Vec3, dither: f32) -> [u8; 3] {
    let [r, g, b] = colour.to_array();
    let [r, g, b, _] = levels([r, g, b, 0.0], [dither; 4]);
    [r, g, b]
}

/// The same for several channels at once, each with its own dither.
#[inline(always)]
pub(crate) fn levels<const N: usize>(light: [f32; N], dither: [f32; N]) -> [u8; N] {
    let mut levels = encode(light.map(|c| c.clamp(0.0, 1.0)));
    for (level, dither) in levels.iter_mut().zip(dither) {
        *level = (*level * 255.0 + 0.5 + dither).clamp(0.0, 255.0);
    }
    levels.map(|level| level as u8)
}

/// sRGB bytes to displayable light.
pub(crate) fn light(pixel: [u8; 4]) -> Vec3 {
    Vec3::from_array(linear([pixel[0], pixel[1], pixel[2]]))
}

/// Noise of one triangular-free step at a pixel, in (-0.5, 0.5), the same every time.
#[inline(always)]
pub(crate) fn dither(x: usize, y: usize) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    ((h ^ (h >> 15)) >> 8) as f32 / 16_777_216.0 - 0.499_999
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_way_through_light() {
        for b in 0..=255u8 {
            assert_eq!(bytes(light([b, b, b, 255]), 0.0), [b; 3]);
        }
    }

    #[test]
    fn the_fitted_curve_follows_the_standard() {
        for i in 0..=100_000 {
            let c = i as f32 / 100_000.0;
            let power = 1.055 * c.powf(1.0 / 2.4) - 0.055;
            let exact = if c <= 0.003_130_8 { 12.92 * c } else { power };
            assert!((encode([c; 4])[3] - exact).abs() < 0.012 / 255.0, "{c}");
        }
    }

    #[test]
    fn the_film_curve_rises_and_stays_below_one() {
        let mut last = -1.0;
        for i in 0..400 {
            let out = film(Vec3::splat(i as f32 * 0.05)).x;
            assert!(out >= last && out <= 1.0, "step {i}: {out} after {last}");
            last = out;
        }
        assert_eq!(film(Vec3::splat(0.5)), Vec3::splat(0.5));
    }
}
