//! A convex tube: what a tape measure sees of a trunk, an arm or a leg, and cloth hung on it.
//!
//! At stations along a straight axis the tube keeps, for every direction around the axis, how
//! far the slice reaches that way (its support function). That is the shape cloth takes when
//! it is wrapped around: hollows are bridged. Growing a slice by `e` adds `e` to every reach
//! and `2π e` to its girth.

use glam::DVec3;
use std::f64::consts::TAU;

/// Directions around the axis.
const DIRS: usize = 72;

/// Where a tube runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    /// Station zero [m].
    pub origin: DVec3,
    /// Unit, the way stations count.
    pub along: DVec3,
    /// Unit, across; direction number 0.
    pub u: DVec3,
    /// Unit, across; a quarter turn from `u`.
    pub w: DVec3,
}

impl Axis {
    /// An axis from one point to another [m], with `front` as direction zero.
    pub fn new(origin: DVec3, to: DVec3, front: DVec3) -> Axis {
        let along = (to - origin).normalize_or(DVec3::Y);
        let u = (front - along * front.dot(along)).normalize_or(DVec3::X);
        Axis {
            origin,
            along,
            u,
            w: along.cross(u),
        }
    }

    /// Distance along [m], and the two coordinates across [m].
    pub fn coordinates(&self, p: DVec3) -> (f64, f64, f64) {
        let d = p - self.origin;
        (d.dot(self.along), d.dot(self.u), d.dot(self.w))
    }
}

/// A tube measured on a body.
#[derive(Clone, Debug)]
pub(crate) struct Tube {
    pub axis: Axis,
    from: f64,
    step: f64,
    reach: Vec<[f64; DIRS]>,
}

impl Tube {
    /// Wraps a tape around the edges' slices at `n` stations between `from` and `to` [m].
    ///
    /// Stations that no edge crosses copy the nearest one that is crossed.
    pub fn measure(axis: Axis, (from, to): (f64, f64), edges: &[[DVec3; 2]]) -> Tube {
        let n = ((to - from) / 0.008).ceil().max(2.0) as usize;
        let step = (to - from) / (n - 1) as f64;
        let mut tube = Tube {
            axis,
            from,
            step,
            reach: vec![[f64::MIN; DIRS]; n],
        };
        for e in edges {
            tube.include(e[0], e[1]);
        }
        tube.fill();
        tube
    }

    fn include(&mut self, a: DVec3, b: DVec3) {
        let (mut a, mut b) = (self.axis.coordinates(a), self.axis.coordinates(b));
        if a.0 > b.0 {
            std::mem::swap(&mut a, &mut b);
        }
        let first = ((a.0 - self.from) / self.step).ceil().max(0.0) as usize;
        for i in first..self.reach.len() {
            let t = self.at(i);
            if t > b.0 {
                break;
            }
            let s = if b.0 > a.0 {
                (t - a.0) / (b.0 - a.0)
            } else {
                0.0
            };
            let (u, w) = (a.1 + (b.1 - a.1) * s, a.2 + (b.2 - a.2) * s);
            for (reach, d) in self.reach[i].iter_mut().zip(directions()) {
                *reach = reach.max(u * d[0] + w * d[1]);
            }
        }
    }

    fn fill(&mut self) {
        let known: Vec<usize> = (0..self.reach.len())
            .filter(|&i| self.reach[i][0] > f64::MIN)
            .collect();
        for i in 0..self.reach.len() {
            if let Some(&j) = known.iter().min_by_key(|j| j.abs_diff(i)) {
                self.reach[i] = self.reach[j];
            }
        }
    }

    /// The station's distance along the axis [m].
    pub fn at(&self, station: usize) -> f64 {
        self.from + self.step * station as f64
    }

    pub fn len(&self) -> usize {
        self.reach.len()
    }

    /// What a tape around station `i` reads [m] (Cauchy: the mean reach times 2π).
    pub fn girth(&self, i: usize) -> f64 {
        self.reach[i].iter().sum::<f64>() / DIRS as f64 * TAU
    }

