//! Photos in: JPEG, PNG and WebP become an upright [`Image`]; all else about them is dropped.
//!
//! The container is walked first, by code of our own that allocates nothing: it finds the size,
//! so that limits hold before anything is decoded, and the end, so that a cut file is told from
//! a whole one. The decoders below would fill the missing part with grey.

mod jpeg;
mod png;
mod webp;

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use image::codecs::{jpeg::JpegDecoder, png::PngDecoder, webp::WebPDecoder};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, Limits};
use muslin_geom::Image;

use crate::error::{Fault, IoError, Place};
use crate::input::{Input, read_file};
use crate::sniff::{Kind, sniff};

/// What to do about a damaged copy.
const COPY: &str = "open it in a picture viewer; if it is damaged there too, copy it again";

/// What a photo may cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotoLimits {
    /// Largest file [bytes].
    pub bytes: u64,
    /// Most pixels.
    pub pixels: u64,
    /// Longest side [pixels].
    pub side: u32,
}

impl Default for PhotoLimits {
    /// 40 MiB, 64 million pixels, 16,384 pixels a side: a phone's photo of 50 million pixels is no more.
    fn default() -> Self {
        Self {
            bytes: 40 << 20,
            pixels: 64_000_000,
            side: 16_384,
        }
    }
}

/// A photo as a job takes it.
#[derive(Clone, PartialEq, Eq)]
pub struct Photo {
    /// The file as the user named it.
    pub file: String,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
    /// The upright picture, straight alpha.
    pub image: Image,
}

/// Reads the photo at `path`.
pub fn read_photo(path: &Path, limits: &PhotoLimits) -> Result<Photo, IoError> {
    let input = read_file(path, limits.bytes)?;
    let image = decode_photo(&input, limits)?;
    Ok(Photo {
        sha256: input.sha256(),
        file: input.file,
        image,
    })
}

/// Decodes a photo: upright by its EXIF orientation, 8-bit sRGB with straight alpha.
///
/// Grey, palette and 16-bit pictures are converted, CMYK too; of a moving picture the first
/// frame is taken. Colour profiles are ignored.
pub fn decode_photo(input: &Input, limits: &PhotoLimits) -> Result<Image, IoError> {
    let (file, bytes) = (input.file.as_str(), input.bytes.as_slice());
    let size = match sniff(bytes) {
        Kind::Jpeg => jpeg::size(file, bytes)?,
        Kind::Png => png::size(file, bytes)?,
        Kind::WebP => webp::size(file, bytes)?,
        Kind::Other(kind) => return Err(other_kind(file, kind)),
        Kind::Unknown => return Err(other_kind(file, "a file of unknown kind")),
    };
    within(file, size, limits)?;
    let cursor = Cursor::new(bytes);
    match sniff(bytes) {
        Kind::Jpeg => decode(file, JpegDecoder::new(cursor), limits),
        Kind::Png => decode(
            file,
            PngDecoder::with_limits(cursor, budget(limits)),
            limits,
        ),
        _ => decode(file, WebPDecoder::new(cursor), limits),
    }
}

/// Lays a picture with straight alpha over one colour, so that it hides nothing any more.
///
/// What stands behind a transparent pixel is arbitrary; a detector must not see it. A picture that
/// hides nothing is lent as it is.
pub fn flatten(image: &Image, background: [u8; 3]) -> Cow<'_, Image> {
    if image.pixels.iter().all(|p| p[3] == 255) {
        return Cow::Borrowed(image);
    }
    let over = |&[r, g, b, a]: &[u8; 4]| {
        let mix = |c: u8, back: u8| {
            let sum = u32::from(c) * u32::from(a) + u32::from(back) * (255 - u32::from(a));
            ((sum + 127) / 255) as u8
        };
        [
            mix(r, background[0]),
            mix(g, background[1]),
            mix(b, background[2]),
            255,
        ]
    };
    Cow::Owned(Image {
        pixels: image.pixels.iter().map(over).collect(),
        ..*image
    })
}

/// Checks a size [pixels] against the limits.
fn within(file: &str, [width, height]: [u32; 2], limits: &PhotoLimits) -> Result<(), IoError> {
    if width == 0 || height == 0 {
        let fault = Fault::new("photo-damaged", file, "the picture has no pixels");
        return Err(fault
            .found(format!("{width} x {height}"))
            .hint(COPY)
            .invalid());
    }
    let pixels = u64::from(width) * u64::from(height);
    if pixels <= limits.pixels && width.max(height) <= limits.side {
        return Ok(());
    }
    Err(
        Fault::new("photo-large", file, "the picture has too many pixels")
            .found(format!(
                "{width} x {height}, {:.1} million",
                pixels as f64 / 1e6
            ))
            .allowed(format!(
                "{:.0} million, {} a side",
                limits.pixels as f64 / 1e6,
                limits.side
            ))
            .hint("scale it down; 2000 pixels along the longer side are plenty")
            .refused(),
    )
}

/// What a decoder may allocate: eight bytes a pixel and something for its tables.
fn budget(limits: &PhotoLimits) -> Limits {
    let mut budget = Limits::default();
    budget.max_image_width = Some(limits.side);
    budget.max_image_height = Some(limits.side);
    budget.max_alloc = Some(limits.pixels * 8 + (64 << 20));
    budget
}

/// Decodes the pixels once the container has passed.
fn decode(
    file: &str,
    decoder: Result<impl ImageDecoder, ImageError>,
    limits: &PhotoLimits,
) -> Result<Image, IoError> {
    let damaged = |e: ImageError| damaged(file, &e);
    let mut decoder = decoder.map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    within(file, [width, height], limits)?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut picture = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    picture.apply_orientation(orientation);
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let pixels = match picture {
        // What most photos are, without a copy in between.
        DynamicImage::ImageRgb8(rgb) => {
            let rgb = rgb.as_chunks::<3>().0.iter();
            rgb.map(|&[r, g, b]| [r, g, b, 255]).collect()
        }
        other => other.into_rgba8().as_chunks::<4>().0.to_vec(),
    };
    Ok(Image {
        width,
        height,
        pixels,
    })
}

fn damaged(file: &str, err: &ImageError) -> IoError {
    match err {
        ImageError::Limits(_) => {
            Fault::new("photo-large", file, "the picture needs too much memory")
                .found(err)
                .hint("scale it down; 2000 pixels along the longer side are plenty")
                .refused()
        }
        ImageError::Unsupported(_) => Fault::new("photo-kind", file, "a picture of a rare kind")
            .found(err)
            .hint("open it in a picture editor and save it as JPEG or PNG")
            .refused(),
        _ => Fault::new("photo-damaged", file, "the picture is damaged")
            .found(err)
            .hint(COPY)
            .invalid(),
    }
}

/// The file ends at `at` though more should come.
fn cut(file: &str, at: usize, what: &str) -> IoError {
    Fault::new("photo-cut", file, format!("the picture is cut off: {what}"))
        .at(Place::Byte(at as u64))
        .hint(COPY)
        .invalid()
}

fn other_kind(file: &str, kind: &str) -> IoError {
    let hint = match kind {
        "a HEIC picture" => {
            "save it as JPEG: share it by mail, or set the phone's camera to 'most compatible'"
        }
        "a video" => "save one frame of it as JPEG or PNG",
        _ => "give a JPEG, PNG or WebP picture",
    };
    Fault::new("photo-kind", file, "this is not a photo we can read")
        .at(Place::Byte(0))
        .found(kind)
        .allowed("JPEG, PNG or WebP")
        .hint(hint)
        .refused()
}
