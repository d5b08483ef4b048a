//! A GLB taken apart: its JSON and the numbers behind its accessors.

use std::borrow::Cow;
use std::fmt::Display;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use serde_json::Value;

use crate::error::{Fault, IoError, Place};

/// More numbers in one accessor are refused.
const MAX_NUMBERS: usize = 1 << 28;
/// More numbers in all that is read of a file are refused: 8 GiB.
const MAX_IN_ALL: usize = 1 << 30;

/// JSON and binary of a file.
#[derive(Clone, Debug)]
pub struct Glb<'a> {
    name: String,
    /// The whole JSON.
    pub json: Value,
    bin: Cow<'a, [u8]>,
    room: Room,
}

/// How many numbers of a file may still be read. Accessors need no data for them, so that the file's
/// own size is no bound.
#[derive(Debug)]
struct Room(AtomicUsize);

impl Default for Room {
    fn default() -> Self {
        Self(AtomicUsize::new(MAX_IN_ALL))
    }
}

impl Clone for Room {
    /// A copy of a file is read from its beginning.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Numbers of an accessor, `width` to an element.
pub struct Numbers {
    /// Components one after the other; normalised ones from −1 to 1.
    pub flat: Vec<f64>,
    /// How many make an element.
    pub width: usize,
}

impl<'a> Glb<'a> {
    /// Takes the container apart (glTF 2.0, section 4).
    pub fn new(name: &str, bytes: &'a [u8]) -> Result<Self, IoError> {
        let (json, bin) = Self::parts(name, bytes)?;
        Ok(Self {
            name: name.into(),
            json,
            bin: Cow::Borrowed(bin),
            room: Room::default(),
        })
    }

    /// The same with bytes of its own.
    pub fn owned(name: &str, bytes: Vec<u8>) -> Result<Glb<'static>, IoError> {
        let (json, bin) = Self::parts(name, &bytes)?;
        Ok(Glb::of(name, json, bin.to_vec()))
    }

