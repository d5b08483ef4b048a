//! From samples to surfaces: what each pixel has to shade.
//!
//! Samples of one pixel that see the same piece of surface are shaded once, at
//! their middle; a pixel on an outline keeps one fragment for each side.

use glam::{Vec2, Vec3};

use crate::camera::Camera;
use crate::project::{Flat, Projected};
use crate::raster::{NOTHING, Tile, pattern};

/// One piece of surface in one pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Share of the pixel it fills.
    pub weight: f32,
    /// The face it lies on (the largest, where several meet).
    pub face: u32,
    /// The scene's part.
    pub part: u16,
    /// Seen from behind.
    pub back: bool,
    /// Position [m].
    pub at: Vec3,
    /// Unit normal on the side that is seen.
    pub normal: Vec3,
    /// Distance along the camera's axis [m].
    pub depth: f32,
    /// Material coordinates [m].
    pub uv: Vec2,
    /// Linear RGB factor.
    pub colour: Vec3,
    /// Light of the dome on the side that is seen.
    pub dome: Vec3,
    /// Signed distance from the painted layer's edge [m].
    pub layer: f32,
    /// Distance from the cloth's open edge [m].
    pub hem: f32,
}

/// The fragments of a tile, pixel by pixel.
pub(crate) struct Fragments {
    /// Left, top, width and height [px].
    pub frame: [usize; 4],
    starts: Vec<u32>,
    items: Vec<Fragment>,
}

impl Fragments {
    /// A tile in which nothing is seen.
    pub fn none(frame: [usize; 4]) -> Self {
        Self {
            frame,
            starts: vec![0; frame[2] * frame[3] + 1],
            items: Vec::new(),
        }
    }

    /// Fragments of the tile's pixel `at`, counted row by row.
    pub fn of(&self, at: usize) -> &[Fragment] {
        &self.items[self.starts[at] as usize..self.starts[at + 1] as usize]
    }
}

/// What fragments are made from.
pub(crate) struct Resolver<'a> {
    /// The scene.
    pub flat: &'a Flat,
    /// The scene in the camera's frame.
    pub projected: &'a Projected,
    /// Light of the dome per vertex, front and back.
    pub dome: &'a [[Vec3; 2]],
    /// The lens: focal length and principal point [px].
    pub focal: f32,
    pub centre: Vec2,
}

impl<'a> Resolver<'a> {
    /// A resolver for one camera.
    pub fn new(
        flat: &'a Flat,
        projected: &'a Projected,
        dome: &'a [[Vec3; 2]],
        camera: &Camera,
    ) -> Self {
        Self {
            flat,
            projected,
            dome,
            focal: camera.focal as f32,
            centre: camera.centre.as_vec2(),
        }
    }

    /// Turns a filled tile into fragments.
    pub fn resolve<const S: usize>(&self, tile: &Tile<S>, frame: [usize; 4]) -> Fragments {
        let offsets = pattern::<S>().map(|o| Vec2::new(o[0] as f32, o[1] as f32) / 256.0);
        let pixels = tile.id.len();
        let mut out = Fragments {
            frame,
            starts: Vec::with_capacity(pixels + 1),
            items: Vec::with_capacity(pixels),
        };
        out.starts.push(0);
        for (i, ids) in tile.id.iter().enumerate() {
            if ids.iter().any(|&id| id != NOTHING) {
                let corner = Vec2::new(
                    (frame[0] + i % frame[2]) as f32,
                    (frame[1] + i / frame[2]) as f32,
                );
                self.pixel(ids, &offsets, corner, &mut out.items);
            }
            out.starts.push(out.items.len() as u32);
        }
        out
    }

    fn pixel<const S: usize>(
        &self,
        ids: &[u32; S],
        offsets: &[Vec2; S],
        corner: Vec2,
        out: &mut Vec<Fragment>,
    ) {
        let first = out.len();
        let mut done = [false; S];
        for s in 0..S {
            if ids[s] == NOTHING || done[s] {
                continue;
            }
            let (mut sum, mut count) = (Vec2::ZERO, 0.0);
            for t in s..S {
                if ids[t] == ids[s] {
                    (sum, count, done[t]) = (sum + offsets[t], count + 1.0, true);
                }
            }
            let piece = self.fragment(ids[s], corner + sum / count, count / S as f32);
            match out[first..]
                .iter_mut()
                .find(|f| f.continues(&piece, self.focal))
            {
                Some(same) => same.join(&piece),
                None => out.push(piece),
            }
        }
        for f in &mut out[first..] {
            f.normal = f.normal.normalize_or(Vec3::Y);
        }
    }

