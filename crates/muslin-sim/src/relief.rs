//! Flesh gives way: a posed body that folds into itself is pressed apart, to leave room for cloth.
//!
//! Skinned bodies pass through themselves at armpits, crotch and knees, and a hand on a hip is
//! a little inside it. No cloth could lie there. Real flesh yields: both sides draw back, the
//! thicker part more, until a gap stays between them, and the skin around follows smoothly. What
//! is too deep for that is left as it is, and said.
//!
//! The way back lies between straight in and towards the core of the limb: in a deep fold normals
//! alone cross each other, so that a dent would turn itself inside out.

use std::sync::OnceLock;

use glam::DVec3;
use muslin_geom::{Aabb, Bvh, Surface, closest::Crossing};

use crate::{
    cloth::{SimError, finite, same},
    ordered,
    pattern::{Pattern, Rows},
};

/// A body in one pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Vertices of the skin [m].
    pub skin: Vec<DVec3>,
    /// For every vertex a point inside, where its flesh gives way to [m]; none at all: straight in.
    pub cores: Vec<DVec3>,
}

impl Frame {
    /// Whether it has `n` vertices, all finite, and as many cores or none.
    pub(crate) fn check(&self, n: usize) -> Result<(), SimError> {
        same("body frame", self.skin.len(), n)?;
        finite("body vertex", &self.skin)?;
        if !self.cores.is_empty() {
            same("cores", self.cores.len(), n)?;
        }
        finite("core", &self.cores)
    }
}

impl From<Vec<DVec3>> for Frame {
    /// Skin whose flesh gives way straight in.
    fn from(skin: Vec<DVec3>) -> Frame {
        Frame {
            skin,
            cores: Vec::new(),
        }
    }
}

/// A body with room for cloth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Relief {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// How far the skin drew back, at most [m].
    pub deepest: f64,
    /// Vertices that drew back by more than a tenth of a millimetre.
    pub moved: usize,
    /// Vertices that are still inside another part of the body.
    pub left: usize,
}

/// Rounds of drawing back; each sees where the last one led.
const ROUNDS: usize = 4;
/// Largest share of a part's thickness that yields on one side.
const YIELD: f64 = 0.35;
/// Parts thinner than this, as a hand, do not yield: what they press on does [m].
const THIN: f64 = 0.05;
/// Flesh that is as far from its core is soft [m].
pub(crate) const SOFT: f64 = 0.5 * THIN;
/// How far a part is looked for [m].
const FAR: f64 = 0.35;
/// Share of the way to its core that a place can give at most.
const INWARD: f64 = 0.8;
/// Deeper than this no flesh yields [m].
const DEEPEST: f64 = 0.08;
/// Skin that was this near at rest is one fold, not two parts [m].
const SAME: f64 = 0.025;
/// Rounds of spreading a dent, and what is left of it from one vertex to the next.
const SPREAD: usize = 12;
const FADE: f64 = 0.85;

/// What a body's flesh is at rest, where its parts are apart and thickness can be told.
pub struct Flesh {
    rest: Surface,
    near: Rows,
    /// How thick the body is behind each vertex [m], as far as anybody asked.
    thickness: Vec<OnceLock<f64>>,
}

impl Flesh {
    /// `rest`: vertices [m] of outward triangles.
    pub fn new(rest: &[DVec3], faces: &[[u32; 3]]) -> Flesh {
        Flesh {
            rest: Surface::new(rest, faces),
            near: Pattern::new(rest.len(), faces).near,
            thickness: vec![OnceLock::new(); rest.len()],
        }
    }

    /// The skin at rest.
    pub fn rest(&self) -> &Surface {
        &self.rest
    }

    /// Presses a posed body apart where it folds into itself.
    ///
    /// `gap`: room to leave between two parts of the skin [m]. Only vertices that `wanted` names
    /// may move.
    pub fn relieve(&self, posed: &Frame, gap: f64, wanted: &[bool]) -> Relief {
        let mut fold = Fold::new(self, posed);
        let mut left = 0;
        let mut asked = wanted.to_vec();
        for _ in 0..ROUNDS {
            let needs = fold.needs(gap, &asked);
            left = needs.iter().filter(|n| n.inside).count();
            if needs.iter().all(|n| n.depth <= 0.0) {
                break;
            }
            let moved = fold.draw_back(&needs, wanted);
            // Skin only ever draws back: who neither needed to nor did has no more to fear than before.
            for (i, asked) in asked.iter_mut().enumerate() {
                *asked &= moved[i] || needs[i].inside || needs[i].depth > 0.0;
            }
        }
        let verts = fold.now.verts();
        let moves = verts.iter().zip(&posed.skin).map(|(a, b)| a.distance(*b));
        let moves: Vec<f64> = moves.collect();
        Relief {
            deepest: moves.iter().copied().fold(0.0, f64::max),
            moved: moves.iter().filter(|m| **m > 1e-4).count(),
            verts: verts.to_vec(),
            left,
        }
    }

