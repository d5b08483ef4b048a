//! Shapes in steps of 12 and of 8 bits.

use half::f16;

/// Steps to either side of nothing.
const MOST: f32 = 2047.0;
/// What nothing is written as.
const ZERO: f32 = 2048.0;

/// What a step of each of `k` columns is worth, `most` of which make its largest entry.
fn steps_of(rows: &[f32], k: usize, most: f32) -> Vec<f32> {
    let largest = |c: usize| {
        let column = rows.iter().skip(c).step_by(k.max(1));
        column.fold(f32::MIN_POSITIVE, |a, x| a.max(x.abs()))
    };
    (0..k).map(|c| largest(c) / most).collect()
}

/// Bytes of a row of `k` entries.
pub(crate) fn bytes_of(k: usize) -> usize {
    (3 * k).div_ceil(2)
}

/// Rows of entries in 12-bit steps: an entry is its count times what a step of its column is worth [m] times
/// what its row is.
///
/// Two counts take three bytes: the low byte of the first, its high half byte below the low one of the second,
/// the high byte of the second.
pub(crate) struct Packed {
    pub bytes: Vec<u8>,
    pub steps: Vec<f32>,
    /// As 16-bit floats.
    pub rows: Vec<u16>,
}

impl Packed {
    /// Of rows of `k` entries.
    pub fn new(flat: &[f32], k: usize) -> Self {
        let mut out = Self {
            bytes: Vec::with_capacity(flat.len() / k.max(1) * bytes_of(k)),
            steps: steps_of(flat, k, MOST),
            rows: Vec::new(),
        };
        for row in flat.chunks_exact(k.max(1)) {
            let counts: Vec<f32> = row.iter().zip(&out.steps).map(|(x, s)| x / s).collect();
            let share = counts.iter().fold(0.0f32, |a, x| a.max(x.abs())) / MOST;
            let share = f16::from_f32(share);
            let worth = share.to_f32().max(f32::MIN_POSITIVE);
            let count = |x: &f32| ((x / worth).round().clamp(-MOST, MOST) + ZERO) as u16;
            for pair in counts.chunks(2) {
                let a = count(&pair[0]);
                let b = pair.get(1).map_or(0, count);
                let three = [a as u8, (a >> 8 | (b & 15) << 4) as u8, (b >> 4) as u8];
                out.bytes.extend(&three[..1 + pair.len()]);
            }
            out.rows.push(share.to_bits());
        }
        out
    }
}

/// The counts of a row, and perhaps one more.
pub(crate) fn unpacked(bytes: &[u8]) -> impl Iterator<Item = f32> {
    let pair = |three: &[u8]| {
        let at = |k: usize| three.get(k).map_or(0, |b| u16::from(*b));
        [at(0) | (at(1) & 15) << 8, at(1) >> 4 | at(2) << 4]
    };
    let counts = bytes.chunks(3).flat_map(pair);
    counts.map(|count| f32::from(count) - ZERO)
}

/// Rows of `k` entries in 8-bit steps around 128, and what a step of each is worth: swings are smooth,
/// and one of 6 cm is off by a quarter of a millimetre at most.
pub(crate) fn stepped(rows: &[f32], k: usize) -> (Vec<f32>, Vec<u8>) {
    let steps = steps_of(rows, k, 127.0);
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
        for k in [1, 2, 7, 8] {
            let flat: Vec<f32> = Noise::new(3).normals(5 * k);
            let packed = Packed::new(&flat, k);
            assert_eq!(packed.bytes.len(), 5 * bytes_of(k));
            for v in 0..5 {
                let worth = f16::from_bits(packed.rows[v]).to_f32();
                let row = &packed.bytes[v * bytes_of(k)..(v + 1) * bytes_of(k)];
                for (c, count) in unpacked(row).take(k).enumerate() {
                    let step = worth * packed.steps[c];
                    let off = (count * step - flat[v * k + c]).abs();
                    // The last step may be cut by the row's own rounding.
                    let most = if count.abs() == MOST { 1.05 } else { 0.501 };
                    assert!(off <= most * step, "{k} {v} {c}: {off} of {step}");
                }
            }
        }
    }

    #[test]
    fn nothing_stays_nothing() {
        let packed = Packed::new(&[0.0; 6], 3);
        assert!(
            unpacked(&packed.bytes[..5])
                .take(3)
                .all(|count| count == 0.0)
        );
        assert_eq!(packed.rows, [0, 0]);
    }
}
