//! Settling: a garment's mesh slid evenly over its form.

use crate::fitting::mean_edge;
use crate::form::{Form, Near};
use glam::DVec3;
use muslin_geom::{Mesh, self_intersections};
use rayon::prelude::*;

/// Who neighbours whom, and which vertices are on which rim.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Net {
    pub faces: Vec<[u32; 3]>,
    neighbours: Vec<Vec<u32>>,
    /// Previous and next along the rim, and the rim's number.
    rim: Vec<Option<([u32; 2], usize)>>,
    /// The rims, each a closed loop of vertices.
    pub loops: Vec<Vec<u32>>,
}

/// Where a rim has to stay.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Track {
    /// In the plane through a point [m] across a unit direction.
    Plane(DVec3, DVec3),
    /// Where it is, apart from sliding along itself.
    Free,
}

/// How many times as long as asked cloth is slid where it stays squeezed.
const PARTS: usize = 6;

/// Where more than one of so many triangles is squeezed, it is slid anew, firmly: on a tube a few triangles wide, as around a
/// wrist, a gap of more than a right angle in a ring of vertices grows, for chords pull less than what is around.
const MANY: usize = 50;

/// How vertices go to the middle of their neighbours: which share of the way, and whether longer edges pull harder.
#[derive(Clone, Copy, Debug)]
struct Slide {
    share: f64,
    firm: bool,
}

const LOOSELY: Slide = Slide {
    share: 0.8,
    firm: false,
};
const FIRMLY: Slide = Slide {
    share: 0.3,
    firm: true,
};
const STILL: Slide = Slide {
    share: 0.0,
    firm: false,
};

/// How often cloth that crosses itself is spread anew, how far around the place [m], as much more each
/// time, and how often each vertex goes to the middle of its neighbours.
const SPREADS: usize = 4;
const FILM: f64 = 0.05;
const SPREAD: usize = 100;
/// Slides in which it comes back to the form, and how far in each [m]: at full steps it crosses itself
/// where the form is hollow.
const BACK: usize = 60;
const GENTLY: f64 = 0.002;

