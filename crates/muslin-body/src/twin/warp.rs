//! A smooth map of space that takes some points exactly where they belong.
//!
//! Radial basis functions `|r|` (biharmonic in space) and an affine part:
//! `x ↦ A x + b + Σ w_k |x − p_k|`, with the weights orthogonal to affine maps.

use glam::DVec3;

pub(crate) struct Warp {
    centres: Vec<DVec3>,
    weights: Vec<DVec3>,
    /// Rows for 1, x, y, z.
    affine: [DVec3; 4],
}

impl Warp {
    /// The map with `from[k] ↦ to[k]`; none where the points lie in a plane or coincide.
    pub fn new(from: &[DVec3], to: &[DVec3]) -> Option<Warp> {
        let n = from.len();
        let size = n + 4;
        let affine = |p: DVec3| [1.0, p.x, p.y, p.z];
        // A system with three right sides, rows one after the other.
        let width = size + 3;
        let mut a = vec![0.0; size * width];
        for i in 0..n {
            for j in 0..n {
                a[i * width + j] = from[i].distance(from[j]);
            }
            for (k, c) in affine(from[i]).into_iter().enumerate() {
                a[i * width + n + k] = c;
                a[(n + k) * width + i] = c;
            }
            a[i * width + size..][..3].copy_from_slice(&to[i].to_array());
        }
        eliminate(&mut a, size, width)?;
        let row = |i: usize| DVec3::from_slice(&a[i * width + size..]);
        Some(Warp {
            centres: from.to_vec(),
            weights: (0..n).map(row).collect(),
            affine: std::array::from_fn(|k| row(n + k)),
        })
    }

    pub fn at(&self, p: DVec3) -> DVec3 {
        let [b, x, y, z] = self.affine;
        let bent = self.centres.iter().zip(&self.weights);
        let bent: DVec3 = bent.map(|(c, w)| *w * p.distance(*c)).sum();
        b + x * p.x + y * p.y + z * p.z + bent
    }
}

/// Solves in place by elimination with row exchange; none if the system is singular.
fn eliminate(a: &mut [f64], n: usize, width: usize) -> Option<()> {
    for k in 0..n {
        let best =
            (k..n).max_by(|&i, &j| a[i * width + k].abs().total_cmp(&a[j * width + k].abs()))?;
        let pivot = a[best * width + k];
        if pivot.abs() < 1e-9 {
            return None;
        }
        for c in 0..width {
            a.swap(k * width + c, best * width + c);
            a[k * width + c] /= pivot;
        }
        for i in (0..n).filter(|&i| i != k) {
            let f = a[i * width + k];
            if f != 0.0 {
                for c in k..width {
                    a[i * width + c] -= f * a[k * width + c];
                }
            }
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_land_where_they_belong_and_an_affine_map_is_kept_everywhere() {
        let from: Vec<DVec3> = (0..9)
            .map(|k| {
                let t = f64::from(k);
                DVec3::new((1.3 * t).sin(), 0.2 * t, (0.7 * t).cos() * t)
            })
            .collect();
        let turned = |p: DVec3| DVec3::new(0.5 - p.z, 2.0 * p.y, p.x + 0.1 * p.y);
        let to: Vec<DVec3> = from.iter().map(|p| turned(*p)).collect();
        let warp = Warp::new(&from, &to).expect("points in space");
        let away = DVec3::new(3.0, -1.0, 2.0);
        assert!(warp.at(away).distance(turned(away)) < 1e-9);
        let mut bent = to.clone();
        bent[4] += DVec3::new(0.1, 0.2, -0.3);
        let warp = Warp::new(&from, &bent).expect("points in space");
        for (p, q) in from.iter().zip(&bent) {
            assert!(warp.at(*p).distance(*q) < 1e-9);
        }
        assert!(
            Warp::new(&from[..3], &to[..3]).is_none(),
            "three points lie in a plane"
        );
    }
}
