//! The binary half: numbers in a buffer, and the JSON that says where they are.

use glam::{DQuat, DVec2, DVec3, DVec4};
use serde_json::{Value, json};

/// Component types of glTF.
const BYTE: u32 = 5120;
const UNSIGNED_BYTE: u32 = 5121;
const SHORT: u32 = 5122;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Buffer targets of glTF.
const VERTICES: u32 = 34962;
const TRIANGLES: u32 = 34963;

/// One buffer with its views and accessors.
#[derive(Default)]
pub struct Bin {
    /// The buffer; every view starts at a multiple of four.
    pub bytes: Vec<u8>,
    /// `bufferViews`.
    pub views: Vec<Value>,
    /// `accessors`.
    pub accessors: Vec<Value>,
}

/// An even grid of 65,535 steps along the longest side of a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The middle [m].
    pub origin: [f32; 3],
    /// Distance of neighbouring points [m], > 0.
    pub step: f32,
}

impl Grid {
    /// The grid that just holds these points; a single point gets a grid of 1 µm.
    pub fn around(points: &[DVec3]) -> Self {
        let (low, high) = bounds(points);
        let origin = (0.5 * (low + high)).as_vec3().to_array();
        let middle = DVec3::from(origin.map(f64::from));
        let reach = (high - middle).max(middle - low).max_element();
        Self {
            origin,
            step: ((reach / 32_767.0) as f32).next_up().max(1e-6),
        }
    }

    /// The grid point next to `x` [m].
    pub fn nearest(&self, x: DVec3) -> [i16; 3] {
        let cells = (x - DVec3::from(self.origin.map(f64::from))) / f64::from(self.step);
        // The cast saturates; -32,768 cannot come out, for the grid reaches as far either way.
        cells.to_array().map(|c| c.round() as i16)
    }

    /// Where a grid point lies [m].
    pub fn world(&self, cell: [i16; 3]) -> DVec3 {
        let origin = DVec3::from(self.origin.map(f64::from));
        origin + f64::from(self.step) * DVec3::from(cell.map(f64::from))
    }
}

/// How texture coordinates are brought into the unit square: `uv = offset + scale * stored`.
///
/// In glTF's sense, v pointing down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvFrame {
    /// What the square's corner stands for.
    pub offset: DVec2,
    /// What its side stands for, > 0; one for both axes, so that squares stay squares.
    pub scale: f64,
}

impl UvFrame {
    /// The frame of these coordinates, v up. Those in the unit square stay as they are.
    pub fn of(uvs: &[DVec2]) -> Self {
        let down = || uvs.iter().map(|&uv| flipped(uv));
        let low = down().fold(DVec2::INFINITY, DVec2::min);
        let high = down().fold(DVec2::NEG_INFINITY, DVec2::max);
        if uvs.is_empty() || (low.min_element() >= 0.0 && high.max_element() <= 1.0) {
            return Self {
                offset: DVec2::ZERO,
                scale: 1.0,
            };
        }
        Self {
            offset: low,
            scale: (high - low).max_element().max(1e-6),
        }
    }

    /// Whether stored and meant coordinates are the same.
    pub fn is_plain(&self) -> bool {
        self.offset == DVec2::ZERO && self.scale == 1.0
    }
}

impl Bin {
    /// Positions as floats.
    pub fn positions(&mut self, points: &[DVec3]) -> usize {
        let view = self.floats(points.iter().map(|p| p.as_vec3().to_array()));
        let points = points.iter().map(|p| p.as_vec3().as_dvec3());
        let (low, high) = bounds(&points.collect::<Vec<_>>());
        let (low, high) = (low.as_vec3().to_array(), high.as_vec3().to_array());
        let shape = json!({ "type": "VEC3", "componentType": FLOAT, "min": low, "max": high });
        self.accessor(view, shape)
    }

    /// Positions as grid points.
    pub fn grid_positions(&mut self, points: &[DVec3], grid: &Grid) -> usize {
        let cells: Vec<[i16; 3]> = points.iter().map(|&p| grid.nearest(p)).collect();
        self.cells(&cells, true)
    }

