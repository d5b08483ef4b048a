//! A crew-neck shirt.

use super::{Cut, FigureRange, Side, off_skin, ramp, shadow};
use crate::form::{Form, Part, Wall};
use crate::pattern::Laid;
use crate::sheet::Sheet;
use crate::stand::Stand;
use crate::tube::{Axis, Tube};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// A crew-neck shirt. Lengths are those of the average body and grow with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tee {
    /// Girth beyond the chest's [m].
    pub chest_ease: f64,
    /// Girth at the hem beyond what it falls over: hips, belly [m].
    pub hem_ease: f64,
    /// Girth beyond the upper arm's [m].
    pub sleeve_ease: f64,
    /// Girth beyond the arm's where the sleeve ends [m].
    pub cuff_ease: f64,
    /// Sleeve length: 1 ends at the elbow, 2 at the wrist.
    pub sleeve: f64,
    /// Height of the hem above the crotch [m].
    pub hem: f64,
    /// How far the neckline stands off the neck at the sides [m].
    pub neck_width: f64,
    /// How much lower than that it lies in front [m].
    pub neck_depth: f64,
    /// Edge length of the triangles aimed at [m], 0.005 to 0.025.
    pub edge: f64,
}

/// Room above the arm, where the sleeve lies on it [m].
const ON_ARM: f64 = 0.005;

/// Height of the neckline's back above the middle of the leaning neck [m].
const NAPE: f64 = -0.022;

/// Least length of a sleeve beyond where it leaves the trunk [m].
const BEYOND_PIT: f64 = 0.06;

impl Default for Tee {
    fn default() -> Tee {
        Tee::new(Cut::Regular)
    }
}

impl Tee {
    /// A short-sleeved shirt of this cut.
    pub fn new(cut: Cut) -> Tee {
        let (chest, hem, sleeve, cuff) = match cut {
            Cut::Slim => (0.05, 0.05, 0.05, 0.06),
            Cut::Regular => (0.10, 0.08, 0.09, 0.11),
            Cut::Loose => (0.18, 0.15, 0.14, 0.17),
        };
        Tee {
            chest_ease: chest,
            hem_ease: hem,
            sleeve_ease: sleeve,
            cuff_ease: cuff,
            sleeve: 0.72,
            hem: 0.035,
            neck_width: 0.017,
            neck_depth: 0.025,
            edge: 0.012,
        }
    }

    pub(crate) fn figures(&self) -> [FigureRange; 9] {
        [
            ("chest ease [m]", self.chest_ease, 0.02, 0.5),
            ("hem ease [m]", self.hem_ease, 0.02, 0.6),
            ("sleeve ease [m]", self.sleeve_ease, 0.02, 0.3),
            ("cuff ease [m]", self.cuff_ease, 0.02, 0.3),
            ("sleeve length", self.sleeve, 0.35, 2.15),
            ("hem above the crotch [m]", self.hem, 0.02, 0.2),
            ("neck width [m]", self.neck_width, 0.0, 0.05),
            ("neck depth [m]", self.neck_depth, 0.0, 0.1),
            ("edge length [m]", self.edge, 0.005, 0.025),
        ]
    }

    /// Where the arm's axis would leave the sleeve [m], whatever the trunk's size.
    fn sleeve_end(&self, stand: &Stand, side: Side) -> DVec3 {
        let limbs = &stand.limbs[side.index()];
        if self.sleeve <= 1.0 {
            limbs.shoulder.lerp(limbs.elbow, self.sleeve)
        } else {
            limbs.elbow.lerp(limbs.wrist, self.sleeve - 1.0)
        }
    }

    pub(crate) fn cut(&self, stand: &Stand) -> Sheet {
        self.cut_above(stand, stand.crotch.y + self.hem)
    }

    /// What of the shirt is above a height [m].
    pub(super) fn cut_above(&self, stand: &Stand, floor: f64) -> Sheet {
        let v = stand.verts;
        let mut sheet = Sheet::whole(stand.map).cut(v, |p| p.y - floor);
        for side in [Side::Left, Side::Right] {
            sheet = sheet.cut(v, |p| self.before_cuff(stand, side, p));
        }
        sheet.cut(v, |p| self.outside_neck(stand, p)).largest()
    }

