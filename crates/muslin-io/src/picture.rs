//! Pictures out: PNG, and animated PNG for a turntable.

use muslin_geom::Image;
use png::{BitDepth, BlendOp, ColorType, Compression, DisposeOp, Encoder, Filter, Writer};

/// `image` as a PNG, sRGB; the alpha channel is left out if nothing is transparent.
///
/// # Panics
/// If the image has no pixels or a pixel count other than its size says.
pub fn png(image: &Image) -> Vec<u8> {
    let colour = colour(std::slice::from_ref(image));
    let mut file = Vec::new();
    let mut writer = start(encoder(&mut file, image, colour));
    writer
        .write_image_data(&samples(image, Window::whole(image), colour))
        .expect(MEMORY);
    writer.finish().expect(MEMORY);
    file
}

/// `frames` as an animated PNG that runs for ever, each frame shown for `delay_ms` [ms].
///
/// Readers that know no animation show the first frame. Every later frame stores only the
/// window in which it differs from the one before.
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
    let colour = colour(frames);
    let mut file = Vec::new();
    let mut encoder = encoder(&mut file, first, colour);
    encoder
        .set_animated(frames.len() as u32, 0)
        .expect("there is a frame");
    encoder
        .set_frame_delay(delay_ms, 1000)
        .expect("the picture is animated");
    encoder
        .set_blend_op(BlendOp::Source)
        .expect("the picture is animated");
    encoder
        .set_dispose_op(DisposeOp::None)
        .expect("the picture is animated");
    let mut writer = start(encoder);
    for (i, frame) in frames.iter().enumerate() {
        let window = match i {
            0 => Window::whole(frame),
            _ => Window::of_change(&frames[i - 1], frame),
        };
        write_frame(&mut writer, frame, window, colour);
    }
    writer.finish().expect(MEMORY);
    file
}

/// Why writing cannot fail.
const MEMORY: &str = "writing to memory cannot fail";

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

/// Colour with or without alpha, whatever these pictures need.
fn colour(images: &[Image]) -> ColorType {
    let is_opaque = images.iter().all(|i| i.pixels.iter().all(|p| p[3] == 255));
    if is_opaque {
        ColorType::Rgb
    } else {
        ColorType::Rgba
    }
}

fn encoder<'a>(
    file: &'a mut Vec<u8>,
    image: &Image,
    colour: ColorType,
) -> Encoder<'a, &'a mut Vec<u8>> {
    assert_eq!(
        image.pixels.len(),
        image.width * image.height,
        "a picture has its pixels"
    );
    let side = |n| u32::try_from(n).expect("a side fits 32 bits");
    let mut encoder = Encoder::new(file, side(image.width), side(image.height));
    encoder.set_color(colour);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Balanced);
    encoder.set_filter(Filter::Adaptive);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder
}

fn start<'a>(encoder: Encoder<'a, &'a mut Vec<u8>>) -> Writer<&'a mut Vec<u8>> {
    encoder
        .write_header()
        .expect("a picture has at least one pixel")
}

fn write_frame(writer: &mut Writer<&mut Vec<u8>>, frame: &Image, w: Window, colour: ColorType) {
    let fits = "a window lies inside its frame";
    writer.reset_frame_position().expect(fits);
    writer
        .set_frame_dimension(w.width as u32, w.height as u32)
        .expect(fits);
    writer
        .set_frame_position(w.x as u32, w.y as u32)
        .expect(fits);
    writer
        .write_image_data(&samples(frame, w, colour))
        .expect(MEMORY);
}

/// The window's samples, row by row.
fn samples(image: &Image, w: Window, colour: ColorType) -> Vec<u8> {
    let channels = if colour == ColorType::Rgb { 3 } else { 4 };
    let mut out = Vec::with_capacity(w.width * w.height * channels);
    for row in image.pixels.chunks(image.width).skip(w.y).take(w.height) {
        for pixel in &row[w.x..w.x + w.width] {
            out.extend_from_slice(&pixel[..channels]);
        }
    }
    out
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
                canvas.pixels[y * width + x] = [p[0], p[1], p[2], *p.get(3).unwrap_or(&255)];
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
