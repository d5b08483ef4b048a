//! The laws on points: inertia, weight, pins, drag, contact, friction, on a thousand states each.

use glam::{DQuat, DVec3};
use muslin_energy::air::{self, Panel};
use muslin_energy::check::states::{NOTHING, STATES};
use muslin_energy::check::{self, Rng, Tally};
use muslin_energy::contact::{self, Barrier};
use muslin_energy::friction::{self, Pressed};
use muslin_energy::{Local, outer, point, point::Scheme, proximity};

const SKIN: Barrier = Barrier {
    radius: 3e-3,
    width: 1e-3,
    stiffness: 800.0,
};
/// A law on one point as a law on one vertex.
fn alone(law: impl Fn(DVec3) -> muslin_energy::AtPoint) -> impl Fn(&[DVec3; 1]) -> Local<1> {
    move |x| law(x[0]).spread(&[1.0])
}

/// Gradient and Hessian both converge, the Hessian is never indefinite.
fn passes(
    name: &str,
    step: f64,
    mut state: impl FnMut(&mut Rng) -> (Box<dyn Fn(&[DVec3; 1]) -> Local<1>>, DVec3),
) {
    let (mut rng, mut first, mut second) = (Rng::new(3), Tally::default(), Tally::default());
    for _ in 0..STATES {
        let (law, x) = state(&mut rng);
        first.add(check::gradient_order(&law, &[x], step, &mut rng));
        second.add(check::hessian_order(&law, &[x], step, &mut rng));
        let local = law(&[x]);
        assert!(check::lowest_eigenvalue(&local) > -1e-9, "{name} at {x}");
        assert!(check::asymmetry(&local) < 1e-12, "{name}");
    }
    assert_eq!(first.second(1e-7), Ok(()), "{name} gradient");
    assert_eq!(second.second(1e-6), Ok(()), "{name} Hessian");
}

#[test]
fn inertia_weight_pins_and_drag_are_right_to_second_order() {
    passes("pin", 0.1, |rng| {
        let (target, k) = (rng.vector(), rng.scale(1.0, 1e4));
        (
            Box::new(alone(move |x| point::pin(x, target, k))),
            rng.vector(),
        )
    });
    passes("inertia", 0.1, |rng| {
        let (target, m) = (rng.vector(), rng.scale(1e-6, 1e-3));
        (
            Box::new(alone(move |x| point::inertia(x, target, m, 0.004))),
            rng.vector(),
        )
    });
    passes("gravity", 0.1, |rng| {
        (
            Box::new(alone(|x| point::gravity(x, 2e-5, DVec3::NEG_Y * 9.81))),
            rng.vector(),
        )
    });
    passes("drag", 0.1, |rng| {
        let carried = rng.vector();
        (
            Box::new(alone(move |x| point::drag(x, carried, 1e-5, 0.004))),
            rng.vector(),
        )
    });
}

#[test]
fn air_is_right_to_second_order_and_pushes_with_the_square_of_the_speed() {
    passes("air", 1e-4, |rng| {
        let on = Panel {
            normal: rng.vector().normalize(),
            resistance: rng.scale(1e-6, 1e-3),
        };
        let (carried, s) = (rng.vector(), rng.scale(1e-3, 0.1));
        let x = carried + on.normal * s + on.normal.any_orthonormal_vector() * s;
        (
            Box::new(alone(move |x| air::push(x, carried, &on, 0.004))),
            x,
        )
    });
    let on = Panel {
        normal: DVec3::Y,
        resistance: 0.5 * 1.2 * 1.2 * 2.0,
    };
    // Two square metres fall flat at three metres a second, whichever way the normal points.
    for turned in [1.0, -1.0] {
        let on = Panel {
            normal: on.normal * turned,
            ..on
        };
        let at = air::push(DVec3::new(0.7, -0.03, 0.0), DVec3::ZERO, &on, 0.01);
        let up = -at.gradient;
        assert!((up - DVec3::Y * (1.44 * 9.0)).length() < 1e-12, "{up}");
    }
    assert_eq!(
        air::push(DVec3::X, DVec3::ZERO, &on, 0.01).gradient,
        DVec3::ZERO
    );
}

