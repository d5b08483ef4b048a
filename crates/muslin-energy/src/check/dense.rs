//! Small symmetric matrices as rows, and their eigenvalues.

use glam::DMat3;

/// Eigenvalues and vectors of a symmetric matrix.
#[derive(Clone, Debug)]
pub struct Eigen {
    /// Eigenvalues, in no order.
    pub values: Vec<f64>,
    /// `vectors[i][k]`: component `i` of the unit eigenvector of `values[k]`.
    pub vectors: Vec<Vec<f64>>,
}

impl Eigen {
    /// The matrix again, its negative eigenvalues set to zero.
    pub fn without_negative(&self) -> Vec<Vec<f64>> {
        let n = self.values.len();
        let entry = |i: usize, j: usize| {
            (0..n)
                .map(|k| self.values[k].max(0.0) * self.vectors[i][k] * self.vectors[j][k])
                .sum()
        };
        (0..n)
            .map(|i| (0..n).map(|j| entry(i, j)).collect())
            .collect()
    }
}

/// Jacobi's method on the symmetric part of a square matrix, until nothing is off the diagonal.
pub fn eigen(matrix: &[Vec<f64>]) -> Eigen {
    let n = matrix.len();
    let mut a: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            (0..n)
                .map(|j| 0.5 * (matrix[i][j] + matrix[j][i]))
                .collect()
        })
        .collect();
    let mut v: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect())
        .collect();
    let total: f64 = a.iter().flatten().map(|x| x * x).sum();
    for _ in 0..60 {
        let off: f64 = (0..n)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| a[i][j] * a[i][j])
            .sum();
        if off <= 1e-32 * total {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(&mut a, &mut v, [p, q]);
            }
        }
    }
    Eigen {
        values: (0..n).map(|i| a[i][i]).collect(),
        vectors: v,
    }
}

/// Turns in the plane of two axes so that their common entry vanishes.
fn rotate(a: &mut [Vec<f64>], v: &mut [Vec<f64>], [p, q]: [usize; 2]) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    let n = a.len();
    for k in 0..n {
        (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
        (v[k][p], v[k][q]) = (c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]);
    }
    for k in 0..n {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
    }
}

/// `N × N` blocks as one matrix of `3N` rows.
pub(super) fn matrix<const N: usize>(blocks: &[[DMat3; N]; N]) -> Vec<Vec<f64>> {
    let entry = |i: usize, j: usize| blocks[i / 3][j / 3].col(j % 3)[i % 3];
    (0..3 * N)
        .map(|i| (0..3 * N).map(|j| entry(i, j)).collect())
        .collect()
}

/// The way back from [`matrix`].
pub(super) fn blocks<const N: usize>(matrix: &[Vec<f64>]) -> [[DMat3; N]; N] {
    let mut out = [[DMat3::ZERO; N]; N];
    for i in 0..3 * N {
        for j in 0..3 * N {
            out[i / 3][j / 3].col_mut(j % 3)[i % 3] = matrix[i][j];
        }
    }
    out
}
