//! Cloth prepared for the published laws.

use std::collections::BTreeMap;

use glam::DVec3;
use muslin_energy::hinge::{self, RestHinge, Stencil};
use muslin_sim::Cloth;

use super::recipe::{Bend, Recipe};
use crate::TrainError;
use crate::cut::{Cut, Patch};

/// An edge as a spring.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    pub verts: [u32; 2],
    /// Length as cut [m]; the mean of both sides' at a seam.
    pub rest: f32,
}

/// An inner edge that folds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hinge {
    pub verts: [u32; 4],
    pub faces: [u32; 2],
    /// `k l²/(8 (A₀ + A₁))` [J/rad²].
    pub stiffness: f32,
    /// Angle at rest [rad].
    pub angle: f32,
}

/// Everything that depends on the cut and the recipe alone.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    pub patches: Vec<Patch>,
    pub edges: Vec<Edge>,
    pub hinges: Vec<Hinge>,
    /// Mass of every vertex [kg].
    pub mass: Vec<f32>,
    pub pins: Vec<u32>,
}

impl Sheet {
    /// A `cloth` that lies at `template` [m] around the body at rest.
    pub fn new(recipe: &Recipe, cloth: &Cloth, template: &[DVec3]) -> Result<Self, TrainError> {
        let cut = Cut::new(cloth)?;
        let stencils = hinge::stencils(&cloth.faces);
        let one = |s: &Stencil| folding(recipe, cloth, (s, template));
        Ok(Self {
            edges: edges(cloth),
            hinges: stencils.iter().map(one).collect(),
            mass: masses(recipe, &cut),
            pins: cut.pins,
            patches: cut.patches,
        })
    }
}

fn folding(recipe: &Recipe, cloth: &Cloth, (s, template): (&Stencil, &[DVec3])) -> Hinge {
    let (k, is_flat) = match recipe.bend {
        Bend::Normals(_) => (0.0, true),
        Bend::Angles { stiffness, is_flat } => (f64::from(stiffness), is_flat),
    };
    // The law of `muslin_energy` has a half where the papers have an eighth.
    let bend = hinge::Bend {
        warp: 0.25 * k,
        weft: 0.25 * k,
    };
    let corners = s.verts.map(|v| template[v as usize]);
    let angle = if is_flat { 0.0 } else { hinge::angle(&corners) };
    let rest = RestHinge::new(s.corners(&cloth.rest), &bend, angle);
    Hinge {
        verts: s.verts,
        faces: s.faces,
        stiffness: rest.stiffness as f32,
        angle: rest.angle as f32,
    }
}

fn edges(cloth: &Cloth) -> Vec<Edge> {
    let mut lengths: BTreeMap<[u32; 2], (f64, f64)> = BTreeMap::new();
    for (face, corners) in cloth.faces.iter().zip(&cloth.rest) {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let length = corners[k].distance(corners[(k + 1) % 3]);
            let entry = lengths.entry([a.min(b), a.max(b)]).or_default();
            *entry = (entry.0 + length, entry.1 + 1.0);
        }
    }
    let one = |(verts, (sum, n)): ([u32; 2], (f64, f64))| Edge {
        verts,
        rest: (sum / n) as f32,
    };
    lengths.into_iter().map(one).collect()
}

fn masses(recipe: &Recipe, cut: &Cut) -> Vec<f32> {
    let n = cut.n_verts();
    let mut mass = vec![0.0; n];
    for p in &cut.patches {
        for v in p.verts {
            mass[v as usize] += recipe.density * p.area / 3.0;
        }
    }
    match recipe.even_mass {
        true => vec![mass.iter().sum::<f32>() / n as f32; n],
        false => mass,
    }
}
