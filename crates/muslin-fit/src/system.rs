//! Normal equations: sums of weighted rows, and their solution.

/// `H = Σ w q qᵀ` and `g = Σ w q r` of rows `q·δ + r ≈ 0`.
#[derive(Debug, Clone)]
pub struct System {
    n: usize,
    /// Row-major; the upper triangle counts.
    h: Vec<f64>,
    g: Vec<f64>,
}

/// A system that still takes rows.
///
/// Rows that follow one another in the same columns are multiplied together first, close by one
/// another in memory, and spread over the system once.
#[derive(Debug, Clone)]
pub struct Sums {
    system: System,
    columns: Vec<usize>,
    /// Row after row, as wide as `columns`.
    values: Vec<f64>,
    /// Weight and residual of each.
    rows: Vec<[f64; 2]>,
    products: Vec<f64>,
}

impl Sums {
    /// No rows yet, over `n` unknowns.
    pub fn new(n: usize) -> Sums {
        Sums {
            system: System {
                n,
                h: vec![0.0; n * n],
                g: vec![0.0; n],
            },
            columns: Vec::new(),
            values: Vec::new(),
            rows: Vec::new(),
            products: vec![0.0; n],
        }
    }

    /// Adds the row that has `values` in `columns` (rising), residual `r` and weight `w`.
    pub fn add(&mut self, columns: &[usize], values: &[f64], r: f64, w: f64) {
        if columns != self.columns {
            self.spread();
            self.columns.extend_from_slice(columns);
        }
        self.values.extend_from_slice(values);
        self.rows.push([w, r]);
    }

    /// The system of all rows.
    pub fn done(mut self) -> System {
        self.spread();
        self.system
    }

    /// Adds the products of the rows that wait.
    fn spread(&mut self) {
        let System { n, h, g } = &mut self.system;
        let width = self.columns.len();
        for (i, &a) in self.columns.iter().enumerate() {
            let sums = &mut self.products[..width - i];
            sums.fill(0.0);
            for (row, [w, r]) in self.values.chunks_exact(width).zip(&self.rows) {
                let factor = w * row[i];
                g[a] += factor * r;
                for (sum, v) in sums.iter_mut().zip(&row[i..]) {
                    *sum += factor * v;
                }
            }
            let target = &mut h[a * *n..][..*n];
            for (&b, sum) in self.columns[i..].iter().zip(sums) {
                target[b] += *sum;
            }
        }
        self.columns.clear();
        self.values.clear();
        self.rows.clear();
    }
}

impl System {
    /// Which way cost falls fastest along unknown `i`: minus the gradient.
    pub fn fall(&self, i: usize) -> f64 {
        -self.g[i]
    }

    /// Keeps unknown `i` where it is.
    pub fn hold(&mut self, i: usize) {
        self.h[i * self.n + i] = 1e18;
        self.g[i] = 0.0;
    }

    /// The step δ that solves `(H + λ (diag H + floor)) δ = −g`; none if not positive definite.
    pub fn solve(&self, lambda: f64, floor: f64) -> Option<Vec<f64>> {
        let n = self.n;
        let mut u = self.h.clone();
        for i in 0..n {
            u[i * n + i] += lambda * (u[i * n + i] + floor);
        }
        if !factor(&mut u, n) {
            return None;
        }
        let mut x: Vec<f64> = self.g.iter().map(|g| -g).collect();
        for i in 0..n {
            x[i] /= u[i * n + i];
            let xi = x[i];
            for (x, u) in x[i + 1..].iter_mut().zip(&u[i * n + i + 1..]) {
                *x -= u * xi;
            }
        }
        for i in (0..n).rev() {
            let sum = dot(&u[i * n + i + 1..(i + 1) * n], &x[i + 1..]);
            x[i] = (x[i] - sum) / u[i * n + i];
        }
        Some(x)
    }
}

/// Cholesky `UᵀU` in place, upper triangle; false where a pivot is not positive.
///
/// Two pivots at a time, so that what is left is read and written half as often.
fn factor(u: &mut [f64], n: usize) -> bool {
    for k in (0..n).step_by(2) {
        let (above, below) = u.split_at_mut((k + 1) * n);
        let first = &mut above[k * n..];
        if !scale(&mut first[k..]) {
            return false;
        }
        if k + 1 == n {
            return true;
        }
        let (second, below) = below.split_at_mut(n);
        take(&mut second[k + 1..], first[k + 1], &first[k + 1..]);
        if !scale(&mut second[k + 1..]) {
            return false;
        }
        for (i, row) in below.chunks_exact_mut(n).enumerate() {
            let i = k + 2 + i;
            let (f, s) = (first[i], second[i]);
            for ((x, a), b) in row[i..].iter_mut().zip(&first[i..]).zip(&second[i..]) {
                *x -= f * a + s * b;
            }
        }
    }
    true
}

/// Divides a row by the root of its first value; false where that is not positive.
fn scale(row: &mut [f64]) -> bool {
    let pivot = row[0];
    if pivot.is_nan() || pivot <= 0.0 {
        return false;
    }
    let by = 1.0 / pivot.sqrt();
    row.iter_mut().for_each(|x| *x *= by);
    true
}

/// `row -= factor · other`.
fn take(row: &mut [f64], factor: f64, other: &[f64]) {
    for (x, o) in row.iter_mut().zip(other) {
        *x -= factor * o;
    }
}

/// Eight sums side by side, so that a vector unit can be used; always in the same order.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (ca, ra) = a.as_chunks::<8>();
    let (cb, rb) = b.as_chunks::<8>();
    let mut sum = [0.0; 8];
    for (a, b) in ca.iter().zip(cb) {
        for k in 0..8 {
            sum[k] += a[k] * b[k];
        }
    }
    let rest: f64 = ra.iter().zip(rb).map(|(a, b)| a * b).sum();
    sum.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_system_is_solved_exactly() {
        let n = 19;
        let mut system = Sums::new(n);
        let columns: Vec<usize> = (0..n).collect();
        let want: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin()).collect();
        for k in 0..2 * n {
            let row: Vec<f64> = (0..n)
                .map(|i| ((k * k * 7 + i * i * 3 + k * i) as f64 * 0.37).cos())
                .collect();
            let r = -row.iter().zip(&want).map(|(a, b)| a * b).sum::<f64>();
            system.add(&columns, &row, r, 0.5 + (k % 3) as f64);
        }
        let got = system.done().solve(1e-12, 1.0).expect("well posed");
        assert!(
            got.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-6),
            "{got:?}"
        );
    }

    #[test]
    fn unknowns_without_rows_stay() {
        let mut system = Sums::new(3);
        system.add(&[0, 2], &[1.0, 1.0], 2.0, 1.0);
        let step = system.done().solve(1e-3, 1.0).expect("damped");
        assert_eq!(step[1], 0.0);
        assert!((step[0] + 1.0).abs() < 1e-2);
    }
}
