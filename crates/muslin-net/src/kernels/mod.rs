//! The arithmetic: one file per kind of loop, each held to a naive one in its tests.

pub(crate) mod conv;
pub(crate) mod depthwise;
pub(crate) mod matmul;
pub(crate) mod pixels;

/// What happens to a sum on its way out: limits, and something added first.
#[derive(Clone, Copy)]
pub(crate) struct Finish<'a> {
    /// Least and greatest value stored.
    pub limits: [f32; 2],
    /// Added before the limits, value by value.
    pub plus: Option<&'a [f32]>,
}

/// Holds `x` between two limits; not-a-number passes.
#[inline(always)]
pub(crate) fn hold(x: f32, [lo, hi]: [f32; 2]) -> f32 {
    let x = if x < lo { lo } else { x };
    if x > hi { hi } else { x }
}

#[cfg(test)]
pub(crate) mod noise {
    /// Deterministic values in -1..1, without a short period.
    pub(crate) fn values(n: usize, seed: u32) -> Vec<f32> {
        let mut state = seed.wrapping_mul(0x9E37_79B9).wrapping_add(0x7F4A_7C15);
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        (0..n).map(next).collect()
    }

    /// Fails unless all values agree within `tol`.
    pub(crate) fn assert_close(got: &[f32], want: &[f32], tol: f32) {
        assert_eq!(got.len(), want.len());
        for (i, (g, w)) in got.iter().zip(want).enumerate() {
            assert!((g - w).abs() <= tol, "value {i}: {g} instead of {w}");
        }
    }
}
