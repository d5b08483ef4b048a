//! Which triangle each sample of a picture sees.
//!
//! Corners are snapped to 1/256 pixel and edges are tested in whole numbers with
//! a top-left rule, so that neighbours share an edge without gap or overlap.

use std::ops::Range;

use glam::DVec2;

/// Steps per pixel that corners are snapped to.
const UNIT: i64 = 256;
/// The id of a sample that sees nothing.
pub(crate) const NOTHING: u32 = u32::MAX;
/// Edge slopes beyond this leave 32-bit arithmetic.
const WIDE: i64 = 1 << 21;

/// A triangle on the picture plane, wound so that its area is positive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tri {
    x: [i32; 3],
    y: [i32; 3],
    /// Nearness of each corner: anything affine on the plane that grows towards the eye.
    near: [f32; 3],
    /// What a sample remembers.
    pub id: u32,
}

impl Tri {
    /// Snaps the corners [px]; none if nothing is left of the triangle.
    /// Coordinates must be below 2^22 px.
    pub fn new(p: [DVec2; 3], mut near: [f32; 3], id: u32) -> Option<Self> {
        let mut x = [snap(p[0].x), snap(p[1].x), snap(p[2].x)];
        let mut y = [snap(p[0].y), snap(p[1].y), snap(p[2].y)];
        let area = i64::from(x[1] - x[0]) * i64::from(y[2] - y[0])
            - i64::from(x[2] - x[0]) * i64::from(y[1] - y[0]);
        if area < 0 {
            x.swap(1, 2);
            y.swap(1, 2);
            near.swap(1, 2);
        }
        (area != 0).then_some(Self { x, y, near, id })
    }

    /// Columns and rows of pixels with samples in its bounding box, cut to a
    /// rectangle; samples lie from `first` to `last` in a pixel.
    #[inline(always)]
    fn span(&self, cols: Range<i32>, rows: Range<i32>, [first, last]: [i32; 2]) -> [Range<i32>; 2] {
        let cut = |v: [i32; 3], r: Range<i32>| {
            let lo = (v[0].min(v[1]).min(v[2]) - last + 255) >> 8;
            let hi = (v[0].max(v[1]).max(v[2]) - first) >> 8;
            lo.max(r.start)..(hi + 1).min(r.end)
        };
        [cut(self.x, cols), cut(self.y, rows)]
    }

    /// The three edge functions, non-negative inside.
    #[inline(always)]
    fn edges(&self) -> [Edge; 3] {
        [self.edge(0, 1), self.edge(1, 2), self.edge(2, 0)]
    }

    #[inline(always)]
    fn edge(&self, i: usize, j: usize) -> Edge {
        let dx = i64::from(self.x[j]) - i64::from(self.x[i]);
        let dy = i64::from(self.y[j]) - i64::from(self.y[i]);
        // Of an edge's two directions exactly one owns the samples on it.
        let owns = dy > 0 || (dy == 0 && dx < 0);
        let c = dy * i64::from(self.x[i]) - dx * i64::from(self.y[i]);
        Edge {
            a: -dy,
            b: dx,
            c: c - i64::from(!owns),
        }
    }

    /// Nearness as a plane over snapped coordinates.
    #[inline(always)]
    fn plane(&self) -> Plane {
        let from = |v: [i32; 3], i: usize| f64::from(v[i]) - f64::from(v[0]);
        let rise = |i: usize| f64::from(self.near[i]) - f64::from(self.near[0]);
        let (x1, x2, y1, y2) = (
            from(self.x, 1),
            from(self.x, 2),
            from(self.y, 1),
            from(self.y, 2),
        );
        let (n1, n2) = (rise(1), rise(2));
        let inv = 1.0 / (x1 * y2 - x2 * y1);
        let a = (n1 * y2 - n2 * y1) * inv;
        let b = (n2 * x1 - n1 * x2) * inv;
        let lo = self.near[0].min(self.near[1]).min(self.near[2]);
        let hi = self.near[0].max(self.near[1]).max(self.near[2]);
        let c = f64::from(self.near[0]) - a * f64::from(self.x[0]) - b * f64::from(self.y[0]);
        Plane { a, b, c, lo, hi }
    }
}

