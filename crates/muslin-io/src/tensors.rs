//! Weights as files: the `safetensors` layout, with notes in its metadata.
//!
//! Readers of that layout in any language open these files. Nothing in them is ever executed.

use std::collections::HashMap;

use muslin_net::{Array, Numbers, Weights};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::error::{Fault, IoError};

/// Arrays that a file may hold, and bytes of its notes.
const MOST_ARRAYS: usize = 1024;

/// The file's bytes.
pub fn write_weights(weights: &Weights) -> Vec<u8> {
    let bytes: Vec<(&str, &[usize], Dtype, Vec<u8>)> = (weights.arrays.iter())
        .map(|(name, array)| {
            let (kind, bytes) = raw(&array.numbers);
            (name.as_str(), array.shape.as_slice(), kind, bytes)
        })
        .collect();
    let views = bytes.iter().map(|(name, shape, kind, bytes)| {
        let view = TensorView::new(*kind, shape.to_vec(), bytes);
        (*name, view.expect("an array fills its shape"))
    });
    let notes: HashMap<String, String> = weights.notes.clone().into_iter().collect();
    // The crate writes notes in the order of the map, which differs from run to run.
    let notes = (!notes.is_empty()).then_some(notes);
    let file = safetensors::serialize(views, notes);
    ordered(file.expect("arrays of sound shapes can be written"))
}

/// Reads a file's bytes; `file` is its name for messages.
pub fn read_weights(file: &str, bytes: &[u8]) -> Result<Weights, IoError> {
    let broken = |e: safetensors::SafeTensorError| {
        let fault = Fault::new("not-weights", file, format!("no safetensors file: {e}"));
        fault
            .hint("give a file that `muslin train` wrote")
            .invalid()
    };
    let (_, head) = SafeTensors::read_metadata(bytes).map_err(broken)?;
    let found = SafeTensors::deserialize(bytes).map_err(broken)?;
    if found.len() > MOST_ARRAYS {
        let fault = Fault::new("many-arrays", file, "more arrays than any model has");
        return Err(fault.found(found.len()).allowed(MOST_ARRAYS).refused());
    }
    let mut out = Weights::default();
    out.notes
        .extend(head.metadata().clone().unwrap_or_default());
    for (name, view) in found.iter() {
        let numbers = numbers(&view).ok_or_else(|| {
            let what = format!("array {name:?} is of a kind that is not read");
            Fault::new("array-kind", file, what)
                .found(format!("{:?}", view.dtype()))
                .refused()
        })?;
        out.arrays
            .insert(name.to_owned(), Array::new(view.shape(), numbers));
    }
    Ok(out)
}

fn raw(numbers: &Numbers) -> (Dtype, Vec<u8>) {
    match numbers {
        Numbers::F64(v) => (Dtype::F64, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Numbers::F32(v) => (Dtype::F32, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Numbers::F16(v) => (Dtype::F16, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Numbers::U32(v) => (Dtype::U32, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Numbers::U8(v) => (Dtype::U8, v.clone()),
    }
}

fn numbers(view: &TensorView<'_>) -> Option<Numbers> {
    let bytes = view.data();
    let fours = || bytes.as_chunks::<4>().0.iter();
    Some(match view.dtype() {
        Dtype::F64 => Numbers::F64(
            bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|b| f64::from_le_bytes(*b))
                .collect(),
        ),
        Dtype::F32 => Numbers::F32(fours().map(|b| f32::from_le_bytes(*b)).collect()),
        Dtype::U32 => Numbers::U32(fours().map(|b| u32::from_le_bytes(*b)).collect()),
        Dtype::F16 => Numbers::F16(
            bytes
                .as_chunks::<2>()
                .0
                .iter()
                .map(|b| u16::from_le_bytes(*b))
                .collect(),
        ),
        Dtype::U8 => Numbers::U8(bytes.to_vec()),
        _ => return None,
    })
}

/// The same file with the entries of its head in order, so that equal weights are equal bytes.
fn ordered(file: Vec<u8>) -> Vec<u8> {
    let (len, rest) = file
        .split_first_chunk::<8>()
        .expect("a file starts with the length of its head");
    let (head, data) = rest.split_at(u64::from_le_bytes(*len) as usize);
    let value: serde_json::Value = serde_json::from_slice(head).expect("the head was just written");
    // The default map of serde_json keeps keys sorted.
    let mut head = value.to_string().into_bytes();
    head.resize(head.len().next_multiple_of(8), b' ');
    let mut out = (head.len() as u64).to_le_bytes().to_vec();
    out.extend(head);
    out.extend(data);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Weights {
        let mut w = Weights::default();
        let mut add =
            |name: &str, shape: &[usize], n| w.arrays.insert(name.into(), Array::new(shape, n));
        add(
            "a",
            &[2, 3],
            Numbers::F32(vec![1.0, -2.5, 0.0, f32::MIN_POSITIVE, 4.0, 5.0]),
        );
        add("b", &[2], Numbers::F64(vec![0.1, -1e300]));
        add("c", &[3], Numbers::U32(vec![0, 7, u32::MAX]));
        add("d", &[1], Numbers::F16(vec![0x3c00]));
        add("e", &[4], Numbers::U8(vec![1, 2, 3, 255]));
        for k in 0..9 {
            w.notes
                .insert(format!("note {k}"), "words, \"quoted\"".into());
        }
        w
    }

    #[test]
    fn weights_come_back_as_they_were_and_equal_ones_are_equal_bytes() {
        let bytes = write_weights(&some());
        assert_eq!(read_weights("w", &bytes), Ok(some()));
        assert_eq!(bytes, write_weights(&some()));
    }

    #[test]
    fn cut_or_foreign_bytes_are_refused_in_words() {
        let bytes = write_weights(&some());
        for n in [0, 1, 7, 8, 20, bytes.len() / 2, bytes.len() - 1] {
            let fault = read_weights("w.muslin", &bytes[..n]).expect_err("a cut file");
            assert!(fault.to_string().contains("w.muslin"), "{fault}");
        }
        let mut huge = bytes.clone();
        huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(read_weights("w", &huge).is_err());
        for at in 8..200 {
            let mut bent = bytes.clone();
            bent[at] ^= 0x15;
            // Any answer will do, but no panic.
            let _ = read_weights("w", &bent);
        }
    }
}
