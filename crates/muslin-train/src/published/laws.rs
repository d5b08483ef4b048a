//! The published losses of sixteen poses at once, in single precision: energy and gradient.
//!
//! Positions lie `[vertex][axis][pose]` [m]; gradients [N] are added, energies [J] returned, one for
//! each pose. Nothing is divided by zero: cloth without length or area has no direction.

use super::recipe::{Bend, Recipe, Stretch, Touch};
use super::sheet::{Hinge, Sheet};
use crate::cut::Patch;
use crate::lanes::{Lane, Row, Vec3};

/// Shorter squares than this have no direction [m²], [m⁴].
const LEAST: f32 = 1e-18;

/// Stretch of the whole sheet.
#[inline(always)]
pub(crate) fn stretch(recipe: &Recipe, sheet: &Sheet, x: &[Row], g: &mut [Row]) -> Lane {
    let mut energy = Lane::all(0.0);
    match recipe.stretch {
        Stretch::Edges(k) => {
            for e in &sheet.edges {
                let [a, b] = e.verts;
                let d = Vec3::of(x, b) - Vec3::of(x, a);
                let length = d.dot(d).max(Lane::all(LEAST)).sqrt();
                let stretch = length - e.rest;
                energy += stretch * stretch * k;
                let pull = d.times(stretch / length * (2.0 * k));
                pull.add_to(g, b);
                (pull * -1.0).add_to(g, a);
            }
        }
        Stretch::StVk(mu, lambda) => {
            for p in &sheet.patches {
                energy += patch(p, (x, g), |f| stvk(f, mu, lambda));
            }
        }
        Stretch::Yarns(along, shear) => {
            for p in &sheet.patches {
                energy += patch(p, (x, g), |f| yarns(f, along, shear));
            }
        }
    }
    energy
}

/// A density [J/m²] of `F = ∂x/∂u` with its derivative, over one face.
#[inline(always)]
fn patch(
    p: &Patch,
    (x, g): (&[Row], &mut [Row]),
    law: impl Fn([Vec3; 2]) -> (Lane, [Vec3; 2]),
) -> Lane {
    let [x0, x1, x2] = p.verts.map(|v| Vec3::of(x, v));
    let (a, b) = (x1 - x0, x2 - x0);
    let [s, t] = p.slopes;
    let (density, stress) = law([a * s[0] + b * t[0], a * s[1] + b * t[1]]);
    let spread = |s: [f32; 2]| (stress[0] * s[0] + stress[1] * s[1]) * p.area;
    let (g1, g2) = (spread(s), spread(t));
    ((g1 + g2) * -1.0).add_to(g, p.verts[0]);
    g1.add_to(g, p.verts[1]);
    g2.add_to(g, p.verts[2]);
    density * p.area
}

/// `μ |E|² + ½ λ tr(E)²`, `E = ½ (FᵀF − I)`: `muslin_energy::stvk`.
#[inline(always)]
fn stvk(f: [Vec3; 2], mu: f32, lambda: f32) -> (Lane, [Vec3; 2]) {
    let half = |u: Vec3, v: Vec3, rest: f32| (u.dot(v) - rest) * 0.5;
    let [a, b, d] = [
        half(f[0], f[0], 1.0),
        half(f[0], f[1], 0.0),
        half(f[1], f[1], 1.0),
    ];
    let trace = a + d;
    let energy = (a * a + b * b * 2.0 + d * d) * mu + trace * trace * (0.5 * lambda);
    let pressure = trace * lambda;
    let (s, t, u) = (
        a * (2.0 * mu) + pressure,
        b * (2.0 * mu),
        d * (2.0 * mu) + pressure,
    );
    (
        energy,
        [f[0].times(s) + f[1].times(t), f[0].times(t) + f[1].times(u)],
    )
}

/// `k (|w_u| − 1)² + k (|w_v| − 1)² + s (w_u · w_v)²`.
#[inline(always)]
fn yarns(f: [Vec3; 2], along: f32, shear: f32) -> (Lane, [Vec3; 2]) {
    let across = f[0].dot(f[1]);
    let mut energy = across * across * shear;
    let turn = across * (2.0 * shear);
    let mut stress = [f[1].times(turn), f[0].times(turn)];
    for i in 0..2 {
        let length = f[i].dot(f[i]).max(Lane::all(LEAST)).sqrt();
        let strain = length - 1.0;
        energy += strain * strain * along;
        stress[i] += f[i].times(strain / length * (2.0 * along));
    }
    (energy, stress)
}

