//! Air: what it costs a piece of cloth to push it aside.

use glam::DVec3;

use crate::{AtPoint, outer};

/// A flat piece of cloth in the air, as it lay when the step began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// Unit normal; which side does not matter.
    pub normal: DVec3,
    /// `½ ρ C A` [N s²/m²]: density of the air (1.2 kg/m³), drag coefficient of a plate across
    /// the wind (about 1.2), area [m²].
    pub resistance: f64,
}

/// Drag of a panel over one step: `E = c |s|³ / (3 h²)`, `s = n · (x − carried)`.
///
/// `x`: the panel's middle [m]; `carried`: where the air would have taken it, `x_before +
/// h v_air` [m]; `step`: h > 0 [s]. The force is `−c |w| w n` for the speed `w = s/h` at which
/// the panel meets the air: pressure grows with the square of the speed, and air that slips along
/// the panel takes nothing. Curvature `2 c |w| / h` along the normal, exact and never negative.
/// A panel that goes with the air, or that has no area, feels nothing.
///
/// Newton's law of resistance, normal part alone; normal and area are those at the start of the
/// step, as in lagged friction, which leaves the energy convex.
#[inline]
pub fn push(x: DVec3, carried: DVec3, on: &Panel, step: f64) -> AtPoint {
    let speed = on.normal.dot(x - carried) / step;
    let force = on.resistance * speed.abs() * speed;
    AtPoint {
        energy: force * speed * step / 3.0,
        gradient: on.normal * force,
        hessian: outer(
            on.normal * (2.0 * on.resistance * speed.abs() / step),
            on.normal,
        ),
    }
}
