//! The laws on one triangle: stretch, shear, strain limit, each on more than a thousand states.

use glam::{DMat3, DQuat, DVec2, DVec3};
use muslin_energy::check::states::{NOTHING, STATES, deformed, height, triangle};
use muslin_energy::check::{self, Rng, Tally};
use muslin_energy::membrane::{self, Stretch};
use muslin_energy::neo;
use muslin_energy::strain::{self, StrainLimit};
use muslin_energy::stvk::{self, Lame};
use muslin_energy::{InPlane, Local, RestTriangle};

const COTTON: Stretch = Stretch {
    warp: 1500.0,
    weft: 1000.0,
    shear: 150.0,
    compression: 1.0,
};
const SOFT: Stretch = Stretch {
    compression: 0.3,
    ..COTTON
};
const SNUG: Lame = Lame {
    mu: 11.1,
    lambda: 20.9,
};
const LIMIT: StrainLimit = StrainLimit {
    start: 0.03,
    limit: 0.06,
    stiffness: 1000.0,
    wall: 0.9,
};
type Law = fn(&[DVec3; 3], &RestTriangle) -> Local<3>;

const LAWS: [(&str, Law); 6] = [
    ("neo-Hookean", |x, rest| neo::hessian(x, rest, &SNUG)),
    ("membrane", |x, rest| membrane::hessian(x, rest, &COTTON)),
    ("membrane, soft in compression", |x, rest| {
        membrane::hessian(x, rest, &SOFT)
    }),
    ("stvk", |x, rest| stvk::hessian(x, rest, &SNUG)),
    ("principal limit", |x, rest| {
        strain::principal(&rest.deformation(x), &LIMIT).spread(rest)
    }),
    ("yarn limit", |x, rest| {
        strain::yarn(&rest.deformation(x), &LIMIT).spread(rest)
    }),
];

/// A random rest triangle, and its corners as cut.
fn rest(rng: &mut Rng) -> (RestTriangle, [DVec2; 3]) {
    let corners = triangle(rng);
    let rest = RestTriangle::new(corners).expect("a height of a thousandth is enough");
    (rest, corners)
}

/// Runs a question over all laws and states: `(law, triangle, positions, step, random)`.
fn ask(
    seed: u64,
    question: impl Fn(&str, &dyn Fn(&[DVec3; 3]) -> Local<3>, &[DVec3; 3], &mut Rng),
) {
    for (name, law) in LAWS {
        let mut rng = Rng::new(seed);
        for _ in 0..STATES {
            let (rest, corners) = rest(&mut rng);
            let x = deformed(corners, &mut rng);
            question(name, &|x| law(x, &rest), &x, &mut rng);
        }
    }
}

#[test]
fn gradients_converge_at_second_order() {
    for (name, law) in LAWS {
        let (mut rng, mut tally) = (Rng::new(1), Tally::default());
        for _ in 0..STATES {
            let (rest, corners) = rest(&mut rng);
            let x = deformed(corners, &mut rng);
            let step = 0.03 * height(&x);
            tally.add(check::gradient_order(|x| law(x, &rest), &x, step, &mut rng));
        }
        assert_eq!(tally.second(1e-7), Ok(()), "{name}");
    }
}

#[test]
fn hessians_are_never_indefinite_and_symmetric() {
    ask(2, |name, law, x, _| {
        let local = law(x);
        let low = check::lowest_eigenvalue(&local);
        assert!(low > -1e-9, "{name}: {low:e} at {x:?}");
        assert!(check::asymmetry(&local) < 1e-12, "{name}");
    });
}

#[test]
fn turning_and_shifting_the_whole_changes_nothing() {
    ask(3, |name, law, x, rng| {
        let defect = check::rigid_defect(law, x, NOTHING, rng);
        assert!(defect < 1e-6, "{name}: {defect:e} at {x:?}");
    });
}

#[test]
fn a_turn_of_cloth_that_is_no_sliver_changes_its_energy_by_a_millionth_of_a_millionth_at_most() {
    ask(13, |name, law, x, rng| {
        let x = x.map(|p| p - x[0]);
        let widest = (x[1] - x[0]).length().max((x[2] - x[0]).length());
        if height(&x) < 0.3 * widest {
            return;
        }
        let turn = DQuat::from_scaled_axis(rng.vector() * 3.0);
        let [here, there] = [law(&x).energy, law(&x.map(|p| turn * p)).energy];
        let off = (there - here).abs();
        assert!(off <= 1e-12 * here + 1e-20, "{name}: {here:e} {off:e}");
    });
}

