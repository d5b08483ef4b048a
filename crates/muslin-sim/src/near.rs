//! Which pieces of cloth are near which: the list that contact and the safe step share.
//!
//! The list is kept by pairs of regions of the cloth. Every pair of regions knows how far apart
//! whatever its part of the list leaves out was, and when; that shrinks by what the one region does
//! as seen from the other. Only pairs of regions that have come to the end of it are searched
//! again, a few in a step: the folds that form, the sleeve that meets the side.

use glam::{DVec3, Vec3A};
use muslin_energy::proximity;
use muslin_geom::{
    Aabb, Swept,
    closest::{on_segments, on_triangle},
};
use rayon::prelude::*;

use crate::{
    ordered,
    quality::percentile,
    region::{gap, shift},
    safe::make_safe,
    weave::Weave,
};

/// Two features that may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Near {
    /// A vertex and a triangle, or two edges.
    pub verts: [u32; 4],
    pub is_edges: bool,
}

impl Near {
    /// The gap between the two at `x` [m], and its weights.
    pub fn gap(&self, x: &[DVec3]) -> (DVec3, [f64; 4]) {
        let at = self.verts.map(|v| x[v as usize]);
        let weights = self.weights(&at);
        (proximity::weighted(&at, &weights), weights)
    }

    /// The weights of the gap between the two whose vertices are `at` [m].
    pub fn weights(&self, at: &[DVec3; 4]) -> [f64; 4] {
        match self.is_edges {
            true => proximity::edge_edge(at),
            false => proximity::vertex_triangle(at),
        }
    }

    /// Whether the way between the two at `x` [m], which is along `way`, is the way from the one sheet to the other:
    /// upright on the triangle, or on both edges, which cross.
    pub fn is_upright(&self, x: &[DVec3], way: DVec3) -> bool {
        let [a, b, c, d] = self.verts.map(|v| x[v as usize]);
        let [e, f] = match self.is_edges {
            true => [b - a, d - c],
            false => [c - b, d - b],
        };
        let across = e.normalize_or_zero().cross(f.normalize_or_zero());
        across.length() > CROSSING && across.normalize().dot(way).abs() > UPRIGHT
    }
}

/// Sine of the angle at which edges cross at least, cosine of that by which an upright way leans at most.
const CROSSING: f64 = 0.3;
const UPRIGHT: f64 = 1.0 - 1e-6;
/// Slack of the list [m].
const SLACK: f64 = 1.5e-3;
/// Whoever stays farther apart than this does not meet [m].
const TOUCHING: f64 = 5e-4;
/// Regions farther apart than this are not looked at one by one [m].
const FAR: f64 = 0.05;
/// Places that pairs of regions may have been looked at, before the oldest is given up.
const PLACES: usize = 4;
/// Looks at a move that keeps changing.
const LOOKS: usize = 8;

/// All pairs of features that may touch.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    pub list: Vec<Near>,
    pairs: Vec<Pair>,
    /// Positions that pairs of regions were looked at [m], the latest last.
    places: Vec<Vec<DVec3>>,
    /// Positions where all others were at least so far apart [m].
    beyond: (Vec<DVec3>, f64),
    /// Positions at which all pairs of regions were last seen to hold everything within so much [m].
    held: (Vec<DVec3>, f64),
}

/// Two regions, or one twice, and what is near between them.
#[derive(Clone, Debug)]
struct Pair {
    regions: [u32; 2],
    /// The place it was looked at.
    place: usize,
    /// How far apart was there, at least, whatever is not in the list [m].
    clear: f64,
    list: Vec<Near>,
}

/// Straight ways of all vertices: from where, and by how much [m].
type Ways<'a> = (&'a [DVec3], &'a [DVec3]);

