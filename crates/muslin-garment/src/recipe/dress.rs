//! A dress: a shirt and a skirt in one, taken in at the waist.

use super::skirt::{ease, hem};
use super::{Cut, FigureRange, Skirt, Tee, ramp, tee};
use crate::sheet::Sheet;
use crate::stand::Stand;
use crate::tube::Tube;

/// A dress with a crew neck and sleeves. Lengths are those of the average body and grow with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Dress {
    /// Neckline, sleeves, room at the chest, and the triangles' size; its hem does not count.
    pub top: Tee,
    /// Room at waist and hips, flare and length; its rise and triangles do not count.
    pub skirt: Skirt,
}

impl Default for Dress {
    fn default() -> Dress {
        Dress::new(Cut::Regular)
    }
}

impl Dress {
    /// A short-sleeved dress of this cut that ends at the knee.
    pub fn new(cut: Cut) -> Dress {
        let (waist, hip, flare) = match cut {
            Cut::Slim => (0.06, 0.05, 0.15),
            Cut::Regular => (0.12, 0.08, 0.6),
            Cut::Loose => (0.25, 0.16, 1.2),
        };
        Dress {
            top: Tee::new(cut),
            skirt: Skirt {
                waist_ease: waist,
                hip_ease: hip,
                flare,
                ..Skirt::new(cut)
            },
        }
    }

    pub(crate) fn figures(&self) -> Vec<FigureRange> {
        let top = self.top.figures();
        top.into_iter().chain(self.skirt.figures()).collect()
    }

    pub(crate) fn cut(&self, stand: &Stand) -> Sheet {
        let (v, hem) = (stand.verts, hem(stand, self.skirt.length));
        let skirt = Sheet::skirt(stand.map).cut(v, |p| p.y - hem).largest();
        let shirt = self.top.cut_above(stand, stand.skirt_top() + SEAM);
        shirt.joined(skirt, v)
    }

    /// What the dress is cut on.
    pub(crate) fn plan<'a>(&self, stand: &'a Stand<'a>) -> tee::Plan<'a> {
        tee::Plan::around(&self.top, stand, self.trunk(stand))
    }

    /// Straight down from the chest to the waist, over the hips, and out to the hem.
    fn trunk(&self, stand: &Stand) -> Tube {
        let hem = hem(stand, self.skirt.length);
        let shoulder = (stand.limbs[0].shoulder.y + stand.limbs[1].shoulder.y) / 2.0;
        let (low, top) = (hem - 0.03, stand.neck);
        let (pit, waist) = (stand.armpit, stand.waist().y);
        let mut tube = stand.trunk_tube(low, top);
        let chest = tube.largest_girth(pit - 0.35 * stand.trunk(), pit) + self.top.chest_ease;
        let [a, b, c] = self.skirt.falls(stand, &tube, (hem, waist));
        let knots = [a, b, c, (pit, chest.max(c.1))];
        tube.bridge(low, waist);
        tube.bridge(waist, shoulder + 0.42 * (top - shoulder));
        tube.widen(|y, girth| {
            let below = ease(&knots, y, girth, AT_LEAST);
            below + (0.005 - below) * ramp(y, pit, shoulder)
        });
        tube.soften(3);
        tube
    }
}

/// Room around the body where the cut would leave less [m].
const AT_LEAST: f64 = 0.006;

/// How far above the skirt's upper edge the shirt is cut off, to be joined to it [m].
const SEAM: f64 = 0.015;
