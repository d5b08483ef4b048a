//! Gloves, socks and boots: meshes with one opening, which a hand or a foot goes into, and what goes around a limb
//! beside them.

use super::clean::{Piece, extent, middle};
use super::place::{Found, UNITS, arms_turned, axes, off_skin, told};
use crate::GarmentError;
use crate::growing::{FOOT, HAND};
use crate::stand::{Limbs, SIDES, Stand, limb_share};
use glam::{DAffine3, DVec3};
use muslin_body::{Avatar, Figure, Posed};
use muslin_geom::Surface;

/// Size of what goes around a hand or a foot, corner to corner [m].
const SIZES: (f64, f64) = (0.15, 1.2);
/// Vertices of a mesh, and of a hand or foot, that are looked at.
const LOOKS: usize = 160;
const TIPS: usize = 48;
/// Farther from the skin makes no difference [m].
const FAR: f64 = 0.3;
/// A place is taken as it stands if it costs less than this [m], and no other that costs more.
const FITS: f64 = 0.02;
/// If it costs more than this [m] where it stands, it is for no hand and no foot: it is there on purpose.
const LOST: f64 = 0.04;
/// A place on a hand or a foot is covered if the cloth is this near [m].
const COVERED: f64 = 0.02;
/// What a metre costs by which it is farther away than that.
const BARE: f64 = 4.0;
/// What two pieces on the same hand or foot cost [m].
const SAME: f64 = 0.1;
/// Steps by which a place is searched [m], and moves of each.
const STEPS: [f64; 5] = [0.08, 0.04, 0.02, 0.01, 0.005];
const MOVES: usize = 6;

/// A hand or a foot of a posed body.
struct End {
    name: String,
    /// Wrist or ankle [m].
    pivot: DVec3,
    /// Some of its skin [m].
    skin: Vec<DVec3>,
}

/// Where meshes with one opening each go: as they stand, or moved to where hands or feet fill them.
pub fn find(
    avatar: &Avatar,
    (base, stand): (&Figure, &Stand),
    pieces: &[Piece],
) -> Result<Found, GarmentError> {
    let mut best: Option<(f64, Found)> = None;
    for (up, turn) in axes() {
        for turned in turns(stand) {
            let posed = arms_turned(avatar, base, turned)?;
            let search = Search {
                pieces: pieces.iter().map(|p| some(p, |v| turn * v)).collect(),
                covers: pieces.iter().map(Piece::ends).collect(),
                rims: (pieces.iter().filter(|p| p.ends()))
                    .map(|p| turn * middle(&p.mesh.verts, &p.rims[0]))
                    .collect(),
                ends: ends(avatar, stand, &posed)?,
                skin: Surface::new(&posed.verts, avatar.collision_faces()),
            };
            let Some((cost, scale, shift, how)) = search.best() else {
                continue;
            };
            // Arms as they are, and Y up, need no explanation: others have to be clearly better.
            if best.as_ref().is_some_and(|b| cost > 0.85 * b.0) {
                continue;
            }
            let on = search.ends_of(scale, shift);
            let on = on.iter().zip(&search.covers).filter(|e| *e.1);
            let on: Vec<&str> = on.map(|e| search.ends[*e.0].name.as_str()).collect();
            let found = Found {
                world_from_file: DAffine3 {
                    matrix3: turn * scale,
                    translation: shift,
                },
                posed,
                turned,
                told: format!("{} ({})", told(&how, up, cost), on.join(", ")),
            };
            best = Some((cost, found));
        }
        if best.as_ref().is_some_and(|b| b.0 < FITS) {
            break;
        }
    }
    match best {
        Some((_, found)) => Ok(found),
        None => {
            let what = "it has one opening only, and neither a hand nor a foot fits into it: a hat, a bag or a \
                        cover, nothing that a body goes through";
            Err(GarmentError::Mesh { what: what.into() })
        }
    }
}

/// How far arms may be turned down for gloves [rad]: as ours are, level, and between.
fn turns(stand: &Stand) -> [f64; 3] {
    let arm = stand.limbs[0].elbow - stand.limbs[0].shoulder;
    let own = (-arm.y).atan2(arm.x.abs());
    [0.0, -own, -0.5 * own]
}

/// Some vertices of a piece.
fn some(piece: &Piece, at: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let verts = &piece.mesh.verts;
    let step = verts.len().div_ceil(LOOKS).max(1);
    verts.iter().step_by(step).map(|v| at(*v)).collect()
}

fn ends(avatar: &Avatar, stand: &Stand, posed: &Posed) -> Result<Vec<End>, GarmentError> {
    let mut out = Vec::new();
    for (s, side) in ["left", "right"].into_iter().enumerate() {
        let Limbs { wrist, ankle, .. } = stand.limbs[s];
        let all = [
            ("hand", "wrist", wrist, &HAND),
            ("foot", "foot", ankle, &FOOT),
        ];
        for (name, bone, pivot, bones) in all {
            let share = limb_share(avatar, bones, SIDES[s]);
            let own: Vec<usize> = (0..share.len().min(posed.verts.len()))
                .filter(|i| share[*i] > 0.99)
                .collect();
            let bone = avatar.bone(&format!("{bone}.{}", SIDES[s]))?;
            let step = own.len().div_ceil(TIPS).max(1);
            out.push(End {
                name: format!("{side} {name}"),
                pivot: posed.bones[bone].transform_point3(pivot),
                skin: own.iter().step_by(step).map(|i| posed.verts[*i]).collect(),
            });
        }
    }
    Ok(out)
}