    /// Of JSON over one buffer.
    pub fn of(name: &str, json: Value, bin: Vec<u8>) -> Glb<'static> {
        Glb {
            name: name.into(),
            json,
            bin: Cow::Owned(bin),
            room: Room::default(),
        }
    }

    fn parts<'b>(name: &str, bytes: &'b [u8]) -> Result<(Value, &'b [u8]), IoError> {
        let fault = |what: &str| {
            Fault::new("glb", name, what)
                .hint("write the file again")
                .invalid()
        };
        let word = |at: usize| {
            let b = bytes.get(at..at.checked_add(4)?)?;
            Some(u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
        };
        if bytes.get(..4) != Some(b"glTF") || word(4) != Some(2) {
            return Err(fault("not a GLB of version 2"));
        }
        let length = word(12).ok_or_else(|| fault("cut short"))?;
        let json = bytes
            .get(20..20usize.saturating_add(length))
            .ok_or_else(|| fault("cut short"))?;
        let json = serde_json::from_slice(json)
            .map_err(|e| fault(&format!("its JSON is damaged: {e}")))?;
        let at = 20 + length;
        let bin = match word(at) {
            Some(n) => bytes
                .get(at + 8..(at + 8).saturating_add(n))
                .ok_or_else(|| fault("cut short"))?,
            None => &[],
        };
        Ok((json, bin))
    }

    /// A fault at a place in the JSON.
    pub fn fault(&self, pointer: &str, what: &str) -> IoError {
        let fault = Fault::new("glb", &self.name, what);
        fault.at(Place::Pointer(pointer.into())).invalid()
    }

    /// What errors call it.
    pub fn file(&self) -> &str {
        &self.name
    }

    /// Too much of something at a place in the JSON.
    pub fn large(&self, pointer: &str, what: &str, allowed: impl Display) -> IoError {
        let fault = Fault::new("glb-large", &self.name, what);
        let fault = fault.at(Place::Pointer(pointer.into())).allowed(allowed);
        fault
            .hint("make it smaller in the program that it comes from")
            .refused()
    }

    /// The list called `key`, empty if there is none.
    pub fn list(&self, key: &str) -> &[Value] {
        self.json[key].as_array().map_or(&[], Vec::as_slice)
    }

    /// The bytes of a buffer view, with its stride if it has one.
    pub fn view(&self, index: &Value) -> Option<(&[u8], Option<usize>)> {
        let view = self.list("bufferViews").get(int(index)?)?;
        let start = int(&view["byteOffset"]).unwrap_or(0);
        let end = start.checked_add(int(&view["byteLength"])?)?;
        let is_ours = int(&view["buffer"]) == Some(0);
        is_ours.then_some(())?;
        Some((self.bin.get(start..end)?, int(&view["byteStride"])))
    }

    /// Refuses what asks for more numbers than the file may still give.
    pub fn has_room(&self, pointer: &str, numbers: usize) -> Result<(), IoError> {
        match numbers <= self.room.0.load(Ordering::Relaxed) {
            true => Ok(()),
            false => Err(self.full(pointer)),
        }
    }

    /// The same, and counts them as given.
    pub fn take(&self, pointer: &str, numbers: usize) -> Result<(), IoError> {
        let rest = |room: usize| room.checked_sub(numbers);
        let taken = (self.room.0).fetch_update(Ordering::Relaxed, Ordering::Relaxed, rest);
        taken.map(drop).map_err(|_| self.full(pointer))
    }

    fn full(&self, pointer: &str) -> IoError {
        self.large(pointer, "too many numbers in the file", MAX_IN_ALL)
    }

    /// Counts from the beginning: what was read before is gone.
    pub fn anew(&self) {
        self.room.0.store(MAX_IN_ALL, Ordering::Relaxed);
    }

    /// How many elements the accessor that `index` names claims to have; none if it is no accessor.
    pub fn count(&self, index: &Value) -> usize {
        let accessor = int(index).and_then(|i| self.list("accessors").get(i));
        accessor.and_then(|a| int(&a["count"])).unwrap_or(0)
    }

    /// The numbers of the accessor that `index` names.
    pub fn numbers(&self, index: &Value) -> Result<Numbers, IoError> {
        let i = int(index).unwrap_or(usize::MAX);
        let pointer = format!("/accessors/{i}");
        let broken = || self.fault(&pointer, "no accessor, or one that reaches beyond its data");
        let accessor = self.list("accessors").get(i).ok_or_else(broken)?;
        let claimed = claimed(accessor).ok_or_else(broken)?;
        if claimed > MAX_NUMBERS {
            return Err(self.large(&pointer, "too many numbers in one accessor", MAX_NUMBERS));
        }
        self.take(&pointer, claimed)?;
        self.accessor(accessor).ok_or_else(broken)
    }

    /// The points that `index` names; `pointer` says what asks for them.
    pub fn points(&self, pointer: &str, index: &Value) -> Result<Vec<DVec3>, IoError> {
        let numbers = self.numbers(index)?;
        match numbers.width {
            3 => {
                let points = numbers.flat.as_chunks::<3>().0.iter();
                Ok(points.map(|c| DVec3::from_array(*c)).collect())
            }
            _ => Err(self.fault(pointer, "positions that are not in space")),
        }
    }

    fn accessor(&self, a: &Value) -> Option<Numbers> {
        let (width, kind, count) = (width(a)?, int(&a["componentType"])?, int(&a["count"])?);
        let is_share = a["normalized"] == true;
        let mut flat = match &a["bufferView"] {
            Value::Null => vec![0.0; count * width],
            view => {
                let (data, stride) = self.view(view)?;
                let data = data.get(int(&a["byteOffset"]).unwrap_or(0)..)?;
                unpacked(data, (count, width, stride), (kind, is_share))?
            }
        };
        let sparse = &a["sparse"];
        if let Some(n) = int(&sparse["count"]) {
            let part = |what: &str, width: usize, kind: usize| {
                let (data, _) = self.view(&sparse[what]["bufferView"])?;
                let data = data.get(int(&sparse[what]["byteOffset"]).unwrap_or(0)..)?;
                unpacked(data, (n, width, None), (kind, is_share && what == "values"))
            };
            let whole = int(&sparse["indices"]["componentType"])?;
            if !matches!(whole, 5121 | 5123 | 5125) {
                return None;
            }
            let places = part("indices", 1, whole)?;
            let values = part("values", width, kind)?;
            for (&at, value) in places.iter().zip(values.chunks_exact(width)) {
                let at = (at as usize).checked_mul(width)?;
                flat.get_mut(at..at.checked_add(width)?)?
                    .copy_from_slice(value);
            }
        }
        Some(Numbers { flat, width })
    }
}

