//! The suite of `muslin_energy` put to the laws of sixteen poses, ours and the published ones, on the states that the
//! reference laws are asked on.
//!
//! A question is about one pose; the other fifteen are the same cloth elsewhere, so that a pose that heard of another
//! would be found out.

use std::cell::Cell;

use glam::{DVec2, DVec3};
use muslin_energy::check::states::{self, STATES};
use muslin_energy::check::{self, Rng, Scale, Tally};
use muslin_energy::hinge::Bend;
use muslin_energy::membrane::Stretch;
use muslin_energy::{Local, outer};
use muslin_sim::{Cloth, Material};

use crate::cut::Cut;
use crate::lanes::{LANES, Lane, Row, points};
use crate::laws::{self, Wall};

/// Errors that rounding to seven digits leaves of a derivative by differences: of the middle state, and of the 99th in a
/// hundred.
const ERRORS: [f64; 2] = [3e-5, 2e-2];
/// What it leaves of forces that should add up to nothing, and of those that should turn with the cloth: beside their
/// own size, and beside what the answer owes to coordinates that are rounded a metre or two from the origin [m].
const PUSHED: f64 = 1e-6;
const TURNED: f64 = 1e-3;
const ROUNDED: f64 = 3e-7;

/// Sixteen poses of cloth of a few vertices: adds gradients [N], gives energies [J].
pub(crate) type Law<'a> = &'a dyn Fn(&[Row], &mut [Row]) -> Lane;

/// The law as the suite asks for it, in one pose after the other.
fn one_pose<const N: usize>(law: Law<'_>) -> impl Fn(&[DVec3; N]) -> Local<N> {
    let turn = Cell::new(0);
    move |x| {
        let asked = turn.replace((turn.get() + 1) % LANES);
        let mut rows = vec![[0.0; LANES]; 3 * N];
        for (v, p) in x.iter().enumerate() {
            for (axis, p) in p.to_array().into_iter().enumerate() {
                let elsewhere = |lane: usize| 1.0 + 0.1 * (lane as f64 - asked as f64);
                rows[3 * v + axis] = std::array::from_fn(|lane| (p * elsewhere(lane)) as f32);
            }
        }
        let mut g = vec![[0.0; LANES]; 3 * N];
        let energy = law(&rows, &mut g);
        Local {
            energy: f64::from(energy.0[asked]),
            gradient: points(&g, asked).try_into().expect("as many as asked"),
            ..Local::ZERO
        }
    }
}

/// Positions that single precision holds as they are.
fn rounded<const N: usize>(x: [DVec3; N]) -> [DVec3; N] {
    x.map(|p| p.as_vec3().as_dvec3())
}

/// What was found of a law on all states.
#[derive(Default)]
pub(crate) struct Found {
    orders: Tally,
    turned: f64,
    pushed: f64,
}

impl Found {
    /// Asks a law of `N` vertices at `x` [m], which lie `near` [m] each other, so near that rounding matters, and which
    /// resists being moved by `stiffness` [N/m].
    pub(crate) fn ask<const N: usize>(
        &mut self,
        law: Law<'_>,
        (x, near, stiffness): ([DVec3; N], f64, f64),
        rng: &mut Rng,
    ) {
        // Near the origin, for there the digits are those of the cloth.
        let x = rounded(x.map(|p| p - x[0]));
        let law = one_pose::<N>(law);
        let owed = stiffness * ROUNDED / TURNED;
        let scale = Scale {
            energy: owed * near,
            force: owed,
        };
        self.orders
            .add(check::gradient_order(&law, &x, 0.1 * near, rng));
        let turned = check::rigid_defect(&law, &x, scale, rng);
        let pushed = check::momentum_defect(&law(&x), &x, scale);
        (self.turned, self.pushed) = (self.turned.max(turned), self.pushed.max(pushed));
    }

    /// Holds what was found to what single precision can do.
    pub(crate) fn passes(&self, name: &str) {
        assert_eq!(self.orders.second_in_single(ERRORS), Ok(()), "{name}");
        assert!(self.turned < TURNED, "{name}: {:e}", self.turned);
        assert!(self.pushed < PUSHED, "{name}: {:e}", self.pushed);
    }
}

