//! Fill: an outline in the plane filled with near-equilateral triangles.
//!
//! The outline's points are kept exactly, none is added between them, so that two outlines that
//! will be sewn together still match. Inside, a hexagonal lattice is laid, joined by a
//! constrained Delaunay triangulation (ears first, then Lawson's flips), and smoothed. Every sign
//! is decided by exact predicates, in a fixed order.

use glam::DVec2;
use robust::{Coord, incircle, orient2d};

/// A filled outline.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filled {
    /// Points [m]: those of the outline first, in their order.
    pub verts: Vec<DVec2>,
    /// Triangles that turn the way the outline runs.
    pub faces: Vec<[u32; 3]>,
}

/// Why an outline could not be filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FillError {
    /// Two sides of the outline cross or touch: those that start at these points.
    Crossing(usize, usize),
    /// No area, or a point that is not finite.
    Flat,
}

impl std::fmt::Display for FillError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Crossing(i, j) => write!(f, "the outline crosses itself at points {i} and {j}"),
            Self::Flat => f.write_str("the outline encloses nothing"),
        }
    }
}

impl std::error::Error for FillError {}

/// Fills `outline` (a closed loop, either way around) with edges of about `edge` [m].
pub fn fill(outline: &[DVec2], edge: f64) -> Result<Filled, FillError> {
    let area = twice_area(outline);
    if outline.len() < 3 || !area.is_finite() || area == 0.0 {
        return Err(FillError::Flat);
    }
    if let Some((i, j)) = crossing(outline) {
        return Err(FillError::Crossing(i, j));
    }
    // Clockwise outlines are filled in the mirror.
    let mirror = DVec2::new(area.signum(), 1.0);
    let own: Vec<DVec2> = outline.iter().map(|p| *p * mirror).collect();
    let mut net = Net::of_ears(&own).ok_or(FillError::Flat)?;
    net.flip_all();
    for p in lattice(&own, edge) {
        net.insert(p);
    }
    net.smooth(own.len(), 6);
    Ok(Filled {
        verts: net.x.iter().map(|p| *p * mirror).collect(),
        faces: net.faces,
    })
}

fn twice_area(p: &[DVec2]) -> f64 {
    let n = p.len();
    (0..n).map(|i| p[i].perp_dot(p[(i + 1) % n])).sum()
}

fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| Coord { x: p.x, y: p.y });
    orient2d(a, b, c)
}

/// The first two sides, by their starts, that share more than the corner between neighbours.
fn crossing(p: &[DVec2]) -> Option<(usize, usize)> {
    let n = p.len();
    let side = |i: usize| [p[i], p[(i + 1) % n]];
    for i in 0..n {
        let [a, b] = side(i);
        let (low, high) = (a.min(b), a.max(b));
        let j = (i + 1) % n;
        let back = turn(a, b, p[(j + 1) % n]) == 0.0 && (b - a).dot(p[(j + 1) % n] - b) <= 0.0;
        if back || a == b {
            return Some((i, j));
        }
        for j in i + 2..n {
            if i == 0 && j == n - 1 {
                continue;
            }
            let [c, d] = side(j);
            let apart = c.min(d).cmpgt(high).any() || c.max(d).cmplt(low).any();
            if !apart
                && turn(a, b, c) * turn(a, b, d) <= 0.0
                && turn(c, d, a) * turn(c, d, b) <= 0.0
            {
                return Some((i, j));
            }
        }
    }
    None
}

/// A lattice point this close to the outline, in edges, is left out.
const MARGIN: f64 = 0.62;

/// Points of a hexagonal lattice well inside a counter-clockwise outline.
fn lattice(outline: &[DVec2], edge: f64) -> Vec<DVec2> {
    let low = outline.iter().fold(DVec2::MAX, |a, b| a.min(*b));
    let high = outline.iter().fold(DVec2::MIN, |a, b| a.max(*b));
    let rise = edge * 0.75f64.sqrt();
    let (rows, across) = ((high.y - low.y) / rise, (high.x - low.x) / edge);
    let mut points = Vec::new();
    for r in 0..rows.ceil() as usize + 1 {
        let y = low.y + rise * (r as f64 + 0.37);
        let inset = if r % 2 == 0 { 0.13 } else { 0.63 };
        // Where the row runs inside.
        let mut cuts: Vec<f64> = crossings_at(outline, y);
        cuts.sort_unstable_by(f64::total_cmp);
        for k in 0..across.ceil() as usize + 1 {
            let p = DVec2::new(low.x + edge * (k as f64 + inset), y);
            let inside = cuts.iter().filter(|c| **c < p.x).count() % 2 == 1;
            if inside && is_clear(outline, p, MARGIN * edge) {
                points.push(p);
            }
        }
    }
    points
}

