//! Normal equations: sums of weighted rows, and their solution.

/// `H = Σ w q qᵀ` and `g = Σ w q r` of rows `q·δ + r ≈ 0`.
#[derive(Debug, Clone)]
pub struct System {
    n: usize,
    /// Row-major; the lower triangle counts.
    h: Vec<f64>,
    g: Vec<f64>,
}

impl System {
    /// No rows yet, over `n` unknowns.
    pub fn new(n: usize) -> System {
        System {
            n,
            h: vec![0.0; n * n],
            g: vec![0.0; n],
        }
    }

    /// Adds the row that has `values` in `columns` (rising), residual `r` and weight `w`.
    pub fn add(&mut self, columns: &[usize], values: &[f64], r: f64, w: f64) {
        for (i, (&a, &va)) in columns.iter().zip(values).enumerate() {
            let wva = w * va;
            self.g[a] += wva * r;
            let row = &mut self.h[a * self.n..];
            for (&b, &vb) in columns[..=i].iter().zip(values) {
                row[b] += wva * vb;
            }
        }
    }

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
        let mut l = self.h.clone();
        for i in 0..n {
            l[i * n + i] += lambda * (l[i * n + i] + floor);
        }
        if !factor(&mut l, n) {
            return None;
        }
        let mut x: Vec<f64> = self.g.iter().map(|g| -g).collect();
        for i in 0..n {
            let sum = dot(&l[i * n..i * n + i], &x[..i]);
            x[i] = (x[i] - sum) / l[i * n + i];
        }
        for i in (0..n).rev() {
            x[i] /= l[i * n + i];
            let xi = x[i];
            for (x, l) in x[..i].iter_mut().zip(&l[i * n..i * n + i]) {
                *x -= l * xi;
            }
        }
        Some(x)
    }
}

/// Cholesky in place, lower triangle; false where a pivot is not positive.
fn factor(l: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        let (above, row) = l.split_at_mut(i * n);
        for j in 0..i {
            let sum = dot(&row[..j], &above[j * n..j * n + j]);
            row[j] = (row[j] - sum) / above[j * n + j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
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
        let mut system = System::new(n);
        let columns: Vec<usize> = (0..n).collect();
        let want: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin()).collect();
        for k in 0..2 * n {
            let row: Vec<f64> = (0..n)
                .map(|i| ((k * k * 7 + i * i * 3 + k * i) as f64 * 0.37).cos())
                .collect();
            let r = -row.iter().zip(&want).map(|(a, b)| a * b).sum::<f64>();
            system.add(&columns, &row, r, 0.5 + (k % 3) as f64);
        }
        let got = system.solve(1e-12, 1.0).expect("well posed");
        assert!(
            got.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-6),
            "{got:?}"
        );
    }

    #[test]
    fn unknowns_without_rows_stay() {
        let mut system = System::new(3);
        system.add(&[0, 2], &[1.0, 1.0], 2.0, 1.0);
        let step = system.solve(1e-3, 1.0).expect("damped");
        assert_eq!(step[1], 0.0);
        assert!((step[0] + 1.0).abs() < 1e-2);
    }
}