impl Neighbours {
    /// Makes the list hold every pair that is within `distance` [m] at `x`. Vertices that are
    /// `tangled` have passed through each other already.
    pub fn look(&mut self, (weave, tangled): (&Weave, &[bool]), x: &[DVec3], distance: f64) {
        let stale = self.unless_held(weave, x, distance);
        if !self.apart(x, distance) || !stale.is_empty() {
            let still = vec![DVec3::ZERO; x.len()];
            self.renew(weave, (x, &still), (stale, distance));
            self.gather(tangled);
        }
        self.held = (x.to_vec(), distance);
    }

    /// [`Neighbours::stale`], but where it is known already that none is.
    fn unless_held(&self, weave: &Weave, x: &[DVec3], distance: f64) -> Vec<usize> {
        match distance <= self.held.1 && self.held.0 == x {
            true => Vec::new(),
            false => self.stale(weave, x, distance),
        }
    }

    /// Changes `moves` [m] from `x` [m] until no cloth passes through itself on the way; whether it `slides` on where it
    /// is stopped.
    ///
    /// A changed move may lead to other pairs than those looked at, so it is looked at again; one
    /// that keeps changing is brought nearer to what all of the cloth does, in the end to just that.
    pub fn lead(
        &mut self,
        (weave, tangled): (&Weave, &[bool]),
        x: &[DVec3],
        moves: &mut [DVec3],
        slides: bool,
    ) {
        let mean = moves.iter().sum::<DVec3>() / moves.len() as f64;
        // Between two places that the list covers it covers every place: distances shrink by what
        // pairs go against each other, and that is linear in time.
        let mut stale = self.unless_held(weave, x, TOUCHING);
        for look in 0..LOOKS {
            if look + 1 == LOOKS {
                moves.fill(mean);
            } else if look >= LOOKS / 2 {
                moves.iter_mut().for_each(|m| *m = m.lerp(mean, 0.5));
            }
            let there = sum(x, moves);
            // Whoever may push there is wanted as well, so that it need not be looked for again.
            stale.extend(self.stale(weave, &there, weave.radius));
            let mut within = weave.radius;
            if !stale.is_empty() || !self.apart(x, TOUCHING) || !self.apart(&there, TOUCHING) {
                if self.renew(weave, (x, moves), (std::mem::take(&mut stale), TOUCHING)) {
                    within = TOUCHING;
                }
                self.gather(tangled);
            }
            if !make_safe(&self.list, x, moves, slides) {
                self.held = (there, within);
                return;
            }
            let there = sum(x, moves);
            stale = self.stale(weave, &there, TOUCHING);
            if stale.is_empty() && self.apart(&there, TOUCHING) {
                self.held = (there, TOUCHING);
                return;
            }
        }
    }

    /// How far 98 % of the pairs in the list move at most, as seen from the one side, by these moves from `x` [m]; no end
    /// where nobody has looked there.
    pub fn drift(&self, x: &[DVec3], moves: &[DVec3]) -> f64 {
        if self.held.0 != x {
            return f64::INFINITY;
        }
        let mut drifts = ordered::map(self.list.len(), |k| {
            let weights = self.list[k].gap(x).1;
            let way = self.list[k].verts.map(|v| moves[v as usize]);
            proximity::weighted(&way, &weights).length()
        });
        percentile(&mut drifts, 0.98)
    }

    /// Whether regions that are no pair are more than `distance` [m] apart at `x`.
    fn apart(&self, x: &[DVec3], distance: f64) -> bool {
        let (at, far) = &self.beyond;
        at.len() == x.len() && {
            let gone: Vec<DVec3> = x.iter().zip(at).map(|(x, at)| *x - *at).collect();
            spread(&gone) <= far - distance
        }
    }

    /// Pairs of regions of which something that is not in the list may be within `distance` [m] at
    /// `x`.
    fn stale(&self, weave: &Weave, x: &[DVec3], distance: f64) -> Vec<usize> {
        let places = self.places.iter();
        let gone = places.map(|at| weave.regions.boxes(|v| x[v] - at[v]));
        let gone: Vec<Vec<Aabb>> = gone.collect();
        let holds = |p: &Pair| {
            let [a, b] = p.regions.map(|r| &gone[p.place][r as usize]);
            shift(a, b) <= p.clear - distance
        };
        let pairs = self.pairs.iter().enumerate();
        pairs.filter(|p| !holds(p.1)).map(|p| p.0).collect()
    }