/// Pixels to snapped units, rounded by truncation of a number made positive.
fn snap(px: f64) -> i32 {
    const LIFT: f64 = 2_147_483_648.0;
    ((px * UNIT as f64 + (LIFT + 0.5)) as i64 - LIFT as i64) as i32
}

/// `a x + b y + c` over snapped coordinates.
#[derive(Clone, Copy)]
struct Edge {
    a: i64,
    b: i64,
    c: i64,
}

impl Edge {
    #[inline(always)]
    fn at(&self, x: i64, y: i64) -> i64 {
        self.a * x + self.b * y + self.c
    }

    #[inline(always)]
    fn is_wide(&self) -> bool {
        self.a.abs().max(self.b.abs()) >= WIDE
    }
}

/// As [`Edge`], for nearness; `lo..=hi` are the corners' extremes.
#[derive(Clone, Copy)]
struct Plane {
    a: f64,
    b: f64,
    c: f64,
    lo: f32,
    hi: f32,
}

/// Places of `S` samples in a pixel, in snapped units.
///
/// `S` is a square n²: an n × n grid, sheared so that no two samples share a
/// column or row; edges of every slope get all `S` steps.
pub(crate) fn pattern<const S: usize>() -> [[i32; 2]; S] {
    let n = (1..=S).find(|n| n * n >= S).unwrap_or(1);
    let place = |major: usize, minor: usize| {
        let k = (major * n + minor) as f64 + 0.5;
        (k * UNIT as f64 / (n * n) as f64) as i32
    };
    std::array::from_fn(|s| [place(s % n, s / n), place(s / n, s % n)])
}

/// A rectangle of pixels with `S` samples each.
pub(crate) struct Tile<const S: usize> {
    x0: i32,
    y0: i32,
    width: i32,
    height: i32,
    offsets: [[i32; 2]; S],
    reach: [i32; 2],
    /// Nearness of what each sample sees.
    pub near: Vec<[f32; S]>,
    /// Id of what each sample sees, or [`NOTHING`].
    pub id: Vec<[u32; S]>,
}

impl<const S: usize> Tile<S> {
    /// An empty tile with its top left pixel at `(x0, y0)`.
    pub fn new(x0: usize, y0: usize, width: usize, height: usize) -> Self {
        let offsets = pattern::<S>();
        let first = offsets.iter().flatten().copied().min().unwrap_or(0);
        let last = offsets.iter().flatten().copied().max().unwrap_or(255);
        let mut tile = Self {
            x0: 0,
            y0: 0,
            width: 0,
            height: 0,
            offsets,
            reach: [first, last],
            near: Vec::new(),
            id: Vec::new(),
        };
        tile.reset(x0, y0, width, height);
        tile
    }

    /// Empties the tile and moves it.
    pub fn reset(&mut self, x0: usize, y0: usize, width: usize, height: usize) {
        [self.x0, self.y0, self.width, self.height] = [x0, y0, width, height].map(|v| v as i32);
        self.near.clear();
        self.near.resize(width * height, [f32::NEG_INFINITY; S]);
        self.id.clear();
        self.id.resize(width * height, [NOTHING; S]);
    }

    /// Lets every sample that `tri` covers, nearer than before, see it.
    #[inline(always)]
    pub fn fill(&mut self, tri: &Tri) {
        let [cols, rows] = tri.span(
            self.x0..self.x0 + self.width,
            self.y0..self.y0 + self.height,
            self.reach,
        );
        if cols.is_empty() || rows.is_empty() {
            return;
        }
        let edges = tri.edges();
        if edges.iter().any(Edge::is_wide) {
            self.fill_wide(tri, &edges, cols, rows);
        } else {
            self.fill_narrow(tri, &edges, cols, rows);
        }
    }

