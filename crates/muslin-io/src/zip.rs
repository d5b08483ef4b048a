//! Just enough of ZIP: the list at the end of the archive, stored and deflated members.
//!
//! APPNOTE 6.3.10. Sizes are taken from the list and proved by unpacking; sums are checked.

use std::io::Read;

use flate2::Crc;
use flate2::read::DeflateDecoder;

use crate::error::{Fault, IoError};

/// What an archive begins with that has members.
pub const MAGIC: &[u8] = b"PK\x03\x04";
/// More members are refused.
const MAX_MEMBERS: usize = 4096;

/// What is wrong with an archive.
pub enum Bad {
    /// It breaks its format, as the words say.
    Broken(String),
    /// It has too much of something: of what, and how much is allowed.
    Large(&'static str, String),
}

impl Bad {
    /// As an error: too much is refused, all else is invalid.
    pub fn told(self, fault: impl FnOnce(String) -> Fault) -> IoError {
        match self {
            Self::Broken(what) => fault(what).invalid(),
            Self::Large(what, allowed) => fault(what.into()).allowed(allowed).refused(),
        }
    }
}

impl From<String> for Bad {
    fn from(what: String) -> Self {
        Self::Broken(what)
    }
}

impl From<&str> for Bad {
    fn from(what: &str) -> Self {
        Self::Broken(what.into())
    }
}

/// A member as the archive's list tells it.
pub struct Member {
    /// Its name.
    pub name: String,
    /// Its size when unpacked [bytes].
    pub size: u64,
    packed: u64,
    offset: u64,
    method: u16,
    crc: u32,
}

fn number(bytes: &[u8], at: usize, wide: usize) -> Result<u64, String> {
    let end = at.checked_add(wide).ok_or("cut short")?;
    let field = bytes.get(at..end).ok_or("the archive is cut short")?;
    Ok(field.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b)))
}

fn place(n: u64) -> Result<usize, String> {
    usize::try_from(n).map_err(|_| "an offset is out of range".into())
}

/// All members in the order of the list.
pub fn members(bytes: &[u8]) -> Result<Vec<Member>, Bad> {
    let end = end_of_list(bytes)?;
    let (mut count, mut at) = (number(bytes, end + 10, 2)?, number(bytes, end + 16, 4)?);
    let is_large = count == 0xffff || at == 0xffff_ffff;
    if is_large && end >= 20 && bytes[end - 20..].starts_with(b"PK\x06\x07") {
        let far = place(number(bytes, end - 12, 8)?)?;
        if number(bytes, far, 4)? != 0x0606_4b50 {
            return Err("its 64-bit end is not where it says".into());
        }
        (count, at) = (
            number(bytes, far.saturating_add(32), 8)?,
            number(bytes, far.saturating_add(48), 8)?,
        );
    }
    if count > MAX_MEMBERS as u64 {
        return Err(Bad::Large("too many members", MAX_MEMBERS.to_string()));
    }
    let mut at = place(at)?;
    let mut out = Vec::new();
    for _ in 0..count {
        let (member, next) = listed(bytes, at)?;
        out.push(member);
        at = next;
    }
    Ok(out)
}

/// Where the end record starts: the last one whose comment reaches the end of the file.
fn end_of_list(bytes: &[u8]) -> Result<usize, String> {
    let last = bytes.len().checked_sub(22).ok_or("not a ZIP archive")?;
    let first = last.saturating_sub(65_535);
    let is_end = |&at: &usize| bytes[at..].starts_with(b"PK\x05\x06");
    let found = (first..=last).rev().find(is_end);
    found.ok_or_else(|| "not a whole ZIP archive: its list of members is missing".into())
}

/// The member listed at `at`, and where the next one is.
fn listed(bytes: &[u8], at: usize) -> Result<(Member, usize), String> {
    let field = |offset: usize, wide: usize| number(bytes, at.saturating_add(offset), wide);
    if field(0, 4)? != 0x0201_4b50 {
        return Err("its list of members is damaged".into());
    }
    if field(8, 2)? & 1 != 0 {
        return Err("a member is encrypted".into());
    }
    let [name, extra, comment] = [28, 30, 32].map(|o| field(o, 2).map(|n| n as usize));
    let (name, extra, comment) = (name?, extra?, comment?);
    let text = bytes.get(at + 46..at + 46 + name).ok_or("cut short")?;
    let mut member = Member {
        name: String::from_utf8_lossy(text).into_owned(),
        method: field(10, 2)? as u16,
        crc: field(16, 4)? as u32,
        packed: field(20, 4)?,
        size: field(24, 4)?,
        offset: field(42, 4)?,
    };
    let extras = bytes
        .get(at + 46 + name..at + 46 + name + extra)
        .ok_or("cut short")?;
    widen(&mut member, extras)?;
    Ok((member, at + 46 + name + extra + comment))
}

