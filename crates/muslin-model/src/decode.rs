//! From codes and bones to the vertices of one frame, sixteen at a time.

use glam::{Mat3A, Vec3A};
use pulp::Simd;

use crate::Model;
use crate::blocks::{Blocks, WIDE, Wide};
use crate::steps::{self, Coder, Job, Sums, Two};

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
    /// Room for the codes in steps, and for the vertices by places.
    pub twos: &'a mut [Two],
    pub lie: &'a mut [Placed],
    /// Whether the last block comes first: what was read last is still near.
    pub backwards: bool,
    pub out: &'a mut [[f32; 3]],
    /// Room for the normals' lengths by places, and the normals, where they are asked for.
    pub normals: Option<(&'a mut [Wide], &'a mut [[f32; 3]])>,
}

impl Job for One<'_> {
    #[inline(always)]
    fn run<S: Simd, M: Sums>(self, on: S, sums: M) {
        let b = self.blocks;
        let worth = coded(b, self.codes, self.twos);
        for k in 0..b.base.len() {
            let block = b.turn(k, self.backwards);
            let sum = mixed(sums, (b, block), self.twos);
            let worth = worth * b.by_block[block];
            let mut x = [Wide::default(); 3];
            for r in 0..WIDE / S::F32_LANES {
                let (at, _) = skinned(on, (b, block, r), (&sum, worth), self.bones);
                (0..3).for_each(|axis| set::<S>(&mut x[axis], r, at[axis]));
            }
            let places = block * WIDE..b.n_verts.min((block + 1) * WIDE);
            // Written out: what `zip` and `take` call is not always inlined here.
            for (i, to) in self.lie[places].iter_mut().enumerate() {
                *to = [Vec3A::new(x[0].0[i], x[1].0[i], x[2].0[i]), Vec3A::ZERO];
            }
        }
        // Read in the order of places and written in that of the mesh: it is stores that wait for memory.
        let (lie, places) = (self.lie, b.places.iter());
        let Some((lengths, normals)) = self.normals else {
            for (x, place) in self.out.iter_mut().zip(places) {
                *x = lie[*place as usize][0].to_array();
            }
            return;
        };
        turn(b, lie);
        inverse_lengths(on, lie, lengths);
        for ((x, n), place) in self.out.iter_mut().zip(normals).zip(places) {
            let place = *place as usize;
            let ([at, around], by) = (lie[place], lengths[place / WIDE].0[place % WIDE]);
            *x = at.to_array();
            *n = if by == 0.0 { Vec3A::Y } else { around * by }.to_array();
        }
    }
}

/// Adds twice every face to its corners.
#[inline(always)]
fn turn(b: &Blocks, lie: &mut [Placed]) {
    for face in &b.faces {
        let [p, q, r] = face.map(|v| v as usize);
        let here = lie[p][0];
        let twice = (lie[q][0] - here).cross(lie[r][0] - here);
        lie[p][1] += twice;
        lie[q][1] += twice;
        lie[r][1] += twice;
    }
}

/// One over the length of what is around each place; zero where it is nothing.
///
/// All squares first: sixteen that are read as they are written would wait for memory.
#[inline(always)]
fn inverse_lengths<S: Simd>(on: S, lie: &[Placed], out: &mut [Wide]) {
    for (lot, to) in lie.chunks(WIDE).zip(out.iter_mut()) {
        for (i, [_, around]) in lot.iter().enumerate() {
            to.0[i] = around.length_squared();
        }
    }
    for by in out {
        for by in S::as_mut_simd_f32s(&mut by.0).0 {
            let zero = on.splat_f32s(0.0);
            let some = on.greater_than_f32s(*by, zero);
            let inverse = on.div_f32s(on.splat_f32s(1.0), on.sqrt_f32s(*by));
            *by = on.select_f32s(some, inverse, zero);
        }
    }
}

/// One frame of points: where each of them is carried [m], and how what is around it is turned.
struct Turned<'a> {
    blocks: &'a Blocks,
    /// Codes, each times what a step of it is worth.
    codes: &'a [f32],
    bones: &'a [Affine],
    /// Room for the codes in steps.
    twos: &'a mut [Two],
    out: &'a mut [(Vec3A, Mat3A)],
}

