//! Whole numbers in place of fractions: learnt shapes in 16-bit steps, codes in 16-bit steps, and their products
//! summed in 32 bits without rounding, two codes in one instruction.

use pulp::{Simd, WithSimd};

use crate::blocks::WIDE;

/// What two neighbouring codes multiply.
pub(crate) type Two = [i16; 2];

/// The steps of two codes' shapes in one coordinate of every vertex of a block; or two codes of every frame of a group.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Steps(pub [Two; WIDE]);

/// The largest step of shapes that so many codes mix. With codes that a [`Coder`] for it makes, no sum leaves 32 bits;
/// where codes are alike and shapes a third of their largest at most places, as much is lost of these as of those.
pub(crate) fn most(n_codes: usize) -> i16 {
    let all = f64::from(i32::MAX) / (0.3 * n_codes.max(1) as f64);
    all.sqrt().min(f64::from(i16::MAX)) as i16
}

/// Codes that are less than this together move nothing that anybody sees, and steps of them would have no number.
const NOTHING: f32 = 1e-20;

/// Codes in steps: every frame has a size of step of its own, as fine as sums allow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coder {
    /// Steps in one of a code.
    per: f32,
    /// What a step is worth.
    pub worth: f32,
}

impl Coder {
    /// For the codes of one frame and shapes of so many steps at `most`. Where a code is not finite, nothing of the
    /// frame is.
    #[inline(always)]
    pub fn of(codes: &[f32], most: i16) -> Self {
        let (mut sum, mut largest) = (0.0f32, 0.0f32);
        for z in codes {
            sum += z.abs();
            largest = largest.max(z.abs());
        }
        if sum < NOTHING || !sum.is_finite() {
            return Self {
                per: 0.0,
                worth: 0.0 * sum,
            };
        }
        // Half a step of each code may be lost to rounding, and the sum of sizes itself is rounded.
        let all = (f64::from(i32::MAX) / f64::from(most)) as f32 * 0.999;
        let per = ((all - 0.5 * codes.len() as f32) / sum).min(f32::from(i16::MAX) / largest);
        Self {
            per,
            worth: 1.0 / per,
        }
    }

    /// Codes in steps, two by two; the last may be alone.
    #[inline(always)]
    pub fn twos(&self, codes: &[f32]) -> impl Iterator<Item = Two> {
        let two = |z: &[f32]| [self.steps(z[0]), z.get(1).map_or(0, |z| self.steps(*z))];
        codes.chunks(2).map(two)
    }

    /// A code in steps.
    #[inline(always)]
    fn steps(&self, code: f32) -> i16 {
        (code * self.per).round_ties_even() as i16
    }
}

/// How a processor sums products of steps, sixteen sums side by side.
pub(crate) trait Sums: Copy {
    /// Sixteen sums.
    type Sum: Copy;
    /// Sixteen times two steps.
    type Row: Copy;
    /// Sums of nothing.
    fn none(self) -> Self::Sum;
    /// From memory.
    fn row(self, steps: &Steps) -> Self::Row;
    /// The same two steps sixteen times.
    fn alike(self, two: Two) -> Self::Row;
    /// Each sum and the products of its two steps.
    fn plus(self, sum: Self::Sum, a: Self::Row, b: Self::Row) -> Self::Sum;
    /// As floats.
    fn floats(self, sum: Self::Sum) -> [f32; WIDE];
    /// Rows for columns.
    fn turned(self, rows: Square) -> Square;
}

/// Eight rows of eight.
pub(crate) type Square = [[f32; 8]; 8];

/// What any processor can do.
#[derive(Clone, Copy)]
pub(crate) struct Plain;

impl Sums for Plain {
    type Sum = [i32; WIDE];
    type Row = [Two; WIDE];

    #[inline(always)]
    fn none(self) -> Self::Sum {
        [0; WIDE]
    }

    #[inline(always)]
    fn row(self, steps: &Steps) -> Self::Row {
        steps.0
    }

    #[inline(always)]
    fn alike(self, two: Two) -> Self::Row {
        [two; WIDE]
    }

    #[inline(always)]
    fn plus(self, mut sum: Self::Sum, a: Self::Row, b: Self::Row) -> Self::Sum {
        for (sum, (a, b)) in sum.iter_mut().zip(a.iter().zip(&b)) {
            let [p, q] = [0, 1].map(|k| i32::from(a[k]) * i32::from(b[k]));
            *sum += p + q;
        }
        sum
    }

    #[inline(always)]
    fn floats(self, sum: Self::Sum) -> [f32; WIDE] {
        sum.map(|x| x as f32)
    }

