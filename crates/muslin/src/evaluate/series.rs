//! One line a frame: what changes over time.

use super::frame::Frame;

/// A figure of a frame; none where it is not known.
type Figure = fn(&Frame) -> Option<f64>;

/// The columns after frame and time.
const COLUMNS: [(&str, Figure); 14] = [
    ("strain_J", |f| Some(f.strain)),
    ("bend_J", |f| Some(f.bend)),
    ("gravity_J", |f| Some(f.gravity)),
    ("inertia_J", |f| f.inertia),
    ("total_J", |f| Some(f.total())),
    ("residual_force_per_weight", |f| Some(f.residual)),
    ("edge_max", |f| most(&f.edges, 1.0)),
    ("principal_max", |f| most(&f.large, 1.0)),
    ("vertices_inside", |f| Some(f.contact.depths.len() as f64)),
    ("depth_max_mm", |f| {
        Some(most(&f.contact.depths, 1000.0).unwrap_or(0.0))
    }),
    ("body_intersections", |f| Some(f.contact.pairs as f64)),
    ("edge_triangle_crossings", |f| Some(f.crossings as f64)),
    ("acceleration_m_s2", |f| f.acceleration),
    ("jerk_m_s3", |f| f.jerk),
];

/// The largest, times `unit`.
fn most(values: &[f32], unit: f64) -> Option<f64> {
    let most = values.iter().copied().reduce(f32::max);
    most.map(|m| unit * f64::from(m))
}

/// The frames as CSV, `fps` of them a second; an empty field where a figure is not known.
pub fn csv(frames: &[Frame], fps: f64) -> String {
    let mut out = String::from("frame,time_s");
    COLUMNS.iter().for_each(|c| out += &format!(",{}", c.0));
    out.push('\n');
    for f in frames {
        out += &format!("{},{}", f.t, f.t as f64 / fps);
        for (_, of) in COLUMNS {
            match of(f).filter(|x| x.is_finite()) {
                Some(x) => out += &format!(",{x}"),
                None => out.push(','),
            }
        }
        out.push('\n');
    }
    out
}
