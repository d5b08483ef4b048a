//! Cloth on cloth: near pairs push each other apart and rub.

use glam::{DVec3, Mat3A};
use muslin_energy::{AtPoint, contact, contact::Barrier, friction, friction::Pressed, proximity};

use crate::{
    matrix::{Link, narrow},
    near::Near,
    ordered,
};

/// A pair that is close enough to push.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub verts: [u32; 4],
    pub weights: [f64; 4],
    /// Where the gap would be if the two had stuck together [m].
    pub stuck: DVec3,
    pub grip: f64,
    pub stick: f64,
}

impl Pair {
    /// The pair as it stands at `x`, if it is closer than the barrier's radius.
    pub fn at(near: &Near, x: &[DVec3], rule: &Rule) -> Option<Pair> {
        let (stuck, weights) = near.gap(x);
        let [_, slope, _] = rule.barrier.at(stuck.length());
        let (grip, stick) = (-slope * rule.friction, rule.stick);
        let pair = Pair {
            verts: near.verts,
            weights,
            stuck,
            grip,
            stick,
        };
        (slope < 0.0).then_some(pair)
    }

    fn gap(&self, x: &[DVec3]) -> DVec3 {
        proximity::weighted(&self.verts.map(|v| x[v as usize]), &self.weights)
    }

    fn answer(&self, x: &[DVec3], barrier: &Barrier) -> AtPoint {
        let gap = self.gap(x);
        let mut out = contact::apart(gap, barrier);
        if self.grip > 0.0 {
            let normal = self.stuck.normalize_or_zero();
            let on = Pressed {
                normal,
                limit: self.grip,
                stick: self.stick,
            };
            let rub = friction::slide_majorised(gap - self.stuck, &on);
            out.energy += rub.energy;
            out.gradient += rub.gradient;
            out.hessian += rub.hessian;
        }
        out
    }
}

/// How cloth meets cloth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    pub barrier: Barrier,
    /// Coulomb's coefficient.
    pub friction: f64,
    /// Slide that still counts as sticking [m].
    pub stick: f64,
}

/// Sum of the pairs' energies [J].
pub(crate) fn energy(pairs: &[Pair], x: &[DVec3], barrier: &Barrier) -> f64 {
    ordered::sum(pairs.len(), |range| {
        range.map(|p| pairs[p].answer(x, barrier).energy).sum()
    })
}

/// Adds the gradients of all pairs and returns their stiffness.
pub(crate) fn add(
    pairs: &[Pair],
    x: &[DVec3],
    barrier: &Barrier,
    gradient: &mut [DVec3],
) -> Vec<Link> {
    let answers = ordered::map(pairs.len(), |p| pairs[p].answer(x, barrier));
    for (pair, answer) in pairs.iter().zip(&answers) {
        for k in 0..4 {
            gradient[pair.verts[k] as usize] += answer.gradient * pair.weights[k];
        }
    }
    let link = |(pair, answer): (&Pair, &AtPoint)| Link {
        verts: pair.verts,
        weights: pair.weights.map(|w| w as f32),
        stiffness: narrow(&answer.hessian),
    };
    let links = pairs.iter().zip(&answers).map(link);
    links.filter(|l| l.stiffness != Mat3A::ZERO).collect()
}