    #[inline(always)]
    fn turned(self, rows: Square) -> Square {
        std::array::from_fn(|i| rows.map(|row| row[i]))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::__m256;

    use pulp::x86::{V3, V4};
    use pulp::{Simd, WithSimd, cast, i16x16, i16x32, i32x8, i32x16};

    use super::{Job, Square, Steps, Sums, Two, WIDE, With};

    pulp::simd_type! {
        /// [`V4`] on processors that multiply pairs of steps and add them to a sum in one instruction (`vpdpwssd`): the
        /// compiler takes it in place of [`Sums::plus`]'s two wherever it may.
        pub(super) struct Summing {
            pub avx512f: "avx512f",
            pub avx512bw: "avx512bw",
            pub avx512cd: "avx512cd",
            pub avx512dq: "avx512dq",
            pub avx512vl: "avx512vl",
            pub avx512vnni: "avx512vnni",
            pub fma: "fma",
            pub bmi1: "bmi1",
            pub bmi2: "bmi2",
            pub lzcnt: "lzcnt",
            pub popcnt: "popcnt",
        }
    }

    impl Summing {
        /// Does a job with them.
        pub fn run(self, v4: V4, job: impl Job) {
            self.vectorize(
                #[inline(always)]
                || With(job, v4).with_simd(v4),
            );
        }
    }

    /// A pair of steps as one number of twice the width.
    #[inline(always)]
    fn one(two: Two) -> i32 {
        cast(two)
    }

    impl Sums for V4 {
        type Sum = i32x16;
        type Row = i16x32;

        #[inline(always)]
        fn none(self) -> i32x16 {
            self.splat_i32x16(0)
        }

        #[inline(always)]
        fn row(self, steps: &Steps) -> i16x32 {
            cast(steps.0)
        }

        #[inline(always)]
        fn alike(self, two: Two) -> i16x32 {
            cast(self.splat_i32x16(one(two)))
        }

        #[inline(always)]
        fn plus(self, sum: i32x16, a: i16x32, b: i16x32) -> i32x16 {
            let both = self.multiply_wrapping_add_adjacent_i16x32(a, b);
            self.add_i32s(sum, both)
        }

        #[inline(always)]
        fn floats(self, sum: i32x16) -> [f32; WIDE] {
            cast(self.convert_i32x16_to_f32x16(sum))
        }

        #[inline(always)]
        fn turned(self, rows: Square) -> Square {
            (*self).turned(rows)
        }
    }

    impl Sums for V3 {
        type Sum = [i32x8; 2];
        type Row = [i16x16; 2];

        #[inline(always)]
        fn none(self) -> [i32x8; 2] {
            [self.splat_i32x8(0); 2]
        }

        #[inline(always)]
        fn row(self, steps: &Steps) -> [i16x16; 2] {
            cast(steps.0)
        }

        #[inline(always)]
        fn alike(self, two: Two) -> [i16x16; 2] {
            [cast(self.splat_i32x8(one(two))); 2]
        }

        #[inline(always)]
        fn plus(self, sum: [i32x8; 2], a: [i16x16; 2], b: [i16x16; 2]) -> [i32x8; 2] {
            let both = |k: usize| self.multiply_wrapping_add_adjacent_i16x16(a[k], b[k]);
            [
                self.add_i32s(sum[0], both(0)),
                self.add_i32s(sum[1], both(1)),
            ]
        }

        #[inline(always)]
        fn floats(self, sum: [i32x8; 2]) -> [f32; WIDE] {
            cast([
                self.convert_i32x8_to_f32x8(sum[0]),
                self.convert_i32x8_to_f32x8(sum[1]),
            ])
        }

        #[inline(always)]
        fn turned(self, rows: Square) -> Square {
            let on = self.avx;
            let r = |i: usize| -> __m256 { cast(rows[i]) };
            // Pairs of rows, then fours, then eights.
            let low = |i: usize| on._mm256_unpacklo_ps(r(2 * i), r(2 * i + 1));
            let high = |i: usize| on._mm256_unpackhi_ps(r(2 * i), r(2 * i + 1));
            let fours = |a, b| {
                [
                    on._mm256_shuffle_ps::<0x44>(a, b),
                    on._mm256_shuffle_ps::<0xee>(a, b),
                ]
            };
            let above = [fours(low(0), low(1)), fours(high(0), high(1))];
            let below = [fours(low(2), low(3)), fours(high(2), high(3))];
            let first = |k: usize| {
                let (a, b) = (above[k / 2][k % 2], below[k / 2][k % 2]);
                cast(on._mm256_permute2f128_ps::<0x20>(a, b))
            };
            let last = |k: usize| {
                let (a, b) = (above[k / 2][k % 2], below[k / 2][k % 2]);
                cast(on._mm256_permute2f128_ps::<0x31>(a, b))
            };
            [
                first(0),
                first(1),
                first(2),
                first(3),
                last(0),
                last(1),
                last(2),
                last(3),
            ]
        }
    }
}

/// Work that gains from wide registers.
pub(crate) trait Job {
    /// Does it. `#[inline(always)]`, like all it calls.
    fn run<S: Simd, M: Sums>(self, on: S, sums: M);
}

struct With<J, M>(J, M);

impl<J: Job, M: Sums> WithSimd for With<J, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, on: S) {
        self.0.run(on, self.1);
    }
}