/// Bending of the whole sheet.
#[inline(always)]
pub(crate) fn bend(recipe: &Recipe, sheet: &Sheet, x: &[Row], g: &mut [Row]) -> Lane {
    match recipe.bend {
        Bend::Normals(k) => normals(k, sheet, x, g),
        Bend::Angles { .. } => {
            let mut energy = Lane::all(0.0);
            for h in &sheet.hinges {
                energy += angle(h, x, g);
            }
            energy
        }
    }
}

/// `k Σ |n₀ − n₁|²` of unit normals.
#[inline(always)]
fn normals(k: f32, sheet: &Sheet, x: &[Row], g: &mut [Row]) -> Lane {
    let of = |p: &Patch| {
        let [a, b, c] = p.verts.map(|v| Vec3::of(x, v));
        let n = cross(b - a, c - a);
        let size = n.dot(n).max(Lane::all(LEAST)).sqrt();
        (n.times(Lane::all(1.0) / size), size)
    };
    let unit: Vec<(Vec3, Lane)> = sheet.patches.iter().map(of).collect();
    let mut slopes = vec![Vec3::ZERO; unit.len()];
    let mut energy = Lane::all(0.0);
    for h in &sheet.hinges {
        let [f0, f1] = h.faces.map(|f| f as usize);
        let apart = unit[f0].0 - unit[f1].0;
        energy += apart.dot(apart) * k;
        slopes[f0] += apart * (2.0 * k);
        slopes[f1] -= apart * (2.0 * k);
    }
    for (p, ((n, size), slope)) in sheet.patches.iter().zip(unit.iter().zip(slopes)) {
        // Along itself a unit normal cannot change.
        let slope = (slope - n.times(n.dot(slope))).times(Lane::all(1.0) / *size);
        let [a, b, c] = p.verts.map(|v| Vec3::of(x, v));
        let (gb, gc) = (cross(c - a, slope), cross(slope, b - a));
        gb.add_to(g, p.verts[1]);
        gc.add_to(g, p.verts[2]);
        ((gb + gc) * -1.0).add_to(g, p.verts[0]);
    }
    energy
}

/// `c (θ − θ̄)²` with the signed angle: `muslin_energy::hinge`.
#[inline(always)]
fn angle(h: &Hinge, x: &[Row], g: &mut [Row]) -> Lane {
    let [a, b, c, d] = h.verts.map(|v| Vec3::of(x, v));
    let edge = b - a;
    let square = edge.dot(edge).max(Lane::all(LEAST));
    let length = square.sqrt();
    let (n0, n1) = (cross(edge, c - a), cross(d - a, edge));
    let sine = cross(n0, n1).dot(edge) / length;
    let cosine = n0.dot(n1);
    let mut turn = Lane::all(0.0);
    for i in 0..turn.0.len() {
        turn.0[i] = way(sine.0[i].atan2(cosine.0[i]) - h.angle);
    }
    let slope = turn * (2.0 * h.stiffness);
    // Unit normal over height: how fast a corner that rises turns its face.
    let rise = |n: Vec3| n.times(length * slope / n.dot(n).max(Lane::all(LEAST)));
    let (t0, t1) = (rise(n0), rise(n1));
    let (s0, s1) = ((c - a).dot(edge) / square, (d - a).dot(edge) / square);
    let one = Lane::all(1.0);
    (t0.times(one - s0) + t1.times(one - s1)).add_to(g, h.verts[0]);
    (t0.times(s0) + t1.times(s1)).add_to(g, h.verts[1]);
    (t0 * -1.0).add_to(g, h.verts[2]);
    (t1 * -1.0).add_to(g, h.verts[3]);
    turn * turn * h.stiffness
}

/// The shorter way round.
#[inline(always)]
fn way(turn: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    if turn > PI {
        turn - TAU
    } else if turn < -PI {
        turn + TAU
    } else {
        turn
    }
}

#[inline(always)]
fn cross(a: Vec3, b: Vec3) -> Vec3 {
    let ([a, b, c], [d, e, f]) = (a.0, b.0);
    Vec3([b * f - c * e, c * d - a * f, a * e - b * d])
}

impl Touch {
    /// Energy [J] and slope [N] at a distance [m].
    #[inline(always)]
    pub fn at(&self, distance: Lane) -> [Lane; 2] {
        let depth = (-distance + self.gap).max(Lane::all(0.0));
        let mut slope = depth * (-self.stiffness * self.power as f32);
        let mut energy = depth * depth * self.stiffness;
        for _ in 2..self.power {
            slope = slope * depth;
            energy = energy * depth;
        }
        [energy, slope]
    }
}

#[cfg(test)]
mod suite;
#[cfg(test)]
mod tests;
