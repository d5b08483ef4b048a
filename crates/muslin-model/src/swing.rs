//! Swings in the making: what is remembered of the frames before, and where the next one goes.

use glam::{Mat3A, Vec3A};

use crate::decode::Affine;
use crate::layers::Dense;
use crate::ties::{Held, Ties};
use crate::walls::Walls;
use crate::{Model, Sway};

/// Steps of cloth's swings by BDF2, on the points that stand for it.
///
/// With `y` where the points would rest, `R` their bones' mean turn, `m` their masses and `x̂` where
/// they would go unforced, the codes solve `(Φᵀ m Φ / τ² + D / τ + Ω²) q = Φᵀ Rᵀ m (x̂ − y) / τ² + D q̂ / τ`.
#[derive(Clone, Debug)]
pub(crate) struct Swing {
    points: Vec<Point>,
    /// From the pose's codes to where every point is before it is carried, axis by axis [m].
    still: Dense,
    /// The swings at every point: three rows with one entry per code; from codes to ways, and from pulls to codes.
    means: Vec<f32>,
    ways: Dense,
    pulls: Dense,
    damping: Vec<f32>,
    stiffness: Vec<f32>,
    pub walls: Walls,
    pub ties: Ties,
    /// Seconds from frame to frame, and the inverse of the system for that, by rows.
    step: f32,
    pub inverse: Vec<f32>,
    /// What is remembered of a sequence.
    pub past: Past,
    /// Room for a frame.
    here: Vec<(Vec3A, Mat3A)>,
    each: Vec<f32>,
    right: Vec<f32>,
    /// How much of the swing is shown.
    pub level: f32,
}

/// What is remembered of the frames before.
#[derive(Clone, Debug)]
pub(crate) struct Past {
    /// How many frames were seen, as far as that matters.
    seen: usize,
    /// Where the points were and how fast they went: in the last frame, and one before [m, m/s].
    points: [Vec<[Vec3A; 2]>; 2],
    /// Codes of the last frame, and of the one before.
    codes: [Vec<f32>; 2],
}

/// Where bones carry a point, and how they turn what is around it.
#[inline(always)]
fn carried(followed: &[(u8, f32)], bones: &[Affine], at: Vec3A) -> (Vec3A, Mat3A) {
    let (mut x, mut turn) = (Vec3A::ZERO, Mat3A::ZERO);
    for &(b, w) in followed {
        let a = &bones[usize::from(b)];
        let m = Mat3A::from_cols_slice(&a[..9]);
        x += (m * at + Vec3A::from_slice(&a[9..])) * w;
        turn += m * w;
    }
    (x, turn)
}

/// The bones that a vertex follows, and how strongly.
fn bones_of(model: &Model, v: usize) -> Vec<(u8, f32)> {
    model.skin.row(v).map(|(b, w)| (b as u8, w)).collect()
}

/// From the pose's codes to where vertices are before they are carried, axis by axis [m].
pub(crate) fn still(model: &Model, verts: impl Iterator<Item = usize> + Clone) -> Dense {
    let codes = model.n_codes() - 1;
    let rows = verts.flat_map(|v| (0..3).map(move |axis| (v, axis)));
    let row = |(v, axis): (usize, usize)| &model.modes[(3 * v + axis) * (codes + 1)..][..=codes];
    let mixed = rows.clone().flat_map(|r| &row(r)[..codes]);
    let at = rows
        .clone()
        .map(|r| model.template[r.0][r.1] + row(r)[codes]);
    let params: Vec<f32> = mixed.copied().chain(at).collect();
    Dense::of(codes, rows.count(), &params)
}

/// A point that stands for the cloth around it.
#[derive(Clone, Debug)]
struct Point {
    mass: f32,
    /// Bones that it follows, and how strongly.
    bones: Vec<(u8, f32)>,
}

impl Swing {
    /// Of a model's swings, if it has any.
    pub fn new(model: &Model) -> Option<Self> {
        let sway = model.sway.as_ref().filter(|s| !s.is_empty())?;
        let (k, n) = (sway.len(), sway.samples.len());
        let point = |(v, mass): (&u32, &f32)| Point {
            mass: *mass,
            bones: bones_of(model, *v as usize),
        };
        let turned = (0..k).flat_map(|c| sway.means[c..].iter().step_by(k));
        let turned: Vec<f32> = turned.copied().chain(std::iter::repeat_n(0.0, k)).collect();
        let means = sway.means.iter().copied();
        let ways: Vec<f32> = means.chain(std::iter::repeat_n(0.0, 3 * n)).collect();
        Some(Self {
            still: still(model, sway.samples.iter().map(|v| *v as usize)),
            ways: Dense::of(k, 3 * n, &ways),
            pulls: Dense::of(3 * n, k, &turned),
            means: sway.means.clone(),
            damping: sway.damping.clone(),
            stiffness: sway.stiffness.clone(),
            walls: Walls::new(model, sway),
            ties: Ties::new(model, sway),
            step: 0.0,
            inverse: vec![0.0; k * k],
            past: Past {
                seen: 0,
                points: [vec![[Vec3A::ZERO; 2]; n], vec![[Vec3A::ZERO; 2]; n]],
                codes: [vec![0.0; k], vec![0.0; k]],
            },
            here: vec![(Vec3A::ZERO, Mat3A::IDENTITY); n],
            each: vec![0.0; 3 * n],
            right: vec![0.0; k],
            level: 1.0,
            points: sway.samples.iter().zip(&sway.masses).map(point).collect(),
        })
    }

    /// How many swings there are.
    pub fn len(&self) -> usize {
        self.stiffness.len()
    }