    /// Looks again at pairs of regions for all that may come near on the way; the answer is for
    /// where it leads. Where regions may be near that are no pair, finds all pairs first, and says so: those are
    /// then looked at for what is within `distance` [m] alone.
    fn renew(
        &mut self,
        weave: &Weave,
        (x, moves): Ways<'_>,
        (mut stale, distance): (Vec<usize>, f64),
    ) -> bool {
        self.held.0.clear();
        let there = sum(x, moves);
        let boxes = weave.regions.boxes(|v| there[v]);
        let steps = weave.regions.boxes(|v| moves[v]);
        self.places.push(there);
        let there = &self.places[self.places.len() - 1];
        let anew = !self.apart(x, distance) || !self.apart(there, distance);
        if anew {
            let far = FAR + spread(moves);
            self.beyond = (there.clone(), far);
            self.pair_up(&boxes, far);
            stale = self.stale(weave, x, distance);
            stale.extend(self.stale(weave, &self.beyond.0, distance));
        }
        stale.sort_unstable();
        stale.dedup();
        let reach = weave.radius + SLACK;
        let scene = Scene::new(
            weave,
            (x, moves),
            reach,
            stale.iter().flat_map(|k| self.pairs[*k].regions),
        );
        let look = |k: &usize| {
            let [a, b] = self.pairs[*k].regions.map(|r| r as usize);
            let apart = gap(&boxes[a], &boxes[b]);
            if apart - shift(&steps[a], &steps[b]) > reach {
                (apart, Vec::new())
            } else {
                (reach, scene.search(a, b))
            }
        };
        let found: Vec<(f64, Vec<Near>)> = stale.par_iter().map(look).collect();
        let place = self.places.len() - 1;
        for (k, (clear, list)) in stale.into_iter().zip(found) {
            let regions = self.pairs[k].regions;
            self.pairs[k] = Pair {
                regions,
                place,
                clear,
                list,
            };
        }
        if self.places.len() > PLACES {
            self.give_up_oldest(weave);
        }
        anew
    }

    /// Every two regions whose `boxes`, at the latest place, are within `far` [m].
    fn pair_up(&mut self, boxes: &[Aabb], far: f64) {
        let rows = ordered::map(boxes.len(), |a| {
            let others = (a..boxes.len()).map(|b| (b, gap(&boxes[a], &boxes[b])));
            others.filter(|o| o.1 <= far).collect::<Vec<_>>()
        });
        let place = self.places.len() - 1;
        let mut known = std::mem::take(&mut self.pairs).into_iter().peekable();
        for (a, (b, clear)) in (0..)
            .zip(rows)
            .flat_map(|(a, row)| row.into_iter().map(move |o| (a, o)))
        {
            let regions = [a, b as u32];
            while known.next_if(|p| p.regions < regions).is_some() {}
            let pair = known.next_if(|p| p.regions == regions);
            self.pairs.push(pair.unwrap_or(Pair {
                regions,
                place,
                clear,
                list: Vec::new(),
            }));
        }
    }

    /// Whoever was looked at in the first place counts from the last one on.
    fn give_up_oldest(&mut self, weave: &Weave) {
        let last = self.places.len() - 1;
        let (from, to) = (&self.places[0], &self.places[last]);
        let gone = weave.regions.boxes(|v| to[v] - from[v]);
        for pair in &mut self.pairs {
            if pair.place == 0 {
                let [a, b] = pair.regions.map(|r| &gone[r as usize]);
                pair.clear -= shift(a, b);
                pair.place = last;
            }
            pair.place -= 1;
        }
        self.places.remove(0);
    }