/// Takes 64-bit sizes and offsets from a member's extra fields.
fn widen(member: &mut Member, mut extras: &[u8]) -> Result<(), String> {
    while extras.len() >= 4 {
        let (tag, size) = (number(extras, 0, 2)?, number(extras, 2, 2)? as usize);
        let body = extras
            .get(4..4 + size)
            .ok_or("a member's extra field is cut short")?;
        if tag == 1 {
            let mut at = 0;
            for value in [&mut member.size, &mut member.packed, &mut member.offset] {
                if *value == 0xffff_ffff {
                    *value = number(body, at, 8)?;
                    at += 8;
                }
            }
        }
        extras = &extras[4 + size..];
    }
    Ok(())
}

/// The unpacked bytes of a member.
pub fn unpack(bytes: &[u8], member: &Member) -> Result<Vec<u8>, String> {
    let at = place(member.offset)?;
    if number(bytes, at, 4)? != 0x0403_4b50 {
        return Err("it is not where the list says".into());
    }
    let (name, extra) = (
        number(bytes, at + 26, 2)? as usize,
        number(bytes, at + 28, 2)? as usize,
    );
    let start = at + 30 + name + extra;
    let end = start
        .checked_add(place(member.packed)?)
        .ok_or("cut short")?;
    let packed = bytes.get(start..end).ok_or("it is cut short")?;
    let data = match member.method {
        0 => packed.to_vec(),
        8 => inflate(packed, member.size)?,
        m => {
            return Err(format!(
                "packed by method {m}, which is not known (stored and deflated are)"
            ));
        }
    };
    if data.len() as u64 != member.size {
        return Err(format!(
            "{} bytes expected, {} found",
            member.size,
            data.len()
        ));
    }
    let mut crc = Crc::new();
    crc.update(&data);
    match crc.sum() == member.crc {
        true => Ok(data),
        false => Err("its checksum is wrong".into()),
    }
}

/// Unpacks until one byte more than promised: memory follows the data, not the claim.
fn inflate(packed: &[u8], size: u64) -> Result<Vec<u8>, String> {
    let mut data = Vec::new();
    let mut reader = DeflateDecoder::new(packed).take(size.saturating_add(1));
    reader
        .read_to_end(&mut data)
        .map_err(|e| format!("it cannot be unpacked: {e}"))?;
    Ok(data)
}

/// An archive in the making, all members stored.
#[derive(Default)]
pub struct Writer {
    bytes: Vec<u8>,
    list: Vec<u8>,
    count: u16,
}

impl Writer {
    /// Adds a member.
    pub fn add(&mut self, name: &str, data: &[u8]) -> Result<(), &'static str> {
        let offset = u32::try_from(self.bytes.len()).map_err(|_| "more than 4 GiB")?;
        let size = u32::try_from(data.len()).map_err(|_| "more than 4 GiB")?;
        let mut crc = Crc::new();
        crc.update(data);
        // Version 2.0, no flags, stored, midnight on 1 January 1980.
        let mut common = [20u16, 0, 0, 0, 0x21].map(u16::to_le_bytes).concat();
        common.extend([crc.sum(), size, size].map(u32::to_le_bytes).concat());
        common.extend([name.len() as u16, 0].map(u16::to_le_bytes).concat());
        self.bytes.extend(MAGIC);
        self.bytes.extend(&common);
        self.bytes.extend(name.bytes());
        self.bytes.extend(data);
        self.list.extend(b"PK\x01\x02\x14\0");
        self.list.extend(&common);
        // No comment, first disk, no attributes.
        self.list.extend([0; 10]);
        self.list.extend(offset.to_le_bytes());
        self.list.extend(name.bytes());
        self.count += 1;
        Ok(())
    }

    /// The whole archive.
    pub fn finish(mut self) -> Vec<u8> {
        let (at, size) = (self.bytes.len() as u32, self.list.len() as u32);
        self.bytes.extend(&self.list);
        self.bytes.extend(b"PK\x05\x06\0\0\0\0");
        self.bytes
            .extend([self.count, self.count].map(u16::to_le_bytes).concat());
        self.bytes.extend([size, at].map(u32::to_le_bytes).concat());
        self.bytes.extend([0, 0]);
        self.bytes
    }
}