/// Where a weight on a spring (angular speed one) is after one radian of BDF2 steps.
fn swung(steps: usize) -> f64 {
    let h = 1.0 / steps as f64;
    // The past is the true one, so that only the scheme's own error shows.
    let true_at = |t: f64| (DVec3::X * t.cos(), DVec3::X * -t.sin());
    let ((mut x, mut v), (mut x1, mut v1)) = (true_at(0.0), true_at(-h));
    for _ in 0..steps {
        let scheme = Scheme::bdf2(h, h);
        let (inertia, spring) = (
            point::inertia(x, scheme.target([x, x1], [v, v1]), 1.0, scheme.tau),
            point::pin(x, DVec3::ZERO, 1.0),
        );
        let pull = inertia.gradient + spring.gradient;
        let next = x - pull / (inertia.hessian.x_axis.x + spring.hessian.x_axis.x);
        (v, v1) = (scheme.velocity(next, [x, x1]), v);
        (x, x1) = (next, x);
    }
    x.x
}

#[test]
fn bdf2_falls_exactly_and_swings_to_second_order() {
    let (h, g) = (0.1, DVec3::NEG_Y * 9.81);
    let at = |t: f64| {
        (
            DVec3::X * 2.0 * t + g * (0.5 * t * t),
            DVec3::X * 2.0 + g * t,
        )
    };
    for last in [h, 0.25 * h, 2.0 * h] {
        let ((x0, v0), (x1, v1)) = (at(0.3), at(0.3 - last));
        let scheme = Scheme::bdf2(h, last);
        let fallen = scheme.target([x0, x1], [v0, v1]) + g * (scheme.tau * scheme.tau);
        let (x, v) = at(0.3 + h);
        assert!((fallen - x).length() < 1e-14);
        assert!((scheme.velocity(fallen, [x0, x1]) - v).length() < 1e-13);
    }
    let errors = [20, 40, 80].map(|n| (swung(n) - 1.0_f64.cos()).abs());
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.9..2.1).contains(&order), "order {order}");
    }
}

#[test]
fn contact_with_a_plane_is_right_to_second_order_outside_touching_and_deep_inside() {
    passes("plane", 1e-4, |rng| {
        let normal = rng.vector().normalize();
        let gap = if rng.between(0.0, 1.0) < 0.5 {
            rng.between(0.0, 4e-3)
        } else {
            -rng.scale(1e-4, 0.1)
        };
        let x = normal * gap + normal.any_orthonormal_vector() * rng.between(-0.01, 0.01);
        (
            Box::new(alone(move |r| contact::plane(r, normal, &SKIN))),
            x,
        )
    });
}

#[test]
fn friction_is_right_to_second_order_sticking_sliding_and_between() {
    passes("friction", 2e-7, |rng| {
        let normal = rng.vector().normalize();
        let on = Pressed {
            normal,
            limit: rng.scale(1e-4, 0.1),
            stick: 4e-6,
        };
        let slide = rng.vector().normalize() * rng.scale(4e-7, 4e-4);
        (Box::new(alone(move |x| friction::slide(x, &on))), slide)
    });
}

#[test]
fn friction_rises_to_coulomb_s_limit_and_no_further() {
    let on = Pressed {
        normal: DVec3::Y,
        limit: 0.3,
        stick: 1e-5,
    };
    assert_eq!(friction::slide(DVec3::ZERO, &on).gradient, DVec3::ZERO);
    assert_eq!(friction::slide(DVec3::Y, &on).gradient, DVec3::ZERO);
    let half = friction::slide(DVec3::X * 5e-6, &on).gradient;
    assert!((half.x - 0.3 * 0.75).abs() < 1e-12);
    for slide in [1e-5, 1e-3, 1.0] {
        let force = friction::slide(DVec3::new(slide, 3.0 * slide, 0.0), &on).gradient;
        assert!((force - DVec3::X * 0.3).length() < 1e-12);
    }
}