    /// The largest girth between two distances along the axis [m].
    pub fn largest_girth(&self, from: f64, to: f64) -> f64 {
        let within = (0..self.len()).filter(|&i| (from..=to).contains(&self.at(i)));
        within.map(|i| self.girth(i)).fold(0.0, f64::max)
    }

    /// Widens every station by `ease(distance along, girth)` [m] in all directions.
    pub fn widen(&mut self, ease: impl Fn(f64, f64) -> f64) {
        for i in 0..self.len() {
            let e = ease(self.at(i), self.girth(i));
            self.reach[i].iter_mut().for_each(|r| *r += e);
        }
    }

    /// Moves every station by `shift(distance along)` [m]; girths stay.
    pub fn shift(&mut self, shift: impl Fn(f64) -> DVec3) {
        for i in 0..self.len() {
            let v = shift(self.at(i));
            let (u, w) = (v.dot(self.axis.u), v.dot(self.axis.w));
            for (r, d) in self.reach[i].iter_mut().zip(directions()) {
                *r += u * d[0] + w * d[1];
            }
        }
    }

    /// Goes over to the reaches of another tube on the same stations: `share(distance along)`
    /// is 0 for this one, 1 for the other.
    pub fn blend_to(&mut self, other: &Tube, share: impl Fn(f64) -> f64) {
        for i in 0..self.len() {
            let s = share(self.at(i));
            for (r, o) in self.reach[i].iter_mut().zip(&other.reach[i]) {
                *r += (o - *r) * s;
            }
        }
    }

    /// Lets cloth fall from all stations between two distances down (or up) to station `i`.
    pub fn drop_to(&mut self, i: usize, from: f64, to: f64) {
        for j in 0..self.len() {
            if (from..=to).contains(&self.at(j)) {
                for k in 0..DIRS {
                    self.reach[i][k] = self.reach[i][k].max(self.reach[j][k]);
                }
            }
        }
    }

    /// Pulls cloth straight along the axis between two distances [m]: hollows are bridged.
    pub fn bridge(&mut self, from: f64, to: f64) {
        let inside: Vec<usize> = (0..self.len())
            .filter(|&i| (from - 1e-9..=to + 1e-9).contains(&self.at(i)))
            .collect();
        for k in 0..DIRS {
            let hull = upper_hull(&inside, |i| self.reach[i][k]);
            for pair in hull.windows(2) {
                let (a, b) = (pair[0], pair[1]);
                let (ra, rb) = (self.reach[a][k], self.reach[b][k]);
                for i in a..b {
                    self.reach[i][k] = ra + (rb - ra) * (i - a) as f64 / (b - a) as f64;
                }
            }
        }
    }

    /// Rounds the tube off: means over neighbours along and around, never tighter than before.
    pub fn soften(&mut self, times: usize) {
        for _ in 0..times {
            let old = self.reach.clone();
            for i in 0..old.len() {
                let (p, n) = (i.saturating_sub(1), (i + 1).min(old.len() - 1));
                for k in 0..DIRS {
                    let (l, r) = ((k + DIRS - 1) % DIRS, (k + 1) % DIRS);
                    let mean = (old[p][k] + old[n][k] + old[i][l] + old[i][r]) / 4.0;
                    self.reach[i][k] = (old[i][k] + mean) / 2.0;
                }
            }
        }
    }

    /// A radius about the axis that no station exceeds [m].
    pub fn bound(&self) -> f64 {
        self.reach.iter().flatten().fold(0.0, |m: f64, r| m.max(*r)) * 1.01
    }

    /// About how far `p` is outside the tube [m], negative inside, and the direction that grows.
    ///
    /// Exact on the surface and inside a cylinder; beyond the last station the end continues.
    pub fn distance(&self, p: DVec3) -> (f64, DVec3) {
        let (t, u, w) = self.axis.coordinates(p);
        let s = ((t - self.from) / self.step).clamp(0.0, (self.len() - 1) as f64);
        let i = (s as usize).min(self.len() - 2);
        let f = s - i as f64;
        let (lo, hi) = (&self.reach[i], &self.reach[i + 1]);
        let table = directions();
        let value = |k: usize| u * table[k][0] + w * table[k][1] - (lo[k] + (hi[k] - lo[k]) * f);
        let (at, best) = highest(towards(u, w), value);
        let inside = s > 0.0 && s < (self.len() - 1) as f64;
        let slope = if inside {
            (hi[at] - lo[at]) / self.step
        } else {
            0.0
        };
        let d = directions()[at];
        let g = self.axis.u * d[0] + self.axis.w * d[1] - self.axis.along * slope;
        let steep = (1.0 + slope * slope).sqrt();
        (best / steep, g / steep)
    }
}

