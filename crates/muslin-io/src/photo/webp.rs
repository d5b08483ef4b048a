//! Walks a WebP's chunks (RFC 9649) to its end.

use std::io::Cursor;

use image::ImageDecoder;
use image::codecs::webp::WebPDecoder;

use super::{cut, damaged};
use crate::error::IoError;

/// Width and height [pixels] of a WebP whose chunks are all there.
pub fn size(file: &str, bytes: &[u8]) -> Result<[u32; 2], IoError> {
    let ends = || cut(file, bytes.len(), "its last chunk is not whole");
    let declared = length(bytes, 4).ok_or_else(ends)?;
    let riff = bytes
        .get(8..declared.checked_add(8).ok_or_else(ends)?)
        .ok_or_else(ends)?;
    let mut at = 4;
    while at < riff.len() {
        let body = length(riff, at + 4).ok_or_else(ends)?;
        at = body
            .checked_add(at + 8)
            .filter(|&end| end <= riff.len())
            .ok_or_else(ends)?;
        at += body % 2;
    }
    let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(|e| damaged(file, &e))?;
    Ok(decoder.dimensions().into())
}

/// The chunk length that stands at `at`.
fn length(bytes: &[u8], at: usize) -> Option<usize> {
    let word = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes([word[0], word[1], word[2], word[3]]) as usize)
}
