//! Learnt shapes as whole numbers: what a frame has to read of them is most of its time.
//!
//! Neighbours on the cloth move alike. So the shape of a code is, in a block of vertices, its middle there in 16 bits,
//! and what single vertices are beside it: in 16 bits too for the few codes that move cloth most, in 8 for all others,
//! in steps of a size of its own for every code in every block.

use std::cmp::Reverse;
use std::ops::Range;

use muslin_net::learn::Mlp;

use crate::blocks::WIDE;
use crate::steps::{Bytes, Coder, Steps, Sums, Two, most, opened, upper_half};
use crate::swing::n_swings;
use crate::{Encoder, Model};

/// How far vertices may be off for codes in 8 bits, root mean square [m].
const OFF: f32 = 5e-5;
/// Root mean square of what is lost by rounding to whole numbers.
const ROUNDED: f32 = 0.2887;
/// The largest step in 16 bits beside some in 8: finer ones would leave too few to tell their codes by.
const FINE: i16 = 2_047;
/// The largest step in 8 bits.
const BYTE: i16 = i8::MAX as i16;
/// Numbers between two layers, about (codes of the wardrobe in its motions: 1.1 to 1.8), and how far a swing goes [m].
const BETWEEN: f32 = 1.6;
const SWINGS: f32 = 0.01;

/// Shapes of all codes that a frame is mixed by: those of the pose without the constant one, then the swings.
#[derive(Clone, Debug)]
pub(crate) struct Shapes {
    /// The code at each place, those in 16 bits first, and what a step of it is worth [m] where that is most.
    pub codes: Vec<u32>,
    pub by_code: Vec<f32>,
    /// How many pairs are in 16 bits, and the largest step of those.
    n_fine: usize,
    most: i16,
    /// Steps beside the middles: `[block][two codes][axis]`.
    fine: Vec<Steps>,
    coarse: Vec<Bytes>,
    /// What a step is worth in a block, as a share of the most: upper halves of floats, `[block][code]`, by sixteens.
    shares: Vec<[u16; WIDE]>,
    middles: Middles,
}

/// Middles of shapes: sixteen blocks are to them what sixteen vertices are to a block.
#[derive(Clone, Debug)]
struct Middles {
    most: i16,
    rows: Vec<Steps>,
    /// How far the code at each place takes a middle at most, in steps of [`Shapes::by_code`].
    by_code: Vec<f32>,
    /// What a step is worth in each lot of blocks, as a share of that.
    by_lot: Vec<f32>,
}

/// What single vertices of a block are beside its middle: pairs of codes in 16 bits, and in 8.
pub(crate) type Beside<'a> = (&'a [[Steps; 3]], &'a [[Bytes; 3]]);

impl Shapes {
    /// Of vertices in this order. All in 16 bits where it must be `exact`.
    pub fn new(model: &Model, order: &[u32], exact: bool) -> Self {
        let n = model.n_codes() - 1 + n_swings(model);
        let blocks: Vec<Entries> = (order.chunks(WIDE))
            .map(|verts| Entries::new(model, verts, n))
            .collect();
        let sizes = sizes(model, &blocks, n);
        let mut codes: Vec<u32> = (0..n as u32).collect();
        codes.sort_by(|a, b| sizes[*b as usize].total_cmp(&sizes[*a as usize]));
        let n_twos = n.div_ceil(2);
        let n_fine = match exact {
            true => n_twos,
            false => n_fine(codes.iter().map(|c| sizes[*c as usize] / f32::from(BYTE))),
        };
        let mut out = Self {
            most: if n_fine < n_twos { FINE } else { most(n) },
            n_fine,
            by_code: vec![0.0; n],
            fine: Vec::with_capacity(3 * n_fine * blocks.len()),
            coarse: Vec::with_capacity(3 * (n_twos - n_fine) * blocks.len()),
            shares: Vec::with_capacity(n.div_ceil(WIDE) * blocks.len()),
            middles: Middles {
                most: most(n),
                rows: Vec::new(),
                by_code: Vec::with_capacity(n),
                by_lot: Vec::new(),
            },
            codes,
        };
        for p in 0..n {
            let c = out.codes[p] as usize;
            let step =
                |b: &Entries| (b.beside[c] / f32::from(out.range(p))).max(b.largest[c] / 32_767.0);
            let largest = blocks.iter().map(step).fold(0.0, f32::max);
            out.by_code[p] = if largest == 0.0 { 1.0 } else { largest };
            let far = |b: &Entries| b.middle[c].iter().fold(0.0, |m, x| f32::max(m, x.abs()));
            let farthest = blocks.iter().map(far).fold(f32::MIN_POSITIVE, f32::max);
            out.middles.by_code.push(farthest / out.by_code[p]);
        }
        blocks.iter().for_each(|b| out.add(b));
        blocks.chunks(WIDE).for_each(|lot| out.add_middles(lot));
        out
    }

