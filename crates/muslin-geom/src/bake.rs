//! Moving cloth as few things: handles that carry it, and shapes that mend what handles cannot.
//!
//! Handles are found from the motion alone: skinning decomposition with rigid bones and few weights a
//! vertex (Le and Deng 2012), vertices grouped first by who moves alike. Shapes are the main components of
//! what is left where handles are undone.

mod handles;
mod shapes;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::{neighbours, vertex_normals};

/// How much there may be of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bake {
    /// Handles, one at least.
    pub handles: usize,
    /// Shapes, or none.
    pub shapes: usize,
}

/// Frames of cloth as handles and shapes. Frame 0 is the rest shape: handles have not moved there, and no
/// shape counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Baked {
    /// Where the vertices rest [m].
    pub rest: Vec<DVec3>,
    /// Vertex → (handle, weight), four at most, which sum to one.
    pub weights: Vec<Vec<(u32, f64)>>,
    /// Where the handles rest [m]: in the middle of what they carry.
    pub centres: Vec<DVec3>,
    /// Frame → handle: turn and way from rest.
    pub moves: Vec<Vec<DAffine3>>,
    /// Shape → vertex: displacement at rest [m], before handles carry it.
    pub shapes: Vec<Vec<DVec3>>,
    /// Frame → shape: how much of it.
    pub codes: Vec<Vec<f64>>,
}

/// Frames that handles, weights and shapes are chosen by, at most; all frames are then followed.
const CHOSEN: usize = 120;

impl Baked {
    /// What comes nearest to `frames` of cloth with these triangles. Frames have equally many vertices, one
    /// at least.
    pub fn new(frames: &[Vec<DVec3>], faces: &[[u32; 3]], bake: Bake) -> Self {
        let rest = frames[0].clone();
        let near = neighbours(rest.len(), faces);
        let chosen: Vec<&[DVec3]> = even(frames.len(), CHOSEN).map(|t| &frames[t][..]).collect();
        let weights = handles::weights((&rest, &near), &chosen, bake.handles.max(1));
        let (weights, centres) = handles::used(&rest, weights);
        let follow = |x: &Vec<DVec3>| handles::follow((&rest, &weights, &centres), x);
        let mut baked = Self {
            moves: frames.par_iter().map(follow).collect(),
            codes: vec![Vec::new(); frames.len()],
            shapes: Vec::new(),
            rest,
            weights,
            centres,
        };
        if bake.shapes > 0 {
            let chosen: Vec<usize> = even(frames.len(), 2 * CHOSEN).collect();
            baked.shapes = shapes::main(&baked.left((frames, &chosen)), bake.shapes);
            let code = |(t, x): (usize, &Vec<DVec3>)| shapes::code(&baked, t, (x, &[]));
            baked.codes = frames.par_iter().enumerate().map(code).collect();
        }
        baked
    }

    /// The vertices in frame `t` [m].
    pub fn frame(&self, t: usize) -> Vec<DVec3> {
        let place = |v: usize| self.carried((t, v)).transform_point3(self.shaped((t, v)));
        (0..self.rest.len()).map(place).collect()
    }

    /// Frame `t` alone.
    pub fn only(&self, t: usize) -> Self {
        Self {
            moves: vec![self.moves[t].clone()],
            codes: vec![self.codes[t].clone()],
            ..self.clone()
        }
    }

    /// Leads frame `t` nearer to `x`, where each vertex counts as much as `pull` says.
    pub fn lead(&mut self, t: usize, (x, pull): (&[DVec3], &[f64])) {
        // What handles are to reach is what the shapes leave.
        let left = |v: usize| {
            let by = self.shaped((t, v)) - self.rest[v];
            x[v] - self.carried((t, v)).transform_vector3(by)
        };
        let wanted: Vec<DVec3> = (0..x.len()).map(left).collect();
        let mut moves = self.moves[t].clone();
        handles::lead((&self.rest, &self.weights), (&wanted, pull), &mut moves);
        self.moves[t] = moves;
        if !self.shapes.is_empty() {
            self.codes[t] = shapes::code(self, t, (x, pull));
        }
    }

    /// What takes vertex `v` from rest into frame `t`.
    fn carried(&self, (t, v): (usize, usize)) -> DAffine3 {
        blend(&self.weights[v], &self.moves[t])
    }

    /// Where a vertex is before handles carry it.
    fn shaped(&self, (t, v): (usize, usize)) -> DVec3 {
        let by = self.shapes.iter().zip(&self.codes[t]);
        self.rest[v] + by.map(|(s, c)| *c * s[v]).sum::<DVec3>()
    }

    /// What handles leave, brought back to rest: frame → vertex.
    fn left(&self, (frames, chosen): (&[Vec<DVec3>], &[usize])) -> Vec<Vec<DVec3>> {
        let one = |t: &usize| {
            let back = |(v, x): (usize, &DVec3)| {
                let d = self.carried((*t, v)).inverse().transform_point3(*x) - self.rest[v];
                if d.is_finite() { d } else { DVec3::ZERO }
            };
            frames[*t].iter().enumerate().map(back).collect()
        };
        chosen.par_iter().map(one).collect()
    }

