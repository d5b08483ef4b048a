//! What a file really is, whatever its name says.

/// A kind of file, told from its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// JPEG picture.
    Jpeg,
    /// PNG picture, moving or not.
    Png,
    /// WebP picture, moving or not.
    WebP,
    /// Known, but not a photo we read; the words name it in a message.
    Other(&'static str),
    /// Nothing we know.
    Unknown,
}

/// Signatures at fixed offsets: offset, bytes, name.
const SIGNATURES: &[(usize, &[u8], &str)] = &[
    (0, b"GIF8", "a GIF picture"),
    (0, b"BM", "a BMP picture"),
    (0, b"II*\0", "a TIFF or raw camera picture"),
    (0, b"MM\0*", "a TIFF or raw camera picture"),
    (0, b"\xff\x0a", "a JPEG XL picture"),
    (0, b"\0\0\0\x0cJXL ", "a JPEG XL picture"),
    (0, b"\0\0\0\x0cjP  ", "a JPEG 2000 picture"),
    (0, b"8BPS", "a Photoshop document"),
    (0, b"\0\0\x01\0", "an icon"),
    (0, b"v/1\x01", "an OpenEXR picture"),
    (0, b"#?RADIANCE", "a Radiance picture"),
    (0, b"%PDF", "a PDF document"),
    (0, b"glTF", "a GLB model"),
    (0, b"PK\x03\x04", "a ZIP archive or office document"),
    (0, b"\x1f\x8b", "a gzip archive"),
    (0, b"7z\xbc\xaf", "a 7-Zip archive"),
    (0, b"\x7fELF", "a program"),
    (0, b"MZ", "a program"),
    (0, b"\x1aE\xdf\xa3", "a Matroska or WebM video"),
    (0, b"RIFF", "a WAV sound or AVI video"),
    (0, b"OggS", "an Ogg sound or video"),
    (0, b"ID3", "an MP3 sound"),
    (4, b"TFL3", "a TensorFlow Lite model"),
    (0, b"\x93NUMPY", "a NumPy array"),
    (0, b"Kaydara FBX Binary", "an FBX model"),
    (0, b"HIERARCHY", "a BVH motion"),
];

/// Whether it is an FBX model, binary or text.
pub fn is_fbx(bytes: &[u8]) -> bool {
    bytes.starts_with(b"Kaydara FBX") || bytes.starts_with(b"; FBX")
}

/// Names the kind of `bytes`; the first 512 suffice.
pub fn sniff(bytes: &[u8]) -> Kind {
    let starts = |at: usize, want: &[u8]| bytes.get(at..at + want.len()) == Some(want);
    if starts(0, &[0xff, 0xd8, 0xff]) {
        return Kind::Jpeg;
    }
    if starts(0, b"\x89PNG\r\n\x1a\n") {
        return Kind::Png;
    }
    if starts(0, b"RIFF") && starts(8, b"WEBP") {
        return Kind::WebP;
    }
    if starts(4, b"ftyp") {
        return Kind::Other(brand(bytes.get(8..12).unwrap_or_default()));
    }
    match SIGNATURES.iter().find(|(at, want, _)| starts(*at, want)) {
        Some((_, _, name)) => Kind::Other(name),
        None => text(bytes),
    }
}

/// The ISO media family: phones' photos and videos share one container.
fn brand(brand: &[u8]) -> &'static str {
    match brand {
        b"heic" | b"heix" | b"hevc" | b"hevx" | b"heim" | b"heis" | b"mif1" | b"msf1" => {
            "a HEIC picture"
        }
        b"avif" | b"avis" => "an AVIF picture",
        b"crx " => "a raw camera picture",
        _ => "a video",
    }
}

/// Kinds of text, told from the first tag.
fn text(bytes: &[u8]) -> Kind {
    let head = &bytes[..bytes.len().min(512)];
    let head = String::from_utf8_lossy(head).to_lowercase();
    let head = head.trim_start_matches('\u{feff}').trim_start();
    if head.contains("<svg") {
        return Kind::Other("an SVG drawing");
    }
    if head.contains("<html") || head.starts_with("<!doctype html") {
        return Kind::Other("a web page");
    }
    if head.starts_with("<?xml") {
        return Kind::Other("an XML document");
    }
    if head.starts_with("version https://git-lfs") {
        return Kind::Other("a Git LFS pointer, not the file itself");
    }
    let plain = |c: char| !c.is_control() && c != '\u{fffd}' || c.is_whitespace();
    let is_text = !head.is_empty() && head.chars().all(plain);
    if is_text {
        Kind::Other("text")
    } else {
        Kind::Unknown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_what_people_bring_instead_of_photos() {
        let cases: &[(&[u8], Kind)] = &[
            (b"\0\0\0\x18ftypheic", Kind::Other("a HEIC picture")),
            (b"\0\0\0\x18ftypavif", Kind::Other("an AVIF picture")),
            (b"\0\0\0\x18ftypisom", Kind::Other("a video")),
            (
                b"<?xml version='1.0'?><svg/>",
                Kind::Other("an SVG drawing"),
            ),
            (b"\n<!DOCTYPE HTML><p>", Kind::Other("a web page")),
            (b"GIF89a", Kind::Other("a GIF picture")),
            (b"%PDF-1.7", Kind::Other("a PDF document")),
            (b"hello there", Kind::Other("text")),
            (b"RIFF\0\0\0\0WEBPVP8 ", Kind::WebP),
            (b"RIFF\0\0\0\0WAVE", Kind::Other("a WAV sound or AVI video")),
            (b"\x89PNG\r\n\x1a\n", Kind::Png),
            (b"\xff\xd8\xff\xe0", Kind::Jpeg),
            (b"\0\x01\x02\x03", Kind::Unknown),
            (b"", Kind::Unknown),
        ];
        for (bytes, want) in cases {
            assert_eq!(sniff(bytes), *want, "{bytes:?}");
        }
    }
}
