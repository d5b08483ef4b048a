//! Skin weights that spread evenly over the cloth.

use muslin_body::Sparse;
use muslin_geom::neighbours;

/// How far a garment's skin weights spread: each round leads every vertex halfway to the mean of
/// its neighbours; then only the `most` largest of a vertex are kept.
///
/// Weights taken from the nearest skin change as fast as the skin's own, which folds cloth over
/// joints; a few rounds lay it in a gentle curve.
pub fn diffused(weights: &Sparse, faces: &[[u32; 3]], (rounds, most): (usize, usize)) -> Sparse {
    let near = neighbours(weights.n_rows(), faces);
    let bones = 1 + weights.rows().flatten().map(|e| e.0).max().unwrap_or(0) as usize;
    let mut now: Vec<Vec<f64>> = (weights.rows())
        .map(|row| {
            let mut dense = vec![0.0; bones];
            row.iter().for_each(|&(b, w)| dense[b as usize] += w);
            dense
        })
        .collect();
    for _ in 0..rounds {
        let next = now.iter().enumerate().map(|(i, own)| {
            let share = 0.5 / near[i].len().max(1) as f64;
            let keep = if near[i].is_empty() { 1.0 } else { 0.5 };
            let mut out: Vec<f64> = own.iter().map(|w| keep * w).collect();
            for &j in &near[i] {
                out.iter_mut()
                    .zip(&now[j as usize])
                    .for_each(|(o, w)| *o += share * w);
            }
            out
        });
        now = next.collect();
    }
    let mut out = Sparse::new();
    now.iter().for_each(|dense| out.push(largest(dense, most)));
    out
}

fn largest(dense: &[f64], most: usize) -> Vec<(u32, f64)> {
    let mut row: Vec<(u32, f64)> = dense
        .iter()
        .enumerate()
        .map(|(b, w)| (b as u32, *w))
        .collect();
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    row.truncate(most);
    row.retain(|e| e.1 > 1e-3);
    row.sort_by_key(|e| e.0);
    let sum: f64 = row.iter().map(|e| e.1).sum();
    row.iter().map(|&(b, w)| (b, w / sum)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_spread_stay_convex_and_are_few() {
        let faces: Vec<[u32; 3]> = (0..8).map(|i| [i, i + 1, i + 2]).collect();
        let mut sharp = Sparse::new();
        (0..10).for_each(|i| sharp.push([(u32::from(i >= 5), 1.0)]));
        let soft = diffused(&sharp, &faces, (6, 2));
        assert!(soft.is_convex(2) && soft.widest() <= 2);
        let of_second = |i: usize| soft.row(i).iter().find(|e| e.0 == 1).map_or(0.0, |e| e.1);
        assert!((0..9).all(|i| of_second(i) <= of_second(i + 1)), "monotone");
        assert!(of_second(4) > 0.2 && of_second(5) < 0.8);
    }
}