    /// Positions, or moves from there, in grid cells; with their bounds where a reader wants them.
    pub fn cells(&mut self, cells: &[[i16; 3]], bounded: bool) -> usize {
        let bound = |pick: fn(i16, i16) -> i16| {
            let merge = |a: [i16; 3], b: [i16; 3]| std::array::from_fn(|k| pick(a[k], b[k]));
            cells.iter().copied().reduce(merge).unwrap_or_default()
        };
        let view = self.shorts(cells);
        let mut shape = json!({ "type": "VEC3", "componentType": SHORT });
        if bounded {
            shape["min"] = json!(bound(i16::min));
            shape["max"] = json!(bound(i16::max));
        }
        self.accessor(view, shape)
    }

    /// Normals as floats.
    pub fn normals(&mut self, normals: &[DVec3]) -> usize {
        let view = self.floats(normals.iter().map(|&n| unit(n).as_vec3().to_array()));
        self.accessor(view, json!({ "type": "VEC3", "componentType": FLOAT }))
    }

    /// Normals as 16-bit fractions of one.
    pub fn short_normals(&mut self, normals: &[DVec3]) -> usize {
        let normals: Vec<_> = normals
            .iter()
            .map(|&n| unit(n).to_array().map(short))
            .collect();
        let view = self.shorts(&normals);
        let shape = json!({ "type": "VEC3", "componentType": SHORT, "normalized": true });
        self.accessor(view, shape)
    }

    /// Tangents as floats.
    pub fn tangents(&mut self, tangents: &[DVec4]) -> usize {
        let view = self.floats(tangents.iter().map(|t| t.as_vec4().to_array()));
        self.accessor(view, json!({ "type": "VEC4", "componentType": FLOAT }))
    }

    /// Tangents as 16-bit fractions of one.
    pub fn short_tangents(&mut self, tangents: &[DVec4]) -> usize {
        let tangents: Vec<_> = tangents.iter().map(|t| t.to_array().map(short)).collect();
        let view = self.shorts(&tangents);
        let shape = json!({ "type": "VEC4", "componentType": SHORT, "normalized": true });
        self.accessor(view, shape)
    }

    /// Texture coordinates as 16-bit fractions of their [`UvFrame`].
    pub fn uvs(&mut self, uvs: &[DVec2]) -> usize {
        let frame = UvFrame::of(uvs);
        let start = self.start();
        for &uv in uvs {
            let stored = (flipped(uv) - frame.offset) / frame.scale;
            for c in stored.to_array() {
                self.bytes
                    .extend(((c * 65_535.0).round() as u16).to_le_bytes());
            }
        }
        let view = self.view(start, json!({ "target": VERTICES, "byteStride": 4 }));
        let shape = json!({ "type": "VEC2", "componentType": UNSIGNED_SHORT, "normalized": true });
        self.accessor((view, uvs.len()), shape)
    }

    /// Moves of normals as 8-bit fractions of one, padded to four bytes.
    pub fn bytes(&mut self, moves: &[[i8; 3]]) -> usize {
        let view = self.padded(moves);
        let shape = json!({ "type": "VEC3", "componentType": BYTE, "normalized": true });
        self.accessor(view, shape)
    }

    /// Moves of positions in 8-bit cells.
    pub fn byte_cells(&mut self, moves: &[[i8; 3]]) -> usize {
        let view = self.padded(moves);
        let bound = |pick: fn(i8, i8) -> i8| {
            let merge = |a: [i8; 3], b: [i8; 3]| std::array::from_fn(|k| pick(a[k], b[k]));
            moves.iter().copied().reduce(merge).unwrap_or_default()
        };
        let (low, high) = (bound(i8::min), bound(i8::max));
        let shape = json!({ "type": "VEC3", "componentType": BYTE, "min": low, "max": high });
        self.accessor(view, shape)
    }

    fn padded(&mut self, moves: &[[i8; 3]]) -> (usize, usize) {
        let start = self.start();
        for [x, y, z] in moves {
            self.bytes.extend([*x as u8, *y as u8, *z as u8, 0]);
        }
        let view = self.view(start, json!({ "target": VERTICES, "byteStride": 4 }));
        (view, moves.len())
    }

    /// Turns of an animation as 16-bit fractions of one.
    pub fn short_turns(&mut self, turns: &[DQuat]) -> usize {
        let start = self.start();
        for c in turns.iter().flat_map(|q| q.to_array()) {
            self.bytes.extend(short(c).to_le_bytes());
        }
        let view = self.view(start, json!({}));
        let shape = json!({ "type": "VEC4", "componentType": SHORT, "normalized": true });
        self.accessor((view, turns.len()), shape)
    }