    /// Makes the list anew of what the pairs of regions know, without what has passed through each
    /// other already.
    pub fn gather(&mut self, tangled: &[bool]) {
        let free = |n: &&Near| !n.verts.iter().all(|v| tangled[*v as usize]);
        let all = self.pairs.iter().flat_map(|p| &p.list);
        self.list = all.filter(free).copied().collect();
    }
}

/// Where everything is after its move [m].
pub(crate) fn sum(x: &[DVec3], moves: &[DVec3]) -> Vec<DVec3> {
    x.iter().zip(moves).map(|(x, m)| *x + *m).collect()
}

/// The most that two of these differ by, axis by axis [m].
fn spread(moves: &[DVec3]) -> f64 {
    let all = Aabb::of(moves);
    shift(&all, &all)
}

/// A face's number, and its way.
type Face = (usize, Swept);

/// Where everything is and goes, and what is asked about two regions.
struct Scene<'a> {
    weave: &'a Weave,
    x: &'a [DVec3],
    moves: &'a [DVec3],
    reach: f64,
    verts: Vec<Swept>,
    /// The faces of the regions that are asked about, and all of a region together.
    regions: Vec<Option<(Vec<Face>, Swept)>>,
    /// Positions as seen from the first vertex, in single precision [m].
    at: Vec<Vec3A>,
    /// Vertices whose faces cannot come near each other.
    open: Vec<bool>,
}