fn crossings_at(p: &[DVec2], y: f64) -> Vec<f64> {
    let n = p.len();
    let cut = |i: usize| {
        let (a, b) = (p[i], p[(i + 1) % n]);
        ((a.y > y) != (b.y > y)).then(|| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y))
    };
    (0..n).filter_map(cut).collect()
}

fn is_clear(outline: &[DVec2], p: DVec2, margin: f64) -> bool {
    let n = outline.len();
    (0..n).all(|i| {
        let (a, d) = (outline[i], outline[(i + 1) % n] - outline[i]);
        let t = ((p - a).dot(d) / d.length_squared()).clamp(0.0, 1.0);
        (p - a - d * t).length_squared() > margin * margin
    })
}

const NONE: u32 = u32::MAX;

/// Triangles and who is across each side; `across[t][k]` lies beyond corners `k` and `k + 1`.
struct Net {
    x: Vec<DVec2>,
    faces: Vec<[u32; 3]>,
    across: Vec<[u32; 3]>,
    last: u32,
}

impl Net {
    /// Cuts ears off a simple counter-clockwise outline until nothing is left.
    fn of_ears(outline: &[DVec2]) -> Option<Net> {
        let mut ring: Vec<u32> = (0..outline.len() as u32).collect();
        let mut faces = Vec::with_capacity(outline.len());
        let mut at = 0;
        let mut tried = 0;
        while ring.len() > 3 {
            let n = ring.len();
            let ear = [at, at + 1, at + 2].map(|k| ring[k % n]);
            if is_ear(outline, &ring, ear) {
                faces.push(ear);
                ring.remove((at + 1) % n);
                tried = 0;
                // The next ear is looked for elsewhere, so that no fan of slivers grows.
                at = (at + 1) % ring.len();
            } else {
                tried += 1;
                at = (at + 1) % n;
            }
            if tried > ring.len() {
                return None;
            }
        }
        faces.push([ring[0], ring[1], ring[2]]);
        let across = neighbours(&faces);
        Some(Net {
            x: outline.to_vec(),
            faces,
            across,
            last: 0,
        })
    }

    fn corner(&self, t: u32, k: usize) -> DVec2 {
        self.x[self.faces[t as usize][k % 3] as usize]
    }

    /// Splits the triangle that holds `p`; a point on a side or outside is left out.
    fn insert(&mut self, p: DVec2) {
        let Some(t) = self.find(p) else { return };
        let ([a, b, c], old) = (self.faces[t as usize], self.across[t as usize]);
        let v = self.x.len() as u32;
        self.x.push(p);
        let (s, u) = (self.faces.len() as u32, self.faces.len() as u32 + 1);
        self.faces[t as usize] = [a, b, v];
        self.faces.extend([[b, c, v], [c, a, v]]);
        self.across[t as usize] = [old[0], s, u];
        self.across.extend([[old[1], u, t], [old[2], t, s]]);
        self.point_back(old[1], t, s);
        self.point_back(old[2], t, u);
        self.last = t;
        self.flip_from(vec![(t, 0), (s, 0), (u, 0)]);
    }

    /// `of` now borders `to` where it bordered `from`.
    fn point_back(&mut self, of: u32, from: u32, to: u32) {
        if of != NONE {
            let row = &mut self.across[of as usize];
            row.iter_mut().filter(|n| **n == from).for_each(|n| *n = to);
        }
    }

    fn find(&self, p: DVec2) -> Option<u32> {
        let mut t = self.last;
        for _ in 0..self.faces.len() {
            let out = (0..3).find(|&k| turn(self.corner(t, k), self.corner(t, k + 1), p) < 0.0);
            match out.map(|k| self.across[t as usize][k]) {
                None => break,
                Some(NONE) => return self.search(p),
                Some(n) => t = n,
            }
        }
        self.holds(t, p).then_some(t).or_else(|| self.search(p))
    }