/// Does a job with the widest registers that this machine has.
pub(crate) fn fastest(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(v4) = pulp::x86::V4::try_new() {
            if let Some(all) = x86::Summing::try_new() {
                return all.run(v4, job);
            }
            return Simd::vectorize(v4, With(job, v4));
        }
        if let Some(v3) = pulp::x86::V3::try_new() {
            return Simd::vectorize(v3, With(job, v3));
        }
    }
    pulp::Arch::new().dispatch(With(job, Plain));
}

/// Does a job that is written as plain loops over lanes: what is compiled for AVX-512 gathers lanes that lie side by
/// side, and takes several times as long.
pub(crate) fn widely(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return Simd::vectorize(v3, With(job, v3));
    }
    pulp::Arch::new().dispatch(With(job, Plain));
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use muslin_net::learn::Noise;

    use super::*;

    /// Does a job in every way that this machine knows.
    fn each_way(job: impl Job + Copy) {
        job.run(pulp::Scalar::new(), Plain);
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(v3) = pulp::x86::V3::try_new() {
                Simd::vectorize(v3, With(job, v3));
            }
            if let Some(v4) = pulp::x86::V4::try_new() {
                Simd::vectorize(v4, With(job, v4));
                if let Some(all) = x86::Summing::try_new() {
                    all.run(v4, job);
                }
            }
        }
    }

    /// Sums of as many products as there are rows.
    #[derive(Clone, Copy)]
    struct Total<'a> {
        rows: &'a [(Steps, Two)],
        out: &'a RefCell<Vec<[f32; WIDE]>>,
    }

    impl Job for Total<'_> {
        #[inline(always)]
        fn run<S: Simd, M: Sums>(self, _: S, sums: M) {
            let mut sum = sums.none();
            for (row, two) in self.rows {
                sum = sums.plus(sum, sums.row(row), sums.alike(*two));
            }
            self.out.borrow_mut().push(sums.floats(sum));
        }
    }

    #[test]
    fn sums_are_exact_and_alike_on_all_registers() {
        let mut noise = Noise::new(3);
        let mut step = |most: i16| (noise.unit() * 2.0 * f64::from(most)) as i16 - most;
        let rows: Vec<(Steps, Two)> = (0..40)
            .map(|_| {
                let steps = Steps(std::array::from_fn(|_| [step(16_000), step(16_000)]));
                (steps, [step(1500), step(1500)])
            })
            .collect();
        let exact: [f32; WIDE] = std::array::from_fn(|i| {
            let terms = rows
                .iter()
                .flat_map(|(row, two)| [0, 1].map(|k| i64::from(row.0[i][k]) * i64::from(two[k])));
            terms.sum::<i64>() as f32
        });
        let out = RefCell::new(Vec::new());
        each_way(Total {
            rows: &rows,
            out: &out,
        });
        let all = out.into_inner();
        assert!(!all.is_empty());
        for sums in all {
            assert_eq!(sums, exact);
        }
    }

    /// A square, turned.
    #[derive(Clone, Copy)]
    struct Turn<'a>(&'a Square, &'a RefCell<Vec<Square>>);

    impl Job for Turn<'_> {
        #[inline(always)]
        fn run<S: Simd, M: Sums>(self, _: S, sums: M) {
            self.1.borrow_mut().push(sums.turned(*self.0));
        }
    }

    #[test]
    fn a_turned_square_has_columns_for_rows() {
        let rows: Square = std::array::from_fn(|i| std::array::from_fn(|j| (8 * i + j) as f32));
        let out = RefCell::new(Vec::new());
        fastest(Turn(&rows, &out));
        each_way(Turn(&rows, &out));
        let all = out.into_inner();
        assert!(all.len() > 1);
        for turned in all {
            assert_eq!(turned, Plain.turned(rows));
            assert_eq!(turned[2][5], rows[5][2]);
        }
    }

    #[test]
    fn no_codes_lead_out_of_32_bits() {
        // All as large as each other, one far larger than the rest, and many.
        let sets = [
            vec![0.7f32; 1],
            vec![0.7; 80],
            vec![1e-3; 80],
            vec![2.5; 255],
            {
                let mut one = vec![1e-4f32; 79];
                one.push(-30.0);
                one
            },
        ];
        for codes in sets {
            let most = most(codes.len());
            let coder = Coder::of(&codes, most);
            let total: i64 = codes.iter().map(|z| i64::from(coder.steps(*z)).abs()).sum();
            assert!(total * i64::from(most) <= i64::from(i32::MAX), "{total}");
            for z in &codes {
                let back = f32::from(coder.steps(*z)) * coder.worth;
                assert!((back - z).abs() <= 0.51 * coder.worth, "{back} for {z}");
            }
        }
    }

    #[test]
    fn codes_that_are_not_numbers_leave_none() {
        assert!(Coder::of(&[1.0, f32::NAN], 9).worth.is_nan());
        assert!(Coder::of(&[f32::INFINITY], 9).worth.is_nan());
        let nothing = Coder::of(&[0.0; 4], 9);
        assert_eq!((nothing.steps(0.0), nothing.worth), (0, 0.0));
        let little = Coder::of(&[1e-38; 4], 9);
        assert_eq!((little.steps(1e-38), little.worth), (0, 0.0));
    }
}