impl<'a> Scene<'a> {
    /// `regions`: those that will be asked about.
    fn new(
        weave: &'a Weave,
        (x, moves): Ways<'a>,
        reach: f64,
        regions: impl Iterator<Item = u32>,
    ) -> Scene<'a> {
        let mut asked = (vec![false; x.len()], vec![false; weave.regions.len()]);
        for r in regions.map(|r| r as usize) {
            let verts = weave.regions.verts(r).iter();
            verts.for_each(|v| asked.0[*v as usize] = true);
            asked.1[r] = true;
        }
        let verts = ordered::map(x.len(), |i| Swept::point(x[i] - x[0], moves[i], reach));
        let faces = |r: usize| {
            let faces = weave.regions.faces(r).iter().map(|f| *f as usize);
            let faces = faces.map(|f| (f, around(&verts, &weave.faces[f])));
            let faces: Vec<Face> = faces.collect();
            let whole = faces.iter().map(|f| f.1).reduce(Swept::union)?;
            Some((faces, whole))
        };
        let numbers = (0..asked.1.len()).into_par_iter();
        let at = ordered::map(x.len(), |i| (x[i] - x[0]).as_vec3a());
        let ways: Vec<Vec3A> = moves.iter().map(|m| m.as_vec3a()).collect();
        let room = reach as f32 + ROUNDING;
        Scene {
            regions: numbers
                .map(|r| asked.1[r].then(|| faces(r)).flatten())
                .collect(),
            open: weave.fans.open((&at, &ways), (room, &asked.0)),
            at,
            verts,
            weave,
            x,
            moves,
            reach,
        }
    }

    /// Pairs of features of two regions, or within one, that may come within reach.
    fn search(&self, a: usize, b: usize) -> Vec<Near> {
        let mut out = Vec::new();
        let (Some((mine, here)), Some((theirs, there))) = (&self.regions[a], &self.regions[b])
        else {
            return out;
        };
        if a == b {
            for (k, f) in mine.iter().enumerate() {
                let rest = mine[k + 1..].iter();
                rest.filter(|g| f.1.meets(&g.1))
                    .for_each(|g| self.faces_near(f, g, &mut out));
            }
            return out;
        }
        let theirs: Vec<&Face> = theirs.iter().filter(|g| g.1.meets(here)).collect();
        for f in mine.iter().filter(|f| f.1.meets(there)) {
            let meeting = theirs.iter().filter(|g| f.1.meets(&g.1));
            meeting.for_each(|g| self.faces_near(f, g, &mut out));
        }
        out
    }

    /// Adds the pairs of features of two faces that may come within reach.
    fn faces_near(&self, f: &Face, g: &Face, out: &mut Vec<Near>) {
        let (f, g) = if f.0 < g.0 { (f, g) } else { (g, f) };
        let (mine, theirs) = (self.weave.faces[f.0], self.weave.faces[g.0]);
        let mut shared = mine.into_iter().filter(|v| theirs.contains(v)).peekable();
        let apart = match shared.peek() {
            Some(_) => shared.any(|v| self.open[v as usize]),
            None => self.parted((mine, theirs), self.reach as f32 + f.1.drift(&g.1)),
        };
        if apart {
            return;
        }
        self.vertices(f.0, g, out);
        self.vertices(g.0, f, out);
        let mut ways = [([0; 2], f.1); 3];
        let mut n = 0;
        for ends in self.edges(g.0) {
            let way = around(&self.verts, &ends);
            if way.meets(&f.1) {
                ways[n] = (ends, way);
                n += 1;
            }
        }
        if n == 0 {
            return;
        }
        for [a, b] in self.edges(f.0) {
            let way = around(&self.verts, &[a, b]);
            for ([c, d], other) in &ways[..n] {
                let apart = a != *c && a != *d && b != *c && b != *d;
                if apart && way.meets(other) && self.edges_near([a, b, *c, *d]) {
                    out.push(Near {
                        verts: [a, b, *c, *d],
                        is_edges: true,
                    });
                }
            }
        }
    }

    /// Whether a slab so thick [m] lies between two triangles, across the way between their middles.
    fn parted(&self, (f, g): ([u32; 3], [u32; 3]), room: f32) -> bool {
        let [f, g] = [f, g].map(|t| t.map(|v| self.at[v as usize]));
        let axis = (g[0] + g[1] + g[2]) - (f[0] + f[1] + f[2]);
        let [mine, theirs] = [f, g].map(|t| t.map(|p| (p - f[0]).dot(axis)));
        let gap = theirs[0].min(theirs[1]).min(theirs[2]) - mine[0].max(mine[1]).max(mine[2]);
        let room = room + ROUNDING;
        gap > 0.0 && gap * gap > room * room * axis.length_squared()
    }

    /// Adds the vertices of face `f` that may come near face `g`.
    fn vertices(&self, f: usize, g: &Face, out: &mut Vec<Near>) {
        let t = self.weave.faces[g.0];
        for v in self.weave.owned[f].verts {
            if v == u32::MAX || t.contains(&v) {
                continue;
            }
            if self.verts[v as usize].meets(&g.1) && self.vertex_near(v, t) {
                out.push(Near {
                    verts: [v, t[0], t[1], t[2]],
                    is_edges: false,
                });
            }
        }
    }

    /// The edges that face `f` answers for.
    fn edges(&self, f: usize) -> impl Iterator<Item = [u32; 2]> {
        let owned = self.weave.owned[f].edges.into_iter();
        let edges = owned.filter(|e| *e != u32::MAX);
        edges.map(|e| self.weave.edges[e as usize])
    }

    /// Largest of the relative moves of two vertices, squared [m²].
    fn drift(&self, a: u32, b: u32) -> f64 {
        self.moves[a as usize].distance_squared(self.moves[b as usize])
    }

    fn vertex_near(&self, v: u32, t: [u32; 3]) -> bool {
        let p = self.x[v as usize];
        let drift = t.map(|c| self.drift(v, c)).into_iter().fold(0.0, f64::max);
        let reach = self.reach + drift.sqrt();
        let t = t.map(|i| self.x[i as usize]);
        on_triangle(p, &t).point.distance_squared(p) <= reach * reach
    }

    fn edges_near(&self, v: [u32; 4]) -> bool {
        let [a, b, c, d] = v;
        let drift = [(a, c), (a, d), (b, c), (b, d)].map(|(i, j)| self.drift(i, j));
        let reach = self.reach + drift.into_iter().fold(0.0, f64::max).sqrt();
        let [a, b, c, d] = v.map(|i| self.x[i as usize]);
        on_segments([a, b], [c, d]).distance <= reach
    }
}

