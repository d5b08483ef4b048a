//! Where a mesh of unknown size, axes and pose goes on the body.
//!
//! Every unit and up-axis that makes it as large as a garment is tried where it stands; if none
//! surrounds the body, sizes and heights are searched for the one that does so most closely. What
//! is found is told in a sentence.

use super::clean::Piece;
use crate::GarmentError;
use crate::stand::Stand;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use muslin_body::{Avatar, Figure, Pose, Posed};
use muslin_geom::Surface;

/// A place on the body.
pub struct Found {
    /// From the file's units and axes to metres around the posed body.
    pub world_from_file: DAffine3,
    /// The body that the mesh was fitted on.
    pub posed: Posed,
    /// How far its arms are turned down for that [rad].
    pub turned: f64,
    /// What was decided.
    pub told: String,
}

pub(super) const UNITS: [(f64, &str); 5] = [
    (1.0, "metres"),
    (0.1, "decimetres"),
    (0.01, "centimetres"),
    (0.0254, "inches"),
    (0.001, "millimetres"),
];
/// Height of garments [m].
const HEIGHTS: (f64, f64) = (0.15, 1.75);
/// Nothing with sleeves is shorter than this [m].
const SLEEVED: f64 = 0.38;
/// A garment this tall [m] that fits where it stands is no hat or sock, wherever it is open.
const LARGE: f64 = 0.5;
/// Vertices that are looked at.
const LOOKS: usize = 300;
/// A garment stands where it is if its highest opening is this near to neck or waist [m].
const NEAR: f64 = 0.16;
/// Farther from the skin makes no difference [m].
const FAR: f64 = 0.2;
/// A place is taken as it stands if it costs less than this [m].
const FITS: f64 = 0.027;
/// As far off the skin as wide clothes are on average [m].
const WIDE: f64 = 0.09;
/// Farther off the skin than this on average [m], it is on no part of the body.
const LOST: f64 = 0.12;
/// Sleeves and arms may differ by this [rad] without the arms being moved.
const ALIKE: f64 = 0.15;

/// Finds the place.
pub fn find(
    avatar: &Avatar,
    (base, stand): (&Figure, &Stand),
    pieces: &[Piece],
) -> Result<Found, GarmentError> {
    let points = sample(pieces);
    let mut best: Option<(f64, Found)> = None;
    for (up, turn) in axes() {
        let angle = sleeve_angle(pieces, &turn);
        let upright: Vec<DVec3> = points.iter().map(|p| turn * *p).collect();
        for turned in arm_turns(stand, angle) {
            let posed = arms_turned(avatar, base, turned)?;
            let search = Search {
                points: upright.clone(),
                top: top_rim(pieces, &turn),
                rims: rims(pieces, &turn),
                arms: arms(stand, &posed, avatar)?,
                trunk: trunk(stand),
                sleeved: angle.is_some(),
                carrier: match angle {
                    Some(_) => posed.verts[stand.map.neck_vertex()].with_x(0.0),
                    None => stand.waist(),
                },
                skin: Surface::new(&posed.verts, avatar.collision_faces()),
            };
            let (cost, scale, shift, how) = search.best();
            // Arms as they are, and Y up, need no explanation: others have to be clearly better.
            if best.as_ref().is_some_and(|b| cost > 0.85 * b.0) {
                continue;
            }
            let told = told(&how, up, cost);
            let world_from_file = DAffine3 {
                matrix3: turn * scale,
                translation: shift,
            };
            let found = Found {
                world_from_file,
                posed,
                turned,
                told,
            };
            best = Some((cost, found));
        }
        if best.as_ref().is_some_and(|b| b.0 < FITS) {
            break;
        }
    }
    let (cost, found) = best.expect("an axis was tried");
    if cost > LOST {
        let what = "no size and height puts it around the body; is it a garment?";
        return Err(GarmentError::Mesh { what: what.into() });
    }
    Ok(found)
}

/// Axes that may be up, and what turns them up.
pub(super) fn axes() -> [(&'static str, DMat3); 2] {
    [
        ("Y", DMat3::IDENTITY),
        ("Z", DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2)),
    ]
}

