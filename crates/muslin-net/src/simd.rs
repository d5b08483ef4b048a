//! Wide instructions, chosen when the program runs.
//!
//! A kernel is written once over [`Lanes`], eight numbers worked side by side. [`fastest`] gives
//! it AVX2 registers where the machine has them and plain arrays elsewhere; the tests hold one
//! to the other.
#![allow(unsafe_code)] // vector registers are reached by functions that need AVX2 and FMA

/// Numbers in a [`Lanes`].
pub(crate) const N_LANES: usize = 8;

/// Eight numbers that every operation treats alike.
pub(crate) trait Lanes: Copy {
    /// Eight times `x`.
    fn splat(x: f32) -> Self;
    /// Eight neighbours.
    fn load(x: &[f32; N_LANES]) -> Self;
    /// Eight neighbours from each of `N` places of `x`, the first at `at`, `step` apart.
    ///
    /// Panics unless all lie inside.
    fn load_every<const N: usize>(x: &[f32], at: usize, step: usize) -> [Self; N];
    /// Into eight neighbours.
    fn store(self, to: &mut [f32; N_LANES]);
    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `self + a * b`; the product may or may not be rounded first.
    fn plus_product(self, a: Self, b: Self) -> Self;
    /// Held between two limits; not-a-number passes.
    fn hold(self, low: Self, high: Self) -> Self;
}

/// A loop that gains from wide registers.
pub(crate) trait Kernel {
    /// Does the work. Must be `#[inline(always)]`, like all it calls, or it is compiled for the
    /// baseline processor only.
    fn run<L: Lanes>(self);
}

/// Runs `kernel` with the widest instructions this machine has.
pub(crate) fn fastest(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    if avx2::available() {
        // SAFETY: the processor has just been found to have both features.
        unsafe { avx2::run(kernel) };
        return;
    }
    plain(kernel);
}

/// Runs `kernel` with the baseline instructions.
pub(crate) fn plain(kernel: impl Kernel) {
    kernel.run::<Plain>();
}

/// Lanes in an array, which compilers turn into what the baseline has.
#[derive(Clone, Copy)]
struct Plain([f32; N_LANES]);

impl Lanes for Plain {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; N_LANES])
    }

    #[inline(always)]
    fn load(x: &[f32; N_LANES]) -> Self {
        Self(*x)
    }

    #[inline(always)]
    fn load_every<const N: usize>(x: &[f32], at: usize, step: usize) -> [Self; N] {
        let mut all = [Self([0.0; N_LANES]); N];
        for (i, lanes) in all.iter_mut().enumerate() {
            let from = x.get(at + i * step..).and_then(|x| x.first_chunk());
            lanes.0 = *from.expect("beyond the list");
        }
        all
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; N_LANES]) {
        *to = self.0;
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }

    #[inline(always)]
    fn plus_product(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + a.0[i] * b.0[i]))
    }

    #[inline(always)]
    fn hold(self, low: Self, high: Self) -> Self {
        let one = |i: usize| super::kernels::hold(self.0[i], [low.0[i], high.0[i]]);
        Self(std::array::from_fn(one))
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::{
        __m256, _mm256_add_ps, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_max_ps, _mm256_min_ps,
        _mm256_set1_ps, _mm256_storeu_ps,
    };

    use super::{Kernel, Lanes, N_LANES};

    pub(super) fn available() -> bool {
        std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")
    }

    /// Needs AVX2 and FMA; [`Wide`] is made nowhere else.
    #[target_feature(enable = "avx2,fma")]
    pub(super) fn run(kernel: impl Kernel) {
        kernel.run::<Wide>();
    }

    /// Lanes in a register.
    #[derive(Clone, Copy)]
    struct Wide(__m256);

    impl Lanes for Wide {
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: `run` is the only way here, and its caller found the features.
            Self(unsafe { _mm256_set1_ps(x) })
        }

        #[inline(always)]
        fn load(x: &[f32; N_LANES]) -> Self {
            // SAFETY: features as in `splat`; the reference covers eight numbers.
            Self(unsafe { _mm256_loadu_ps(x.as_ptr()) })
        }

        #[inline(always)]
        fn load_every<const N: usize>(x: &[f32], at: usize, step: usize) -> [Self; N] {
            let mut all = [Self::splat(0.0); N];
            let end = step
                .checked_mul(N.saturating_sub(1))
                .and_then(|last| last.checked_add(at)?.checked_add(N_LANES));
            assert!(end.is_some_and(|end| end <= x.len()), "beyond the list");
            for (i, lanes) in all.iter_mut().enumerate() {
                // SAFETY: features as in `splat`; the last place, which is the farthest, has just
                // been found to leave room for eight numbers.
                lanes.0 = unsafe { _mm256_loadu_ps(x.as_ptr().add(at + i * step)) };
            }
            all
        }

        #[inline(always)]
        fn store(self, to: &mut [f32; N_LANES]) {
            // SAFETY: features as in `splat`; the reference covers eight numbers.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            // SAFETY: features as in `splat`.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn plus_product(self, a: Self, b: Self) -> Self {
            // SAFETY: features as in `splat`.
            Self(unsafe { _mm256_fmadd_ps(a.0, b.0, self.0) })
        }

        #[inline(always)]
        fn hold(self, low: Self, high: Self) -> Self {
            // The instructions return their second argument for not-a-number.
            // SAFETY: features as in `splat`.
            Self(unsafe { _mm256_min_ps(high.0, _mm256_max_ps(low.0, self.0)) })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Each<'a>(&'a mut Vec<f32>);

    impl Kernel for Each<'_> {
        #[inline(always)]
        fn run<L: Lanes>(self) {
            let x = L::load(&[-2.0, -1.0, 0.0, 0.5, 1.0, 7.0, f32::NAN, f32::INFINITY]);
            let (three, six) = (L::splat(3.0), L::splat(6.0));
            for y in [
                x,
                x.plus(three),
                three.plus_product(x, six),
                x.hold(L::splat(0.0), six),
            ] {
                let mut out = [0.0; N_LANES];
                y.store(&mut out);
                self.0.extend(out);
            }
            let list: Vec<f32> = (0..25).map(|i| i as f32).collect();
            for lanes in L::load_every::<3>(&list, 1, 8) {
                let mut out = [0.0; N_LANES];
                lanes.store(&mut out);
                self.0.extend(out);
            }
        }
    }

    struct Beyond;

    impl Kernel for Beyond {
        #[inline(always)]
        fn run<L: Lanes>(self) {
            let _ = L::load_every::<3>(&[0.0; 24], 1, 8);
        }
    }

    #[test]
    #[should_panic(expected = "beyond the list")]
    fn nothing_is_read_beyond_a_list() {
        fastest(Beyond);
    }

    #[test]
    fn registers_and_arrays_agree() {
        let (mut wide, mut narrow) = (Vec::new(), Vec::new());
        fastest(Each(&mut wide));
        plain(Each(&mut narrow));
        let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&wide), bits(&narrow));
        assert_eq!(&wide[24..30], [0.0, 0.0, 0.0, 0.5, 1.0, 6.0]);
        let list: Vec<f32> = (1..25).map(|i| i as f32).collect();
        assert_eq!(&wide[4 * N_LANES..], list);
    }
}