/// A whole number.
pub fn int(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|n| usize::try_from(n).ok())
}

/// Components of an accessor's element.
fn width(accessor: &Value) -> Option<usize> {
    match accessor["type"].as_str()? {
        "SCALAR" => Some(1),
        "VEC2" => Some(2),
        "VEC3" => Some(3),
        "VEC4" => Some(4),
        "MAT4" => Some(16),
        _ => None,
    }
}

/// How many numbers an accessor asks for, with those that it replaces and their places.
fn claimed(accessor: &Value) -> Option<usize> {
    let (width, count) = (width(accessor)?, int(&accessor["count"])?);
    let replaced = int(&accessor["sparse"]["count"]).unwrap_or(0);
    let replaced = replaced.saturating_mul(width + 1);
    Some(count.saturating_mul(width).saturating_add(replaced))
}

/// `count` elements of `width` components of a kind; `None` beyond the data.
fn unpacked(
    data: &[u8],
    (count, width, stride): (usize, usize, Option<usize>),
    (kind, is_share): (usize, bool),
) -> Option<Vec<f64>> {
    let (size, most) = match kind {
        5120 => (1, 127.0),
        5121 => (1, 255.0),
        5122 => (2, 32_767.0),
        5123 => (2, 65_535.0),
        5125 | 5126 => (4, 1.0),
        _ => return None,
    };
    let stride = stride.unwrap_or(size * width);
    let end = count.checked_sub(1).map_or(Some(0), |last| {
        last.checked_mul(stride)?.checked_add(size * width)
    })?;
    (end <= data.len()).then_some(())?;
    let unit = if is_share { most } else { 1.0 };
    let one = |at: usize| {
        let b = &data[at..at + size];
        match kind {
            5120 => f64::from(b[0] as i8),
            5121 => f64::from(b[0]),
            5122 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            5123 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            5125 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            _ => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        }
    };
    let element = |i: usize| (0..width).map(move |k| one(i * stride + k * size) / unit);
    Some((0..count).flat_map(element).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn all_numbers_of_a_file_are_counted_together_and_before_they_are_made() {
        let zeros = |n: usize| json!({ "type": "SCALAR", "componentType": 5126, "count": n });
        let json = json!({ "accessors": [zeros(60), zeros(usize::MAX)] });
        let glb = Glb::of("a.glb", json, Vec::new());
        glb.room.0.store(100, Ordering::Relaxed);
        assert_eq!(glb.numbers(&json!(0)).map(|n| n.flat.len()).ok(), Some(60));
        for (accessor, told) in [(0, "in the file"), (1, "in one accessor")] {
            let fault = glb.numbers(&json!(accessor)).err().expect("too many");
            assert!(fault.to_string().contains(told), "{fault}");
            assert_eq!(fault.exit_code(), 4, "{fault}");
        }
        glb.anew();
        assert!(glb.numbers(&json!(0)).is_ok());
    }

    #[test]
    fn numbers_that_are_replaced_count_as_well() {
        let sparse = json!({
            "type": "VEC3",
            "componentType": 5126,
            "count": 2,
            "sparse": { "count": 1u64 << 40 },
        });
        let glb = Glb::of("a.glb", json!({ "accessors": [sparse] }), Vec::new());
        let fault = glb.numbers(&json!(0)).err().expect("too many");
        assert_eq!(fault.exit_code(), 4, "{fault}");
    }
}
