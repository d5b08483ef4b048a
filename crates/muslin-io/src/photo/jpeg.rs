//! Walks a JPEG's markers (ITU T.81 annex B) to its end.

use super::cut;
use crate::error::{Fault, IoError, Place};

/// Most scans a progressive picture may have; encoders write about ten. A decoder goes over the
/// whole picture once a scan, so that a small file of thousands would keep it busy for hours.
const SCANS: usize = 100;

/// Width and height [pixels] of a JPEG that is whole: it has a frame, a scan and an end mark.
pub fn size(file: &str, bytes: &[u8]) -> Result<[u32; 2], IoError> {
    let (mut at, mut size, mut scans) = (2, None, 0);
    loop {
        let (marker, body) = marker(bytes, at).ok_or_else(|| no_end(file, bytes))?;
        at = body;
        match marker {
            0xd9 => break,
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let segment = segment(bytes, at).ok_or_else(|| no_end(file, bytes))?;
        at += 2 + segment.len();
        match marker {
            0xc4 | 0xc8 | 0xcc => {}
            0xc0..=0xcf => size = Some(frame(file, marker, segment, body)?),
            0xda => scans += 1,
            _ => {}
        }
        if scans > SCANS {
            return Err(too_many_scans(file, at));
        }
    }
    match size {
        Some(size) if scans > 0 => Ok(size),
        _ => Err(cut(file, at, "it ends before any pixels")),
    }
}

/// The next marker from `at` on, and where its body starts. Skips what no marker starts: the
/// compressed pixels of a scan, in which 0xFF is followed by 0 or a restart mark.
fn marker(bytes: &[u8], mut at: usize) -> Option<(u8, usize)> {
    loop {
        at += bytes.get(at..)?.iter().position(|&b| b == 0xff)?;
        match *bytes.get(at + 1)? {
            0x00 | 0xd0..=0xd7 => at += 2,
            0xff => at += 1,
            code => return Some((code, at + 2)),
        }
    }
}

/// The segment whose length stands at `at`, without the length.
fn segment(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = bytes.get(at..at + 2)?;
    let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
    bytes.get(at + 2..at + length.max(2))
}

/// Width and height from a frame header; only 8-bit Huffman-coded frames pass.
fn frame(file: &str, marker: u8, segment: &[u8], at: usize) -> Result<[u32; 2], IoError> {
    let &[depth, h1, h0, w1, w0, _, ..] = segment else {
        return Err(cut(file, at, "its frame header is too short"));
    };
    let coding = match marker {
        0xc0..=0xc2 if depth == 8 => {
            return Ok([[w1, w0], [h1, h0]].map(|x| u32::from(u16::from_be_bytes(x))));
        }
        0xc0..=0xc2 => format!("{depth} bits a channel"),
        0xc3 | 0xc7 | 0xcb | 0xcf => "lossless coding".to_owned(),
        0xc9 | 0xca => "arithmetic coding".to_owned(),
        _ => "hierarchical coding".to_owned(),
    };
    Err(Fault::new("photo-kind", file, "a JPEG of a rare kind")
        .at(Place::Byte(at as u64))
        .found(coding)
        .allowed("8 bits a channel, baseline or progressive")
        .hint("open it in a picture editor and save it as JPEG or PNG")
        .refused())
}

fn no_end(file: &str, bytes: &[u8]) -> IoError {
    cut(file, bytes.len(), "its end mark is missing")
}

fn too_many_scans(file: &str, at: usize) -> IoError {
    Fault::new("photo-kind", file, "the JPEG is built from too many scans")
        .at(Place::Byte(at as u64))
        .found(format!("more than {SCANS}"))
        .allowed(SCANS)
        .hint("open it in a picture editor and save it again")
        .refused()
}
