//! Predicted garments one over the other: each network knows its own garment on a bare body.

use glam::DVec3;
use muslin_garment::Garment;
use muslin_geom::{Surface, neighbours};
use rayon::prelude::*;

/// How cloth is led out of other cloth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lead {
    /// Room between two layers of cloth [m].
    room: f64,
    /// Deeper inside another garment than this cloth is elsewhere: a hem under a waistband, not a sleeve
    /// beside a hip [m].
    deep: f64,
    /// No triangle is lifted over another by more than this at once [m].
    lift: f64,
}

impl Lead {
    /// For garments that know nothing of each other.
    pub const STRANGE: Self = Self {
        room: 0.004,
        deep: 0.04,
        lift: 0.02,
    };
    /// For those that were taught to lie over each other, but not to swing: what is deeper than a swing is a fold, whose
    /// inside looks outwards, and leading cloth out of that tears it.
    pub const SWINGING: Self = Self {
        room: 0.001,
        deep: 0.012,
        lift: 0.006,
    };
}

/// Rounds of pushing out, and in each how often what is pushed takes its neighbours along.
const ROUNDS: usize = 8;
const SPREAD: usize = 6;
/// Where no vertex is pushed farther, all lie outside [m].
const DONE: f64 = 1e-4;

/// A garment that others lie over.
struct Under {
    surface: Surface,
    /// Which vertices are on an opening: which side one is on cannot be told there.
    rim: Vec<bool>,
}

impl Under {
    /// The garment at `x` [m].
    pub fn new(garment: &Garment, x: &[DVec3]) -> Self {
        let mut rim = vec![false; x.len()];
        let edges = garment.rims.iter().flat_map(|r| &r.verts);
        edges.for_each(|v| rim[*v as usize] = true);
        Self {
            surface: Surface::new(x, &garment.faces),
            rim,
        }
    }

    /// How a point gets outside, if it is within.
    fn push(&self, p: DVec3, lead: &Lead) -> Option<DVec3> {
        let hit = self.surface.closest(p, lead.deep)?;
        let face = self.surface.faces()[hit.face as usize];
        let lack = lead.room - hit.signed;
        let at_rim = face.iter().any(|v| self.rim[*v as usize]);
        (lack > 0.0 && !at_rim).then(|| hit.normal * lack)
    }

    /// How the corners of triangles outside that cross this garment get before what they cross.
    fn lifts(&self, outer: &Surface, lead: &Lead) -> Vec<Option<DVec3>> {
        let mut out: Vec<Option<DVec3>> = vec![None; outer.verts().len()];
        for [f, g] in outer.intersections(&self.surface) {
            let (face, here) = (outer.faces()[f as usize], outer.corners(f));
            let there = self.surface.corners(g);
            // Either the fold goes under this triangle, or the triangle over the plane of the fold.
            let up = (here[1] - here[0]).cross(here[2] - here[0]);
            let (up, away) = (up.normalize_or_zero(), self.surface.face_normal(g));
            let peak = there
                .map(|p| (p - here[0]).dot(up))
                .into_iter()
                .fold(0.0, f64::max);
            for (v, p) in face.into_iter().zip(here) {
                let lack = lead.room - (p - there[0]).dot(away);
                let way = if peak + lead.room < lack {
                    up * (peak + lead.room)
                } else {
                    away * lack
                };
                let so_far = out[v as usize].map_or(0.0, |d| d.length());
                if lack > 0.0 && (so_far..lead.lift).contains(&way.length()) {
                    out[v as usize] = Some(way);
                }
            }
        }
        out
    }
}

/// A predicted garment.
pub(crate) struct Predicted<'g> {
    pub garment: &'g Garment,
    /// Where it lies [m].
    pub x: Vec<DVec3>,
    /// How it is led out of those below it; not at all where it was taught all that it does over them.
    pub lead: Option<Lead>,
}

/// Garments, innermost first, as one cloth [m]: each is led out of those below it.
pub(crate) fn stacked<'g>(garments: impl Iterator<Item = Predicted<'g>>) -> Vec<DVec3> {
    let (mut out, mut under) = (Vec::new(), Vec::new());
    let mut garments = garments.peekable();
    while let Some(mut g) = garments.next() {
        if let Some(lead) = &g.lead {
            over(&mut g.x, &g.garment.faces, (&under, lead));
        }
        if garments.peek().is_some() {
            under.push(Under::new(g.garment, &g.x));
        }
        out.extend(g.x);
    }
    out
}