    /// How many codes there are.
    pub fn n_codes(&self) -> usize {
        self.codes.len()
    }

    /// How many pairs of them; the last code may be alone.
    pub fn n_twos(&self) -> usize {
        self.n_codes().div_ceil(2)
    }

    /// The largest step of the code at place `p`.
    fn range(&self, p: usize) -> i16 {
        if p < 2 * self.n_fine { self.most } else { BYTE }
    }

    /// Puts codes, each times what a step of it is worth, at their places.
    #[inline(always)]
    pub fn place(&self, z: impl Fn(usize) -> f32, out: &mut [f32]) {
        let places = self.codes.iter().zip(&self.by_code);
        for (to, (code, worth)) in out.iter_mut().zip(places) {
            *to = z(*code as usize) * worth;
        }
    }

    /// For the middles, and for what is beside them, of codes at their places; leaves the former's codes.
    #[inline(always)]
    pub fn coders(&self, codes: &[f32], middles: &mut [f32]) -> [Coder; 2] {
        let each = codes.iter().zip(&self.middles.by_code);
        for (to, (z, by)) in middles.iter_mut().zip(each) {
            *to = z * by;
        }
        let (fine, coarse) = codes.split_at(codes.len().min(2 * self.n_fine));
        [
            Coder::of([(middles, self.middles.most), (&[], 0)]),
            Coder::of([(fine, self.most), (coarse, BYTE)]),
        ]
    }

    /// The middles of a lot of blocks: three axes for two codes, and what a step is worth.
    #[inline(always)]
    pub fn middles(&self, lot: usize) -> (&[[Steps; 3]], f32) {
        let n = 3 * self.n_twos();
        let rows = &self.middles.rows[n * lot..n * (lot + 1)];
        (rows.as_chunks().0, self.middles.by_lot[lot])
    }

