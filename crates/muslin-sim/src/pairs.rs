//! Cloth on cloth: near pairs push each other apart and rub.

use glam::{DVec3, Mat3A};
use muslin_energy::{AtPoint, contact, contact::Barrier, outer, proximity};

use crate::{
    matrix::{Link, narrow},
    near::Near,
    ordered,
    rub::Rub,
};

/// A pair that is close enough to push, or will be once weight led the one to the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub verts: [u32; 4],
    pub weights: [f64; 4],
    /// How they rub; its normal is the unit vector across the gap.
    pub rub: Rub,
    /// How strongly the two push, or will once weight led the one to the other [N].
    press: f64,
    /// What holds the two apart that do not push yet [N/m].
    soon: f64,
}

impl Pair {
    /// The pair as it stands at `x`, if it is closer than the barrier's radius or weight leads it there. What it
    /// grips by is for [`gripping`] to say.
    fn at(near: &Near, x: &[DVec3], rule: &Rule<'_>) -> Option<Pair> {
        let (gap, weights) = near.gap(x);
        let [_, slope, _] = rule.barrier.at(gap.length());
        let normal = gap.normalize_or_zero();
        let pair = Pair {
            verts: near.verts,
            weights,
            rub: Rub::new((normal, DVec3::ZERO), 0.0, rule.stick),
            press: -slope,
            soon: 0.0,
        };
        if slope < 0.0 {
            return Some(pair);
        }
        let fall = rule.fall.dot(normal).abs();
        let [_, there, _] = rule.barrier.at(gap.length() - fall);
        // Whoever is beside what he is not above meets something else first.
        (there < 0.0 && near.is_upright(x, normal)).then(|| Pair {
            press: -there,
            soon: -there / fall,
            ..pair
        })
    }

    /// The pair with its friction. `rates`: what cloth pushed every vertex, as a share of what it may now.
    fn rubbing(self, rates: Option<&[f64]>, rule: &Rule<'_>) -> Pair {
        let rate = match rates {
            Some(rates) => self.known(rates),
            // Who is only about to meet has not pushed yet.
            None => f64::from(!self.is_coming()),
        };
        let grip = self.press * rate * self.mean(rule.friction) * rule.grip;
        let rub = Rub::new((self.normal(), self.gap(rule.from)), grip, rule.stick);
        Pair { rub, ..self }
    }

    /// The mean over the two sides of what is known of vertices.
    fn mean(&self, of: &[f64]) -> f64 {
        let ends = self.verts.iter().zip(&self.weights);
        0.5 * ends.map(|(v, w)| w.abs() * of[*v as usize]).sum::<f64>()
    }

    /// The mean over both sides of what is known of vertices, or over the one alone if the other slid to where nobody
    /// was before.
    fn known(&self, of: &[f64]) -> f64 {
        let ends = || self.verts.iter().zip(&self.weights);
        let side = |sign: f64| {
            let of = ends().map(|(v, w)| (sign * w).max(0.0) * of[*v as usize]);
            of.sum::<f64>()
        };
        let [one, other] = [1.0, -1.0].map(side);
        match one.min(other) > 0.0 {
            true => 0.5 * (one + other),
            false => one.max(other),
        }
    }

    /// How strongly the two push after a Newton step from `from` to `to` [m]: as the step saw it, and where it ended. A
    /// blow that threw them apart holds nobody. What holds up who is coming may have pulled, too; that is less than
    /// nothing [N].
    fn pushes(&self, (from, to): (&[DVec3], &[DVec3]), barrier: &Barrier) -> f64 {
        let [gap, there] = [from, to].map(|x| self.gap(x).dot(self.normal()));
        let [[_, slope, curvature], [_, ended, _]] = [gap, there].map(|gap| barrier.at(gap));
        let seen = slope + (curvature + self.soon) * (there - gap);
        match self.is_coming() {
            true => -seen,
            false => -seen.max(ended).min(0.0),
        }
    }

    /// Whether the two do not push yet, but will once weight led the one to the other.
    pub fn is_coming(&self) -> bool {
        self.soon > 0.0
    }

    /// The pair, or, if the two do not push yet and the ways on which all other forces lead [m] part them by more than a
    /// little of what weight leads, without what holds it.
    pub fn unless_parted(&self, ways: &[DVec3], fall: DVec3) -> Pair {
        let parted = self.gap(ways).dot(self.normal()) > PARTING * fall.dot(self.normal()).abs();
        Pair {
            soon: if parted { 0.0 } else { self.soon },
            ..*self
        }
    }

