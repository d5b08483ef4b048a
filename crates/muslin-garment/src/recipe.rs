//! Recipes: what a tailor decides, and how it becomes a form and cuts.

mod dress;
mod skirt;
mod tee;
mod trousers;

pub use dress::Dress;
pub use skirt::Skirt;
pub use tee::Tee;
pub use trousers::Trousers;

use crate::GarmentError;
use crate::form::Form;
use crate::pattern::Laid;
use crate::settle::Track;
use crate::sheet::Sheet;
use crate::stand::Stand;
use glam::{DVec2, DVec3};
use muslin_geom::Surface;

/// How generously a garment is cut.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cut {
    /// Close to the body.
    Slim,
    /// As most are worn.
    #[default]
    Regular,
    /// With plenty of room.
    Loose,
}

/// What to make.
#[derive(Clone, Debug, PartialEq)]
pub enum Recipe {
    /// A crew-neck shirt.
    Tee(Tee),
    /// Trousers or shorts.
    Trousers(Trousers),
    /// A skirt.
    Skirt(Skirt),
    /// A dress with sleeves.
    Dress(Dress),
}

/// Which opening of a garment a rim is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opening {
    /// Around the neck.
    Neck,
    /// The lower edge of a shirt.
    Hem,
    /// The end of the left or right sleeve.
    Cuff(Side),
    /// Around the waist.
    Waist,
    /// The end of the left or right leg.
    LegHem(Side),
}

/// A side of the body, from its own point of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// At +X.
    Left,
    /// At −X.
    Right,
}

impl Side {
    /// The side that a point [m] is on.
    pub(crate) fn of(p: DVec3) -> Side {
        if p.x >= 0.0 { Side::Left } else { Side::Right }
    }

    pub(crate) fn index(self) -> usize {
        match self {
            Side::Left => 0,
            Side::Right => 1,
        }
    }
}

impl Recipe {
    /// The name of what is made.
    pub fn name(&self) -> &'static str {
        match self {
            Recipe::Tee(_) => "tee",
            Recipe::Trousers(_) => "trousers",
            Recipe::Skirt(_) => "skirt",
            Recipe::Dress(_) => "dress",
        }
    }

    /// Edge length aimed at [m].
    pub fn edge(&self) -> f64 {
        match self {
            Recipe::Tee(r) => r.edge,
            Recipe::Trousers(r) => r.edge,
            Recipe::Skirt(r) => r.edge,
            Recipe::Dress(r) => r.top.edge,
        }
    }

    /// Whether every figure is one that cloth can be cut to.
    pub fn check(&self) -> Result<(), GarmentError> {
        match self {
            Recipe::Tee(r) => in_range(&r.figures()),
            Recipe::Trousers(r) => in_range(&r.figures()),
            Recipe::Skirt(r) => in_range(&r.figures()),
            Recipe::Dress(r) => in_range(&r.figures()),
        }
    }

    pub(crate) fn cut(&self, stand: &Stand) -> Sheet {
        match self {
            Recipe::Tee(r) => r.cut(stand),
            Recipe::Trousers(r) => r.cut(stand),
            Recipe::Skirt(r) => r.cut(stand),
            Recipe::Dress(r) => r.cut(stand),
        }
    }

    /// What the cloth hangs on: tights, a skirt, or each where the cloth is like it.
    pub(crate) fn ground(&self, stand: &Stand) -> Surface {
        let map = stand.map;
        let waist = match self {
            Recipe::Tee(_) | Recipe::Trousers(_) => f64::MIN,
            Recipe::Skirt(_) => f64::MAX,
            Recipe::Dress(_) => stand.skirt_top(),
        };
        let above = |f: &&[u32; 3]| f.iter().all(|&i| stand.verts[i as usize].y >= waist);
        let mut faces: Vec<[u32; 3]> = map.tights.iter().filter(above).copied().collect();
        if waist > f64::MIN {
            faces.extend(&map.skirt);
        }
        Surface::new(stand.verts, &faces)
    }

    /// Measures a body; `tuck` is the height [m] of a waistband that a shirt is tucked into.
    pub(crate) fn plan<'a>(&self, stand: &'a Stand<'a>, tuck: Option<f64>) -> Plan<'a> {
        match self {
            Recipe::Tee(r) => Plan::Tee(tee::Plan::new(r, stand, tuck)),
            Recipe::Trousers(r) => Plan::Trousers(trousers::Plan::new(r, stand)),
            Recipe::Skirt(r) => Plan::Skirt(skirt::Plan::new(r, stand)),
            Recipe::Dress(r) => Plan::Tee(r.plan(stand)),
        }
    }

    /// What opening a rim is, of all the rims' middles [m].
    pub(crate) fn opening(&self, middles: &[DVec3], rim: usize) -> Opening {
        let m = middles[rim];
        let others = || {
            middles
                .iter()
                .enumerate()
                .filter(|(i, _)| *i != rim)
                .map(|(_, p)| p)
        };
        let highest = others().all(|p| p.y < m.y);
        let lowest = others().all(|p| p.y > m.y);
        match self {
            Recipe::Tee(_) | Recipe::Dress(_) if highest => Opening::Neck,
            Recipe::Tee(_) | Recipe::Dress(_) if lowest => Opening::Hem,
            Recipe::Tee(_) | Recipe::Dress(_) => Opening::Cuff(Side::of(m)),
            Recipe::Trousers(_) | Recipe::Skirt(_) if highest => Opening::Waist,
            Recipe::Trousers(_) => Opening::LegHem(Side::of(m)),
            Recipe::Skirt(_) => Opening::Hem,
        }
    }

    /// The panels' names, in the order of their numbers.
    pub fn panels(&self) -> &'static [&'static str] {
        match self {
            Recipe::Tee(_) | Recipe::Dress(_) => &["front", "back", "left sleeve", "right sleeve"],
            Recipe::Skirt(_) => &["front", "back"],
            Recipe::Trousers(_) => &["front left", "front right", "back left", "back right"],
        }
    }
}

