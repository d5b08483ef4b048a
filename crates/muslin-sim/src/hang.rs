//! Cloth that hangs at rest on a still body, and how it resists being moved from there.

use glam::{DMat3, DVec3};
use muslin_geom::Surface;

use crate::{
    cloth::{Cloth, SimError},
    drape::{Options, drape},
    relief::Frame,
    stage::Stage,
    weave::Weave,
};

/// Cloth at rest, its masses, and the Hessian of everything but inertia there.
///
/// Tension counts (it is what makes a skirt a pendulum), as do the skin that cloth is pressed on, the
/// friction that holds it there and the pins; cloth against cloth does not. Like every Hessian of the
/// laws it is nowhere indefinite.
#[derive(Clone, Debug, Default)]
pub struct Hanging {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// Mass of every vertex [kg].
    pub mass: Vec<f64>,
    /// Where the blocks of every vertex start, and the end of the last.
    pub starts: Vec<u32>,
    /// The vertex that each block couples it with, in ascending order.
    pub cols: Vec<u32>,
    /// Blocks of the Hessian [N/m].
    pub blocks: Vec<DMat3>,
}

/// Lets `cloth` come to rest from `start` [m] on a still body, and asks how it resists.
pub fn hang(
    cloth: &Cloth,
    start: &[DVec3],
    (body, faces): (&Frame, &[[u32; 3]]),
    options: &Options,
) -> Result<Hanging, SimError> {
    let settled = drape(cloth, start, (std::slice::from_ref(body), faces), options)?;
    let weave = Weave::new(cloth)?;
    let skin = Surface::new(&settled.body, faces);
    let mut stage = Stage::new(&weave, &settled.verts, skin, cloth, *options);
    let (starts, cols, blocks) = stage.resistance();
    Ok(Hanging {
        verts: settled.verts,
        mass: weave.mass.clone(),
        starts,
        cols,
        blocks,
    })
}
