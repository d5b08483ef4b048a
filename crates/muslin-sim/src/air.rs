//! Air around moving cloth: what every vertex's share of it pushes aside.

use glam::DVec3;
use muslin_energy::{
    AtPoint,
    air::{Panel, push},
};

use crate::{ordered, weave::Weave};

/// The air that cloth moves through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Density [kg/m³]; none at 0.
    pub density: f64,
    /// Velocity [m/s].
    pub wind: DVec3,
}

impl Air {
    /// No air at all.
    pub const NONE: Self = Self {
        density: 0.0,
        wind: DVec3::ZERO,
    };
    /// Still air, as it is in a room.
    pub const STILL: Self = Self {
        density: 1.2,
        wind: DVec3::ZERO,
    };
}

/// Drag coefficient of a wall of cloth across the wind: clothes are tubes, and a tube's 1.2 is shared
/// between its front and its back.
const DRAG: f64 = 0.6;

/// The air's part of one step.
pub(crate) struct Drag {
    panels: Vec<Panel>,
    /// Where the air takes what goes with it [m].
    carried: Vec<DVec3>,
    step: f64,
}

impl Drag {
    /// On cloth that begins a step of `step` [s] at `from` [m], counted `times`; none without air.
    pub fn new(
        weave: &Weave,
        from: &[DVec3],
        air: &Air,
        (step, times): (f64, f64),
    ) -> Option<Drag> {
        let pressure = 0.5 * air.density * DRAG * times;
        let panel = |i: usize| {
            let corners = weave.pattern.corners.row(i).iter();
            let across = corners.map(|corner| {
                let [a, b, c] = weave.corners(from, *corner as usize / 3);
                (b - a).cross(c - a)
            });
            // A sixth of the cross products: half for the triangles, a third for the vertex's share.
            let area = across.sum::<DVec3>() / 6.0;
            Panel {
                normal: area.normalize_or_zero(),
                resistance: pressure * area.length(),
            }
        };
        (pressure > 0.0).then(|| Drag {
            panels: ordered::map(from.len(), panel),
            carried: ordered::map(from.len(), |i| from[i] + air.wind * step),
            step,
        })
    }

    /// What vertex `i` at `x` [m] feels.
    pub fn at(&self, i: usize, x: DVec3) -> AtPoint {
        push(x, self.carried[i], &self.panels[i], self.step)
    }
}
