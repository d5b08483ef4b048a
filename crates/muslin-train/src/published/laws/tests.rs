//! The losses against reference laws and differences in double precision.

use glam::DVec3;
use muslin_energy::{RestTriangle, hinge, spring, stvk as exact};

use super::super::recipe::{Isotropic, System};
use super::*;
use crate::lanes::{LANES, points};
use crate::testing::{agree, sheet, states};

/// Energy and gradient of a law of whole sheets in double precision, by central differences.
fn differences(x: &[Row], law: impl Fn(&[DVec3]) -> f64) -> (Vec<Vec<DVec3>>, Vec<f64>) {
    let one = |pose: usize| {
        let x = points(x, pose);
        let slope = |i: usize, axis: usize| {
            let at = |by: f64| {
                let mut x = x.clone();
                x[i][axis] += by;
                law(&x)
            };
            (at(1e-7) - at(-1e-7)) / 2e-7
        };
        let g = (0..x.len()).map(|i| DVec3::from_array([0, 1, 2].map(|a| slope(i, a))));
        (g.collect(), law(&x))
    };
    (0..LANES).map(one).unzip()
}

/// Crumpled cloth unlike any of the states.
fn template() -> Vec<DVec3> {
    let (a, b) = (points(&states(), 3), points(&states(), 5));
    a.iter().zip(&b).map(|(a, b)| (*a + *b) * 0.5).collect()
}

fn corners<const N: usize>(x: &[DVec3], verts: &[u32; N]) -> [DVec3; N] {
    verts.map(|v| x[v as usize])
}

fn check(what: &str, system: System, law: impl Fn(&[DVec3]) -> f64, is_bend: bool) {
    let (recipe, x) = (system.recipe(), states());
    let cloth = sheet();
    let ours = Sheet::new(recipe, &cloth, &template()).expect("a valid cloth");
    let mut g = vec![[0.0; LANES]; x.len()];
    let energy = match is_bend {
        true => bend(recipe, &ours, &x, &mut g),
        false => stretch(recipe, &ours, &x, &mut g),
    };
    let (want, sums) = differences(&x, law);
    agree(what, &g, &want, (energy, &sums));
}

#[test]
fn edges_are_the_reference_springs() {
    let cloth = sheet();
    let law = |x: &[DVec3]| {
        let edges = edges_of(&cloth);
        let one = |(v, rest): &([u32; 2], f64)| spring::edge(&corners(x, v), *rest, 30.0);
        edges.iter().map(|e| one(e).energy).sum()
    };
    check("edges", System::Pbns, law, false);
}

/// Every edge once, with its length as cut.
fn edges_of(cloth: &muslin_sim::Cloth) -> Vec<([u32; 2], f64)> {
    let mut out: Vec<([u32; 2], f64)> = Vec::new();
    for (f, p) in cloth.faces.iter().zip(&cloth.rest) {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let key = [f[i].min(f[j]), f[i].max(f[j])];
            if out.iter().all(|e| e.0 != key) {
                out.push((key, p[i].distance(p[j])));
            }
        }
    }
    out
}

#[test]
fn differences_of_normals_are_their_formula() {
    let cloth = sheet();
    let law = |x: &[DVec3]| {
        let normal = |f: u32| {
            let [a, b, c] = corners(x, &cloth.faces[f as usize]);
            (b - a).cross(c - a).normalize()
        };
        let one =
            |s: &hinge::Stencil| 5e-5 * (normal(s.faces[0]) - normal(s.faces[1])).length_squared();
        hinge::stencils(&cloth.faces).iter().map(one).sum()
    };
    check("normals", System::Pbns, law, true);
}

#[test]
fn snug_stretches_by_the_reference_law_and_its_own_constants() {
    let cloth = sheet();
    let (e, nu, t) = (0.7e5, 0.485, 0.47e-3);
    let k = exact::Lame {
        mu: t * e / (2.0 * (1.0 + nu)),
        lambda: t * e * nu / (1.0 - nu * nu),
    };
    let law = |x: &[DVec3]| {
        let one = |(f, cut): (&[u32; 3], &[glam::DVec2; 3])| {
            let rest = RestTriangle::new(*cut).expect("it has an area");
            exact::gradient(&corners(x, f), &rest, &k).0
        };
        cloth.faces.iter().zip(&cloth.rest).map(one).sum()
    };
    check("stvk", System::Snug, law, false);
}