#[test]
fn forces_leave_momentum_and_spin_alone() {
    ask(4, |name, law, x, _| {
        let defect = check::momentum_defect(&law(x), x, NOTHING);
        assert!(defect < 1e-9, "{name}: {defect:e} at {x:?}");
    });
}

#[test]
fn undeformed_cloth_stores_nothing_and_pulls_at_nothing() {
    let mut rng = Rng::new(5);
    for (name, law) in LAWS {
        for _ in 0..100 {
            let (rest, corners) = rest(&mut rng);
            let local = law(&corners.map(|c| c.extend(0.3)), &rest);
            assert!(local.energy < 1e-18, "{name}: {:e} J", local.energy);
            assert!(local.gradient.iter().all(|g| g.length() < 1e-9), "{name}");
        }
    }
}

/// The exact Hessian of the membrane on the vertices, unprojected.
fn exact(x: &[DVec3; 3], rest: &RestTriangle, hessian: [DMat3; 3]) -> Local<3> {
    let (energy, gradient) = membrane::gradient(x, rest, &COTTON);
    let hessian = InPlane {
        hessian,
        ..InPlane::ZERO
    }
    .spread(rest)
    .hessian;
    Local {
        energy,
        gradient,
        hessian,
    }
}

#[test]
fn the_exact_hessians_converge_at_second_order() {
    let (mut rng, mut weaves, mut sheets) = (Rng::new(6), Tally::default(), Tally::default());
    let mut rubbers = Tally::default();
    for _ in 0..STATES {
        let (rest, corners) = rest(&mut rng);
        let x = deformed(corners, &mut rng);
        let step = 0.03 * height(&x);
        let weave = |x: &[DVec3; 3]| {
            exact(
                x,
                &rest,
                membrane::exact_hessian(&rest.deformation(x), &COTTON),
            )
        };
        weaves.add(check::hessian_order(weave, &x, step, &mut rng));
        let sheet = |x: &[DVec3; 3]| {
            let hessian = stvk::exact_hessian(&rest.deformation(x), &SNUG);
            let (energy, gradient) = stvk::gradient(x, &rest, &SNUG);
            Local {
                energy,
                gradient,
                ..exact(x, &rest, hessian)
            }
        };
        sheets.add(check::hessian_order(sheet, &x, step, &mut rng));
        let rubber = |x: &[DVec3; 3]| {
            let hessian = neo::exact_hessian(&rest.deformation(x), &SNUG);
            let (energy, gradient) = neo::gradient(x, &rest, &SNUG);
            Local {
                energy,
                gradient,
                ..exact(x, &rest, hessian)
            }
        };
        rubbers.add(check::hessian_order(rubber, &x, step, &mut rng));
    }
    assert_eq!(rubbers.second(1e-6), Ok(()));
    assert_eq!(weaves.second(1e-6), Ok(()));
    assert_eq!(sheets.second(1e-6), Ok(()));
}

#[test]
fn strain_limits_need_no_projection_their_hessians_converge_at_second_order() {
    for (name, law) in &LAWS[4..] {
        let (mut rng, mut tally) = (Rng::new(7), Tally::default());
        for _ in 0..STATES {
            let (rest, corners) = rest(&mut rng);
            let x = deformed(corners, &mut rng);
            let step = 0.01 * height(&x);
            tally.add(check::hessian_order(|x| law(x, &rest), &x, step, &mut rng));
        }
        assert_eq!(tally.second(1e-6), Ok(()), "{name}");
    }
}

/// A deformation with no length scale of its own, some of them squeezed to a line.
fn deformation(rng: &mut Rng) -> [DVec3; 2] {
    let squeeze = if rng.between(0.0, 1.0) < 0.1 {
        1e-4
    } else {
        1.0
    };
    [
        DVec3::X + rng.vector() * 0.7,
        DVec3::Y * squeeze + rng.vector() * 0.7 * squeeze,
    ]
}

