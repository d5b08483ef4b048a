//! What the suites of bending share: a fabric, how many states, and how tall a random triangle is.

use muslin_energy::check::{Rng, Scale};
use muslin_energy::hinge::Bend;

pub const STATES: usize = 1200;
pub const DENIM: Bend = Bend {
    warp: 6e-5,
    weft: 4e-5,
};
/// Below a picojoule and a nanonewton nothing happens to a patch of 12 mm.
pub const NOTHING: Scale = Scale {
    energy: 1e-12,
    force: 1e-9,
};

/// Height of a triangle over an edge of one; one in seven is a sliver's.
pub fn tall(rng: &mut Rng) -> f64 {
    if rng.between(0.0, 1.0) < 0.15 {
        rng.scale(2e-3, 0.1)
    } else {
        rng.between(0.4, 1.2)
    }
}
