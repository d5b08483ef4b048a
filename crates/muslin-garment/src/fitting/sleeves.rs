//! Which part of a mesh is a sleeve, however it hangs: what lies between its cuff and the armpit.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DQuat, DVec3};
use muslin_geom::neighbours;

use super::clean::{middle, rims};

/// An opening this far from the middle [m], above the crotch, is a cuff.
const ASIDE: f64 = 0.1;
/// How far along the cloth a sleeve is followed from its cuff, and from look to look [m].
const LONGEST: f64 = 0.8;
const STEP: f64 = 0.01;
/// Where it is so many times as wide as it was, it has met the trunk.
const WIDER: f64 = 1.6;
/// Looks before that: a cuff may be cut aslant.
const FIRST: usize = 4;
/// Width of a ring of a sleeve [m].
const RING: f64 = 0.02;

/// For every vertex the arm, 0 at +X or 1 at -X, in whose sleeve it is, and how far behind the armpit [m]; a little less
/// than nothing where cloth of the trunk goes over into it.
pub type Parts = Vec<Option<(usize, f64)>>;

/// How far from the shoulder's joint the armpit is, along the arm [m].
const PIT: f64 = 0.06;
/// From so far before the armpit to so far behind it [m] cloth goes over from the trunk to the arm.
const OVER: f64 = 0.1;

/// Leads sleeves at `x` [m] to the arms, shoulder, elbow and wrist [m]: every ring of a sleeve to its place on the arm,
/// turned as the arm is.
pub fn onto_arms(x: &mut [DVec3], parts: &Parts, arms: &[[DVec3; 3]; 2]) {
    let rings = (LONGEST / RING) as usize + 1;
    for (side, arm) in arms.iter().enumerate() {
        let ring = |d: f64| ((d / RING) as usize).min(rings - 1);
        let is_own = |part: &(usize, f64)| part.0 == side && part.1 >= 0.0;
        let mut sums = vec![(DVec3::ZERO, 0.0); rings];
        for (p, part) in x.iter().zip(parts) {
            if let Some(part) = part.filter(is_own) {
                let sum = &mut sums[ring(part.1)];
                *sum = (sum.0 + *p, sum.1 + 1.0);
            }
        }
        let middles: Vec<Option<DVec3>> = (sums.iter())
            .map(|s| (s.1 > 2.0).then(|| s.0 / s.1))
            .collect();
        let seen: Vec<usize> = (0..rings).filter(|k| middles[*k].is_some()).collect();
        let (Some(first), Some(last)) = (seen.first(), seen.last()) else {
            continue;
        };
        let at = |k: usize| middles[k].expect("it was seen");
        // One direction for all of it: a cuff's ring may be cut aslant.
        let own = (at(*last) - at(*first)).normalize_or_zero();
        // Where the straight line through the sleeve comes from the armpit.
        let start = at(*first) - own * (*first as f64 + 0.5) * RING;
        let [shoulder, elbow, wrist] = *arm;
        let long = shoulder.distance(elbow);
        let [upper, lower] = [elbow - shoulder, wrist - elbow].map(DVec3::normalize);
        for (p, part) in x.iter_mut().zip(parts) {
            let Some((s, d)) = part else { continue };
            if *s != side {
                continue;
            }
            let along = PIT + d;
            let (to, way) = match along < long {
                true => (shoulder + upper * along, upper),
                false => (elbow + lower * (along - long), lower),
            };
            let middle = start + own * *d;
            let turned = DQuat::from_rotation_arc(own, way) * (*p - middle);
            let share = (0.5 + 0.5 * d / OVER).min(1.0);
            *p = p.lerp(to + turned, share * share * (3.0 - 2.0 * share));
        }
    }
}

/// The sleeves of a mesh at `x` [m] that is worn above `crotch` [m]; nothing where it has not two.
pub fn parts(faces: &[[u32; 3]], x: &[DVec3], crotch: f64) -> Option<Parts> {
    let near = neighbours(x.len(), faces);
    let mut out = vec![None; x.len()];
    let all = rims(faces);
    for side in 0..2 {
        let sign = [1.0, -1.0][side];
        let is_cuff = |rim: &&Vec<u32>| {
            let m = middle(x, rim);
            sign * m.x > ASIDE && m.y > crotch
        };
        let far = |rim: &Vec<u32>| sign * middle(x, rim).x;
        let cuff = all.iter().filter(is_cuff);
        let cuff = cuff.max_by(|a, b| far(a).total_cmp(&far(b)))?;
        let along = along(x, &near, cuff);
        let end = end(faces, x, &along)?;
        for (out, d) in out.iter_mut().zip(&along) {
            if *d < end + OVER && out.is_none() {
                *out = Some((side, end - d));
            }
        }
    }
    Some(out)
}

/// How far along the cloth's edges every vertex is from a rim [m].
fn along(x: &[DVec3], near: &[Vec<u32>], rim: &[u32]) -> Vec<f64> {
    let mut out = vec![f64::INFINITY; x.len()];
    // Distances are positive: their bits are ordered as they are.
    let mut next = BinaryHeap::new();
    for &v in rim {
        out[v as usize] = 0.0;
        next.push(Reverse((0, v)));
    }
    while let Some(Reverse((bits, v))) = next.pop() {
        let here = f64::from_bits(bits);
        if here > out[v as usize] {
            continue;
        }
        for &w in &near[v as usize] {
            let d = here + x[v as usize].distance(x[w as usize]);
            if d < out[w as usize] {
                out[w as usize] = d;
                next.push(Reverse((d.to_bits(), w)));
            }
        }
    }
    out
}