/// Leads the cloth at `x` [m] out of all that it is worn over: first its vertices, then the triangles that
/// are still crossed by a fold between them.
fn over(x: &mut [DVec3], faces: &[[u32; 3]], (under, lead): (&[Under], &Lead)) {
    if under.is_empty() {
        return;
    }
    let near = neighbours(x.len(), faces);
    let mut outer = Surface::new(x, faces);
    for layer in under {
        for _ in 0..ROUNDS {
            let all = x.par_iter();
            let pushes: Vec<Option<DVec3>> = all.map(|p| layer.push(*p, lead)).collect();
            let most = pushes.iter().flatten().map(|d| d.length());
            if most.fold(0.0, f64::max) < DONE {
                break;
            }
            give_way(x, &pushes, &near);
        }
        for _ in 0..ROUNDS {
            outer.refit(x);
            let pushes = layer.lifts(&outer, lead);
            if pushes.iter().all(Option::is_none) {
                break;
            }
            give_way(x, &pushes, &near);
        }
    }
}

/// Moves `x` [m] as it is pushed, and what is `near` along with it.
fn give_way(x: &mut [DVec3], pushes: &[Option<DVec3>], near: &[Vec<u32>]) {
    let own = |d: &Option<DVec3>| d.unwrap_or(DVec3::ZERO);
    let mut moves: Vec<DVec3> = pushes.iter().map(own).collect();
    for _ in 0..SPREAD {
        let even = |v: usize| match pushes[v] {
            Some(d) => d,
            None => {
                near[v].iter().map(|j| moves[*j as usize]).sum::<DVec3>()
                    / near[v].len().max(1) as f64
            }
        };
        moves = (0..x.len()).map(even).collect();
    }
    x.iter_mut().zip(&moves).for_each(|(p, d)| *p += *d);
}

#[cfg(test)]
mod tests {
    use muslin_body::Avatar;
    use muslin_garment::{Recipe, Tee};

    use super::*;

    #[test]
    fn a_shirt_in_a_shirt_is_led_out_of_it_and_one_around_it_stays() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.standard().expect("the default body");
        let recipe = Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::default()
        });
        let tee = Garment::make(&avatar, &recipe).expect("a shirt");
        let worn = tee.worn(&avatar, &figure, &[]).expect("it can be worn");
        let under = [Under::new(&tee, &worn.verts)];
        let normals = muslin_geom::vertex_normals(&worn.verts, &tee.faces);
        let shifted = |by: f64| -> Vec<DVec3> {
            let pairs = worn.verts.iter().zip(&normals);
            pairs.map(|(p, n)| *p + *n * by).collect()
        };
        let mut outer = shifted(0.01);
        let before = outer.clone();
        over(&mut outer, &tee.faces, (&under, &Lead::STRANGE));
        let stayed = outer.iter().zip(&before).filter(|(a, b)| a == b).count();
        // In the armpits a shirt is near itself.
        assert!(stayed * 10 > 8 * outer.len(), "{stayed} of {}", outer.len());
        let mut inner = shifted(-0.006);
        over(&mut inner, &tee.faces, (&under, &Lead::STRANGE));
        let within = inner.iter().filter(|p| {
            under[0]
                .push(**p, &Lead::STRANGE)
                .is_some_and(|d| d.length() > 1e-3)
        });
        assert!(within.count() * 50 < inner.len());
    }

    #[test]
    fn triangles_that_a_fold_below_crosses_are_lifted_over_it() {
        // A ridge of one triangle's width, between the vertices of a coarse sheet above it.
        let grid = |n: u32, step: f64, height: &dyn Fn(f64) -> f64| {
            let at = |i: u32| {
                let (a, b) = (f64::from(i % n) * step, f64::from(i / n) * step);
                DVec3::new(b, height(a), a)
            };
            let cells = (0..n * n).filter(move |i| i % n < n - 1 && i / n < n - 1);
            let faces = cells.flat_map(move |i| [[i, i + 1, i + n + 1], [i, i + n + 1, i + n]]);
            let verts: Vec<DVec3> = (0..n * n).map(at).collect();
            (verts, faces.collect::<Vec<[u32; 3]>>())
        };
        let ridge = |a: f64| if (a - 0.05).abs() < 1e-6 { 0.01 } else { 0.0 };
        let (below, fine) = grid(21, 0.005, &ridge);
        let (above, coarse) = grid(4, 0.034, &|_| 0.006);
        let under = [Under {
            surface: Surface::new(&below, &fine),
            rim: vec![false; below.len()],
        }];
        let crossed = |x: &[DVec3]| {
            let outer = Surface::new(x, &coarse);
            let lifts = under[0].lifts(&outer, &Lead::STRANGE);
            lifts.iter().flatten().count()
        };
        let mut x = above.clone();
        assert!(
            crossed(&x) > 0
                && x.iter()
                    .all(|p| under[0].push(*p, &Lead::STRANGE).is_none())
        );
        over(&mut x, &coarse, (&under, &Lead::STRANGE));
        assert_eq!(crossed(&x), 0);
        assert!(x.iter().zip(&above).all(|(a, b)| a.distance(*b) < 0.02));
    }
}
