//! The laws on a hinge: the angle form and the flat one, each on more than a thousand states.

mod patch;

use glam::{DVec2, DVec3};
use muslin_energy::check::states::{self, NO_FOLD, STATES, faces, folded, lower};
use muslin_energy::check::{self, Rng, Tally};
use muslin_energy::flat::{self, FlatHinge};
use muslin_energy::hinge::{self, RestHinge};
use muslin_energy::{Local, outer};
use patch::DENIM;

/// Rest state, positions and step of a random hinge.
fn state(rng: &mut Rng) -> (RestHinge, FlatHinge, [DVec3; 4], f64) {
    let corners = states::hinge(rng);
    let x = folded(corners, rng);
    let rest = RestHinge::new(faces(corners), &DENIM, rng.between(-0.5, 0.5));
    let step = 0.03 * lower(&x);
    (rest, FlatHinge::new(faces(corners), &DENIM), x, step)
}

#[test]
fn gradients_converge_at_second_order() {
    let (mut rng, mut angles, mut flats) = (Rng::new(1), Tally::default(), Tally::default());
    for _ in 0..STATES {
        let (rest, flat, x, step) = state(&mut rng);
        angles.add(check::gradient_order(
            |x| hinge::hessian(x, &rest),
            &x,
            step,
            &mut rng,
        ));
        flats.add(check::gradient_order(
            |x| flat::hessian(x, &flat),
            &x,
            step,
            &mut rng,
        ));
    }
    assert_eq!(angles.second(1e-7), Ok(()));
    assert_eq!(flats.second(1e-7), Ok(()));
}

#[test]
fn the_flat_hessian_is_exact_and_so_is_the_angle_one_at_its_rest_angle() {
    let (mut rng, mut angles, mut flats) = (Rng::new(2), Tally::default(), Tally::default());
    for _ in 0..STATES {
        let (rest, flat, x, step) = state(&mut rng);
        let rest = RestHinge {
            angle: hinge::angle(&x),
            ..rest
        };
        angles.add(check::hessian_order(
            |x| hinge::hessian(x, &rest),
            &x,
            step,
            &mut rng,
        ));
        flats.add(check::hessian_order(
            |x| flat::hessian(x, &flat),
            &x,
            step,
            &mut rng,
        ));
    }
    assert_eq!(angles.second(1e-6), Ok(()));
    assert_eq!(flats.second(1e-6), Ok(()));
}

#[test]
fn away_from_rest_the_hessian_is_the_outer_product_of_the_angle_s_gradient() {
    let (mut rng, mut tally) = (Rng::new(3), Tally::default());
    for _ in 0..STATES {
        let (rest, _, x, step) = state(&mut rng);
        let angle = |x: &[DVec3; 4]| {
            let (energy, gradient) = hinge::angle_gradient(x);
            Local {
                energy,
                gradient,
                ..Local::ZERO
            }
        };
        tally.add(check::gradient_order(angle, &x, step, &mut rng));
        let g = angle(&x).gradient;
        let mut want = [[glam::DMat3::ZERO; 4]; 4];
        for i in 0..4 {
            for j in 0..4 {
                want[i][j] = outer(g[i], g[j]) * (2.0 * rest.stiffness);
            }
        }
        assert!(check::difference(&hinge::hessian(&x, &rest).hessian, &want) < 1e-12);
    }
    assert_eq!(tally.second(1e-7), Ok(()));
}

#[test]
fn hessians_are_never_indefinite_and_symmetric() {
    let mut rng = Rng::new(4);
    for _ in 0..STATES {
        let (rest, flat, x, _) = state(&mut rng);
        for local in [hinge::hessian(&x, &rest), flat::hessian(&x, &flat)] {
            assert!(check::lowest_eigenvalue(&local) > -1e-9);
            assert!(check::asymmetry(&local) < 1e-12);
        }
    }
}

