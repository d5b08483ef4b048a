//! What of a triangle lies before the lens.

use glam::{DVec2, DVec3};

/// Nearest depth that is drawn [m].
pub(crate) const NEAR: f64 = 0.01;
/// How far beyond the picture corners may lie before they are cut off [px].
const GUARD: f64 = 16384.0;

/// The lens as clipping sees it: points are (x right, y down, depth) [m].
#[derive(Clone, Copy)]
pub(crate) struct Lens {
    /// Focal length [px].
    pub focal: f64,
    /// Principal point [px].
    pub centre: DVec2,
    /// Picture size [px].
    pub size: DVec2,
}

impl Lens {
    /// Where a point before the lens falls [px].
    pub fn pixel(&self, p: DVec3) -> DVec2 {
        self.centre + p.truncate() * (self.focal / p.z)
    }

    /// Whether a point needs no clipping.
    pub fn is_safe(&self, p: DVec3) -> bool {
        p.z >= NEAR && self.planes().iter().all(|plane| plane.dot(p) >= 0.0)
    }

    /// Corners of the part of a triangle that is before the lens and within the
    /// guard band; fewer than three if there is none. A cut on an edge is the
    /// same point for both triangles of the edge.
    pub fn clip(&self, tri: [DVec3; 3]) -> Vec<DVec3> {
        let near = cut(&tri, |p| p.z - NEAR);
        self.planes()
            .iter()
            .fold(near, |poly, plane| cut(&poly, |p| plane.dot(p)))
    }

    /// Inward normals of the guard band's four planes through the eye.
    fn planes(&self) -> [DVec3; 4] {
        let lo = self.centre + GUARD;
        let hi = self.size - self.centre + GUARD;
        [
            DVec3::new(self.focal, 0.0, lo.x),
            DVec3::new(-self.focal, 0.0, hi.x),
            DVec3::new(0.0, self.focal, lo.y),
            DVec3::new(0.0, -self.focal, hi.y),
        ]
    }
}

/// Keeps the side of a convex polygon where `height` is not negative.
fn cut(poly: &[DVec3], height: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(poly.len() + 1);
    for (i, &a) in poly.iter().enumerate() {
        let b = poly[(i + 1) % poly.len()];
        let (ha, hb) = (height(a), height(b));
        if ha >= 0.0 {
            kept.push(a);
        }
        if (ha >= 0.0) != (hb >= 0.0) {
            // From inside to outside, whichever way the polygon runs.
            let (inner, outer, hi, ho) = if ha >= 0.0 {
                (a, b, ha, hb)
            } else {
                (b, a, hb, ha)
            };
            kept.push(inner + (outer - inner) * (hi / (hi - ho)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens {
        focal: 100.0,
        centre: DVec2::splat(50.0),
        size: DVec2::splat(100.0),
    };

    #[test]
    fn a_triangle_through_the_lens_keeps_its_front() {
        let tri = [
            DVec3::new(0.0, 0.0, 1.0),
            DVec3::new(0.1, 0.0, -1.0),
            DVec3::new(0.0, 0.1, 1.0),
        ];
        let poly = LENS.clip(tri);
        assert_eq!(poly.len(), 4);
        assert!(poly.iter().all(|p| p.z >= NEAR - 1e-12));
    }

    #[test]
    fn neighbours_are_cut_at_the_same_point() {
        let [a, b] = [DVec3::new(0.3, 0.2, 0.7), DVec3::new(-0.2, 0.1, -0.9)];
        let one = LENS.clip([a, b, DVec3::new(0.0, 1.0, 1.0)]);
        let two = LENS.clip([b, a, DVec3::new(0.0, -1.0, 1.0)]);
        let shared = one.iter().filter(|p| two.contains(p)).count();
        assert_eq!(shared, 2, "the corner and the cut");
    }

    #[test]
    fn behind_the_lens_nothing_is_left() {
        assert!(
            LENS.clip([
                DVec3::NEG_Z,
                DVec3::new(1.0, 0.0, -2.0),
                DVec3::new(0.0, 1.0, -1.0)
            ])
            .len()
                < 3
        );
    }
}
