//! The reference cloth laid over a clip's triangles.

use glam::{DVec2, DVec3};
use muslin_energy::RestTriangle;
use muslin_energy::hinge::{Bend, RestHinge, Stencil, angle, stencils};
use muslin_energy::stvk::{self, Lame};
use muslin_io::Clip;

/// Young's modulus [Pa].
const YOUNG: f64 = 0.7e5;
/// Poisson's ratio.
const POISSON: f64 = 0.485;
/// Thickness [m].
const THICK: f64 = 0.47e-3;
/// Density [kg/m³].
const DENSITY: f64 = 426.0;
/// How many times stiffer than its plate it bends.
const STIFFER: f64 = 50.0;
/// Gravity [m/s²].
pub const G: f64 = 9.81;

/// Rest shape and material of all triangles.
pub struct Reference {
    /// In-plane stiffness [N/m].
    pub lame: Lame,
    /// Rest triangles; none where a face has no area.
    pub patches: Vec<Option<RestTriangle>>,
    /// Inner edges.
    pub hinges: Vec<(Stencil, RestHinge)>,
    /// Edges with their rest length [m].
    pub edges: Vec<([u32; 2], f64)>,
    /// Mass of every vertex [kg].
    pub mass: Vec<f64>,
    /// Where the rest shape is from.
    pub rest_from: &'static str,
}

impl Reference {
    /// The reference cloth in the clip's rest shape.
    pub fn of(clip: &Clip) -> Self {
        let faces = &clip.drape.faces;
        let (rest_from, solid) = rest_shape(clip);
        let corners = corners(clip);
        let patches: Vec<_> = corners.iter().map(|c| RestTriangle::new(*c)).collect();
        let mut mass = vec![0.0; clip.n_verts()];
        for (face, patch) in faces.iter().zip(&patches) {
            let third = patch.map_or(0.0, |p| p.area) * DENSITY * THICK / 3.0;
            face.iter().for_each(|&i| mass[i as usize] += third);
        }
        // 1/8 of fifty plates times l²/(A₀ + A₁) is ½ B l²/(A₀ + A₁) with B a quarter of them.
        let plate = YOUNG * THICK.powi(3) / (12.0 * (1.0 - POISSON * POISSON));
        let b = STIFFER * plate / 4.0;
        let bend = Bend { warp: b, weft: b };
        let hinge = |s: Stencil| {
            let at_rest = solid.map_or(0.0, |x| angle(&s.verts.map(|i| x[i as usize])));
            (s, RestHinge::new(s.corners(&corners), &bend, at_rest))
        };
        let h = THICK / (1.0 - POISSON * POISSON);
        Self {
            lame: Lame {
                mu: 0.5 * YOUNG * THICK / (1.0 + POISSON),
                lambda: YOUNG * POISSON * h,
            },
            hinges: stencils(faces).into_iter().map(hinge).collect(),
            edges: edges(faces, &corners),
            patches,
            mass,
            rest_from,
        }
    }

    /// Saint Venant-Kirchhoff energy [J] of the reference cloth at `x` [m].
    pub fn strain(&self, faces: &[[u32; 3]], x: &[DVec3]) -> f64 {
        let all = faces.iter().zip(&self.patches);
        let known = all.filter_map(|(f, patch)| Some((f, (*patch)?)));
        known
            .map(|(f, patch)| stvk::gradient(&f.map(|i| x[i as usize]), &patch, &self.lame).0)
            .sum()
    }
}

/// Where a clip's rest shape is from, and the positions [m] that it is if it is not a pattern.
fn rest_shape(clip: &Clip) -> (&'static str, Option<&[DVec3]>) {
    let frames = &clip.drape.frames;
    let finite = || frames.iter().find(|f| f.iter().all(|x| x.is_finite()));
    match (clip.corners.is_empty(), clip.rest.is_empty()) {
        (false, _) => ("pattern", None),
        (true, false) => ("rest shape", Some(&clip.rest)),
        _ => ("first frame", Some(finite().unwrap_or(&frames[0]))),
    }
}

/// Every triangle's corners at rest, flat [m].
pub fn corners(clip: &Clip) -> Vec<[DVec2; 3]> {
    let Some(x) = rest_shape(clip).1 else {
        return clip.corners.clone();
    };
    let flat = |f: &[u32; 3]| laid_flat(f.map(|i| x[i as usize]));
    clip.drape.faces.iter().map(flat).collect()
}

/// The triangle in its own plane.
fn laid_flat([a, b, c]: [DVec3; 3]) -> [DVec2; 3] {
    let (u, v) = (b - a, c - a);
    let x = u.normalize_or_zero();
    let along = v.dot(x);
    [
        DVec2::ZERO,
        DVec2::new(u.length(), 0.0),
        DVec2::new(along, (v - x * along).length()),
    ]
}

/// Every edge once, its length the mean of its faces' (which differ at a seam).
fn edges(faces: &[[u32; 3]], corners: &[[DVec2; 3]]) -> Vec<([u32; 2], f64)> {
    let mut sides: Vec<([u32; 2], f64)> = Vec::with_capacity(3 * faces.len());
    for (face, at) in faces.iter().zip(corners) {
        for k in 0..3 {
            let (i, j) = (face[k], face[(k + 1) % 3]);
            sides.push(([i.min(j), i.max(j)], at[k].distance(at[(k + 1) % 3])));
        }
    }
    sides.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let groups = sides.chunk_by(|a, b| a.0 == b.0);
    groups
        .map(|g| (g[0].0, g.iter().map(|s| s.1).sum::<f64>() / g.len() as f64))
        .filter(|e| e.1 > 0.0)
        .collect()
}
