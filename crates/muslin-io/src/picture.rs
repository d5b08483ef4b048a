//! Pictures out: PNG, and animated PNG for a turntable.

use flate2::Crc;
use muslin_geom::Image;
use png::{BitDepth, ColorType, DeflateCompression, Encoder, Filter, SrgbRenderingIntent};
use rayon::prelude::*;

/// `image` as a PNG, sRGB; the alpha channel is left out if nothing is transparent.
///
/// # Panics
/// If the image has no pixels or a pixel count other than its size says.
pub fn png(image: &Image) -> Vec<u8> {
    match is_opaque(image) {
        true => encode(image, ColorType::Rgb),
        false => encode(image, ColorType::Rgba),
    }
}

/// `frames` as an animated PNG that runs for ever, each frame shown for `delay_ms` [ms].
///
/// Readers that know no animation show the first frame. Every later frame stores only the
/// window in which it differs from the one before, and of opaque frames only the pixels that
/// do, the rest being clear: noise that stays costs nothing. All cores compress; the bytes do not depend
/// on how many there are.
///
/// # Panics
/// If there is no frame, or frames differ in size.
pub fn animated_png(frames: &[Image], delay_ms: u16) -> Vec<u8> {
    let first = frames.first().expect("an animation has a frame");
    let same = |f: &Image| (f.width, f.height) == (first.width, first.height);
    assert!(
        frames.iter().all(same),
        "all frames of an animation have one size"
    );
    let is_opaque = frames.iter().all(is_opaque);
    let packed = frames.par_iter().enumerate().map(|(i, frame)| match i {
        0 => (Window::whole(frame), encode(frame, ColorType::Rgba)),
        _ => later(&frames[i - 1], frame, is_opaque),
    });
    let packed: Vec<_> = packed.collect();
    animation(&packed, delay_ms, if is_opaque { OVER } else { REPLACE })
}

/// Blend of a frame whose pixels stand for themselves.
const REPLACE: u8 = 0;
/// Blend of a frame that is laid over the one before.
const OVER: u8 = 1;

/// What a frame adds to the one before.
fn later(before: &Image, frame: &Image, is_opaque: bool) -> (Window, Vec<u8>) {
    let window = Window::of_change(before, frame);
    let mut cut = window.cut(frame);
    if is_opaque {
        let same = cut.pixels.iter_mut().zip(window.cut(before).pixels);
        same.filter(|(a, b)| *a == b).for_each(|(a, _)| *a = [0; 4]);
    }
    (window, encode(&cut, ColorType::Rgba))
}

/// Joins pictures of their own into one animation (PNG 3rd edition, section 11.3.6).
fn animation(packed: &[(Window, Vec<u8>)], delay_ms: u16, blend: u8) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let is_pixels = |kind: &[u8]| kind == b"IDAT";
    for (kind, body) in chunks(&packed[0].1).take_while(|(kind, _)| !is_pixels(kind)) {
        put(&mut file, kind, body);
    }
    let count = packed.len() as u32;
    put(&mut file, b"acTL", &[count.to_be_bytes(), [0; 4]].concat());
    let mut sequence = 0u32..;
    let mut next = || {
        sequence
            .next()
            .expect("chunks are fewer than 4 milliards")
            .to_be_bytes()
    };
    for (i, (window, png)) in packed.iter().enumerate() {
        put(
            &mut file,
            b"fcTL",
            &[&next()[..], &window.control(delay_ms, blend)].concat(),
        );
        for (kind, body) in chunks(png).filter(|(kind, _)| is_pixels(kind)) {
            match i {
                0 => put(&mut file, kind, body),
                _ => put(&mut file, b"fdAT", &[&next()[..], body].concat()),
            }
        }
    }
    put(&mut file, b"IEND", &[]);
    file
}

/// Kinds and bodies of the chunks of a PNG that we wrote ourselves.
fn chunks(png: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    let mut rest = &png[8..];
    std::iter::from_fn(move || {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        let (kind, body) = rest[4..8 + length].split_at(4);
        rest = &rest[12 + length..];
        Some((kind, body))
    })
}

/// Appends a chunk.
fn put(file: &mut Vec<u8>, kind: &[u8], body: &[u8]) {
    file.extend((body.len() as u32).to_be_bytes());
    let start = file.len();
    file.extend(kind);
    file.extend(body);
    let mut sum = Crc::new();
    sum.update(&file[start..]);
    file.extend(sum.sum().to_be_bytes());
}

/// The part of a frame that is stored, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Window {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Window {
    fn whole(image: &Image) -> Self {
        Self {
            x: 0,
            y: 0,
            width: image.width,
            height: image.height,
        }
    }

    /// The body of a frame control chunk, without its sequence number: `blend` with what was
    /// there and leave it.
    fn control(&self, delay_ms: u16, blend: u8) -> Vec<u8> {
        let side = [self.width, self.height, self.x, self.y].map(|n| (n as u32).to_be_bytes());
        let delay = [delay_ms, 1000].map(u16::to_be_bytes);
        [side.as_flattened(), delay.as_flattened(), &[0, blend]].concat()
    }

    /// The picture in the window.
    fn cut(&self, image: &Image) -> Image {
        let rows = image.pixels.chunks(image.width);
        let rows = rows.skip(self.y).take(self.height);
        Image {
            width: self.width,
            height: self.height,
            pixels: rows
                .flat_map(|row| &row[self.x..][..self.width])
                .copied()
                .collect(),
        }
    }

    /// The smallest window with all pixels that differ; one pixel if none does.
    fn of_change(before: &Image, after: &Image) -> Self {
        let width = after.width;
        let rows = before
            .pixels
            .chunks(width)
            .zip(after.pixels.chunks(width))
            .enumerate();
        let (mut left, mut right, mut top, mut bottom) = (width, 0, after.height, 0);
        for (y, (a, b)) in rows {
            let differs = |x: &usize| a[*x] != b[*x];
            if let Some(x) = (0..width).find(differs) {
                let last = (0..width).rfind(differs).expect("a first has a last");
                (left, right) = (left.min(x), right.max(last));
                (top, bottom) = (top.min(y), y);
            }
        }
        match left > right {
            true => Self {
                x: 0,
                y: 0,
                width: 1,
                height: 1,
            },
            false => Self {
                x: left,
                y: top,
                width: right - left + 1,
                height: bottom - top + 1,
            },
        }
    }
}

