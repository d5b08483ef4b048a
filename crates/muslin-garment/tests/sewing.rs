//! A pattern sewn around the default body.

use glam::{DAffine3, DVec2, DVec3};
use muslin_body::{Avatar, Shape};
use muslin_garment::{Curve, Garment, GarmentError, Opening, Panel, Seam, SewingPattern, Sewn};
use muslin_geom::{Mesh, intersecting_pairs, self_intersections};

fn avatar() -> Avatar {
    Avatar::embedded().expect("the embedded avatar is sound")
}

/// One half of a sleeveless tunic, as it is seen from the front.
fn half(name: &str, z: f64) -> Panel {
    let right = [
        (0.1, 0.0),
        (0.29, 0.0),
        (0.27, 0.62),
        (0.2, 0.85),
        (0.09, 0.87),
        (0.0, 0.8),
    ];
    let mut corners: Vec<DVec2> = right.iter().map(|&(x, y)| DVec2::new(x, y)).collect();
    corners[0].x = 0.0;
    let left = corners[1..5].iter().rev().map(|c| DVec2::new(-c.x, c.y));
    let mut corners: Vec<DVec2> = corners[..6].iter().copied().chain(left).collect();
    if z < 0.0 {
        // Seen from outside, the back runs the other way.
        corners[1..].reverse();
    }
    Panel {
        name: name.into(),
        curves: vec![Curve::Line; corners.len()],
        corners,
        world_from_panel: DAffine3::from_translation(DVec3::new(0.0, 0.56, z)),
    }
}

/// Front and back, sewn at the sides (edges 1 and 8) and on the shoulders (3 and 6).
fn tunic() -> SewingPattern {
    let seam = |front: u32, back: u32| Seam {
        sides: [(0, front), (1, back)],
        flipped: false,
    };
    SewingPattern {
        panels: vec![half("front", 0.3), half("back", -0.3)],
        seams: vec![seam(1, 8), seam(8, 1), seam(3, 6), seam(6, 3)],
    }
}

fn sewn(pattern: &SewingPattern) -> Result<Sewn, GarmentError> {
    Garment::sew(&avatar(), pattern, ("tunic", 0.02))
}

#[test]
fn a_tunic_is_sewn_free_of_the_body_and_of_itself_in_its_own_size() {
    let sewn = sewn(&tunic()).expect("a sound pattern");
    let (avatar, g) = (avatar(), &sewn.garment);
    assert!(sewn.gap < 1e-3, "gap {}", sewn.gap);
    assert!(sewn.strain < 0.06, "strain {}", sewn.strain);
    assert_eq!(g.panels(), ["front", "back"]);
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let worn = g.worn(&avatar, &figure, &[]).expect("a tunic");
    let cloth = Mesh {
        verts: worn.verts,
        faces: g.faces.clone(),
    };
    let skin = Mesh {
        verts: figure.verts.clone(),
        faces: avatar.collision_faces().to_vec(),
    };
    assert_eq!(intersecting_pairs(&cloth, &skin).len(), 0);
    assert_eq!(self_intersections(&cloth).len(), 0);
    // The cut is kept: so much cloth as was drawn, with the warp up the panel.
    let area = |c: &[DVec2; 3]| 0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]);
    assert!(worn.rest.iter().all(|c| area(c) > 0.0));
    let drawn: f64 = worn.rest.iter().map(area).sum();
    let corners = &tunic().panels[0].corners;
    let twice = |k: usize| corners[k].perp_dot(corners[(k + 1) % corners.len()]);
    let both: f64 = (0..corners.len()).map(twice).sum();
    assert!((drawn / both - 1.0).abs() < 1e-6, "{drawn} of {both}");
}

#[test]
fn a_tunic_has_four_openings_hangs_free_and_moves_with_the_bones_around_it() {
    let g = sewn(&tunic()).expect("a sound pattern").garment;
    let mut openings: Vec<String> = g.rims.iter().map(|r| format!("{:?}", r.opening)).collect();
    openings.sort();
    assert_eq!(openings, ["Cuff(Left)", "Cuff(Right)", "Hem", "Neck"]);
    assert!(g.pins.is_empty());
    let avatar = avatar();
    assert!(g.binding.is_convex(avatar.n_verts()));
    let weights = g.skin_weights(&avatar);
    assert!(weights.is_convex(avatar.rig().n_bones()));
    assert_eq!(weights.n_rows(), g.n_verts());
}

#[test]
fn a_sewn_garment_goes_onto_another_body_at_its_own_size() {
    let (avatar, g) = (avatar(), sewn(&tunic()).expect("a sound pattern").garment);
    let shape = Shape::default().with("weight", 0.75).expect("in range");
    let figure = avatar.figure(&shape).expect("an adult");
    let worn = g.worn(&avatar, &figure, &[]).expect("a tunic");
    let cloth = Mesh {
        verts: worn.verts,
        faces: g.faces.clone(),
    };
    let skin = Mesh {
        verts: figure.verts.clone(),
        faces: avatar.collision_faces().to_vec(),
    };
    assert_eq!(intersecting_pairs(&cloth, &skin).len(), 0);
    assert_eq!(worn.rest, g.uv);
}

#[test]
fn a_skirt_is_held_at_the_waist() {
    let sheet = |name: &str, z: f64| {
        let mut corners = [(-0.3, 0.0), (0.3, 0.0), (0.2, 0.5), (-0.2, 0.5)]
            .map(|(x, y)| DVec2::new(x, y))
            .to_vec();
        if z < 0.0 {
            corners[1..].reverse();
        }
        Panel {
            name: name.into(),
            curves: vec![Curve::Line; 4],
            corners,
            world_from_panel: DAffine3::from_translation(DVec3::new(0.0, 0.55, z)),
        }
    };
    let seam = |front: u32, back: u32| Seam {
        sides: [(0, front), (1, back)],
        flipped: false,
    };
    // The back's edges run 0-3-2-1: its sides are edges 0 and 2.
    let pattern = SewingPattern {
        panels: vec![sheet("front", 0.3), sheet("back", -0.3)],
        seams: vec![seam(1, 2), seam(3, 0)],
    };
    let g = sewn(&pattern).expect("a sound pattern").garment;
    let waist = g
        .rims
        .iter()
        .find(|r| r.opening == Opening::Waist)
        .expect("a waist");
    assert_eq!(g.pins.len(), waist.verts.len());
}

#[test]
fn outlines_that_cross_and_seams_that_turn_a_panel_over_are_named() {
    let mut crossed = tunic();
    crossed.panels[0].corners[2] = DVec2::new(-0.2, -0.2);
    let err = sewn(&crossed).expect_err("a crossing outline").to_string();
    assert!(err.contains("\"front\"") && err.contains("cross"), "{err}");
    let mut flipped = tunic();
    flipped.seams[0].flipped = true;
    let err = sewn(&flipped).expect_err("a panel turned over").to_string();
    assert!(
        err.contains("\"front\"") && err.contains("\"back\""),
        "{err}"
    );
}

#[test]
fn any_number_of_threads_sews_the_same() {
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("threads can be had");
        pool.install(|| sewn(&tunic()).expect("a sound pattern").garment)
    };
    assert_eq!(on(1), on(3));
}