    /// What the vertices of a block are beside its middle.
    #[inline(always)]
    pub fn beside(&self, block: usize) -> Beside<'_> {
        let (n, m) = (3 * self.n_fine, 3 * (self.n_twos() - self.n_fine));
        let fine = &self.fine[n * block..n * (block + 1)];
        let coarse = &self.coarse[m * block..m * (block + 1)];
        (fine.as_chunks().0, coarse.as_chunks().0)
    }

    /// What a step of each code is worth in a block, as a share.
    #[inline(always)]
    pub fn shares(&self, block: usize) -> &[[u16; WIDE]] {
        let n = self.n_codes().div_ceil(WIDE);
        &self.shares[n * block..n * (block + 1)]
    }

    /// Adds a block.
    fn add(&mut self, b: &Entries) {
        let n = self.n_codes();
        let first = self.shares.len();
        (self.shares).resize(first + n.div_ceil(WIDE), [0; WIDE]);
        for p in 0..n {
            let c = self.codes[p] as usize;
            let share = b.beside[c] / f32::from(self.range(p)) / self.by_code[p];
            self.shares[first + p / WIDE][p % WIDE] = upper_half(share);
        }
        let own = &self.shares[first..];
        let steps = |p: usize, axis: usize, i: usize| -> i16 {
            let Some(&c) = self.codes.get(p) else {
                return 0;
            };
            let (step, most) = (
                opened(own[p / WIDE][p % WIDE]) * self.by_code[p],
                f32::from(self.range(p)),
            );
            match step > 0.0 {
                true => (b.beside_of(c as usize, axis, i) / step)
                    .round()
                    .clamp(-most, most) as i16,
                false => 0,
            }
        };
        let rows = |twos: Range<usize>| {
            let places = twos.flat_map(|two| (0..3).map(move |axis| (two, axis)));
            places.map(|(two, axis)| -> [Two; WIDE] {
                std::array::from_fn(|i| [0, 1].map(|k| steps(2 * two + k, axis, i)))
            })
        };
        let fine: Vec<Steps> = rows(0..self.n_fine).map(Steps).collect();
        let byte = |each: [Two; WIDE]| Bytes(each.map(|two| two.map(|x| x as i8)));
        let coarse: Vec<Bytes> = rows(self.n_fine..self.n_twos()).map(byte).collect();
        self.fine.extend(fine);
        self.coarse.extend(coarse);
    }

    /// Adds the middles of sixteen blocks, or as many as there are.
    fn add_middles(&mut self, lot: &[Entries]) {
        let at = |p: usize, axis: usize, i: usize| -> f32 {
            match (self.codes.get(p), lot.get(i)) {
                (Some(&c), Some(b)) => {
                    b.middle[c as usize][axis] / self.by_code[p] / self.middles.by_code[p]
                }
                _ => 0.0,
            }
        };
        let mut largest = f32::MIN_POSITIVE;
        for p in 0..self.n_codes() {
            for axis in 0..3 {
                largest = (0..lot.len()).fold(largest, |a, i| a.max(at(p, axis, i).abs()));
            }
        }
        let step = largest / f32::from(self.middles.most);
        for two in 0..self.n_twos() {
            for axis in 0..3 {
                let steps =
                    |i: usize| [0, 1].map(|k| (at(2 * two + k, axis, i) / step).round() as i16);
                self.middles.rows.push(Steps(std::array::from_fn(steps)));
            }
        }
        self.middles.by_lot.push(step);
    }
}

/// What the codes' shapes are in a block [m].
struct Entries {
    /// `[code][vertex]`.
    all: Vec<[[f32; 3]; WIDE]>,
    n: usize,
    /// Halfway between the least and the most, by axis; how far vertices are from it at most, and how far they move.
    middle: Vec<[f32; 3]>,
    beside: Vec<f32>,
    largest: Vec<f32>,
}

impl Entries {
    fn new(model: &Model, verts: &[u32], n_codes: usize) -> Self {
        let mut all = vec![[[0.0f32; 3]; WIDE]; n_codes];
        for (i, &v) in verts.iter().enumerate() {
            for axis in 0..3 {
                let row = 3 * v as usize + axis;
                all.iter_mut()
                    .enumerate()
                    .for_each(|(c, to)| to[i][axis] = entry(model, row, c));
            }
        }
        let ends = |x: &[[f32; 3]; WIDE], axis: usize| {
            let own = x[..verts.len()].iter().map(|x| x[axis]);
            own.fold([f32::MAX, f32::MIN], |[a, b], x| [a.min(x), b.max(x)])
        };
        let (mut middle, mut beside, mut largest) = (Vec::new(), Vec::new(), Vec::new());
        for x in &all {
            let ends = [0, 1, 2].map(|axis| ends(x, axis));
            middle.push(ends.map(|[a, b]| 0.5 * (a + b)));
            beside.push(
                ends.iter()
                    .fold(0.0, |m, [a, b]| f32::max(m, 0.5 * (b - a))),
            );
            largest.push(
                ends.iter()
                    .fold(0.0, |m, [a, b]| f32::max(m, f32::max(a.abs(), b.abs()))),
            );
        }
        Self {
            n: verts.len(),
            all,
            middle,
            beside,
            largest,
        }
    }

