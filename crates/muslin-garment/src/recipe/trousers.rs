//! Trousers and shorts.

use super::{Cut, FigureRange, Side, off_skin, ramp, shadow};
use crate::form::{Form, Part, Wall, melted};
use crate::pattern::Laid;
use crate::sheet::Sheet;
use crate::stand::Stand;
use crate::tube::{Axis, Tube};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Straight trousers, held at the waist. Lengths are those of the average body and grow with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Trousers {
    /// Girth beyond the waist's [m]; cloth lies some 4 mm off the skin at least.
    pub waist_ease: f64,
    /// Girth beyond the hips' [m].
    pub hip_ease: f64,
    /// Girth beyond the thigh's [m].
    pub thigh_ease: f64,
    /// Girth of the leg's end as a share of the thigh's.
    pub taper: f64,
    /// From crotch to waistband [m].
    pub rise: f64,
    /// Leg length: 1 ends at the ankle, 0.5 about the knee.
    pub leg: f64,
    /// Edge length of the triangles aimed at [m], 0.005 to 0.025.
    pub edge: f64,
}

impl Default for Trousers {
    fn default() -> Trousers {
        Trousers::new(Cut::Regular)
    }
}

/// Half the room between the legs [m]: triangles must find their way around the fold.
const BETWEEN: f64 = 0.012;

/// Width over which hips, legs and skin melt into each other [m].
const BLEND: f64 = 0.015;

/// What is nearer to the middle than this on the default body is no leg's but the seam's [m].
const SEAM: f64 = 0.9 * BETWEEN;

/// How far below the body's crotch the trousers' lies [m].
const CROTCH_DROP: f64 = 0.012;

/// How far above the seam the legs are apart [m].
const RISEN: f64 = 0.06;

/// Room around the leg where it is widest for the cut [m].
const AT_LEAST: f64 = 0.005;

impl Trousers {
    /// Long trousers of this cut.
    pub fn new(cut: Cut) -> Trousers {
        let (hip, thigh, taper) = match cut {
            Cut::Slim => (0.03, 0.03, 0.56),
            Cut::Regular => (0.06, 0.07, 0.66),
            Cut::Loose => (0.12, 0.13, 0.78),
        };
        Trousers {
            waist_ease: 0.03,
            hip_ease: hip,
            thigh_ease: thigh,
            taper,
            rise: 0.24,
            leg: 0.98,
            edge: 0.013,
        }
    }

    pub(crate) fn figures(&self) -> [FigureRange; 7] {
        [
            ("waist ease [m]", self.waist_ease, 0.0, 0.2),
            ("hip ease [m]", self.hip_ease, 0.01, 0.5),
            ("thigh ease [m]", self.thigh_ease, 0.02, 0.5),
            ("taper", self.taper, 0.4, 1.3),
            ("rise [m]", self.rise, 0.15, 0.3),
            ("leg length", self.leg, 0.2, 1.0),
            ("edge length [m]", self.edge, 0.005, 0.025),
        ]
    }

    pub(crate) fn cut(&self, stand: &Stand) -> Sheet {
        let v = stand.verts;
        let (waist, hem) = (stand.crotch.y + self.rise, self.hem(stand));
        Sheet::whole(stand.map)
            .cut(v, |p| waist - p.y)
            .largest()
            .cut(v, |p| p.y - hem)
            .largest()
    }

    /// The height of the leg's end [m].
    fn hem(&self, stand: &Stand) -> f64 {
        let ankle = stand.limbs[0].ankle.y.max(stand.limbs[1].ankle.y);
        stand.crotch.y + (ankle - stand.crotch.y) * self.leg
    }

    /// Snug at the waist, straight over the hips.
    fn hips(&self, stand: &Stand) -> Tube {
        let (low, top) = (
            stand.crotch.y - CROTCH_DROP,
            stand.crotch.y + self.rise * stand.scale() + 0.04,
        );
        let mut tube = stand.trunk_tube(low, top);
        let widest = (0..tube.len()).max_by(|&i, &j| tube.girth(i).total_cmp(&tube.girth(j)));
        let waist = top - 0.04;
        let hip = tube.at(widest.unwrap_or(0)).min(waist - 0.04);
        // Above the hips the tape follows the body, so that the waistband does not gape.
        tube.bridge(low, hip);
        let at_waist = melted(self.waist_ease / TAU, off_skin(self.edge), BLEND);
        let at_hip = self.hip_ease / TAU;
        tube.widen(|y, _| at_hip + (at_waist - at_hip) * ramp(y, hip, waist));
        tube.soften(3);
        tube
    }

