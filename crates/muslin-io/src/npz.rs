//! NumPy archives in and out: named arrays, as `numpy.load` and `numpy.savez` know them.
//!
//! Read: stored and deflated members, both byte orders and both array orders, integers, floats of
//! 16, 32 and 64 bits, truth values and text. Pickled objects are refused and never looked at.
//! Written: stored members in format version 1, the same bytes for the same arrays.

mod npy;

use std::collections::BTreeMap;

use crate::error::{Fault, IoError, Place};
use crate::zip::{self, Bad};

/// An archive of more unpacked bytes is refused.
const MAX_BYTES: u64 = 4 << 30;
/// Arrays that need more memory together are refused [bytes]: integers are kept in 64 bits.
const MAX_MEMORY: usize = 8 << 30;

/// Numbers or words with a shape; the last axis runs fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; none for a single value.
    pub shape: Vec<usize>,
    /// As many as the shape says.
    pub values: Values,
}

/// What an array is made of.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// `float16` and `float32`.
    F32(Vec<f32>),
    /// `float64`.
    F64(Vec<f64>),
    /// All integers and truth values; written as `int32`.
    Int(Vec<i64>),
    /// Words; written as `<U..`.
    Text(Vec<String>),
}

/// The arrays of an archive by name, without the `.npy`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Npz {
    file: String,
    arrays: BTreeMap<String, Array>,
}

/// Reads an archive; `name` is what errors call it.
pub fn read(name: &str, bytes: &[u8]) -> Result<Npz, IoError> {
    let bad = |bad: Bad| match bad {
        Bad::Large(..) => bad.told(|what| Fault::new("npz-large", name, what)),
        Bad::Broken(_) => bad.told(|what| {
            let fault = Fault::new("npz", name, what);
            fault.hint("write it again with numpy.savez")
        }),
    };
    let mut npz = Npz {
        file: name.into(),
        ..Npz::default()
    };
    let (mut room, mut memory) = (MAX_BYTES, MAX_MEMORY);
    for member in zip::members(bytes).map_err(bad)? {
        let Some(array) = member.name.strip_suffix(".npy") else {
            continue;
        };
        if member.size > room {
            let what = "too much data in the archive";
            return Err(bad(Bad::Large(what, "4 GiB".into())));
        }
        room -= member.size;
        let at = |e: Bad| match e {
            Bad::Broken(what) => bad(format!("array {array:?}: {what}").into()),
            large => bad(large),
        };
        let data = zip::unpack(bytes, &member).map_err(|what| at(what.into()))?;
        let read = npy::read(&data, &mut memory).map_err(at)?;
        npz.arrays.insert(array.to_owned(), read);
    }
    if npz.arrays.is_empty() {
        return Err(bad("no arrays in the archive".into()));
    }
    Ok(npz)
}

/// The bytes of an archive with these arrays, in this order.
///
/// Fails on a float that is not finite, an integer beyond 32 bits, and more than 4 GiB.
pub fn write(arrays: &[(&str, Array)]) -> Result<Vec<u8>, IoError> {
    let fault = |name: &str, what: &str| {
        let place = Place::Pointer(format!("/{name}"));
        let fault = Fault::new("bad-array", "the arrays to write", what);
        fault.at(place).invalid()
    };
    let mut out = zip::Writer::default();
    for (name, array) in arrays {
        let data = npy::write(array).map_err(|what| fault(name, what))?;
        out.add(&format!("{name}.npy"), &data)
            .map_err(|what| fault(name, what))?;
    }
    Ok(out.finish())
}

impl Array {
    /// Floats of 32 bits.
    pub fn f32(shape: &[usize], values: Vec<f32>) -> Self {
        Self {
            shape: shape.to_vec(),
            values: Values::F32(values),
        }
    }

    /// Integers, which must fit into 32 bits.
    pub fn int(shape: &[usize], values: Vec<i64>) -> Self {
        Self {
            shape: shape.to_vec(),
            values: Values::Int(values),
        }
    }