    #[inline(always)]
    fn fill_narrow(&mut self, tri: &Tri, e: &[Edge; 3], cols: Range<i32>, rows: Range<i32>) {
        let plane = tri.plane();
        let step = e.map(|e| self.offsets.map(|o| e.a as i32 * o[0] + e.b as i32 * o[1]));
        let most = step.map(|steps| steps.into_iter().max().unwrap_or(0));
        let rise = self
            .offsets
            .map(|o| (plane.a * f64::from(o[0]) + plane.b * f64::from(o[1])) as f32);
        for py in rows {
            let y = i64::from(py) * UNIT;
            for px in cols.clone() {
                let x = i64::from(px) * UNIT;
                let base = e.map(|e| e.at(x, y).clamp(-(1 << 30), 1 << 30) as i32);
                // Half of the box around a small triangle lies beyond one of its edges.
                if (base[0] + most[0]) | (base[1] + most[1]) | (base[2] + most[2]) < 0 {
                    continue;
                }
                let level = (plane.a * x as f64 + plane.b * y as f64 + plane.c) as f32;
                let at = ((py - self.y0) * self.width + px - self.x0) as usize;
                let (near, id) = (&mut self.near[at], &mut self.id[at]);
                for s in 0..S {
                    let inside =
                        (base[0] + step[0][s]) | (base[1] + step[1][s]) | (base[2] + step[2][s]);
                    let z = (level + rise[s]).max(plane.lo).min(plane.hi);
                    let wins = (inside >= 0) & (z > near[s]);
                    near[s] = if wins { z } else { near[s] };
                    id[s] = if wins { tri.id } else { id[s] };
                }
            }
        }
    }

    /// The same for triangles far larger than the picture.
    fn fill_wide(&mut self, tri: &Tri, e: &[Edge; 3], cols: Range<i32>, rows: Range<i32>) {
        let plane = tri.plane();
        for (py, px) in rows.flat_map(|y| cols.clone().map(move |x| (y, x))) {
            let at = ((py - self.y0) * self.width + px - self.x0) as usize;
            for s in 0..S {
                let x = i64::from(px) * UNIT + i64::from(self.offsets[s][0]);
                let y = i64::from(py) * UNIT + i64::from(self.offsets[s][1]);
                let level = (plane.a * x as f64 + plane.b * y as f64 + plane.c) as f32;
                let z = level.max(plane.lo).min(plane.hi);
                if e.iter().all(|e| e.at(x, y) >= 0) && z > self.near[at][s] {
                    self.near[at][s] = z;
                    self.id[at][s] = tri.id;
                }
            }
        }
    }
}

