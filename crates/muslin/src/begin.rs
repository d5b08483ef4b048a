//! Where trained garments begin that are not clean in a pose: on the way to it, as far as they are.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use glam::DVec3;
use muslin_geom::{Closest, Mesh, Surface, neighbours, self_intersections};
use rayon::prelude::*;

/// Pairs of triangles that cross, and vertices lost in the body, that there may be in what a garment was taught; with
/// more it knows nothing of the pose.
const MANY: usize = 60;
/// So few come free without a trace.
const FEW: usize = 12;
/// Deeper in the body than this a vertex may come out on the far side of a limb [m]; and how deep is looked.
const LOST: [f64; 2] = [0.015, 0.1];
/// Shares of the way from the rest pose at which trained garments are asked, until little enough is wrong: what
/// crosses itself in the pose itself, as legs do in a long step, may not yet do so before.
const SHARES: [f64; 5] = [1.0, 0.85, 0.7, 0.55, 0.4];

/// More pairs than this are not parted, nor any nearer to the pose than this share of the way, where thighs may pass
/// through each other and leave cloth no room: legs that cross so are led out of the step instead.
const PARTED: usize = 100;
const NO_LATER: f64 = 0.7;
/// Cloth that crosses other cloth lies over another part of the body where their feet on the skin at rest are farther
/// apart than this [m].
const APART: f64 = 0.04;
/// It is led by this share of its way to its own skin at once, in at most so many rounds, and takes so many rings of
/// neighbours along, each by this share of what the ring within is led.
const PULL: f64 = 0.5;
const ROUNDS: usize = 3;
const RINGS: usize = 4;
const ALONG: f64 = 0.75;
/// How far from the skin it is led [m], and how far at rest its skin is looked for.
const OFF: f64 = 0.003;
const FAR: f64 = 0.2;

/// What hangs freely is laid so uneven [m], in waves so long [m]: a cone of silk stands until something tells it where to fold.
/// Freely is what is farther from the skin than the second distance, not at all what is nearer than the first [m].
const UNEVEN: f64 = 0.003;
const WAVE: f64 = 0.08;
const FREE: [f64; 2] = [0.006, 0.026];

/// The share of the way to a pose at which garments of these triangles begin, and where they lie there [m]: the
/// first with next to nothing wrong, or that with the least; nothing if they know nothing of the way.
///
/// `rest`: where they lie around the body at rest [m], and the skin there. `at` says of a share where the networks lay
/// the cloth [m], and the skin there.
pub(crate) fn begin(
    faces: &[[u32; 3]],
    rest: (&[DVec3], impl Fn() -> Surface + Sync),
    at: impl Fn(f64) -> Option<(Vec<DVec3>, Surface)> + Sync,
) -> Option<(f64, Vec<DVec3>)> {
    let still = OnceLock::new();
    let look = |share: &f64| {
        let (verts, skin) = at(*share)?;
        let faces = faces.to_vec();
        let mut mesh = Mesh { verts, faces };
        let crossings = self_intersections(&mesh);
        let mut wrong = crossings.len();
        if *share <= NO_LATER && (FEW + 1..=PARTED).contains(&wrong) {
            let still = still.get_or_init(&rest.1);
            let parting = Parting::new(&mesh.faces, (rest.0, still), &skin);
            wrong = parting.part(&mut mesh, crossings);
        }
        // More than too many need not be counted.
        if wrong <= MANY {
            wrong += lost(&skin, &mesh.verts);
        }
        Some((wrong, *share, mesh.verts, skin))
    };
    let mut least: Option<(usize, f64, Vec<DVec3>, Surface)> = None;
    // Much of a look is one thread's work, so the next is taken at the same time while most are in vain.
    let (first, others) = SHARES.split_at(2);
    'all: for shares in [first].into_iter().chain(others.chunks(1)) {
        let seen: Vec<_> = shares.par_iter().map(look).collect();
        for one in seen {
            let one = one?;
            let wrong = one.0;
            if least.as_ref().is_none_or(|l| wrong < l.0) {
                least = Some(one);
            }
            if wrong <= FEW {
                break 'all;
            }
        }
    }
    let (wrong, share, mut verts, skin) = least?;
    if wrong > MANY {
        return None;
    }
    verts.par_iter_mut().for_each(|x| *x += uneven(*x, &skin));
    Some((share, verts))
}

