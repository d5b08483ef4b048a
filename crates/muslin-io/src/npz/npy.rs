//! One array: a line of Python that tells type, order and shape, then the values.
//!
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use std::borrow::Cow;

use half::f16;

use super::{Array, Values};
use crate::zip::Bad;

const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// What the header tells.
struct Header<'a> {
    descr: &'a str,
    fortran: bool,
    shape: Vec<usize>,
}

/// Reads an array from the bytes of a `.npy` file; takes what it needs from `memory` [bytes].
pub fn read(bytes: &[u8], memory: &mut usize) -> Result<Array, Bad> {
    if bytes.get(..6) != Some(MAGIC) {
        return Err("not a NumPy array".into());
    }
    let version = *bytes.get(6).ok_or("cut short")?;
    let wide = if version == 1 { 2 } else { 4 };
    let length = bytes.get(8..8 + wide).ok_or("cut short")?;
    let length = length.iter().rev().fold(0, |n, &b| n << 8 | usize::from(b));
    let start = 8 + wide;
    let text = bytes
        .get(start..start.saturating_add(length))
        .ok_or("cut short")?;
    let text = std::str::from_utf8(text).map_err(|_| "its header is no text")?;
    let header = header(text)?;
    let n = header
        .shape
        .iter()
        .try_fold(1usize, |n, &k| n.checked_mul(k));
    let n = n.ok_or("absurdly large")?;
    let kind = Kind::of(header.descr)?;
    let data = kind.data(&bytes[start + length..], n)?;
    let left = n
        .checked_mul(kind.memory())
        .and_then(|need| memory.checked_sub(need));
    *memory = left.ok_or_else(|| Bad::Large("too much data in the archive", "8 GiB".into()))?;
    let mut values = kind.values(&data, n)?;
    if header.fortran && header.shape.len() > 1 {
        values = match values {
            Values::F32(v) => Values::F32(turned(&v, &header.shape)),
            Values::F64(v) => Values::F64(turned(&v, &header.shape)),
            Values::Int(v) => Values::Int(turned(&v, &header.shape)),
            Values::Text(v) => Values::Text(turned(&v, &header.shape)),
        };
    }
    Ok(Array {
        shape: header.shape,
        values,
    })
}

/// The three entries of the header, which stand in this order in all files that NumPy writes, but
/// need not.
fn header(text: &str) -> Result<Header<'_>, String> {
    let after = |key: &str| {
        let at = text.find(&format!("'{key}':"));
        at.map(|at| text[at + key.len() + 3..].trim_start())
            .ok_or(format!("its header has no {key}"))
    };
    let descr = after("descr")?;
    let descr = descr
        .strip_prefix('\'')
        .and_then(|d| d.split_once('\''))
        .ok_or("its values are records, not numbers")?
        .0;
    let shape = after("shape")?;
    let shape = shape
        .strip_prefix('(')
        .and_then(|s| s.split_once(')'))
        .ok_or("its shape is no list")?
        .0;
    let length = |w: &str| {
        let digits = w.trim().trim_end_matches('L');
        digits
            .parse::<usize>()
            .map_err(|_| "its shape is no list of numbers")
    };
    let shape: Result<Vec<usize>, _> = shape
        .split(',')
        .filter(|w| !w.trim().is_empty())
        .map(length)
        .collect();
    Ok(Header {
        descr,
        fortran: after("fortran_order")?.starts_with("True"),
        shape: shape?,
    })
}

/// A type of values such as `<f4`.
struct Kind<'a> {
    descr: &'a str,
    letter: &'a str,
    /// The number behind the letter: bytes, or characters of text.
    size: usize,
    /// Bytes of a value in the file.
    wide: usize,
}

impl<'a> Kind<'a> {
    fn of(descr: &'a str) -> Result<Self, String> {
        let (_, kind) = descr.split_at_checked(1).ok_or("its type is empty")?;
        let (letter, size) = kind.split_at_checked(1).ok_or("its type is empty")?;
        if letter == "O" {
            return Err(
                "it holds pickled objects, which could run anything and are never read".into(),
            );
        }
        let unknown = || format!("type {descr:?} is not known");
        let size: usize = size.parse().map_err(|_| unknown())?;
        if size == 0 {
            return Err(format!("values of type {descr:?} have no bytes"));
        }
        let unit = if letter == "U" { 4 } else { 1 };
        Ok(Self {
            descr,
            letter,
            size,
            wide: size.checked_mul(unit).ok_or("absurdly large")?,
        })
    }