/// Deformation space seen as two points, so that the suite's projection serves it.
fn columns([uu, uv, vv]: [DMat3; 3]) -> [[DMat3; 2]; 2] {
    [[uu, uv], [uv.transpose(), vv]]
}

#[test]
fn each_membrane_term_is_the_exact_one_without_its_negative_eigenvalues() {
    let parts = [
        Stretch {
            warp: 0.0,
            weft: 0.0,
            ..COTTON
        },
        Stretch {
            warp: 0.0,
            shear: 0.0,
            ..COTTON
        },
        Stretch {
            weft: 0.0,
            shear: 0.0,
            ..SOFT
        },
    ];
    let mut rng = Rng::new(8);
    for _ in 0..STATES {
        let f = deformation(&mut rng);
        for k in &parts {
            let want = check::projected(&columns(membrane::exact_hessian(&f, k)));
            let off = check::difference(&columns(membrane::response(&f, k).hessian), &want);
            assert!(off < 1e-9, "{off:e} for {k:?} at {f:?}");
        }
    }
}

#[test]
fn the_membrane_s_hessian_in_single_precision_is_that_in_double() {
    let mut rng = Rng::new(11);
    let mut states: Vec<[DVec3; 2]> = (0..STATES).map(|_| deformation(&mut rng)).collect();
    let (x, y) = (DVec3::X, DVec3::Y);
    states.extend([[x, x], [x, -x], [x, DVec3::ZERO], [DVec3::ZERO; 2], [x, y]]);
    states.extend([[x * 1e-6, y * 1e-6], [x * (1.0 + 1e-6), y * (1.0 - 1e-6)]]);
    for f in &states {
        for k in [&COTTON, &SOFT] {
            let double = membrane::response(f, k);
            let (stress, hessian) = membrane::response_single(f, k);
            let size = 1.0 + double.stress[0].length() + double.stress[1].length();
            for (got, want) in stress.iter().zip(double.stress) {
                assert!(
                    got.distance(want) < 1e-12 * size,
                    "{got} for {want} at {f:?}"
                );
            }
            let got = columns(hessian.map(|h| h.as_dmat3()));
            let off = check::difference(&got, &columns(double.hessian));
            assert!(off < 1e-6, "{off:e} for {k:?} at {f:?}");
        }
    }
}

/// The membrane as the solver asks for it: forces in double, Hessian in single precision.
fn narrow(x: &[DVec3; 3], rest: &RestTriangle, k: &Stretch) -> Local<3> {
    let f = rest.deformation(x);
    let (stress, hessian) = membrane::response_single(&f, k);
    InPlane {
        energy: membrane::density(&f, k),
        stress,
        hessian: hessian.map(|h| h.as_dmat3()),
    }
    .spread(rest)
}

#[test]
fn the_membrane_in_single_precision_passes_the_suite() {
    for k in [&COTTON, &SOFT] {
        let (mut rng, mut tally) = (Rng::new(12), Tally::default());
        for _ in 0..STATES {
            let (rest, corners) = rest(&mut rng);
            let x = deformed(corners, &mut rng);
            let law = |x: &[DVec3; 3]| narrow(x, &rest, k);
            let here = law(&x);
            assert!(check::lowest_eigenvalue(&here) > -1e-6, "at {x:?}");
            assert!(check::asymmetry(&here) < 1e-6, "at {x:?}");
            assert!(check::rigid_defect(law, &x, NOTHING, &mut rng) < 1e-6);
            assert!(check::momentum_defect(&here, &x, NOTHING) < 1e-9);
            tally.add(check::gradient_order(law, &x, 0.03 * height(&x), &mut rng));
        }
        assert_eq!(tally.second(2e-6), Ok(()));
    }
}

#[test]
fn in_tension_along_the_yarns_the_membrane_hessian_is_exact() {
    let mut rng = Rng::new(9);
    for _ in 0..STATES {
        let along = rng.vector().normalize();
        let u = along * rng.between(1.0, 1.5);
        let v = along.any_orthonormal_vector() * rng.between(1.0, 1.5);
        let got = columns(membrane::response(&[u, v], &COTTON).hessian);
        let off = check::difference(&got, &columns(membrane::exact_hessian(&[u, v], &COTTON)));
        assert!(off < 1e-12, "{off:e}");
    }
}

