//! From codes and bones to the vertices of one frame, sixteen at a time.

use glam::Vec3A;
use pulp::Simd;

use crate::blocks::{Blocks, WIDE, Wide};
use crate::steps::{Coder, Job, Sums, Two};

/// A bone: the columns of its matrix and its translation.
pub(crate) type Affine = [f32; 12];

/// Where a vertex is [m], and the sum of twice the faces around it [m²].
pub(crate) type Placed = [Vec3A; 2];

/// One frame.
pub(crate) struct One<'a> {
    pub blocks: &'a Blocks,
    /// Codes, each times what a step of it is worth.
    pub codes: &'a [f32],
    pub bones: &'a [Affine],
    /// Room for the codes in steps.
    pub twos: &'a mut [Two],
    pub out: &'a mut [[f32; 3]],
    /// Room for the vertices by places, and the normals, where they are asked for.
    pub normals: Option<(&'a mut [Placed], &'a mut [[f32; 3]])>,
}

impl Job for One<'_> {
    #[inline(always)]
    fn run<S: Simd, M: Sums>(self, on: S, sums: M) {
        let b = self.blocks;
        let coder = Coder::of(self.codes, b.most);
        let twos = coder.twos(self.codes);
        self.twos.iter_mut().zip(twos).for_each(|(to, z)| *to = z);
        let mut normals = self.normals;
        for block in 0..b.base.len() {
            let mut sum = [sums.none(); 3];
            for (row, two) in b.rows(block).iter().zip(&*self.twos) {
                let two = sums.alike(*two);
                for axis in 0..3 {
                    sum[axis] = sums.plus(sum[axis], sums.row(&row[axis]), two);
                }
            }
            let floats = |axis: usize| Wide(sums.floats(sum[axis]));
            let sum = [floats(0), floats(1), floats(2)];
            let worth = coder.worth * b.by_block[block];
            let x = skinned(on, (b, block), (&sum, worth), self.bones);
            put(b, block, &x, self.out);
            if let Some((room, _)) = &mut normals {
                let places = room[block * WIDE..].iter_mut().take(WIDE).enumerate();
                places.for_each(|(i, to)| {
                    *to = [Vec3A::new(x[0].0[i], x[1].0[i], x[2].0[i]), Vec3A::ZERO];
                });
            }
        }
        if let Some((room, out)) = normals {
            turn(b, room, out);
        }
    }
}

/// Unit normals, weighted by area; up where no face has any.
#[inline(always)]
fn turn(b: &Blocks, room: &mut [Placed], out: &mut [[f32; 3]]) {
    for face in &b.faces {
        let [p, q, r] = face.map(|v| v as usize);
        let here = room[p][0];
        let twice = (room[q][0] - here).cross(room[r][0] - here);
        room[p][1] += twice;
        room[q][1] += twice;
        room[r][1] += twice;
    }
    for ([_, n], v) in room.iter().zip(&b.order) {
        out[*v as usize] = n.normalize_or(Vec3A::Y).to_array();
    }
}

/// Corrected and carried by the bones.
#[inline(always)]
fn skinned<S: Simd>(
    on: S,
    (b, block): (&Blocks, usize),
    (sum, worth): (&[Wide; 3], f32),
    bones: &[Affine],
) -> [Wide; 3] {
    let span = b.starts[block] as usize..b.starts[block + 1] as usize;
    let (weights, own) = (&b.weights[span.clone()], &b.bones[span]);
    let worth = on.splat_f32s(worth);
    let mut out = [Wide::default(); 3];
    for r in 0..WIDE / S::F32_LANES {
        let rest = |axis: usize| {
            let (sum, base) = (at::<S>(&sum[axis], r), at::<S>(&b.base[block][axis], r));
            on.mul_add_e_f32s(sum, worth, base)
        };
        let p = [rest(0), rest(1), rest(2)];
        let mut m = [on.splat_f32s(0.0); 12];
        for (w, bone) in weights.iter().zip(own) {
            let (w, bone) = (at::<S>(w, r), &bones[usize::from(*bone)]);
            for (m, a) in m.iter_mut().zip(bone) {
                *m = on.mul_add_e_f32s(w, on.splat_f32s(*a), *m);
            }
        }
        for axis in 0..3 {
            let x = carried(on, (&m, axis), &p);
            S::as_mut_simd_f32s(&mut out[axis].0).0[r] = x;
        }
    }
    out
}

/// A coordinate of a point carried by a matrix.
#[inline(always)]
pub(crate) fn carried<S: Simd>(
    on: S,
    (m, axis): (&[S::f32s; 12], usize),
    p: &[S::f32s; 3],
) -> S::f32s {
    let mut x = on.mul_add_e_f32s(m[axis], p[0], m[9 + axis]);
    x = on.mul_add_e_f32s(m[3 + axis], p[1], x);
    on.mul_add_e_f32s(m[6 + axis], p[2], x)
}

/// Register `r` of a block.
#[inline(always)]
pub(crate) fn at<S: Simd>(x: &Wide, r: usize) -> S::f32s {
    S::as_simd_f32s(&x.0).0[r]
}

/// Each vertex to its place in the mesh.
#[inline(always)]
fn put(b: &Blocks, block: usize, x: &[Wide; 3], out: &mut [[f32; 3]]) {
    let order = b.order[block * WIDE..].iter().take(WIDE);
    for (i, &v) in order.enumerate() {
        out[v as usize] = [x[0].0[i], x[1].0[i], x[2].0[i]];
    }
}
