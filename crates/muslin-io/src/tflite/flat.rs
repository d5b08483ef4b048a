//! FlatBuffers, read with every offset checked.
//!
//! A table knows its fields through a list of offsets (the vtable) that lies elsewhere in the
//! file. Nothing here trusts either.

use super::TfliteError;

type Read<T> = Result<T, TfliteError>;

/// A table inside a file.
#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    file: &'a [u8],
    at: usize,
    size: usize,
    vtable: &'a [u8],
}

/// A vector of elements of a fixed size.
#[derive(Clone, Copy)]
struct Vector<'a> {
    at: usize,
    bytes: &'a [u8],
}

impl<'a> Table<'a> {
    /// The outermost table of a file that carries the identifier `ident`.
    pub(super) fn root(file: &'a [u8], ident: [u8; 4]) -> Read<Self> {
        match file.get(4..8) {
            Some(found) if found == ident => Self::new(file, offset(file, 0)?),
            _ => Err(TfliteError::new(
                4,
                format!("not marked {:?}", String::from_utf8_lossy(&ident)),
            )),
        }
    }

    fn new(file: &'a [u8], at: usize) -> Read<Self> {
        let back = i32::from_le_bytes(array(file, at)?);
        let start = i64::try_from(at)
            .ok()
            .and_then(|a| usize::try_from(a - i64::from(back)).ok());
        let start = start.ok_or_else(|| TfliteError::new(at, "a vtable outside the file"))?;
        let len = usize::from(u16::from_le_bytes(array(file, start)?));
        let size = usize::from(u16::from_le_bytes(array(file, start + 2)?));
        let vtable = file.get(start..start + len).filter(|v| v.len() >= 4);
        let whole = at.checked_add(size).is_some_and(|end| end <= file.len());
        match vtable {
            Some(vtable) if whole && size >= 4 => Ok(Self {
                file,
                at,
                size,
                vtable,
            }),
            _ => Err(TfliteError::new(
                start,
                format!("a vtable of {len} bytes for {size}"),
            )),
        }
    }

    /// Where the table lies.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// Where field `i` lies, if it is there; it is `width` bytes.
    fn field(&self, i: usize, width: usize) -> Read<Option<usize>> {
        let Some(slot) = self.vtable.get(4 + 2 * i..6 + 2 * i) else {
            return Ok(None);
        };
        match usize::from(u16::from_le_bytes([slot[0], slot[1]])) {
            0 => Ok(None),
            o if o >= 4 && o + width <= self.size => Ok(Some(self.at + o)),
            o => Err(TfliteError::new(
                self.at,
                format!("field {i} at {o} of {}", self.size),
            )),
        }
    }

    pub(super) fn u8(&self, i: usize, default: u8) -> Read<u8> {
        Ok(self.field(i, 1)?.map_or(default, |at| self.file[at]))
    }

    pub(super) fn u32(&self, i: usize, default: u32) -> Read<u32> {
        let at = self.field(i, 4)?;
        at.map_or(Ok(default), |at| {
            Ok(u32::from_le_bytes(array(self.file, at)?))
        })
    }

    pub(super) fn i32(&self, i: usize, default: i32) -> Read<i32> {
        Ok(self.u32(i, default.cast_unsigned())?.cast_signed())
    }

    pub(super) fn table(&self, i: usize) -> Read<Option<Self>> {
        let at = self.field(i, 4)?;
        at.map(|at| Self::new(self.file, offset(self.file, at)?))
            .transpose()
    }

    fn vector(&self, i: usize, width: usize) -> Read<Option<Vector<'a>>> {
        let Some(at) = self.field(i, 4)? else {
            return Ok(None);
        };
        let at = offset(self.file, at)?;
        let len = u32::from_le_bytes(array(self.file, at)?) as usize;
        let end = len.checked_mul(width).and_then(|n| n.checked_add(at + 4));
        match end.and_then(|end| self.file.get(at + 4..end)) {
            Some(bytes) => Ok(Some(Vector { at: at + 4, bytes })),
            None => Err(TfliteError::new(
                at,
                format!("{len} elements reach beyond the file"),
            )),
        }
    }

    /// A vector of bytes.
    pub(super) fn bytes(&self, i: usize) -> Read<Option<&'a [u8]>> {
        Ok(self.vector(i, 1)?.map(|v| v.bytes))
    }

    /// A vector of 16-bit numbers.
    pub(super) fn u16s(&self, i: usize) -> Read<Vec<u16>> {
        let vector = self.vector(i, 2)?;
        let bytes = vector.map_or(&[][..], |v| v.bytes);
        Ok(bytes
            .as_chunks()
            .0
            .iter()
            .map(|b| u16::from_le_bytes(*b))
            .collect())
    }

    /// A vector of at most `most` numbers; empty if absent.
    pub(super) fn i32s(&self, i: usize, most: usize) -> Read<Vec<i32>> {
        match self.vector(i, 4)? {
            Some(v) if v.bytes.len() > most.saturating_mul(4) => Err(v.too_long(4, most)),
            Some(v) => Ok(v
                .bytes
                .as_chunks()
                .0
                .iter()
                .map(|b| i32::from_le_bytes(*b))
                .collect()),
            None => Ok(Vec::new()),
        }
    }

    /// A vector of at most `most` tables; empty if absent.
    pub(super) fn tables(&self, i: usize, most: usize) -> Read<Vec<Self>> {
        let Some(v) = self.vector(i, 4)? else {
            return Ok(Vec::new());
        };
        if v.bytes.len() > most * 4 {
            return Err(v.too_long(4, most));
        }
        let one = |k| Self::new(self.file, offset(self.file, v.at + 4 * k)?);
        (0..v.bytes.len() / 4).map(one).collect()
    }
}

impl Vector<'_> {
    fn too_long(&self, width: usize, most: usize) -> TfliteError {
        let n = self.bytes.len() / width;
        TfliteError::new(self.at, format!("{n} elements, more than the {most} taken"))
    }
}

fn array<const N: usize>(file: &[u8], at: usize) -> Read<[u8; N]> {
    let found = file.get(at..).and_then(|rest| rest.first_chunk());
    found
        .copied()
        .ok_or_else(|| TfliteError::new(at, "the file ends here"))
}

/// The place that the offset at `at` points to.
fn offset(file: &[u8], at: usize) -> Read<usize> {
    Ok(at + u32::from_le_bytes(array(file, at)?) as usize)
}
