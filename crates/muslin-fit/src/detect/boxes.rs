//! Reading the detector: anchors, scores, and one square per person.

use glam::DVec2;

use super::crop::Square;

/// Boxes the detector judges.
const N: usize = 2254;
/// Shapes of its outputs: places and scores.
pub(super) const OUTPUTS: [&[usize]; 2] = [&[1, N, 12], &[1, N, 1]];
/// Cells along a side of each grid and boxes per cell: strides 8, 16 and three times 32, two each.
const GRIDS: [(usize, usize); 3] = [(28, 2), (14, 2), (7, 6)];
/// Pixels along a side of the detector's picture; its places are in these.
const SIDE: f64 = 224.0;
/// Least score of a person.
const LEAST: f64 = 0.5;
/// Boxes that share more of their union than this are one person.
const OVERLAP: f64 = 0.3;
/// How much larger than the person the square is.
const MARGIN: f64 = 1.25;

/// A square that may hold a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub square: Square,
    /// The detector's score, 0 to 1.
    pub score: f64,
}

/// A box and its four points, as shares of the detector's picture.
#[derive(Clone, Copy)]
struct Sighting {
    low: DVec2,
    high: DVec2,
    points: [DVec2; 4],
    score: f64,
}

/// Candidates, the likeliest first, and the best score of all boxes.
///
/// `places` and `scores` are the detector's outputs; `whole` is the square it looked at.
pub(super) fn read(places: &[f32], scores: &[f32], whole: &Square) -> (Vec<Candidate>, f64) {
    let scores: Vec<f64> = scores.iter().map(|&s| sigmoid(s)).collect();
    let best = scores.iter().copied().fold(0.0, f64::max);
    let rows = places.as_chunks::<12>().0;
    let seen = anchors()
        .zip(rows)
        .zip(scores)
        .filter(|(_, score)| *score >= LEAST);
    let sightings = seen.map(|((anchor, row), score)| sighting(anchor, row, score));
    let sane = |s: &Sighting| s.low.is_finite() && s.high.cmpge(s.low).all();
    let merged = merge(sightings.filter(sane).collect());
    (merged.iter().map(|s| candidate(s, whole)).collect(), best)
}

fn sigmoid(x: f32) -> f64 {
    1.0 / (1.0 + f64::from(-x.clamp(-100.0, 100.0)).exp())
}

/// The middles of all cells, once for every box, in the detector's order.
fn anchors() -> impl Iterator<Item = DVec2> {
    GRIDS.into_iter().flat_map(|(n, per_cell)| {
        (0..n * n * per_cell).map(move |i| {
            let cell = i / per_cell;
            (DVec2::new((cell % n) as f64, (cell / n) as f64) + 0.5) / n as f64
        })
    })
}

/// A row is middle, size and four points, all relative to the anchor.
fn sighting(anchor: DVec2, row: &[f32; 12], score: f64) -> Sighting {
    let pair = |i: usize| DVec2::new(f64::from(row[i]), f64::from(row[i + 1])) / SIDE;
    let (middle, size) = (pair(0) + anchor, pair(2));
    let points = [4, 6, 8, 10].map(|i| pair(i) + anchor);
    Sighting {
        low: middle - size / 2.0,
        high: middle + size / 2.0,
        points,
        score,
    }
}

/// Weighted non-maximum suppression: what overlaps the best is averaged with it by score.
fn merge(mut left: Vec<Sighting>) -> Vec<Sighting> {
    left.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut merged = Vec::new();
    while let Some(&best) = left.first() {
        let (same, rest): (Vec<_>, Vec<_>) =
            left.into_iter().partition(|s| overlap(s, &best) > OVERLAP);
        merged.push(if same.is_empty() {
            best
        } else {
            average(&same, best.score)
        });
        // A box without area overlaps nothing, not even itself.
        left = if same.is_empty() {
            rest[1..].to_vec()
        } else {
            rest
        };
    }
    merged
}