/// What is searched for: upright pieces in the file's units.
struct Search {
    pieces: Vec<Vec<DVec3>>,
    /// Whether each covers a hand or a foot.
    covers: Vec<bool>,
    /// The middles of the openings of those that do.
    rims: Vec<DVec3>,
    ends: Vec<End>,
    skin: Surface,
}

impl Search {
    /// Which hand or foot each piece is nearest to.
    fn ends_of(&self, scale: f64, shift: DVec3) -> Vec<usize> {
        let mean = |all: &[DVec3]| all.iter().sum::<DVec3>() / all.len().max(1) as f64;
        let one = |piece: &Vec<DVec3>| {
            let here = mean(piece) * scale + shift;
            let far = |e: &usize| here.distance(mean(&self.ends[*e].skin));
            let near = (0..self.ends.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
            near.expect("there are hands and feet")
        };
        self.pieces.iter().map(one).collect()
    }

    /// Mean distance from the skin [m], far more for points inside, and how bare hands and feet stay.
    fn cost(&self, scale: f64, shift: DVec3) -> f64 {
        let ends = self.ends_of(scale, shift);
        let mut sum = 0.0;
        for ((piece, &end), covers) in self.pieces.iter().zip(&ends).zip(&self.covers) {
            let at: Vec<DVec3> = piece.iter().map(|p| *p * scale + shift).collect();
            let bare = |s: &DVec3| {
                let nearest = at.iter().map(|p| p.distance(*s)).fold(FAR, f64::min);
                (nearest - COVERED).max(0.0)
            };
            sum += off_skin(&self.skin, at.iter().copied(), FAR);
            if *covers {
                let skin = &self.ends[end].skin;
                sum += BARE * skin.iter().map(bare).sum::<f64>() / skin.len() as f64;
            }
        }
        let covered = ends.iter().zip(&self.covers).filter(|e| *e.1).map(|e| e.0);
        let covered: Vec<_> = covered.collect();
        let doubled = (1..covered.len()).filter(|&k| covered[..k].contains(&covered[k]));
        sum / ends.len() as f64 + SAME * doubled.count() as f64
    }

    /// Cost, scale, shift and what to call it; none if it is for no hand and no foot.
    fn best(&self) -> Option<(f64, f64, DVec3, String)> {
        let size = self.pieces.iter().map(|p| extent(p)).fold(0.0, f64::max);
        let fits = |s: f64| (SIZES.0..SIZES.1).contains(&(size * s));
        let floor = (self.skin.verts().iter().map(|v| v.y)).fold(f64::MAX, f64::min);
        let least = |all: Vec<(f64, f64, DVec3, String)>| {
            all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let units: Vec<_> = UNITS.iter().filter(|u| fits(u.0)).collect();
        let mut stands = Vec::new();
        for (s, unit) in &units {
            for (y, from) in [(0.0, "the body's middle"), (floor, "the floor")] {
                let shift = DVec3::Y * y;
                stands.push((
                    self.cost(*s, shift),
                    *s,
                    shift,
                    format!("{unit} from {from}"),
                ));
            }
        }
        let stands = least(stands);
        if stands.as_ref().is_some_and(|b| b.0 < FITS) {
            return stands;
        }
        let mut moved = Vec::new();
        for (s, unit) in &units {
            for carrier in self.carriers() {
                let (cost, shift) = self.slide(*s, carrier);
                moved.push((
                    cost,
                    *s,
                    shift,
                    format!("{unit} and moved to where it fits"),
                ));
            }
        }
        let stands = stands.filter(|b| b.0 < LOST);
        let moved = least(moved).filter(|m| m.0 < FITS);
        match (stands, moved) {
            (Some(stands), Some(moved)) if moved.0 > 0.85 * stands.0 => Some(stands),
            (stands, moved) => moved.or(stands),
        }
    }

    /// Where openings may be: at a wrist or an ankle, of several pieces in the middle between two.
    fn carriers(&self) -> Vec<DVec3> {
        let at: Vec<DVec3> = self.ends.iter().map(|e| e.pivot).collect();
        match self.rims.len() {
            1 => at,
            _ => vec![(at[0] + at[2]) / 2.0, (at[1] + at[3]) / 2.0],
        }
    }

    /// The best shift for a scale, beginning with the openings at `carrier`; several pieces stay in the middle.
    fn slide(&self, s: f64, carrier: DVec3) -> (f64, DVec3) {
        let rims = self.rims.iter().sum::<DVec3>() / self.rims.len() as f64;
        let mut at = carrier - rims * s;
        let mut cost = self.cost(s, at);
        let axes = match self.rims.len() {
            1 => &[DVec3::Y, DVec3::Z, DVec3::X][..],
            _ => &[DVec3::Y, DVec3::Z][..],
        };
        for step in STEPS {
            for _ in 0..MOVES {
                let moves = axes.iter().flat_map(|a| [at + *a * step, at - *a * step]);
                let tried = moves.map(|m| (self.cost(s, m), m));
                let least = tried.min_by(|a, b| a.0.total_cmp(&b.0));
                match least.filter(|l| l.0 < cost) {
                    Some(better) => (cost, at) = better,
                    None => break,
                }
            }
        }
        (cost, at)
    }
}