    /// Four bones a vertex.
    pub fn joints(&mut self, joints: impl ExactSizeIterator<Item = [u8; 4]>) -> usize {
        let (start, n) = (self.start(), joints.len());
        self.bytes.extend(joints.flatten());
        let view = self.view(start, json!({ "target": VERTICES, "byteStride": 4 }));
        let shape = json!({ "type": "VEC4", "componentType": UNSIGNED_BYTE });
        self.accessor((view, n), shape)
    }

    /// Their four weights in 65,535ths.
    pub fn short_weights(&mut self, weights: impl ExactSizeIterator<Item = [u16; 4]>) -> usize {
        let (start, n) = (self.start(), weights.len());
        for c in weights.flatten() {
            self.bytes.extend(c.to_le_bytes());
        }
        let view = self.view(start, json!({ "target": VERTICES, "byteStride": 8 }));
        let shape = json!({ "type": "VEC4", "componentType": UNSIGNED_SHORT, "normalized": true });
        self.accessor((view, n), shape)
    }

    /// Any floats, `N` to a vertex.
    pub fn attribute<const N: usize>(
        &mut self,
        values: impl ExactSizeIterator<Item = [f32; N]>,
        shape: Value,
    ) -> usize {
        let view = self.floats(values);
        self.accessor(view, shape)
    }

    /// Floats that are no vertices, such as times and places of an animation.
    pub fn keys<const N: usize>(
        &mut self,
        values: impl ExactSizeIterator<Item = [f32; N]>,
        shape: Value,
    ) -> usize {
        let (start, n) = (self.start(), values.len());
        for c in values.flatten() {
            self.bytes.extend(c.to_le_bytes());
        }
        let view = self.view(start, json!({}));
        self.accessor((view, n), shape)
    }

    /// Moves of a few of `n` vertices, in ascending order; the others stay.
    pub fn sparse(&mut self, moves: &[(u32, DVec3)], n: usize) -> usize {
        let start = self.start();
        moves
            .iter()
            .for_each(|m| self.bytes.extend(m.0.to_le_bytes()));
        let indices = self.view(start, json!({}));
        let start = self.start();
        for c in moves.iter().flat_map(|m| m.1.as_vec3().to_array()) {
            self.bytes.extend(c.to_le_bytes());
        }
        let values = self.view(start, json!({}));
        let mut all: Vec<DVec3> = moves.iter().map(|m| m.1.as_vec3().as_dvec3()).collect();
        if moves.len() < n {
            all.push(DVec3::ZERO);
        }
        let (low, high) = bounds(&all);
        self.accessors.push(json!({
            "type": "VEC3",
            "componentType": FLOAT,
            "count": n,
            "min": low.as_vec3().to_array(),
            "max": high.as_vec3().to_array(),
            "sparse": {
                "count": moves.len(),
                "indices": { "bufferView": indices, "componentType": UNSIGNED_INT },
                "values": { "bufferView": values },
            },
        }));
        self.accessors.len() - 1
    }

    /// Moves of `n` vertices that all stay.
    pub fn zeros(&mut self, n: usize) -> usize {
        let zero = [0.0; 3];
        self.accessors.push(json!({
            "type": "VEC3",
            "componentType": FLOAT,
            "count": n,
            "min": zero,
            "max": zero,
        }));
        self.accessors.len() - 1
    }

    /// Another file's view of these bytes, kept as it is but for its place.
    pub fn copied(&mut self, bytes: &[u8], view: &mut Value) -> usize {
        let start = self.start();
        self.bytes.extend(bytes);
        self.view(start, view.take())
    }

    /// Triangles; 16-bit where the vertices allow (65,535 is kept for restarts).
    pub fn indices(&mut self, faces: &[[u32; 3]], n_verts: usize) -> usize {
        let start = self.start();
        let is_short = n_verts <= 65_535;
        for &corner in faces.as_flattened() {
            match is_short {
                true => self.bytes.extend((corner as u16).to_le_bytes()),
                false => self.bytes.extend(corner.to_le_bytes()),
            }
        }
        let view = self.view(start, json!({ "target": TRIANGLES }));
        let kind = if is_short {
            UNSIGNED_SHORT
        } else {
            UNSIGNED_INT
        };
        self.accessor(
            (view, 3 * faces.len()),
            json!({ "type": "SCALAR", "componentType": kind }),
        )
    }

