//! A triangle as it was cut: its rest shape, and how far it is from it now.

use glam::{DVec2, DVec3};

/// A triangle's rest shape in material coordinates [m]: x along the weft, y along the warp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestTriangle {
    /// Rest area [m²].
    pub area: f64,
    /// `[∂N/∂weft, ∂N/∂warp]` [1/m] of the linear shape functions of vertices 1 and 2.
    slopes: [[f64; 2]; 2],
}

impl RestTriangle {
    /// From the three corners as cut [m]; either winding.
    ///
    /// `None` if a corner is not finite or the corners lie on a line (height below a millionth
    /// of the longest side): such a triangle has no rest shape to return to.
    pub fn new(corners: [DVec2; 3]) -> Option<Self> {
        let (a, b) = (corners[1] - corners[0], corners[2] - corners[0]);
        let twice = a.perp_dot(b);
        let longest = a
            .length_squared()
            .max(b.length_squared())
            .max((b - a).length_squared());
        let slim = twice.abs() <= 1e-6 * longest;
        if slim || !twice.is_finite() || longest == 0.0 {
            return None;
        }
        let slopes = [[b.y / twice, -b.x / twice], [-a.y / twice, a.x / twice]];
        Some(Self {
            area: 0.5 * twice.abs(),
            slopes,
        })
    }

    /// How the deformation answers to vertex `i` (0, 1 or 2): `∂F/∂xᵢ` by column [1/m].
    #[inline]
    pub fn slope(&self, i: usize) -> [f64; 2] {
        let [a, b] = self.slopes;
        match i {
            0 => [-(a[0] + b[0]), -(a[1] + b[1])],
            1 => a,
            _ => b,
        }
    }

    /// The deformation `F = ∂x/∂X`, by column: where a unit of weft and a unit of warp went.
    ///
    /// Undeformed cloth has two orthogonal unit columns, however it lies in space.
    #[inline]
    pub fn deformation(&self, x: &[DVec3; 3]) -> [DVec3; 2] {
        let (a, b) = (x[1] - x[0], x[2] - x[0]);
        let [s, t] = self.slopes;
        [a * s[0] + b * t[0], a * s[1] + b * t[1]]
    }
}

/// The two principal stretches of a deformation, the larger first (1 = unstretched).
///
/// From the trace and determinant of `FᵀF`; the smaller keeps its digits when it is tiny.
#[inline]
pub(crate) fn principal(f: &[DVec3; 2]) -> [f64; 2] {
    let (a, b, d) = (f[0].length_squared(), f[0].dot(f[1]), f[1].length_squared());
    let larger = (0.5 * (a + d) + (0.25 * (a - d) * (a - d) + b * b).sqrt()).sqrt();
    if larger == 0.0 {
        return [0.0, 0.0];
    }
    [larger, f[0].cross(f[1]).length() / larger]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unmoved_triangle_is_not_deformed_whichever_way_it_winds() {
        for corners in [
            [
                DVec2::ZERO,
                DVec2::new(0.01, 0.001),
                DVec2::new(0.002, 0.012),
            ],
            [
                DVec2::ZERO,
                DVec2::new(0.002, 0.012),
                DVec2::new(0.01, 0.001),
            ],
        ] {
            let rest = RestTriangle::new(corners).expect("these corners are no line");
            let f = rest.deformation(&corners.map(|c| DVec3::new(c.x, c.y, 1.5)));
            assert!(f[0].abs_diff_eq(DVec3::X, 1e-12) && f[1].abs_diff_eq(DVec3::Y, 1e-12));
        }
    }

    #[test]
    fn corners_on_a_line_have_no_rest_shape() {
        assert_eq!(
            RestTriangle::new([DVec2::ZERO, DVec2::X, DVec2::X * 2.0]),
            None
        );
        assert_eq!(RestTriangle::new([DVec2::ONE; 3]), None);
        assert_eq!(RestTriangle::new([DVec2::ZERO, DVec2::X, DVec2::NAN]), None);
    }
}
