//! Who may meet whom while everything moves: boxes that see relative motion alone.
//!
//! Boxes that travel together are as far apart at the end as at the start, however far they go. So
//! each carries, beside the box of where its points are, the box of how they move, and two are
//! compared by what one does as seen from the other.

use glam::{DVec3, Vec3A};

/// Something on its way: its box, and the box of how its points move, in single precision [m].
#[derive(Clone, Copy, Debug)]
pub struct Swept {
    low: Vec3A,
    high: Vec3A,
    least: Vec3A,
    most: Vec3A,
}

/// Room for rounding at a few metres from the origin [m].
const ROUNDING: f64 = 2e-6;

impl Swept {
    /// A point that goes straight by `by` [m]. Two that come within `margin` [m] of each other, on
    /// every axis, count as meeting. `at` is best measured from something near.
    pub fn point(at: DVec3, by: DVec3, margin: f64) -> Swept {
        let (room, by) = (0.5 * margin + ROUNDING, by.as_vec3a());
        Swept {
            low: (at - room).as_vec3a(),
            high: (at + room).as_vec3a(),
            least: by,
            most: by,
        }
    }

    /// Both together.
    #[inline]
    pub fn union(self, other: Swept) -> Swept {
        Swept {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            least: self.least.min(other.least),
            most: self.most.max(other.most),
        }
    }

    /// Whether the two may touch on the way, axis by axis, as seen from the other.
    #[inline]
    pub fn meets(&self, other: &Swept) -> bool {
        let back = (self.least - other.most).min(Vec3A::ZERO);
        let forth = (self.most - other.least).max(Vec3A::ZERO);
        let apart = (self.low + back).cmpgt(other.high) | other.low.cmpgt(self.high + forth);
        !apart.any()
    }

    /// The most that a point of one moves as seen from one of the other [m].
    #[inline]
    pub fn drift(&self, other: &Swept) -> f32 {
        let drift = (self.most - other.least).max(other.most - self.least);
        drift.max(Vec3A::ZERO).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{bvh::Aabb, testing::Rng};

    /// Random small triangles that fly about, most of them together.
    fn swarm(n: usize, seed: u64) -> (Vec<[DVec3; 3]>, Vec<[DVec3; 3]>) {
        let mut rng = Rng(seed);
        let wind = DVec3::new(5.0, -3.0, 2.0);
        (0..n)
            .map(|_| {
                let p = rng.vec();
                let own = (rng.vec() - 0.5) * 0.2;
                let corner = |rng: &mut Rng| p + (rng.vec() - 0.5) * 0.05;
                let at = [corner(&mut rng), corner(&mut rng), corner(&mut rng)];
                (at, [wind + own, wind + own * 1.1, wind + own * 0.9])
            })
            .unzip()
    }

    #[test]
    fn every_pair_that_comes_near_meets_and_the_wind_wakes_nobody() {
        let (at, moves) = swarm(300, 3);
        let way = |(at, moves): (&[DVec3; 3], &[DVec3; 3])| {
            let [a, b, c] = [0, 1, 2].map(|k| Swept::point(at[k], moves[k], 0.01));
            a.union(b).union(c)
        };
        let ways: Vec<Swept> = at.iter().zip(&moves).map(way).collect();
        let boxes_at = |i: usize, s: f64| {
            let moved: [DVec3; 3] = std::array::from_fn(|k| at[i][k] + moves[i][k] * s);
            Aabb::of(&moved)
        };
        let (mut met, mut said) = (0, 0);
        for i in 0..at.len() {
            for j in i + 1..at.len() {
                let near = (0..=50).any(|s| {
                    let s = f64::from(s) / 50.0;
                    boxes_at(i, s).grown(0.01).overlaps(&boxes_at(j, s))
                });
                let says = ways[i].meets(&ways[j]);
                met += usize::from(near);
                said += usize::from(says);
                assert!(!near || says, "{i} and {j} meet");
            }
        }
        assert!(met > 30 && said < 4 * met, "{said} for {met}");
    }
}
