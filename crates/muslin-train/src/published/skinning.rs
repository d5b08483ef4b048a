//! Skin weights that are learnt with the rest: PBNS's `blendweights`, and those that NCS trains for skirts.
//!
//! A vertex has a number for every bone. PBNS takes `elu(100 W)` of each, NCS `exp` of what began as
//! `log(w + 1e-3)`; both then divide by their sum. So a bone that does not move a vertex may come to.

use muslin_model::Skin;

use super::recipe::System;

/// What PBNS multiplies its numbers by.
const STEEP: f32 = 100.0;
/// What NCS adds to weights before their logarithm.
const FAINT: f32 = 1e-3;
/// How strongly NCS holds the weights of pinned vertices: `k Σ (w − w̄)²` over all of their bones [J].
const HELD: f32 = 100.0;

/// How weights follow from what is learnt.
pub(crate) struct Skinning {
    is_soft: bool,
    n_bones: usize,
    /// Weights at first, bone after bone for every vertex.
    first: Vec<f32>,
}

impl Skinning {
    /// Of a garment that is bound by `skin` to `n_bones` bones.
    pub fn new(system: System, skin: &Skin, n_bones: usize) -> Self {
        let mut first = vec![0.0; skin.n_verts() * n_bones];
        for (v, row) in first.chunks_exact_mut(n_bones).enumerate() {
            skin.row(v).for_each(|(b, w)| row[b] += w);
        }
        Self {
            is_soft: system == System::Ncs,
            n_bones,
            first,
        }
    }

    /// How many numbers are learnt.
    pub fn len(&self) -> usize {
        self.first.len()
    }

    /// What they begin as.
    pub fn start(&self) -> Vec<f32> {
        let one = |w: &f32| match self.is_soft {
            true => (w + FAINT).ln(),
            false => *w,
        };
        self.first.iter().map(one).collect()
    }

    /// A number raised, before all of a vertex are divided by their sum, and how fast that changes.
    fn raised(&self, x: f32) -> [f32; 2] {
        if self.is_soft {
            return [x.exp(); 2];
        }
        let z = STEEP * x;
        match z > 0.0 {
            true => [z, STEEP],
            false => [z.exp() - 1.0, STEEP * z.exp()],
        }
    }

    /// The weights of a vertex, and how fast each rises with its number where the sum stays.
    fn row(&self, numbers: &[f32]) -> (Vec<f32>, Vec<f32>) {
        // The largest taken off changes no share, and no power grows beyond all bounds.
        let most = numbers.iter().copied().fold(f32::MIN, f32::max);
        let off = if self.is_soft { most } else { 0.0 };
        let raised = numbers.iter().map(|x| self.raised(x - off));
        let (up, rate): (Vec<f32>, Vec<f32>) = raised.map(|[a, b]| (a, b)).unzip();
        let sum: f32 = up.iter().sum();
        let share = |all: Vec<f32>| all.into_iter().map(|a| a / sum).collect();
        (share(up), share(rate))
    }

    /// The weights that these numbers give.
    pub fn skin(&self, numbers: &[f32]) -> Skin {
        let mut skin = Skin {
            starts: vec![0],
            ..Skin::default()
        };
        for numbers in numbers.chunks_exact(self.n_bones) {
            let (weights, _) = self.row(numbers);
            for (b, w) in weights.into_iter().enumerate().filter(|e| e.1 != 0.0) {
                skin.bones.push(b as u8);
                skin.weights.push(w);
            }
            skin.starts.push(skin.bones.len() as u32);
        }
        skin
    }

    /// From `∂/∂weights`, bone after bone for every vertex, to `∂/∂numbers`, in place; and what it costs to hold the
    /// weights of `pins` where they were [J].
    pub fn slopes(&self, numbers: &[f32], pins: &[u32], slopes: &mut [f32]) -> f64 {
        let n = self.n_bones;
        let mut held = 0.0;
        let rows = numbers
            .chunks_exact(n)
            .zip(slopes.chunks_exact_mut(n))
            .zip(self.first.chunks_exact(n));
        for (v, ((numbers, slopes), first)) in rows.enumerate() {
            let (weights, rates) = self.row(numbers);
            if self.is_soft && pins.contains(&(v as u32)) {
                for ((w, first), slope) in weights.iter().zip(first).zip(&mut *slopes) {
                    let off = w - first;
                    held += f64::from(HELD * off * off);
                    *slope += 2.0 * HELD * off;
                }
            }
            let mean: f32 = weights.iter().zip(&*slopes).map(|(w, s)| w * s).sum();
            let each = slopes.iter_mut().zip(rates);
            each.for_each(|(s, rate)| *s = rate * (*s - mean));
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;

    fn skin() -> Skin {
        Skin {
            starts: vec![0, 1, 3, 6],
            bones: vec![2, 0, 1, 0, 1, 3],
            weights: vec![1.0, 0.25, 0.75, 0.5, 0.3, 0.2],
        }
    }

    #[test]
    fn pbns_begins_with_the_garment_s_own_weights_and_ncs_near_them() {
        let pbns = Skinning::new(System::Pbns, &skin(), 4);
        let back = pbns.skin(&pbns.start());
        assert_eq!((&back.starts, &back.bones), (&skin().starts, &skin().bones));
        let near = |a: &Skin, most: f32| {
            (0..3).all(|v| {
                let of = |s: &Skin, b: usize| s.row(v).find(|e| e.0 == b).map_or(0.0, |e| e.1);
                (0..4).all(|b| (of(a, b) - of(&skin(), b)).abs() < most)
            })
        };
        assert!(near(&back, 1e-6));
        let ncs = Skinning::new(System::Ncs, &skin(), 4);
        let back = ncs.skin(&ncs.start());
        assert!(near(&back, 4e-3) && !near(&back, 1e-5));
        for v in 0..3 {
            let sum: f32 = back.row(v).map(|e| e.1).sum();
            assert!((sum - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn the_slopes_are_those_of_the_weights_and_of_what_holds_pins() {
        for system in [System::Pbns, System::Ncs] {
            let own = Skinning::new(system, &skin(), 4);
            let mut noise = Noise::new(4);
            let spread = if system == System::Pbns { 0.01 } else { 1.0 };
            let numbers: Vec<f32> = (own.start().iter())
                .map(|x| x + (spread * noise.normal()) as f32)
                .collect();
            let asked: Vec<f32> = noise.normals(12);
            let pins = [1];
            let cost = |numbers: &[f32]| {
                let s = own.skin(numbers);
                let pull = |v: usize, (b, w): (usize, f32)| f64::from(asked[4 * v + b] * w);
                let of = |v: usize| s.row(v).map(|e| pull(v, e)).sum::<f64>();
                let pulled: f64 = (0..3).map(of).sum();
                pulled + own.slopes(numbers, &pins, &mut [0.0; 12])
            };
            let mut slopes = asked.clone();
            own.slopes(&numbers, &pins, &mut slopes);
            for i in 0..12 {
                let h = 1e-3 * spread as f32;
                let at = |by: f32| {
                    let mut numbers = numbers.clone();
                    numbers[i] += by;
                    cost(&numbers)
                };
                let want = (at(h) - at(-h)) / (2.0 * f64::from(h));
                assert!(
                    (f64::from(slopes[i]) - want).abs() < 3e-2 + 1e-2 * want.abs(),
                    "{system:?} {i}: {} for {want}",
                    slopes[i]
                );
            }
        }
    }
}