    /// The pair at `x` [m] with where its slide ends, if all other forces lead it farther by their `ways` than friction
    /// may hold vertices `back` [m].
    pub fn led_on(&self, x: &[DVec3], ways: &[DVec3], back: &[f64]) -> Pair {
        // Both sides are held back.
        let back = 2.0 * self.mean(back);
        let rub = self.rub.led_on(self.gap(x), self.gap(ways), back);
        Pair { rub, ..*self }
    }

    fn gap(&self, x: &[DVec3]) -> DVec3 {
        proximity::weighted(&self.verts.map(|v| x[v as usize]), &self.weights)
    }

    fn answer(&self, x: &[DVec3], barrier: &Barrier) -> AtPoint {
        let gap = self.gap(x);
        let mut out = contact::apart(gap, barrier);
        let rub = self.rub.answer(gap);
        out.energy += rub.energy;
        out.gradient += rub.gradient;
        out.hessian += rub.hessian + outer(self.normal() * self.soon, self.normal());
        out
    }

    fn normal(&self) -> DVec3 {
        self.rub.normal
    }
}

/// Who is led apart by more than this share of a fall is not about to meet.
const PARTING: f64 = 0.1;

/// How cloth meets cloth in a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule<'a> {
    pub barrier: Barrier,
    /// Coulomb's coefficient at every vertex; a pair's is the mean of its sides'.
    pub friction: &'a [f64],
    /// How much of it counts, of 1.
    pub grip: f64,
    /// Slide that still counts as sticking [m].
    pub stick: f64,
    /// Where the cloth was when the step began [m].
    pub from: &'a [DVec3],
    /// How strongly cloth pushed each vertex when the last step ended [N], if that is known: friction goes by it.
    pub pushed: Option<&'a [f64]>,
    /// How far weight alone leads within the step [m]: who may meet by that is held up before he falls through.
    pub fall: DVec3,
}

/// The pairs of a list that push at `x`, or soon will, with their friction.
///
/// What pushed a vertex when the last step ended is shared among all of its pairs, whether they touch where a solve
/// begins or not: cloth that lies on cloth is above it in one step and pressed into it in the next.
pub(crate) fn gripping(list: &[Near], x: &[DVec3], rule: &Rule<'_>) -> Vec<Pair> {
    let found = ordered::map(list.len(), |k| Pair::at(&list[k], x, rule));
    let pairs: Vec<Pair> = found.into_iter().flatten().collect();
    let rates = rule.pushed.map(|pushed| {
        let press = on_vertices(&pairs, x.len(), |p| pairs[p].press);
        let shares = pushed.iter().zip(press);
        let shares = shares.map(|(before, now)| if now > 0.0 { before / now } else { 0.0 });
        shares.collect::<Vec<_>>()
    });
    ordered::map(pairs.len(), |k| pairs[k].rubbing(rates.as_deref(), rule))
}

/// By how much friction may hold every one of `n` vertices back [N].
pub(crate) fn grips(pairs: &[Pair], n: usize) -> Vec<f64> {
    on_vertices(pairs, n, |p| pairs[p].rub.grip)
}

/// The sum over the pairs of every vertex's part in the `force` of each, by its number [N].
fn on_vertices(pairs: &[Pair], n: usize, force: impl Fn(usize) -> f64 + Sync + Send) -> Vec<f64> {
    let forces = ordered::map(pairs.len(), force);
    let mut out = vec![0.0; n];
    for (pair, force) in pairs.iter().zip(forces) {
        for (v, w) in pair.verts.iter().zip(&pair.weights) {
            out[*v as usize] += force * w.abs();
        }
    }
    out
}

