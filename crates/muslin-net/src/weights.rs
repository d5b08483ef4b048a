//! Named arrays with notes: what a trained network is stored as.

use std::collections::BTreeMap;

/// Numbers of one kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    /// 64-bit floats.
    F64(Vec<f64>),
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 16-bit floats (IEEE binary16), as their bits.
    F16(Vec<u16>),
    /// 32-bit counts.
    U32(Vec<u32>),
    /// Bytes.
    U8(Vec<u8>),
}

impl Numbers {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::F64(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F16(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::U8(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Numbers in a shape; the last axis is the innermost.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// As many numbers as the product of the shape.
    pub numbers: Numbers,
}

impl Array {
    /// An array of this shape.
    ///
    /// # Panics
    /// If the numbers do not fill the shape.
    pub fn new(shape: &[usize], numbers: Numbers) -> Self {
        assert_eq!(
            shape.iter().product::<usize>(),
            numbers.len(),
            "an array fills its shape"
        );
        Self {
            shape: shape.to_vec(),
            numbers,
        }
    }
}

/// Named arrays, and notes about them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weights {
    /// By name.
    pub arrays: BTreeMap<String, Array>,
    /// What else there is to say, by name.
    pub notes: BTreeMap<String, String>,
}
