//! A turned square cut out of a picture, as a network sees it.
//!
//! Sampling agrees bit for bit with what the networks met in training: corners map to corners
//! (not pixel centres), places are rounded to 1/32 pixel and values to whole steps, as OpenCV's
//! `warpPerspective` does with 8-bit pictures.

use glam::DVec2;
use muslin_geom::Image;

/// A square in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Square {
    /// Its middle [px].
    pub centre: DVec2,
    /// Length of a side [px].
    pub side: f64,
    /// How far it is turned, clockwise as one looks at the picture [rad].
    pub angle: f64,
}

/// What lies beyond the edge of a picture.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Border {
    /// Black.
    Black,
    /// The pixels at the edge, going on.
    Stretched,
}

/// Steps per pixel that places are rounded to.
const STEPS: i64 = 32;

impl Square {
    /// The smallest upright square around a whole picture.
    pub(super) fn around(image: &Image) -> Self {
        let size = DVec2::new(image.width as f64, image.height as f64);
        Self {
            centre: size / 2.0,
            side: size.max_element(),
            angle: 0.0,
        }
    }

    /// The picture's place [px] of a place in the square, both coordinates from 0 to 1.
    pub fn to_picture(&self, p: DVec2) -> DVec2 {
        let turn = DVec2::from_angle(self.angle);
        self.centre + turn.rotate((p - 0.5) * self.side)
    }
}

/// `n × n` pixels of three colours.
pub(super) fn sample(image: &Image, square: &Square, n: usize, border: Border) -> Vec<u8> {
    let origin = square.to_picture(DVec2::ZERO);
    let right = (square.to_picture(DVec2::X) - origin) / n as f64;
    let down = (square.to_picture(DVec2::Y) - origin) / n as f64;
    let mut out = vec![0; n * n * 3];
    for (y, row) in out.chunks_exact_mut(3 * n.max(1)).enumerate() {
        for (x, to) in row.as_chunks_mut().0.iter_mut().enumerate() {
            let at = origin + right * x as f64 + down * y as f64;
            *to = bilinear(image, at, border);
        }
    }
    out
}

fn bilinear(image: &Image, at: DVec2, border: Border) -> [u8; 3] {
    let [x, y] = [at.x, at.y].map(steps);
    let (fx, fy) = (x.rem_euclid(STEPS) as u64, y.rem_euclid(STEPS) as u64);
    let (x, y) = (x.div_euclid(STEPS), y.div_euclid(STEPS));
    let [[a, b], [c, d]] = inner_corners(image, x, y).unwrap_or_else(|| {
        [y, y + 1].map(|y| [pixel(image, x, y, border), pixel(image, x + 1, y, border)])
    });
    let (gx, gy) = (32 - fx, 32 - fy);
    let sum = (spread(a) * gx + spread(b) * fx) * gy + (spread(c) * gx + spread(d) * fx) * fy;
    let rounded = sum + spread([1, 1, 1, 0]) * 512;
    [0, 20, 40].map(|shift| (rounded >> (shift + 10)) as u8)
}

/// Whole steps nearest to a place [px], the even one of two.
///
/// A float so large has no bits left for fractions, so adding it rounds, without the call that
/// rounding is on plain processors.
fn steps(v: f64) -> i64 {
    const LARGE: f64 = 1.5 * (1_u64 << 52) as f64;
    let scaled = (v * STEPS as f64).clamp(-1e12, 1e12);
    (scaled + LARGE).to_bits() as i64 - LARGE.to_bits() as i64
}

/// Three colours twenty bits apart: room for each times 1024.
fn spread([r, g, b, _]: [u8; 4]) -> u64 {
    u64::from(r) | u64::from(g) << 20 | u64::from(b) << 40
}

/// The pixel at a place, its right neighbour, and both below, if all are inside.
fn inner_corners(image: &Image, x: i64, y: i64) -> Option<[[[u8; 4]; 2]; 2]> {
    let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
    if x + 1 >= image.width || y + 1 >= image.height {
        return None;
    }
    let at = y * image.width + x;
    let pair = |at: usize| image.pixels[at..].first_chunk().copied();
    Some([pair(at)?, pair(at + image.width)?])
}

#[inline]
fn pixel(image: &Image, x: i64, y: i64, border: Border) -> [u8; 4] {
    let (right, low) = (image.width as i64 - 1, image.height as i64 - 1);
    let (inside_x, inside_y) = (x.clamp(0, right), y.clamp(0, low));
    if border == Border::Black && (x, y) != (inside_x, inside_y) {
        return [0; 4];
    }
    image.pixels[inside_y as usize * image.width + inside_x as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red grows to the right, green downwards, four per pixel.
    fn ramps() -> Image {
        let pixel = |i: usize| [(i % 40 * 4) as u8, (i / 40 * 4) as u8, 100, 255];
        Image {
            width: 40,
            height: 30,
            pixels: (0..1200).map(pixel).collect(),
        }
    }

    #[test]
    fn an_upright_square_keeps_pixels_as_they_are() {
        let square = Square {
            centre: DVec2::new(18.0, 12.0),
            side: 8.0,
            angle: 0.0,
        };
        let out = sample(&ramps(), &square, 8, Border::Black);
        assert_eq!(out[..6], [14 * 4, 8 * 4, 100, 15 * 4, 8 * 4, 100]);
        assert_eq!(out[8 * 3..8 * 3 + 3], [14 * 4, 9 * 4, 100]);
    }

    #[test]
    fn a_quarter_turn_looks_along_the_other_axis() {
        let angle = std::f64::consts::FRAC_PI_2;
        let square = Square {
            centre: DVec2::new(20.0, 15.0),
            side: 10.0,
            angle,
        };
        let out = sample(&ramps(), &square, 10, Border::Black);
        // Its top left corner is the picture's top right one; rightwards is down.
        assert_eq!(out[..6], [25 * 4, 10 * 4, 100, 25 * 4, 11 * 4, 100]);
    }

    #[test]
    fn beyond_the_edge_is_black_or_goes_on() {
        let square = Square {
            centre: DVec2::ZERO,
            side: 8.0,
            angle: 0.0,
        };
        let outside = |border| sample(&ramps(), &square, 8, border)[..3].to_vec();
        assert_eq!(outside(Border::Black), [0, 0, 0]);
        assert_eq!(outside(Border::Stretched), [0, 0, 100]);
    }

    #[test]
    fn between_pixels_values_mix_and_round() {
        let square = Square {
            centre: DVec2::new(10.25, 10.5),
            side: 0.0,
            angle: 0.0,
        };
        assert_eq!(sample(&ramps(), &square, 1, Border::Black), [41, 42, 100]);
    }
}