    /// Starts anew, with that many seconds from frame to frame.
    pub fn begin(&mut self, step: f64) {
        self.past.seen = 0;
        if self.step == step as f32 {
            return;
        }
        self.step = step as f32;
        let (k, tau) = (self.len(), 2.0 / 3.0 * step);
        let mut a = vec![0.0f64; k * k];
        for (rows, p) in self.means.chunks_exact(3 * k).zip(&self.points) {
            for row in rows.chunks_exact(k) {
                for (i, x) in row.iter().enumerate() {
                    let share = f64::from(p.mass) * f64::from(*x) / (tau * tau);
                    let out = a[i * k..(i + 1) * k].iter_mut();
                    out.zip(row).for_each(|(a, y)| *a += share * f64::from(*y));
                }
            }
        }
        for i in 0..k {
            a[i * k + i] += f64::from(self.damping[i]) / tau + f64::from(self.stiffness[i]);
        }
        let inverse = inverse(a, k);
        (self.inverse.iter_mut().zip(inverse)).for_each(|(to, x)| *to = x as f32);
        self.walls.ready(&self.inverse);
        self.ties.ready(&self.means, &self.inverse, k);
    }

    /// The codes of the next frame, where the pose mixes shapes by `z` and bones stand so.
    #[inline(always)]
    pub fn codes(&mut self, z: &[f32], bones: &[Affine], out: &mut [f32]) {
        self.rest(z, bones);
        let k = self.len();
        let tau = 2.0 / 3.0 * self.step;
        match self.past.seen {
            // Cloth that one sees for the first time goes along with the body.
            0 | 1 => {
                for (i, (y, _)) in self.here.iter().enumerate() {
                    let [x, v] = &mut self.past.points[0][i];
                    *v = match self.past.seen {
                        0 => Vec3A::ZERO,
                        _ => (*y - *x) / self.step,
                    };
                    *x = *y;
                }
                self.past.codes.iter_mut().for_each(|q| q.fill(0.0));
                let [now, before] = &mut self.past.points;
                for (b, [x, v]) in before.iter_mut().zip(now) {
                    *b = [*x - *v * self.step, *v];
                }
                self.past.seen += 1;
            }
            _ => {
                self.walls.stand(z, bones);
                self.step(tau);
            }
        }
        for (to, q) in out[..k].iter_mut().zip(&self.past.codes[0]) {
            *to = self.level * q;
        }
    }

    /// Where the points would rest, and how they are turned.
    #[inline(always)]
    fn rest(&mut self, z: &[f32], bones: &[Affine]) {
        self.still.apply(z, &mut self.each);
        let places = self.each.as_chunks::<3>().0;
        for ((p, at), here) in self.points.iter().zip(places).zip(&mut self.here) {
            *here = carried(&p.bones, bones, Vec3A::from_array(*at));
        }
    }

    /// A step in time.
    #[inline(always)]
    fn step(&mut self, tau: f32) {
        let k = self.len();
        let pulls = self.each.as_chunks_mut::<3>().0;
        for (i, to) in pulls.iter_mut().enumerate() {
            let ([x1, v1], [x2, v2]) = (self.past.points[0][i], self.past.points[1][i]);
            let free = (x1 * 4.0 - x2) / 3.0 + (v1 * 4.0 - v2) * (tau / 3.0);
            let (y, turn) = &self.here[i];
            let pull = turn.transpose() * (free - *y) * (self.points[i].mass / (tau * tau));
            *to = pull.to_array();
        }
        self.pulls.apply(&self.each, &mut self.right);
        let [q1, q2] = &mut self.past.codes;
        for i in 0..k {
            self.right[i] += self.damping[i] / tau * (4.0 * q1[i] - q2[i]) / 3.0;
        }
        std::mem::swap(q1, q2);
        for (q, row) in q1.iter_mut().zip(self.inverse.chunks_exact(k)) {
            *q = row.iter().zip(&self.right).map(|(a, b)| a * b).sum();
        }
        self.walls.hold(q1);
        let held = Held {
            here: &self.here,
            means: &self.means,
            ways: &self.ways,
            inverse: &self.inverse,
            each: &mut self.each,
        };
        if self.ties.hold(held, q1) {
            self.walls.hold(q1);
        }
        self.ways.apply(q1, &mut self.each);
        let [now, before] = &mut self.past.points;
        for (i, way) in self.each.as_chunks::<3>().0.iter().enumerate() {
            let (y, turn) = &self.here[i];
            let x = *y + *turn * Vec3A::from_array(*way);
            let free = (now[i][0] * 4.0 - before[i][0]) / 3.0;
            before[i] = now[i];
            now[i] = [x, (x - free) / tau];
        }
    }
}

/// The inverse of a symmetric positive definite matrix, by rows: Gauss and Jordan.
fn inverse(mut a: Vec<f64>, k: usize) -> Vec<f64> {
    let mut out = vec![0.0; k * k];
    (0..k).for_each(|i| out[i * k + i] = 1.0);
    for j in 0..k {
        let pivot = 1.0 / a[j * k + j];
        for c in 0..k {
            a[j * k + c] *= pivot;
            out[j * k + c] *= pivot;
        }
        for i in (0..k).filter(|i| *i != j) {
            let f = a[i * k + j];
            for c in 0..k {
                a[i * k + c] -= f * a[j * k + c];
                out[i * k + c] -= f * out[j * k + c];
            }
        }
    }
    out
}

/// How many numbers the swings add to a model's.
pub(crate) fn n_swings(model: &Model) -> usize {
    model.sway.as_ref().map_or(0, Sway::len)
}