#[test]
fn snug_in_its_own_cotton_as_a_sheet_is_snug() {
    // 3.96e-5 N m is 50 times the plate's stiffness, in a law that has an eighth for its half.
    let (e, nu, t) = (0.7e5, 0.485, 0.47e-3_f64);
    let plate = e * t.powi(3) / (12.0 * (1.0 - nu * nu));
    let sheet = Isotropic {
        stretch: e * t,
        poisson: nu,
        bend: 0.25 * 50.0 * plate,
        density: 426.0 * t,
    };
    let own = System::Snug.recipe();
    let same = own.of_sheet(&sheet);
    let constants = |r: &Recipe| match (r.stretch, r.bend) {
        (Stretch::StVk(mu, lambda), Bend::Angles { stiffness, .. }) => {
            [mu, lambda, stiffness, r.density]
        }
        other => panic!("another law: {other:?}"),
    };
    for (a, b) in constants(&same).iter().zip(constants(own)) {
        assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
    }
}

#[test]
fn yarns_are_their_formula_over_the_true_area() {
    let cloth = sheet();
    let law = |x: &[DVec3]| {
        let one = |(f, cut): (&[u32; 3], &[glam::DVec2; 3])| {
            let rest = RestTriangle::new(*cut).expect("it has an area");
            let [u, v] = rest.deformation(&corners(x, f));
            let yarn = |w: DVec3| 10.0 * (w.length() - 1.0).powi(2);
            rest.area * (yarn(u) + yarn(v) + u.dot(v).powi(2))
        };
        cloth.faces.iter().zip(&cloth.rest).map(one).sum()
    };
    check("yarns", System::Ncs, law, false);
}

#[test]
fn folds_are_the_reference_hinges_signed_and_against_their_rest() {
    let cloth = sheet();
    let template = template();
    for (system, k, is_flat) in [(System::Snug, 3.96e-5, true), (System::Ncs, 2e-5, false)] {
        let law = |x: &[DVec3]| {
            let one = |s: &hinge::Stencil| {
                let areas: f64 = (s.faces.iter())
                    .map(|f| {
                        let [a, b, c] = cloth.rest[*f as usize];
                        0.5 * (b - a).perp_dot(c - a).abs()
                    })
                    .sum();
                let [a, b] = [s.verts[0], s.verts[1]];
                let edge = edges_of(&cloth)
                    .into_iter()
                    .find(|e| e.0 == [a.min(b), a.max(b)])
                    .expect("an edge");
                let rest = match is_flat {
                    true => 0.0,
                    false => hinge::angle(&corners(&template, &s.verts)),
                };
                let turn = hinge::angle(&corners(x, &s.verts)) - rest;
                let turn = (turn.sin()).atan2(turn.cos());
                k * edge.1 * edge.1 / (8.0 * areas) * turn * turn
            };
            hinge::stencils(&cloth.faces).iter().map(one).sum()
        };
        check("folds", system, law, true);
    }
}

#[test]
fn flat_cloth_has_a_gradient_that_is_a_number() {
    let cloth = sheet();
    let mut x = vec![[0.0; LANES]; 36];
    for (face, cut) in cloth.faces.iter().zip(&cloth.rest) {
        for (v, p) in face.iter().zip(cut) {
            x[3 * *v as usize] = [p.x as f32; LANES];
            x[3 * *v as usize + 2] = [p.y as f32; LANES];
        }
    }
    let heap = vec![[0.1; LANES]; 36];
    for system in [System::Pbns, System::Snug, System::Ncs] {
        let recipe = system.recipe();
        let ours = Sheet::new(recipe, &cloth, &points(&x, 0)).expect("a valid cloth");
        for (x, is_flat) in [(&x, true), (&heap, false)] {
            let mut g = vec![[0.0; LANES]; 36];
            let energy = stretch(recipe, &ours, x, &mut g) + bend(recipe, &ours, x, &mut g);
            assert!(g.as_flattened().iter().all(|g| g.is_finite()), "{system:?}");
            assert!(energy.0[0].is_finite());
            assert_eq!(energy.0[0].abs() < 1e-9, is_flat, "{system:?} {energy:?}");
        }
    }
}

#[test]
fn touch_has_the_slope_of_its_energy_and_ends_at_its_gap() {
    for system in [System::Pbns, System::Snug, System::Ncs] {
        let touch = system.recipe().touch;
        let (k, p, gap) = (touch.stiffness, touch.power, f64::from(touch.gap));
        let law = |d: f64| f64::from(k) * (gap - d).max(0.0).powi(p);
        let mut at = Lane::all(0.0);
        (0..LANES).for_each(|i| at.0[i] = 6e-3 - 1.1e-3 * i as f32);
        let [energy, slope] = touch.at(at);
        for (i, d) in at.0.iter().map(|d| f64::from(*d)).enumerate() {
            let want = (law(d + 1e-7) - law(d - 1e-7)) / 2e-7;
            let error = (f64::from(slope.0[i]) - want).abs();
            assert!(error < 1e-3 * want.abs() + 1e-6, "{system:?} {d}");
            let error = (f64::from(energy.0[i]) - law(d)).abs();
            assert!(error <= 1e-4 * law(d), "{system:?} {d}");
        }
        assert!(slope.0[0] == 0.0 && slope.0[15] < 0.0);
    }
}
