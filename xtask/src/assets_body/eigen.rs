//! Eigenvalues and eigenvectors of a symmetric matrix (Jacobi's cyclic rotations).

/// Eigenvalues from the largest down, and their unit vectors.
pub struct Eigen {
    pub values: Vec<f64>,
    vectors: Vec<f64>,
}

/// Decomposes the symmetric `n` × `n` matrix `a`.
pub fn symmetric(mut a: Vec<f64>, n: usize) -> Eigen {
    let mut v = vec![0.0; n * n];
    (0..n).for_each(|i| v[i * n + i] = 1.0);
    let scale: f64 = a.iter().map(|x| x * x).sum();
    for _ in 0..60 {
        let off: f64 = (0..n * n)
            .filter(|k| k / n != k % n)
            .map(|k| a[k] * a[k])
            .sum();
        if off <= 1e-28 * scale {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(&mut a, &mut v, n, (p, q));
            }
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[j * n + j].total_cmp(&a[i * n + i]));
    let values = order.iter().map(|&i| a[i * n + i]).collect();
    let vectors = order
        .iter()
        .flat_map(|&i| v[i * n..(i + 1) * n].to_vec())
        .collect();
    Eigen { values, vectors }
}

/// Makes `a[p][q]` zero by a rotation of rows and columns `p` and `q`; the rows of `v` follow.
fn rotate(a: &mut [f64], v: &mut [f64], n: usize, (p, q): (usize, usize)) {
    let apq = a[p * n + q];
    if apq == 0.0 {
        return;
    }
    let theta = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..n {
        let (x, y) = (a[k * n + p], a[k * n + q]);
        a[k * n + p] = c * x - s * y;
        a[k * n + q] = s * x + c * y;
    }
    for m in [a, v] {
        for k in 0..n {
            let (x, y) = (m[p * n + k], m[q * n + k]);
            m[p * n + k] = c * x - s * y;
            m[q * n + k] = s * x + c * y;
        }
    }
}

impl Eigen {
    /// The unit vector of the `m`-th value.
    pub fn vector(&self, m: usize) -> &[f64] {
        let n = self.values.len();
        &self.vectors[m * n..(m + 1) * n]
    }

    /// The symmetric square root; eigenvalues below zero are rounding and count as zero.
    pub fn root(&self) -> Vec<f64> {
        let n = self.values.len();
        let mut out = vec![0.0; n * n];
        for m in 0..n {
            let (v, r) = (self.vector(m), self.values[m].max(0.0).sqrt());
            for i in 0..n {
                for j in 0..n {
                    out[i * n + j] += r * v[i] * v[j];
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_squares_to_the_matrix() {
        let a = vec![4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0];
        let found = symmetric(a.clone(), 3);
        assert!(found.values.windows(2).all(|w| w[0] >= w[1]));
        let r = found.root();
        for i in 0..3 {
            for j in 0..3 {
                let square: f64 = (0..3).map(|k| r[i * 3 + k] * r[k * 3 + j]).sum();
                assert!((square - a[i * 3 + j]).abs() < 1e-12);
            }
        }
    }
}
