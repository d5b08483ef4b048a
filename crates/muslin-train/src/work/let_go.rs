//! Cloth that is let go before it is learnt from: what a few steps of a solver would mend counts less.

use super::{Walled, Work};
use crate::cut::Cut;
use crate::lanes::{LANES, Row};
use crate::trainer::{Energies, Trainer};

/// Share of Jacobi's step: whole ones overshoot where neighbours are led the same way.
const SHARE: f32 = 0.5;

impl Trainer<'_> {
    /// Lets cloth go by itself for `plan.relaxed` steps of Jacobi's iteration, from corrections `r` at rest where forces
    /// (in the rest frame) are `g`; makes `g` the mean of the forces on the way, and says what cloth costs in the end.
    ///
    /// What persists on the way is what no such step mends: waves of many edges' length. Skin and planes between cloth
    /// stay where they were.
    #[inline(always)]
    pub(super) fn let_go(
        &self,
        (pack, walls): Walled<'_>,
        (r, g): (&mut [Row], &mut [Row]),
    ) -> Energies {
        let wearer = &self.wearers[pack.wearer];
        let firmness = wearer.firmness(self.firm_at(self.now.step)) as f32;
        let stiff = stiffness(&wearer.cut, firmness, self.skin_stiffness());
        let mut force = g.to_vec();
        let mut scratch = Work::default();
        for _ in 0..self.plan.relaxed {
            for ((r, f), k) in r
                .as_chunks_mut::<3>()
                .0
                .iter_mut()
                .zip(force.as_chunks::<3>().0)
                .zip(&stiff)
            {
                let by = SHARE / k;
                for (r, f) in r.iter_mut().zip(f) {
                    r.iter_mut().zip(f).for_each(|(r, f)| *r -= by * f);
                }
            }
            let mut x = r.to_vec();
            self.carry(pack, &mut x);
            force.fill([0.0; LANES]);
            self.ask((pack, walls), (&x, &mut force), &mut scratch);
            for (g, f) in g.iter_mut().zip(&force) {
                g.iter_mut().zip(f).for_each(|(g, f)| *g += f);
            }
        }
        let share = 1.0 / (1 + self.plan.relaxed) as f32;
        g.iter_mut().flatten().for_each(|g| *g *= share);
        scratch.energies
    }
}

/// How stiff the cloth holds each vertex where its neighbours stay, at most [N/m].
fn stiffness(cut: &Cut, firmness: f32, skin: f32) -> Vec<f32> {
    let mut out = vec![skin; cut.n_verts()];
    for p in &cut.patches {
        let [s, t] = p.slopes;
        let first = [-s[0] - t[0], -s[1] - t[1]];
        let [weft, warp, shear] = p.stretch;
        for (v, [a, b]) in p.verts.into_iter().zip([first, s, t]) {
            out[v as usize] +=
                firmness * p.area * (a * a * (weft + shear) + b * b * (warp + shear));
        }
    }
    for (v, out) in out.iter_mut().enumerate() {
        *out += cut.bend(v).iter().map(|b| b.1.abs()).sum::<f32>();
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::Training;
    use crate::testing::Class;

    #[test]
    fn cloth_that_is_let_go_costs_less_and_less_and_its_forces_are_the_mean_on_the_way() {
        let class = Class::new();
        let mut trainer = class.trainer();
        for _ in 0..4 {
            trainer.step().expect("finite");
        }
        let pack = trainer.now.packs[0].clone();
        let mut after = |steps: usize| {
            trainer.plan.relaxed = steps;
            let work = trainer.work(&mut pack.clone());
            (
                work.relaxed.map(|e| e.total()),
                work.energies.total(),
                work.d_modes,
            )
        };
        let (none, cost, plain) = after(0);
        assert_eq!(none, None);
        let all = [1, 2, 4, 8].map(after);
        let mut last = cost;
        for (relaxed, here, _) in &all {
            assert_eq!(*here, cost, "told is what is predicted");
            let relaxed = relaxed.expect("it was let go");
            assert!(relaxed < last, "{relaxed} {last}");
            last = relaxed;
        }
        // Forces that are mended on the way count less; their sum over the cloth is weight and skin, which stay.
        let size = |d: &[f32]| d.iter().map(|x| x * x).sum::<f32>().sqrt();
        let sizes: Vec<f32> = all.iter().map(|a| size(&a.2)).collect();
        assert!(sizes[0] < size(&plain), "{sizes:?}");
        assert!(sizes.is_sorted_by(|a, b| a > b), "{sizes:?}");
    }
}
