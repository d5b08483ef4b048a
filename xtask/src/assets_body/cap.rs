//! Closing a mesh where faces are taken out of it.

use std::collections::BTreeMap;

/// Quads that close every hole left by the `removed` ones, in their orientation.
///
/// A hole's ring is bridged by a strip of quads across, begun where that makes the rungs
/// shortest. Rings of odd length end in a triangle: a quad whose last two corners agree.
pub fn close(
    quads: &[[u32; 4]],
    removed: &[bool],
    at: &[[f64; 3]],
) -> Result<Vec<[u32; 4]>, String> {
    let gone = quads
        .iter()
        .zip(removed)
        .filter(|(_, r)| **r)
        .map(|(q, _)| q);
    let rings = rings(gone)?;
    Ok(rings.iter().flat_map(|ring| bridge(ring, at)).collect())
}

/// The closed outlines of these quads, each running as their edges do.
fn rings<'a>(quads: impl Iterator<Item = &'a [u32; 4]>) -> Result<Vec<Vec<u32>>, String> {
    let edges: std::collections::BTreeSet<(u32, u32)> = quads
        .flat_map(|q| (0..4).map(|k| (q[k], q[(k + 1) % 4])))
        .collect();
    let open = edges.iter().filter(|(a, b)| !edges.contains(&(*b, *a)));
    let mut next: BTreeMap<u32, u32> = BTreeMap::new();
    for &(a, b) in open {
        if next.insert(a, b).is_some() {
            return Err(format!("outlines meet at vertex {a}"));
        }
    }
    let mut rings = Vec::new();
    while let Some((start, _)) = next.first_key_value() {
        let mut ring = vec![*start];
        while let Some(to) = next.remove(ring.last().expect("a ring has a start")) {
            ring.push(to);
        }
        ring.pop();
        rings.push(ring);
    }
    Ok(rings)
}

fn bridge(ring: &[u32], at: &[[f64; 3]]) -> Vec<[u32; 4]> {
    let n = ring.len();
    let rung = |s: usize, i: usize| (ring[(s + i) % n], ring[(s + n - 1 - i) % n]);
    let length = |s: usize| (0..n / 2).map(|i| distance(at, rung(s, i))).sum::<f64>();
    let best = (0..n)
        .min_by(|&a, &b| length(a).total_cmp(&length(b)))
        .unwrap_or(0);
    let quad = |i: usize| {
        let ((a, b), (c, d)) = (rung(best, i), rung(best, i + 1));
        [b, a, c, d]
    };
    (0..n.div_ceil(2) - 1).map(quad).collect()
}

fn distance(at: &[[f64; 3]], (a, b): (u32, u32)) -> f64 {
    let (a, b) = (at[a as usize], at[b as usize]);
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_in_a_grid_is_bridged_the_right_way_round() {
        // A 3 × 3 grid of quads; the middle one is taken out.
        let at: Vec<[f64; 3]> = (0..16)
            .map(|i| [f64::from(i % 4), f64::from(i / 4), 0.0])
            .collect();
        let cell = |i: u32| [i, i + 1, i + 5, i + 4];
        let quads: Vec<[u32; 4]> = [0, 1, 2, 4, 5, 6, 8, 9, 10].map(cell).to_vec();
        let removed: Vec<bool> = (0..9).map(|i| i == 4).collect();
        let cap = close(&quads, &removed, &at).expect("one ring");
        assert_eq!(cap.len(), 1);
        let mut corners = cap[0];
        let first = corners
            .iter()
            .position(|&c| c == 5)
            .expect("a corner of the hole");
        corners.rotate_left(first);
        assert_eq!(corners, [5, 6, 10, 9]);
    }
}
