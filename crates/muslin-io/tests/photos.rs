//! Photos of every kind we read, and what must happen to those we do not.

use std::path::PathBuf;

use muslin_geom::Image;
use muslin_io::{Input, IoError, PhotoLimits, decode_photo, flatten, read_photo};

/// The test picture: one colour a quarter, from the top left by rows.
const QUARTERS: [[u8; 3]; 4] = [[200, 30, 30], [30, 160, 40], [30, 40, 200], [240, 240, 240]];

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/files")
        .join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(file(name)).expect("the test pictures lie in the repository")
}

fn decode(bytes: &[u8]) -> Result<Image, IoError> {
    let input = Input {
        file: "some.file".into(),
        bytes: bytes.to_vec(),
    };
    decode_photo(&input, &PhotoLimits::default())
}

/// The colours in the middle of the four quarters.
fn quarters(image: &Image) -> [[u8; 4]; 4] {
    let (w, h) = (image.width, image.height);
    let at = |x: usize, y: usize| image.pixels[y * w + x];
    [
        at(w / 4, h / 4),
        at(3 * w / 4, h / 4),
        at(w / 4, 3 * h / 4),
        at(3 * w / 4, 3 * h / 4),
    ]
}

/// Every channel within `tolerance` of what was painted, and opaque.
fn assert_corners(image: &Image, tolerance: u8, name: &str) {
    assert_eq!(
        (image.width, image.height, image.pixels.len()),
        (48, 32, 48 * 32),
        "{name}"
    );
    for (got, want) in quarters(image).iter().zip(QUARTERS) {
        let near = got
            .iter()
            .zip(want)
            .all(|(&a, b)| a.abs_diff(b) <= tolerance);
        assert!(near && got[3] == 255, "{name}: {got:?} is not {want:?}");
    }
}

#[test]
fn every_kind_of_photo_shows_the_same_picture() {
    let cases = [
        ("corners.jpg", 4),
        ("corners-progressive.jpg", 4),
        ("corners-cmyk.jpg", 8),
        ("corners-lossy.webp", 12),
        ("corners.webp", 0),
        ("corners-palette.png", 4),
        ("corners-turned.png", 0),
        ("corners-turned.webp", 0),
    ];
    for (name, tolerance) in cases {
        let photo = read_photo(&file(name), &PhotoLimits::default());
        let photo = photo.unwrap_or_else(|e| panic!("{}", e.message()));
        assert_corners(&photo.image, tolerance, name);
        assert_eq!(photo.sha256.len(), 64);
    }
}

#[test]
fn grey_stays_grey() {
    let image = decode(&bytes("corners-grey.jpg")).expect("a grey JPEG is a photo");
    assert!(
        image
            .pixels
            .iter()
            .all(|p| p[0] == p[1] && p[1] == p[2] && p[3] == 255)
    );
}

/// `jpeg` with an EXIF block that holds nothing but this orientation.
fn with_orientation(jpeg: &[u8], orientation: u8) -> Vec<u8> {
    let mut exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0]);
    let length = (exif.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, &exif, &jpeg[2..]].concat()
}

#[test]
fn all_eight_exif_orientations_are_undone() {
    // Which quarter of the stored picture must come to each place (EXIF 2.32, tag 0x0112).
    let places = [
        [0, 1, 2, 3],
        [1, 0, 3, 2],
        [3, 2, 1, 0],
        [2, 3, 0, 1],
        [0, 2, 1, 3],
        [2, 0, 3, 1],
        [3, 1, 2, 0],
        [1, 3, 0, 2],
    ];
    let jpeg = bytes("corners.jpg");
    let stored = quarters(&decode(&jpeg).expect("the plain picture is whole"));
    for (i, want) in places.iter().enumerate() {
        let image = decode(&with_orientation(&jpeg, i as u8 + 1)).expect("EXIF breaks nothing");
        assert_eq!(
            quarters(&image),
            want.map(|q| stored[q]),
            "orientation {}",
            i + 1
        );
        assert_eq!(image.width > image.height, i < 4, "orientation {}", i + 1);
    }
    for nonsense in [0, 9, 255] {
        let image = decode(&with_orientation(&jpeg, nonsense)).expect("nonsense is ignored");
        assert_eq!(quarters(&image), stored);
    }
}

#[test]
fn sixteen_bits_become_eight_and_alpha_is_kept() {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 2, 1);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().expect("memory takes all");
    let row = [
        0xff, 0xff, 0x80, 0x80, 0, 0, 0xff, 0xff, 1, 1, 2, 2, 3, 3, 0, 0,
    ];
    writer.write_image_data(&row).expect("memory takes all");
    writer.finish().expect("memory takes all");
    let image = decode(&file).expect("16 bits are allowed");
    assert_eq!(image.pixels, [[255, 128, 0, 255], [1, 2, 3, 0]]);
    assert_eq!(
        flatten(&image, [9, 8, 7]).pixels,
        [[255, 128, 0, 255], [9, 8, 7, 255]]
    );
}

const WHOLE: [&str; 8] = [
    "corners.jpg",
    "corners-progressive.jpg",
    "corners-cmyk.jpg",
    "corners-lossy.webp",
    "corners.webp",
    "corners-palette.png",
    "corners-turned.png",
    "corners-turned.webp",
];