    /// Bytes that are no numbers, such as a picture.
    pub fn blob(&mut self, bytes: &[u8]) -> usize {
        let start = self.start();
        self.bytes.extend(bytes);
        self.view(start, json!({}))
    }

    /// Numbers of 32 bits, `N` to a vertex: the view and the count.
    fn floats<const N: usize>(
        &mut self,
        vectors: impl ExactSizeIterator<Item = [f32; N]>,
    ) -> (usize, usize) {
        let (start, n) = (self.start(), vectors.len());
        for c in vectors.flatten() {
            self.bytes.extend(c.to_le_bytes());
        }
        let shape = json!({ "target": VERTICES, "byteStride": 4 * N });
        (self.view(start, shape), n)
    }

    /// Numbers of 16 bits, padded to eight bytes a vertex as glTF's alignment wants.
    fn shorts<const N: usize>(&mut self, vectors: &[[i16; N]]) -> (usize, usize) {
        let start = self.start();
        for vector in vectors {
            let padding = std::iter::repeat_n(0, 4 - N);
            for c in vector.iter().copied().chain(padding) {
                self.bytes.extend(c.to_le_bytes());
            }
        }
        let shape = json!({ "target": VERTICES, "byteStride": 8 });
        (self.view(start, shape), vectors.len())
    }

    /// Where the next view starts.
    fn start(&mut self) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.bytes.len()
    }

    /// A view from `start` to the end so far.
    fn view(&mut self, start: usize, mut shape: Value) -> usize {
        shape["buffer"] = 0.into();
        shape["byteOffset"] = start.into();
        shape["byteLength"] = (self.bytes.len() - start).into();
        self.views.push(shape);
        self.views.len() - 1
    }

    /// An accessor over all of a view: `(view, count)`.
    pub fn accessor(&mut self, (view, count): (usize, usize), mut shape: Value) -> usize {
        shape["bufferView"] = view.into();
        shape["count"] = count.into();
        self.accessors.push(shape);
        self.accessors.len() - 1
    }
}

/// The corners of the box around `points`.
pub fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (
        low,
        points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max),
    )
}

/// A unit vector; a vertex without a direction of its own looks up.
fn unit(n: DVec3) -> DVec3 {
    n.try_normalize().unwrap_or(DVec3::Y)
}

/// A fraction of one in 16 bits.
fn short(c: f64) -> i16 {
    (c * 32_767.0).round() as i16
}

/// From v up to glTF's v down.
fn flipped(uv: DVec2) -> DVec2 {
    DVec2::new(uv.x, 1.0 - uv.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_moves_by_half_a_step_at_most() {
        let points: Vec<DVec3> = (0..500)
            .map(|i| {
                let t = f64::from(i) * 0.37;
                DVec3::new(
                    0.4 * t.sin(),
                    0.9 + 0.9 * (1.7 * t).cos(),
                    0.2 * (2.3 * t).sin(),
                )
            })
            .collect();
        let grid = Grid::around(&points);
        assert!(grid.step < 2.76e-5, "{}", grid.step);
        for &p in &points {
            let off = (grid.world(grid.nearest(p)) - p).abs().max_element();
            assert!(off <= 0.5 * f64::from(grid.step) * (1.0 + 1e-9), "{off}");
        }
    }

    #[test]
    fn one_point_or_a_huge_thing_still_has_a_grid() {
        for points in [
            vec![DVec3::splat(5.0)],
            vec![DVec3::splat(-1e6), DVec3::splat(1e6)],
        ] {
            let grid = Grid::around(&points);
            assert!(grid.step > 0.0);
            for &p in &points {
                assert!((grid.world(grid.nearest(p)) - p).length() <= f64::from(grid.step));
            }
        }
    }

    #[test]
    fn coordinates_in_the_square_stay_and_others_fit_into_it() {
        assert!(UvFrame::of(&[DVec2::ZERO, DVec2::ONE]).is_plain() && UvFrame::of(&[]).is_plain());
        let uvs = [DVec2::new(-0.5, 0.25), DVec2::new(1.5, 0.75)];
        let frame = UvFrame::of(&uvs);
        assert_eq!((frame.offset, frame.scale), (DVec2::new(-0.5, 0.25), 2.0));
    }
}