#[test]
fn in_tension_the_stvk_hessian_is_exact_and_elsewhere_never_below_it() {
    let mut rng = Rng::new(10);
    for _ in 0..STATES {
        let f = deformation(&mut rng);
        let got = columns(stvk::response(&f, &SNUG).hessian);
        let mut rest = got;
        let exact = columns(stvk::exact_hessian(&f, &SNUG));
        for i in 0..2 {
            for j in 0..2 {
                rest[i][j] -= exact[i][j];
            }
        }
        let added = Local {
            energy: 0.0,
            gradient: [DVec3::ZERO; 2],
            hessian: rest,
        };
        assert!(check::lowest_eigenvalue(&added) > -1e-6 || check::difference(&got, &exact) < 1e-9);
        let tense = f.map(|c| c * 3.0);
        let off = check::difference(
            &columns(stvk::response(&tense, &SNUG).hessian),
            &columns(stvk::exact_hessian(&tense, &SNUG)),
        );
        let stretched =
            tense[0].cross(tense[1]).length() > 1.2 * tense[0].length().max(tense[1].length());
        assert!(off < 1e-12 || !stretched, "{off:e} at {tense:?}");
    }
}

#[test]
fn the_neo_hookean_hessian_is_the_exact_one_without_its_negative_eigenvalues() {
    let mut rng = Rng::new(11);
    for _ in 0..STATES {
        let f = deformation(&mut rng);
        let want = check::projected(&columns(neo::exact_hessian(&f, &SNUG)));
        let off = check::difference(&columns(neo::response(&f, &SNUG).hessian), &want);
        assert!(off < 1e-9, "{off:e} at {f:?}");
    }
}

#[test]
fn small_strains_of_a_neo_hookean_sheet_cost_what_lame_says_and_collapse_stays_finite() {
    let small = 1e-5;
    for [a, b, c] in [
        [1.0, 0.0, 0.0],
        [0.3, -0.7, 0.0],
        [0.0, 0.0, 1.0],
        [0.5, 0.2, -0.9],
    ] {
        let f = [
            DVec3::new(1.0 + a * small, c * small, 0.0),
            DVec3::new(c * small, 1.0 + b * small, 0.0),
        ];
        let lame = SNUG.mu * (a * a + b * b + 2.0 * c * c) + 0.5 * SNUG.lambda * (a + b).powi(2);
        let got = neo::density(&f, &SNUG) / (small * small);
        assert!((got / lame - 1.0).abs() < 1e-4, "{got} for {lame}");
    }
    for f in [
        [DVec3::ZERO; 2],
        [DVec3::X, DVec3::X * -0.5],
        [DVec3::X, DVec3::ZERO],
    ] {
        let at = neo::response(&f, &SNUG);
        assert!(at.energy.is_finite() && at.stress.iter().all(|s| s.is_finite()));
        assert!(at.hessian.iter().all(|h| h.is_finite()), "{f:?}");
    }
}

#[test]
fn a_pulled_strip_carries_its_stiffness_times_its_strain() {
    let corners = [DVec2::ZERO, DVec2::new(0.01, 0.0), DVec2::new(0.0, 0.01)];
    let rest = RestTriangle::new(corners).expect("a right triangle");
    let x = corners.map(|c| DVec3::new(c.x, c.y * 1.02, 0.0));
    let (energy, g) = membrane::gradient(&x, &rest, &COTTON);
    // Half of a 10 mm square: half the width's force of 1500 N/m times 2 %.
    assert!((g[2].y - 0.5 * 0.01 * 1500.0 * 0.02).abs() < 1e-12);
    assert!((energy - 0.5 * 1500.0 * 0.02 * 0.02 * rest.area).abs() < 1e-15);
}

#[test]
fn a_limit_far_exceeded_stays_finite_and_pulls_back() {
    for strain in [0.055, 0.0599, 0.06, 0.061, 0.5, 10.0] {
        let [e, slope, curvature] = LIMIT.at(1.0 + strain);
        assert!(e.is_finite() && slope.is_finite() && curvature.is_finite());
        assert!(
            slope > LIMIT.stiffness * (strain - LIMIT.start),
            "softer than the cloth at {strain}"
        );
    }
}