#[test]
fn a_point_deep_inside_is_pushed_out_by_one_newton_step_of_its_own_contact() {
    for depth in [0.0, 1e-3, 1e-2, 0.3] {
        let at = contact::plane(DVec3::Y * -depth, DVec3::Y, &SKIN);
        let step = -at.gradient.y / at.hessian.y_axis.y;
        assert!(step > depth, "from {depth} only {step}");
        assert!(step < depth + SKIN.radius, "thrown off by {step}");
    }
}

#[test]
fn the_barrier_is_zero_at_its_radius_and_its_curvature_starts_at_zero() {
    assert_eq!(SKIN.at(SKIN.radius), [0.0; 3]);
    let [_, slope, curvature] = SKIN.at(SKIN.radius - 1e-7);
    assert!(slope < 0.0 && curvature < 0.1);
    // Across the join of cubic and parabola nothing jumps.
    let join = SKIN.radius - SKIN.width;
    for (above, below) in SKIN.at(join + 1e-12).into_iter().zip(SKIN.at(join - 1e-12)) {
        assert!((above - below).abs() < 1e-5);
    }
}

/// Where four vertices are nearest, for either kind of pair.
type Nearest = fn(&[DVec3; 4]) -> [f64; 4];

const PAIRS: [(&str, Nearest); 2] = [
    ("vertex-triangle", proximity::vertex_triangle),
    ("edge-edge", proximity::edge_edge),
];

/// Two pieces of cloth a few millimetres apart, one in five of them slivers or nearly parallel.
fn near(name: &str, rng: &mut Rng) -> [DVec3; 4] {
    let size = rng.scale(0.004, 0.03);
    let thin = if rng.between(0.0, 1.0) < 0.2 {
        rng.scale(1e-3, 0.1)
    } else {
        1.0
    };
    let mut flat = |x: f64, z: f64| {
        DVec3::new(
            x + rng.between(-0.2, 0.2),
            0.0,
            z + thin * rng.between(-0.2, 0.2),
        ) * size
    };
    let mut x = if name == "edge-edge" {
        [
            flat(-0.5, 0.0),
            flat(0.5, 0.0),
            flat(-0.4, -0.5 * thin),
            flat(0.4, 0.5 * thin),
        ]
    } else {
        [
            flat(0.0, 0.0),
            flat(-0.5, 0.0),
            flat(0.5, 0.0),
            flat(0.0, thin),
        ]
    };
    let lift = rng.between(2e-4, 3.5e-3);
    x[0].y += lift * rng.between(0.9, 1.1);
    if name == "edge-edge" {
        x[1].y += lift * rng.between(0.9, 1.1);
    }
    let (turn, at) = (DQuat::from_scaled_axis(rng.vector() * 3.0), rng.vector());
    x.map(|p| turn * p + at)
}

/// The contact of cloth with cloth, nearest points found anew at every position.
fn touching(nearest: Nearest) -> impl Fn(&[DVec3; 4]) -> Local<4> {
    move |x| {
        let weights = nearest(x);
        contact::apart(proximity::weighted(x, &weights), &SKIN).spread(&weights)
    }
}

#[test]
fn cloth_on_cloth_has_the_right_gradient_although_the_nearest_points_move() {
    for (name, nearest) in PAIRS {
        let (mut rng, mut tally) = (Rng::new(5), Tally::default());
        for _ in 0..STATES {
            let x = near(name, &mut rng);
            let gap = proximity::weighted(&x, &nearest(&x)).length();
            // Short steps, so that the nearest point seldom passes a corner within them.
            let area = (x[2] - x[1]).cross(x[3] - x[1]).length();
            let least = gap.min(area / 0.03);
            tally.add(check::gradient_order(
                touching(nearest),
                &x,
                1e-3 * least,
                &mut rng,
            ));
        }
        assert_eq!(tally.second(1e-7), Ok(()), "{name}");
    }
}

