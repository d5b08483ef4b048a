//! The turn that fits one cloud of points to another best.

use glam::{DMat4, DQuat, DVec3, DVec4};

/// The rotation that takes `from` (about its middle) as near to `to` as can be, in least squares.
///
/// Horn 1987: the largest eigenvector of a symmetric 4×4 matrix, by squaring; from `guess` where
/// several turns fit alike.
pub fn best_turn(from: (&[DVec3], DVec3), to: (&[DVec3], DVec3), guess: DQuat) -> DQuat {
    let mut s = [[0.0; 3]; 3];
    for (a, b) in from.0.iter().zip(to.0) {
        let (a, b) = ((*a - from.1).to_array(), (*b - to.1).to_array());
        for i in 0..3 {
            for j in 0..3 {
                s[i][j] += a[i] * b[j];
            }
        }
    }
    turn_of(s, guess)
}

/// The same from the sum of all `a_i b_j`, `a` the points to be turned and `b` those that they are turned
/// to, each about its middle.
pub fn turn_of(s: [[f64; 3]; 3], guess: DQuat) -> DQuat {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
    // In the order x, y, z, w.
    let n = DMat4::from_cols(
        DVec4::new(xx - yy - zz, xy + yx, zx + xz, yz - zy),
        DVec4::new(xy + yx, yy - xx - zz, yz + zy, zx - xz),
        DVec4::new(zx + xz, yz + zy, zz - xx - yy, xy - yx),
        DVec4::new(yz - zy, zx - xz, xy - yx, xx + yy + zz),
    );
    let size: f64 = n.to_cols_array().iter().map(|c| c * c).sum::<f64>().sqrt();
    if size == 0.0 || !size.is_finite() {
        return guess;
    }
    // Shifted so that the largest eigenvalue is also the largest in size.
    let mut m = n * (1.0 / size) + DMat4::IDENTITY;
    for _ in 0..24 {
        m = m * m;
        let largest = m.to_cols_array().iter().fold(0.0f64, |a, c| a.max(c.abs()));
        m *= 1.0 / largest;
    }
    let q = m * DVec4::from(guess);
    q.try_normalize().map_or(guess, DQuat::from_vec4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_cloud_is_turned_back() {
        let cloud: Vec<DVec3> = (0..40)
            .map(f64::from)
            .map(|t| DVec3::new((1.3 * t).sin(), 0.5 * (2.1 * t).cos(), 0.2 * t.sin()))
            .collect();
        for angle in [0.0, 0.4, 2.0, 3.1] {
            let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), angle);
            let middle = DVec3::new(1.0, 2.0, 3.0);
            let moved: Vec<DVec3> = cloud.iter().map(|x| middle + turn * *x).collect();
            let found = best_turn((&cloud, DVec3::ZERO), (&moved, middle), DQuat::IDENTITY);
            assert!(
                found.dot(turn).abs() > 1.0 - 1e-9,
                "{angle}: {found} {turn}"
            );
        }
    }
}
