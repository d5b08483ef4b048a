//! Memory that numbers of one run after another lie in.

/// Bytes of a line of the processor's cache.
const LINE: usize = 64;

/// Numbers that begin with a line of the cache, so that no eight of them share two.
#[derive(Default)]
pub(crate) struct Room {
    values: Vec<f32>,
    start: usize,
}

impl Room {
    /// Makes it hold at least `len` numbers; what it held may be lost.
    pub(crate) fn fit(&mut self, len: usize) {
        let spare = LINE / size_of::<f32>();
        if self.values.len() < len + spare {
            self.values = vec![0.0; len + spare];
            // Where no start can be found, nothing is lost but time.
            self.start = self.values.as_ptr().align_offset(LINE).min(spare);
        }
    }

    /// The first `len` numbers.
    pub(crate) fn head(&self, len: usize) -> &[f32] {
        &self.values[self.start..][..len]
    }

    /// The first `len` numbers, to be changed.
    pub(crate) fn head_mut(&mut self, len: usize) -> &mut [f32] {
        &mut self.values[self.start..][..len]
    }
}
