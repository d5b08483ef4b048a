//! From what poses give to a better network.

use muslin_net::learn::{Adam, View, multiply};

use crate::elastic::Elastic;
use crate::factor::Factor;
use crate::lanes::{LANES, Row};
use crate::lesson::Plan;
use crate::trainer::Trainer;
use crate::work::Work;

/// No vertex of a pose that is learnt from moves farther than this in a step of the shapes [m].
pub(crate) const FARTHEST: f32 = 0.01;
/// Memory of the codes' moments and of the walls' stiffness.
const MEMORY: f64 = 0.95;
/// How many times its mean the stiffness of a wall is taken to be.
const PRESSED: f32 = 3.0;
/// Share of the codes' mean square that is added to all of them.
pub(crate) const FLOOR: f64 = 3e-2;
/// Share of the skin's stiffness at the first step, and of the steps after which it has all.
const SOFT_START: f32 = 0.2;
const HARDENED: f32 = 0.4;
/// Shares of the steps between which firm cloth becomes as soft as it is.
const SOFTENS: [f64; 2] = [0.1, 0.3];
/// Share of the steps at the end in which step sizes fall.
const FADE: f32 = 0.4;

impl Trainer<'_> {
    /// Slower and slower at the end.
    pub(crate) fn fading(&self) -> f32 {
        let done = self.now.step as f32 / self.plan.steps.max(1) as f32;
        ((1.0 - done) / FADE).clamp(0.01, 1.0)
    }

    /// Soft at first, so that cloth finds its way out of the body before it is pressed on it.
    pub(crate) fn skin_stiffness(&self) -> f32 {
        if self.begun.is_some() {
            return self.plan.skin as f32;
        }
        let done = self.now.step as f32 / self.plan.steps.max(1) as f32;
        self.plan.skin as f32 * (SOFT_START + (1.0 - SOFT_START) * done / HARDENED).min(1.0)
    }

    /// How firm cloth is taken to be after so many steps.
    pub(crate) fn firm_at(&self, step: u64) -> f64 {
        firm_at(&self.plan, self.begun.is_some(), step)
    }

    /// Takes a step.
    pub(crate) fn learn(&mut self, works: &[Work]) {
        let share = 1.0 / works.len() as f32;
        let sum = |of: fn(&Work) -> &[f32]| {
            let mut out = vec![0.0f32; of(&works[0]).len()];
            for w in works {
                out.iter_mut().zip(of(w)).for_each(|(o, x)| *o += share * x);
            }
            out
        };
        let adam = Adam {
            rate: self.plan.rate * self.fading(),
            ..Adam::default()
        };
        let slopes = [sum(|w| &w.d_params), sum(|w| &w.d_skinning)].concat();
        adam.step(&mut self.now.adam, &mut self.now.params, &slopes);
        self.bind();
        self.remember(&sum(|w| &w.moments), &sum(|w| w.walls.as_flattened()));
        let (d_modes, keep) = (sum(|w| &w.d_modes), self.plan.momentum);
        for (m, d) in self.now.momentum.iter_mut().zip(&d_modes) {
            *m = keep * *m + (1.0 - keep) * d;
        }
        let k = self.plan.codes;
        let solved = self.factor.solve(&self.now.momentum, k);
        let inverse = inverse(&self.now.moments, k, FLOOR);
        let mut moves = vec![0.0; solved.len()];
        multiply(
            &mut moves,
            0.0,
            View::new(&solved, solved.len() / k, k),
            View::new(&inverse, k, k),
        );
        let rate = self.plan.shape_rate * self.fading();
        let farthest = rate * farthest(&moves, works, k);
        let rate = rate * (FARTHEST / farthest.max(1e-12)).min(1.0);
        self.now
            .modes
            .iter_mut()
            .zip(&moves)
            .for_each(|(m, d)| *m -= rate * d);
    }

    /// Takes codes and walls into the running means, and factors anew where that is due.
    pub(crate) fn remember(&mut self, moments: &[f32], walls: &[f32]) {
        let now = &mut self.now;
        let keep = if now.moments[now.moments.len() - 1] == 0.0 {
            0.0
        } else {
            MEMORY
        };
        for (m, x) in now.moments.iter_mut().zip(moments) {
            *m = keep * *m + (1.0 - keep) * f64::from(*x);
        }
        for (m, x) in now.walls.as_flattened_mut().iter_mut().zip(walls) {
            *m = keep as f32 * *m + (1.0 - keep as f32) * x;
        }
        if factors_at(now.step) {
            now.factored.clone_from(&now.walls);
            now.factored_at = now.step;
            self.refactor();
        }
    }

    /// Factors with the walls that were remembered last, and with the cloth as firm as it was then: a step that was left
    /// out has not factored.
    pub(crate) fn refactor(&mut self) {
        let firm = self.firm_at(self.now.factored_at);
        if !self.elastic.is_of(firm) {
            self.elastic = Elastic::new(&self.wearers, firm);
        }
        self.factor = factored(&self.elastic, &self.now.factored, &self.plan);
    }
}