/// How far a place [m] of cloth is moved so that it lies uneven: sideways, by where it is alone and by little from one place to
/// the next, so that nothing passes through anything.
fn uneven(x: DVec3, skin: &Surface) -> DVec3 {
    let off = skin.closest(x, FREE[1]).map_or(FREE[1], |hit| hit.signed);
    let free = ((off - FREE[0]) / (FREE[1] - FREE[0])).clamp(0.0, 1.0);
    let wave = |along: f64| (TAU / WAVE * along).sin();
    DVec3::new(wave(x.z), 0.0, wave(x.x + 0.3 * WAVE)) * (UNEVEN * free)
}

/// What leads cloth that crosses cloth over another part of the body, as legs of trousers do in a long step, towards
/// the skin that it lies over at rest.
struct Parting<'p> {
    rest: &'p [DVec3],
    still: &'p Surface,
    skin: &'p Surface,
    near: Vec<Vec<u32>>,
    /// The nearest skin at rest of every vertex that was asked for.
    feet: Vec<Option<Option<Closest>>>,
}

impl<'p> Parting<'p> {
    fn new(
        faces: &[[u32; 3]],
        (rest, still): (&'p [DVec3], &'p Surface),
        skin: &'p Surface,
    ) -> Self {
        Self {
            near: neighbours(rest.len(), faces),
            feet: vec![None; rest.len()],
            rest,
            still,
            skin,
        }
    }

    fn foot(&mut self, v: u32) -> Option<Closest> {
        let v = v as usize;
        let look = || self.still.closest(self.rest[v], FAR);
        *self.feet[v].get_or_insert_with(look)
    }

    /// Parts what crosses; returns how many pairs do then.
    fn part(mut self, mesh: &mut Mesh, mut crossings: Vec<[u32; 2]>) -> usize {
        for _ in 0..ROUNDS {
            if crossings.len() <= FEW {
                break;
            }
            let shares = self.shares(mesh, &crossings);
            if shares.is_empty() {
                break;
            }
            let before = mesh.verts.clone();
            for (v, share) in shares {
                if let Some(foot) = self.foot(v) {
                    let corners = self.skin.corners(foot.face).into_iter().zip(foot.weights);
                    let at: DVec3 = corners.map(|(p, w)| p * w).sum();
                    let to = at + self.skin.face_normal(foot.face) * OFF;
                    mesh.verts[v as usize] = before[v as usize].lerp(to, share);
                }
            }
            let now = self_intersections(mesh);
            if now.len() >= crossings.len() {
                mesh.verts = before;
                break;
            }
            crossings = now;
        }
        crossings.len()
    }

    /// Which vertices are led, and by which share of their way.
    fn shares(&mut self, mesh: &Mesh, crossings: &[[u32; 2]]) -> Vec<(u32, f64)> {
        let mut seen = vec![false; mesh.verts.len()];
        let mut ring = Vec::new();
        let mut add = |v: u32, ring: &mut Vec<u32>| {
            if !std::mem::replace(&mut seen[v as usize], true) {
                ring.push(v);
            }
        };
        for pair in crossings {
            let [f, g] = pair.map(|f| mesh.faces[f as usize]);
            let feet = (self.foot(f[0]), self.foot(g[0]));
            if let (Some(a), Some(b)) = feet
                && a.point.distance(b.point) > APART
            {
                f.into_iter().chain(g).for_each(|v| add(v, &mut ring));
            }
        }
        let (mut out, mut share) = (Vec::new(), PULL);
        for _ in 0..=RINGS {
            out.extend(ring.iter().map(|v| (*v, share)));
            let mut next = Vec::new();
            for v in ring {
                self.near[v as usize]
                    .iter()
                    .for_each(|w| add(*w, &mut next));
            }
            (ring, share) = (next, ALONG * share);
        }
        out
    }
}

