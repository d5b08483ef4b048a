//! Bending by whole triangles: the law's suite on a thousand patches, and what cloth of any cut reads.

mod patch;

use glam::{DMat2, DVec2, DVec3};
use muslin_energy::Local;
use muslin_energy::check::states::{NO_FOLD, STAR, STATES, corners, crumpled, star};
use muslin_energy::check::{self, Rng};
use muslin_energy::hinge::Bend;
use muslin_energy::plate::{self, Plate};
use patch::DENIM;

/// The plate of the middle triangle, its rest, positions and step; one patch in three lacks neighbours.
fn state(rng: &mut Rng) -> (Plate, [DVec2; 6], [DVec3; 6], f64) {
    let points = star(rng);
    let kept = match rng.between(0.0, 1.0) {
        p if p < 0.15 => 2,
        p if p < 0.3 => 3,
        _ => 4,
    };
    let faces = &STAR[..kept];
    let plate = plate::plates(faces, &corners(faces, &points), |_| DENIM)[0].1;
    let x = crumpled(&points, rng);
    (plate, points, x, 0.03 * points[0].distance(points[1]))
}

#[test]
fn gradient_and_hessian_are_derivatives_to_rounding_for_the_law_is_quadratic() {
    let mut rng = Rng::new(1);
    for _ in 0..STATES {
        let (plate, _, x, step) = state(&mut rng);
        let law = |x: &[DVec3; 6]| plate::hessian(x, &plate);
        let slope = check::gradient_order(law, &x, step, &mut rng);
        let curve = check::hessian_order(law, &x, step, &mut rng);
        assert!(
            slope.error < 1e-7 && curve.error < 1e-7,
            "{slope:?} {curve:?}"
        );
    }
}

#[test]
fn it_is_never_indefinite_and_neither_turning_nor_shifting_changes_anything() {
    let mut rng = Rng::new(2);
    for _ in 0..STATES {
        let (plate, points, x, _) = state(&mut rng);
        let law = |x: &[DVec3; 6]| plate::hessian(x, &plate);
        let here = law(&x);
        assert!(check::lowest_eigenvalue(&here) > -1e-9);
        assert!(check::asymmetry(&here) < 1e-9);
        assert!(check::rigid_defect(law, &x, NO_FOLD, &mut rng) < 1e-6);
        assert!(check::momentum_defect(&here, &x, NO_FOLD) < 1e-6);
        assert_eq!(plate::gradient(&x, &plate), (here.energy, here.gradient));
        assert_eq!(plate::energy(&x, &plate), here.energy);
        let flat = points.map(|p| p.extend(0.4));
        assert!(plate::energy(&flat, &plate) < 1e-14);
    }
}

#[test]
fn a_cylinder_along_any_direction_costs_what_the_fabric_says_whatever_the_grain() {
    // Equilateral triangles: corners a centimetre from the middle, neighbours' twice as far.
    let at = |degrees: f64, far: f64| DVec2::from_angle(degrees.to_radians()) * far;
    let own = [90.0, 210.0, 330.0].map(|a| at(a, 0.01));
    let others = [150.0, 270.0, 30.0].map(|a| at(a, 0.02));
    let points = [own[0], own[1], own[2], others[0], others[1], others[2]];
    for grain in [0.0, 0.4, 1.1, 2.3] {
        let turned = points.map(|p| DMat2::from_angle(grain) * p);
        let plate = plate::plates(&STAR, &corners(&STAR, &turned), |_| DENIM)[0].1;
        let area = 0.5
            * (turned[1] - turned[0])
                .perp_dot(turned[2] - turned[0])
                .abs();
        for way in [0.0, 0.7, 1.6, 2.9] {
            let m = DVec2::from_angle(way);
            let x = turned.map(|p| p.extend(0.5 * p.dot(m) * p.dot(m)));
            let want = 0.5 * area * DENIM.along(m);
            let got = plate::energy(&x, &plate);
            assert!(
                (got / want - 1.0).abs() < 1e-9,
                "{grain} {way}: {got} {want}"
            );
        }
    }
}

#[test]
fn neighbours_cut_apart_or_on_another_grain_fold_as_if_they_were_one_piece() {
    let mut rng = Rng::new(3);
    for _ in 0..100 {
        let points = star(&mut rng);
        let whole = corners(&STAR, &points);
        let mut apart = whole.clone();
        for other in &mut apart[1..] {
            let (turn, shift) = (
                DMat2::from_angle(rng.between(-3.0, 3.0)),
                rng.vector().truncate(),
            );
            *other = other.map(|p| turn * p + shift);
        }
        let [a, b] = [whole, apart].map(|rest| plate::plates(&STAR, &rest, |_| DENIM)[0]);
        assert_eq!(a.0, b.0);
        let size =
            a.1.matrix
                .iter()
                .flatten()
                .map(|q| q.abs())
                .fold(0.0, f64::max);
        for (p, q) in a.1.matrix.iter().flatten().zip(b.1.matrix.iter().flatten()) {
            assert!((p - q).abs() < 1e-6 * size, "{p} {q}");
        }
    }
}

#[test]
fn beside_softer_cloth_the_softer_one_folds_and_no_area_resists_nothing() {
    let points = star(&mut Rng::new(4));
    let rest = corners(&STAR, &points);
    let soft = Bend {
        warp: 1e-6,
        weft: 1e-6,
    };
    let beside = plate::plates(&STAR, &rest, |f| if f == 2 { soft } else { DENIM })[0].1;
    assert_eq!(beside, plate::plates(&STAR, &rest, |_| soft)[0].1);

    let line = points.map(|p| DVec2::new(p.x, 0.0));
    for (_, plate) in plate::plates(&STAR, &corners(&STAR, &line), |_| DENIM) {
        assert_eq!(plate.matrix, [[0.0; 6]; 6]);
    }
    assert!(plate::entries(&STAR, &corners(&STAR, &line), |_| DENIM).is_empty());
    let alone = plate::hessian(
        &points.map(|p| p.extend(0.0)),
        &plate::plates(&STAR[..1], &rest[..1], |_| DENIM)[0].1,
    );
    assert_eq!(alone.energy, 0.0);
    assert_eq!(alone.hessian, Local::<6>::ZERO.hessian);
}

#[test]
fn the_one_matrix_is_the_sum_of_all_plates() {
    let points = star(&mut Rng::new(5));
    let rest = corners(&STAR, &points);
    let x = points.map(|p| p.extend(p.x * p.y / 0.01));
    let each: f64 = (plate::plates(&STAR, &rest, |_| DENIM).iter())
        .map(|(verts, plate)| plate::energy(&verts.map(|v| x[v as usize]), plate))
        .sum();
    let entries = plate::entries(&STAR, &rest, |_| DENIM);
    let whole: f64 = (entries.iter())
        .map(|(i, j, q)| 0.5 * q * x[*i as usize].dot(x[*j as usize]))
        .sum();
    assert!(
        each > 0.0 && (whole / each - 1.0).abs() < 1e-6,
        "{whole} {each}"
    );
}
