//! Skin weights that are learnt with the rest: ours, PBNS's `blendweights`, and those that NCS trains for skirts.
//!
//! A vertex has a number for every bone that may move it. PBNS takes `elu(100 W)` of each, NCS `exp` of what began as
//! `log(w + 1e-3)`, we `exp` of three times what began as a third of `log w`; all then divide by their sum. Ours are for
//! the bones that move a vertex at first, so that a model stays as small; PBNS's and NCS's are for all, so that a bone
//! that does not may come to.

use muslin_geom::widely;
use muslin_model::Skin;

use crate::lanes::{Lane, Row, Vec3};
use crate::skin;

/// What PBNS multiplies its numbers by.
const STEEP: f32 = 100.0;
/// What we multiply ours by: they are to learn so many times as fast as the network does.
const BRISK: f32 = 3.0;
/// What NCS adds to weights before their logarithm.
const FAINT: f32 = 1e-3;
/// How strongly NCS holds the weights of pinned vertices: `k Σ (w − w̄)²` over all of their bones [J].
const HELD: f32 = 100.0;

/// Whose skin weights they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Whose {
    Ours,
    Pbns,
    Ncs,
}

/// How weights follow from what is learnt.
pub(crate) struct Skinning {
    whose: Whose,
    /// The weights at first: of every vertex those of all bones that may move it.
    first: Skin,
}

impl Skinning {
    /// Of a garment that is bound by `skin` to `n_bones` bones.
    pub fn new(whose: Whose, skin: &Skin, n_bones: usize) -> Self {
        let first = match whose {
            Whose::Ours => skin.clone(),
            Whose::Pbns | Whose::Ncs => to_all(skin, n_bones),
        };
        Self { whose, first }
    }

    /// How many numbers are learnt.
    pub fn len(&self) -> usize {
        self.first.weights.len()
    }

    /// What they begin as.
    pub fn start(&self) -> Vec<f32> {
        let one = |w: &f32| match self.whose {
            Whose::Ours => w.ln() / BRISK,
            Whose::Pbns => *w,
            Whose::Ncs => (w + FAINT).ln(),
        };
        self.first.weights.iter().map(one).collect()
    }

    /// A number raised, before all of a vertex are divided by their sum, and how fast that changes.
    fn raised(&self, x: f32) -> [f32; 2] {
        let z = STEEP * x;
        match self.whose {
            Whose::Ours => [(BRISK * x).exp(), BRISK * (BRISK * x).exp()],
            Whose::Pbns if z > 0.0 => [z, STEEP],
            Whose::Pbns => [z.exp() - 1.0, STEEP * z.exp()],
            Whose::Ncs => [x.exp(); 2],
        }
    }

    /// The weights of a vertex, and how fast each rises with its number where the sum stays.
    fn row(&self, numbers: &[f32]) -> (Vec<f32>, Vec<f32>) {
        // The largest taken off changes no share, and no power grows beyond all bounds.
        let most = numbers.iter().copied().fold(f32::MIN, f32::max);
        let off = if self.whose == Whose::Pbns { 0.0 } else { most };
        let raised = numbers.iter().map(|x| self.raised(x - off));
        let (up, rate): (Vec<f32>, Vec<f32>) = raised.map(|[a, b]| (a, b)).unzip();
        let sum: f32 = up.iter().sum();
        let share = |all: Vec<f32>| all.into_iter().map(|a| a / sum).collect();
        (share(up), share(rate))
    }

    /// Where the numbers of every vertex are.
    fn rows(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let starts = self.first.starts.windows(2);
        starts.map(|s| s[0] as usize..s[1] as usize)
    }

    /// The weights that these numbers give.
    pub fn skin(&self, numbers: &[f32]) -> Skin {
        let mut skin = Skin {
            starts: vec![0],
            ..Skin::default()
        };
        for span in self.rows() {
            let (weights, _) = self.row(&numbers[span.clone()]);
            let bones = &self.first.bones[span];
            for (b, w) in bones.iter().zip(weights).filter(|e| e.1 != 0.0) {
                skin.bones.push(*b);
                skin.weights.push(w);
            }
            skin.starts.push(skin.bones.len() as u32);
        }
        skin
    }

    /// Adds to `out` what the weights do to the cost in sixteen poses of these `bones`, where the cloth lies at rest as `laid`
    /// and by `d` more [m], and is pulled by `g` [N].
    pub fn pull(
        &self,
        bones: &[[Row; 12]],
        (laid, d): (&[[f32; 3]], &[Row]),
        g: &[Row],
        out: &mut [f32],
    ) {
        widely(
            #[inline(always)]
            || {
                for ((v, t), span) in laid.iter().enumerate().zip(self.rows()) {
                    let (d, g) = (Vec3::of(d, v as u32), Vec3::of(g, v as u32));
                    let p = Vec3([0, 1, 2].map(|i| d.0[i] + t[i]));
                    for (out, b) in out[span.clone()].iter_mut().zip(&self.first.bones[span]) {
                        let there = skin::carry(&bones[usize::from(*b)].map(Lane), p);
                        *out += there.dot(g).sum() as f32;
                    }
                }
            },
        );
    }

