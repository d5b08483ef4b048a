//! Cut: the part of a triangle surface where a scalar field is positive, exactly along its isoline.

use glam::DVec3;
use std::collections::HashMap;

/// A vertex of a cut surface: the point `(1 − along) · ends[0] + along · ends[1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnEdge {
    /// Vertices of the uncut surface; equal when the vertex was kept.
    pub ends: [u32; 2],
    /// Fraction of the way to the second end, 0 to 1.
    pub along: f64,
}

impl OnEdge {
    /// The same blend of any values that live on the uncut vertices.
    pub fn blend(&self, values: &[DVec3]) -> DVec3 {
        values[self.ends[0] as usize].lerp(values[self.ends[1] as usize], self.along)
    }
}

/// What a cut leaves: triangles over vertices that remember where they lay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// Corner indices into `verts`, oriented like the uncut faces.
    pub faces: Vec<[u32; 3]>,
    /// Only vertices that a face uses.
    pub verts: Vec<OnEdge>,
}

/// A crossing this close to a vertex, as a fraction of its edge, becomes that vertex.
const SNAP: f64 = 0.02;

/// Keeps the part of `faces` where `field >= 0`, interpolated linearly along edges.
///
/// `field` has one value per vertex, in any unit. The isoline becomes a boundary; where it
/// passes within 2 % of a kept vertex it goes through that vertex, so that no sliver is left.
/// A field without a positive value leaves nothing.
pub fn cut(faces: &[[u32; 3]], field: &[f64]) -> Cut {
    let mut out = Builder::default();
    for f in faces {
        let ring = out.clipped(f, field);
        for k in 1..ring.len().saturating_sub(1) {
            out.face([ring[0], ring[k], ring[k + 1]]);
        }
    }
    out.cut.compact()
}

#[derive(Default)]
struct Builder {
    cut: Cut,
    index: HashMap<[u32; 2], u32>,
}

impl Builder {
    /// The corners of a face's kept polygon.
    fn clipped(&mut self, f: &[u32; 3], field: &[f64]) -> Vec<u32> {
        let mut ring = Vec::with_capacity(4);
        for k in 0..3 {
            let (a, b) = (f[k], f[(k + 1) % 3]);
            let (fa, fb) = (field[a as usize], field[b as usize]);
            if fa >= 0.0 {
                ring.push(self.vertex(a, a, 0.0));
            }
            if (fa >= 0.0) != (fb >= 0.0) {
                ring.push(self.crossing([a, b], [fa, fb]));
            }
        }
        ring
    }

    /// The vertex where the isoline crosses an edge, the same from either side.
    fn crossing(&mut self, [a, b]: [u32; 2], [fa, fb]: [f64; 2]) -> u32 {
        let ((kept, fk), (gone, fg)) = if fa >= 0.0 {
            ((a, fa), (b, fb))
        } else {
            ((b, fb), (a, fa))
        };
        let along = fk / (fk - fg);
        if along < SNAP {
            self.vertex(kept, kept, 0.0)
        } else {
            self.vertex(kept, gone, along)
        }
    }

    fn vertex(&mut self, a: u32, b: u32, along: f64) -> u32 {
        let verts = &mut self.cut.verts;
        *self.index.entry([a, b]).or_insert_with(|| {
            verts.push(OnEdge {
                ends: [a, b],
                along,
            });
            verts.len() as u32 - 1
        })
    }

    fn face(&mut self, f: [u32; 3]) {
        if f[0] != f[1] && f[1] != f[2] && f[2] != f[0] {
            self.cut.faces.push(f);
        }
    }
}

impl Cut {
    /// Drops vertices that snapping left without a face.
    fn compact(mut self) -> Cut {
        let mut new = vec![u32::MAX; self.verts.len()];
        let mut verts = Vec::with_capacity(self.verts.len());
        for f in &mut self.faces {
            for i in f {
                if new[*i as usize] == u32::MAX {
                    new[*i as usize] = verts.len() as u32;
                    verts.push(self.verts[*i as usize]);
                }
                *i = new[*i as usize];
            }
        }
        Cut {
            faces: self.faces,
            verts,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
    const CORNERS: [DVec3; 4] = [
        DVec3::ZERO,
        DVec3::X,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(0.0, 1.0, 0.0),
    ];

    fn area(cut: &Cut) -> f64 {
        let x: Vec<DVec3> = cut.verts.iter().map(|v| v.blend(&CORNERS)).collect();
        let twice = cut.faces.iter().map(|f| {
            let [a, b, c] = f.map(|i| x[i as usize]);
            (b - a).cross(c - a).z
        });
        twice.sum::<f64>() / 2.0
    }

    #[test]
    fn a_linear_field_cuts_along_its_line() {
        let kept = cut(&SQUARE, &[0.3, -0.7, -0.7, 0.3]);
        assert!((area(&kept) - 0.3).abs() < 1e-12, "area {}", area(&kept));
        assert!(kept.verts.iter().all(|v| v.blend(&CORNERS).x < 0.3 + 1e-12));
    }

    #[test]
    fn what_is_kept_and_what_is_dropped_add_up() {
        let field = [0.31, -0.2, -0.9, 0.4];
        let (a, b) = (cut(&SQUARE, &field), cut(&SQUARE, &field.map(|f| -f)));
        assert!((area(&a) + area(&b) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_crossing_at_a_vertex_leaves_no_sliver() {
        let kept = cut(&SQUARE, &[0.0, -1.0, -1.0, 1.0]);
        assert_eq!(kept.faces.len(), 1, "{kept:?}");
    }

    #[test]
    fn nothing_positive_leaves_nothing() {
        assert_eq!(cut(&SQUARE, &[-1.0; 4]), Cut::default());
    }
}