/// Shared area over joint area, 0 to 1.
fn overlap(a: &Sighting, b: &Sighting) -> f64 {
    let area = |size: DVec2| size.max(DVec2::ZERO).element_product();
    let shared = area(a.high.min(b.high) - a.low.max(b.low));
    let joint = area(a.high - a.low) + area(b.high - b.low) - shared;
    if joint > 0.0 { shared / joint } else { 0.0 }
}

fn average(same: &[Sighting], score: f64) -> Sighting {
    let total: f64 = same.iter().map(|s| s.score).sum();
    let mean =
        |f: &dyn Fn(&Sighting) -> DVec2| same.iter().map(|s| f(s) * s.score).sum::<DVec2>() / total;
    Sighting {
        low: mean(&|s| s.low),
        high: mean(&|s| s.high),
        points: std::array::from_fn(|i| mean(&|s| s.points[i])),
        score,
    }
}

/// The square around the first point (the hips) that the second (at the reach of the limbs)
/// lies straight above of.
fn candidate(s: &Sighting, whole: &Square) -> Candidate {
    let [hips, reach] = [s.points[0], s.points[1]].map(|p| whole.to_picture(p));
    let up = reach - hips;
    let angle = std::f64::consts::FRAC_PI_2 - (-up.y).atan2(up.x);
    let square = Square {
        centre: hips,
        side: 2.0 * MARGIN * up.length(),
        angle,
    };
    Candidate {
        square,
        score: s.score,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: Square = Square {
        centre: DVec2::new(100.0, 50.0),
        side: 200.0,
        angle: 0.0,
    };

    /// Outputs with nobody, for a test to put people into.
    fn nobody() -> (Vec<f32>, Vec<f32>) {
        (vec![0.0; N * 12], vec![-9.0; N])
    }

    /// A box of 60 pixels in cell `i`, its second point 40 pixels to the side.
    fn put(out: &mut (Vec<f32>, Vec<f32>), i: usize, score: f32, shift: f32) {
        out.0[i * 12..][..8].copy_from_slice(&[shift, 0., 60., 60., shift, 0., 40. + shift, 0.]);
        out.1[i] = score;
    }

    #[test]
    fn anchors_count_what_the_detector_says() {
        assert_eq!(anchors().count(), N);
        assert_eq!(anchors().next(), Some(DVec2::splat(0.5 / 28.0)));
        assert_eq!(anchors().last(), Some(DVec2::splat(6.5 / 7.0)));
    }

    #[test]
    fn nobody_leaves_the_best_score() {
        let out = nobody();
        let (found, best) = read(&out.0, &out.1, &WHOLE);
        assert!(found.is_empty() && (best - 1.0 / (1.0 + 9f64.exp())).abs() < 1e-9);
    }

    #[test]
    fn neighbours_merge_by_score_and_strangers_stay() {
        let mut out = nobody();
        let at = 28 * 28 * 2;
        put(&mut out, at, 2.0, 0.0);
        put(&mut out, at + 1, 2.0, 8.0);
        put(&mut out, at + 2 * 14 * 14 - 1, 1.0, 0.0);
        let (found, best) = read(&out.0, &out.1, &WHOLE);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].score, best);
        let to_px = 200.0 / 224.0;
        let square = found[0].square;
        let want = DVec2::new((8.0 + 4.0) * to_px, 8.0 * to_px - 50.0);
        assert!((square.centre - want).length() < 1e-9, "{square:?}");
        assert!((square.side - 2.5 * 40.0 * to_px).abs() < 1e-9);
        assert!((square.angle - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn boxes_without_sense_are_dropped() {
        let mut out = nobody();
        put(&mut out, 3, 5.0, 0.0);
        out.0[3 * 12 + 2] = -1.0;
        put(&mut out, 9, 5.0, f32::NAN);
        out.1[11] = 5.0; // no area at all
        let (found, _) = read(&out.0, &out.1, &WHOLE);
        assert_eq!(found.len(), 1);
    }
}
