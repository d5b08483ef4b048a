//! Walks a PNG's chunks (ISO/IEC 15948) to its end and checks their sums.

use flate2::Crc;

use super::{COPY, cut};
use crate::error::{Fault, IoError, Place};

/// Width and height [pixels] of a PNG that is whole: header first, end chunk last, and every
/// chunk that a picture needs with a right check sum.
pub fn size(file: &str, bytes: &[u8]) -> Result<[u32; 2], IoError> {
    let (mut at, mut size) = (8, None);
    loop {
        let (kind, body) = chunk(file, bytes, at)?;
        match (&kind, size) {
            (b"IHDR", None) => size = Some(header(file, body, at)?),
            (b"IHDR", Some(_)) => return Err(damaged(file, at, "a second header")),
            (_, None) => return Err(damaged(file, at, "another chunk before the header")),
            (b"IEND", Some(size)) => return Ok(size),
            _ => {}
        }
        at += 12 + body.len();
    }
}

/// Kind and body of the chunk at `at`.
fn chunk<'a>(file: &str, bytes: &'a [u8], at: usize) -> Result<([u8; 4], &'a [u8]), IoError> {
    let ends = || cut(file, bytes.len(), "its end chunk is missing");
    let word = |at: usize| {
        let word = bytes.get(at..at.checked_add(4)?)?;
        Some([word[0], word[1], word[2], word[3]])
    };
    let length = u32::from_be_bytes(word(at).ok_or_else(ends)?) as usize;
    let kind = word(at + 4).ok_or_else(ends)?;
    let end = length.checked_add(at + 8).ok_or_else(ends)?;
    let body = bytes.get(at + 8..end).ok_or_else(ends)?;
    let stored = u32::from_be_bytes(word(end).ok_or_else(ends)?);
    let is_needed = kind[0].is_ascii_uppercase();
    let mut sum = Crc::new();
    sum.update(&bytes[at + 4..end]);
    if is_needed && sum.sum() != stored {
        let name: String = kind.iter().map(|&b| char::from(b)).collect();
        return Err(damaged(
            file,
            at,
            &format!("chunk {name} with a wrong check sum"),
        ));
    }
    Ok((kind, body))
}

/// Width and height from the header chunk at `at`.
fn header(file: &str, body: &[u8], at: usize) -> Result<[u32; 2], IoError> {
    let &[w3, w2, w1, w0, h3, h2, h1, h0, ..] = body else {
        return Err(damaged(file, at, "a header that is too short"));
    };
    Ok([[w3, w2, w1, w0], [h3, h2, h1, h0]].map(u32::from_be_bytes))
}

fn damaged(file: &str, at: usize, found: &str) -> IoError {
    Fault::new("photo-damaged", file, "the picture is damaged")
        .at(Place::Byte(at as u64))
        .found(found)
        .hint(COPY)
        .invalid()
}
