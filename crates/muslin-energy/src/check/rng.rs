//! Random states that are the same on every machine.

use glam::DVec3;

/// SplitMix64 (Steele et al. 2014): small, and good enough to scatter states.
#[derive(Clone, Debug)]
pub struct Rng(u64);

impl Rng {
    /// The sequence of a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// Uniform in the logarithm between two positive numbers: every scale equally often.
    pub fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Uniform in the cube `[−1, 1)³`.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| self.between(-1.0, 1.0)))
    }

    /// A direction of unit length in the space of `N` points.
    pub fn direction<const N: usize>(&mut self) -> [DVec3; N] {
        let p = [DVec3::ZERO; N].map(|_| self.vector());
        let length = p.iter().map(|v| v.length_squared()).sum::<f64>().sqrt();
        p.map(|v| v / length)
    }
}
