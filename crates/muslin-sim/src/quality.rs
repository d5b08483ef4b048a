//! How good a drape is: what a judge would measure on the delivered frame.

use glam::DVec3;
use muslin_energy::point;
use muslin_geom::Surface;

use crate::{elastic, ordered, weave::Weave};

/// Energies of the delivered frame [J].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Stretch, shear and strain limit.
    pub stretch: f64,
    /// Bending.
    pub bend: f64,
    /// Weight, against the height of the origin.
    pub weight: f64,
}

/// Cloth at rest, and how well it rests.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settled {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// The body that it rests on [m]: the path's last frame, drawn back where it folds into
    /// itself so that cloth has room.
    pub body: Vec<DVec3>,
    /// How far the skin drew back at most [m]; see [`crate::Flesh`].
    pub yielded: f64,
    /// Energies at rest.
    pub energies: Energies,
    /// Pairs of cloth and body triangles that meet, by exact predicates.
    pub body_intersections: usize,
    /// Vertices of the cloth inside the body.
    pub vertices_inside: usize,
    /// Pairs of cloth triangles that cross, by exact predicates.
    pub self_crossings: usize,
    /// Stretch (0.01 is 1 %) that half of the faces stay below.
    pub stretch_p50: f64,
    /// Stretch that 99 % of the faces stay below.
    pub stretch_p99: f64,
    /// The largest stretch.
    pub stretch_max: f64,
    /// Time steps taken.
    pub steps: usize,
    /// Whether the cloth came to rest before the steps ran out.
    pub converged: bool,
    /// Fastest vertex at the end [m/s], leaving out the fastest in a hundred.
    pub speed_p99: f64,
}

/// Largest principal stretch of every face at `x` [m], less one (0.01 is 1 %).
///
/// `rest`: material coordinates of each face's corners [m]; a face without area has none: zero.
pub fn stretch(faces: &[[u32; 3]], rest: &[[glam::DVec2; 3]], x: &[DVec3]) -> Vec<f64> {
    let one = |(f, r): (&[u32; 3], &[glam::DVec2; 3])| {
        let patch = muslin_energy::RestTriangle::new(*r)?;
        Some(largest(&patch.deformation(&f.map(|i| x[i as usize]))))
    };
    faces
        .iter()
        .zip(rest)
        .map(|pair| one(pair).unwrap_or(0.0))
        .collect()
}

fn largest(f: &[DVec3; 2]) -> f64 {
    let (a, b, d) = (f[0].length_squared(), f[0].dot(f[1]), f[1].length_squared());
    (0.5 * (a + d) + (0.25 * (a - d) * (a - d) + b * b).sqrt()).sqrt() - 1.0
}

/// How far the worst face stretches beyond its limit; below zero if none does.
pub(crate) fn excess(weave: &Weave, x: &[DVec3]) -> f64 {
    ordered::most(weave.faces.len(), |f| over(weave, x, f))
}

/// How far a face in a hundred stretches beyond its limit at least.
pub(crate) fn excess_p99(weave: &Weave, x: &[DVec3]) -> f64 {
    let mut all = ordered::map(weave.faces.len(), |f| over(weave, x, f));
    percentile(&mut all, 0.99)
}

/// How far a face stretches beyond its limit; below zero if it does not.
fn over(weave: &Weave, x: &[DVec3], face: usize) -> f64 {
    let patch = &weave.patches[face];
    let stretch = || largest(&patch.rest.deformation(&weave.corners(x, face)));
    patch
        .limit
        .map_or(f64::NEG_INFINITY, |l| stretch() - l.limit)
}

/// The value below which a `share` of all lies; zero of none.
pub(crate) fn percentile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

impl Settled {
    /// Measures `verts` [m] on the body `skin`.
    pub(crate) fn measure(
        weave: &Weave,
        verts: Vec<DVec3>,
        skin: &Surface,
        (self_crossings, body_intersections): (usize, usize),
    ) -> Settled {
        let of = |f: usize| largest(&weave.patches[f].rest.deformation(&weave.corners(&verts, f)));
        let mut stretch = ordered::map(weave.faces.len(), of);
        let inside = ordered::map(verts.len(), |i| {
            usize::from(skin.signed(verts[i], 0.05).is_some_and(|d| d < 0.0))
        });
        Settled {
            energies: energies(weave, &verts),
            body_intersections,
            vertices_inside: inside.into_iter().sum(),
            self_crossings,
            stretch_p50: percentile(&mut stretch, 0.5),
            stretch_p99: percentile(&mut stretch, 0.99),
            stretch_max: percentile(&mut stretch, 1.0),
            body: skin.verts().to_vec(),
            verts,
            ..Settled::default()
        }
    }
}

fn energies(weave: &Weave, x: &[DVec3]) -> Energies {
    let near = &weave.pattern.near;
    let g = DVec3::new(0.0, -9.81, 0.0);
    let sum = |part: &(dyn Fn(usize) -> f64 + Sync)| ordered::sum(x.len(), |r| r.map(part).sum());
    Energies {
        stretch: elastic::energy(weave, x),
        bend: sum(&|i| 0.5 * weave.bending.pull(i, x, near).dot(x[i] - x[0])),
        weight: sum(&|i| point::gravity(x[i], weave.mass[i], g).energy),
    }
}
