//! The main components of what handles leave, and how much of each a frame needs.

use glam::DVec3;
use rayon::prelude::*;

use super::Baked;

/// Rounds of the subspace iteration, and components beyond those asked for that speed it.
const ROUNDS: usize = 40;
const SPARE: usize = 8;
/// Share of the mean square that is added where codes and normals are solved for.
const RIDGE: f64 = 1e-9;

/// At most `k` shapes that explain most of `left` (frame → vertex); as long as the farthest that any of
/// them takes a vertex is one. None where nothing is left.
pub fn main(left: &[Vec<DVec3>], k: usize) -> Vec<Vec<DVec3>> {
    let t = left.len();
    let row = |i: usize| -> Vec<f64> {
        let dot = |j: usize| left[i].iter().zip(&left[j]).map(|(a, b)| a.dot(*b)).sum();
        (0..t).map(dot).collect()
    };
    let gram: Vec<Vec<f64>> = (0..t).into_par_iter().map(row).collect();
    let size: f64 = (0..t).map(|i| gram[i][i]).sum();
    let mut out = Vec::new();
    for turn in subspace(&gram, k.min(t)) {
        let n = left[0].len();
        let sum = |v: usize| -> DVec3 { turn.iter().zip(left).map(|(c, d)| *c * d[v]).sum() };
        let mut shape: Vec<DVec3> = (0..n).into_par_iter().map(sum).collect();
        let square: f64 = shape.iter().map(|d| d.length_squared()).sum();
        let farthest = shape
            .iter()
            .map(|d| d.abs().max_element())
            .fold(0.0, f64::max);
        if square > 1e-12 * size && farthest > 0.0 {
            shape.iter_mut().for_each(|d| *d /= farthest);
            out.push(shape);
        }
    }
    out
}

/// An orthonormal basis of about the `k` main directions of a positive matrix.
fn subspace(gram: &[Vec<f64>], k: usize) -> Vec<Vec<f64>> {
    let t = gram.len();
    let m = (k + SPARE).min(t);
    // Any start will do that is of full rank and that no direction is orthogonal to.
    let scattered = |k: usize| {
        let z = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (z >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let start = |c: usize| (0..t).map(|i| scattered(i * m + c)).collect();
    let mut basis: Vec<Vec<f64>> = (0..m).map(start).collect();
    orthonormal(&mut basis);
    for _ in 0..ROUNDS {
        let step = |b: &Vec<f64>| {
            let dot = |row: &Vec<f64>| row.iter().zip(b).map(|(a, b)| a * b).sum();
            gram.iter().map(dot).collect()
        };
        basis = basis.par_iter().map(step).collect();
        orthonormal(&mut basis);
    }
    // Gram and Schmidt in order lead the first to the largest.
    basis.truncate(k);
    basis
}

/// Gram-Schmidt, twice; what depends on those before it becomes zero.
fn orthonormal(basis: &mut [Vec<f64>]) {
    for c in 0..basis.len() {
        let (before, rest) = basis.split_at_mut(c);
        let own = &mut rest[0];
        let first: f64 = own.iter().map(|x| x * x).sum();
        for _ in 0..2 {
            for b in before.iter() {
                let dot: f64 = own.iter().zip(b).map(|(x, y)| x * y).sum();
                own.iter_mut().zip(b).for_each(|(x, y)| *x -= dot * y);
            }
        }
        let square: f64 = own.iter().map(|x| x * x).sum();
        let scale = if square > 1e-20 * first && square > 0.0 {
            1.0 / square.sqrt()
        } else {
            0.0
        };
        own.iter_mut().for_each(|x| *x *= scale);
    }
}

/// How much of each shape leads frame `t` nearest to `x`, handles counted in; vertices count as `pull`
/// says, or alike where it is empty.
pub fn code(baked: &Baked, t: usize, (x, pull): (&[DVec3], &[f64])) -> Vec<f64> {
    let k = baked.shapes.len();
    let (mut a, mut b) = (vec![0.0; k * k], vec![0.0; k]);
    let mut row = vec![DVec3::ZERO; k];
    for (v, x) in x.iter().enumerate() {
        let carried = baked.carried((t, v));
        let gap = *x - carried.transform_point3(baked.rest[v]);
        let pulled = pull.get(v).copied().unwrap_or(1.0);
        for (r, s) in row.iter_mut().zip(&baked.shapes) {
            *r = carried.matrix3 * s[v];
        }
        for i in 0..k {
            let own = pulled * row[i];
            b[i] += own.dot(gap);
            (0..=i).for_each(|j| a[i * k + j] += own.dot(row[j]));
        }
    }
    finish(&mut a, k);
    solve(&mut a, &mut b);
    b
}

/// How `changes` (frame → vertex) depend on `codes` (frame → shape), in least squares: shape → vertex.
pub fn explained(changes: &[Vec<DVec3>], codes: &[&[f64]]) -> Vec<Vec<DVec3>> {
    let k = codes.first().map_or(0, |c| c.len());
    let mut a = vec![0.0; k * k];
    for c in codes {
        for i in 0..k {
            (0..=i).for_each(|j| a[i * k + j] += c[i] * c[j]);
        }
    }
    // Frames are few and noise many: a shape that hardly counts must not bend much.
    let mean = (0..k).map(|i| a[i * k + i]).sum::<f64>() / k.max(1) as f64;
    (0..k).for_each(|i| a[i * k + i] += 1e-3 * mean);
    finish(&mut a, k);
    let inverse: Vec<Vec<f64>> = (0..k)
        .map(|i| {
            let mut column = vec![0.0; k];
            column[i] = 1.0;
            solve(&mut a.clone(), &mut column);
            column
        })
        .collect();
    let n = changes.first().map_or(0, Vec::len);
    let shape = |row: &Vec<f64>| {
        let share = |c: &&[f64]| -> f64 { row.iter().zip(*c).map(|(r, c)| r * c).sum() };
        let shares: Vec<f64> = codes.iter().map(share).collect();
        let sum = |v: usize| shares.iter().zip(changes).map(|(s, d)| *s * d[v]).sum();
        (0..n).map(sum).collect()
    };
    inverse.par_iter().map(shape).collect()
}

/// Fills the upper half from the lower, and adds a little to the diagonal.
fn finish(a: &mut [f64], k: usize) {
    let mean = (0..k).map(|i| a[i * k + i]).sum::<f64>() / k.max(1) as f64;
    for i in 0..k {
        a[i * k + i] += RIDGE * mean + 1e-300;
        (0..i).for_each(|j| a[j * k + i] = a[i * k + j]);
    }
}

/// Solves `a x = b` for a positive definite `a` (rows; overwritten by its Cholesky factor), in place.
pub fn solve(a: &mut [f64], b: &mut [f64]) {
    let n = b.len();
    for j in 0..n {
        for i in j..n {
            let dot: f64 = (0..j).map(|q| a[i * n + q] * a[j * n + q]).sum();
            let value = a[i * n + j] - dot;
            a[i * n + j] = match i == j {
                true => value.max(f64::MIN_POSITIVE).sqrt(),
                false => value / a[j * n + j],
            };
        }
    }
    for i in 0..n {
        let dot: f64 = (0..i).map(|q| a[i * n + q] * b[q]).sum();
        b[i] = (b[i] - dot) / a[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|q| a[q * n + i] * b[q]).sum();
        b[i] = (b[i] - dot) / a[i * n + i];
    }
}