    fn holds(&self, t: u32, p: DVec2) -> bool {
        (0..3).all(|k| turn(self.corner(t, k), self.corner(t, k + 1), p) > 0.0)
    }

    fn search(&self, p: DVec2) -> Option<u32> {
        (0..self.faces.len() as u32).find(|&t| self.holds(t, p))
    }

    fn flip_all(&mut self) {
        let n = self.faces.len() as u32;
        self.flip_from((0..n).flat_map(|t| [(t, 0), (t, 1), (t, 2)]).collect());
    }

    /// Flips sides until each is Delaunay, beginning with these.
    fn flip_from(&mut self, mut open: Vec<(u32, usize)>) {
        while let Some((t, k)) = open.pop() {
            let n = self.across[t as usize][k];
            if n == NONE {
                continue;
            }
            let m = (0..3)
                .find(|&m| {
                    self.across[n as usize][m] == t
                        && self.faces[n as usize][m] == self.faces[t as usize][(k + 1) % 3]
                })
                .expect("neighbours know each other");
            let [a, b, c, d] = [
                self.corner(t, k),
                self.corner(t, k + 1),
                self.corner(t, k + 2),
                self.corner(n, m + 2),
            ]
            .map(|p| Coord { x: p.x, y: p.y });
            if incircle(a, b, c, d) > 0.0 {
                self.flip((t, k), (n, m));
                open.extend([(t, 0), (t, 1), (n, 0), (n, 1)]);
            }
        }
    }

    /// Turns the side between two triangles.
    fn flip(&mut self, (t, k): (u32, usize), (n, m): (u32, usize)) {
        let (f, g) = (self.faces[t as usize], self.faces[n as usize]);
        let (p, q) = (self.across[t as usize], self.across[n as usize]);
        let [a, b, c] = [0, 1, 2].map(|i| f[(k + i) % 3]);
        let d = g[(m + 2) % 3];
        self.faces[t as usize] = [c, a, d];
        self.faces[n as usize] = [d, b, c];
        let (bc, ca) = (p[(k + 1) % 3], p[(k + 2) % 3]);
        let (ad, db) = (q[(m + 1) % 3], q[(m + 2) % 3]);
        self.across[t as usize] = [ca, ad, n];
        self.across[n as usize] = [db, bc, t];
        self.point_back(ad, n, t);
        self.point_back(bc, t, n);
    }

    /// Moves each inner point to the middle of its neighbours, where no triangle turns over.
    fn smooth(&mut self, first: usize, rounds: usize) {
        for _ in 0..rounds {
            let mut around = vec![Vec::new(); self.x.len()];
            for f in &self.faces {
                for k in 0..3 {
                    around[f[k] as usize].push([f[(k + 1) % 3], f[(k + 2) % 3]]);
                }
            }
            for i in first..self.x.len() {
                let sum: DVec2 = around[i].iter().map(|e| self.x[e[0] as usize]).sum();
                let to = sum / around[i].len() as f64;
                let stays =
                    |e: &[u32; 2]| turn(to, self.x[e[0] as usize], self.x[e[1] as usize]) > 0.0;
                if around[i].iter().all(stays) {
                    self.x[i] = to;
                }
            }
            self.flip_all();
        }
    }
}

