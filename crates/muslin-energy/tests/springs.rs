//! The law on an edge, on more than a thousand states.

use glam::DVec3;
use muslin_energy::check::states::{NOTHING, STATES, edge};
use muslin_energy::check::{self, Rng, Tally};
use muslin_energy::spring;

#[test]
fn gradients_converge_at_second_order_and_in_tension_the_hessian_too() {
    let (mut rng, mut first, mut second) = (Rng::new(1), Tally::default(), Tally::default());
    for _ in 0..STATES {
        let (x, rest, k) = edge(&mut rng);
        let length = x[0].distance(x[1]);
        let law = |x: &[DVec3; 2]| spring::edge(x, rest, k);
        first.add(check::gradient_order(law, &x, 0.03 * length, &mut rng));
        if length > 1.05 * rest {
            second.add(check::hessian_order(law, &x, 0.01 * length, &mut rng));
        }
    }
    assert_eq!(first.second(1e-7), Ok(()));
    assert_eq!(second.second(1e-6), Ok(()));
}

#[test]
fn hessians_are_never_indefinite_and_nothing_turns_or_drifts() {
    let mut rng = Rng::new(2);
    for _ in 0..STATES {
        let (x, rest, k) = edge(&mut rng);
        let law = |x: &[DVec3; 2]| spring::edge(x, rest, k);
        let local = law(&x);
        assert!(check::lowest_eigenvalue(&local) > -1e-9, "{x:?}");
        assert!(check::asymmetry(&local) < 1e-12);
        assert!(check::momentum_defect(&local, &x, NOTHING) < 1e-9);
        assert!(check::rigid_defect(law, &x, NOTHING, &mut rng) < 1e-6);
    }
}

#[test]
fn an_edge_at_rest_or_without_direction_pulls_at_nothing() {
    let still = spring::edge(&[DVec3::ZERO, DVec3::X * 0.25], 0.25, 50.0);
    assert_eq!((still.energy, still.gradient), (0.0, [DVec3::ZERO; 2]));
    let gone = spring::edge(&[DVec3::ONE; 2], 0.2, 50.0);
    assert_eq!(gone.gradient, [DVec3::ZERO; 2]);
    assert!((gone.energy - 1.0).abs() < 1e-12);
}