/// How far from its cuff a sleeve ends [m].
fn end(faces: &[[u32; 3]], x: &[DVec3], along: &[f64]) -> Option<f64> {
    let mut widths = Vec::new();
    for k in 1..(LONGEST / STEP) as usize {
        let level = STEP * k as f64;
        let width: f64 = faces.iter().map(|f| crossed(f, (x, along), level)).sum();
        let mut before: Vec<f64> = widths.clone();
        before.sort_by(f64::total_cmp);
        if widths.len() >= FIRST && width > WIDER * before[before.len() / 2] {
            return Some(level);
        }
        widths.push(width);
    }
    None
}

/// How long the line is along which a face is `level` from the rim [m].
fn crossed(face: &[u32; 3], (x, along): (&[DVec3], &[f64]), level: f64) -> f64 {
    let mut ends = Vec::with_capacity(2);
    for k in 0..3 {
        let (a, b) = (face[k] as usize, face[(k + 1) % 3] as usize);
        let (p, q) = (along[a] - level, along[b] - level);
        if (p < 0.0) != (q < 0.0) && p.is_finite() && q.is_finite() {
            ends.push(x[a].lerp(x[b], p / (p - q)));
        }
    }
    match ends[..] {
        [a, b] => a.distance(b),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AROUND: usize = 24;
    const LONG: usize = 40;
    /// Where a funnel begins to widen, in its rings of 1 cm.
    const SLEEVE: usize = 25;

    /// A sleeve at this x [m] that hangs, a little outwards, and widens into something like a trunk above; its cuff is the
    /// first ring.
    fn funnel(x: f64) -> Vec<DVec3> {
        let ring = |k: usize| {
            let radius = 0.05 + 0.03 * k.saturating_sub(SLEEVE) as f64;
            let at = move |a: f64| {
                DVec3::new(
                    x * (1.0 - 0.002 * k as f64) + radius * a.cos(),
                    1.0 + 0.01 * k as f64,
                    radius * a.sin(),
                )
            };
            (0..AROUND).map(move |i| at(std::f64::consts::TAU * i as f64 / AROUND as f64))
        };
        (0..LONG).flat_map(ring).collect()
    }

    fn two() -> (Vec<[u32; 3]>, Vec<DVec3>) {
        let verts: Vec<DVec3> = [funnel(0.3), funnel(-0.3)].concat();
        let corner = |s: usize, k: usize, i: usize| ((s * LONG + k) * AROUND + i % AROUND) as u32;
        let all =
            (0..2).flat_map(|s| (1..LONG).flat_map(move |k| (0..AROUND).map(move |i| (s, k, i))));
        let cell = |(s, k, i)| {
            let [a, b] = [corner(s, k - 1, i), corner(s, k - 1, i + 1)];
            let [c, d] = [corner(s, k, i + 1), corner(s, k, i)];
            [[a, b, c], [a, c, d]]
        };
        (all.flat_map(cell).collect(), verts)
    }

    #[test]
    fn a_sleeve_ends_where_it_widens_and_goes_to_its_arm_as_it_is() {
        let (faces, x) = two();
        let parts = parts(&faces, &x, 0.5).expect("two sleeves");
        let ring = |v: usize| v / AROUND % LONG;
        for (v, part) in parts.iter().enumerate() {
            match part {
                Some((side, d)) => {
                    assert_eq!(*side, v / AROUND / LONG);
                    let own = 0.01 * (SLEEVE as f64 - ring(v) as f64);
                    assert!(
                        ring(v) > SLEEVE || (d - own).abs() < 0.04,
                        "{v}: {d} for {own}"
                    );
                }
                None => assert!(ring(v) > SLEEVE, "{v}"),
            }
        }
        // Arms straight out to both sides, and up where the shoulders are.
        let arm = |s: f64| [0.2, 0.5, 0.75].map(|x| DVec3::new(s * x, 1.5, 0.1));
        let mut moved = x.clone();
        onto_arms(&mut moved, &parts, &[arm(1.0), arm(-1.0)]);
        for s in 0..2 {
            let at = |k: usize, i: usize| (s * LONG + k) * AROUND + i;
            for k in [0, 5, 10] {
                let sum: DVec3 = (0..AROUND).map(|i| moved[at(k, i)]).sum();
                let middle = sum / AROUND as f64;
                assert!(
                    (middle - DVec3::new(middle.x, 1.5, 0.1)).length() < 1e-3,
                    "{middle}"
                );
                // The cuff is farthest out.
                let next: DVec3 = (0..AROUND).map(|i| moved[at(k + 1, i)]).sum();
                assert!(middle.x.abs() > next.x.abs() / AROUND as f64);
                for i in 0..AROUND {
                    let [p, q] = [at(k, i), at(k + 1, i)];
                    let [before, after] = [x[p].distance(x[q]), moved[p].distance(moved[q])];
                    assert!((before - after).abs() < 2e-4, "{before} {after}");
                }
            }
        }
        // What is far from an armpit stays.
        assert!((0..x.len()).all(|v| parts[v].is_some() || moved[v] == x[v]));
    }

    #[test]
    fn legs_of_trousers_are_no_sleeves() {
        let (faces, x) = two();
        assert!(parts(&faces, &x, 1.2).is_none());
    }
}