    fn thickness(&self, i: usize) -> f64 {
        *self.thickness[i].get_or_init(|| thickness(&self.rest, i))
    }
}

/// The path of a body that gives way: nothing changes but where skin would press on skin.
///
/// The first and the last frame are relieved; between them dents grow and fade. `near`: skin vertices that cloth is worn on; whatever comes within `around` [m]
/// of them may yield too.
pub(crate) fn relieve_path(
    path: &[Frame],
    faces: &[[u32; 3]],
    (near, around): (&[bool], f64),
    gap: f64,
) -> (Vec<Vec<DVec3>>, Relief) {
    let (first, last) = (&path[0], &path[path.len() - 1]);
    let flesh = Flesh::new(&first.skin, faces);
    let end = |frame: &Frame| {
        let wanted = within(&frame.skin, near, around);
        flesh.relieve(frame, gap, &wanted)
    };
    let (from, to) = (end(first), end(last));
    let depth = |relief: &Relief, f: &Frame, i: usize| relief.verts[i].distance(f.skin[i]);
    let n = (path.len() - 1).max(1);
    let between = |(k, frame): (usize, &Frame)| {
        let t = k as f64 / n as f64;
        let normals = muslin_geom::vertex_normals(&frame.skin, faces);
        let given = |i: usize| {
            let d = depth(&from, first, i) * (1.0 - t) + depth(&to, last, i) * t;
            given(frame.skin[i], normals[i], (frame.cores.get(i), d))
        };
        ordered::map(frame.skin.len(), given)
    };
    let mut out: Vec<Vec<DVec3>> = path.iter().enumerate().map(between).collect();
    out[0].clone_from(&from.verts);
    let end = out.len() - 1;
    out[end].clone_from(&to.verts);
    (out, to)
}

/// Where skin at `p` [m] with this `normal` ends when it gives by `depth` [m].
pub(crate) fn given(p: DVec3, normal: DVec3, (core, depth): (Option<&DVec3>, f64)) -> DVec3 {
    let Some(core) = core else {
        return p - normal * depth;
    };
    let way = *core - p;
    let inward = (way.normalize_or_zero() - normal).normalize_or_zero();
    p + inward * depth.min(INWARD * way.length())
}

/// Vertices within `around` [m] of those that `near` names.
pub(crate) fn within(x: &[DVec3], near: &[bool], around: f64) -> Vec<bool> {
    let points: Vec<DVec3> = x.iter().zip(near).filter(|p| *p.1).map(|p| *p.0).collect();
    let boxes: Vec<Aabb> = points.iter().map(|p| Aabb::of(&[*p])).collect();
    let tree = Bvh::over(&boxes);
    let distance = |p: DVec3| {
        tree.nearest(p, around * around, |k| {
            points[k as usize].distance_squared(p)
        })
    };
    ordered::map(x.len(), |i| near[i] || distance(x[i]).is_some())
}

/// A posed body that is being pressed apart.
struct Fold<'a> {
    flesh: &'a Flesh,
    cores: &'a [DVec3],
    now: Surface,
    drawn: Vec<f64>,
}

/// What a vertex needs: how far to draw back [m], and whether it is inside another part.
#[derive(Clone, Copy, Debug, Default)]
struct Need {
    depth: f64,
    inside: bool,
}