    /// A straight leg that narrows evenly.
    fn leg_tube(&self, stand: &Stand, side: Side) -> Tube {
        let limbs = &stand.limbs[side.index()];
        let axis = Axis::new(limbs.hip, limbs.ankle, DVec3::Z);
        let length = (limbs.ankle - limbs.hip).length();
        let start = (limbs.hip.y - stand.crotch.y - 0.1).max(0.0);
        let sign = if side == Side::Left { 1.0 } else { -1.0 };
        let [l, r] = &stand.map.arm;
        let mine = |i: usize| stand.verts[i].x * sign > -0.001 && l[i] + r[i] < 0.5;
        let mut tube = stand.tube(axis, (start, length), mine);
        let crotch = limbs.hip.y - stand.crotch.y;
        let thigh = tube.largest_girth(crotch + 0.02, length) + self.thigh_ease;
        let hem = thigh * self.taper;
        let at_hip = self.hip_ease / TAU;
        tube.bridge(start, length);
        tube.widen(|t, girth| {
            let s = ((t - crotch) / (length - crotch)).clamp(0.0, 1.0);
            let full = ((thigh + (hem - thigh) * s - girth) / TAU).max(AT_LEAST);
            at_hip + (full - at_hip) * ramp(t, crotch - 0.05, crotch + 0.25)
        });
        tube.soften(3);
        tube
    }
}

/// Trousers on one body.
pub(crate) struct Plan<'a> {
    stand: &'a Stand<'a>,
    hips: Tube,
    legs: [Tube; 2],
    edge: f64,
}

impl<'a> Plan<'a> {
    pub fn new(trousers: &Trousers, stand: &'a Stand<'a>) -> Plan<'a> {
        let legs = [Side::Left, Side::Right].map(|side| trousers.leg_tube(stand, side));
        Plan {
            stand,
            hips: trousers.hips(stand),
            legs,
            edge: trousers.edge,
        }
    }

    /// What the trousers are cut on.
    pub fn form(&self) -> Form<'_> {
        let crotch = self.stand.crotch;
        let seam = DVec3::new(0.0, crotch.y - CROTCH_DROP, crotch.z);
        let mut parts = vec![Part::tube(&self.hips, vec![Wall::Saddle(seam, 0.1)])];
        for (leg, inward) in self.legs.iter().zip([-DVec3::X, DVec3::X]) {
            let top = Wall::Plane(DVec3::Y * (crotch.y + 0.09), DVec3::Y);
            let inner = Wall::Plane(-inward * BETWEEN, inward);
            parts.push(Part::tube(leg, vec![top, inner]));
        }
        parts.push(Part::Skin(&self.stand.skin, off_skin(self.edge)));
        Form {
            parts,
            blend: BLEND,
        }
    }

    /// Moves the first guess `x` [m] to where thighs that touch leave room for a crotch, each leg on its side
    /// of them.
    pub fn prepare(&self, form: &Form, x: &mut [DVec3], left: &[f64]) {
        let crotch = self.stand.crotch;
        let ankle = self.stand.limbs[0].ankle.y;
        let usual = crotch.y - CROTCH_DROP - 0.01;
        let steps = (0..100)
            .map(|k| usual - 0.004 * f64::from(k))
            .take_while(|y| *y > ankle);
        let open = |y: &f64| !form.holds(DVec3::new(0.0, *y, crotch.z));
        let found = steps.into_iter().find(open).unwrap_or(usual);
        for (p, left) in x.iter_mut().zip(left) {
            if left.abs() > SEAM && p.y < usual + RISEN {
                let side = left.signum();
                p.x = side * (side * p.x).max(BETWEEN);
            }
            let share = 1.0 - ramp(p.x.abs(), 0.04, 0.16);
            let below = ((p.y - ankle) / (usual - ankle)).clamp(0.0, 1.0);
            let above = ((usual + 0.15 - p.y) / 0.15).clamp(0.0, 1.0);
            p.y += (found - usual) * share * below.min(above);
        }
    }

    /// Where a face with these corners [m] goes on the pattern.
    pub fn lay(&self, corners: [DVec3; 3]) -> Laid {
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let side = Side::of(middle);
        let limbs = &self.stand.limbs[side.index()];
        let back = middle.z < limbs.hip.z;
        let at = |p: DVec3| {
            let t = (limbs.hip.y - p.y) / (limbs.hip.y - limbs.ankle.y);
            let x = limbs.hip.x + (limbs.ankle.x - limbs.hip.x) * t.clamp(0.0, 1.0);
            shadow(p, DVec2::new(x, limbs.hip.z), 1.0)
        };
        Laid {
            panel: 2 * usize::from(back) + side.index(),
            corners: corners.map(at),
        }
    }
}