impl Net {
    pub fn new(faces: Vec<[u32; 3]>, n_verts: usize) -> Net {
        let mut neighbours = vec![Vec::new(); n_verts];
        let mut half: Vec<(u32, u32)> = Vec::with_capacity(faces.len() * 3);
        for f in &faces {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                neighbours[a as usize].push(b);
                neighbours[b as usize].push(a);
                half.push((a, b));
            }
        }
        for n in &mut neighbours {
            n.sort_unstable();
            n.dedup();
        }
        half.sort_unstable();
        let open = half
            .iter()
            .filter(|(a, b)| half.binary_search(&(*b, *a)).is_err());
        let loops = chains(open.copied().collect());
        let mut rim = vec![None; n_verts];
        for (l, ring) in loops.iter().enumerate() {
            for (k, &i) in ring.iter().enumerate() {
                let n = ring.len();
                rim[i as usize] = Some(([ring[(k + n - 1) % n], ring[(k + 1) % n]], l));
            }
        }
        Net {
            faces,
            neighbours,
            rim,
            loops,
        }
    }

    /// Which vertices are on a rim.
    pub fn on_rim(&self) -> Vec<bool> {
        self.rim.iter().map(Option::is_some).collect()
    }

    /// Slides `x` [m] over `form` until the triangles are even, `times` times.
    ///
    /// Where a fold of the body squeezed them it goes on as long as that helps, and where it left them
    /// crossing they are drawn out of it, as a film would span the place, and led back slowly.
    /// `tracks` has one entry per loop.
    pub fn settle(&self, form: &Form, x: &mut [DVec3], tracks: &[Track], times: usize) {
        let (start, mut near) = (x.to_vec(), vec![Near::default(); x.len()]);
        let squeezed = self.even_out(form, x, (tracks, times), (&mut near, LOOSELY));
        if squeezed > self.faces.len() / MANY {
            let mut other = start;
            near.fill(Near::default());
            self.even_out(form, &mut other, (tracks, times), (&mut near, FIRMLY));
            if self.crossing(&other).len() < self.crossing(x).len() {
                x.copy_from_slice(&other);
            }
            near.fill(Near::default());
        }
        self.land(form, x, tracks, &mut near);
        let mut crossing = self.crossing(x);
        for again in 1..=SPREADS {
            if crossing.is_empty() {
                break;
            }
            let mut other = x.to_vec();
            self.spread(&mut other, &crossing, again as f64 * FILM);
            self.lead_back(form, &mut other, &mut near, again);
            self.land(form, &mut other, tracks, &mut near);
            let left = self.crossing(&other);
            let even = self.squeezed(&other) <= self.squeezed(x).max(self.faces.len() / 500);
            if left.len() < crossing.len() && even {
                x.copy_from_slice(&other);
                crossing = left;
            }
        }
    }

    /// Slides as [`Net::settle`] does, `times` times at once; says how many triangles are squeezed in the end.
    fn even_out(
        &self,
        form: &Form,
        x: &mut [DVec3],
        (tracks, times): (&[Track], usize),
        (near, slide): (&mut [Near], Slide),
    ) -> usize {
        let mut squeezed = usize::MAX;
        for part in 0..PARTS {
            for round in 0..times {
                let steps = if part + round < 2 { 8 } else { 1 };
                self.round(form, x, tracks, near, (slide, steps));
            }
            let now = self.squeezed(x);
            if now <= self.faces.len() / 1500 || now >= squeezed {
                return now;
            }
            squeezed = now;
        }
        squeezed
    }

    /// Brings the mesh onto the form where it is.
    fn land(&self, form: &Form, x: &mut [DVec3], tracks: &[Track], near: &mut [Near]) {
        for _ in 0..3 {
            self.round(form, x, tracks, near, (STILL, 8));
        }
    }

    /// One slide of all vertices by a share of the way to evenness, and Newton steps back.
    fn round(
        &self,
        form: &Form,
        x: &mut [DVec3],
        tracks: &[Track],
        near: &mut [Near],
        (slide, steps): (Slide, usize),
    ) {
        let old = &*x;
        let mut new = old.to_vec();
        new.par_iter_mut()
            .zip(near)
            .enumerate()
            .for_each(|(i, (p, near))| {
                let step = match slide.firm {
                    true => self.firm_step(i, old),
                    false => self.step(i, old),
                };
                *p += step * slide.share;
                *p = match self.rim[i].map(|r| tracks[r.1]) {
                    None | Some(Track::Free) => form.project(*p, steps, near),
                    Some(Track::Plane(at, across)) => {
                        let flat = *p - across * (*p - at).dot(across);
                        form.project_within(flat, steps, near, |v| v - across * v.dot(across))
                    }
                };
            });
        x.copy_from_slice(&new);
    }

    /// Leads the mesh back to the form, so many times as slowly, and slides it along it only.
    fn lead_back(&self, form: &Form, x: &mut [DVec3], near: &mut [Near], slow: usize) {
        near.fill(Near::default());
        let most = GENTLY / slow as f64;
        for _ in 0..slow * BACK {
            let old = &*x;
            let mut new = old.to_vec();
            let inner = |i: &usize| self.rim[*i].is_none();
            new.par_iter_mut()
                .zip(&mut *near)
                .enumerate()
                .filter(|(i, _)| inner(i))
                .for_each(|(i, (p, near))| {
                    let out = form.normal(*p, near).unwrap_or(DVec3::ZERO);
                    let slide = self.step(i, old);
                    let home = form.project(*p, 1, near) - *p;
                    *p += home.clamp_length_max(most);
                    *p += 0.5 * (slide - out * out.dot(slide));
                });
            x.copy_from_slice(&new);
        }
    }

    /// Triangles that cross others, in pairs.
    fn crossing(&self, x: &[DVec3]) -> Vec<[u32; 2]> {
        self_intersections(&Mesh {
            verts: x.to_vec(),
            faces: self.faces.clone(),
        })
    }

    /// Draws the mesh tight within so many metres of these triangles.
    fn spread(&self, x: &mut [DVec3], crossing: &[[u32; 2]], reach: f64) {
        let mut loose = vec![false; x.len()];
        for i in (crossing.as_flattened().iter()).flat_map(|f| self.faces[*f as usize]) {
            loose[i as usize] = true;
        }
        let edge = mean_edge(x, &self.faces);
        for _ in 0..(reach / edge.max(1e-4)).ceil() as usize {
            let inner = loose.clone();
            for (i, _) in inner.iter().enumerate().filter(|(_, l)| **l) {
                self.neighbours[i]
                    .iter()
                    .for_each(|j| loose[*j as usize] = true);
            }
        }
        let free = |i: &usize| loose[*i] && self.rim[*i].is_none();
        let free: Vec<usize> = (0..x.len()).filter(free).collect();
        for _ in 0..SPREAD {
            for &i in &free {
                x[i] += self.step(i, x);
            }
        }
    }

    /// How many triangles have an angle below 15 degrees.
    fn squeezed(&self, x: &[DVec3]) -> usize {
        let sharp = |f: &&[u32; 3]| {
            let p = f.map(|i| x[i as usize]);
            (0..3).any(|k| {
                let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                a.cross(b).length() < a.dot(b) * 0.268
            })
        };
        self.faces.iter().filter(sharp).count()
    }

    /// Towards the middle of the neighbours; on a rim, along it.
    ///
    /// Steps across the surface are left in: projection undoes them where the mesh lies well,
    /// and where a fold of the body has squeezed it they are what opens it.
    fn step(&self, i: usize, x: &[DVec3]) -> DVec3 {
        if let Some(([p, n], _)) = self.rim[i] {
            let (p, n) = (x[p as usize], x[n as usize]);
            let along = (n - p).normalize_or_zero();
            return along * along.dot((p + n) * 0.5 - x[i]);
        }
        let ring = &self.neighbours[i];
        let sum: DVec3 = ring.iter().map(|&j| x[j as usize]).sum();
        sum / ring.len().max(1) as f64 - x[i]
    }

    /// As [`Net::step`], but that longer edges pull harder, so that no gap opens in a ring of few.
    fn firm_step(&self, i: usize, x: &[DVec3]) -> DVec3 {
        if self.rim[i].is_some() {
            return self.step(i, x);
        }
        let all = self.neighbours[i].iter().map(|&j| x[j as usize] - x[i]);
        let (sum, weight) = all.fold((DVec3::ZERO, 1e-12), |(sum, weight), d| {
            (sum + d * d.length(), weight + d.length())
        });
        sum / weight
    }

    /// Rounds off the rims that are not cut by a plane, without shrinking them.
    ///
    /// Taubin's two-step smoothing (1995) along each loop.
    pub fn round_rims(&self, x: &mut [DVec3], times: usize) {
        for ring in &self.loops {
            for step in 0..2 * times {
                let by = if step % 2 == 0 { 0.5 } else { -0.526 };
                let old: Vec<DVec3> = ring.iter().map(|&i| x[i as usize]).collect();
                let n = ring.len();
                for (k, &i) in ring.iter().enumerate() {
                    let middle = (old[(k + n - 1) % n] + old[(k + 1) % n]) * 0.5;
                    x[i as usize] += (middle - old[k]) * by;
                }
            }
        }
    }
}

/// Joins directed edges into closed loops, in the order of their smallest vertex.
fn chains(mut open: Vec<(u32, u32)>) -> Vec<Vec<u32>> {
    open.sort_unstable();
    let mut used = vec![false; open.len()];
    let mut loops = Vec::new();
    for start in 0..open.len() {
        let (mut ring, mut at) = (Vec::new(), start);
        while !used[at] {
            used[at] = true;
            ring.push(open[at].0);
            match open.binary_search_by_key(&open[at].1, |e| e.0) {
                Ok(next) => at = next,
                Err(_) => break,
            }
        }
        if !ring.is_empty() {
            loops.push(ring);
        }
    }
    loops
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_has_two_rims() {
        let n = 8u32;
        let mut faces = Vec::new();
        for k in 0..n {
            let (a, b) = (k, (k + 1) % n);
            faces.extend([[a, b, b + n], [a, b + n, a + n]]);
        }
        let net = Net::new(faces, 2 * n as usize);
        assert_eq!(net.loops.iter().map(Vec::len).collect::<Vec<_>>(), [8, 8]);
        assert!(net.on_rim().iter().all(|r| *r));
    }
}