/// A recipe on one body.
pub(crate) enum Plan<'a> {
    Tee(tee::Plan<'a>),
    Trousers(trousers::Plan<'a>),
    Skirt(skirt::Plan<'a>),
}

impl Plan<'_> {
    /// What it is cut on.
    pub fn form(&self) -> Form<'_> {
        match self {
            Plan::Tee(p) => p.form(),
            Plan::Trousers(p) => p.form(),
            Plan::Skirt(p) => p.form(),
        }
    }

    /// Betters a first guess of where the vertices are [m], from how far left they are on the default body
    /// [m].
    pub fn prepare(&self, form: &Form, x: &mut [DVec3], left: &[f64]) {
        if let Plan::Trousers(p) = self {
            p.prepare(form, x, left);
        }
    }

    /// How a rim through these places [m] stays flat.
    pub fn track(&self, opening: Opening, rim: &[DVec3]) -> Track {
        let middle = rim.iter().sum::<DVec3>() / rim.len() as f64;
        match (self, opening) {
            (_, Opening::Neck) => Track::Free,
            (Plan::Tee(p), Opening::Cuff(side)) => {
                let (point, across) = p.cuff(side);
                Track::Plane(point, across)
            }
            _ => Track::Plane(middle, DVec3::Y),
        }
    }

    /// Where a face with these corners [m] and this share of arm bones goes on the pattern.
    pub fn lay(&self, corners: [DVec3; 3], arm: [f64; 2]) -> Laid {
        match self {
            Plan::Tee(p) => p.lay(corners, arm),
            Plan::Trousers(p) => p.lay(corners),
            Plan::Skirt(p) => p.lay(corners),
        }
    }
}

/// A figure of a recipe: what it is, its value, the least and the most allowed.
pub(crate) type FigureRange = (&'static str, f64, f64, f64);

fn in_range(figures: &[FigureRange]) -> Result<(), GarmentError> {
    match figures
        .iter()
        .find(|(_, value, low, high)| !(*low..=*high).contains(value))
    {
        None => Ok(()),
        Some(&(what, value, low, high)) => Err(GarmentError::OutOfRange {
            what,
            value,
            low,
            high,
        }),
    }
}

/// How far vertices stay off the skin [m] so that triangles with edges of `edge` [m] do, too:
/// they cut the corner where the skin is round.
fn off_skin(edge: f64) -> f64 {
    0.0035 + 4.0 * edge * edge
}

/// Lays a point by its shadow on the frontal plane, with the sides folded out.
///
/// `middle`: x and z of the panel's middle line [m]; `unfold`: 1 where the sides go back steeply.
pub(crate) fn shadow(p: DVec3, middle: DVec2, unfold: f64) -> DVec2 {
    let x = p.x - middle.x;
    let depth = 0.5 * unfold * (0.16 - (p.z - middle.y).abs()).max(0.0);
    let edge = (x / 0.04).clamp(-1.0, 1.0);
    DVec2::new(p.x + edge * depth, p.y)
}

/// 0 below `from`, 1 above `to`, smooth between.
pub(crate) fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
