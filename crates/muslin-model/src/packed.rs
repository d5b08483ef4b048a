//! Shapes in steps of 12 and of 8 bits.

use half::f16;

/// How finely entries of shapes are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Steps {
    /// Two counts of 12 bits in three bytes: the low byte of the first, its high half byte below the low one of the
    /// second, the high byte of the second.
    Twelve,
    /// A byte each.
    Eight,
}

impl Steps {
    /// Steps to either side of nothing.
    fn most(self) -> f32 {
        match self {
            Self::Twelve => 2047.0,
            Self::Eight => 127.0,
        }
    }

    /// What nothing is written as.
    fn zero(self) -> f32 {
        self.most() + 1.0
    }

    /// Bytes of a row of `k` entries.
    pub fn bytes_of(self, k: usize) -> usize {
        match self {
            Self::Twelve => (3 * k).div_ceil(2),
            Self::Eight => k,
        }
    }

    fn write(self, counts: &[u16], out: &mut Vec<u8>) {
        match self {
            Self::Eight => out.extend(counts.iter().map(|c| *c as u8)),
            Self::Twelve => {
                for pair in counts.chunks(2) {
                    let (a, b) = (pair[0], pair.get(1).map_or(0, |b| *b));
                    let three = [a as u8, (a >> 8 | (b & 15) << 4) as u8, (b >> 4) as u8];
                    out.extend(&three[..1 + pair.len()]);
                }
            }
        }
    }

    /// The counts of a row, and perhaps one more.
    pub fn read(self, bytes: &[u8]) -> impl Iterator<Item = f32> {
        let (wide, zero) = (if self == Self::Twelve { 3 } else { 1 }, self.zero());
        let counts = bytes.chunks(wide).flat_map(move |some| {
            let at = |k: usize| some.get(k).map_or(0, |b| u16::from(*b));
            let pair = [at(0) | (at(1) & 15) << 8, at(1) >> 4 | at(2) << 4];
            pair.into_iter().take(if wide == 3 { 2 } else { 1 })
        });
        counts.map(move |count| f32::from(count) - zero)
    }
}

/// What a step of each of `k` columns is worth, `most` of which make its largest entry.
fn steps_of(rows: &[f32], k: usize, most: f32) -> Vec<f32> {
    let largest = |c: usize| {
        let column = rows.iter().skip(c).step_by(k.max(1));
        column.fold(f32::MIN_POSITIVE, |a, x| a.max(x.abs()))
    };
    (0..k).map(|c| largest(c) / most).collect()
}

/// Rows of entries in steps: an entry is its count times what a step of its column is worth [m] times what its row is.
pub(crate) struct Packed {
    pub bytes: Vec<u8>,
    pub steps: Vec<f32>,
    /// As 16-bit floats.
    pub rows: Vec<u16>,
}

impl Packed {
    /// Of rows of `k` entries.
    pub fn new(flat: &[f32], k: usize, fine: Steps) -> Self {
        let most = fine.most();
        let mut out = Self {
            bytes: Vec::with_capacity(flat.len() / k.max(1) * fine.bytes_of(k)),
            steps: steps_of(flat, k, most),
            rows: Vec::new(),
        };
        for row in flat.chunks_exact(k.max(1)) {
            let counts: Vec<f32> = row.iter().zip(&out.steps).map(|(x, s)| x / s).collect();
            let share = counts.iter().fold(0.0f32, |a, x| a.max(x.abs())) / most;
            let share = f16::from_f32(share);
            let worth = share.to_f32().max(f32::MIN_POSITIVE);
            let count = |x: &f32| ((x / worth).round().clamp(-most, most) + fine.zero()) as u16;
            let counts: Vec<u16> = counts.iter().map(count).collect();
            fine.write(&counts, &mut out.bytes);
            out.rows.push(share.to_bits());
        }
        out
    }
}

/// Rows of `k` entries in 8-bit steps around 128, and what a step of each is worth: swings are smooth,
/// and one of 6 cm is off by a quarter of a millimetre at most.
pub(crate) fn stepped(rows: &[f32], k: usize) -> (Vec<f32>, Vec<u8>) {
    let steps = steps_of(rows, k, Steps::Eight.most());
    let byte = |(i, x): (usize, &f32)| ((x / steps[i % k]).round() + 128.0) as u8;
    let bytes = rows.iter().enumerate().map(byte).collect();
    (steps, bytes)
}

/// The way back from [`stepped`].
pub(crate) fn unstepped(bytes: &[u8], steps: &[f32]) -> Vec<f32> {
    let k = steps.len().max(1);
    let entry = |(i, b): (usize, &u8)| (f32::from(*b) - 128.0) * steps.get(i % k).unwrap_or(&0.0);
    bytes.iter().enumerate().map(entry).collect()
}

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;

    #[test]
    fn rows_come_back_within_half_a_step_whether_even_or_odd() {
        for (k, fine) in [1, 2, 7, 8]
            .into_iter()
            .flat_map(|k| [(k, Steps::Twelve), (k, Steps::Eight)])
        {
            let flat: Vec<f32> = Noise::new(3).normals(5 * k);
            let packed = Packed::new(&flat, k, fine);
            let wide = fine.bytes_of(k);
            assert_eq!(packed.bytes.len(), 5 * wide);
            for v in 0..5 {
                let worth = f16::from_bits(packed.rows[v]).to_f32();
                let row = &packed.bytes[v * wide..(v + 1) * wide];
                for (c, count) in fine.read(row).take(k).enumerate() {
                    let step = worth * packed.steps[c];
                    let off = (count * step - flat[v * k + c]).abs();
                    // The last step may be cut by the row's own rounding.
                    let most = if count.abs() == fine.most() {
                        1.05
                    } else {
                        0.501
                    };
                    assert!(off <= most * step, "{k} {fine:?} {v} {c}: {off} of {step}");
                }
            }
        }
    }

    #[test]
    fn nothing_stays_nothing() {
        for fine in [Steps::Twelve, Steps::Eight] {
            let packed = Packed::new(&[0.0; 6], 3, fine);
            let row = &packed.bytes[..fine.bytes_of(3)];
            assert!(fine.read(row).take(3).all(|count| count == 0.0));
            assert_eq!(packed.rows, [0, 0]);
        }
    }
}
