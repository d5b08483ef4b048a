//! Cloth prepared for solving: everything that depends on the cut alone.

use glam::DVec3;
use muslin_energy::{RestTriangle, membrane::Stretch, strain::StrainLimit};
use muslin_geom::number_edges;

use crate::{
    bending::Bending,
    cloth::{Cloth, SimError},
    fan::Fans,
    pattern::Pattern,
    region::Regions,
};

/// A face's share of the laws.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub rest: RestTriangle,
    pub stretch: Stretch,
    pub limit: Option<StrainLimit>,
}

/// Cloth with all that follows from its rest shape.
#[derive(Clone, Debug)]
pub(crate) struct Weave {
    pub faces: Vec<[u32; 3]>,
    pub patches: Vec<Patch>,
    /// Lumped masses [kg]; a vertex without faces weighs as little as the lightest other.
    pub mass: Vec<f64>,
    pub layers: Vec<u32>,
    pub friction: Vec<f64>,
    pub pattern: Pattern,
    pub regions: Regions,
    pub fans: Fans,
    pub bending: Bending,
    /// Edges, smaller vertex first.
    pub edges: Vec<[u32; 2]>,
    /// For every face, the vertices and the edges that it answers for, `u32::MAX` for none.
    pub owned: Vec<Owned>,
    /// Distance at which cloth begins to push cloth [m].
    pub radius: f64,
}

/// Features that a face represents in searches, so that each is found once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Owned {
    pub verts: [u32; 3],
    pub edges: [u32; 3],
}

impl Weave {
    pub fn new(cloth: &Cloth) -> Result<Weave, SimError> {
        cloth.check()?;
        let n = cloth.n_verts();
        let (pattern, (edges, owned)) =
            rayon::join(|| Pattern::new(n, &cloth.faces), || own(n, &cloth.faces));
        let (bending, (regions, patches)) = rayon::join(
            || Bending::new(cloth, &pattern),
            || (Regions::new(&pattern.near, &cloth.faces), patches(cloth)),
        );
        Ok(Weave {
            faces: cloth.faces.clone(),
            patches: patches?,
            mass: masses(cloth),
            layers: cloth.layers.clone(),
            friction: friction(cloth),
            bending,
            radius: radius(cloth),
            regions,
            fans: Fans::new(&pattern.corners, &cloth.faces),
            pattern,
            edges,
            owned,
        })
    }

    /// The same cloth with walls at its limits that are so many times as stiff.
    pub fn firmer(&self, times: f64) -> Weave {
        let mut firm = self.clone();
        let limits = firm.patches.iter_mut().filter_map(|p| p.limit.as_mut());
        limits.for_each(|limit| limit.stiffness *= times);
        firm
    }

    pub fn n_verts(&self) -> usize {
        self.mass.len()
    }

    /// Positions of a face's corners [m].
    pub fn corners(&self, x: &[DVec3], face: usize) -> [DVec3; 3] {
        let [a, b, c] = self.faces[face];
        [x[a as usize], x[b as usize], x[c as usize]]
    }

    /// The mean over the cloth's mass.
    pub fn mean(&self, of: impl Fn(usize) -> DVec3) -> DVec3 {
        let each = self.mass.iter().enumerate();
        each.map(|(i, m)| of(i) * *m).sum::<DVec3>() / self.mass.iter().sum::<f64>()
    }

    /// The velocities `v` [m/s], all changed alike, so that they have the momentum of `of`.
    pub fn with_momentum_of(&self, of: &[DVec3], mut v: Vec<DVec3>) -> Vec<DVec3> {
        let change = self.mean(|i| of[i] - v[i]);
        v.iter_mut().for_each(|v| *v += change);
        v
    }
}

/// Share of the limit at which the wall begins; the lower, the softer its approach.
const WALL_START: f64 = 0.5;

fn patches(cloth: &Cloth) -> Result<Vec<Patch>, SimError> {
    let one = |(f, corners): (usize, &[glam::DVec2; 3])| {
        let material = &cloth.materials[cloth.material_of[f] as usize];
        let k = &material.stretch;
        let limit = material.limit.map(|limit| StrainLimit {
            start: WALL_START * limit,
            limit,
            stiffness: 2.0 * k.warp.max(k.weft),
            wall: 0.85,
        });
        let rest = RestTriangle::new(*corners).ok_or(SimError::NoRestShape(f))?;
        Ok(Patch {
            rest,
            stretch: *k,
            limit,
        })
    };
    cloth.rest.iter().enumerate().map(one).collect()
}

fn area(c: &[glam::DVec2; 3]) -> f64 {
    0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]).abs()
}

fn masses(cloth: &Cloth) -> Vec<f64> {
    let mut mass = vec![0.0; cloth.n_verts()];
    for (f, face) in cloth.faces.iter().enumerate() {
        let density = cloth.materials[cloth.material_of[f] as usize].density;
        for &i in face {
            mass[i as usize] += density * area(&cloth.rest[f]) / 3.0;
        }
    }
    let least = mass
        .iter()
        .copied()
        .filter(|m| *m > 0.0)
        .fold(f64::INFINITY, f64::min);
    let least = if least.is_finite() { least } else { 1.0 };
    mass.into_iter().map(|m| m.max(least)).collect()
}

fn friction(cloth: &Cloth) -> Vec<f64> {
    let mut out = vec![0.0f64; cloth.n_verts()];
    for (f, face) in cloth.faces.iter().enumerate() {
        for &i in face {
            let mu = cloth.materials[cloth.material_of[f] as usize].friction;
            out[i as usize] = out[i as usize].max(mu);
        }
    }
    out
}

/// Twice the thickest cloth, at least 1.5 mm, at most a third of the typical edge.
fn radius(cloth: &Cloth) -> f64 {
    let thick = cloth
        .materials
        .iter()
        .map(|m| m.thickness)
        .fold(0.0, f64::max);
    let total: f64 = cloth.rest.iter().map(area).sum();
    // An equilateral triangle of area A has edges of length √(4A/√3).
    let edge = (4.0 * total / (cloth.rest.len().max(1) as f64 * 3f64.sqrt())).sqrt();
    (2.0 * thick).max(1.5e-3).min(edge / 3.0)
}

fn own(n_verts: usize, faces: &[[u32; 3]]) -> (Vec<[u32; 2]>, Vec<Owned>) {
    let none = Owned {
        verts: [u32::MAX; 3],
        edges: [u32::MAX; 3],
    };
    let (numbers, n_edges) = number_edges(n_verts, faces);
    let mut owned = vec![none; faces.len()];
    let mut edges = vec![[u32::MAX; 2]; n_edges];
    for (f, face) in faces.iter().enumerate() {
        for k in 0..3 {
            let edge = &mut edges[numbers[f][k] as usize];
            if *edge == [u32::MAX; 2] {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                *edge = [a.min(b), a.max(b)];
                owned[f].edges[k] = numbers[f][k];
            }
        }
    }
    let mut seen = vec![false; n_verts];
    for (f, face) in faces.iter().enumerate() {
        for k in 0..3 {
            if !std::mem::replace(&mut seen[face[k] as usize], true) {
                owned[f].verts[k] = face[k];
            }
        }
    }
    (edges, owned)
}