/// What single precision leaves open a few metres from the first vertex [m].
const ROUNDING: f32 = 4e-6;

/// All of these vertices, and their ways.
fn around(ways: &[Swept], verts: &[u32]) -> Swept {
    let ways = verts.iter().map(|i| ways[*i as usize]);
    ways.reduce(Swept::union).expect("features have vertices")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::testing::sheets;

    /// Everything within `distance` [m], asked one by one.
    fn all_near(weave: &Weave, x: &[DVec3], distance: f64) -> Vec<([u32; 4], bool)> {
        let p = |v: u32| x[v as usize];
        let mut out = Vec::new();
        for t in &weave.faces {
            for v in (0..x.len() as u32).filter(|v| !t.contains(v)) {
                if on_triangle(p(v), &t.map(p)).point.distance(p(v)) < distance {
                    out.push(([v, t[0], t[1], t[2]], false));
                }
            }
        }
        for (k, [a, b]) in weave.edges.iter().enumerate() {
            for [c, d] in &weave.edges[k + 1..] {
                let apart = a != c && a != d && b != c && b != d;
                if apart && on_segments([p(*a), p(*b)], [p(*c), p(*d)]).distance < distance {
                    out.push(([*a, *b, *c, *d], true));
                }
            }
        }
        out
    }

    /// Everything near at `x` must be in the list; how much that was.
    fn holds(near: &mut Neighbours, weave: &Weave, x: &[DVec3]) -> usize {
        near.look((weave, &vec![false; x.len()]), x, weave.radius);
        let both = |n: &Near| {
            let [a, b, c, d] = n.verts;
            let turned = if n.is_edges { [c, d, a, b] } else { n.verts };
            [(n.verts, n.is_edges), (turned, n.is_edges)]
        };
        let set: BTreeSet<_> = near.list.iter().flat_map(both).collect();
        let all = all_near(weave, x, weave.radius);
        for pair in &all {
            assert!(set.contains(pair), "{pair:?} is missing");
        }
        all.len()
    }

    /// Moves the cloth by what `by` says of a step, a vertex and where it is, for so many steps; how
    /// many were near, all told.
    fn moved(apart: f64, steps: usize, by: impl Fn(usize, usize, DVec3) -> DVec3) -> usize {
        let (cloth, mut x) = sheets(apart);
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let mut near = Neighbours::default();
        let mut met = 0;
        for step in 0..steps {
            let mut moves: Vec<DVec3> =
                x.iter().enumerate().map(|(v, p)| by(step, v, *p)).collect();
            near.lead((&weave, &vec![false; x.len()]), &x, &mut moves, true);
            x = sum(&x, &moves);
            met += holds(&mut near, &weave, &x);
        }
        met
    }

    #[test]
    fn whoever_is_near_is_in_the_list_however_the_cloth_got_there() {
        // The sheets fold up, are pressed together, turn, and fly.
        let met = moved(0.012, 40, |step, v, p| {
            let t = 0.2 * step as f64;
            let wave = DVec3::Z * (0.004 * (90.0 * p.x + 50.0 * p.y + 3.0 * t).sin());
            let press = DVec3::Z * if v < 144 { 0.0015 } else { -0.0015 };
            wave + press + DVec3::new(0.3, -0.1, 0.2) + p.cross(DVec3::Y) * 0.05
        });
        assert!(met > 100, "{met}");
    }

    #[test]
    fn what_comes_near_slowly_from_afar_is_found_while_others_are_busy() {
        // One sheet comes down from 8 cm; a corner of the other flutters, and is looked at each time.
        let met = moved(0.08, 60, |step, v, _| {
            let flutter = if step % 2 == 0 { 0.006 } else { -0.006 };
            match v {
                0 | 1 | 12 => DVec3::Z * -flutter,
                144.. if step < 50 => DVec3::Z * -0.0016,
                _ => DVec3::ZERO,
            }
        });
        assert!(met > 100, "{met}");
    }
}
