//! All hot laws of a garment: 10,000 triangles and 15,000 hinges, value, gradient and Hessian.
//!
//! One thread; the least of 30 runs, as everything above it is the machine's.

use std::hint::black_box;
use std::time::Instant;

use glam::{DVec2, DVec3};
use muslin_energy::check::Rng;
use muslin_energy::hinge::{self, Bend, RestHinge};
use muslin_energy::membrane::{self, Stretch};
use muslin_energy::strain::{self, StrainLimit};
use muslin_energy::{Local, RestTriangle};

const COTTON: Stretch = Stretch {
    warp: 1500.0,
    weft: 1000.0,
    shear: 150.0,
    compression: 1.0,
};
const LIMIT: StrainLimit = StrainLimit {
    start: 0.03,
    limit: 0.06,
    stiffness: 1000.0,
    wall: 0.9,
};
const BEND: Bend = Bend {
    warp: 9e-6,
    weft: 6e-6,
};

fn main() {
    let mut rng = Rng::new(1);
    let triangles: Vec<_> = (0..10_000).map(|_| triangle(&mut rng)).collect();
    let hinges: Vec<_> = (0..15_000).map(|_| hinge(&mut rng)).collect();
    let membrane = least(|| {
        triangles
            .iter()
            .map(|(rest, x)| norm(&membrane::hessian(x, rest, &COTTON)))
            .sum()
    });
    let limited = least(|| {
        triangles
            .iter()
            .map(|(rest, x)| {
                let f = rest.deformation(x);
                let mut answer = membrane::response(&f, &COTTON);
                answer.add(&strain::principal(&f, &LIMIT));
                norm(&answer.spread(rest))
            })
            .sum()
    });
    let bending = least(|| {
        hinges
            .iter()
            .map(|(rest, x)| norm(&hinge::hessian(x, rest)))
            .sum()
    });
    let energies = least(|| {
        let stretch: f64 = triangles
            .iter()
            .map(|(rest, x)| membrane::energy(x, rest, &COTTON))
            .sum();
        stretch
            + hinges
                .iter()
                .map(|(rest, x)| hinge::energy(x, rest))
                .sum::<f64>()
    });
    println!("10,000 triangles  membrane            {membrane:6.2} ms");
    println!("10,000 triangles  membrane and limit  {limited:6.2} ms");
    println!("15,000 hinges     bending             {bending:6.2} ms");
    println!("both              energy alone        {energies:6.2} ms");
}

/// A number that needs every block, so that none is optimised away.
fn norm<const N: usize>(local: &Local<N>) -> f64 {
    let blocks: f64 = local
        .hessian
        .iter()
        .flatten()
        .map(|m| m.x_axis.x + m.y_axis.y + m.z_axis.z + m.x_axis.y + m.y_axis.z + m.z_axis.x)
        .sum();
    local.energy + local.gradient.iter().map(|g| g.x + g.y + g.z).sum::<f64>() + blocks
}

/// Least wall time of 30 runs [ms].
fn least(mut work: impl FnMut() -> f64) -> f64 {
    (0..30)
        .map(|_| {
            let start = Instant::now();
            black_box(work());
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

fn triangle(rng: &mut Rng) -> (RestTriangle, [DVec3; 3]) {
    let corners = [
        DVec2::ZERO,
        DVec2::new(0.012, 0.0),
        DVec2::new(0.006, 0.0104),
    ];
    let rest = RestTriangle::new(corners).expect("an equilateral triangle");
    (rest, corners.map(|c| c.extend(0.0) + rng.vector() * 4e-4))
}

fn hinge(rng: &mut Rng) -> (RestHinge, [DVec3; 4]) {
    let [a, b, c, d] =
        [[0.0, 0.0], [0.012, 0.0], [0.006, 0.0104], [0.006, -0.0104]].map(DVec2::from);
    let rest = RestHinge::new([[a, b, c], [b, a, d]], &BEND, 0.0);
    (
        rest,
        [a, b, c, d].map(|p| p.extend(0.0) + rng.vector() * 2e-3),
    )
}
