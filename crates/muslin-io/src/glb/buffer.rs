//! A GLB taken apart: its JSON and the numbers behind its accessors.

use std::borrow::Cow;

use serde_json::Value;

use crate::error::{Fault, IoError, Place};

/// More numbers in one accessor are refused.
const MAX_NUMBERS: usize = 1 << 28;

/// JSON and binary of a file.
#[derive(Clone, Debug)]
pub struct Glb<'a> {
    name: String,
    /// The whole JSON.
    pub json: Value,
    bin: Cow<'a, [u8]>,
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

    /// The numbers of the accessor that `index` names.
    pub fn numbers(&self, index: &Value) -> Result<Numbers, IoError> {
        let i = int(index).unwrap_or(usize::MAX);
        let pointer = format!("/accessors/{i}");
        let accessor = self.list("accessors").get(i);
        let numbers = accessor.and_then(|a| self.accessor(a));
        numbers
            .ok_or_else(|| self.fault(&pointer, "no accessor, or one that reaches beyond its data"))
    }

    fn accessor(&self, a: &Value) -> Option<Numbers> {
        let width = match a["type"].as_str()? {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => return None,
        };
        let (kind, count) = (int(&a["componentType"])?, int(&a["count"])?);
        let total = count.checked_mul(width).filter(|&n| n <= MAX_NUMBERS)?;
        let is_share = a["normalized"] == true;
        let mut flat = match &a["bufferView"] {
            Value::Null => vec![0.0; total],
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
            let places = part("indices", 1, int(&sparse["indices"]["componentType"])?)?;
            let values = part("values", width, kind)?;
            for (&at, value) in places.iter().zip(values.chunks_exact(width)) {
                let at = at as usize * width;
                flat.get_mut(at..at + width)?.copy_from_slice(value);
            }
        }
        Some(Numbers { flat, width })
    }
}

/// A whole number.
pub fn int(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|n| usize::try_from(n).ok())
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