#[test]
fn a_cut_photo_is_told_from_a_whole_one_wherever_it_is_cut() {
    for name in WHOLE {
        let whole = bytes(name);
        for end in 0..whole.len() {
            let err = decode(&whole[..end]).err();
            let err = err.unwrap_or_else(|| panic!("{name} cut at {end} passed for whole"));
            assert!(
                [3, 4].contains(&err.exit_code()) && !err.hint().is_empty(),
                "{err}"
            );
        }
    }
}

#[test]
fn no_patched_byte_makes_a_decoder_panic() {
    for name in WHOLE {
        let whole = bytes(name);
        for at in 0..whole.len() {
            for value in [
                0,
                1,
                0x7f,
                0xff,
                whole[at].wrapping_add(1),
                whole[at] ^ 0x80,
            ] {
                let mut patched = whole.clone();
                patched[at] = value;
                if let Err(e) = decode(&patched) {
                    assert!(e.to_string().starts_with("some.file"), "{e}");
                }
            }
        }
    }
}

/// A PNG header that claims this size, with nothing behind it but an end.
fn huge_png(width: u32, height: u32) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[8, 6, 0, 0, 0],
    ]
    .concat();
    for (kind, body) in [(b"IHDR", header.as_slice()), (b"IEND", &[])] {
        let mut sum = flate2::Crc::new();
        sum.update(kind);
        sum.update(body);
        file.extend((body.len() as u32).to_be_bytes());
        file.extend_from_slice(&[kind, body].concat());
        file.extend(sum.sum().to_be_bytes());
    }
    file
}

#[test]
fn sizes_are_checked_before_anything_is_decoded() {
    let mut jpeg = bytes("corners.jpg");
    let frame = jpeg
        .windows(2)
        .position(|w| w == [0xff, 0xc0])
        .expect("a baseline frame");
    jpeg[frame + 5..frame + 9].fill(0xff);
    let cases = [
        jpeg,
        huge_png(20_000, 10),
        huge_png(10, 20_000),
        huge_png(16_000, 16_000),
        huge_png(u32::MAX, u32::MAX),
    ];
    for case in cases {
        let err = decode(&case).expect_err("it is far too large");
        assert_eq!((err.code(), err.exit_code()), ("photo-large", 4), "{err}");
    }
    let err = decode(&huge_png(0, 5)).expect_err("there is nothing to see");
    assert_eq!((err.code(), err.exit_code()), ("photo-damaged", 3), "{err}");
}

#[test]
fn a_file_over_the_limit_is_refused_unread() {
    let limits = PhotoLimits {
        bytes: 100,
        ..PhotoLimits::default()
    };
    let err = read_photo(&file("corners.jpg"), &limits)
        .err()
        .expect("it has more than 100 bytes");
    assert_eq!(err.code(), "file-large");
}

#[test]
fn strangers_are_called_by_their_name() {
    let cases: [(&[u8], &str); 5] = [
        (b"\0\0\0\x18ftypheic\0\0\0\0", "a HEIC picture"),
        (
            b"<svg xmlns='http://www.w3.org/2000/svg'/>",
            "an SVG drawing",
        ),
        (b"<!doctype html><title>photo</title>", "a web page"),
        (&bytes("corners.gif"), "a GIF picture"),
        (b"\0\x01\x02", "unknown kind"),
    ];
    for (bytes, kind) in cases {
        let err = decode(bytes).expect_err("none of these is a photo");
        assert_eq!(err.exit_code(), 4);
        assert!(err.to_string().contains(kind), "{err}");
    }
}

#[test]
fn a_picture_of_thousands_of_scans_is_refused() {
    let jpeg = bytes("corners-progressive.jpg");
    let scan = jpeg
        .windows(2)
        .position(|w| w == [0xff, 0xda])
        .expect("it has scans");
    let length = usize::from(jpeg[scan + 3]) + 2;
    let many = jpeg[scan..scan + length].repeat(5000);
    let err = decode(&[&jpeg[..scan], &many, &jpeg[scan..]].concat()).expect_err("5000 scans");
    assert_eq!((err.code(), err.exit_code()), ("photo-kind", 4), "{err}");
}

/// Files of other projects' test suites, kept outside the repository.
fn shared(below: &str) -> Vec<PathBuf> {
    let Some(root) = std::env::var_os("MUSLIN_DATA") else {
        println!("skipped: needs MUSLIN_DATA");
        return Vec::new();
    };
    let folder = std::fs::read_dir(PathBuf::from(root).join(below)).expect("the data are whole");
    folder.flatten().map(|e| e.path()).collect()
}

#[test]
fn photos_of_people_all_open() {
    for path in shared("photos") {
        let extension = path
            .extension()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if ["jpg", "png", "webp"].contains(&extension.as_str()) {
            let photo = read_photo(&path, &PhotoLimits::default());
            let photo = photo.unwrap_or_else(|e| panic!("{}", e.message()));
            assert!(
                photo.image.width.min(photo.image.height) > 100,
                "{}",
                photo.file
            );
        }
    }
}

#[test]
fn broken_pngs_of_the_suite_are_refused_by_place() {
    let fine = ["F-exif-chunk-early.png", "invalid_palette_index.png"];
    for path in shared("robustness/png") {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        match read_photo(&path, &PhotoLimits::default()) {
            Ok(_) => assert!(fine.contains(&name.as_str()), "{name} opened"),
            Err(e) => {
                assert!(!fine.contains(&name.as_str()), "{e}");
                assert_eq!(
                    e.exit_code(),
                    if name.starts_with("xs1") { 4 } else { 3 },
                    "{e}"
                );
                println!("{}", e.message());
            }
        }
    }
}