/// Triangles sorted into the square tiles they may touch, in their own order.
pub(crate) struct Bins {
    /// Tiles across.
    pub cols: usize,
    /// Tiles down.
    pub rows: usize,
    side: usize,
    size: [usize; 2],
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Bins {
    /// Sorts `tris` over a picture of `size` pixels into tiles of `side` pixels.
    pub fn new(tris: &[Tri], size: [usize; 2], side: usize) -> Self {
        let [cols, rows] = size.map(|n| n.div_ceil(side));
        let mut bins = Self {
            cols,
            rows,
            side,
            size,
            starts: vec![0; cols * rows + 1],
            items: Vec::new(),
        };
        for tri in tris {
            bins.touched(tri, |starts, _, bin| starts[bin + 1] += 1);
        }
        for i in 1..bins.starts.len() {
            bins.starts[i] += bins.starts[i - 1];
        }
        bins.items = vec![0; bins.starts[cols * rows] as usize];
        let mut cursor = bins.starts.clone();
        for (i, tri) in tris.iter().enumerate() {
            bins.touched(tri, |_, items, bin| {
                items[cursor[bin] as usize] = i as u32;
                cursor[bin] += 1;
            });
        }
        bins
    }

    /// Indices of the triangles of tile `bin`.
    pub fn members(&self, bin: usize) -> &[u32] {
        &self.items[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }

    /// Left, top, width and height of tile `bin` [px].
    pub fn frame(&self, bin: usize) -> [usize; 4] {
        let [x, y] = [bin % self.cols * self.side, bin / self.cols * self.side];
        [
            x,
            y,
            self.side.min(self.size[0] - x),
            self.side.min(self.size[1] - y),
        ]
    }

    fn touched(&mut self, tri: &Tri, mut visit: impl FnMut(&mut [u32], &mut [u32], usize)) {
        let [cols, rows] = tri.span(0..self.size[0] as i32, 0..self.size[1] as i32, [0, 255]);
        if cols.is_empty() || rows.is_empty() {
            return;
        }
        let side = self.side as i32;
        for row in rows.start / side..=(rows.end - 1) / side {
            for col in cols.start / side..=(cols.end - 1) / side {
                visit(
                    &mut self.starts,
                    &mut self.items,
                    row as usize * self.cols + col as usize,
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tri(p: [[f64; 2]; 3], near: f32, id: u32) -> Tri {
        Tri::new(p.map(DVec2::from), [near; 3], id).unwrap()
    }

    fn seen<const S: usize>(tile: &Tile<S>, id: u32) -> usize {
        tile.id.iter().flatten().filter(|&&i| i == id).count()
    }

    #[test]
    fn the_pattern_has_one_sample_per_column_and_row() {
        for axis in 0..2 {
            let mut at = pattern::<16>().map(|p| p[axis]);
            at.sort_unstable();
            assert_eq!(at, std::array::from_fn(|i| 16 * i as i32 + 8));
        }
    }

    #[test]
    fn a_triangle_covers_its_area() {
        let mut tile = Tile::<16>::new(0, 0, 64, 64);
        tile.fill(&tri([[3.3, 5.1], [60.2, 17.9], [20.7, 58.4]], 1.0, 7));
        let area = 0.5 * ((60.2 - 3.3) * (58.4 - 5.1) - (20.7 - 3.3) * (17.9 - 5.1));
        let got = seen(&tile, 7) as f64 / 16.0;
        assert!((got - area).abs() < 0.002 * area, "{got} for {area}");
    }

    #[test]
    fn a_fan_covers_every_sample_exactly_once() {
        let n = 37;
        let rim = |i: usize| {
            let a = i as f64 / f64::from(n) * std::f64::consts::TAU;
            [31.4 + 90.0 * a.cos(), 30.9 + 90.0 * a.sin()]
        };
        let mut hits = vec![0; 64 * 64 * 16];
        for i in 0..n as usize {
            let mut tile = Tile::<16>::new(0, 0, 64, 64);
            tile.fill(&tri(
                [[31.4, 30.9], rim(i), rim((i + 1) % n as usize)],
                1.0,
                0,
            ));
            for (hit, id) in hits.iter_mut().zip(tile.id.iter().flatten()) {
                *hit += usize::from(*id == 0);
            }
        }
        assert!(hits.iter().all(|&h| h == 1));
    }

    #[test]
    fn huge_and_small_arithmetic_agree() {
        let t = tri(
            [[-4000.0, -3000.5], [9000.25, 40.0], [10.0, 9000.0]],
            1.0,
            0,
        );
        let [mut a, mut b] = [(); 2].map(|()| Tile::<4>::new(0, 0, 50, 50));
        a.fill(&t);
        assert!(t.edges().iter().any(Edge::is_wide));
        b.fill(&tri(
            [[-200.0, -196.0], [250.0, 5.0], [10.0, 400.0]],
            1.0,
            0,
        ));
        let mut c = Tile::<4>::new(0, 0, 50, 50);
        let small = tri([[-200.0, -196.0], [250.0, 5.0], [10.0, 400.0]], 1.0, 0);
        c.fill_wide(&small, &small.edges(), 0..50, 0..50);
        assert_eq!(b.id, c.id);
        assert!(seen(&a, 0) > 0);
    }

    #[test]
    fn nearer_wins_in_any_order_and_ties_go_to_the_first() {
        let p = [[0.0, 0.0], [0.0, 40.0], [40.0, 0.0]];
        for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
            let mut tile = Tile::<4>::new(0, 0, 8, 8);
            for id in order {
                tile.fill(&tri(p, 1.0 + id as f32, id));
            }
            assert_eq!(seen(&tile, 2), 256);
        }
        let mut tile = Tile::<4>::new(0, 0, 8, 8);
        tile.fill(&tri(p, 1.0, 5));
        tile.fill(&tri(p, 1.0, 6));
        assert_eq!(seen(&tile, 5), 256);
    }

    #[test]
    fn bins_hold_every_triangle_where_it_shows() {
        let tris = [tri([[5.0, 5.0], [90.0, 8.0], [40.0, 70.0]], 1.0, 0)];
        let bins = Bins::new(&tris, [100, 80], 32);
        let mut whole = Tile::<4>::new(0, 0, 100, 80);
        whole.fill(&tris[0]);
        let parts: usize = (0..bins.cols * bins.rows)
            .map(|bin| {
                let [x, y, w, h] = bins.frame(bin);
                let mut tile = Tile::<4>::new(x, y, w, h);
                bins.members(bin)
                    .iter()
                    .for_each(|&i| tile.fill(&tris[i as usize]));
                seen(&tile, 0)
            })
            .sum();
        assert_eq!(parts, seen(&whole, 0));
    }
}