    /// Positive before the end of a sleeve, and away from that arm.
    fn before_cuff(&self, stand: &Stand, side: Side, p: DVec3) -> f64 {
        let limbs = &stand.limbs[side.index()];
        let from = if self.sleeve <= 1.0 {
            limbs.shoulder
        } else {
            limbs.elbow
        };
        let end = self.sleeve_end(stand, side);
        let axis = Axis::new(from, end, DVec3::Z);
        let (t, u, w) = axis.coordinates(p);
        let length = (end - from).length();
        (length - t).max((u * u + w * w).sqrt() - 0.11)
    }

    /// Positive outside a leaning elliptical cylinder around the neck.
    fn outside_neck(&self, stand: &Stand, p: DVec3) -> f64 {
        let [l, r] = stand.limbs;
        let middle = (l.shoulder + r.shoulder) / 2.0 + DVec3::new(0.0, 0.06, 0.0);
        let lean = DVec3::new(0.0, 0.94, 0.34).normalize();
        let d = p - middle;
        let half = 0.066 + self.neck_width;
        let (x, z) = (d.x, d.dot(DVec3::X.cross(lean)));
        let deep = half
            + if z > 0.0 {
                self.neck_depth - 0.025
            } else {
                0.0
            };
        let ring = ((x / half).powi(2) + (z / deep).powi(2)).sqrt() - 1.0;
        let slope = DVec3::new(0.0, 0.827, 0.562);
        let below = (NAPE - d.dot(slope)) / half;
        // The greater of the two, with a rounded corner.
        let h = (1.0 - (ring - below).abs() / 0.8).max(0.0);
        ring.max(below) + h * h * 0.2
    }

    /// Straight down from chest and shoulder blades, straight up to the neck.
    fn trunk(&self, stand: &Stand, tuck: Option<f64>) -> Tube {
        let shoulder = (stand.limbs[0].shoulder.y + stand.limbs[1].shoulder.y) / 2.0;
        let low = stand.crotch.y + self.hem - 0.03;
        let top = stand.neck;
        let pit = stand.armpit;
        let mut tube = stand.trunk_tube(low, top);
        let mut snug = tube.clone();
        let chest = tube.largest_girth(pit - 0.35 * stand.trunk(), pit) + self.chest_ease;
        let hips = tube.largest_girth(low, stand.crotch.y + 0.5 * stand.trunk()) + self.hem_ease;
        let hem = chest.max(hips);
        tube.drop_to(0, low, pit);
        tube.bridge(low, shoulder + 0.42 * (top - shoulder));
        tube.widen(|y, girth| {
            let want = hem + (chest - hem) * ((y - low) / (pit - low)).min(1.0);
            let below = ((want - girth) / TAU).max(0.006);
            below + (0.005 - below) * ramp(y, pit, shoulder)
        });
        if let Some(waist) = tuck {
            snug.widen(|_, _| 0.006);
            tube.blend_to(&snug, |y| 1.0 - ramp(y, waist, waist + 0.07));
        }
        tube.soften(3);
        tube
    }

    /// A straight cone that lies on the arm and hangs below it, and its length [m].
    fn sleeve_tube(&self, stand: &Stand, side: Side) -> (Tube, f64) {
        let (from, to) = (
            stand.limbs[side.index()].shoulder,
            self.sleeve_end(stand, side),
        );
        let (axis, length) = (Axis::new(from, to, DVec3::Z), (to - from).length());
        let arm = &stand.map.arm[side.index()];
        let mut tube = stand.tube(axis, (0.0, length + 0.12), |i| arm[i] >= 0.5);
        let biceps = tube.largest_girth(0.55 * length, length) + self.sleeve_ease;
        let cuff = tube.largest_girth(length - 0.01, length + 0.01) + self.cuff_ease;
        tube.bridge(0.0, length + 0.03);
        let ease = |t: f64, girth: f64| {
            let want = biceps + (cuff - biceps) * t / length;
            let full = ((want - girth) / TAU).max(ON_ARM);
            ON_ARM + (full - ON_ARM) * ramp(t, -0.02, 0.06)
        };
        let hang: Vec<f64> = (0..tube.len())
            .map(|i| ease(tube.at(i), tube.girth(i)))
            .collect();
        let (from, step) = (tube.at(0), tube.at(1) - tube.at(0));
        tube.widen(ease);
        let down = (-DVec3::Y + axis.along * axis.along.y).normalize_or_zero();
        tube.shift(|t| down * (hang[((t - from) / step).round() as usize] - ON_ARM));
        tube.soften(3);
        (tube, length)
    }
}

