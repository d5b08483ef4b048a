//! Whole numbers to bytes and back, as the files under `assets` are written.

use flate2::{Compression, Crc, read::DeflateDecoder, write::DeflateEncoder};
use std::io::{Read, Write};

/// What is wrong with bytes that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damaged(pub &'static str);

/// Bytes being written.
#[derive(Debug, Default)]
pub struct Writer {
    out: Vec<u8>,
}

impl Writer {
    /// Four bytes, the least significant first.
    pub fn number(&mut self, n: u32) {
        self.out.extend(n.to_le_bytes());
    }

    /// Names, none of which holds a line break.
    pub fn names<'a>(&mut self, names: impl Iterator<Item = &'a str>) {
        let text = names.collect::<Vec<_>>().join("\n");
        self.number(text.len() as u32);
        self.out.extend(text.bytes());
    }

    /// Numbers of either sign, small ones in few bytes: folded to `0, -1, 1, -2, …`, then all
    /// lowest bytes, all next ones, as far as the largest needs.
    pub fn ints(&mut self, ints: impl Iterator<Item = i32>) {
        let folded: Vec<u32> = ints.map(|i| ((i << 1) ^ (i >> 31)) as u32).collect();
        let most = folded.iter().copied().max().unwrap_or(0);
        let planes = (32 - most.leading_zeros()).div_ceil(8);
        self.number(folded.len() as u32);
        self.number(planes);
        for k in 0..planes {
            self.out.extend(folded.iter().map(|f| (f >> (8 * k)) as u8));
        }
    }

    /// Numbers that are near the one before.
    pub fn differences(&mut self, ints: impl Iterator<Item = i32>) {
        let mut before = 0;
        self.ints(ints.map(|i| {
            let d = i - before;
            before = i;
            d
        }));
    }
}

/// Bytes being read.
#[derive(Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

const SHORT: Damaged = Damaged("it ends early");

impl<'a> Reader<'a> {
    /// Reads these bytes.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// How many bytes are left.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Damaged> {
        let (head, rest) = self.rest.split_at_checked(n).ok_or(SHORT)?;
        self.rest = rest;
        Ok(head)
    }

    /// See [`Writer::number`].
    pub fn number(&mut self) -> Result<u32, Damaged> {
        let bytes = self.take(4)?.try_into().expect("four bytes were taken");
        Ok(u32::from_le_bytes(bytes))
    }

    /// See [`Writer::names`].
    pub fn names(&mut self) -> Result<Vec<String>, Damaged> {
        let n = self.number()? as usize;
        let text = std::str::from_utf8(self.take(n)?).map_err(|_| Damaged("a name"))?;
        Ok(text.split('\n').map(str::to_string).collect())
    }

    /// See [`Writer::ints`].
    pub fn ints(&mut self) -> Result<Vec<i32>, Damaged> {
        let (n, planes) = (self.number()? as usize, self.number()? as usize);
        // With no planes there are no bytes to bound the count by.
        if planes > 4 || n > 1 << 22 {
            return Err(Damaged("a count"));
        }
        let bytes = self.take(n.saturating_mul(planes))?;
        let mut folded = vec![0u32; n];
        for (k, plane) in bytes.chunks(n.max(1)).enumerate() {
            for (f, &b) in folded.iter_mut().zip(plane) {
                *f |= u32::from(b) << (8 * k);
            }
        }
        Ok(folded
            .into_iter()
            .map(|f| (f >> 1) as i32 ^ -((f & 1) as i32))
            .collect())
    }

    /// See [`Writer::differences`].
    pub fn differences(&mut self) -> Result<Vec<i32>, Damaged> {
        let mut ints = self.ints()?;
        let mut at = 0i32;
        for i in &mut ints {
            at = at.wrapping_add(*i);
            *i = at;
        }
        Ok(ints)
    }

    /// Nothing may be left over.
    pub fn finish(self) -> Result<(), Damaged> {
        if self.rest.is_empty() {
            Ok(())
        } else {
            Err(Damaged("it does not end"))
        }
    }
}

/// `magic`, version, length, checksum, and the deflate stream of what was written.
pub fn pack(magic: &[u8; 8], version: u32, w: Writer) -> Vec<u8> {
    let mut out = magic.to_vec();
    out.extend(version.to_le_bytes());
    out.extend((w.out.len() as u32).to_le_bytes());
    out.extend(checksum(&w.out).to_le_bytes());
    let mut deflate = DeflateEncoder::new(out, Compression::best());
    deflate.write_all(&w.out).expect("memory takes every byte");
    deflate.finish().expect("memory takes every byte")
}

/// What [`pack`] packed, if it is whole and not above `largest` bytes.
pub fn unpack(
    magic: &[u8; 8],
    version: u32,
    packed: &[u8],
    largest: usize,
) -> Result<Vec<u8>, Damaged> {
    let mut r = Reader::new(packed);
    if r.take(8)? != magic {
        return Err(Damaged("it is something else"));
    }
    if r.number()? != version {
        return Err(Damaged("another version"));
    }
    let n = r.number()? as usize;
    if n > largest {
        return Err(Damaged("too large"));
    }
    let wanted = r.number()?;
    let mut raw = Vec::with_capacity(n);
    // One byte more than is expected, so that a longer stream is noticed.
    let mut deflate = DeflateDecoder::new(r.rest).take(n as u64 + 1);
    deflate
        .read_to_end(&mut raw)
        .map_err(|_| Damaged("it does not unpack"))?;
    if raw.len() == n && checksum(&raw) == wanted {
        Ok(raw)
    } else {
        Err(Damaged("the checksum fails"))
    }
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_size_come_back() {
        let ints = [0, -1, 1, 127, -128, 300, -70_000, i32::MAX, i32::MIN];
        let mut w = Writer::default();
        w.ints(ints.into_iter());
        w.differences([5, 3, 3, 900].into_iter());
        w.names(["a", "b c"].into_iter());
        w.ints(std::iter::empty());
        let mut r = Reader::new(&w.out);
        assert_eq!(r.ints().expect("ints"), ints);
        assert_eq!(r.differences().expect("differences"), [5, 3, 3, 900]);
        assert_eq!(r.names().expect("names"), ["a", "b c"]);
        assert_eq!(r.ints().expect("none"), []);
        r.finish().expect("nothing is left");
    }

    #[test]
    fn a_flipped_bit_is_noticed() {
        let mut w = Writer::default();
        w.ints(0..1000);
        let packed = pack(b"12345678", 3, w);
        assert!(unpack(b"12345678", 3, &packed, 1 << 20).is_ok());
        assert!(unpack(b"12345678", 3, &packed, 100).is_err());
        for i in 0..packed.len() {
            let mut bad = packed.clone();
            bad[i] ^= 16;
            // Bits after the last block mean nothing; whatever unpacks must be what was packed.
            let whole = unpack(b"12345678", 3, &packed, 1 << 20);
            assert!(
                i + 1 == packed.len() || unpack(b"12345678", 3, &bad, 1 << 20) != whole,
                "byte {i}"
            );
        }
    }
}
