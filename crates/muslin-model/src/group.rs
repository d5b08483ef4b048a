//! Sixteen frames at a time: what is one number in a frame is a register here.

use pulp::Simd;

use crate::blocks::{Blocks, WIDE, Wide};
use crate::decode::{Affine, at, carried};
use crate::fans::Fans;
use crate::steps::{Coder, Job, Steps, Sums, Two};

/// Frames in a group.
pub(crate) const GROUP: usize = WIDE;

/// Room for a group of frames.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// Two codes of each frame.
    twos: Vec<Steps>,
    /// What a step of each frame's codes is worth.
    worth: Wide,
    /// Entries of each bone's matrix.
    bones: Vec<[Wide; 12]>,
    /// Where the vertex at each place is.
    x: Vec<[Wide; 3]>,
    /// What is given of each vertex, in the order of the mesh.
    given: Vec<[Wide; 3]>,
}

impl Room {
    pub fn new(blocks: &Blocks, n_bones: usize) -> Self {
        Self {
            twos: vec![Steps::default(); blocks.n_twos()],
            worth: Wide::default(),
            bones: vec![[Wide::default(); 12]; n_bones],
            x: vec![[Wide::default(); 3]; blocks.n_verts],
            given: vec![[Wide::default(); 3]; blocks.n_verts],
        }
    }
}

/// Frames one after the other in all of the lists, a group at most.
pub(crate) struct Group<'a> {
    pub blocks: &'a Blocks,
    /// Codes, each times what a step of it is worth.
    pub codes: &'a [f32],
    pub bones: &'a [Affine],
    pub room: &'a mut Room,
    /// Whether the last block comes first: what was read last is still near.
    pub backwards: bool,
    pub out: &'a mut [[f32; 3]],
    /// Normals, where they are asked for.
    pub normals: Option<&'a mut [[f32; 3]]>,
}

impl Job for Group<'_> {
    #[inline(always)]
    fn run<S: Simd, M: Sums>(mut self, on: S, sums: M) {
        self.gather();
        let b = self.blocks;
        for k in 0..b.base.len() {
            let block = b.turn(k, self.backwards);
            // As many vertices together as registers hold sums of.
            if S::F32_LANES == WIDE {
                self.block::<S, M, 4>(on, sums, block);
            } else {
                self.block::<S, M, 2>(on, sums, block);
            }
        }
        let Room { x, given, .. } = self.room;
        spread(sums, given, self.out);
        if let Some(out) = self.normals {
            for (place, v) in b.order.iter().enumerate() {
                given[*v as usize] = normal(on, &b.fans, (place, x));
            }
            spread(sums, given, out);
        }
    }
}

impl Group<'_> {
    /// Codes and bones, frame beside frame.
    #[inline(always)]
    fn gather(&mut self) {
        let n_codes = self.blocks.n_codes;
        let room = &mut *self.room;
        room.worth = Wide::default();
        for (f, codes) in self.codes.chunks_exact(n_codes.max(1)).enumerate() {
            let coder = Coder::of(codes, self.blocks.most);
            room.worth.0[f] = coder.worth;
            let twos = room.twos.iter_mut().zip(coder.twos(codes));
            twos.for_each(|(to, z)| to.0[f] = z);
        }
        let n_bones = room.bones.len();
        for (f, bones) in self.bones.chunks_exact(n_bones.max(1)).enumerate() {
            for (to, bone) in room.bones.iter_mut().zip(bones) {
                to.iter_mut().zip(bone).for_each(|(to, x)| to.0[f] = *x);
            }
        }
    }

    /// A block of vertices into all frames, a few at a time.
    #[inline(always)]
    fn block<S: Simd, M: Sums, const K: usize>(&mut self, on: S, sums: M, block: usize) {
        for first in (0..WIDE).step_by(K) {
            if WIDE * block + first < self.blocks.n_verts {
                self.few::<S, M, K>(on, sums, (block, first));
            }
        }
    }

    #[inline(always)]
    fn few<S: Simd, M: Sums, const K: usize>(
        &mut self,
        on: S,
        sums: M,
        (block, first): (usize, usize),
    ) {
        let b = self.blocks;
        let mut sum = [[sums.none(); 3]; K];
        for (row, codes) in b.rows(block).iter().zip(&self.room.twos) {
            let codes = sums.row(codes);
            for (k, sum) in sum.iter_mut().enumerate() {
                for axis in 0..3 {
                    let shape: Two = row[axis].0[first + k];
                    sum[axis] = sums.plus(sum[axis], sums.alike(shape), codes);
                }
            }
        }
        for (k, sum) in sum.into_iter().enumerate() {
            let place = WIDE * block + first + k;
            if place < b.n_verts {
                let floats = |axis: usize| Wide(sums.floats(sum[axis]));
                let sum = [floats(0), floats(1), floats(2)];
                self.carry(on, (block, first + k), &sum);
            }
        }
    }

    /// A vertex, corrected and carried by its bones, in all frames.
    #[inline(always)]
    fn carry<S: Simd>(&mut self, on: S, (block, i): (usize, usize), sum: &[Wide; 3]) {
        let (b, room, place) = (self.blocks, &mut *self.room, WIDE * block + i);
        let own = &b.followed[b.follows[place] as usize..b.follows[place + 1] as usize];
        let mut out = [Wide::default(); 3];
        for r in 0..GROUP / S::F32_LANES {
            let worth = on.mul_f32s(at::<S>(&room.worth, r), on.splat_f32s(b.by_block[block]));
            let rest = |axis: usize| {
                let base = on.splat_f32s(b.base[block][axis].0[i]);
                on.mul_add_e_f32s(at::<S>(&sum[axis], r), worth, base)
            };
            let p = [rest(0), rest(1), rest(2)];
            let mut m = [on.splat_f32s(0.0); 12];
            for (bone, w) in own {
                let (w, bone) = (on.splat_f32s(*w), &room.bones[*bone as usize]);
                for (m, a) in m.iter_mut().zip(bone) {
                    *m = on.mul_add_e_f32s(w, at::<S>(a, r), *m);
                }
            }
            for axis in 0..3 {
                let x = carried(on, (&m, axis), &p);
                S::as_mut_simd_f32s(&mut out[axis].0).0[r] = x;
            }
        }
        if self.normals.is_some() {
            room.x[place] = out;
        }
        room.given[b.order[place] as usize] = out;
    }
}

