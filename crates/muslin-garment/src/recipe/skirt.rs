//! A skirt, and how any skirt falls from the waist.

use super::{Cut, FigureRange, off_skin, ramp, shadow};
use crate::form::{Form, Part, melted};
use crate::pattern::Laid;
use crate::sheet::Sheet;
use crate::stand::Stand;
use crate::tube::Tube;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// A skirt of two panels, held at the waist. Lengths are those of the average body and grow with
/// it.
#[derive(Clone, Debug, PartialEq)]
pub struct Skirt {
    /// Girth beyond the waist's [m]; cloth lies some 4 mm off the skin at least.
    pub waist_ease: f64,
    /// Girth beyond the hips' [m].
    pub hip_ease: f64,
    /// Girth at the hem beyond that at the hips [m].
    pub flare: f64,
    /// From crotch to waistband [m].
    pub rise: f64,
    /// Length below the crotch: 1 ends at the ankle, 0.5 about the knee.
    pub length: f64,
    /// Edge length of the triangles aimed at [m], 0.005 to 0.025.
    pub edge: f64,
}

/// Width over which skirt and skin melt into each other [m].
const BLEND: f64 = 0.015;

impl Default for Skirt {
    fn default() -> Skirt {
        Skirt::new(Cut::Regular)
    }
}

impl Skirt {
    /// A skirt of this cut that ends at the knee.
    pub fn new(cut: Cut) -> Skirt {
        let (hip, flare) = match cut {
            Cut::Slim => (0.03, 0.08),
            Cut::Regular => (0.05, 0.45),
            Cut::Loose => (0.08, 1.1),
        };
        Skirt {
            waist_ease: 0.02,
            hip_ease: hip,
            flare,
            rise: 0.22,
            length: 0.5,
            edge: 0.012,
        }
    }

    pub(crate) fn figures(&self) -> [FigureRange; 6] {
        [
            ("waist ease [m]", self.waist_ease, 0.0, 0.3),
            ("hip ease [m]", self.hip_ease, 0.01, 0.5),
            ("flare [m]", self.flare, 0.0, 3.0),
            ("rise [m]", self.rise, 0.15, 0.23),
            ("length", self.length, 0.1, 0.95),
            ("edge length [m]", self.edge, 0.005, 0.025),
        ]
    }

    pub(crate) fn cut(&self, stand: &Stand) -> Sheet {
        let v = stand.verts;
        let (waist, hem) = (stand.crotch.y + self.rise, hem(stand, self.length));
        Sheet::skirt(stand.map)
            .cut(v, |p| waist - p.y)
            .cut(v, |p| p.y - hem)
            .largest()
    }

    /// Snug at the waist, straight from the hips down to the hem.
    fn tube(&self, stand: &Stand) -> Tube {
        let hem = hem(stand, self.length);
        let waist = stand.crotch.y + self.rise * stand.scale();
        let (low, top) = (hem - 0.03, waist + 0.04);
        let mut tube = stand.trunk_tube(low, top);
        let falls = self.falls(stand, &tube, (hem, waist));
        // Above the hips the tape follows the body, so that the waistband does not gape.
        tube.bridge(low, falls[1].0);
        let gap = off_skin(self.edge);
        tube.widen(|y, girth| {
            let away = ease(&falls, y, girth, gap);
            away + (melted(away, gap, BLEND) - away) * ramp(y, falls[1].0, waist)
        });
        tube.soften(3);
        tube
    }

    /// Height [m] and girth [m] of hem, hips and waist, from the bottom up; `body` is measured.
    pub(super) fn falls(&self, stand: &Stand, body: &Tube, (hem, waist): (f64, f64)) -> [Knot; 3] {
        let hips =
            (0..body.len()).filter(|&i| (stand.crotch.y - 0.04..waist).contains(&body.at(i)));
        let widest = hips.max_by(|&i, &j| body.girth(i).total_cmp(&body.girth(j)));
        let widest = widest.unwrap_or(body.len() - 1);
        let at_waist = body.largest_girth(waist - 0.01, waist + 0.01) + self.waist_ease;
        let at_hips = (body.girth(widest) + self.hip_ease).max(at_waist);
        // Hips that are widest at the waist still leave the skirt somewhere to begin to fall.
        let hips = body.at(widest).min(waist - 0.04);
        [
            (hem, at_hips + self.flare),
            (hips, at_hips),
            (waist, at_waist),
        ]
    }
}

/// The height of the hem of a skirt of some length [m].
pub(super) fn hem(stand: &Stand, length: f64) -> f64 {
    let ankle = stand.limbs[0].ankle.y.max(stand.limbs[1].ankle.y);
    stand.crotch.y + (ankle - stand.crotch.y) * length
}

/// A height and the girth wanted there [m].
pub(super) type Knot = (f64, f64);

/// How far to widen a station of some girth at height `y`, so that the girth follows `knots` [m],
/// `least` [m] at least.
pub(super) fn ease(knots: &[Knot], y: f64, girth: f64, least: f64) -> f64 {
    let next = knots.iter().position(|k| y < k.0);
    let want = match next {
        Some(0) => knots[0].1,
        None => knots[knots.len() - 1].1,
        Some(k) => {
            let ((low, at_low), (high, at_high)) = (knots[k - 1], knots[k]);
            at_low + (at_high - at_low) * (y - low) / (high - low)
        }
    };
    ((want - girth) / TAU).max(least)
}

/// A skirt on one body.
pub(crate) struct Plan<'a> {
    stand: &'a Stand<'a>,
    tube: Tube,
    edge: f64,
}

impl<'a> Plan<'a> {
    pub fn new(skirt: &Skirt, stand: &'a Stand<'a>) -> Plan<'a> {
        Plan {
            stand,
            tube: skirt.tube(stand),
            edge: skirt.edge,
        }
    }

    /// What the skirt is cut on.
    pub fn form(&self) -> Form<'_> {
        let parts = vec![
            Part::tube(&self.tube, vec![]),
            Part::Skin(&self.stand.skin, off_skin(self.edge)),
        ];
        Form {
            parts,
            blend: BLEND,
        }
    }

    /// Where a face with these corners [m] goes on the pattern: front or back.
    pub fn lay(&self, corners: [DVec3; 3]) -> Laid {
        let [l, r] = self.stand.limbs;
        let z = (l.hip.z + r.hip.z) / 2.0;
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        Laid {
            panel: usize::from(middle.z < z),
            corners: corners.map(|p| shadow(p, DVec2::new(0.0, z), 1.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn girths_follow_their_knots_but_never_strangle() {
        let knots = [(0.0, 2.0), (0.5, 1.0), (0.7, 0.8)];
        let girth = |y: f64, body: f64| body + TAU * ease(&knots, y, body, 0.006);
        assert!((girth(0.25, 0.9) - 1.5).abs() < 1e-12);
        assert!((girth(0.6, 0.5) - 0.9).abs() < 1e-12);
        assert!((girth(-0.1, 0.9) - 2.0).abs() < 1e-12 && (girth(0.9, 0.5) - 0.8).abs() < 1e-12);
        assert!(girth(0.6, 1.2) > 1.2 + TAU * 0.0059);
    }
}
