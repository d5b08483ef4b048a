//! From codes and bones to vertices, sixteen at a time.

use pulp::{Simd, WithSimd};

use crate::blocks::{Blocks, WIDE, Wide};

/// Frames whose sums are kept in registers together.
const TOGETHER: usize = 2;

/// A bone: the columns of its matrix and its translation.
pub(crate) type Affine = [f32; 12];

/// One frame.
pub(crate) struct One<'a> {
    pub blocks: &'a Blocks,
    /// Codes, each times what a step of it is worth.
    pub codes: &'a [f32],
    pub bones: &'a [Affine],
    pub out: &'a mut [[f32; 3]],
}

/// Several frames, one after the other in all of the lists.
pub(crate) struct Many<'a> {
    pub blocks: &'a Blocks,
    pub codes: &'a [f32],
    pub bones: &'a [Affine],
    /// Room for the shapes of a block.
    pub room: &'a mut [Wide],
    pub out: &'a mut [[f32; 3]],
}

impl WithSimd for One<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let b = self.blocks;
        for block in 0..b.base.len() {
            let mut sum = [Wide::default(); 3];
            for (row, &z) in b.rows(block).as_chunks::<3>().0.iter().zip(self.codes) {
                for axis in 0..3 {
                    let (row, sum) = (&row[axis], &mut sum[axis].0);
                    for i in 0..WIDE {
                        let m = f32::from(row[i]);
                        sum[i] = match S::IS_SCALAR {
                            true => m * z + sum[i],
                            false => m.mul_add(z, sum[i]),
                        };
                    }
                }
            }
            let x = skinned(simd, (b, block), (&sum, self.bones));
            put(b, block, &x, self.out);
        }
    }
}

impl WithSimd for Many<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let b = self.blocks;
        let frames = self.out.len() / b.n_verts;
        let n_bones = self.bones.len() / frames;
        for block in 0..b.base.len() {
            for (to, row) in self.room.iter_mut().zip(b.rows(block)) {
                to.0 = row.map(f32::from);
            }
            for first in (0..frames).step_by(TOGETHER) {
                // The last frame is worked on again where there is no other.
                let which: [usize; TOGETHER] = std::array::from_fn(|k| (first + k).min(frames - 1));
                let codes = which.map(|f| &self.codes[b.n_codes * f..b.n_codes * (f + 1)]);
                let sums = mixed(simd, self.room, codes);
                for (f, sum) in which.iter().zip(&sums) {
                    let bones = &self.bones[n_bones * f..n_bones * (f + 1)];
                    let x = skinned(simd, (b, block), (sum, bones));
                    let out = &mut self.out[b.n_verts * f..b.n_verts * (f + 1)];
                    put(b, block, &x, out);
                }
            }
        }
    }
}

/// The shapes of a block, three axes a code, mixed by the codes of several frames.
#[inline(always)]
fn mixed<S: Simd>(simd: S, rows: &[Wide], codes: [&[f32]; TOGETHER]) -> [[Wide; 3]; TOGETHER] {
    let mut out = [[Wide::default(); 3]; TOGETHER];
    for r in (0..WIDE / S::F32_LANES).step_by(2) {
        // Two registers at a time: sums that wait for each other keep no unit busy.
        let next = (r + 1).min(WIDE / S::F32_LANES - 1);
        let mut sum = [[[simd.splat_f32s(0.0); 3]; 2]; TOGETHER];
        for ((row, z0), z1) in rows.as_chunks::<3>().0.iter().zip(codes[0]).zip(codes[1]) {
            let z = [simd.splat_f32s(*z0), simd.splat_f32s(*z1)];
            for axis in 0..3 {
                let (a, b) = (at::<S>(&row[axis], r), at::<S>(&row[axis], next));
                for f in 0..TOGETHER {
                    sum[f][0][axis] = simd.mul_add_e_f32s(a, z[f], sum[f][0][axis]);
                    sum[f][1][axis] = simd.mul_add_e_f32s(b, z[f], sum[f][1][axis]);
                }
            }
        }
        for f in 0..TOGETHER {
            for axis in 0..3 {
                S::as_mut_simd_f32s(&mut out[f][axis].0).0[r] = sum[f][0][axis];
                S::as_mut_simd_f32s(&mut out[f][axis].0).0[next] = sum[f][1][axis];
            }
        }
    }
    out
}

/// Corrected and carried by the bones.
#[inline(always)]
fn skinned<S: Simd>(
    simd: S,
    (b, block): (&Blocks, usize),
    (sum, bones): (&[Wide; 3], &[Affine]),
) -> [Wide; 3] {
    let span = b.starts[block] as usize..b.starts[block + 1] as usize;
    let (weights, own) = (&b.weights[span.clone()], &b.bones[span]);
    let step = simd.splat_f32s(b.by_block[block]);
    let mut out = [Wide::default(); 3];
    for r in 0..WIDE / S::F32_LANES {
        let rest = |axis: usize| {
            let (sum, base) = (at::<S>(&sum[axis], r), at::<S>(&b.base[block][axis], r));
            simd.mul_add_e_f32s(sum, step, base)
        };
        let p = [rest(0), rest(1), rest(2)];
        let mut x = [simd.splat_f32s(0.0); 3];
        for (w, bone) in weights.iter().zip(own) {
            let (w, a) = (at::<S>(w, r), &bones[usize::from(*bone)]);
            for axis in 0..3 {
                let entry = |k: usize| simd.splat_f32s(a[k + axis]);
                let mut to = simd.mul_add_e_f32s(entry(0), p[0], entry(9));
                to = simd.mul_add_e_f32s(entry(3), p[1], to);
                to = simd.mul_add_e_f32s(entry(6), p[2], to);
                x[axis] = simd.mul_add_e_f32s(w, to, x[axis]);
            }
        }
        for axis in 0..3 {
            S::as_mut_simd_f32s(&mut out[axis].0).0[r] = x[axis];
        }
    }
    out
}

/// Register `r` of a block.
#[inline(always)]
fn at<S: Simd>(x: &Wide, r: usize) -> S::f32s {
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