    /// The normals at rest, and how each shape changes them, in least squares over the frames.
    pub fn normals(
        &self,
        frames: &[Vec<DVec3>],
        faces: &[[u32; 3]],
    ) -> (Vec<DVec3>, Vec<Vec<DVec3>>) {
        let unit = |n: DVec3| n.try_normalize().unwrap_or(DVec3::Y);
        let rest: Vec<DVec3> = (vertex_normals(&self.rest, faces).into_iter())
            .map(unit)
            .collect();
        if self.shapes.is_empty() {
            return (rest, Vec::new());
        }
        let chosen: Vec<usize> = even(frames.len(), CHOSEN).collect();
        let one = |t: &usize| {
            let normals = vertex_normals(&frames[*t], faces);
            let back = |(v, n): (usize, DVec3)| {
                // Handles turn, so that the transpose takes back.
                let turn = self.carried((*t, v)).matrix3.transpose();
                unit(turn * n) - rest[v]
            };
            normals.into_iter().enumerate().map(back).collect()
        };
        let changes: Vec<Vec<DVec3>> = chosen.par_iter().map(one).collect();
        let codes: Vec<&[f64]> = chosen.iter().map(|t| &self.codes[*t][..]).collect();
        let bends = shapes::explained(&changes, &codes);
        (rest, bends)
    }
}

/// Mean of moves.
fn blend(row: &[(u32, f64)], moves: &[DAffine3]) -> DAffine3 {
    let zero = DAffine3::from_cols_array(&[0.0; 12]);
    row.iter().fold(zero, |sum, (h, w)| {
        let m = moves[*h as usize];
        DAffine3 {
            matrix3: sum.matrix3 + m.matrix3 * *w,
            translation: sum.translation + m.translation * *w,
        }
    })
}

