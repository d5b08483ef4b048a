//! Principal modes of adult bodies.
//!
//! With terms `T` (rows) and coefficients `c` of mean `c̄` and covariance `S²` over a broad
//! population of adults, the shapes `x = template + Tᵀ c` have covariance `Tᵀ S² T`. Its
//! eigenvectors follow from the small matrix `A = S G S`, `G = T Tᵀ`: for `A u = λ u` the mode
//! `Tᵀ S u` has a weight of unit variance, `w = uᵀ S G (c − c̄) / λ`.

use super::eigen;
use super::targets::Term;
use glam::DVec3;
use muslin_body::Blend;

/// Modes below this share of a step in every coordinate (RMS) are rounding to be left out [m].
const SMALLEST: f64 = 2.0e-6;

/// Never more modes than this.
const MOST: usize = 168;

/// How much more an anchor counts than a vertex.
const ANCHOR: f64 = 20.0;

/// How many adults the covariance is taken over.
const ADULTS: usize = 6000;

/// The mean's points, the modes, and the matrix from terms to mode weights.
pub fn principal(
    template: &[DVec3],
    n_verts: usize,
    terms: &[Term],
) -> (Vec<DVec3>, Vec<f32>, Blend) {
    let n = terms.len();
    let mut blend = Blend {
        terms: terms.iter().map(|t| t.tags.clone()).collect(),
        ..Blend::default()
    };
    let (mean_c, covariance) = population(&blend);
    let root = eigen::symmetric(covariance, n).root();
    let gram = gram(terms, 3 * n_verts);
    let sg = product(&root, &gram, n);
    let found = eigen::symmetric(product(&sg, &root, n), n);
    let kept = found
        .values
        .iter()
        .take(MOST)
        .filter(|&&l| keeps(l, template.len()))
        .count();
    let mut modes = Vec::new();
    for m in 0..kept {
        let u = found.vector(m);
        modes.extend(combine(terms, &times(&root, u)));
        // uᵀ S G is a column of (S G)ᵀ u.
        let row: Vec<f64> = (0..n)
            .map(|j| (0..n).map(|i| u[i] * sg[i * n + j]).sum::<f64>() / found.values[m])
            .collect();
        blend
            .bias
            .push(-row.iter().zip(&mean_c).map(|(p, c)| p * c).sum::<f64>());
        blend.projection.extend(row);
    }
    let shift = combine(terms, &mean_c);
    let moved = |(p, d): (&DVec3, &[f32; 3])| *p + DVec3::from(d.map(f64::from));
    (
        template
            .iter()
            .zip(shift.as_chunks().0)
            .map(moved)
            .collect(),
        modes,
        blend,
    )
}

fn keeps(value: f64, n_points: usize) -> bool {
    value > 0.0 && (value / (3 * n_points) as f64).sqrt() > SMALLEST
}

/// Mean and covariance of the terms' coefficients over adults.
///
/// Half of all phenotypes are spread evenly, half sit at an end of their range, so that
/// corners of the grid, where errors are largest, weigh as much as what is common.
fn population(blend: &Blend) -> (Vec<f64>, Vec<f64>) {
    let n = blend.terms.len();
    let mut random = Random(0x5EED);
    let people: Vec<Vec<f64>> = (0..ADULTS)
        .map(|_| blend.terms_at(&adult(&mut random)))
        .collect();
    let mut mean = vec![0.0; n];
    for c in &people {
        c.iter()
            .zip(&mut mean)
            .for_each(|(c, m)| *m += c / ADULTS as f64);
    }
    let mut covariance = vec![0.0; n * n];
    for c in &people {
        let d: Vec<f64> = c.iter().zip(&mean).map(|(c, m)| c - m).collect();
        for i in 0..n {
            for j in 0..n {
                covariance[i * n + j] += d[i] * d[j] / ADULTS as f64;
            }
        }
    }
    (mean, covariance)
}

fn adult(random: &mut Random) -> [f64; 11] {
    let mut p = [0.0; 11];
    for x in &mut p {
        let spread = random.unit();
        *x = if random.unit() < 0.5 {
            spread
        } else {
            spread.round()
        };
    }
    p[1] = 2.0 / 3.0 + p[1] / 3.0;
    p
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// `T Tᵀ`, where the anchors (beyond the first `n` coordinates) count [`ANCHOR`] times.
///
/// Where a joint is off, everything beyond it turns about the wrong point.
fn gram(terms: &[Term], n_coordinates: usize) -> Vec<f64> {
    let dot = |a: &[f32], b: &[f32]| {
        let (a, b) = (a.split_at(n_coordinates), b.split_at(n_coordinates));
        dot(a.0, b.0) + ANCHOR * dot(a.1, b.1)
    };
    let n = terms.len();
    let mut g = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let both = dot(&terms[i].moves, &terms[j].moves);
            g[i * n + j] = both;
            g[j * n + i] = both;
        }
    }
    g
}

/// Four sums side by side, so that they need not wait for each other.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f64; 4];
    for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
        for k in 0..4 {
            sums[k] += f64::from(a[k]) * f64::from(b[k]);
        }
    }
    let rest = a.len() / 4 * 4;
    let tail: f64 = a[rest..]
        .iter()
        .zip(&b[rest..])
        .map(|(a, b)| f64::from(*a) * f64::from(*b))
        .sum();
    sums.iter().sum::<f64>() + tail
}

fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            let x = a[i * n + k];
            for j in 0..n {
                out[i * n + j] += x * b[k * n + j];
            }
        }
    }
    out
}

fn times(a: &[f64], x: &[f64]) -> Vec<f64> {
    a.chunks(x.len())
        .map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum())
        .collect()
}

/// `Tᵀ c`.
fn combine(terms: &[Term], c: &[f64]) -> Vec<f32> {
    let mut sum = vec![0.0f64; terms[0].moves.len()];
    for (term, c) in terms.iter().zip(c) {
        sum.iter_mut()
            .zip(&term.moves)
            .for_each(|(s, x)| *s += c * f64::from(*x));
    }
    sum.into_iter().map(|s| s as f32).collect()
}
