//! A heavy strip clamped level at one end: the elastica.

use glam::DVec2;

/// Steps of the integration along the strip.
const STEPS: usize = 400;

/// Angle below the horizon of the line from clamp to tip [rad].
///
/// `B θ″ = −w (L − s) cos θ`, `θ(0) = 0`, `θ′(L) = 0`, by shooting. `bend`: B [N m]; `weight`: w,
/// force per area [N/m²]; `length`: L [m].
pub fn chord(bend: f64, weight: f64, length: f64) -> f64 {
    let (mut low, mut high) = (0.0, weight * length * length / bend);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if shoot(middle, weight / bend, length).0 > 0.0 {
            high = middle;
        } else {
            low = middle;
        }
    }
    let tip = shoot(0.5 * (low + high), weight / bend, length).1;
    tip.y.atan2(tip.x)
}

/// Curvature at the tip and the tip itself (forward, down), for a curvature at the clamp.
fn shoot(curvature: f64, load: f64, length: f64) -> (f64, DVec2) {
    let h = length / STEPS as f64;
    let slope = |s: f64, [theta, bent]: [f64; 2]| [bent, -load * (length - s) * theta.cos()];
    let step = |[a, b]: [f64; 2], [p, q]: [f64; 2], h: f64| [a + p * h, b + q * h];
    let (mut at, mut tip) = ([0.0, curvature], DVec2::ZERO);
    for k in 0..STEPS {
        let s = k as f64 * h;
        let k1 = slope(s, at);
        let k2 = slope(s + 0.5 * h, step(at, k1, 0.5 * h));
        let k3 = slope(s + 0.5 * h, step(at, k2, 0.5 * h));
        let k4 = slope(s + h, step(at, k3, h));
        let mean = [0, 1].map(|i| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0);
        let next = step(at, mean, h);
        tip += DVec2::from_angle(0.5 * (at[0] + next[0])) * h;
        at = next;
    }
    (at[1], tip)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elastica_hangs_as_tabled_and_a_stiff_one_as_a_beam() {
        for (bend, degrees) in [(1e-5, 60.2), (3e-5, 35.1), (1e-4, 12.8), (3e-4, 4.4)] {
            let got = chord(bend, 0.15 * 9.81, 0.05).to_degrees();
            assert!((got - degrees).abs() < 0.1, "{got} for {degrees}");
        }
        let beam = 1.4715 * 0.05_f64.powi(3) / (8.0 * 0.1);
        assert!((chord(0.1, 1.4715, 0.05) / beam - 1.0).abs() < 1e-3);
    }
}