impl<'a> Fold<'a> {
    fn new(flesh: &'a Flesh, posed: &'a Frame) -> Fold<'a> {
        Fold {
            flesh,
            cores: &posed.cores,
            drawn: vec![0.0; posed.skin.len()],
            now: flesh.rest.moved(&posed.skin),
        }
    }

    fn needs(&self, gap: f64, wanted: &[bool]) -> Vec<Need> {
        ordered::map(wanted.len(), |i| {
            if wanted[i] {
                self.need(i, gap)
            } else {
                Need::default()
            }
        })
    }

    fn need(&self, i: usize, gap: f64) -> Need {
        let normal = self.now.vertex_normal(i as u32);
        let start = self.now.verts()[i];
        let ahead = self.first(i, start, normal * FAR, |_| true);
        // Whoever leaves another part by going outward from his own skin is inside it.
        let inside = ahead.is_some_and(|c| c.leaves);
        let (face, depth) = if inside {
            // The other part's skin lies behind: leave it by going back through it.
            match self.first(i, start, normal * -FAR, |c| c.leaves) {
                Some(c) => (c.face, c.at * FAR + gap),
                None => return Need { depth: 0.0, inside },
            }
        } else {
            match ahead {
                Some(c) => (c.face, gap - c.at * FAR),
                None => return Need::default(),
            }
        };
        if depth <= 0.0 || depth > DEEPEST {
            return Need { depth: 0.0, inside };
        }
        let mine = self.flesh.thickness(i);
        let theirs = self.now.faces()[face as usize].map(|v| self.flesh.thickness(v as usize));
        let theirs = theirs.into_iter().fold(0.0, f64::max);
        let room = (YIELD * mine - self.drawn[i]).max(0.0);
        Need {
            depth: (depth * share(mine, theirs)).min(room),
            inside,
        }
    }

    /// The first crossing of another part on the way `d` [m] from `p`.
    fn first(
        &self,
        i: usize,
        p: DVec3,
        d: DVec3,
        counts: impl Fn(&Crossing) -> bool,
    ) -> Option<Crossing> {
        let mut best: Option<Crossing> = None;
        self.now.along(p, d, |c| {
            let apart = || {
                let f = self.now.faces()[c.face as usize];
                let rest = self.flesh.rest.verts();
                f.iter().all(|&v| rest[v as usize].distance(rest[i]) > SAME)
            };
            if counts(&c) && best.is_none_or(|b| c.at < b.at) && apart() {
                best = Some(c);
            }
        });
        best
    }

    /// Moves the skin back by what it needs, and its surroundings along; says who moved.
    fn draw_back(&mut self, needs: &[Need], wanted: &[bool]) -> Vec<bool> {
        let depth: Vec<f64> = needs.iter().map(|n| n.depth).collect();
        let flesh = (self.cores, &self.flesh.near);
        let verts = dented(&self.now, flesh, depth, |i| wanted[i]);
        let moves = self.now.verts().iter().zip(&verts);
        let moves: Vec<f64> = moves.map(|(a, b)| a.distance(*b)).collect();
        let drawn = self.drawn.iter_mut().zip(&moves);
        drawn.for_each(|(drawn, m)| *drawn += m);
        self.now.refit(&verts);
        moves.iter().map(|m| *m > 0.0).collect()
    }
}

/// The skin drawn back by at least `depth` [m], its surroundings smoothly along.
///
/// `cores`: as in [`Frame`]; `near`: the neighbours of every vertex.
pub(crate) fn dented(
    skin: &Surface,
    (cores, near): (&[DVec3], &Rows),
    depth: Vec<f64>,
    may_move: impl Fn(usize) -> bool + Sync + Send,
) -> Vec<DVec3> {
    let mut all = depth.clone();
    for _ in 0..SPREAD {
        all = ordered::map(depth.len(), |i| {
            let row = near.row(i);
            let mean = row.iter().map(|&j| all[j as usize]).sum::<f64>() / row.len() as f64;
            if may_move(i) {
                depth[i].max(FADE * mean)
            } else {
                0.0
            }
        });
    }
    let gives: Vec<bool> = all.iter().map(|depth| *depth > 0.0).collect();
    let normals = smooth_normals(skin, near, &gives);
    ordered::map(all.len(), |i| match gives[i] {
        true => given(skin.verts()[i], normals[i], (cores.get(i), all[i])),
        false => skin.verts()[i],
    })
}

/// What part of the room the flesh on this side gives, by the thickness of both [m].
fn share(mine: f64, theirs: f64) -> f64 {
    if mine < THIN {
        0.0
    } else if theirs < THIN {
        1.0
    } else {
        mine / (mine + theirs)
    }
}

