//! Wide instructions, chosen when the program runs.
//!
//! A kernel is written once, as plain loops over fixed-size arrays. [`fastest`] compiles it a
//! second time for processors with AVX2 and FMA and picks by what the machine has; the plain
//! compilation is the safe twin, and the tests hold one to the other.
#![allow(unsafe_code)] // calling a function compiled for more than the baseline processor

/// A loop that gains from wide registers.
pub(crate) trait Kernel {
    /// Does the work. `FUSED`: multiply and add round once. Mark it `#[inline(always)]`, or it
    /// is compiled for the baseline only.
    fn run<const FUSED: bool>(self);
}

/// `a * b + c`, rounded once if `FUSED`.
#[inline(always)]
pub(crate) fn madd<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Runs `kernel` with the widest instructions this machine has.
pub(crate) fn fastest(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
        // SAFETY: the processor has just been found to have both features.
        unsafe { with_avx2(kernel) };
        return;
    }
    plain(kernel);
}

/// Runs `kernel` with the baseline instructions.
pub(crate) fn plain(kernel: impl Kernel) {
    // Every 64-bit Arm multiplies and adds at once; elsewhere it could be a slow library call.
    kernel.run::<{ cfg!(target_arch = "aarch64") }>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2(kernel: impl Kernel) {
    kernel.run::<true>();
}