/// At most `most` of `n`, evenly, the first among them.
fn even(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let m = n.min(most);
    (0..m).map(move |i| i * n / m)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::Mesh;

    /// A sheet of so many squares of 2 cm.
    fn sheet(cols: usize, rows: usize) -> Mesh {
        let at = |c: usize, r: usize| (r * (cols + 1) + c) as u32;
        let place =
            |i: usize| 0.02 * DVec3::new((i % (cols + 1)) as f64, (i / (cols + 1)) as f64, 0.0);
        let pair = |i: usize| {
            let (c, r) = (i % cols, i / cols);
            [
                [at(c, r), at(c + 1, r), at(c + 1, r + 1)],
                [at(c, r), at(c + 1, r + 1), at(c, r + 1)],
            ]
        };
        Mesh {
            verts: (0..(cols + 1) * (rows + 1)).map(place).collect(),
            faces: (0..cols * rows).flat_map(pair).collect(),
        }
    }

    fn worst(baked: &Baked, frames: &[Vec<DVec3>]) -> f64 {
        let one = |(t, x): (usize, &Vec<DVec3>)| {
            let gaps = baked
                .frame(t)
                .into_iter()
                .zip(x)
                .map(|(a, b)| a.distance(*b));
            gaps.fold(0.0, f64::max)
        };
        frames.iter().enumerate().map(one).fold(0.0, f64::max)
    }

    /// A sheet whose two halves turn apart about its middle line, its rows bound to both near there.
    fn hinge() -> (Vec<Vec<DVec3>>, Vec<[u32; 3]>) {
        let mesh = sheet(12, 24);
        let (low, high) = (mesh.verts[0].y, mesh.verts[mesh.verts.len() - 1].y);
        let share = |p: &DVec3| {
            let s = (p.y - low) / (high - low);
            (6.0 * (s - 0.5) + 0.5).clamp(0.0, 1.0)
        };
        let frame = |t: usize| {
            let turn = DAffine3::from_axis_angle(DVec3::X, 0.05 * t as f64);
            let back = DAffine3::from_translation(DVec3::new(0.0, 0.02 * t as f64, 0.0));
            let place = |p: &DVec3| {
                let s = share(p);
                (1.0 - s) * back.transform_point3(*p) + s * turn.transform_point3(*p)
            };
            mesh.verts.iter().map(place).collect()
        };
        ((0..20).map(frame).collect(), mesh.faces.clone())
    }

    #[test]
    fn what_two_bones_moved_is_found_again() {
        let (frames, faces) = hinge();
        let bake = Bake {
            handles: 2,
            shapes: 0,
        };
        let two = Baked::new(&frames, &faces, bake);
        assert_eq!(two.centres.len(), 2);
        let size = frames[0]
            .iter()
            .map(|p| p.distance(frames[19][0]))
            .fold(0.0, f64::max);
        assert!(
            worst(&two, &frames) < 1e-2 * size,
            "{}",
            worst(&two, &frames) / size
        );
        let one = Baked::new(&frames, &faces, Bake { handles: 1, ..bake });
        assert!(worst(&one, &frames) > 0.05 * size, "one cannot");
        for row in &two.weights {
            let sum: f64 = row.iter().map(|w| w.1).sum();
            assert!((sum - 1.0).abs() < 1e-12 && row.iter().all(|w| w.1 > 0.0) && row.len() <= 4);
        }
    }

    #[test]
    fn a_wave_that_no_handle_carries_is_a_shape() {
        let mesh = sheet(20, 20);
        let frame = |t: usize| {
            let turn = DQuat::from_rotation_y(0.1 * t as f64);
            let wave = |p: &DVec3| {
                let by = 0.02 * (0.7 * t as f64).sin() * (40.0 * p.x).sin() * (31.0 * p.y).cos();
                turn * (*p + by * DVec3::Z)
            };
            mesh.verts.iter().map(wave).collect::<Vec<_>>()
        };
        let frames: Vec<_> = (0..30).map(frame).collect();
        let bake = Bake {
            handles: 1,
            shapes: 2,
        };
        let baked = Baked::new(&frames, &mesh.faces, bake);
        assert!(worst(&baked, &frames) < 1e-5, "{}", worst(&baked, &frames));
        let bare = Baked::new(&frames, &mesh.faces, Bake { shapes: 0, ..bake });
        assert!(worst(&bare, &frames) > 0.01);
        let (rest, bends) = baked.normals(&frames, &mesh.faces);
        let t = 2;
        let truth = vertex_normals(&frames[t], &mesh.faces);
        for v in 0..rest.len() {
            let bent = rest[v]
                + (bends.iter().zip(&baked.codes[t]))
                    .map(|(b, c)| *c * b[v])
                    .sum::<DVec3>();
            let found = (baked.carried((t, v)).matrix3 * bent).normalize();
            assert!(found.dot(truth[v].normalize()) > 0.97, "{v}");
        }
    }

    #[test]
    fn as_many_shapes_as_there_are_waves_are_found() {
        let mesh = sheet(20, 20);
        let frame = |t: usize| {
            let wave = |p: &DVec3| {
                let one = |k: usize| {
                    let (k, t) = (k as f64, t as f64);
                    (0.37 * t * (1.0 + k)).sin() * ((9.0 + 7.0 * k) * p.x + 5.0 * k * p.y).sin()
                };
                *p + 0.005 * (0..6).map(one).sum::<f64>() * DVec3::Z
            };
            mesh.verts.iter().map(wave).collect::<Vec<_>>()
        };
        let frames: Vec<_> = (0..40).map(frame).collect();
        let off = |shapes: usize| {
            let bake = Bake { handles: 1, shapes };
            worst(&Baked::new(&frames, &mesh.faces, bake), &frames)
        };
        assert!(off(6) < 5e-4, "{}", off(6));
        assert!(off(5) > 1e-3, "{}", off(5));
    }

    #[test]
    fn vertices_that_count_more_are_led_nearer() {
        let (frames, faces) = hinge();
        for shapes in [0, 3] {
            let bake = Bake { handles: 3, shapes };
            let mut baked = Baked::new(&frames, &faces, bake);
            let (t, v) = (12, 40);
            let mut wanted = frames[t].clone();
            wanted[v] += 0.01 * DVec3::Z;
            let mut pull = vec![1.0; wanted.len()];
            pull[v] = 500.0;
            let off = |b: &Baked| b.frame(t)[v].distance(wanted[v]);
            let before = off(&baked);
            baked.lead(t, (&wanted, &pull));
            assert!(off(&baked) < 0.5 * before, "{} of {before}", off(&baked));
            let others = baked.only(t).frame(0);
            let gaps = others.iter().zip(&frames[t]).map(|(a, b)| a.distance(*b));
            assert!(
                gaps.fold(0.0, f64::max) < 0.02,
                "the others stay about there"
            );
        }
    }

    #[test]
    fn one_frame_and_one_vertex_are_enough() {
        let frames = vec![vec![DVec3::ONE]];
        let bake = Bake {
            handles: 8,
            shapes: 4,
        };
        let baked = Baked::new(&frames, &[], bake);
        assert_eq!(
            (baked.frame(0), baked.centres.len()),
            (frames[0].clone(), 1)
        );
    }

    #[test]
    fn frame_zero_is_the_rest_shape_with_handles_and_codes_at_zero() {
        let (frames, faces) = hinge();
        let bake = Bake {
            handles: 4,
            shapes: 3,
        };
        let baked = Baked::new(&frames, &faces, bake);
        assert!(
            baked.codes[0].iter().all(|c| c.abs() < 1e-9),
            "{:?}",
            baked.codes[0]
        );
        let gap = |m: &DAffine3| m.transform_point3(DVec3::ONE).distance(DVec3::ONE);
        assert!(baked.moves[0].iter().map(gap).fold(0.0, f64::max) < 1e-9);
    }
}