/// A shirt on one body.
pub(crate) struct Plan<'a> {
    stand: &'a Stand<'a>,
    trunk: Tube,
    sleeves: [Tube; 2],
    /// Length of the sleeves along the arms [m].
    lengths: [f64; 2],
    edge: f64,
}

impl<'a> Plan<'a> {
    /// Measures; `tuck` is the height [m] of a waistband the shirt is tucked into.
    pub fn new(tee: &Tee, stand: &'a Stand<'a>, tuck: Option<f64>) -> Plan<'a> {
        Plan::around(tee, stand, tee.trunk(stand, tuck))
    }

    /// A shirt with another trunk.
    pub(super) fn around(tee: &Tee, stand: &'a Stand<'a>, trunk: Tube) -> Plan<'a> {
        let sleeves = [Side::Left, Side::Right].map(|side| tee.sleeve_tube(stand, side));
        let lengths = [0, 1].map(|s| sleeves[s].1.max(leaves(&sleeves[s].0, &trunk) + BEYOND_PIT));
        let [(l, _), (r, _)] = sleeves;
        Plan {
            stand,
            trunk,
            sleeves: [l, r],
            lengths,
            edge: tee.edge,
        }
    }

    /// What the shirt is cut on.
    pub fn form(&self) -> Form<'_> {
        let mut parts = vec![Part::tube(&self.trunk, vec![])];
        for sleeve in &self.sleeves {
            let end = Wall::Plane(sleeve.axis.origin, -sleeve.axis.along);
            parts.push(Part::tube(sleeve, vec![end]));
        }
        parts.push(Part::Skin(&self.stand.skin, off_skin(self.edge)));
        Form { parts, blend: 0.02 }
    }

    /// The plane that a sleeve ends in: a point [m] and the unit normal.
    pub fn cuff(&self, side: Side) -> (DVec3, DVec3) {
        let axis = &self.sleeves[side.index()].axis;
        (
            axis.origin + axis.along * self.lengths[side.index()],
            axis.along,
        )
    }

    /// Where a face with these corners [m] and this share of arm bones goes on the pattern.
    pub fn lay(&self, corners: [DVec3; 3], arm: [f64; 2]) -> Laid {
        if arm[0].max(arm[1]) > 0.5 {
            return self.lay_sleeve(usize::from(arm[1] > arm[0]), corners);
        }
        let [l, r] = self.stand.limbs;
        let z = (l.shoulder.z + r.shoulder.z) / 2.0;
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let unfold = |p: DVec3| 1.0 - ramp(p.y, self.stand.armpit - 0.05, l.shoulder.y);
        let at = |p: DVec3| shadow(p, DVec2::new(0.0, z), unfold(p));
        Laid {
            panel: usize::from(middle.z < z),
            corners: corners.map(at),
        }
    }

    /// Unrolls a sleeve, open along the underarm.
    fn lay_sleeve(&self, side: usize, corners: [DVec3; 3]) -> Laid {
        let origin = self.sleeves[side].axis.origin;
        let axis = Axis::new(origin, origin + self.sleeves[side].axis.along, DVec3::Y);
        let angle = |p: DVec3| {
            let (_, u, w) = axis.coordinates(p);
            w.atan2(u)
        };
        let middle = angle(corners.iter().sum::<DVec3>() / 3.0);
        let at = |p: DVec3| {
            let turns = ((middle - angle(p)) / TAU).round();
            let along = axis.coordinates(p).0;
            DVec2::new((angle(p) + TAU * turns) * 0.06, axis.origin.y - along)
        };
        Laid {
            panel: 2 + side,
            corners: corners.map(at),
        }
    }
}

/// How far down the arm [m] the underside of a sleeve comes out of the trunk.
fn leaves(sleeve: &Tube, trunk: &Tube) -> f64 {
    let axis = &sleeve.axis;
    let down = (-DVec3::Y + axis.along * axis.along.y).normalize_or_zero();
    let underside = |t: f64| {
        let p = axis.origin + axis.along * t;
        let deep = (0..100).map(|k| p + down * (0.002 * f64::from(k)));
        deep.into_iter()
            .find(|q| sleeve.distance(*q).0 > 0.0)
            .unwrap_or(p)
    };
    let steps = (0..).map(|k| 0.005 * f64::from(k)).take_while(|t| *t < 0.3);
    steps
        .into_iter()
        .find(|t| trunk.distance(underside(*t)).0 > 0.0)
        .unwrap_or(0.0)
}
