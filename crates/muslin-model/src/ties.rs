//! Cloth that swings is not stretched: points that stand for it stay as near to each other as it lets them.
//!
//! Swings are shapes of small motions. Swung by a hand's breadth they would stretch cloth, and legs in a stride turn
//! two halves of a skirt two ways.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{Mat3A, Vec3A};
use pulp::Simd;

use crate::layers::Dense;
use crate::walls::{dot, faint};
use crate::{Model, Sway};

/// How much longer than along the cloth's edges at rest a pair may be: so far cloth gives.
const GIVES: f32 = 1.05;
/// Rounds over the ties in a step.
const ROUNDS: usize = 3;
/// Swings at most that ties have room for; cloth with more has none.
const MOST: usize = 64;

/// Pairs of neighbouring points, and how far apart they may be.
#[derive(Clone, Debug)]
pub(crate) struct Ties {
    pub pairs: Vec<[u32; 2]>,
    /// In metres.
    pub longest: Vec<f32>,
    /// What is added to how much longer a pair becomes by the push that makes it so ([`faint`]).
    pub faint: f32,
    /// Where the points are [m].
    at: Vec<Vec3A>,
}

/// What ties hold: the points and their swings.
pub(crate) struct Held<'a> {
    /// Where every point rests [m], and how bones turn it.
    pub here: &'a [(Vec3A, Mat3A)],
    /// The swings at every point: three rows with one entry per code; and from codes to ways [m].
    pub means: &'a [f32],
    pub ways: &'a Dense,
    /// The inverse of a step's system, by rows.
    pub inverse: &'a [f32],
    /// Room for the ways.
    pub each: &'a mut [f32],
}

impl Ties {
    pub fn new(model: &Model, sway: &Sway) -> Self {
        let x: Vec<Vec3A> = model.laid().into_iter().map(Vec3A::from_array).collect();
        let near = neighbours(x.len(), &model.faces);
        let (owner, far) = nearest(&x, &near, &sway.samples);
        let mut all: Vec<([u32; 2], f32)> = Vec::new();
        for (v, row) in near.iter().enumerate() {
            for &w in row {
                let (a, b) = (owner[v], owner[w as usize]);
                if a < b && b != NOBODY {
                    let long = far[v] + x[v].distance(x[w as usize]) + far[w as usize];
                    all.push(([a, b], long));
                }
            }
        }
        // The shortest of each pair's ways.
        all.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        all.dedup_by_key(|t| t.0);
        if sway.len() > MOST {
            all.clear();
        }
        Self {
            pairs: all.iter().map(|t| t.0).collect(),
            longest: all.iter().map(|t| GIVES * t.1).collect(),
            faint: 0.0,
            at: vec![Vec3A::ZERO; sway.samples.len()],
        }
    }

    /// Gets ready for steps of that inverse system, where swings move the points by these rows.
    pub fn ready(&mut self, means: &[f32], inverse: &[f32], k: usize) {
        let moved = |row: &[f32]| -> f32 {
            let pushed = inverse.chunks_exact(k).map(|i| dot(i, row));
            pushed.zip(row).map(|(p, r)| p * r).sum()
        };
        let points = means.chunks_exact(3 * k);
        let each = points.map(|rows| rows.chunks_exact(k).map(moved).sum::<f32>());
        self.faint = faint(each);
    }

    /// Leads codes to where all of them are long enough, as far as a few rounds get; whether any was not. A pair that
    /// the pose alone leaves farther apart may be as far.
    #[inline(always)]
    pub fn hold<S: Simd>(&mut self, on: S, held: Held<'_>, q: &mut [f32]) -> bool {
        if self.pairs.is_empty() {
            return false;
        }
        let k = q.len();
        let (mut led, mut first) = (false, [0.0f32; MOST]);
        for _ in 0..ROUNDS {
            held.ways.apply(on, q, held.each);
            let ways = held.each.as_chunks::<3>().0;
            for ((at, way), (y, turn)) in self.at.iter_mut().zip(ways).zip(held.here) {
                *at = *y + *turn * Vec3A::from_array(*way);
            }
            first[..k].copy_from_slice(q);
            let mut all_held = true;
            for (&[i, j], longest) in self.pairs.iter().zip(&self.longest) {
                let (i, j) = (i as usize, j as usize);
                let apart = self.at[j] - self.at[i];
                if apart.length_squared() <= longest * longest {
                    continue;
                }
                let (still, long) = (held.here[j].0 - held.here[i].0, apart.length());
                let most = longest.max(still.length());
                if long <= most {
                    continue;
                }
                let row = row(&held, [i, j], apart / long, k);
                let since = row.iter().zip(q.iter().zip(&first));
                let beyond = long - most + since.map(|(r, (q, f))| r * (q - f)).sum::<f32>();
                if beyond <= 0.0 {
                    continue;
                }
                all_held = false;
                let mut push = [0.0f32; MOST];
                for (p, inverse) in push.iter_mut().zip(held.inverse.chunks_exact(k)) {
                    *p = dot(inverse, &row[..k]);
                }
                let by = beyond / (dot(&push[..k], &row[..k]) + self.faint).max(f32::MIN_POSITIVE);
                q.iter_mut().zip(&push).for_each(|(q, p)| *q -= by * p);
            }
            if all_held {
                break;
            }
            led = true;
        }
        led
    }
}

/// How much longer a pair becomes by each swing, where it lies along a unit vector.
#[inline(always)]
fn row(held: &Held<'_>, pair: [usize; 2], along: Vec3A, k: usize) -> [f32; MOST] {
    let mut out = [0.0f32; MOST];
    for (p, sign) in pair.into_iter().zip([-1.0, 1.0]) {
        let [x, y, z] = (held.here[p].1.transpose() * along * sign).to_array();
        let rows = &held.means[3 * k * p..3 * k * (p + 1)];
        let columns = rows[..k].iter().zip(&rows[k..2 * k]).zip(&rows[2 * k..]);
        for (o, ((a, b), c)) in out.iter_mut().zip(columns) {
            *o += x * a + y * b + z * c;
        }
    }
    out
}

/// The vertices that share an edge with each.
fn neighbours(n: usize, faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut near = vec![Vec::new(); n];
    for f in faces {
        for k in 0..3 {
            near[f[k] as usize].extend([f[(k + 1) % 3], f[(k + 2) % 3]]);
        }
    }
    near
}

/// A vertex that no point is joined to.
const NOBODY: u32 = u32::MAX;

/// Along the cloth's edges the nearest of these points for every vertex, and how far it is [m].
fn nearest(x: &[Vec3A], near: &[Vec<u32>], points: &[u32]) -> (Vec<u32>, Vec<f32>) {
    let (mut owner, mut far) = (vec![NOBODY; x.len()], vec![f32::INFINITY; x.len()]);
    // Distances are positive: their bits are ordered as they are.
    let mut next = BinaryHeap::new();
    for (p, &v) in points.iter().enumerate() {
        (owner[v as usize], far[v as usize]) = (p as u32, 0.0);
        next.push(Reverse((0, v)));
    }
    while let Some(Reverse((bits, v))) = next.pop() {
        let here = f32::from_bits(bits);
        if here > far[v as usize] {
            continue;
        }
        for &w in &near[v as usize] {
            let there = here + x[v as usize].distance(x[w as usize]);
            if there < far[w as usize] {
                (owner[w as usize], far[w as usize]) = (owner[v as usize], there);
                next.push(Reverse((there.to_bits(), w)));
            }
        }
    }
    (owner, far)
}
