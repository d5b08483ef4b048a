//! Which faces and vertices belong together.

use crate::{AvatarParts, BodyError, Part, Unwelded};
use glam::DVec3;
use std::collections::HashMap;

/// Refuses parts that do not fit together; afterwards no index can be out of range.
pub fn check(parts: &AvatarParts) -> Result<(), BodyError> {
    let n = parts.counts.total();
    let n_anchors = parts
        .mean
        .len()
        .checked_sub(n)
        .ok_or(BodyError::Corrupt("too few points"))?;
    let below = |ok: bool, what: &'static str| {
        if ok {
            Ok(())
        } else {
            Err(BodyError::Corrupt(what))
        }
    };
    let (blend, rig) = (&parts.blend, &parts.rig);
    below(
        parts.modes.len() == 3 * parts.mean.len() * blend.n_modes(),
        "modes of another size",
    )?;
    below(
        blend.projection.len() == blend.n_modes() * blend.terms.len(),
        "a blend of another size",
    )?;
    let tags = blend
        .terms
        .iter()
        .flatten()
        .all(|&t| (t as usize) < crate::TAGS.len());
    below(tags, "a tag that does not exist")?;
    let points = |d: &[(u32, [f32; 3])]| d.iter().all(|&(i, _)| (i as usize) < parts.mean.len());
    below(
        parts
            .targets
            .iter()
            .all(|t| points(&t.up) && points(&t.down)),
        "a slider beyond the points",
    )?;
    let anchored = |b: &crate::Bone| (b.head.max(b.tail) as usize) < n_anchors;
    below(rig.bones.iter().all(anchored), "a bone without an anchor")?;
    let rooted = |(i, b): (usize, &crate::Bone)| b.parent.map_or(i == 0, |p| p < i);
    below(
        rig.bones.iter().enumerate().all(rooted),
        "a bone before its parent",
    )?;
    below(
        rig.weights.n_rows() == n && rig.weights.is_convex(rig.n_bones()),
        "skin weights",
    )?;
    below(parts.regressors.is_convex(n), "keypoint weights")?;
    let inside = |q: &[u32; 4]| q.iter().all(|&i| (i as usize) < n);
    below(
        parts.quads.iter().chain(&parts.caps).all(inside),
        "a face beyond the vertices",
    )?;
    below(
        parts.waist.iter().all(|&i| (i as usize) < n),
        "a waist beyond the vertices",
    )?;
    let mapped = |q: &[u32; 4]| q.iter().all(|&i| (i as usize) < parts.uvs.len());
    below(
        parts.quad_uvs.iter().all(mapped),
        "a face beyond the picture",
    )?;
    check_parts(parts)
}

/// Quads come part by part, and body and eyes have places in the picture.
fn check_parts(parts: &AvatarParts) -> Result<(), BodyError> {
    let order = [Part::Body, Part::Eyes, Part::Tights, Part::Skirt];
    let all: usize = order.iter().map(|&p| quads_of(parts, p).len()).sum();
    let skin = quads_of(parts, Part::Body).len() + quads_of(parts, Part::Eyes).len();
    let lined = parts.cavities.iter().all(|&c| (c as usize) < skin);
    if all != parts.quads.len() || parts.quad_uvs.len() != skin || !lined {
        return Err(BodyError::Corrupt("faces across parts"));
    }
    Ok(())
}

/// The quads of one part: those whose corners all lie in it.
pub fn quads_of(parts: &AvatarParts, part: Part) -> &[[u32; 4]] {
    let range = parts.counts.range(part);
    let inside = |q: &[u32; 4]| q.iter().all(|&i| range.contains(&(i as usize)));
    let start = parts
        .quads
        .iter()
        .position(inside)
        .unwrap_or(parts.quads.len());
    let n = parts.quads[start..]
        .iter()
        .take_while(|q| inside(q))
        .count();
    &parts.quads[start..start + n]
}

/// The skin without its cavities, closed by the caps.
pub fn collision_quads(parts: &AvatarParts) -> Vec<[u32; 4]> {
    let body = quads_of(parts, Part::Body);
    let mut lines = vec![false; parts.quads.len()];
    parts
        .cavities
        .iter()
        .for_each(|&c| lines[c as usize] = true);
    let outer = body
        .iter()
        .zip(&lines)
        .filter(|&(_, &cavity)| !cavity)
        .map(|(q, _)| *q);
    outer.chain(parts.caps.iter().copied()).collect()
}

/// Splits quads along the diagonal that is shorter on the mean body.
pub struct Split<'a> {
    mean: &'a [DVec3],
}

impl<'a> Split<'a> {
    /// Quads over these points [m].
    pub fn new(mean: &'a [DVec3]) -> Self {
        Self { mean }
    }

    /// Two triangles for every quad; one where two of its corners are the same.
    pub fn triangles(&self, quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
        self.with_uvs(quads, quads).0
    }

    /// The triangles of `quads`, and those of `uvs` cut alike.
    pub fn with_uvs(&self, quads: &[[u32; 4]], uvs: &[[u32; 4]]) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
        let mut out = (Vec::new(), Vec::new());
        for (q, t) in quads.iter().zip(uvs) {
            for corners in self.corners(q) {
                let face = corners.map(|c| q[c]);
                if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
                    out.0.push(face);
                    out.1.push(corners.map(|c| t[c]));
                }
            }
        }
        out
    }

    fn corners(&self, q: &[u32; 4]) -> [[usize; 3]; 2] {
        let far = |a: usize, b: usize| self.mean[q[a] as usize].distance(self.mean[q[b] as usize]);
        // Mirror images differ by rounding; the margin keeps left and right alike.
        if far(0, 2) <= far(1, 3) * 1.0001 {
            [[0, 1, 2], [0, 2, 3]]
        } else {
            [[0, 1, 3], [1, 2, 3]]
        }
    }
}

/// A vertex for every pair of place on the body and place in the picture, in order of use.
pub fn unweld(faces: &[[u32; 3]], face_uvs: &[[u32; 3]], uvs: &[[f32; 2]]) -> Unwelded {
    let mut known: HashMap<(u32, u32), u32> = HashMap::new();
    let mut out = Unwelded {
        source: Vec::new(),
        uvs: Vec::new(),
        faces: Vec::new(),
    };
    for (face, places) in faces.iter().zip(face_uvs) {
        let corner = |k: usize| {
            *known.entry((face[k], places[k])).or_insert_with(|| {
                out.source.push(face[k]);
                out.uvs.push(uvs[places[k] as usize]);
                out.source.len() as u32 - 1
            })
        };
        out.faces.push([0, 1, 2].map(corner));
    }
    out
}

/// The vertices that can be the body's highest or lowest: near the crown and the soles.
pub fn stature(parts: &AvatarParts) -> Vec<u32> {
    let ys = || parts.mean[..parts.counts.body].iter().map(|v| v.y);
    let (low, high) = (ys().fold(f64::MAX, f64::min), ys().fold(f64::MIN, f64::max));
    let ends = |&(_, y): &(usize, f64)| y < low + 0.03 || y > high - 0.03;
    ys().enumerate()
        .filter(ends)
        .map(|(i, _)| i as u32)
        .collect()
}