    fn beside_of(&self, c: usize, axis: usize, i: usize) -> f32 {
        match i < self.n {
            true => self.all[c][i][axis] - self.middle[c][axis],
            false => 0.0,
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

/// How far each code moves vertices beside the middles of their blocks, about [m].
fn sizes(model: &Model, blocks: &[Entries], n: usize) -> Vec<f32> {
    let posed = spread(model);
    let one = |c: usize| {
        let squares = blocks.iter().map(|b| b.beside[c].powi(2)).sum::<f32>();
        let mean = (squares / blocks.len().max(1) as f32).sqrt();
        let largest = || blocks.iter().map(|b| b.largest[c]);
        let swing = || SWINGS / largest().fold(f32::MIN_POSITIVE, f32::max);
        mean * posed.get(c).copied().unwrap_or_else(swing)
    };
    (0..n).map(one).collect()
}

/// How large the codes of a pose are, about: by the last layer's weights.
fn spread(model: &Model) -> Vec<f32> {
    let by_layer = |m: &Mlp, end: usize| -> Vec<f32> {
        let last = m.layers().next_back().expect("a layer");
        let own = &model.params[end - last.n_params()..end];
        let rows = own.chunks_exact(last.inputs.max(1)).take(last.outputs);
        rows.map(|row| BETWEEN * row.iter().map(|w| w * w).sum::<f32>().sqrt())
            .collect()
    };
    match &model.encoder {
        Encoder::Plain(m) | Encoder::Pbns(m) if !model.params.is_empty() => {
            by_layer(m, model.params.len())
        }
        Encoder::Ncs(n) => by_layer(&n.decoder, n.ends()[4]),
        _ => vec![1.0; model.n_codes() - 1],
    }
}

/// How many pairs of codes, the largest first, have to be in 16 bits so that the others are [`OFF`] at most, where
/// these are their steps in 8 bits [m].
fn n_fine(steps: impl Iterator<Item = f32>) -> usize {
    let off: Vec<f32> = steps.map(|s| 3.0 * (s * ROUNDED).powi(2)).collect();
    let mut left: f32 = off.iter().sum();
    let mut pairs = off.chunks(2);
    let mut n = 0;
    while left > OFF * OFF {
        let Some(two) = pairs.next() else { break };
        (n, left) = (n + 1, left - two.iter().sum::<f32>());
    }
    n
}

/// Vertices in blocks of neighbours, in an order in which blocks are near each other.
pub(crate) fn neighbours(at: &[[f32; 3]]) -> Vec<u32> {
    let mut all: Vec<u32> = (0..at.len() as u32).collect();
    halve(at, &mut all);
    all
}

/// Parts them across their longest side until they are a block.
fn halve(at: &[[f32; 3]], some: &mut [u32]) {
    if some.len() <= WIDE {
        return;
    }
    let side = |axis: usize| {
        let own = some.iter().map(|v| at[*v as usize][axis]);
        let [least, most] = own.fold([f32::MAX, f32::MIN], |[a, b], x| [a.min(x), b.max(x)]);
        most - least
    };
    let sides = [side(0), side(1), side(2)];
    let longest = (0..3)
        .max_by_key(|a| (sides[*a].to_bits(), Reverse(*a)))
        .expect("three axes");
    let key = |v: &u32| at[*v as usize][longest];
    let half = some.len().div_ceil(WIDE) / 2 * WIDE;
    some.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    let (left, right) = some.split_at_mut(half);
    halve(at, left);
    halve(at, right);
}

/// Adds what codes make of rows to two sums each, so that none waits for the one before.
#[inline(always)]
fn add<M: Sums, R>(
    sums: M,
    (rows, twos): (&[[R; 3]], &[Two]),
    read: impl Fn(&R) -> M::Row,
    sum: &mut [[M::Sum; 3]; 2],
) {
    let twos = &twos[..rows.len()];
    let ((rows, last), (twos, last_two)) = (rows.as_chunks::<2>(), twos.as_chunks::<2>());
    let [first, second] = sum;
    for ([a, b], [y, z]) in rows.iter().zip(twos) {
        let (y, z) = (sums.alike(*y), sums.alike(*z));
        for axis in 0..3 {
            first[axis] = sums.plus(first[axis], read(&a[axis]), y);
            second[axis] = sums.plus(second[axis], read(&b[axis]), z);
        }
    }
    for (row, two) in last.iter().zip(last_two) {
        let two = sums.alike(*two);
        for axis in 0..3 {
            first[axis] = sums.plus(first[axis], read(&row[axis]), two);
        }
    }
}

/// What a frame's codes are in a block, and what they make of it: room for one frame.
#[derive(Clone, Debug)]
pub(crate) struct Mixing {
    /// Codes of the middles, in steps of theirs, and in those of a block.
    led: Vec<f32>,
    twos: Vec<Two>,
    own: Vec<[i16; WIDE]>,
    /// Codes in steps of the frame, to be shared out.
    scaled: Vec<[f32; WIDE]>,
    /// Middles of each lot of blocks [m].
    middles: Vec<[[f32; WIDE]; 3]>,
    /// What a step is worth beside them.
    worth: f32,
}

impl Mixing {
    pub fn new(shapes: &Shapes) -> Self {
        let n = shapes.n_codes().div_ceil(WIDE);
        Self {
            led: vec![0.0; shapes.n_codes()],
            twos: vec![[0; 2]; shapes.n_twos()],
            own: vec![[0; WIDE]; n],
            scaled: vec![[0.0; WIDE]; n],
            middles: vec![[[0.0; WIDE]; 3]; shapes.middles.by_lot.len()],
            worth: 0.0,
        }
    }

    /// Takes the codes of a frame, at their places.
    #[inline(always)]
    pub fn begin<M: Sums>(&mut self, sums: M, shapes: &Shapes, codes: &[f32]) {
        let [middle, beside] = shapes.coders(codes, &mut self.led);
        let steps = self.twos.iter_mut().zip(middle.twos(&self.led));
        steps.for_each(|(to, z)| *to = z);
        for (lot, to) in self.middles.iter_mut().enumerate() {
            let (rows, by_lot) = shapes.middles(lot);
            let mut sum = [[sums.none(); 3]; 2];
            add(sums, (rows, &self.twos), |row| sums.row(row), &mut sum);
            let worth = middle.worth * by_lot;
            for axis in 0..3 {
                to[axis] = sums.floats(sums.both(sum[0][axis], sum[1][axis]));
                for x in &mut to[axis] {
                    *x *= worth;
                }
            }
        }
        for (to, z) in self.scaled.as_flattened_mut().iter_mut().zip(codes) {
            *to = z * beside.per;
        }
        self.worth = beside.worth;
    }

    /// The middle of a block [m]; what its vertices are beside it, in steps, and what one is worth [m].
    #[inline(always)]
    pub fn block<M: Sums>(
        &mut self,
        sums: M,
        (shapes, block): (&Shapes, usize),
    ) -> ([f32; 3], [[f32; WIDE]; 3], f32) {
        let codes = self.scaled.iter().zip(shapes.shares(block));
        for (to, (codes, shares)) in self.own.iter_mut().zip(codes) {
            *to = sums.each_whole(codes, shares);
        }
        let (fine, coarse) = shapes.beside(block);
        let twos = self.own.as_flattened().as_chunks::<2>().0;
        let (fine_twos, coarse_twos) = twos.split_at(fine.len());
        let mut sum = [[sums.none(); 3]; 2];
        add(sums, (fine, fine_twos), |row| sums.row(row), &mut sum);
        add(sums, (coarse, coarse_twos), |row| sums.bytes(row), &mut sum);
        let middle = &self.middles[block / WIDE];
        let floats = |axis: usize| sums.floats(sums.both(sum[0][axis], sum[1][axis]));
        (
            [0, 1, 2].map(|axis| middle[axis][block % WIDE]),
            [floats(0), floats(1), floats(2)],
            self.worth,
        )
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::Vec3;
    use muslin_net::learn::{Noise, Nonlinear};

    use super::*;
    use crate::Skin;
    use crate::steps::Plain;

    /// A sheet of so many vertices a side, 12 mm apart, whose shapes are waves, the later the fainter.
    fn sheet(side: usize, codes: usize) -> Model {
        let place = |v: usize| [(v % side) as f32 * 0.012, (v / side) as f32 * 0.012, 0.0];
        let template: Vec<[f32; 3]> = (0..side * side).map(place).collect();
        let noise = &mut Noise::new(5);
        let waves: Vec<[f32; 4]> = (0..codes)
            .map(|c| {
                let height = 0.04 / (1.0 + 0.3 * c as f32);
                let [x, y, phase] = [0; 3].map(|_| 25.0 * noise.normal() as f32);
                [height, x, y, phase]
            })
            .collect();
        let row = |v: usize, axis: usize| {
            let [x, y, _] = template[v];
            let wave = move |w: &[f32; 4]| w[0] * (w[1] * x + w[2] * y + w[3] + axis as f32).sin();
            waves.iter().map(wave).chain([0.0])
        };
        let rows = (0..template.len()).flat_map(|v| (0..3).map(move |axis| (v, axis)));
        let mlp = Mlp {
            widths: vec![codes, codes],
            bend: Nonlinear::Tanh,
            bias: false,
        };
        Model {
            notes: BTreeMap::new(),
            faces: Vec::new(),
            modes: rows.flat_map(|(v, axis)| row(v, axis)).collect(),
            skin: Skin {
                starts: vec![0; template.len() + 1],
                ..Skin::default()
            },
            template,
            bones: Vec::new(),
            drivers: Vec::new(),
            traits: Vec::new(),
            scale: Vec::new(),
            params: (0..codes * codes)
                .map(|_| noise.normal() as f32 / (codes as f32).sqrt())
                .collect(),
            encoder: Encoder::Plain(mlp),
            sway: None,
            resizer: None,
        }
    }

    /// How far off vertices are for some codes: root mean square, and at most [m].
    fn off(model: &Model, exact: bool) -> [f32; 2] {
        let order = neighbours(&model.template);
        let shapes = Shapes::new(model, &order, exact);
        let (n, mut mixing) = (shapes.n_codes(), Mixing::new(&shapes));
        let (mut squares, mut most, mut count) = (0.0, 0.0f32, 0);
        let noise = &mut Noise::new(9);
        for _ in 0..20 {
            let z: Vec<f32> = (0..n).map(|_| noise.normal() as f32).collect();
            let mut codes = vec![0.0; n];
            shapes.place(|c| z[c], &mut codes);
            mixing.begin(Plain, &shapes, &codes);
            for (block, verts) in order.chunks(WIDE).enumerate() {
                let (middle, beside, worth) = mixing.block(Plain, (&shapes, block));
                for (i, &v) in verts.iter().enumerate() {
                    let apart = [0, 1, 2].map(|axis| {
                        let row = &model.modes[(3 * v as usize + axis) * (n + 1)..][..n];
                        let exact: f32 = row.iter().zip(&z).map(|(m, z)| m * z).sum();
                        middle[axis] + worth * beside[axis][i] - exact
                    });
                    let far = Vec3::from_array(apart).length();
                    (squares, most, count) = (squares + far * far, most.max(far), count + 1);
                }
            }
        }
        [(squares / count as f32).sqrt(), most]
    }

    #[test]
    fn shapes_in_bytes_are_off_by_little_and_most_codes_are() {
        let model = sheet(50, 63);
        let order = neighbours(&model.template);
        let shapes = Shapes::new(&model, &order, false);
        assert!((1..28).contains(&shapes.n_fine), "{} pairs", shapes.n_fine);
        let [mean, most] = off(&model, false);
        assert!(mean < 1.2 * OFF && most < 5e-4, "{mean} and {most} m");
        assert!(
            mean > 0.05 * OFF,
            "more in 16 bits than is needed: {mean} m"
        );
        let [mean, most] = off(&model, true);
        assert!(mean < 1e-5 && most < 3e-5, "{mean} and {most} m");
    }

    #[test]
    fn any_number_of_vertices_and_codes_is_told() {
        for (side, codes) in [(1, 1), (3, 2), (4, 17), (5, 33), (17, 3)] {
            let [_, most] = off(&sheet(side, codes), true);
            assert!(most < 2e-5, "{side} {codes}: {most} m");
        }
    }

    #[test]
    fn blocks_are_patches_and_hold_every_vertex_once() {
        let model = sheet(40, 1);
        let mut order = neighbours(&model.template);
        for block in order.chunks(WIDE) {
            let at = block
                .iter()
                .map(|v| Vec3::from_array(model.template[*v as usize]));
            let first = at.clone().next().expect("a vertex");
            assert!(at.map(|x| x.distance(first)).fold(0.0, f32::max) < 0.1);
        }
        order.sort_unstable();
        assert!(order.iter().copied().eq(0..1600));
    }
}
