//! Plain loops compiled for wider registers than the least of processors has.

use pulp::{Simd, WithSimd};

/// Runs `work` as compiled for AVX2, if the processor has it, which is found out while the program runs; the bits are the
/// same on any. What is compiled for AVX-512 gathers and scatters where lanes lie side by side, and takes several times
/// as long.
///
/// The closure and all that it calls have to be inlined (`#[inline(always)]`): what is a function of its own is compiled for the
/// least of processors.
#[inline(always)]
pub fn widely<R>(work: impl FnMut() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return Simd::vectorize(v3, Wide(work));
    }
    Wide(work).with_simd(pulp::Scalar)
}

/// A closure that is called where it is. One that is called by value, as `dispatch` does it, may become a function of its
/// own.
struct Wide<F>(F);

impl<R, F: FnMut() -> R> WithSimd for Wide<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}