    /// From `∂/∂weights` to `∂/∂numbers`, in place; and what it costs to hold the weights of `pins` where they were [J].
    /// Ours are not learnt of pins at all: cloth is held there by the bones that move it at first.
    pub fn slopes(&self, numbers: &[f32], pins: &[u32], slopes: &mut [f32]) -> f64 {
        let mut held = 0.0;
        for (v, span) in self.rows().enumerate() {
            let (weights, rates) = self.row(&numbers[span.clone()]);
            let slopes = &mut slopes[span.clone()];
            let is_held = pins.contains(&(v as u32));
            if self.whose == Whose::Ours && is_held {
                slopes.fill(0.0);
                continue;
            }
            if self.whose == Whose::Ncs && is_held {
                let first = &self.first.weights[span];
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

/// The same weights, and those of nothing of all other bones.
fn to_all(skin: &Skin, n_bones: usize) -> Skin {
    let n = skin.n_verts();
    let mut all = Skin {
        starts: (0..=n).map(|v| (v * n_bones) as u32).collect(),
        bones: (0..n).flat_map(|_| (0..n_bones).map(|b| b as u8)).collect(),
        weights: vec![0.0; n * n_bones],
    };
    for (v, row) in all.weights.chunks_exact_mut(n_bones).enumerate() {
        skin.row(v).for_each(|(b, w)| row[b] += w);
    }
    all
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
        let pbns = Skinning::new(Whose::Pbns, &skin(), 4);
        let back = pbns.skin(&pbns.start());
        assert_eq!((&back.starts, &back.bones), (&skin().starts, &skin().bones));
        let near = |a: &Skin, most: f32| {
            (0..3).all(|v| {
                let of = |s: &Skin, b: usize| s.row(v).find(|e| e.0 == b).map_or(0.0, |e| e.1);
                (0..4).all(|b| (of(a, b) - of(&skin(), b)).abs() < most)
            })
        };
        assert!(near(&back, 1e-6));
        let ncs = Skinning::new(Whose::Ncs, &skin(), 4);
        let back = ncs.skin(&ncs.start());
        assert!(near(&back, 4e-3) && !near(&back, 1e-5));
        for v in 0..3 {
            let sum: f32 = back.row(v).map(|e| e.1).sum();
            assert!((sum - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn the_slopes_are_those_of_the_weights_and_of_what_holds_pins() {
        for whose in [Whose::Pbns, Whose::Ncs, Whose::Ours] {
            let own = Skinning::new(whose, &skin(), 4);
            let mut noise = Noise::new(4);
            let spread = if whose == Whose::Pbns { 0.01 } else { 1.0 };
            let numbers: Vec<f32> = (own.start().iter())
                .map(|x| x + (spread * noise.normal()) as f32)
                .collect();
            let asked: Vec<f32> = noise.normals(own.len());
            let pins = if whose == Whose::Ours { [0] } else { [1] };
            let place = |v: usize, b: usize| {
                let all = own.first.row(v).position(|e| e.0 == b);
                own.first.starts[v] as usize + all.expect("it may move the vertex")
            };
            let cost = |numbers: &[f32]| {
                let s = own.skin(numbers);
                let pull = |v: usize, (b, w): (usize, f32)| f64::from(asked[place(v, b)] * w);
                let of = |v: usize| s.row(v).map(|e| pull(v, e)).sum::<f64>();
                let pulled: f64 = (0..3).map(of).sum();
                pulled + own.slopes(numbers, &pins, &mut vec![0.0; own.len()])
            };
            let mut slopes = asked.clone();
            own.slopes(&numbers, &pins, &mut slopes);
            if whose == Whose::Ours {
                let mut held = asked.clone();
                own.slopes(&numbers, &[1], &mut held);
                assert_eq!((held[1], held[2]), (0.0, 0.0));
                assert_eq!((held[0], &held[3..]), (slopes[0], &slopes[3..]));
            }
            for i in 0..own.len() {
                let h = 1e-3 * spread as f32;
                let at = |by: f32| {
                    let mut numbers = numbers.clone();
                    numbers[i] += by;
                    cost(&numbers)
                };
                let want = (at(h) - at(-h)) / (2.0 * f64::from(h));
                assert!(
                    (f64::from(slopes[i]) - want).abs() < 3e-2 + 1e-2 * want.abs(),
                    "{whose:?} {i}: {} for {want}",
                    slopes[i]
                );
            }
        }
    }
}