/// How thick the body is behind a vertex [m].
fn thickness(skin: &Surface, i: usize) -> f64 {
    let d = skin.vertex_normal(i as u32) * -FAR;
    let mut best = 1.0f64;
    skin.along(skin.verts()[i] + d * 1e-3, d, |c| {
        if c.leaves {
            best = best.min(c.at);
        }
    });
    best * FAR
}

/// How deep the flesh behind a vertex is [m]: as far as to its core, or half as deep as the body is thick there. `cores`: as
/// in [`Frame`].
pub(crate) fn depth(skin: &Surface, cores: &[DVec3], i: usize) -> f64 {
    match cores.get(i) {
        Some(core) => core.distance(skin.verts()[i]),
        None => 0.5 * thickness(skin, i),
    }
}

/// Whether there is flesh behind a vertex that can yield. `cores`: as in [`Frame`].
pub(crate) fn is_soft(skin: &Surface, cores: &[DVec3], i: usize) -> bool {
    depth(skin, cores, i) >= SOFT
}

/// Normals of the vertices that are `asked`, averaged over two rings, so that neighbours draw back side by side; zero
/// elsewhere.
fn smooth_normals(skin: &Surface, near: &Rows, asked: &[bool]) -> Vec<DVec3> {
    let wider = |asked: &[bool]| {
        let mut wider = vec![false; asked.len()];
        let rows = (0..asked.len()).filter(|i| asked[*i]).map(|i| near.row(i));
        rows.flatten().for_each(|&j| wider[j as usize] = true);
        wider
    };
    let once = wider(asked);
    let twice = wider(&once);
    let among = |asked: &[bool], normal: &(dyn Fn(usize) -> DVec3 + Sync)| {
        ordered::map(asked.len(), |i| match asked[i] {
            true => normal(i),
            false => DVec3::ZERO,
        })
    };
    let mean = |of: &[DVec3], i: usize| {
        let row = near.row(i).iter().map(|&j| of[j as usize]);
        row.sum::<DVec3>().normalize_or_zero()
    };
    let own = among(&twice, &|i| skin.vertex_normal(i as u32));
    let smooth = among(&once, &|i| mean(&own, i));
    among(asked, &|i| mean(&smooth, i))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::balls;

    #[test]
    fn overlapping_balls_are_pressed_apart_evenly() {
        let (rest, faces) = balls(0.4);
        let (posed, _) = balls(0.17);
        let relief =
            Flesh::new(&rest, &faces).relieve(&posed.into(), 0.004, &vec![true; rest.len()]);
        assert_eq!(relief.left, 0);
        assert!(
            (0.015..0.03).contains(&relief.deepest),
            "{}",
            relief.deepest
        );
        let mesh = muslin_geom::Mesh {
            verts: relief.verts,
            faces,
        };
        assert!(muslin_geom::self_intersections(&mesh).is_empty());
    }

    #[test]
    fn flesh_gives_way_towards_its_core_and_never_past_it() {
        let (rest, faces) = balls(0.4);
        let (skin, _) = balls(0.15);
        let half = skin.len() / 2;
        let core = |i: usize| DVec3::X * if i < half { -0.075 } else { 0.075 };
        let posed = Frame {
            cores: (0..skin.len()).map(core).collect(),
            skin,
        };
        let relief = Flesh::new(&rest, &faces).relieve(&posed, 0.004, &vec![true; rest.len()]);
        assert_eq!(relief.left, 0);
        for i in 0..rest.len() {
            let (p, q) = (relief.verts[i] - core(i), posed.skin[i] - core(i));
            assert!(p.dot(q) > 0.19 * q.length_squared(), "{i} ends at {p}");
        }
        let way = |depth: f64| given(DVec3::X, DVec3::X, (Some(&DVec3::ZERO), depth));
        assert!((way(0.3) - DVec3::X * 0.7).length() < 1e-12);
        assert!((way(3.0) - DVec3::X * 0.2).length() < 1e-12);
    }

    #[test]
    fn a_body_with_room_is_left_alone() {
        let (rest, faces) = balls(0.4);
        let flesh = Flesh::new(&rest, &faces);
        let relief = flesh.relieve(&rest.clone().into(), 0.004, &vec![true; rest.len()]);
        assert_eq!((relief.moved, relief.left), (0, 0));
        assert_eq!(relief.verts, rest);
    }
}