#[test]
fn cloth_on_cloth_has_the_exact_hessian_of_fixed_weights_less_its_negative_part() {
    for (name, nearest) in PAIRS {
        let (mut rng, mut tally) = (Rng::new(6), Tally::default());
        for _ in 0..STATES {
            let x = near(name, &mut rng);
            let weights = nearest(&x);
            let exact = |x: &[DVec3; 4]| {
                let r = proximity::weighted(x, &weights);
                let [energy, slope, curvature] = SKIN.at(r.length());
                let n = r.normalize();
                let across = (glam::DMat3::IDENTITY - outer(n, n)) * (slope / r.length());
                let hessian = outer(n, n) * curvature + across;
                muslin_energy::AtPoint {
                    energy,
                    gradient: n * slope,
                    hessian,
                }
                .spread(&weights)
            };
            let gap = proximity::weighted(&x, &weights).length();
            tally.add(check::hessian_order(exact, &x, 0.003 * gap, &mut rng));
            let got = touching(nearest)(&x);
            let want = check::projected(&exact(&x).hessian);
            assert!(check::difference(&got.hessian, &want) < 1e-9, "{name}");
            assert!(check::lowest_eigenvalue(&got) > -1e-9, "{name}");
        }
        assert_eq!(tally.second(1e-7), Ok(()), "{name}");
    }
}

#[test]
fn cloth_on_cloth_leaves_momentum_and_spin_alone_and_turns_with_the_whole() {
    for (name, nearest) in PAIRS {
        let mut rng = Rng::new(7);
        for _ in 0..STATES {
            let x = near(name, &mut rng);
            let local = touching(nearest)(&x);
            let defect = check::momentum_defect(&local, &x, NOTHING);
            assert!(defect < 1e-8, "{name}: {defect:e}");
            let defect = check::rigid_defect(touching(nearest), &x, NOTHING, &mut rng);
            assert!(defect < 1e-5, "{name}: {defect:e}");
        }
    }
}

#[test]
fn nearest_points_are_nearer_than_any_others() {
    for (name, nearest) in PAIRS {
        let mut rng = Rng::new(8);
        for _ in 0..STATES {
            let x = if rng.between(0.0, 1.0) < 0.5 {
                near(name, &mut rng)
            } else {
                [DVec3::ZERO; 4].map(|_| rng.vector())
            };
            let weights = nearest(&x);
            let gap = proximity::weighted(&x, &weights).length();
            assert!(weights.iter().sum::<f64>().abs() < 1e-12);
            for _ in 0..20 {
                let (s, t) = (rng.between(0.0, 1.0), rng.between(0.0, 1.0));
                let other = if name == "edge-edge" {
                    [1.0 - s, s, t - 1.0, -t]
                } else {
                    [1.0, s - 1.0, -s * t, -s * (1.0 - t)]
                };
                let there = proximity::weighted(&x, &other).length();
                assert!(there >= gap - 1e-9, "{name}: {there} below {gap} at {x:?}");
            }
        }
    }
}

#[test]
fn degenerate_pairs_answer_with_numbers() {
    let p = DVec3::new(0.1, 0.2, 0.3);
    for (name, nearest) in PAIRS {
        for x in [
            [p; 4],
            [p, p + DVec3::X, p, p + DVec3::X],
            [p + DVec3::Y, p, p + DVec3::X, p + DVec3::X * 2.0],
        ] {
            let local = touching(nearest)(&x);
            assert!(local.energy.is_finite(), "{name}");
            assert!(local.gradient.iter().all(|g| g.is_finite()), "{name}");
            assert!(
                local.hessian.iter().flatten().all(|m| m.is_finite()),
                "{name}"
            );
        }
    }
}
