//! Swings in the making: what is remembered of the frames before, and where the next one goes.

use glam::{Mat3A, Vec3A};
use pulp::Simd;

use crate::decode::{Affine, Points};
use crate::layers::Dense;
use crate::ties::{Held, Ties};
use crate::walls::{Walls, some_of};
use crate::{Model, Sway};

/// Steps of cloth's swings by BDF2, on the points that stand for it.
///
/// With `y` where the points would rest, `R` their bones' mean turn, `m` their masses and `x̂` where
/// they would go unforced, the codes solve `(Φᵀ m Φ / τ² + D / τ + Ω²) q = Φᵀ Rᵀ m (x̂ − y) / τ² + D q̂ / τ`.
#[derive(Clone, Debug)]
pub(crate) struct Swing {
    /// How much of the cloth each point stands for [kg].
    masses: Vec<f32>,
    points: Points,
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

impl Swing {
    /// Of a model's swings, if it has any.
    pub fn new(model: &Model) -> Option<Self> {
        let sway = model.sway.as_ref().filter(|s| !s.is_empty())?;
        let (k, n) = (sway.len(), sway.samples.len());
        let turned = (0..k).flat_map(|c| sway.means[c..].iter().step_by(k));
        let turned: Vec<f32> = turned.copied().chain(std::iter::repeat_n(0.0, k)).collect();
        let means = sway.means.iter().copied();
        let ways: Vec<f32> = means.chain(std::iter::repeat_n(0.0, 3 * n)).collect();
        Some(Self {
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
            masses: sway.masses.clone(),
            points: Points::of(&some_of(model, sway.samples.iter().map(|v| *v as usize))),
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
        for (rows, mass) in self.means.chunks_exact(3 * k).zip(&self.masses) {
            for row in rows.chunks_exact(k) {
                for (i, x) in row.iter().enumerate() {
                    let share = f64::from(*mass) * f64::from(*x) / (tau * tau);
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
    pub fn codes<S: Simd>(&mut self, on: S, (z, bones): (&[f32], &[Affine]), out: &mut [f32]) {
        // Where the points would rest, and how they are turned.
        self.points.turned((z, bones), &mut self.here);
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
                self.step(on, tau);
            }
        }
        for (to, q) in out[..k].iter_mut().zip(&self.past.codes[0]) {
            *to = self.level * q;
        }
    }

    /// A step in time.
    #[inline(always)]
    fn step<S: Simd>(&mut self, on: S, tau: f32) {
        let k = self.len();
        let pulls = self.each.as_chunks_mut::<3>().0;
        for (i, to) in pulls.iter_mut().enumerate() {
            let ([x1, v1], [x2, v2]) = (self.past.points[0][i], self.past.points[1][i]);
            let free = (x1 * 4.0 - x2) / 3.0 + (v1 * 4.0 - v2) * (tau / 3.0);
            let (y, turn) = &self.here[i];
            let pull = turn.transpose() * (free - *y) * (self.masses[i] / (tau * tau));
            *to = pull.to_array();
        }
        self.pulls.apply(on, &self.each, &mut self.right);
        let [q1, q2] = &mut self.past.codes;
        for i in 0..k {
            self.right[i] += self.damping[i] / tau * (4.0 * q1[i] - q2[i]) / 3.0;
        }
        std::mem::swap(q1, q2);
        for (q, row) in q1.iter_mut().zip(self.inverse.chunks_exact(k)) {
            *q = row.iter().zip(&self.right).map(|(a, b)| a * b).sum();
        }
        self.walls.hold(on, q1);
        let held = Held {
            here: &self.here,
            means: &self.means,
            ways: &self.ways,
            inverse: &self.inverse,
            each: &mut self.each,
        };
        let led = self.ties.hold(on, held, q1);
        if led {
            self.walls.hold(on, q1);
        }
        // Ties that held at once have found these ways already.
        if led || self.ties.pairs.is_empty() {
            self.ways.apply(on, q1, &mut self.each);
        }
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