/// Mean distance of points from the skin [m], none farther than `far`; those inside count four times.
pub(super) fn off_skin(
    skin: &Surface,
    points: impl ExactSizeIterator<Item = DVec3>,
    far: f64,
) -> f64 {
    let n = points.len() as f64;
    let off = |p: DVec3| {
        let d = skin.closest(p, far).map_or(far, |h| h.signed);
        if d < 0.0 { (4.0 * -d).min(far) } else { d }
    };
    points.map(off).sum::<f64>() / n
}

/// What was decided, in a sentence.
pub(super) fn told(how: &str, up: &str, off: f64) -> String {
    let off = off * 1e3;
    format!("taken as {how}, {up} up; {off:.0} mm off the skin on average")
}

fn sample(pieces: &[Piece]) -> Vec<DVec3> {
    let all: Vec<DVec3> = pieces
        .iter()
        .flat_map(|p| p.mesh.verts.iter().copied())
        .collect();
    let step = all.len().div_ceil(LOOKS).max(1);
    all.into_iter().step_by(step).collect()
}

struct Search {
    /// Upright, in the file's units.
    points: Vec<DVec3>,
    /// The middle of the highest opening, in the file's units.
    top: DVec3,
    /// The middles of all openings in the file's units, and whether each is for an arm.
    rims: Vec<(DVec3, bool)>,
    /// What openings go around: the arms, and the middle of trunk and legs [m].
    arms: Vec<[DVec3; 2]>,
    trunk: Vec<[DVec3; 2]>,
    /// Whether it has two sleeves or armholes.
    sleeved: bool,
    /// What the highest opening goes around: neck or waist [m].
    carrier: DVec3,
    skin: Surface,
}

impl Search {
    fn bounds(&self) -> (DVec3, DVec3) {
        let low = self.points.iter().fold(DVec3::MAX, |a, b| a.min(*b));
        let high = self.points.iter().fold(DVec3::MIN, |a, b| a.max(*b));
        (low, high)
    }

    /// Mean distance from the skin [m], far more for points inside.
    fn cost(&self, scale: f64, shift: DVec3) -> f64 {
        let at = self.points.iter().map(|p| *p * scale + shift);
        off_skin(&self.skin, at, FAR) + self.beside(scale, shift)
    }

    /// How far the openings' middles are from the limbs that go through them on average [m].
    fn beside(&self, scale: f64, shift: DVec3) -> f64 {
        let one = |&(rim, for_arm): &(DVec3, bool)| {
            let limbs = if for_arm { &self.arms } else { &self.trunk };
            let p = rim * scale + shift;
            let off = limbs.iter().map(|l| from_segment(p, l));
            (off.fold(f64::MAX, f64::min) - LOOSE).max(0.0)
        };
        self.rims.iter().map(one).sum::<f64>() / self.rims.len() as f64
    }

    /// Cost, scale, shift and what to call it.
    fn best(&self) -> (f64, f64, DVec3, String) {
        let (low, high) = self.bounds();
        let tall = high.y - low.y;
        let floor = self
            .skin
            .verts()
            .iter()
            .map(|v| v.y)
            .fold(f64::MAX, f64::min);
        let least = if self.sleeved { SLEEVED } else { HEIGHTS.0 };
        let fits = |s: f64| (least..HEIGHTS.1).contains(&(tall * s));
        let mut best = (f64::MAX, 1.0, DVec3::ZERO, String::new());
        for (s, unit) in UNITS.iter().filter(|u| fits(u.0)) {
            for (shift, from) in [(0.0, "the body's middle"), (floor, "the floor")] {
                let shift = DVec3::Y * shift;
                let near = (self.top * *s + shift).distance(self.carrier) < NEAR;
                if !near && tall * *s < LARGE {
                    continue;
                }
                let cost = self.cost(*s, shift);
                if cost < best.0 {
                    best = (cost, *s, shift, format!("{unit} from {from}"));
                }
            }
        }
        if best.0 < FITS {
            return best;
        }
        best.0 *= 0.85;
        for (s, unit) in UNITS.iter().filter(|u| fits(u.0)) {
            let (cost, shift) = self.slide(*s);
            if cost < best.0 {
                let how = format!("{unit} and moved to where it fits");
                best = (cost, *s, shift, how);
            }
        }
        if best.0 < FITS {
            return best;
        }
        let scaled = self.scaled((least, tall), best.clone());
        // A usual unit is worth more than a better fit: clothes may be wide.
        let share = if best.0 < WIDE { 0.5 } else { 0.8 };
        if scaled.0 < share * best.0 {
            scaled
        } else {
            best
        }
    }