impl Job for Turned<'_> {
    #[inline(always)]
    fn run<S: Simd, M: Sums>(self, on: S, sums: M) {
        let b = self.blocks;
        let worth = coded(b, self.codes, self.twos);
        for block in 0..b.base.len() {
            let sum = mixed(sums, (b, block), self.twos);
            let worth = worth * b.by_block[block];
            // The columns of its turn, and where it is.
            let mut all = [Wide::default(); 12];
            for r in 0..WIDE / S::F32_LANES {
                let (x, m) = skinned(on, (b, block, r), (&sum, worth), self.bones);
                (0..9).for_each(|k| set::<S>(&mut all[k], r, m[k]));
                (0..3).for_each(|k| set::<S>(&mut all[9 + k], r, x[k]));
            }
            let order = b.order[block * WIDE..].iter().take(WIDE);
            for (i, v) in order.enumerate() {
                let column = |k: usize| Vec3A::new(all[k].0[i], all[k + 1].0[i], all[k + 2].0[i]);
                let turn = Mat3A::from_cols(column(0), column(3), column(6));
                self.out[*v as usize] = (column(9), turn);
            }
        }
    }
}

/// Points on the cloth or on skin that are posed by themselves, and room for their codes.
#[derive(Clone, Debug)]
pub(crate) struct Points {
    blocks: Blocks,
    codes: Vec<f32>,
    twos: Vec<Two>,
    lie: Vec<Placed>,
}

impl Points {
    /// The vertices of a model that does not swing.
    pub fn of(model: &Model) -> Self {
        let blocks = Blocks::new(model);
        Self {
            codes: vec![0.0; blocks.n_codes],
            twos: vec![[0; 2]; blocks.n_twos()],
            lie: vec![[Vec3A::ZERO; 2]; blocks.n_verts],
            blocks,
        }
    }

    /// Takes what a pose mixes shapes by.
    #[inline(always)]
    fn mix(&mut self, z: &[f32]) {
        let worths = z.iter().zip(&self.blocks.by_code);
        (self.codes.iter_mut().zip(worths)).for_each(|(to, (z, worth))| *to = z * worth);
    }

    /// Where they are [m] in a pose that mixes shapes by `z`.
    #[inline(always)]
    pub fn laid(&mut self, (z, bones): (&[f32], &[Affine]), out: &mut [[f32; 3]]) {
        self.mix(z);
        steps::fastest(One {
            blocks: &self.blocks,
            codes: &self.codes,
            bones,
            twos: &mut self.twos,
            lie: &mut self.lie,
            backwards: false,
            out,
            normals: None,
        });
    }

    /// [`Points::laid`], and how what is around them is turned.
    #[inline(always)]
    pub fn turned(&mut self, (z, bones): (&[f32], &[Affine]), out: &mut [(Vec3A, Mat3A)]) {
        self.mix(z);
        steps::fastest(Turned {
            blocks: &self.blocks,
            codes: &self.codes,
            bones,
            twos: &mut self.twos,
            out,
        });
    }
}

/// Codes in steps; what a step is worth.
#[inline(always)]
fn coded(b: &Blocks, codes: &[f32], twos: &mut [Two]) -> f32 {
    let coder = Coder::of(codes, b.most);
    let steps = twos.iter_mut().zip(coder.twos(codes));
    steps.for_each(|(to, z)| *to = z);
    coder.worth
}

/// What codes make of a block's shapes, in steps.
#[inline(always)]
fn mixed<M: Sums>(sums: M, (b, block): (&Blocks, usize), twos: &[Two]) -> [Wide; 3] {
    let mut sum = [sums.none(); 3];
    for (row, two) in b.rows(block).iter().zip(twos) {
        let two = sums.alike(*two);
        for axis in 0..3 {
            sum[axis] = sums.plus(sum[axis], sums.row(&row[axis]), two);
        }
    }
    let floats = |axis: usize| Wide(sums.floats(sum[axis]));
    [floats(0), floats(1), floats(2)]
}

/// Register `r` of a block, corrected and carried by the bones, and the mean of their matrices.
#[inline(always)]
fn skinned<S: Simd>(
    on: S,
    (b, block, r): (&Blocks, usize, usize),
    (sum, worth): (&[Wide; 3], f32),
    bones: &[Affine],
) -> ([S::f32s; 3], [S::f32s; 12]) {
    let span = b.starts[block] as usize..b.starts[block + 1] as usize;
    let (weights, own) = (&b.weights[span.clone()], &b.bones[span]);
    let worth = on.splat_f32s(worth);
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
    let x = |axis: usize| carried(on, (&m, axis), &p);
    ([x(0), x(1), x(2)], m)
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

/// Sets register `r` of a block.
#[inline(always)]
fn set<S: Simd>(x: &mut Wide, r: usize, to: S::f32s) {
    S::as_mut_simd_f32s(&mut x.0).0[r] = to;
}
