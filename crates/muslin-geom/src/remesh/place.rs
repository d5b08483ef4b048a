//! Where points lie on the reference surface, found by walking.

use super::OnFace;
use crate::{Mesh, closest::on_triangle};
use glam::DVec3;
use std::collections::HashMap;

/// A place on the reference: inside a face, or on its boundary curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub at: OnFace,
    /// The boundary segment it may slide along; none for inner points.
    pub rim: Option<u32>,
}

/// One directed boundary edge of the reference.
struct Segment {
    /// Its face, and which corner of the face it starts from.
    face: u32,
    corner: usize,
    previous: u32,
    next: u32,
}

/// The surface that everything is projected to.
pub(super) struct Reference<'a> {
    pub mesh: &'a Mesh,
    touching: Vec<Vec<u32>>,
    rim: Vec<Segment>,
    rim_from: HashMap<u32, u32>,
}

impl<'a> Reference<'a> {
    pub fn new(mesh: &'a Mesh) -> Reference<'a> {
        let mut touching = vec![Vec::new(); mesh.verts.len()];
        for (t, f) in mesh.faces.iter().enumerate() {
            for i in f {
                touching[*i as usize].push(t as u32);
            }
        }
        let (rim, rim_from) = segments(mesh);
        Reference {
            mesh,
            touching,
            rim,
            rim_from,
        }
    }

    /// The place of one of the reference's own vertices; none if no face uses it.
    pub fn of_vertex(&self, vertex: u32) -> Option<Place> {
        let rim = self.rim_from.get(&vertex).copied();
        let face = match rim {
            Some(s) => self.rim[s as usize].face,
            None => *self.touching[vertex as usize].first()?,
        };
        let weights = self.mesh.faces[face as usize].map(|i| f64::from(u8::from(i == vertex)));
        Some(Place {
            at: OnFace { face, weights },
            rim,
        })
    }

    /// The point at a place [m].
    pub fn point(&self, at: &OnFace) -> DVec3 {
        let f = self.mesh.faces[at.face as usize];
        (0..3)
            .map(|k| self.mesh.verts[f[k] as usize] * at.weights[k])
            .sum()
    }

    /// The place near `from` that is closest to `x`, on the same kind of ground.
    pub fn nearest(&self, from: &Place, x: DVec3) -> Place {
        match from.rim {
            Some(s) => self.along_rim(s, x),
            None => Place {
                at: self.across_faces(from.at.face, x),
                rim: None,
            },
        }
    }

    fn across_faces(&self, start: u32, x: DVec3) -> OnFace {
        let (mut best, mut distance) = self.on_face(start, x);
        loop {
            if best.weights.iter().all(|w| *w > 1e-9) {
                // Straight below `x`: on a smooth surface no neighbour is closer.
                return best;
            }
            let here = best.face;
            let corners = self.mesh.faces[here as usize];
            for t in corners.iter().flat_map(|&i| &self.touching[i as usize]) {
                let (at, d) = self.on_face(*t, x);
                if d < distance * (1.0 - 1e-9) {
                    (best, distance) = (at, d);
                }
            }
            if best.face == here {
                return best;
            }
        }
    }

    fn on_face(&self, face: u32, x: DVec3) -> (OnFace, f64) {
        let corners = self.mesh.faces[face as usize].map(|i| self.mesh.verts[i as usize]);
        let weights = on_triangle(x, &corners).weights;
        let at = OnFace { face, weights };
        (at, (self.point(&at) - x).length_squared())
    }

    fn along_rim(&self, start: u32, x: DVec3) -> Place {
        let (mut best, mut distance) = self.on_segment(start, x);
        let mut here = start;
        loop {
            let s = &self.rim[here as usize];
            let (mut better, from) = (false, here);
            for other in [s.previous, s.next] {
                let (place, d) = self.on_segment(other, x);
                if d < distance * (1.0 - 1e-9) {
                    (best, distance, here, better) = (place, d, other, true);
                }
            }
            if !better || here == from {
                return best;
            }
        }
    }

    fn on_segment(&self, segment: u32, x: DVec3) -> (Place, f64) {
        let s = &self.rim[segment as usize];
        let f = self.mesh.faces[s.face as usize];
        let (i, j) = (s.corner, (s.corner + 1) % 3);
        let (a, b) = (
            self.mesh.verts[f[i] as usize],
            self.mesh.verts[f[j] as usize],
        );
        let d = b - a;
        let along = ((x - a).dot(d) / d.length_squared().max(1e-300)).clamp(0.0, 1.0);
        let mut weights = [0.0; 3];
        (weights[i], weights[j]) = (1.0 - along, along);
        let at = OnFace {
            face: s.face,
            weights,
        };
        let off = (a + d * along - x).length_squared();
        (
            Place {
                at,
                rim: Some(segment),
            },
            off,
        )
    }
}

/// The boundary as linked segments, and which one starts at a vertex.
fn segments(mesh: &Mesh) -> (Vec<Segment>, HashMap<u32, u32>) {
    let mut half: HashMap<(u32, u32), ()> = HashMap::new();
    for f in &mesh.faces {
        for k in 0..3 {
            half.insert((f[k], f[(k + 1) % 3]), ());
        }
    }
    let (mut rim, mut from, mut to) = (Vec::new(), HashMap::new(), HashMap::new());
    for (t, f) in mesh.faces.iter().enumerate() {
        for corner in 0..3 {
            let (a, b) = (f[corner], f[(corner + 1) % 3]);
            if !half.contains_key(&(b, a)) {
                let index = rim.len() as u32;
                from.insert(a, index);
                to.insert(b, index);
                rim.push(Segment {
                    face: t as u32,
                    corner,
                    previous: index,
                    next: index,
                });
            }
        }
    }
    for s in &mut rim {
        let f = mesh.faces[s.face as usize];
        let (a, b) = (f[s.corner], f[(s.corner + 1) % 3]);
        s.previous = to.get(&a).copied().unwrap_or(s.previous);
        s.next = from.get(&b).copied().unwrap_or(s.next);
    }
    (rim, from)
}
