//! The exported suite put to the published laws.

use glam::DVec3;
use muslin_energy::check::Rng;
use muslin_energy::check::states::{self, STATES};

use super::super::recipe::System;
use super::*;
use crate::suite::{Found, cloth, pulled, push_passes};

/// Asks how a system stretches a triangle.
fn stretches(system: System) -> Found {
    let recipe = system.recipe();
    let firm = match recipe.stretch {
        Stretch::Edges(k) | Stretch::Yarns(k, _) => f64::from(2.0 * k),
        Stretch::StVk(mu, lambda) => f64::from(2.0 * mu + lambda),
    };
    let (mut rng, mut found) = (Rng::new(3), Found::default());
    for _ in 0..STATES {
        let corners = states::triangle(&mut rng);
        let x = states::deformed(corners, &mut rng);
        let cloth = cloth(&[[0, 1, 2]], &corners);
        let sheet = Sheet::new(recipe, &cloth, &x).expect("it has an area");
        let law = |x: &[Row], g: &mut [Row]| stretch(recipe, &sheet, x, g);
        found.ask(&law, pulled(&corners, x, firm), &mut rng);
    }
    found
}

/// Asks how a system bends two triangles that were made folded.
fn bends(system: System) -> Found {
    let recipe = system.recipe();
    let (mut rng, mut found) = (Rng::new(4), Found::default());
    for _ in 0..STATES {
        let corners = states::hinge(&mut rng);
        let made = states::folded(corners, &mut rng);
        let x: [DVec3; 4] = states::folded(corners, &mut rng);
        let cloth = cloth(&states::faces([0, 1, 2, 3]), &corners);
        let sheet = Sheet::new(recipe, &cloth, &made).expect("it has an area");
        let law = |x: &[Row], g: &mut [Row]| bend(recipe, &sheet, x, g);
        // A corner that rises by its height turns its face by a radian.
        let near = states::lower(&x);
        let firm = match recipe.bend {
            Bend::Normals(k) => 2.0 * k,
            Bend::Angles { .. } => 2.0 * sheet.hinges[0].stiffness,
        };
        let stiffness = f64::from(firm) / (near * near);
        found.ask(&law, (x, near, stiffness), &mut rng);
    }
    found
}

#[test]
fn the_stretch_of_all_three_passes() {
    for system in [System::Pbns, System::Snug, System::Ncs] {
        stretches(system).passes(&format!("{} stretch", system.name()));
    }
}

#[test]
fn the_bending_of_all_three_passes() {
    for system in [System::Pbns, System::Snug, System::Ncs] {
        bends(system).passes(&format!("{} bending", system.name()));
    }
}

#[test]
fn the_skin_of_all_three_passes() {
    for system in [System::Pbns, System::Snug, System::Ncs] {
        let touch = &system.recipe().touch;
        let push = |distance: Lane| {
            let [energy, slope] = touch.at(distance);
            [energy, slope, Lane::all(0.0)]
        };
        push_passes(&format!("{} skin", system.name()), push, false);
    }
}