    /// The bytes of `n` values, the lowest of each first.
    fn data<'b>(&self, data: &'b [u8], n: usize) -> Result<Cow<'b, [u8]>, String> {
        let want = n.checked_mul(self.wide).ok_or("absurdly large")?;
        let data = data.get(..want).ok_or(format!(
            "{want} bytes of values expected, {} found",
            data.len()
        ))?;
        let unit = if self.letter == "U" { 4 } else { self.size };
        if !self.descr.starts_with('>') || unit == 1 {
            return Ok(data.into());
        }
        let mut data = data.to_vec();
        data.chunks_exact_mut(unit).for_each(<[u8]>::reverse);
        Ok(data.into())
    }

    /// What a value needs in memory [bytes].
    fn memory(&self) -> usize {
        match self.letter {
            "f" => self.size.max(4),
            "U" | "S" => self
                .size
                .saturating_mul(4)
                .saturating_add(size_of::<String>()),
            _ => 8,
        }
    }

    fn values(&self, data: &[u8], n: usize) -> Result<Values, String> {
        Ok(match (self.letter, self.size) {
            ("f", 2) => Values::F32(each(data, |b| f16::from_le_bytes(b).to_f32())),
            ("f", 4) => Values::F32(each(data, f32::from_le_bytes)),
            ("f", 8) => Values::F64(each(data, f64::from_le_bytes)),
            ("i", 1) => Values::Int(each(data, |b| i8::from_le_bytes(b).into())),
            ("i", 2) => Values::Int(each(data, |b| i16::from_le_bytes(b).into())),
            ("i", 4) => Values::Int(each(data, |b| i32::from_le_bytes(b).into())),
            ("i", 8) => Values::Int(each(data, i64::from_le_bytes)),
            ("u" | "b", 1) => Values::Int(each(data, |b| u8::from_le_bytes(b).into())),
            ("u", 2) => Values::Int(each(data, |b| u16::from_le_bytes(b).into())),
            ("u", 4) => Values::Int(each(data, |b| u32::from_le_bytes(b).into())),
            ("u", 8) => Values::Int(each(data, |b| {
                u64::from_le_bytes(b).min(i64::MAX as u64) as i64
            })),
            ("U", _) => Values::Text(words(data, self.wide, n)),
            ("S", size) => {
                let word = |i: usize| ascii(&data[i * size..(i + 1) * size]);
                Values::Text((0..n).map(word).collect())
            }
            _ => return Err(format!("type {:?} is not known", self.descr)),
        })
    }
}

fn each<const N: usize, T>(data: &[u8], value: impl Fn([u8; N]) -> T) -> Vec<T> {
    data.as_chunks::<N>().0.iter().map(|b| value(*b)).collect()
}

/// Words of 32-bit characters, filled up with zeros.
fn words(data: &[u8], wide: usize, n: usize) -> Vec<String> {
    let word = |i: usize| {
        let letters = data[i * wide..(i + 1) * wide].as_chunks::<4>().0;
        let letters = letters
            .iter()
            .map(|b| u32::from_le_bytes(*b))
            .take_while(|&c| c != 0);
        letters
            .map(|c| char::from_u32(c).unwrap_or('\u{fffd}'))
            .collect()
    };
    (0..n).map(word).collect()
}

fn ascii(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// Values whose first axis runs fastest, brought into our order.
fn turned<T: Clone>(values: &[T], shape: &[usize]) -> Vec<T> {
    let mut out = Vec::with_capacity(values.len());
    let mut index = vec![0usize; shape.len()];
    for _ in 0..values.len() {
        let at = index
            .iter()
            .zip(shape)
            .rev()
            .fold(0, |at, (&i, &n)| at * n + i);
        out.push(values[at].clone());
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    out
}

/// The bytes of a `.npy` file.
pub fn write(array: &Array) -> Result<Vec<u8>, &'static str> {
    let n: usize = array.shape.iter().product();
    let (descr, data, len) = match &array.values {
        Values::F32(v) if v.iter().all(|x| x.is_finite()) => {
            ("<f4".to_owned(), bytes(v, |x| x.to_le_bytes()), v.len())
        }
        Values::F64(v) if v.iter().all(|x| x.is_finite()) => {
            ("<f8".to_owned(), bytes(v, |x| x.to_le_bytes()), v.len())
        }
        Values::F32(_) | Values::F64(_) => return Err("a number is not finite"),
        Values::Int(v) => {
            let short: Option<Vec<i32>> = v.iter().map(|&i| i32::try_from(i).ok()).collect();
            let short = short.ok_or("an integer needs more than 32 bits")?;
            (
                "<i4".to_owned(),
                bytes(&short, |x| x.to_le_bytes()),
                v.len(),
            )
        }
        Values::Text(v) => {
            let wide = v
                .iter()
                .map(|w| w.chars().count())
                .max()
                .unwrap_or(0)
                .max(1);
            let letters = v.iter().flat_map(|w| {
                w.chars()
                    .map(u32::from)
                    .chain(std::iter::repeat(0))
                    .take(wide)
            });
            let letters: Vec<u32> = letters.collect();
            (
                format!("<U{wide}"),
                bytes(&letters, |x| x.to_le_bytes()),
                v.len(),
            )
        }
    };
    if n != len {
        return Err("the values differ in number from the shape");
    }
    let mut out = preamble(&descr, &array.shape);
    out.extend(data);
    Ok(out)
}

fn bytes<T: Copy, const N: usize>(values: &[T], to: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|&x| to(x)).collect()
}

/// Magic, version and header, filled up to a multiple of 64 bytes.
fn preamble(descr: &str, shape: &[usize]) -> Vec<u8> {
    let lengths: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    let text = format!(
        "{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}",
        lengths.join(", ")
    );
    let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
    let mut out = MAGIC.to_vec();
    out.extend([1, 0]);
    out.extend((length as u16).to_le_bytes());
    out.extend(text.bytes());
    out.resize(10 + length - 1, b' ');
    out.push(b'\n');
    out
}