    /// The best of all sizes from `least` [m] up, for a mesh as `tall` as this in its own units;
    /// `best` if none is better.
    fn scaled(
        &self,
        (least, tall): (f64, f64),
        mut best: (f64, f64, DVec3, String),
    ) -> (f64, f64, DVec3, String) {
        let mut try_scale = |s: f64| {
            let (cost, shift) = self.slide(s);
            if cost < best.0 {
                let unit = s * 1e3;
                let how =
                    format!("units of {unit:.1} mm: no usual unit fits, scaled until it does");
                best = (cost, s, shift, how);
            }
            best.1
        };
        let steps = 14;
        let mut s = 0.0;
        for k in 0..steps {
            let h = least * (1.5f64 / least).powf(f64::from(k) / f64::from(steps - 1));
            s = try_scale(h / tall);
        }
        for step in [1.06, 1.03, 1.015] {
            try_scale(s / step);
            s = try_scale(s * step);
        }
        best
    }

    /// The best shift for a scale, with the highest opening about where it is carried.
    fn slide(&self, s: f64) -> (f64, DVec3) {
        let middle = self.carrier - self.top * s;
        let mut best = (f64::MAX, middle);
        let mut look = |shift: DVec3| {
            let far = (shift - middle).length() > NEAR;
            let cost = if far { f64::MAX } else { self.cost(s, shift) };
            if cost < best.0 {
                best = (cost, shift);
            }
            best
        };
        for y in [-0.09, -0.06, -0.03, 0.0, 0.03, 0.06] {
            for z in [-0.04, 0.0, 0.04] {
                look(middle + DVec3::new(0.0, y, z));
            }
        }
        for step in [0.02, 0.01, 0.005] {
            for _ in 0..4 {
                let from = look(middle).1;
                for d in [DVec3::Y, DVec3::Z] {
                    look(from + d * step);
                    look(from - d * step);
                }
            }
        }
        best
    }
}

/// How far an opening's middle may be from its limb [m].
const LOOSE: f64 = 0.04;

fn from_segment(p: DVec3, [a, b]: &[DVec3; 2]) -> f64 {
    let d = *b - *a;
    let t = ((p - *a).dot(d) / d.length_squared()).clamp(0.0, 1.0);
    p.distance(*a + d * t)
}

/// Upper and lower arms of the posed body [m].
fn arms(stand: &Stand, posed: &Posed, avatar: &Avatar) -> Result<Vec<[DVec3; 2]>, GarmentError> {
    let mut out = Vec::new();
    for (s, side) in ["L", "R"].into_iter().enumerate() {
        let bone = avatar.bone(&format!("upperarm01.{side}"))?;
        let at = |p: DVec3| posed.bones[bone].transform_point3(p);
        let l = &stand.limbs[s];
        out.extend([[at(l.shoulder), at(l.elbow)], [at(l.elbow), at(l.wrist)]]);
    }
    Ok(out)
}

/// From neck to crotch, and on to both ankles [m].
fn trunk(stand: &Stand) -> Vec<[DVec3; 2]> {
    let neck = stand.crotch.with_y(stand.neck);
    let legs = [0, 1].map(|s| [stand.limbs[s].hip, stand.limbs[s].ankle]);
    let floor = (stand.limbs[0].ankle + stand.limbs[1].ankle) / 2.0;
    [
        [neck, stand.crotch],
        [stand.crotch, floor],
        legs[0],
        legs[1],
    ]
    .to_vec()
}

/// The middles of all openings, and which of them are for arms.
fn rims(pieces: &[Piece], turn: &DMat3) -> Vec<(DVec3, bool)> {
    let around = bounds(pieces, turn);
    let middles = rim_middles(pieces, turn);
    middles.map(|m| (m, is_aside(m, around))).collect()
}

