//! One number of sixteen poses at a time, in plain loops that compilers make wide.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use glam::DVec3;

/// Poses that are worked on side by side.
pub const LANES: usize = 16;

/// One number of every pose, as it lies in memory.
pub type Row = [f32; LANES];

/// Where vertices are in one of the poses [m]; three rows a vertex.
pub fn points(x: &[Row], lane: usize) -> Vec<DVec3> {
    let one = |p: &[Row; 3]| DVec3::from_array(p.map(|row| f64::from(row[lane])));
    x.as_chunks::<3>().0.iter().map(one).collect()
}

/// What poses say of some vertices, vertex by vertex in order: `none`, with what each pose says `put` into its lane.
pub fn side_by_side<'p, T: 'p, R: Clone>(
    poses: impl Iterator<Item = &'p Vec<(u32, T)>> + Clone,
    none: &R,
    put: impl Fn(&mut R, usize, &T),
) -> Vec<(u32, R)> {
    let mut verts: Vec<u32> = poses.clone().flatten().map(|said| said.0).collect();
    verts.sort_unstable();
    verts.dedup();
    let mut out: Vec<(u32, R)> = verts.iter().map(|v| (*v, none.clone())).collect();
    for (lane, said) in poses.enumerate() {
        for (v, what) in said {
            let at = verts
                .binary_search(v)
                .expect("every vertex was listed above");
            put(&mut out[at].1, lane, what);
        }
    }
    out
}

/// One number of every pose.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Lane(pub Row);

impl Lane {
    /// The same number in every pose.
    #[inline(always)]
    pub fn all(x: f32) -> Self {
        Lane([x; LANES])
    }

    /// The larger of two.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = if self.0[i] > other.0[i] {
                self.0[i]
            } else {
                other.0[i]
            };
        }
        out
    }

    /// The smaller of two.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = if self.0[i] < other.0[i] {
                self.0[i]
            } else {
                other.0[i]
            };
        }
        out
    }

    /// The square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = out.0[i].sqrt();
        }
        out
    }

    /// `below` where this is less than `limit`, else `above`.
    #[inline(always)]
    pub fn choose_below(self, limit: f32, below: f32, above: f32) -> Self {
        let mut out = self;
        for i in 0..LANES {
            out.0[i] = if self.0[i] < limit { below } else { above };
        }
        out
    }

    /// The sum over all poses, in order.
    pub fn sum(self) -> f64 {
        self.0.iter().map(|x| f64::from(*x)).sum()
    }
}

macro_rules! each {
    ($trait:ident, $name:ident, $assign:tt) => {
        impl $trait for Lane {
            type Output = Lane;
            #[inline(always)]
            fn $name(mut self, other: Lane) -> Lane {
                for i in 0..LANES {
                    self.0[i] $assign other.0[i];
                }
                self
            }
        }
        impl $trait<f32> for Lane {
            type Output = Lane;
            #[inline(always)]
            fn $name(mut self, other: f32) -> Lane {
                for i in 0..LANES {
                    self.0[i] $assign other;
                }
                self
            }
        }
    };
}

each!(Add, add, +=);
each!(Sub, sub, -=);
each!(Mul, mul, *=);
each!(Div, div, /=);

impl Neg for Lane {
    type Output = Lane;
    #[inline(always)]
    fn neg(mut self) -> Lane {
        for i in 0..LANES {
            self.0[i] = -self.0[i];
        }
        self
    }
}

impl AddAssign for Lane {
    #[inline(always)]
    fn add_assign(&mut self, other: Lane) {
        *self = *self + other;
    }
}

/// One vector of every pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3(pub [Lane; 3]);

impl Vec3 {
    /// Zero in every pose.
    pub const ZERO: Self = Vec3([Lane([0.0; LANES]); 3]);

    /// Vertex `v` of positions that lie `[vertex][axis][pose]`.
    #[inline(always)]
    pub fn of(x: &[Row], v: u32) -> Self {
        let at = 3 * v as usize;
        let x = &x[at..at + 3];
        Vec3([Lane(x[0]), Lane(x[1]), Lane(x[2])])
    }

    /// Writes vertex `v`.
    #[inline(always)]
    pub fn put(self, x: &mut [Row], v: u32) {
        let at = 3 * v as usize;
        let x = &mut x[at..at + 3];
        for axis in 0..3 {
            x[axis] = self.0[axis].0;
        }
    }

    /// Adds to vertex `v`.
    #[inline(always)]
    pub fn add_to(self, x: &mut [Row], v: u32) {
        let at = 3 * v as usize;
        let x = &mut x[at..at + 3];
        for axis in 0..3 {
            x[axis] = (Lane(x[axis]) + self.0[axis]).0;
        }
    }

    /// `self · other`.
    #[inline(always)]
    pub fn dot(self, other: Self) -> Lane {
        let ([a, b, c], [d, e, f]) = (self.0, other.0);
        a * d + b * e + c * f
    }

    /// Times one number a pose.
    #[inline(always)]
    pub fn times(self, k: Lane) -> Self {
        Vec3([self.0[0] * k, self.0[1] * k, self.0[2] * k])
    }
}

impl Add for Vec3 {
    type Output = Vec3;
    #[inline(always)]
    fn add(self, o: Vec3) -> Vec3 {
        Vec3([self.0[0] + o.0[0], self.0[1] + o.0[1], self.0[2] + o.0[2]])
    }
}

impl Sub for Vec3 {
    type Output = Vec3;
    #[inline(always)]
    fn sub(self, o: Vec3) -> Vec3 {
        Vec3([self.0[0] - o.0[0], self.0[1] - o.0[1], self.0[2] - o.0[2]])
    }
}

impl Mul<f32> for Vec3 {
    type Output = Vec3;
    #[inline(always)]
    fn mul(self, k: f32) -> Vec3 {
        Vec3([self.0[0] * k, self.0[1] * k, self.0[2] * k])
    }
}

impl AddAssign for Vec3 {
    #[inline(always)]
    fn add_assign(&mut self, o: Vec3) {
        *self = *self + o;
    }
}

impl SubAssign for Vec3 {
    #[inline(always)]
    fn sub_assign(&mut self, o: Vec3) {
        *self = *self - o;
    }
}