    /// A single number.
    pub fn number(value: f64) -> Self {
        Self {
            shape: Vec::new(),
            values: Values::F64(vec![value]),
        }
    }

    /// Words in a row.
    pub fn text(words: Vec<String>) -> Self {
        Self {
            shape: vec![words.len()],
            values: Values::Text(words),
        }
    }

    /// All values as 64-bit floats; none of text.
    pub fn floats(&self) -> Option<Vec<f64>> {
        match &self.values {
            Values::F32(v) => Some(v.iter().map(|&x| x.into()).collect()),
            Values::F64(v) => Some(v.clone()),
            Values::Int(v) => Some(v.iter().map(|&x| x as f64).collect()),
            Values::Text(_) => None,
        }
    }
}

impl Npz {
    /// The array called `name`, if there is one.
    pub fn get(&self, name: &str) -> Option<&Array> {
        self.arrays.get(name)
    }

    /// The names of all arrays.
    pub fn names(&self) -> Vec<&str> {
        self.arrays.keys().map(String::as_str).collect()
    }

    /// The floats of the array called `name`, whose shape must be `shape` where that is not `None`.
    pub fn floats(&self, name: &str, shape: &[Option<usize>]) -> Result<Vec<f64>, IoError> {
        let array = self.shaped(name, shape)?;
        let floats = array.floats();
        floats.ok_or_else(|| self.fault(name, "holds text, not numbers"))
    }

    /// The indices of the array called `name`, each below `below`, in triples.
    pub fn triangles(&self, name: &str, below: usize) -> Result<Vec<[u32; 3]>, IoError> {
        let corners = self.indices(name, (&[None, Some(3)], below))?;
        Ok(corners.as_chunks::<3>().0.to_vec())
    }

    /// The indices of the array called `name` and of such a shape, each below `below`.
    pub fn indices(
        &self,
        name: &str,
        (shape, below): (&[Option<usize>], usize),
    ) -> Result<Vec<u32>, IoError> {
        let array = self.shaped(name, shape)?;
        let Values::Int(ints) = &array.values else {
            return Err(self.fault(name, "holds no integers"));
        };
        let index = |&i: &i64| u32::try_from(i).ok().filter(|&i| (i as usize) < below);
        let all: Option<Vec<u32>> = ints.iter().map(index).collect();
        all.ok_or_else(|| self.fault(name, "has a corner that is no vertex"))
    }

    /// The array called `name`, whose shape must be `shape` where that is not `None`.
    pub fn shaped(&self, name: &str, shape: &[Option<usize>]) -> Result<&Array, IoError> {
        let array = self.get(name).ok_or_else(|| {
            let fault = Fault::new("npz", &self.file, format!("no array {name:?}"));
            fault.found(self.names().join(", ")).invalid()
        })?;
        let fits = array.shape.len() == shape.len()
            && array
                .shape
                .iter()
                .zip(shape)
                .all(|(&n, want)| want.is_none_or(|w| w == n));
        match fits {
            true => Ok(array),
            false => Err(self.wrong_shape(name, array, shape)),
        }
    }

    fn wrong_shape(&self, name: &str, array: &Array, shape: &[Option<usize>]) -> IoError {
        let wanted: Vec<String> = shape
            .iter()
            .map(|n| n.map_or("n".into(), |n| n.to_string()))
            .collect();
        let fault = Fault::new(
            "npz",
            &self.file,
            format!("array {name:?} has another shape"),
        );
        fault
            .found(format!("{:?}", array.shape))
            .allowed(format!("[{}]", wanted.join(", ")))
            .invalid()
    }

    /// A fault in the array called `name`.
    pub(crate) fn fault(&self, name: &str, what: &str) -> IoError {
        Fault::new("npz", &self.file, format!("array {name:?} {what}")).invalid()
    }
}

#[cfg(test)]
mod tests;