    /// The surface of a face at a pixel position.
    #[inline(always)]
    fn fragment(&self, face: u32, pixel: Vec2, weight: f32) -> Fragment {
        let flat = self.flat;
        let v = flat.faces[face as usize].map(|v| v as usize);
        let seen = v.map(|v| self.projected.seen[v]);
        let ray = ((pixel - self.centre) / self.focal).extend(1.0);
        let (b, back) = crossing(seen, ray);
        let mix = |a: &[f32]| b[0] * a[v[0]] + b[1] * a[v[1]] + b[2] * a[v[2]];
        let mix3 = |a: &[Vec3]| b[0] * a[v[0]] + b[1] * a[v[1]] + b[2] * a[v[2]];
        let depth = b[0] * seen[0].z + b[1] * seen[1].z + b[2] * seen[2].z;
        let normal = mix3(&flat.normals).normalize_or(Vec3::Y);
        let uv = flat.uvs[face as usize];
        let side = usize::from(back);
        let dome = (0..3).map(|i| b[i] * self.dome[v[i]][side]).sum();
        Fragment {
            weight,
            face,
            part: flat.part[face as usize],
            back,
            at: mix3(&flat.at),
            normal: if back { -normal } else { normal },
            depth,
            uv: b[0] * uv[0] + b[1] * uv[1] + b[2] * uv[2],
            colour: mix3(&flat.colours),
            dome,
            layer: mix(&flat.layer),
            hem: mix(&flat.hem),
        }
    }
}

impl Fragment {
    /// Whether `other` is the same piece of surface, seen through a lens of `focal` px.
    fn continues(&self, other: &Self, focal: f32) -> bool {
        let pixel = self.depth / focal;
        self.part == other.part
            && self.back == other.back
            && (self.depth - other.depth).abs() < 5.0 * pixel
            && self.normal.dot(other.normal) > 0.75 * self.normal.length()
    }

    fn join(&mut self, other: &Self) {
        if other.weight > self.weight {
            (self.face, self.uv) = (other.face, other.uv);
        }
        let sum = self.weight + other.weight;
        let t = other.weight / sum;
        self.weight = sum;
        self.at = self.at.lerp(other.at, t);
        self.normal = self.normal.lerp(other.normal, t);
        self.depth += (other.depth - self.depth) * t;
        self.colour = self.colour.lerp(other.colour, t);
        self.dome = self.dome.lerp(other.dome, t);
        self.layer += (other.layer - self.layer) * t;
        self.hem += (other.hem - self.hem) * t;
    }
}

/// Barycentric weights where a ray from the eye meets a triangle's plane, pulled
/// into the triangle, and whether it is seen from behind. A triangle seen edge-on
/// answers with its first corner.
fn crossing(p: [Vec3; 3], ray: Vec3) -> ([f32; 3], bool) {
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let across = ray.cross(e2);
    let det = e1.dot(across);
    let to = -p[0];
    let inv = if det == 0.0 { 0.0 } else { 1.0 / det };
    let u = (to.dot(across) * inv).clamp(0.0, 1.0);
    let v = (ray.dot(to.cross(e1)) * inv).clamp(0.0, 1.0);
    let over = (u + v).max(1.0);
    let (u, v) = (u / over, v / over);
    ([1.0 - u - v, u, v], e1.cross(e2).dot(p[0]) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_finds_its_place_on_a_triangle() {
        let p = [
            Vec3::new(-1.0, 0.0, 5.0),
            Vec3::new(2.0, 0.5, 7.0),
            Vec3::new(0.0, 3.0, 4.0),
        ];
        let want = [0.2, 0.5, 0.3];
        let at = p[0] * want[0] + p[1] * want[1] + p[2] * want[2];
        let (got, _) = crossing(p, at / at.z);
        assert!((0..3).all(|i| (got[i] - want[i]).abs() < 1e-5), "{got:?}");
    }

    #[test]
    fn turning_a_triangle_round_shows_its_back() {
        let p = [
            Vec3::new(0.0, 0.0, 3.0),
            Vec3::new(0.0, 1.0, 3.0),
            Vec3::new(1.0, 0.0, 3.0),
        ];
        let ray = Vec3::new(0.1, 0.1, 1.0);
        assert!(crossing(p, ray).1 != crossing([p[0], p[2], p[1]], ray).1);
    }
}
