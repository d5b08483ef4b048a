//! Memory that is asked for before it is read.

#![allow(unsafe_code)]

/// Bytes that come together.
const LINE: usize = 64;

/// Asks for what will be read soon; does nothing where a processor has no word for that.
#[inline(always)]
pub(crate) fn ask<T>(soon: &[T]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = soon.as_ptr().cast::<i8>();
        for at in (0..size_of_val(soon)).step_by(LINE) {
            // SAFETY: no place is read, and `at` lies inside of the slice.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.add(at)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (soon, LINE);
}