#[test]
fn turning_and_shifting_changes_nothing_and_forces_leave_momentum_and_spin_alone() {
    let mut rng = Rng::new(5);
    for _ in 0..STATES {
        let (rest, flat, x, _) = state(&mut rng);
        let by_angle = |x: &[DVec3; 4]| hinge::hessian(x, &rest);
        let by_flat = |x: &[DVec3; 4]| flat::hessian(x, &flat);
        assert!(check::rigid_defect(by_angle, &x, NO_FOLD, &mut rng) < 1e-6);
        assert!(check::rigid_defect(by_flat, &x, NO_FOLD, &mut rng) < 1e-6);
        assert!(check::momentum_defect(&by_angle(&x), &x, NO_FOLD) < 1e-8);
        assert!(check::momentum_defect(&by_flat(&x), &x, NO_FOLD) < 1e-8);
    }
}

#[test]
fn energy_and_gradient_alone_say_the_same() {
    let mut rng = Rng::new(6);
    for _ in 0..100 {
        let (rest, flat, x, _) = state(&mut rng);
        let full = hinge::hessian(&x, &rest);
        assert_eq!(hinge::gradient(&x, &rest), (full.energy, full.gradient));
        assert!((hinge::energy(&x, &rest) - full.energy).abs() <= 1e-9 * full.energy);
        let full = flat::hessian(&x, &flat);
        assert_eq!(flat::gradient(&x, &flat), (full.energy, full.gradient));
        assert_eq!(flat::energy(&x, &flat), full.energy);
    }
}

#[test]
fn a_flat_hinge_at_rest_stores_nothing() {
    let mut rng = Rng::new(7);
    for _ in 0..100 {
        let corners = states::hinge(&mut rng);
        let x = corners.map(|c| c.extend(0.4));
        let flat = FlatHinge::new(faces(corners), &DENIM);
        let rest = RestHinge::new(faces(corners), &DENIM, 0.0);
        assert!(hinge::energy(&x, &rest) < 1e-24);
        assert!(flat::energy(&x, &flat) < 1e-20);
    }
}

#[test]
fn the_angle_is_positive_where_the_faces_fall_away_from_their_normals() {
    for fold in [-2.0, -0.5, 0.0, 0.3, 3.0_f64] {
        let (s, c) = fold.sin_cos();
        let x = [
            DVec3::ZERO,
            DVec3::X,
            DVec3::new(0.4, 1.0, 0.0),
            DVec3::new(0.4, -c, -s),
        ];
        assert!((hinge::angle(&x) - fold).abs() < 1e-12);
    }
}

#[test]
fn faces_without_area_push_nowhere() {
    let corners = [
        DVec2::ZERO,
        DVec2::X,
        DVec2::new(0.5, 1.0),
        DVec2::new(0.5, -1.0),
    ];
    let rest = RestHinge::new(faces(corners), &DENIM, 0.2);
    for x in [
        [DVec3::ONE; 4],
        [DVec3::ZERO, DVec3::X, DVec3::X * 0.5, DVec3::NEG_Y],
    ] {
        let local = hinge::hessian(&x, &rest);
        assert!(local.energy.is_finite() && local.gradient.iter().all(|g| g.is_finite()));
    }
    let line = [[DVec2::ZERO, DVec2::X, DVec2::X * 2.0]; 2];
    assert_eq!(RestHinge::new(line, &DENIM, 0.0).stiffness, 0.0);
    assert_eq!(FlatHinge::new(line, &DENIM).stiffness, 0.0);
}

#[test]
fn a_mesh_has_one_hinge_for_each_edge_between_two_faces() {
    // A tetrahedron, closed: six edges, each with two faces; then with one face taken away.
    let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
    assert_eq!(hinge::stencils(&faces).len(), 6);
    assert_eq!(hinge::stencils(&faces[..3]).len(), 3);
    for h in hinge::stencils(&faces) {
        let corner = |side: usize, i: usize| {
            faces[h.faces[side] as usize][(h.starts[side] as usize + i) % 3]
        };
        let [a, b, c, d] = h.verts;
        assert_eq!([corner(0, 0), corner(0, 1), corner(0, 2)], [a, b, c]);
        assert_eq!([corner(1, 0), corner(1, 1), corner(1, 2)], [b, a, d]);
    }
}