/// How strongly cloth pushes every vertex after a Newton step [N]; see [`Pair::pushes`].
pub(crate) fn pushes(pairs: &[Pair], ways: (&[DVec3], &[DVec3]), barrier: &Barrier) -> Vec<f64> {
    let mut out = on_vertices(pairs, ways.0.len(), |p| pairs[p].pushes(ways, barrier));
    out.iter_mut().for_each(|f| *f = f.max(0.0));
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A vertex over the middle of a triangle, in the plane of 0 height; two sorts of cloth.
    fn over(height: f64) -> [DVec3; 4] {
        let corner = |k: u32| {
            DVec3::new(
                [0.0, 0.01, -0.01][k as usize],
                0.0,
                [0.01, 0.0, 0.0][k as usize],
            )
        };
        [
            DVec3::new(0.0, height, 0.004),
            corner(0),
            corner(1),
            corner(2),
        ]
    }

    const NEAR: Near = Near {
        verts: [0, 1, 2, 3],
        is_edges: false,
    };
    const FRICTION: [f64; 4] = [0.6, 0.2, 0.2, 0.2];

    fn rule<'a>(from: &'a [DVec3], pushed: Option<&'a [f64]>, fall: f64) -> Rule<'a> {
        Rule {
            barrier: Barrier {
                radius: 1.5e-3,
                width: 0.75e-3,
                stiffness: 150.0,
            },
            friction: &FRICTION,
            grip: 1.0,
            stick: 3e-5,
            from,
            pushed,
            fall: DVec3::NEG_Y * fall,
        }
    }

    #[test]
    fn a_pair_grips_as_both_its_sides_rub_and_by_no_more_than_pushed_before() {
        let x = over(1e-3);
        let grip =
            |pushed: Option<&[f64]>| gripping(&[NEAR], &x, &rule(&x, pushed, 0.0))[0].rub.grip;
        let [_, slope, _] = rule(&x, None, 0.0).barrier.at(1e-3);
        assert!((grip(None) / (-0.4 * slope) - 1.0).abs() < 1e-9);
        // The triangle may have come from where nobody lay on it.
        let pushed = [1e-4, 0.0, 0.0, 0.0];
        assert!((grip(Some(&pushed)) / 0.4e-4 - 1.0).abs() < 1e-9);
        assert_eq!(grip(Some(&[0.0; 4])), 0.0);
    }

    #[test]
    fn what_pushed_is_shared_by_who_touches_and_who_is_about_to() {
        // Two vertices on a triangle, the one pressed into it, the other above.
        let mut x = over(1e-3).to_vec();
        x.push(DVec3::new(0.001, 2.5e-3, 0.004));
        let other = Near {
            verts: [4, 1, 2, 3],
            is_edges: false,
        };
        let pushed = [2e-4, 0.0, 0.0, 0.0, 1e-4];
        let rule = Rule {
            friction: &[0.3; 5],
            ..rule(&x, Some(&pushed), 2.7e-3)
        };
        let pairs = gripping(&[NEAR, other], &x, &rule);
        let grips = [pairs[0].rub.grip, pairs[1].rub.grip];
        let most = |k: usize| 0.3 * pushed[[0, 4][k]];
        assert!((grips[0] / most(0) - 1.0).abs() < 1e-9, "{grips:?}");
        assert!((grips[1] / most(1) - 1.0).abs() < 1e-9, "{grips:?}");
        // One vertex that two triangles hold rubs on both by no more than pushed it.
        let twice = gripping(&[NEAR, NEAR], &x, &rule);
        assert!(((twice[0].rub.grip + twice[1].rub.grip) / most(0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_pushed_is_what_a_step_saw_unless_it_threw_the_two_apart() {
        let x = over(1e-3);
        let rule = rule(&x, None, 0.0);
        let pair = Pair::at(&NEAR, &x, &rule).expect("it is near");
        let pushed = |height: f64| pushes(&[pair], (&x, &over(height)), &rule.barrier);
        let [_, slope, curvature] = rule.barrier.at(1e-3);
        let still = pushed(1e-3);
        assert!((still[0] / -slope - 1.0).abs() < 1e-9, "{still:?}");
        assert!((still[1..].iter().sum::<f64>() / -slope - 1.0).abs() < 1e-9);
        let nearer = pushed(0.9e-3)[0];
        assert!(
            (nearer / (1e-4 * curvature - slope) - 1.0).abs() < 0.1,
            "{nearer}"
        );
        assert_eq!(pushed(1.6e-3)[0], 0.0);
    }

    #[test]
    fn who_is_about_to_fall_on_cloth_is_held_up_and_rubs_nobody() {
        let x = over(2.5e-3);
        assert!(Pair::at(&NEAR, &x, &rule(&x, None, 0.0)).is_none());
        let rule = rule(&x, None, 2.7e-3);
        let pair = Pair::at(&NEAR, &x, &rule).expect("it falls");
        assert_eq!((pair.rub.grip, pair.gap(&x).y), (0.0, 2.5e-3));
        // As stiff as makes it end where the barrier would push as much.
        let [_, there, _] = rule.barrier.at(-0.2e-3);
        assert!((pair.soon * 2.7e-3 / -there - 1.0).abs() < 1e-9);
        let answer = pair.answer(&x, &rule.barrier);
        assert_eq!((answer.energy, answer.gradient), (0.0, DVec3::ZERO));
        assert!((answer.hessian.y_axis.y / pair.soon - 1.0).abs() < 1e-9);
    }
}
