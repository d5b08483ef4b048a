//! Which skin a garment may meet.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::DVec3;
use muslin_geom::{Aabb, Bvh};

/// Skin this near to cloth at rest may be met [m].
const AROUND: f64 = 0.10;
/// So may skin that hangs this far out below it [m]: a shin under a skirt, a thigh under a shirt.
const BELOW: f64 = 0.45;
/// Height of the slices that cloth is looked at in [m].
const SLICE: f64 = 0.025;
/// Directions in a slice, and in how many of them cloth must lie where it goes around a point.
const SECTORS: usize = 12;
const CLOSED: usize = 11;

/// A cloth at rest, ready to be asked what is around it.
pub(crate) struct Resting<'x> {
    /// Its vertices [m].
    x: &'x [DVec3],
    tree: Bvh,
}

impl<'x> Resting<'x> {
    pub fn new(x: &'x [DVec3]) -> Self {
        let boxes: Vec<Aabb> = x.iter().map(|p| Aabb::of(&[*p])).collect();
        let tree = Bvh::over(&boxes);
        Self { x, tree }
    }

    /// Whether a point lies within `far` of it [m].
    pub fn is_near(&self, p: DVec3, far: f64) -> bool {
        let square = |k: u32| self.x[k as usize].distance_squared(p);
        self.tree.nearest(p, far * far, square).is_some()
    }

    /// Which of the points of a skin it may meet in some pose: those near to it at rest, those that it goes around
    /// however wide it hangs, and those that hang out below it. Hands beside a skirt are none of these.
    pub fn meets(&self, skin: &[DVec3]) -> Vec<bool> {
        let low = self.x.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let slice = |y: f64| ((y - low) / SLICE) as i64;
        let mut slices: BTreeMap<i64, Vec<[f64; 2]>> = BTreeMap::new();
        for p in self.x {
            for k in -1..=1 {
                let slice = slices.entry(slice(p.y) + k).or_default();
                slice.push([p.x, p.z]);
            }
        }
        let is_worn = |p: &DVec3| {
            let ring = slices.get(&slice(p.y.max(low)));
            ring.is_some_and(|ring| p.y > low - BELOW && goes_around(ring, [p.x, p.z]))
        };
        let meets = |p: &DVec3| self.is_near(*p, AROUND) || is_worn(p);
        skin.iter().map(meets).collect()
    }
}

/// Whether points lie all around another.
fn goes_around(ring: &[[f64; 2]], p: [f64; 2]) -> bool {
    let mut seen = [false; SECTORS];
    for [x, z] in ring {
        let turn = (z - p[1]).atan2(x - p[0]) / TAU + 0.5;
        seen[(turn * SECTORS as f64) as usize % SECTORS] = true;
    }
    seen.into_iter().filter(|s| *s).count() >= CLOSED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_skirt_meets_the_legs_in_it_and_below_it_and_no_hand_beside_it() {
        let wall = |share: f64| -> Vec<DVec3> {
            let around = (0..40).map(move |k| TAU * share * f64::from(k) / 40.0);
            around
                .flat_map(|a| (0..26).map(move |k| (a, 0.5 + 0.02 * f64::from(k))))
                .map(|(a, y)| DVec3::new(0.3 * a.cos(), y, 0.3 * a.sin()))
                .collect()
        };
        let skin = [
            DVec3::new(0.05, 0.8, 0.05),
            DVec3::new(-0.1, 0.2, 0.1),
            DVec3::new(0.35, 0.8, 0.0),
            DVec3::new(0.45, 0.8, 0.0),
            DVec3::new(0.45, 0.3, 0.0),
            DVec3::new(0.0, 0.0, 0.0),
            DVec3::new(0.0, 1.2, 0.0),
        ];
        let whole = [true, true, true, false, false, false, false];
        assert_eq!(Resting::new(&wall(1.0)).meets(&skin), whole);
        let apron = [false, false, true, false, false, false, false];
        assert_eq!(Resting::new(&wall(0.5)).meets(&skin), apron, "open behind");
    }
}
