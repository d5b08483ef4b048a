//! Cloth as arrays: what is cut, from what, and what holds it.

use glam::{DVec2, DVec3};
use muslin_energy::{hinge::Bend, membrane::Stretch};

/// What a piece of cloth is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Mass per area [kg/m²].
    pub density: f64,
    /// Resistance in its plane [N/m].
    pub stretch: Stretch,
    /// Resistance to folding [N m].
    pub bend: Bend,
    /// Largest strain its yarns allow (0.06 is 6 %), if that is known.
    pub limit: Option<f64>,
    /// Coulomb's coefficient, against the body and against cloth.
    pub friction: f64,
    /// Thickness [m].
    pub thickness: f64,
}

/// Cloth to be draped: one garment or several, in one numbering.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloth {
    /// Corner indices, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Rest shape of every face: material coordinates of its corners [m], x weft, y warp.
    pub rest: Vec<[DVec2; 3]>,
    /// What there is to be made of.
    pub materials: Vec<Material>,
    /// For every face, its entry of `materials`.
    pub material_of: Vec<u32>,
    /// For every vertex, its layer: 0 next to the skin; higher ones are worn over lower ones.
    pub layers: Vec<u32>,
    /// Vertices that stay where they start relative to the nearest skin, as at a waistband.
    pub pins: Vec<u32>,
}

/// Why a drape could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// Arrays that must belong together do not.
    #[error("{what} has {got} entries, expected {want}")]
    Length {
        /// The array.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that fits the rest.
        want: usize,
    },
    /// An index points at nothing.
    #[error("{what} {index} of {owner} {at} does not exist; there are {count}")]
    Index {
        /// What is pointed at.
        what: &'static str,
        /// The index.
        index: u32,
        /// Who points.
        owner: &'static str,
        /// Which of them.
        at: usize,
        /// How many there are.
        count: usize,
    },
    /// A face without a rest shape to return to.
    #[error("face {0} has no rest shape: its material corners lie on a line or are not finite")]
    NoRestShape(usize),
    /// A coordinate is not a number.
    #[error("{what} {at} is not finite")]
    NotFinite {
        /// What it is.
        what: &'static str,
        /// Which one.
        at: usize,
    },
    /// A path without frames.
    #[error("the body's path has no frame")]
    EmptyPath,
    /// The caller asked to stop.
    #[error("stopped")]
    Stopped,
    /// The body tears the cloth apart on its way: by how much one face in a hundred stretches beyond its limit.
    #[error("the cloth is too tight: on the body's way a hundredth of it stretches {:.0} % beyond its limit", .0 * 100.0)]
    TooTight(f64),
    /// Even the shortest steps gave no finite result.
    #[error("the solver found no finite step at step {0}; check densities and stiffnesses")]
    Diverged(usize),
}

impl Cloth {
    /// Number of vertices.
    pub fn n_verts(&self) -> usize {
        self.layers.len()
    }

    /// Thickness of two layers of each garment [m].
    pub(crate) fn thickness_of_all(&self) -> f64 {
        let layers = self.layers.iter().max().map_or(0, |l| l + 1);
        let thick = self.materials.iter().map(|m| m.thickness);
        2.0 * f64::from(layers) * thick.fold(0.0, f64::max)
    }

    /// Whether all arrays fit each other.
    pub fn check(&self) -> Result<(), SimError> {
        let (n, m) = (self.n_verts(), self.faces.len());
        same("rest", self.rest.len(), m)?;
        same("material_of", self.material_of.len(), m)?;
        for (at, f) in self.faces.iter().enumerate() {
            for &index in f {
                below("vertex", index, n, ("face", at))?;
            }
        }
        for (at, &index) in self.material_of.iter().enumerate() {
            below("material", index, self.materials.len(), ("face", at))?;
        }
        for (at, &index) in self.pins.iter().enumerate() {
            below("vertex", index, n, ("pin", at))?;
        }
        Ok(())
    }
}

pub(crate) fn same(what: &'static str, got: usize, want: usize) -> Result<(), SimError> {
    if got == want {
        Ok(())
    } else {
        Err(SimError::Length { what, got, want })
    }
}

fn below(
    what: &'static str,
    index: u32,
    count: usize,
    (owner, at): (&'static str, usize),
) -> Result<(), SimError> {
    if (index as usize) < count {
        return Ok(());
    }
    Err(SimError::Index {
        what,
        index,
        owner,
        at,
        count,
    })
}

pub(crate) fn finite(what: &'static str, points: &[DVec3]) -> Result<(), SimError> {
    match points.iter().position(|p| !p.is_finite()) {
        Some(at) => Err(SimError::NotFinite { what, at }),
        None => Ok(()),
    }
}