/// The unit normal at a place, weighted by area, in all frames; upwards where no face has any.
#[inline(always)]
fn normal<S: Simd>(on: S, fans: &Fans, (place, x): (usize, &[[Wide; 3]])) -> [Wide; 3] {
    let mut out = [Wide::default(); 3];
    for r in 0..GROUP / S::F32_LANES {
        let get = |p: usize, axis: usize| at::<S>(&x[p][axis], r);
        let here = [get(place, 0), get(place, 1), get(place, 2)];
        let to = |p: usize, axis: usize| on.sub_f32s(get(p, axis), here[axis]);
        let away = |p: u32| {
            let p = p as usize;
            [to(p, 0), to(p, 1), to(p, 2)]
        };
        let mut n = [on.splat_f32s(0.0); 3];
        for fan in fans.of(place) {
            let mut last = away(fan[0]);
            for next in &fan[1..] {
                let next = away(*next);
                for k in 0..3 {
                    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                    let part = on.mul_add_e_f32s(last[i], next[j], n[k]);
                    n[k] = on.negate_mul_add_e_f32s(last[j], next[i], part);
                }
                last = next;
            }
        }
        let mut square = on.mul_f32s(n[0], n[0]);
        square = on.mul_add_e_f32s(n[1], n[1], square);
        square = on.mul_add_e_f32s(n[2], n[2], square);
        let zero = on.splat_f32s(0.0);
        let some = on.greater_than_f32s(square, zero);
        let by = on.div_f32s(on.splat_f32s(1.0), on.sqrt_f32s(square));
        for axis in 0..3 {
            let up = on.splat_f32s(if axis == 1 { 1.0 } else { 0.0 });
            let n = on.select_f32s(some, on.mul_f32s(n[axis], by), up);
            S::as_mut_simd_f32s(&mut out[axis].0).0[r] = n;
        }
    }
    out
}

/// What is given of every vertex in all frames, to where it is in each.
#[inline(always)]
fn spread<M: Sums>(sums: M, given: &[[Wide; 3]], out: &mut [[f32; 3]]) {
    let frame = given.as_flattened().len();
    let flat = out.as_flattened_mut();
    let frames = flat.len() / frame;
    let (lots, rest) = given.as_flattened().as_chunks::<8>();
    for (lot, rows) in lots.iter().enumerate() {
        for f in (0..frames).step_by(8) {
            // Written out: what `from_fn` and `map` call is not inlined here, and would go through memory.
            let r = |i: usize| part(&rows[i], f);
            let square = sums.turned([r(0), r(1), r(2), r(3), r(4), r(5), r(6), r(7)]);
            for (i, eight) in square.iter().take(frames - f).enumerate() {
                let to = frame * (f + i) + 8 * lot;
                flat[to..to + 8].copy_from_slice(eight);
            }
        }
    }
    for (row, x) in (frame - rest.len()..).zip(rest) {
        (0..frames).for_each(|f| flat[frame * f + row] = x.0[f]);
    }
}

/// Eight neighbours.
#[inline(always)]
fn part(x: &Wide, from: usize) -> [f32; 8] {
    *x.0[from..].first_chunk().expect("there are two eights")
}
