//! Cloth in blocks of sixteen vertices that follow the same few bones.
//!
//! A frame is bound by memory, so learnt shapes are kept as 16-bit steps: of a size of its own for
//! every code (which is multiplied into the code) and for every block (which is multiplied into the
//! sum). That is 50 times finer than what a file keeps of them.

use std::cmp::Reverse;

use crate::swing::n_swings;
use crate::{Model, Skin};

/// Vertices in a block.
pub(crate) const WIDE: usize = 16;

/// One number of every vertex of a block.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Wide(pub [f32; WIDE]);

/// Everything of a model that depends on the vertex.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// How many vertices there are; places beyond them belong to none.
    pub n_verts: usize,
    /// Codes that a frame is mixed by: those of the pose without the constant one, then the swings.
    pub n_codes: usize,
    /// The vertex at each place.
    pub order: Vec<u32>,
    /// Template and constant shape of each block, by axis [m].
    pub base: Vec<[Wide; 3]>,
    /// Steps of the shapes: `[block][code][axis]`.
    pub modes: Vec<[i16; WIDE]>,
    /// What a step of each code is worth, before that of the block.
    pub by_code: Vec<f32>,
    /// What a step of each block is worth [m].
    pub by_block: Vec<f32>,
    /// Where each block's bones start, and the end of the last.
    pub starts: Vec<u32>,
    /// The bones that any vertex of a block follows.
    pub bones: Vec<u8>,
    /// How much each vertex follows each of them.
    pub weights: Vec<Wide>,
}

impl Blocks {
    pub fn new(model: &Model) -> Self {
        let n_codes = model.n_codes() - 1 + n_swings(model);
        let by_code: Vec<f32> = (0..n_codes).map(|c| column(model, c)).collect();
        let mut out = Self {
            n_verts: model.n_verts(),
            n_codes,
            order: alike(&model.skin),
            base: Vec::new(),
            modes: Vec::new(),
            by_code,
            by_block: Vec::new(),
            starts: vec![0],
            bones: Vec::new(),
            weights: Vec::new(),
        };
        let (order, laid) = (out.order.clone(), model.laid());
        for verts in order.chunks(WIDE) {
            out.shape((model, &laid), verts);
            out.follow(&model.skin, verts);
        }
        out
    }

    /// The shapes of a block: three axes a code.
    pub fn rows(&self, block: usize) -> &[[i16; WIDE]] {
        &self.modes[3 * self.n_codes * block..3 * self.n_codes * (block + 1)]
    }

    /// Adds the shapes of a block of a model that lies there at rest [m].
    fn shape(&mut self, (model, laid): (&Model, &[[f32; 3]]), verts: &[u32]) {
        let constant = model.n_codes() - 1;
        let row = |v: u32, axis: usize| 3 * v as usize + axis;
        let at = |v: u32, axis: usize, c: usize| entry(model, row(v, axis), c);
        let mut base = [Wide::default(); 3];
        let mut most = 0.0f32;
        for (i, &v) in verts.iter().enumerate() {
            for axis in 0..3 {
                let fixed = model.modes[row(v, axis) * (constant + 1) + constant];
                base[axis].0[i] = laid[v as usize][axis] + fixed;
                let all = (0..self.n_codes).map(|c| at(v, axis, c) / self.by_code[c]);
                most = all.fold(most, |a, x| a.max(x.abs()));
            }
        }
        let step = most.max(f32::MIN_POSITIVE) / f32::from(i16::MAX);
        for c in 0..self.n_codes {
            for axis in 0..3 {
                let mut row = [0i16; WIDE];
                for (to, &v) in row.iter_mut().zip(verts) {
                    *to = (at(v, axis, c) / self.by_code[c] / step).round() as i16;
                }
                self.modes.push(row);
            }
        }
        self.base.push(base);
        self.by_block.push(step);
    }

    /// Adds the bones of a block.
    fn follow(&mut self, skin: &Skin, verts: &[u32]) {
        let all = verts.iter().flat_map(|v| skin.row(*v as usize));
        let mut bones: Vec<usize> = all.filter(|e| e.1 != 0.0).map(|e| e.0).collect();
        bones.sort_unstable();
        bones.dedup();
        for &b in &bones {
            let mut row = Wide::default();
            for (to, &v) in row.0.iter_mut().zip(verts) {
                *to = skin.row(v as usize).filter(|e| e.0 == b).map(|e| e.1).sum();
            }
            self.bones.push(b as u8);
            self.weights.push(row);
        }
        self.starts.push(self.bones.len() as u32);
    }
}

/// Code `c`'s share in a coordinate.
fn entry(model: &Model, row: usize, c: usize) -> f32 {
    let posed = model.n_codes() - 1;
    match &model.sway {
        Some(s) if c >= posed => s.shapes[row * s.len() + c - posed],
        _ => model.modes[row * (posed + 1) + c],
    }
}

/// The largest entry of a code's shape; one where it has none.
fn column(model: &Model, c: usize) -> f32 {
    let all = (0..3 * model.n_verts()).map(|row| entry(model, row, c));
    match all.fold(0.0f32, |a, x| a.max(x.abs())) {
        0.0 => 1.0,
        most => most,
    }
}

/// Vertices in an order in which neighbours follow the same bones, most followed first.
fn alike(skin: &Skin) -> Vec<u32> {
    let key = |v: &u32| {
        let mut row: Vec<(Reverse<u32>, usize)> = skin
            .row(*v as usize)
            .map(|(b, w)| (Reverse(w.to_bits()), b))
            .collect();
        row.sort_unstable();
        row.into_iter().map(|e| e.1).collect::<Vec<_>>()
    };
    let mut order: Vec<u32> = (0..skin.n_verts() as u32).collect();
    order.sort_by_cached_key(key);
    order
}
