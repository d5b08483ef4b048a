//! What joints like: where they rest, how far they turn, about which axes.
//!
//! A joint's rotation is read as a rotation vector in its own axes: flexion, side, twist. The
//! ranges are the degrees-of-freedom limits that CMU's `.asf` skeletons carry (knee and elbow
//! −10 to 170°, hip −160 to 20°, upper arm −60 to 90° and ±90°, spine and neck −20 to 45° and
//! ±30°), moved to our rest pose and tightened to what relaxed people do. The spreads are set by
//! hand: wide where a joint is seen well, narrow where a picture says little (wrist, twist).

use glam::{DMat3, DQuat, DVec3};

/// Preferences of one joint, in its axes. Radians; a bone's share where several share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Habit {
    /// Columns: flexion, side and twist axis, in the rest pose.
    pub axes: DMat3,
    /// Where it rests.
    pub mean: DVec3,
    /// How far it likes to stray: one standard deviation.
    pub spread: DVec3,
    /// Least and greatest turn.
    pub range: [DVec3; 2],
}

/// Degrees: mean, spread, least, greatest for flexion, side, twist.
struct Row(&'static str, [f64; 3], [f64; 3], [f64; 3], [f64; 3]);

const ROWS: [Row; 11] = [
    Row(
        "waist",
        [0.0; 3],
        [7.0, 4.0, 4.0],
        [-8.0, -9.0, -9.0],
        [22.0, 9.0, 9.0],
    ),
    Row(
        "chest",
        [0.0; 3],
        [4.0, 3.0, 4.0],
        [-7.0, -8.0, -9.0],
        [12.0, 8.0, 9.0],
    ),
    Row(
        "neck",
        [0.0; 3],
        [5.0, 4.0, 8.0],
        [-16.0, -11.0, -18.0],
        [16.0, 11.0, 18.0],
    ),
    Row(
        "head",
        [0.0; 3],
        [8.0, 6.0, 12.0],
        [-25.0, -14.0, -25.0],
        [25.0, 14.0, 25.0],
    ),
    Row(
        "collar",
        [0.0; 3],
        [5.0, 5.0, 2.0],
        [-12.0, -12.0, -5.0],
        [18.0, 14.0, 5.0],
    ),
    Row(
        "shoulder",
        [0.0, -20.0, 0.0],
        [50.0, 45.0, 35.0],
        [-70.0, -75.0, -95.0],
        [150.0, 140.0, 95.0],
    ),
    Row(
        "elbow",
        [15.0, 0.0, 0.0],
        [50.0, 3.0, 35.0],
        [-5.0, -8.0, -80.0],
        [145.0, 8.0, 80.0],
    ),
    Row(
        "wrist",
        [0.0; 3],
        [15.0, 8.0, 6.0],
        [-65.0, -25.0, -15.0],
        [65.0, 25.0, 15.0],
    ),
    Row(
        "hip",
        [-3.0, 0.0, 0.0],
        [32.0, 15.0, 14.0],
        [-130.0, -30.0, -45.0],
        [28.0, 60.0, 45.0],
    ),
    Row(
        "knee",
        [4.0, 0.0, 0.0],
        [32.0, 2.5, 5.0],
        [-3.0, -6.0, -15.0],
        [150.0, 6.0, 15.0],
    ),
    Row(
        "ankle",
        [0.0; 3],
        [10.0, 8.0, 7.0],
        [-35.0, -25.0, -20.0],
        [50.0, 25.0, 20.0],
    ),
];

impl Habit {
    /// The habit of the joint group `name`; `along` is where its bone points at rest.
    ///
    /// None for the root, which may be anywhere.
    pub fn of(name: &str, along: DVec3) -> Option<Habit> {
        let (base, right) = match name.strip_suffix(".R") {
            Some(base) => (base, true),
            None => (name.strip_suffix(".L").unwrap_or(name), false),
        };
        let row = ROWS.iter().find(|r| r.0 == base)?;
        let mirror = DVec3::new(-1.0, 1.0, 1.0);
        let axes = left_axes(base, if right { along * mirror } else { along });
        // A mirror turns rotation vectors about: they keep what they lose as points.
        let axes = if right {
            DMat3::from_diagonal(-mirror) * axes
        } else {
            axes
        };
        let degrees = |d: [f64; 3]| DVec3::from(d.map(f64::to_radians));
        Some(Habit {
            axes,
            mean: degrees(row.1),
            spread: degrees(row.2),
            range: [degrees(row.3), degrees(row.4)],
        })
    }

    /// The axis that flexes the joint forward (knee: backward), in the rest pose.
    pub fn hinge(&self) -> DVec3 {
        self.axes.x_axis
    }

    /// The rotation vector of `rotation` in the joint's axes.
    pub fn read(&self, rotation: DQuat) -> DVec3 {
        self.axes.transpose() * rotation_vector(rotation)
    }
}

/// Axes of a joint on the left side; the body faces +z, its left is +x.
fn left_axes(base: &str, along: DVec3) -> DMat3 {
    let twist = along.normalize_or(DVec3::Y);
    // Bending brings the bone from where it points toward `to`.
    let to = match base {
        "shoulder" | "elbow" | "wrist" | "collar" | "waist" | "chest" | "neck" | "head" => DVec3::Z,
        "ankle" => DVec3::NEG_Y,
        _ => DVec3::NEG_Z,
    };
    let flexion = twist.cross(to).normalize_or(DVec3::X);
    let side = match base {
        // Raises the arm, spreads the leg.
        "shoulder" | "elbow" | "wrist" | "collar" => flexion.cross(twist),
        _ => twist.cross(flexion),
    };
    DMat3::from_cols(flexion, side, twist)
}

/// The rotation vector (axis times angle, angle at most π) of a unit quaternion.
pub fn rotation_vector(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let v = DVec3::new(q.x, q.y, q.z);
    let sin = v.length();
    if sin < 1e-12 {
        2.0 * v
    } else {
        v * (2.0 * sin.atan2(q.w) / sin)
    }
}

/// `∂ rotation_vector(q · exp δ) / ∂δ` at δ = 0, where `phi` is the rotation vector of `q`.
///
/// The inverse right Jacobian of SO(3); at half a turn it has no value and grows without bound.
pub fn log_slope(phi: DVec3) -> DMat3 {
    let angle = phi.length();
    let cross = skew(phi);
    let k = if angle < 1e-4 {
        1.0 / 12.0 + angle * angle / 720.0
    } else {
        let half = 0.5 * angle;
        (1.0 - half / half.tan()) / (angle * angle)
    };
    DMat3::IDENTITY + cross * 0.5 + cross * cross * k
}

/// The matrix of `v × `.
pub fn skew(v: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, v.z, -v.y),
        DVec3::new(-v.z, 0.0, v.x),
        DVec3::new(v.y, -v.x, 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_slope_is_what_finite_differences_say() {
        for phi in [
            DVec3::ZERO,
            DVec3::new(1e-5, 0.0, 0.0),
            DVec3::new(0.3, -1.2, 0.7),
            DVec3::new(2.0, 1.0, -1.5),
        ] {
            let q = DQuat::from_scaled_axis(phi);
            let slope = log_slope(phi);
            for k in 0..3 {
                let step =
                    |h: f64| rotation_vector(q * DQuat::from_scaled_axis(DVec3::AXES[k] * h));
                let fd = (step(1e-6) - step(-1e-6)) / 2e-6;
                assert!(
                    fd.distance(slope.col(k)) < 1e-7,
                    "{phi} {k}: {fd} {}",
                    slope.col(k)
                );
            }
        }
    }

    #[test]
    fn limbs_bend_the_way_limbs_bend() {
        let arm = DVec3::new(0.7, -0.7, 0.0);
        let turned = |name: &str, along: DVec3, axis: usize| {
            let habit = Habit::of(name, along).expect("a joint");
            DQuat::from_axis_angle(habit.axes.col(axis), 0.5) * along
        };
        let mirror = DVec3::new(-1.0, 1.0, 1.0);
        assert!(turned("elbow.L", arm, 0).z > 0.1 && turned("elbow.R", arm * mirror, 0).z > 0.1);
        assert!(
            turned("shoulder.L", arm, 1).y > -0.5 && turned("shoulder.R", arm * mirror, 1).y > -0.5
        );
        for side in ["L", "R"] {
            assert!(turned(&format!("knee.{side}"), DVec3::NEG_Y, 0).z < -0.1);
            assert!(turned(&format!("ankle.{side}"), DVec3::Z, 0).y < -0.1);
        }
        let spread = |side: &str| turned(&format!("hip.{side}"), DVec3::NEG_Y, 1).x;
        assert!(
            spread("L") > 0.1 && spread("R") < -0.1,
            "{} {}",
            spread("L"),
            spread("R")
        );
        assert!(turned("waist", DVec3::Y, 0).z > 0.1);
    }
}
