//! The four edits of a sheet of triangles.

use super::Remeshed;
use super::place::{Place, Reference};
use crate::{Mesh, vertex_normals};
use glam::DVec3;
use std::collections::HashMap;

/// Triangles in the making.
pub(super) struct Sheet<'a> {
    reference: &'a Reference<'a>,
    x: Vec<DVec3>,
    place: Vec<Place>,
    faces: Vec<[u32; 3]>,
}

/// An edge with the faces beside it.
#[derive(Clone, Copy)]
struct Edge {
    ends: [u32; 2],
    faces: [u32; 2],
}

const NONE: u32 = u32::MAX;

impl<'a> Sheet<'a> {
    pub fn new(reference: &'a Reference<'a>) -> Sheet<'a> {
        let mut new = vec![NONE; reference.mesh.verts.len()];
        let mut sheet = Sheet {
            reference,
            x: vec![],
            place: vec![],
            faces: vec![],
        };
        for f in &reference.mesh.faces {
            for &i in f {
                if new[i as usize] == NONE {
                    let place = reference.of_vertex(i).expect("a face uses this vertex");
                    new[i as usize] = sheet.add(place);
                }
            }
            sheet.faces.push(f.map(|i| new[i as usize]));
        }
        sheet
    }

    pub fn finish(self) -> Remeshed {
        let origin = self.place.iter().map(|p| p.at).collect();
        Remeshed {
            mesh: Mesh {
                verts: self.x,
                faces: self.faces,
            },
            origin,
        }
    }

    fn add(&mut self, place: Place) -> u32 {
        self.x.push(self.reference.point(&place.at));
        self.place.push(place);
        self.x.len() as u32 - 1
    }

    /// Cuts every edge longer than `limit` [m] in two.
    pub fn split(&mut self, limit: f64) {
        let edges = edges(&self.faces);
        let mut middle = HashMap::new();
        for e in &edges {
            if self.length(e.ends) > limit {
                let place = self.between(e);
                middle.insert(e.ends, self.add(place));
            }
        }
        let mut faces = Vec::with_capacity(self.faces.len() * 2);
        for f in &self.faces {
            let mids = [0, 1, 2].map(|k| middle.get(&key(f[k], f[(k + 1) % 3])).copied());
            split_face(*f, mids, &self.x, &mut faces);
        }
        self.faces = faces;
    }

    /// The place of an edge's midpoint.
    fn between(&self, e: &Edge) -> Place {
        let [a, b] = e.ends.map(|i| i as usize);
        let mut from = self.place[a];
        if e.faces[1] != NONE {
            from.rim = None;
        }
        self.reference.nearest(&from, (self.x[a] + self.x[b]) * 0.5)
    }

    /// Merges the ends of edges shorter than `limit` [m] where the surface allows it.
    pub fn collapse(&mut self, limit: f64) {
        let ring = ring_faces(&self.faces, self.x.len());
        let mut short: Vec<Edge> = edges(&self.faces)
            .into_iter()
            .filter(|e| self.length(e.ends) < limit)
            .collect();
        short.sort_by(|a, b| self.length(a.ends).total_cmp(&self.length(b.ends)));
        let mut locked = vec![false; self.x.len()];
        let mut gone = vec![false; self.faces.len()];
        for e in short {
            if e.ends.iter().any(|&i| locked[i as usize]) {
                continue;
            }
            let Some((keep, drop, place)) = self.merged(&e, &ring, limit * 5.0 / 3.0) else {
                continue;
            };
            for t in ring[keep as usize].iter().chain(&ring[drop as usize]) {
                self.faces[*t as usize]
                    .iter()
                    .for_each(|&i| locked[i as usize] = true);
            }
            e.faces
                .iter()
                .filter(|t| **t != NONE)
                .for_each(|&t| gone[t as usize] = true);
            for t in &ring[drop as usize] {
                self.faces[*t as usize]
                    .iter_mut()
                    .filter(|i| **i == drop)
                    .for_each(|i| *i = keep);
            }
            self.x[keep as usize] = self.reference.point(&place.at);
            self.place[keep as usize] = place;
        }
        let mut t = 0;
        self.faces.retain(|_| {
            t += 1;
            !gone[t - 1]
        });
        self.compact();
    }

    /// Which end stays, which goes, and where the one that stays ends up.
    fn merged(&self, e: &Edge, ring: &[Vec<u32>], limit: f64) -> Option<(u32, u32, Place)> {
        let on_rim = e.ends.map(|i| self.place[i as usize].rim.is_some());
        let rim_edge = e.faces[1] == NONE;
        if on_rim == [true, true] && !rim_edge {
            return None;
        }
        let [keep, drop] = if on_rim[1] {
            [e.ends[1], e.ends[0]]
        } else {
            e.ends
        };
        let place = if on_rim[0] != on_rim[1] {
            self.place[keep as usize]
        } else {
            self.between(e)
        };
        let fits = self.link_is_simple(e, ring, rim_edge)
            && self.stays_flat([keep, drop], self.reference.point(&place.at), ring, limit);
        fits.then_some((keep, drop, place))
    }

    /// Whether the ends share no neighbours but those across the edge.
    fn link_is_simple(&self, e: &Edge, ring: &[Vec<u32>], rim_edge: bool) -> bool {
        let [mut a, b] = e.ends.map(|i| self.neighbours(i, ring));
        a.retain(|i| b.contains(i));
        let tiny = ring[e.ends[0] as usize].len() + ring[e.ends[1] as usize].len() < 6;
        a.len() == if rim_edge { 1 } else { 2 } && !tiny
    }

    fn neighbours(&self, i: u32, ring: &[Vec<u32>]) -> Vec<u32> {
        let faces = ring[i as usize].iter();
        let mut all: Vec<u32> = faces.flat_map(|&t| self.faces[t as usize]).collect();
        all.sort_unstable();
        all.dedup();
        all.retain(|&j| j != i);
        all
    }

    /// Whether the faces around a merged edge keep their side, some area, and short edges.
    fn stays_flat(&self, ends: [u32; 2], to: DVec3, ring: &[Vec<u32>], limit: f64) -> bool {
        ends.iter().flat_map(|&i| &ring[i as usize]).all(|&t| {
            let f = self.faces[t as usize];
            if ends.iter().all(|i| f.contains(i)) {
                return true;
            }
            let old = f.map(|i| self.x[i as usize]);
            let new = f.map(|i| {
                if ends.contains(&i) {
                    to
                } else {
                    self.x[i as usize]
                }
            });
            let (n, m) = (normal(old), normal(new));
            let long = (0..3).any(|k| (new[k] - new[(k + 1) % 3]).length() > limit);
            let upright = n.dot(m) > 0.5 * n.length() * m.length() || n.length() < 1e-12;
            upright && !long && m.length() > 0.0
        })
    }

    /// Turns edges where that brings vertices nearer to six neighbours (four on a rim).
    pub fn flip_for_valence(&mut self) {
        let mut valence = vec![0i32; self.x.len()];
        for e in edges(&self.faces) {
            e.ends.iter().for_each(|&i| valence[i as usize] += 1);
        }
        let want: Vec<i32> = self
            .place
            .iter()
            .map(|p| if p.rim.is_some() { 4 } else { 6 })
            .collect();
        let off = |i: u32, by: i32| (valence[i as usize] + by - want[i as usize]).pow(2);
        self.flip(|_, [a, b], [c, d]| {
            let before = off(a, 0) + off(b, 0) + off(c, 0) + off(d, 0);
            off(a, -1) + off(b, -1) + off(c, 1) + off(d, 1) < before
        });
    }

    /// Turns edges that face angles of more than half a turn together.
    pub fn flip_for_angles(&mut self) {
        self.flip(|x, [a, b], [c, d]| {
            let angle = |i: u32| {
                let [p, q, r] = [a, b, i].map(|j| x[j as usize]);
                (p - r).angle_between(q - r)
            };
            angle(c) + angle(d) > std::f64::consts::PI + 1e-6
        });
    }

    /// Turns every inner edge that `gains`, as long as the surface stays unfolded.
    fn flip(&mut self, gains: impl Fn(&[DVec3], [u32; 2], [u32; 2]) -> bool) {
        let all = edges(&self.faces);
        let known: Vec<[u32; 2]> = all.iter().map(|e| e.ends).collect();
        let mut locked = vec![false; self.x.len()];
        for e in all.iter().filter(|e| e.faces[1] != NONE) {
            let [a, b] = e.ends;
            let tips = e.faces.map(|t| tip(self.faces[t as usize], e.ends));
            let four = [a, b, tips[0], tips[1]];
            let taken = known.binary_search(&key(tips[0], tips[1])).is_ok();
            if taken || four.iter().any(|&i| locked[i as usize]) {
                continue;
            }
            let Some(faces) = self.turned(e, tips) else {
                continue;
            };
            if gains(&self.x, e.ends, tips) {
                four.iter().for_each(|&i| locked[i as usize] = true);
                (
                    self.faces[e.faces[0] as usize],
                    self.faces[e.faces[1] as usize],
                ) = (faces[0], faces[1]);
            }
        }
    }

    /// The two faces after a turn; none if they would fold or vanish.
    fn turned(&self, e: &Edge, [c, d]: [u32; 2]) -> Option<[[u32; 3]; 2]> {
        let f = self.faces[e.faces[0] as usize];
        let k = f.iter().position(|i| *i == c).expect("the tip is a corner");
        let (p, q) = (f[(k + 1) % 3], f[(k + 2) % 3]);
        let new = [[c, p, d], [d, q, c]];
        let at = |g: [u32; 3]| normal(g.map(|i| self.x[i as usize]));
        let old = e.faces.map(|t| at(self.faces[t as usize]));
        let up = (old[0] + old[1]).normalize_or_zero();
        let area = old[0].length() + old[1].length();
        let ok = new.iter().all(|&g| at(g).dot(up) > 0.05 * area);
        ok.then_some(new)
    }

    /// Moves vertices towards the middle of their neighbours, along the surface.
    pub fn slide(&mut self, times: usize) {
        let edges = edges(&self.faces);
        for _ in 0..times {
            let goals = self.goals(&edges);
            let normals = vertex_normals(&self.x, &self.faces);
            for i in 0..self.x.len() {
                let mut step = (goals[i] - self.x[i]) * 0.7;
                if self.place[i].rim.is_none() {
                    step -= normals[i] * step.dot(normals[i]);
                }
                let place = self.reference.nearest(&self.place[i], self.x[i] + step);
                self.x[i] = self.reference.point(&place.at);
                self.place[i] = place;
            }
        }
    }

    /// The mean of each vertex's neighbours; on a rim, of its two neighbours there.
    fn goals(&self, edges: &[Edge]) -> Vec<DVec3> {
        let mut sum = vec![(DVec3::ZERO, 0.0); self.x.len()];
        for e in edges {
            let [a, b] = e.ends.map(|i| i as usize);
            for (i, j) in [(a, b), (b, a)] {
                if self.place[i].rim.is_none() || e.faces[1] == NONE {
                    sum[i].0 += self.x[j];
                    sum[i].1 += 1.0;
                }
            }
        }
        sum.iter()
            .zip(&self.x)
            .map(|(s, x)| if s.1 > 0.0 { s.0 / s.1 } else { *x })
            .collect()
    }

    fn length(&self, [a, b]: [u32; 2]) -> f64 {
        (self.x[a as usize] - self.x[b as usize]).length()
    }

    /// Forgets vertices without a face.
    fn compact(&mut self) {
        let mut new = vec![NONE; self.x.len()];
        self.faces
            .iter()
            .flatten()
            .for_each(|&i| new[i as usize] = 0);
        let mut n = 0;
        for i in 0..new.len() {
            if new[i] != NONE {
                (self.x[n], self.place[n], new[i]) = (self.x[i], self.place[i], n as u32);
                n += 1;
            }
        }
        self.x.truncate(n);
        self.place.truncate(n);
        self.faces
            .iter_mut()
            .flatten()
            .for_each(|i| *i = new[*i as usize]);
    }
}

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn key(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn tip(f: [u32; 3], ends: [u32; 2]) -> u32 {
    f.into_iter()
        .find(|i| !ends.contains(i))
        .expect("a face has a third corner")
}

/// Every edge once, in ascending order.
fn edges(faces: &[[u32; 3]]) -> Vec<Edge> {
    let (starts, mut sides) = sides(faces);
    let mut all: Vec<Edge> = Vec::with_capacity(sides.len() / 2 + 1);
    for (first, bin) in starts.windows(2).enumerate() {
        let bin = &mut sides[bin[0] as usize..bin[1] as usize];
        bin.sort_unstable();
        for &[second, face] in &*bin {
            let ends = [first as u32, second];
            match all.last_mut() {
                Some(e) if e.ends == ends => e.faces[1] = face,
                _ => all.push(Edge {
                    ends,
                    faces: [face, NONE],
                }),
            }
        }
    }
    all
}

/// The faces' sides as (higher end, face), gathered by their lower end: where each end's
/// start, and the sides. Many short sorts then cost less than a long one.
fn sides(faces: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 2]>) {
    let keys = |f: [u32; 3]| [0, 1, 2].map(|k| key(f[k], f[(k + 1) % 3]));
    let n_verts = faces.iter().flatten().max().map_or(0, |&i| i as usize + 1);
    let mut starts = vec![0u32; n_verts + 1];
    for [low, _] in faces.iter().flat_map(|&f| keys(f)) {
        starts[low as usize + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut next = starts.clone();
    let mut sides = vec![[0; 2]; faces.len() * 3];
    for (t, &f) in faces.iter().enumerate() {
        for [low, high] in keys(f) {
            sides[next[low as usize] as usize] = [high, t as u32];
            next[low as usize] += 1;
        }
    }
    (starts, sides)
}

fn ring_faces(faces: &[[u32; 3]], n_verts: usize) -> Vec<Vec<u32>> {
    let mut ring = vec![Vec::new(); n_verts];
    for (t, f) in faces.iter().enumerate() {
        f.iter().for_each(|&i| ring[i as usize].push(t as u32));
    }
    ring
}

/// A face with some edges cut in the middle, as one to four faces.
fn split_face(f: [u32; 3], mids: [Option<u32>; 3], x: &[DVec3], out: &mut Vec<[u32; 3]>) {
    let turn = |k: usize| {
        (
            [f[k], f[(k + 1) % 3], f[(k + 2) % 3]],
            [mids[k], mids[(k + 1) % 3], mids[(k + 2) % 3]],
        )
    };
    match mids {
        [None, None, None] => out.push(f),
        [Some(m), Some(n), Some(o)] => {
            out.extend([[f[0], m, o], [m, f[1], n], [o, n, f[2]], [m, n, o]]);
        }
        _ => {
            // Turn so that the first edge is cut and, with two cuts, the last is not.
            let k = (0..3)
                .find(|&k| mids[k].is_some() && mids[(k + 2) % 3].is_none())
                .expect("one or two of three are cut");
            match turn(k) {
                ([a, b, c], [Some(m), Some(n), _]) => {
                    out.push([m, b, n]);
                    let d = |i: u32, j: u32| (x[i as usize] - x[j as usize]).length();
                    if d(a, n) < d(m, c) {
                        out.extend([[a, m, n], [a, n, c]]);
                    } else {
                        out.extend([[a, m, c], [m, n, c]]);
                    }
                }
                ([a, b, c], [Some(m), ..]) => out.extend([[a, m, c], [m, b, c]]),
                _ => unreachable!("the first edge is cut"),
            }
        }
    }
}