/// How many vertices of the cloth at `x` [m] lie deep in a body.
fn lost(skin: &Surface, x: &[DVec3]) -> usize {
    let [depth, far] = LOST;
    let is_lost = |p: &&DVec3| {
        let hit = skin.closest(**p, far);
        // On which side only matters of what is far from it.
        let hit = hit.filter(|hit| hit.signed.abs() > depth);
        hit.is_some_and(|hit| skin.sided(**p, hit).signed < -depth)
    };
    x.par_iter().filter(is_lost).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 12;

    /// Two sheets of cells of 1 cm that face each other, at these x [m] by sheet, row and column.
    fn sheets(x: impl Fn(usize, usize, usize) -> f64) -> Vec<DVec3> {
        let all = (0..2).flat_map(|s| (0..N).flat_map(move |i| (0..N).map(move |j| (s, i, j))));
        let at = |(s, i, j)| DVec3::new(x(s, i, j), 0.01 * i as f64, 0.01 * j as f64);
        all.map(at).collect()
    }

    fn faces() -> Vec<[u32; 3]> {
        let corner = |s: usize, i: usize, j: usize| (N * N * s + N * i + j) as u32;
        let all = (0..2).flat_map(|s| (1..N).flat_map(move |i| (1..N).map(move |j| (s, i, j))));
        let cell = |(s, i, j)| {
            let [a, b] = [corner(s, i - 1, j - 1), corner(s, i, j - 1)];
            let [c, d] = [corner(s, i, j), corner(s, i - 1, j)];
            [[a, b, c], [a, c, d]]
        };
        all.flat_map(cell).collect()
    }

    /// Skin behind each, 10 cm apart.
    fn skin() -> Surface {
        let corner = |x: f64, k: usize| DVec3::new(x, [-0.5, 0.5][k & 1], [-0.5, 0.5][k >> 1]);
        let verts: Vec<DVec3> = (0..8)
            .map(|k| corner([-0.05, 0.05][k >> 2], k & 3))
            .collect();
        Surface::new(&verts, &[[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]])
    }

    /// Where the networks lay them: all through each other in the pose, a row of each through the other on the way, and
    /// apart at first.
    fn laid(share: f64) -> Option<(Vec<DVec3>, Surface)> {
        let x = |s: usize, i: usize, j: usize| {
            let side = [-1.0, 1.0][s];
            let bump = match share {
                0.8.. => (i + j).is_multiple_of(2),
                0.6.. => i == 6 && (4..8).contains(&j),
                _ => false,
            };
            if bump { -0.006 * side } else { 0.006 * side }
        };
        Some((sheets(x), skin()))
    }

    #[test]
    fn legs_that_cross_on_the_way_are_parted_there() {
        let rest = sheets(|s, _, _| [-0.03, 0.03][s]);
        let (share, verts) = begin(&faces(), (&rest, skin), laid).expect("they know the way");
        assert_eq!(share, NO_LATER);
        let before = laid(share).expect("they lie there").0;
        let faces = faces();
        let crossing = |verts: &[DVec3]| {
            let (verts, faces) = (verts.to_vec(), faces.clone());
            self_intersections(&Mesh { verts, faces }).len()
        };
        let crossings = (crossing(&before), crossing(&verts));
        assert!(crossings.0 > FEW && crossings.1 == 0, "{crossings:?}");
        let skin = skin();
        let moved = |v: usize| verts[v] != before[v] + uneven(before[v], &skin);
        assert!((4..8).all(|j| moved(6 * N + j) && !moved(j)));
        // Nearer to its own skin than it was, and not in it.
        assert!(verts.iter().all(|p| p.x.abs() < 0.05));
    }

    #[test]
    fn what_lies_over_the_same_skin_is_not_parted() {
        let rest = sheets(|s, _, _| [0.03, 0.035][s]);
        let (share, verts) = begin(&faces(), (&rest, skin), laid).expect("they know the way");
        assert_eq!(share, 0.55);
        let before = laid(share).expect("they lie there").0;
        let skin = skin();
        let lies: Vec<DVec3> = before.iter().map(|x| *x + uneven(*x, &skin)).collect();
        assert_eq!(verts, lies);
    }

    #[test]
    fn what_hangs_freely_is_laid_uneven_and_what_lies_on_skin_is_not() {
        let skin = skin();
        let at = |off: f64, k: usize| DVec3::new(0.05 - off, 0.01, 0.004 * k as f64);
        let most = |off: f64| {
            let moves = (0..40).map(|k| uneven(at(off, k), &skin));
            moves.fold(0.0, |most: f64, m| most.max(m.length()))
        };
        assert_eq!(most(FREE[0] - 1e-4), 0.0);
        let (half, whole) = (most(0.016), most(0.045));
        assert!(whole > UNEVEN && half < 0.6 * whole, "{half} {whole}");
        // Two that are near go much the same way: none comes past the other.
        let apart = |k: usize| {
            let [a, b] = [k, k + 1].map(|k| at(0.03, k));
            (uneven(b, &skin) - uneven(a, &skin)).length() / a.distance(b)
        };
        assert!((0..40).map(apart).all(|x| x < 0.7));
    }
}