/// The direction that points most nearly to `(u, w)`.
fn towards(u: f64, w: f64) -> usize {
    let turns = w.atan2(u) / TAU + 1.0;
    (turns * DIRS as f64).round() as usize % DIRS
}

/// The direction where `value` is highest, climbing from a window around `start`.
fn highest(start: usize, value: impl Fn(usize) -> f64) -> (usize, f64) {
    const WINDOW: usize = 5;
    let mut best = (start, value(start));
    for sense in [1, DIRS - 1] {
        let (mut k, mut since) = (start, 0);
        while since < WINDOW {
            k += sense;
            k -= if k >= DIRS { DIRS } else { 0 };
            since += 1;
            let v = value(k);
            if v > best.1 {
                (best, since) = ((k, v), 0);
            }
        }
    }
    best
}

/// Unit vectors around the axis.
fn directions() -> &'static [[f64; 2]; DIRS] {
    static TABLE: std::sync::OnceLock<[[f64; 2]; DIRS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|k| {
            let (s, c) = (TAU * k as f64 / DIRS as f64).sin_cos();
            [c, s]
        })
    })
}

/// The stations on the upper convex hull of `height` over them.
fn upper_hull(stations: &[usize], height: impl Fn(usize) -> f64) -> Vec<usize> {
    let mut hull: Vec<usize> = Vec::new();
    for &i in stations {
        while let [.., a, b] = hull[..] {
            let run = |p: usize, q: usize| (q - p) as f64;
            let below = (height(b) - height(a)) * run(a, i) <= (height(i) - height(a)) * run(a, b);
            if !below {
                break;
            }
            hull.pop();
        }
        hull.push(i);
    }
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges of an upright cone frustum: radius from 0.1 m at the bottom to 0.2 m at 1 m.
    fn cone() -> Vec<[DVec3; 2]> {
        (0..360)
            .map(|k| {
                let (s, c) = f64::from(k).to_radians().sin_cos();
                [
                    DVec3::new(0.1 * s, 0.0, 0.1 * c),
                    DVec3::new(0.2 * s, 1.0, 0.2 * c),
                ]
            })
            .collect()
    }

    fn upright() -> Axis {
        Axis::new(DVec3::ZERO, DVec3::Y, DVec3::Z)
    }

    #[test]
    fn the_tape_reads_the_girth_of_a_circle() {
        let tube = Tube::measure(upright(), (0.0, 1.0), &cone());
        assert!((tube.girth(0) - TAU * 0.1).abs() < 1e-4);
        assert!((tube.largest_girth(0.0, 1.0) - TAU * 0.2).abs() < 1e-3);
    }

    #[test]
    fn cloth_dropped_from_the_widest_place_hangs_straight() {
        let mut tube = Tube::measure(upright(), (0.0, 1.0), &cone());
        tube.drop_to(0, 0.0, 1.0);
        tube.bridge(0.0, 1.0);
        for i in 0..tube.len() {
            assert!((tube.girth(i) - TAU * 0.2).abs() < 1e-3, "station {i}");
        }
    }

    #[test]
    fn distance_to_a_cone_is_signed_and_its_gradient_points_out() {
        let tube = Tube::measure(upright(), (0.0, 1.0), &cone());
        let p = DVec3::new(0.0, 0.5, 0.2);
        let (d, g) = tube.distance(p);
        let exact = 0.05 / (1.0f64 + 0.01).sqrt();
        assert!((d - exact).abs() < 1e-4, "{d} against {exact}");
        assert!((g.length() - 1.0).abs() < 1e-9 && g.z > 0.9 && g.y < 0.0);
        assert!(tube.distance(DVec3::new(0.0, 0.5, 0.1)).0 < 0.0);
    }
}
