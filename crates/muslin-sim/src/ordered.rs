//! Work shared among threads whose result does not depend on how many there are.
//!
//! Chunks have a fixed size and their results are combined in order.

use std::ops::Range;

use rayon::prelude::*;

/// Entries per chunk; a constant, because it decides the order of every sum.
pub(crate) const CHUNK: usize = 512;

/// `Σ part(range)` over the chunks of `0..n`.
pub(crate) fn sum(n: usize, part: impl Fn(Range<usize>) -> f64 + Sync) -> f64 {
    let chunks = 0..n.div_ceil(CHUNK);
    let range = |c: usize| c * CHUNK..((c + 1) * CHUNK).min(n);
    let parts: Vec<f64> = chunks.into_par_iter().map(|c| part(range(c))).collect();
    parts.iter().sum()
}

/// The largest of `value(i)` for `0..n`; less than anything of none.
pub(crate) fn most(n: usize, value: impl Fn(usize) -> f64 + Sync + Send) -> f64 {
    let all = (0..n).into_par_iter().with_min_len(CHUNK).map(value);
    all.reduce(|| f64::NEG_INFINITY, f64::max)
}

/// Writes `value(i)` to every entry.
pub(crate) fn fill<T: Send>(out: &mut [T], value: impl Fn(usize) -> T + Sync) {
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, part)| {
        for (k, entry) in part.iter_mut().enumerate() {
            *entry = value(c * CHUNK + k);
        }
    });
}

/// Writes `value(i, entry)` over every entry.
pub(crate) fn change<T: Send + Copy>(out: &mut [T], value: impl Fn(usize, T) -> T + Sync) {
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, part)| {
        for (k, entry) in part.iter_mut().enumerate() {
            *entry = value(c * CHUNK + k, *entry);
        }
    });
}

/// `value(i)` for `0..n`.
pub(crate) fn map<T: Send>(n: usize, value: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..n)
        .into_par_iter()
        .with_min_len(CHUNK)
        .map(value)
        .collect()
}