fn is_ear(x: &[DVec2], ring: &[u32], ear: [u32; 3]) -> bool {
    let [a, b, c] = ear.map(|i| x[i as usize]);
    if turn(a, b, c) <= 0.0 {
        return false;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    ring.iter().all(|&i| {
        let p = x[i as usize];
        let apart = ear.contains(&i) || p.cmplt(low).any() || p.cmpgt(high).any();
        apart || turn(a, b, p) < 0.0 || turn(b, c, p) < 0.0 || turn(c, a, p) < 0.0
    })
}

fn neighbours(faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let sides = faces.iter().enumerate();
    let mut sides: Vec<([u32; 2], u32)> = sides
        .flat_map(|(t, f)| (0..3).map(move |k| ([f[k], f[(k + 1) % 3]], t as u32)))
        .collect();
    sides.sort_unstable();
    let other = |a: u32, b: u32| match sides.binary_search_by_key(&[b, a], |s| s.0) {
        Ok(at) => sides[at].1,
        Err(_) => NONE,
    };
    let row = |f: &[u32; 3]| [0, 1, 2].map(|k| other(f[k], f[(k + 1) % 3]));
    faces.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 20 cm with a notch like a dart, points every centimetre.
    fn notched() -> Vec<DVec2> {
        let corners = [
            (0.0, 0.0),
            (0.09, 0.0),
            (0.1, 0.08),
            (0.11, 0.0),
            (0.2, 0.0),
            (0.2, 0.2),
            (0.0, 0.2),
        ]
        .map(|(x, y)| DVec2::new(x, y));
        let mut out = Vec::new();
        for k in 0..corners.len() {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            let n = (a.distance(b) / 0.01).round().max(1.0);
            out.extend((0..n as usize).map(|i| a.lerp(b, i as f64 / n)));
        }
        out
    }

    fn area(filled: &Filled) -> f64 {
        let one = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|i| filled.verts[i as usize]);
            0.5 * (b - a).perp_dot(c - a)
        };
        assert!(filled.faces.iter().all(|f| one(f) != 0.0));
        filled.faces.iter().map(one).sum()
    }

    #[test]
    fn a_notched_square_is_filled_evenly_and_its_outline_kept() {
        let outline = notched();
        let filled = fill(&outline, 0.01).expect("simple");
        assert_eq!(filled.verts[..outline.len()], outline[..]);
        assert!((area(&filled) - (0.04 - 0.5 * 0.02 * 0.08)).abs() < 1e-12);
        // Euler: one piece without holes.
        let sides = (3 * filled.faces.len() + outline.len()) / 2;
        assert_eq!(filled.verts.len() + filled.faces.len() - sides, 1);
        let angle = |f: &[u32; 3]| {
            let p = f.map(|i| filled.verts[i as usize]);
            let at = |k: usize| {
                let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                u.angle_to(v).abs()
            };
            at(0).min(at(1)).min(at(2)).to_degrees()
        };
        let mut angles: Vec<f64> = filled.faces.iter().map(angle).collect();
        angles.sort_unstable_by(f64::total_cmp);
        assert!(angles[0] > 12.0, "worst {}", angles[0]);
        assert!(
            angles[angles.len() / 2] > 48.0,
            "median {}",
            angles[angles.len() / 2]
        );
    }

    #[test]
    fn a_clockwise_outline_gives_clockwise_triangles() {
        let mut outline = notched();
        outline.reverse();
        let filled = fill(&outline, 0.01).expect("simple");
        assert!((area(&filled) + (0.04 - 0.5 * 0.02 * 0.08)).abs() < 1e-12);
        assert_eq!(filled.verts[..outline.len()], outline[..]);
    }

    #[test]
    fn outlines_that_cross_touch_or_enclose_nothing_are_refused() {
        let p = |list: &[(f64, f64)]| -> Vec<DVec2> {
            list.iter().map(|&(x, y)| DVec2::new(x, y)).collect()
        };
        let bow = p(&[(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 2.0)]);
        assert_eq!(fill(&bow, 0.1), Err(FillError::Crossing(0, 2)));
        let touch = p(&[(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 0.0), (0.0, 1.0)]);
        assert!(matches!(fill(&touch, 0.1), Err(FillError::Crossing(..))));
        let back = p(&[(0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0)]);
        assert!(matches!(fill(&back, 0.1), Err(FillError::Crossing(..))));
        assert_eq!(
            fill(&p(&[(0.0, 0.0), (1.0, 1.0)]), 0.1),
            Err(FillError::Flat)
        );
        let nan = p(&[(0.0, 0.0), (1.0, f64::NAN), (1.0, 1.0)]);
        assert_eq!(fill(&nan, 0.1), Err(FillError::Flat));
    }

    #[test]
    fn a_sliver_without_room_inside_is_still_filled() {
        let thin: Vec<DVec2> = (0..20)
            .map(|i| DVec2::new(0.01 * f64::from(i), 0.0))
            .chain((0..20).rev().map(|i| DVec2::new(0.01 * f64::from(i), 1e-3)))
            .collect();
        let filled = fill(&thin, 0.01).expect("simple");
        assert_eq!((filled.verts.len(), filled.faces.len()), (40, 38));
    }
}
