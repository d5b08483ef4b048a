//! Cloth structure from material coordinates, faded before it can alias.

use std::f32::consts::{PI, TAU};

use glam::Vec2;

use crate::{Weave, WeaveKind};

/// What a weave does to the surface at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Texture {
    /// Factor on the colour, about one on average.
    pub tint: f32,
    /// Slope of the yarns along weft and warp.
    pub slope: Vec2,
}

impl Texture {
    const FLAT: Self = Self {
        tint: 1.0,
        slope: Vec2::ZERO,
    };
}

/// The texture at `uv` [m] for a pixel that spans `footprint` [m] of cloth.
pub(crate) fn texture(weave: &Weave, uv: Vec2, footprint: f32) -> Texture {
    let mut out = Texture {
        tint: 1.0 + weave.slub * slub(weave.kind, uv, footprint),
        ..Texture::FLAT
    };
    let keep = fade(footprint / weave.repeat) * weave.contrast;
    if keep > 0.01 {
        let p = uv / weave.repeat;
        let h = 0.02;
        let here = height(weave.kind, p);
        let du = (height(weave.kind, p + Vec2::new(h, 0.0)) - here) / h;
        let dv = (height(weave.kind, p + Vec2::new(0.0, h)) - here) / h;
        out.tint *= 1.0 + keep * (here - 0.5);
        out.slope = Vec2::new(du, dv) * (0.25 * keep);
    }
    out
}

/// What is left of a wave when a pixel spans `share` of its length.
fn fade(share: f32) -> f32 {
    let x = 0.5 * PI * share;
    (-3.5 * x * x).exp()
}

/// Height of the yarns, 0 to 1, in repeats.
fn height(kind: WeaveKind, p: Vec2) -> f32 {
    let wave = |x: f32| 0.5 + 0.5 * (TAU * x).cos();
    match kind {
        WeaveKind::Plain => 0.5 + 0.5 * (TAU * p.x).cos() * (TAU * p.y).cos(),
        WeaveKind::Twill => 0.75 * wave(p.x + p.y) + 0.25 * wave(3.0 * p.x),
        WeaveKind::Jersey => {
            let side = (TAU * p.x).sin().abs();
            0.6 * side + 0.4 * side * wave(1.35 * p.y + 0.5 * side)
        }
        WeaveKind::Satin => wave(p.y + 0.2 * p.x),
    }
}

/// Uneven yarn, about -1 to 1: streaks along the yarns at several widths.
fn slub(kind: WeaveKind, uv: Vec2, footprint: f32) -> f32 {
    let (along, tilt) = match kind {
        WeaveKind::Twill => (14.0, 0.25),
        WeaveKind::Plain => (10.0, 1.0),
        WeaveKind::Jersey => (2.0, 0.6),
        WeaveKind::Satin => (12.0, 0.5),
    };
    let mut sum = 0.0;
    for (octave, &width) in [0.0013, 0.0031, 0.0073].iter().enumerate() {
        let keep = fade(footprint / (2.0 * width)) / (1.0 + 0.35 * octave as f32);
        if keep > 0.01 {
            let seed = octave as u32 * 2;
            sum += keep * noise(uv / Vec2::new(width, width * along), seed);
            sum += keep * tilt * noise(uv / Vec2::new(width * along, width), seed + 1);
        }
    }
    0.5 * sum
}

/// Smooth noise of unit wavelength, -1 to 1.
fn noise(p: Vec2, seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let s = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let (i, j) = (cell.x as i32 as u32, cell.y as i32 as u32);
    let at = |di: u32, dj: u32| hash(i.wrapping_add(di), j.wrapping_add(dj), seed);
    let top = at(0, 0) * (1.0 - s.x) + at(1, 0) * s.x;
    let low = at(0, 1) * (1.0 - s.x) + at(1, 1) * s.x;
    top * (1.0 - s.y) + low * s.y
}

fn hash(i: u32, j: u32, seed: u32) -> f32 {
    let mut h =
        i.wrapping_mul(0x8DA6_B343) ^ j.wrapping_mul(0xD816_3841) ^ seed.wrapping_mul(0xCB1A_B31F);
    h = (h ^ (h >> 13)).wrapping_mul(0x5BD1_E995);
    h = (h ^ (h >> 15)).wrapping_mul(0x27D4_EB2F);
    ((h ^ (h >> 14)) >> 8) as f32 / 8_388_608.0 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [WeaveKind; 4] = [
        WeaveKind::Plain,
        WeaveKind::Twill,
        WeaveKind::Jersey,
        WeaveKind::Satin,
    ];

    #[test]
    fn a_far_weave_is_plain_colour() {
        for kind in KINDS {
            let weave = Weave {
                slub: 0.0,
                ..Weave::usual(kind)
            };
            let t = texture(&weave, Vec2::new(0.1234, 0.0567), 2.0 * weave.repeat);
            assert_eq!(t, Texture::FLAT);
        }
    }

    #[test]
    fn a_near_weave_keeps_the_colour_on_average() {
        for kind in KINDS {
            let weave = Weave::usual(kind);
            let n = 20_000;
            let tints = (0..n).map(|i| {
                let uv = Vec2::new(i as f32 * 1.37e-4, i as f32 * 2.11e-5);
                texture(&weave, uv, 1e-5).tint
            });
            let mean = tints.sum::<f32>() / n as f32;
            assert!((mean - 1.0).abs() < 0.12, "{kind:?}: {mean}");
        }
    }
}