/// Cloth of these faces and corners as cut [m].
pub(crate) fn cloth(faces: &[[u32; 3]], corners: &[DVec2]) -> Cloth {
    Cloth {
        rest: states::corners(faces, corners),
        materials: vec![Material {
            density: 0.2,
            stretch: Stretch {
                warp: 1500.0,
                weft: 1000.0,
                shear: 150.0,
                compression: 0.3,
            },
            bend: Bend {
                warp: 6e-5,
                weft: 4e-5,
            },
            limit: None,
            friction: 0.3,
            thickness: 5e-4,
        }],
        material_of: vec![0; faces.len()],
        layers: vec![0; corners.len()],
        pins: Vec::new(),
        faces: faces.to_vec(),
    }
}

/// A triangle at `x` [m] of cloth that resists with so much [N/m], as [`Found::ask`] is told of it: the thinner it is, the
/// more a move stretches it, and turns its yarns.
pub(crate) fn pulled(cut: &[DVec2; 3], x: [DVec3; 3], k: f64) -> ([DVec3; 3], f64, f64) {
    let flat = cut.map(|c| c.extend(0.0));
    let longest = flat[0].distance(flat[1]).max(flat[0].distance(flat[2]));
    let near = states::height(&x);
    (x, near, k * longest / states::height(&flat).min(near))
}

#[test]
fn the_membrane_of_sixteen_poses_passes() {
    let (mut rng, mut found) = (Rng::new(1), Found::default());
    for _ in 0..STATES {
        let corners = states::triangle(&mut rng);
        let cut = Cut::new(&cloth(&[[0, 1, 2]], &corners)).expect("it has an area");
        let x = states::deformed(corners, &mut rng);
        let law = |x: &[Row], g: &mut [Row]| laws::membrane(&cut, 1.0, x, g);
        found.ask(&law, pulled(&corners, x, 1500.0), &mut rng);
    }
    found.passes("membrane");
}

#[test]
fn the_bending_of_sixteen_poses_passes() {
    let (mut rng, mut found) = (Rng::new(2), Found::default());
    for _ in 0..STATES {
        let corners = states::star(&mut rng);
        let cut = Cut::new(&cloth(&states::STAR, &corners)).expect("it has an area");
        let x = states::crumpled(&corners, &mut rng);
        let law = |x: &[Row], g: &mut [Row]| {
            let mut energy = Lane::all(0.0);
            for v in 0..6 {
                let (part, pull) = laws::bending(&cut, x, v);
                energy += part;
                pull.add_to(g, v as u32);
            }
            energy
        };
        let size = corners[0].distance(corners[1]);
        let firm = cut.bend(0).iter().map(|b| f64::from(b.1.abs())).sum();
        found.ask(&law, (x, size, firm), &mut rng);
    }
    found.passes("bending");
}

/// A push at a gap [m], one pose after the other: energy [J], slope [N], and curvature [N/m] where it is told.
pub(crate) fn push_passes(name: &str, push: impl Fn(Lane) -> [Lane; 3], tells_curvature: bool) {
    let mut rng = Rng::new(5);
    let [mut first, mut second] = [Tally::default(), Tally::default()];
    for i in 0..STATES {
        let (normal, lane) = (rng.vector().normalize(), i % LANES);
        let law = |x: &[DVec3; 1]| {
            let gaps = Lane(std::array::from_fn(|l| {
                (normal.dot(x[0]) + 1e-4 * (l as f64 - lane as f64)) as f32
            }));
            let [energy, slope, curvature] = push(gaps).map(|k| f64::from(k.0[lane]));
            Local {
                energy,
                gradient: [normal * slope],
                hessian: [[outer(normal, normal) * curvature]],
            }
        };
        let x = [normal * rng.between(-4e-3, 4e-3)];
        first.add(check::gradient_order(law, &x, 2e-4, &mut rng));
        second.add(check::hessian_order(law, &x, 2e-4, &mut rng));
        assert!(check::lowest_eigenvalue(&law(&x)) > -1e-9, "{name}");
    }
    assert_eq!(first.second_in_single(ERRORS), Ok(()), "{name}");
    if tells_curvature {
        assert_eq!(second.second_in_single(ERRORS), Ok(()), "{name}");
    }
}

#[test]
fn the_wall_of_sixteen_poses_passes() {
    let wall = Wall {
        radius: 3e-3,
        width: 1e-3,
        stiffness: 800.0,
    };
    push_passes("wall", |gap| wall.at(gap), true);
}
