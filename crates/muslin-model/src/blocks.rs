//! Cloth in blocks of sixteen vertices that follow the same few bones.
//!
//! Learnt shapes are kept as 16-bit steps: of a size of its own for every code (which is multiplied into the code) and
//! for every block (which is multiplied into the sum). That is 50 times finer than what a file keeps of them.

use std::cmp::Reverse;

use crate::fans::Fans;
use crate::steps::{Steps, most};
use crate::swing::n_swings;
use crate::{Model, Skin};

/// Vertices in a block.
pub(crate) const WIDE: usize = 16;

/// Vertices that are sorted by their bones together: a few hundred stay in the fastest memory.
const REGION: usize = 512;

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
    /// The vertex at each place, and the place of each vertex.
    pub order: Vec<u32>,
    pub places: Vec<u32>,
    /// Template and constant shape of each block, by axis [m].
    pub base: Vec<[Wide; 3]>,
    /// The largest step of a shape.
    pub most: i16,
    /// Steps of the shapes: `[block][two codes][axis]`.
    pub modes: Vec<Steps>,
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
    /// Where the bones of the vertex at each place start in `followed`, and the end of the last.
    pub follows: Vec<u32>,
    /// Bones of single vertices, and how much they follow them.
    pub followed: Vec<(u32, f32)>,
    /// Faces and neighbours, by places.
    pub faces: Vec<[u32; 3]>,
    pub fans: Fans,
}

impl Blocks {
    pub fn new(model: &Model) -> Self {
        let n_codes = model.n_codes() - 1 + n_swings(model);
        let by_code = largest(model, n_codes);
        let mut out = Self {
            n_verts: model.n_verts(),
            n_codes,
            order: Vec::new(),
            places: vec![0; model.n_verts()],
            base: Vec::new(),
            most: most(n_codes),
            modes: Vec::new(),
            by_code,
            by_block: Vec::new(),
            starts: vec![0],
            bones: Vec::new(),
            weights: Vec::new(),
            follows: vec![0],
            followed: Vec::new(),
            faces: Vec::new(),
            fans: Fans::default(),
        };
        let (order, laid) = (together(model), model.laid());
        for (place, v) in order.iter().enumerate() {
            out.places[*v as usize] = place as u32;
        }
        for verts in order.chunks(WIDE) {
            out.shape((model, &laid), verts);
            out.follow(&model.skin, verts);
        }
        let placed = |f: &[u32; 3]| f.map(|v| out.places[v as usize]);
        let mut faces: Vec<[u32; 3]> = model.faces.iter().map(placed).collect();
        // In the order of memory.
        faces.sort_by_key(|f| f.iter().copied().min());
        (out.fans, out.faces) = (Fans::new(&faces, out.n_verts), faces);
        out.order = order;
        out
    }

    /// How many pairs of codes there are; the last code may be alone.
    pub fn n_twos(&self) -> usize {
        self.n_codes.div_ceil(2)
    }

    /// The block that comes as the `k`th, from the first on or from the last.
    #[inline(always)]
    pub fn turn(&self, k: usize, backwards: bool) -> usize {
        if backwards {
            self.base.len() - 1 - k
        } else {
            k
        }
    }

    /// The shapes of a block: three axes for two codes.
    #[inline(always)]
    pub fn rows(&self, block: usize) -> &[[Steps; 3]] {
        let n = 3 * self.n_twos();
        self.modes[n * block..n * (block + 1)].as_chunks().0
    }

    /// Adds the shapes of a block of a model that lies there at rest [m].
    fn shape(&mut self, (model, laid): (&Model, &[[f32; 3]]), verts: &[u32]) {
        let constant = model.n_codes() - 1;
        let row = |v: u32, axis: usize| 3 * v as usize + axis;
        let at = |v: u32, axis: usize, c: usize| entry(model, row(v, axis), c);
        let mut base = [Wide::default(); 3];
        let mut largest = 0.0f32;
        for (i, &v) in verts.iter().enumerate() {
            for axis in 0..3 {
                let fixed = model.modes[row(v, axis) * (constant + 1) + constant];
                base[axis].0[i] = laid[v as usize][axis] + fixed;
                let all = (0..self.n_codes).map(|c| at(v, axis, c) / self.by_code[c]);
                largest = all.fold(largest, |a, x| a.max(x.abs()));
            }
        }
        let step = largest.max(f32::MIN_POSITIVE) / f32::from(self.most);
        for c in (0..self.n_codes).step_by(2) {
            for axis in 0..3 {
                let steps = |v: u32, c: usize| match c < self.n_codes {
                    true => (at(v, axis, c) / self.by_code[c] / step).round() as i16,
                    false => 0,
                };
                let mut row = Steps::default();
                for (to, &v) in row.0.iter_mut().zip(verts) {
                    *to = [steps(v, c), steps(v, c + 1)];
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
        for &v in verts {
            let own = skin.row(v as usize).filter(|e| e.1 != 0.0);
            let first = self.followed.len();
            self.followed.extend(own.map(|(b, w)| (b as u32, w)));
            // As a block's bones, so that sums are the same to the last bit.
            self.followed[first..].sort_by_key(|e| e.0);
            self.follows.push(self.followed.len() as u32);
        }
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

/// The largest entry of every code's shape; one where it has none.
fn largest(model: &Model, n_codes: usize) -> Vec<f32> {
    let mut most = vec![0.0f32; n_codes];
    // Row by row, as they lie in memory.
    for row in 0..3 * model.n_verts() {
        for (c, most) in most.iter_mut().enumerate() {
            *most = most.max(entry(model, row, c).abs());
        }
    }
    let sound = |m: f32| if m == 0.0 { 1.0 } else { m };
    most.into_iter().map(sound).collect()
}

/// Vertices in an order in which neighbours on the cloth are near, and follow the same bones, most followed first.
fn together(model: &Model) -> Vec<u32> {
    let key = |v: &u32| {
        let mut row: Vec<(Reverse<u32>, usize)> = model
            .skin
            .row(*v as usize)
            .map(|(b, w)| (Reverse(w.to_bits()), b))
            .collect();
        row.sort_unstable();
        row.into_iter().map(|e| e.1).collect::<Vec<_>>()
    };
    let mut order = outwards(&model.faces, model.n_verts());
    order
        .chunks_mut(REGION)
        .for_each(|lot| lot.sort_by_cached_key(key));
    order
}

/// Vertices in the order in which one reaches them from one vertex of each piece of the cloth, along its edges.
fn outwards(faces: &[[u32; 3]], n_verts: usize) -> Vec<u32> {
    let mut near: Vec<Vec<u32>> = vec![Vec::new(); n_verts];
    for &[a, b, c] in faces {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            near[p as usize].push(q);
            near[q as usize].push(p);
        }
    }
    let (mut order, mut seen) = (Vec::with_capacity(n_verts), vec![false; n_verts]);
    for start in 0..n_verts as u32 {
        let mut next = order.len();
        if !std::mem::replace(&mut seen[start as usize], true) {
            order.push(start);
        }
        while next < order.len() {
            for &v in &near[order[next] as usize] {
                if !std::mem::replace(&mut seen[v as usize], true) {
                    order.push(v);
                }
            }
            next += 1;
        }
    }
    order
}