/// How firm cloth is taken to be after so many steps: 1 at first, 0 in the end, and from the start where a training
/// has begun with a model.
pub(crate) fn firm_at(plan: &Plan, has_begun: bool, step: u64) -> f64 {
    if has_begun {
        return 0.0;
    }
    let done = step as f64 / plan.steps.max(1) as f64;
    ((SOFTENS[1] - done) / (SOFTENS[1] - SOFTENS[0])).clamp(0.0, 1.0)
}

/// Whether the stiffness is factored anew after so many steps.
pub(crate) fn factors_at(step: u64) -> bool {
    matches!(step, 1 | 5 | 20 | 60) || step.is_multiple_of(150)
}

/// How far the step takes the vertex that it takes farthest, in all poses of a batch [m].
fn farthest(moves: &[f32], works: &[Work], k: usize) -> f32 {
    let moves = View::new(moves, moves.len() / k, k);
    let one = |w: &Work| {
        let mut x = vec![[0.0f32; LANES]; moves.rows()];
        multiply(
            x.as_flattened_mut(),
            0.0,
            moves,
            View::new(&w.codes, k, LANES),
        );
        let square =
            |v: &[Row; 3], lane: usize| v.iter().map(|row| row[lane] * row[lane]).sum::<f32>();
        let vertex = |v: &[Row; 3]| (0..LANES).map(|lane| square(v, lane)).fold(0.0, f32::max);
        x.as_chunks::<3>().0.iter().map(vertex).fold(0.0, f32::max)
    };
    works.iter().map(one).fold(0.0, f32::max).sqrt()
}

/// Factors the stiffness with walls.
pub(crate) fn factored(elastic: &Elastic, walls: &[[f32; 6]], plan: &Plan) -> Factor {
    // A vertex is pressed on in some poses only, and then harder than on the mean.
    let pressed: Vec<[f32; 6]> = walls.iter().map(|w| w.map(|k| PRESSED * k)).collect();
    let factor = elastic.factor(&pressed, plan.damping);
    factor.expect("springs and a positive damping are positive definite")
}

/// The inverse of the moments, with a floor of that share of their mean.
pub(crate) fn inverse(moments: &[f64], k: usize, floor: f64) -> Vec<f32> {
    let mean = (0..k).map(|i| moments[i * k + i]).sum::<f64>() / k as f64;
    let mut a = moments.to_vec();
    (0..k).for_each(|i| a[i * k + i] += floor * mean.max(1e-12));
    // Cholesky in place, then the inverse column by column.
    for j in 0..k {
        for i in j..k {
            let dot: f64 = (0..j).map(|q| a[i * k + q] * a[j * k + q]).sum();
            let value = a[i * k + j] - dot;
            a[i * k + j] = if i == j {
                value.sqrt()
            } else {
                value / a[j * k + j]
            };
        }
    }
    let mut out = vec![0.0f32; k * k];
    for c in 0..k {
        let mut x = vec![0.0; k];
        x[c] = 1.0;
        for i in 0..k {
            let dot: f64 = (0..i).map(|q| a[i * k + q] * x[q]).sum();
            x[i] = (x[i] - dot) / a[i * k + i];
        }
        for i in (0..k).rev() {
            let dot: f64 = (i + 1..k).map(|q| a[q * k + i] * x[q]).sum();
            x[i] = (x[i] - dot) / a[i * k + i];
        }
        (0..k).for_each(|r| out[r * k + c] = x[r] as f32);
    }
    out
}
