//! What the suites of bending share.

use muslin_energy::hinge::Bend;

pub const DENIM: Bend = Bend {
    warp: 6e-5,
    weft: 4e-5,
};