/// The lowest and highest coordinates of all pieces.
fn bounds(pieces: &[Piece], turn: &DMat3) -> (DVec3, DVec3) {
    let all = pieces.iter().flat_map(|p| &p.mesh.verts);
    let all = all.map(|v| *turn * *v);
    all.fold((DVec3::MAX, DVec3::MIN), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

/// An opening that takes up more than this share of its piece's height is an open front: neck and hem in one.
const FRONT: f64 = 0.6;
/// Share of such an opening's height that is its neck, and its hem.
const END: f64 = 0.15;

/// The middles of all openings; of an open front, of its neck and its hem.
fn rim_middles(pieces: &[Piece], turn: &DMat3) -> impl Iterator<Item = DVec3> {
    let middle = |all: &[DVec3]| all.iter().sum::<DVec3>() / all.len() as f64;
    let span = |all: &[DVec3]| {
        let ends = all.iter().map(|p| p.y);
        ends.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)))
    };
    let of_piece = move |p: &Piece| {
        let verts: Vec<DVec3> = p.mesh.verts.iter().map(|v| *turn * *v).collect();
        let (low, high) = span(&verts);
        let of_rim = |rim: &Vec<u32>| {
            let rim: Vec<DVec3> = rim.iter().map(|v| verts[*v as usize]).collect();
            let (hem, neck) = span(&rim);
            let end = END * (neck - hem);
            match neck - hem > FRONT * (high - low) {
                false => vec![middle(&rim)],
                true => [neck - end..=neck, hem..=hem + end]
                    .map(|at| rim.iter().filter(|p| at.contains(&p.y)).copied().collect())
                    .map(|part: Vec<DVec3>| middle(&part))
                    .to_vec(),
            }
        };
        p.rims.iter().flat_map(of_rim).collect::<Vec<_>>()
    };
    pieces.iter().flat_map(of_piece)
}

/// Whether an opening with its middle here, in a mesh of these bounds, is for an arm.
fn is_aside(m: DVec3, (low, high): (DVec3, DVec3)) -> bool {
    let aside = (2.0 * m.x - low.x - high.x) / (high.x - low.x);
    let level = (m.y - low.y) / (high.y - low.y);
    aside.abs() > 0.5 && level > 0.3
}

/// The middle of the highest opening.
fn top_rim(pieces: &[Piece], turn: &DMat3) -> DVec3 {
    let highest = rim_middles(pieces, turn).max_by(|a, b| a.y.total_cmp(&b.y));
    highest.expect("a piece has openings")
}

/// How far below level the sleeves point [rad], if there are two.
fn sleeve_angle(pieces: &[Piece], turn: &DMat3) -> Option<f64> {
    let (low, high) = bounds(pieces, turn);
    let middle = (low.x + high.x) / 2.0;
    let mut angles = [None, None];
    for p in pieces {
        for rim in &p.rims {
            let at: Vec<DVec3> = rim
                .iter()
                .map(|&i| *turn * p.mesh.verts[i as usize])
                .collect();
            let centre = at.iter().sum::<DVec3>() / at.len() as f64;
            let aside = centre.x - middle;
            if !is_aside(centre, (low, high)) {
                continue;
            }
            let n = at.len();
            let area: DVec3 = (0..n)
                .map(|k| (at[k] - centre).cross(at[(k + 1) % n] - centre))
                .sum();
            let out = area * (area.x * aside).signum();
            let down = (-out.y).atan2(out.truncate().x.abs());
            angles[usize::from(aside < 0.0)] = Some(down);
        }
    }
    Some((angles[0]? + angles[1]?) / 2.0)
}

/// How far the arms may have to be turned down to lie in the sleeves [rad].
fn arm_turns(stand: &Stand, angle: Option<f64>) -> Vec<f64> {
    let limb = &stand.limbs[0];
    let own = limb.elbow - limb.shoulder;
    let own = (-own.y).atan2(own.x.abs());
    let mut turns = vec![0.0];
    if let Some(angle) = angle {
        // A cuff tells the direction of its sleeve only roughly.
        let around = [0.0, -0.25, 0.25].map(|d| (angle + d - own).clamp(-1.2, 0.6));
        turns.extend(around.into_iter().filter(|t| t.abs() > ALIKE));
    }
    turns
}

/// The body with its arms turned down by an angle [rad].
pub(super) fn arms_turned(
    avatar: &Avatar,
    base: &Figure,
    down: f64,
) -> Result<Posed, GarmentError> {
    let mut pose = Pose::rest(avatar);
    for (side, sign) in [("L", -1.0), ("R", 1.0)] {
        let bone = avatar.bone(&format!("upperarm01.{side}"))?;
        pose.rotations[bone] = DQuat::from_rotation_z(sign * down);
    }
    Ok(avatar.pose(base, &pose))
}