fn is_opaque(image: &Image) -> bool {
    image.pixels.iter().all(|p| p[3] == 255)
}

/// How hard pixels are pressed: the next levels take 1.3 to 4 times as long for 1 to 5 % less.
const PRESSURE: u8 = 3;

/// A picture as a PNG of this kind, with or without alpha.
fn encode(image: &Image, colour: ColorType) -> Vec<u8> {
    assert_eq!(
        image.pixels.len(),
        image.width * image.height,
        "a picture has its pixels"
    );
    let side = |n| u32::try_from(n).expect("a side fits 32 bits");
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, side(image.width), side(image.height));
    encoder.set_color(colour);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_deflate_compression(DeflateCompression::Level(PRESSURE));
    encoder.set_filter(Filter::Adaptive);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let mut writer = encoder
        .write_header()
        .expect("a picture has at least one pixel");
    let memory = "writing to memory cannot fail";
    writer
        .write_image_data(&samples(image, colour))
        .expect(memory);
    writer.finish().expect(memory);
    file
}

/// The picture's samples, row by row.
fn samples(image: &Image, colour: ColorType) -> Vec<u8> {
    match colour {
        ColorType::Rgb => image
            .pixels
            .iter()
            .flat_map(|p| [p[0], p[1], p[2]])
            .collect(),
        _ => image.pixels.as_flattened().to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, PhotoLimits, decode_photo};

    /// A shaded disc on a clear or plain ground.
    fn disc(cx: f64, ground: [u8; 4]) -> Image {
        let (width, height) = (60, 40);
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f64 - cx, (i / width) as f64 - 20.0);
            let r = x.hypot(y);
            if r < 9.0 {
                [(200.0 - 9.0 * r) as u8, 90, 60, 255]
            } else {
                ground
            }
        };
        Image {
            width,
            height,
            pixels: (0..width * height).map(pixel).collect(),
        }
    }

    fn decode(bytes: Vec<u8>) -> Image {
        let input = Input {
            file: "ours.png".into(),
            bytes,
        };
        decode_photo(&input, &PhotoLimits::default()).expect("we read what we write")
    }

    #[test]
    fn a_png_reads_back_to_the_same_pixels() {
        for ground in [[0, 0, 0, 0], [250, 250, 252, 255]] {
            let image = disc(30.0, ground);
            assert_eq!(decode(png(&image)), image);
        }
    }

    #[test]
    fn alpha_is_left_out_when_nothing_is_transparent() {
        let kind = |ground| png(&disc(30.0, ground))[25];
        assert_eq!((kind([1, 2, 3, 255]), kind([1, 2, 3, 254])), (2, 6));
    }

    /// Plays an animation the way APNG 1.0 says, from decoded frames.
    fn play(file: &[u8]) -> Vec<Image> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(file))
            .read_info()
            .expect("a PNG");
        let info = reader.info();
        let (width, height) = (info.width as usize, info.height as usize);
        let n = info.animation_control.expect("animated").num_frames;
        let mut canvas = Image::filled(width, height, [0; 4]);
        let mut frames = Vec::new();
        for _ in 0..n {
            let mut buffer = vec![0; width * height * 4];
            let shape = reader.next_frame(&mut buffer).expect("a frame");
            let control = *reader.info().frame_control().expect("animated");
            let channels = shape.color_type.samples();
            for (i, p) in buffer[..shape.buffer_size()].chunks(channels).enumerate() {
                let x = i % shape.width as usize + control.x_offset as usize;
                let y = i / shape.width as usize + control.y_offset as usize;
                let over = control.blend_op == png::BlendOp::Over;
                if !over || p[3] > 0 {
                    canvas.pixels[y * width + x] = [p[0], p[1], p[2], p[3]];
                }
            }
            frames.push(canvas.clone());
        }
        frames
    }

    #[test]
    fn an_animation_plays_back_frame_by_frame() {
        for ground in [[0, 0, 0, 0], [250, 250, 252, 255]] {
            let frames: Vec<Image> = [20.0, 24.0, 24.0, 40.0].map(|x| disc(x, ground)).to_vec();
            let file = animated_png(&frames, 80);
            assert_eq!(play(&file), frames);
            assert_eq!(decode(file), frames[0]);
        }
    }

    #[test]
    fn a_frame_stores_only_what_changed() {
        let (a, b) = (disc(20.0, [0; 4]), disc(24.0, [0; 4]));
        assert_eq!(
            Window::of_change(&a, &b),
            Window {
                x: 12,
                y: 12,
                width: 21,
                height: 17
            }
        );
        assert_eq!(Window::of_change(&a, &a).width, 1);
    }
}
