//! One line a frame: what changes over time.

use super::{frame::Frame, most};

/// A figure of a frame; not a number where it is not known.
type Figure = fn(&Frame) -> f64;

/// The columns after frame and time.
const COLUMNS: [(&str, Figure); 14] = [
    ("strain_J", |f| f.strain),
    ("bend_J", |f| f.bend),
    ("gravity_J", |f| f.gravity),
    ("inertia_J", |f| f.inertia.unwrap_or(f64::NAN)),
    ("total_J", Frame::total),
    ("residual_force_per_weight", |f| f.residual),
    ("edge_max", |f| most(wide(&f.edges))),
    ("principal_max", |f| most(wide(&f.large))),
    ("vertices_inside", |f| f.contact.depths.len() as f64),
    ("depth_max_mm", |f| {
        1000.0 * most(wide(&f.contact.depths)).max(0.0)
    }),
    ("body_intersections", |f| f.contact.pairs as f64),
    ("edge_triangle_crossings", |f| f.crossings as f64),
    ("acceleration_m_s2", |f| f.acceleration.unwrap_or(f64::NAN)),
    ("jerk_m_s3", |f| f.jerk.unwrap_or(f64::NAN)),
];

fn wide(values: &[f32]) -> impl Iterator<Item = f64> {
    values.iter().map(|x| f64::from(*x))
}

/// The frames as CSV, `fps` of them a second; an empty field where a figure is not known.
pub fn csv(frames: &[Frame], fps: f64) -> String {
    let mut out = String::from("frame,time_s");
    COLUMNS.iter().for_each(|c| out += &format!(",{}", c.0));
    out.push('\n');
    for f in frames {
        out += &format!("{},{}", f.t, f.t as f64 / fps);
        for (_, of) in COLUMNS {
            out.push(',');
            let x = of(f);
            if x.is_finite() {
                out += &x.to_string();
            }
        }
        out.push('\n');
    }
    out
}
