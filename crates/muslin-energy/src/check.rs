//! The suite that a law must pass, whoever computes it.
//!
//! A law comes as a closure from positions to a [`Local`]; a fast variant wraps itself in one and
//! runs the same questions: is the gradient the derivative of the energy, the Hessian that of the
//! gradient, both to second order; is the Hessian never indefinite; does moving the whole change
//! nothing; do the forces add up to no force and no turn. [`states`] makes what it is asked on.

mod dense;
mod rng;
pub mod states;

use glam::{DMat3, DQuat, DVec3};

use crate::Local;
pub use dense::{Eigen, eigen};
pub use rng::Rng;

/// How often a step is halved.
const HALVINGS: i32 = 18;

/// How a central difference approaches a derivative as the step halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Observed order: error ∝ stepᵒʳᵈᵉʳ. 2 if no error is visible above rounding.
    pub slope: f64,
    /// Smallest error over all steps, and over all steps and their halves extrapolated to none (Richardson), relative
    /// to the derivative.
    pub error: f64,
}

/// The orders of many states together.
#[derive(Clone, Debug, Default)]
pub struct Tally(Vec<Order>);

impl Tally {
    /// Adds one state.
    pub fn add(&mut self, order: Order) {
        self.0.push(order);
    }

    /// Whether the states show second order: every one meets `error`, the median order lies in
    /// 1.9 to 2.1, and 99 in 100 reach 1.85. The hundredth may step across a kink of the third
    /// derivative, where no difference quotient knows its order.
    ///
    /// # Errors
    /// A sentence that says which of the three failed, and by how much.
    pub fn second(&self, error: f64) -> Result<(), String> {
        let mut slopes: Vec<f64> = self.0.iter().map(|o| o.slope).collect();
        slopes.sort_by(f64::total_cmp);
        let worst = self.0.iter().map(|o| o.error).fold(0.0, f64::max);
        let median = slopes[slopes.len() / 2];
        let low = slopes.iter().filter(|s| **s < 1.85).count();
        if worst > error || worst.is_nan() {
            return Err(format!("worst error {worst:e}, allowed {error:e}"));
        }
        if !(1.9..2.1).contains(&median) {
            return Err(format!("median order {median:.3}"));
        }
        if low * 100 > slopes.len() {
            return Err(format!(
                "{low} of {} states below second order",
                slopes.len()
            ));
        }
        Ok(())
    }

    /// Whether the states show second order as far as single precision lets it be seen: the median order lies in 1.9 to
    /// 2.1, and half of the states meet the first of `errors`, 99 in 100 the second. The hundredth is nearly degenerate:
    /// what its coordinates lose by rounding is as large as its strain.
    ///
    /// # Errors
    /// A sentence that says which of the three failed, and by how much.
    pub fn second_in_single(&self, errors: [f64; 2]) -> Result<(), String> {
        let sorted = |of: fn(&Order) -> f64| {
            let mut all: Vec<f64> = self.0.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (slopes, found) = (sorted(|o| o.slope), sorted(|o| o.error));
        let n = slopes.len();
        let median = slopes[n / 2];
        if !(1.9..2.1).contains(&median) {
            return Err(format!("median order {median:.3}"));
        }
        for (at, allowed) in [n / 2, (n * 99).div_ceil(100) - 1].into_iter().zip(errors) {
            let error = found[at];
            if error > allowed || error.is_nan() {
                return Err(format!(
                    "{at} of {n} states with an error of less than {error:e}, allowed {allowed:e}"
                ));
            }
        }
        Ok(())
    }
}

/// Order at which differences of the energy approach the gradient, along a random direction.
///
/// `step`: the largest step [m]; it is halved 18 times. Choose it well below the smallest length
/// that matters to the state (a triangle's height, a barrier's width).
pub fn gradient_order<const N: usize>(
    law: impl Fn(&[DVec3; N]) -> Local<N>,
    x: &[DVec3; N],
    step: f64,
    rng: &mut Rng,
) -> Order {
    let p = rng.direction();
    let here = law(x);
    let slope = dot(&here.gradient, &p);
    let size = norm(&here.gradient) + f64::MIN_POSITIVE;
    observe(step, size, |h| {
        let ends = law(&moved(x, &p, h)).energy - law(&moved(x, &p, -h)).energy;
        [DVec3::X * (ends / (2.0 * h) - slope)]
    })
}

/// Order at which differences of the gradient approach Hessian times direction.
///
/// Only for states where the Hessian is meant to be exact. Steps as in [`gradient_order`].
pub fn hessian_order<const N: usize>(
    law: impl Fn(&[DVec3; N]) -> Local<N>,
    x: &[DVec3; N],
    step: f64,
    rng: &mut Rng,
) -> Order {
    let p = rng.direction();
    let change = times(&law(x).hessian, &p);
    let size = frobenius(&law(x).hessian) + f64::MIN_POSITIVE;
    observe(step, size, |h| {
        let (ahead, behind) = (
            law(&moved(x, &p, h)).gradient,
            law(&moved(x, &p, -h)).gradient,
        );
        let mut off = [DVec3::ZERO; N];
        for i in 0..N {
            off[i] = (ahead[i] - behind[i]) / (2.0 * h) - change[i];
        }
        off
    })
}

/// Reads the order off errors at halving steps: the median over the last of them that are clearly
/// above rounding. Rounding grows as the step halves, so the smallest steps tell how large it is.
fn observe<const N: usize>(step: f64, size: f64, off: impl Fn(f64) -> [DVec3; N]) -> Order {
    let offs: Vec<[DVec3; N]> = (0..=HALVINGS)
        .map(|k| off(step * 0.5_f64.powi(k)))
        .collect();
    let errors: Vec<f64> = offs.iter().map(norm).collect();
    // What errs with the square of the step is gone.
    let extrapolated = offs.windows(2).map(|pair| {
        let at = |i: usize| (pair[1][i] * 4.0 - pair[0][i]) / 3.0;
        norm::<N>(&std::array::from_fn(at))
    });
    let floor = errors[errors.len() - 3..]
        .iter()
        .copied()
        .fold(0.0, f64::max);
    let rounding = |k: usize| floor * 0.5_f64.powi(HALVINGS - k as i32);
    let clear = (0..errors.len())
        .take_while(|k| errors[*k] > 50.0 * rounding(*k))
        .count();
    let mut slopes: Vec<f64> = errors[clear.saturating_sub(6)..clear]
        .windows(2)
        .map(|pair| (pair[0] / pair[1]).log2())
        .collect();
    slopes.sort_by(f64::total_cmp);
    let slope = if slopes.is_empty() {
        2.0
    } else {
        slopes[slopes.len() / 2]
    };
    let all = errors.iter().copied().chain(extrapolated);
    let least = all.fold(f64::INFINITY, f64::min);
    Order {
        slope,
        error: least / size,
    }
}

/// Smallest eigenvalue of a Hessian over its largest in magnitude; 0 for a Hessian of zeros.
///
/// A law passes at −1e-9: positive semidefinite up to rounding.
pub fn lowest_eigenvalue<const N: usize>(local: &Local<N>) -> f64 {
    let values = eigen(&dense::matrix(&local.hessian)).values;
    let size = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let least = values.iter().fold(f64::INFINITY, |m, v| m.min(*v));
    if size > 0.0 { least / size } else { 0.0 }
}

/// The Hessian nearest to `blocks` that has no negative eigenvalue (they are set to zero).
pub fn projected<const N: usize>(blocks: &[[DMat3; N]; N]) -> [[DMat3; N]; N] {
    dense::blocks(&eigen(&dense::matrix(blocks)).without_negative())
}

/// `|A − B| / |B|` in the Frobenius norm; the norm of `A` if `B` is zero.
pub fn difference<const N: usize>(a: &[[DMat3; N]; N], b: &[[DMat3; N]; N]) -> f64 {
    let mut off = *a;
    for i in 0..N {
        for j in 0..N {
            off[i][j] -= b[i][j];
        }
    }
    let size = frobenius(b);
    if size > 0.0 {
        frobenius(&off) / size
    } else {
        frobenius(&off)
    }
}

/// How far the Hessian is from symmetric, relative to its norm.
pub fn asymmetry<const N: usize>(local: &Local<N>) -> f64 {
    let mut transposed = local.hessian;
    for i in 0..N {
        for j in 0..N {
            transposed[i][j] = local.hessian[j][i].transpose();
        }
    }
    difference(&transposed, &local.hessian)
}

/// What a random turn and shift of the whole changes: energy, and gradient against the turned one.
///
/// Relative to `scale.energy` [J] and to the largest force plus `scale.force` [N], which name what
/// counts as nothing for the law.
pub fn rigid_defect<const N: usize>(
    law: impl Fn(&[DVec3; N]) -> Local<N>,
    x: &[DVec3; N],
    scale: Scale,
    rng: &mut Rng,
) -> f64 {
    let (turn, shift) = (DQuat::from_scaled_axis(rng.vector() * 3.0), rng.vector());
    let (here, there) = (law(x), law(&x.map(|p| turn * p + shift)));
    let mut off = [DVec3::ZERO; N];
    for i in 0..N {
        off[i] = there.gradient[i] - turn * here.gradient[i];
    }
    let energy = (there.energy - here.energy).abs() / (here.energy.abs() + scale.energy);
    energy.max(norm(&off) / (norm(&here.gradient) + scale.force))
}

/// What counts as nothing for a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// [J]
    pub energy: f64,
    /// [N]
    pub force: f64,
}

/// Sum of forces and of turning moments about the centroid, relative to the forces' own size.
pub fn momentum_defect<const N: usize>(local: &Local<N>, x: &[DVec3; N], scale: Scale) -> f64 {
    let centre = x.iter().sum::<DVec3>() / N as f64;
    let reach = x.iter().fold(0.0_f64, |m, p| m.max(p.distance(centre)));
    let (mut force, mut moment) = (DVec3::ZERO, DVec3::ZERO);
    for i in 0..N {
        force += local.gradient[i];
        moment += (x[i] - centre).cross(local.gradient[i]);
    }
    let size = norm(&local.gradient) + scale.force;
    (force.length() / size).max(moment.length() / (size * reach + f64::MIN_POSITIVE))
}

/// Hessian times a direction.
pub fn times<const N: usize>(blocks: &[[DMat3; N]; N], p: &[DVec3; N]) -> [DVec3; N] {
    let mut out = [DVec3::ZERO; N];
    for i in 0..N {
        for j in 0..N {
            out[i] += blocks[i][j] * p[j];
        }
    }
    out
}

fn moved<const N: usize>(x: &[DVec3; N], p: &[DVec3; N], h: f64) -> [DVec3; N] {
    let mut out = *x;
    for i in 0..N {
        out[i] += p[i] * h;
    }
    out
}

fn dot<const N: usize>(a: &[DVec3; N], b: &[DVec3; N]) -> f64 {
    (0..N).map(|i| a[i].dot(b[i])).sum()
}

fn norm<const N: usize>(a: &[DVec3; N]) -> f64 {
    dot(a, a).sqrt()
}

fn frobenius<const N: usize>(blocks: &[[DMat3; N]; N]) -> f64 {
    let square = |m: &DMat3| m.to_cols_array().iter().map(|v| v * v).sum::<f64>();
    blocks.iter().flatten().map(square).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `E = Σ exp(a·x)`, its gradient scaled by `g` and its Hessian by `h`.
    fn exponential(x: &[DVec3; 2], g: f64, h: f64) -> Local<2> {
        let a = DVec3::new(0.3, -0.7, 0.4);
        let mut out = Local::ZERO;
        for i in 0..2 {
            let e = a.dot(x[i]).exp();
            out.energy += e;
            out.gradient[i] = a * (e * g);
            out.hessian[i][i] = crate::outer(a, a) * (e * h);
        }
        out
    }

    #[test]
    fn a_right_law_passes_and_a_slightly_wrong_one_does_not() {
        let x = [DVec3::new(0.1, 0.2, 0.3), DVec3::new(-0.4, 0.1, 0.9)];
        let mut rng = Rng::new(1);
        let right = |x: &[DVec3; 2]| exponential(x, 1.0, 1.0);
        let mut tally = Tally::default();
        tally.add(gradient_order(right, &x, 0.1, &mut rng));
        tally.add(hessian_order(right, &x, 0.1, &mut rng));
        assert_eq!(tally.second(1e-9), Ok(()));
        assert_eq!(tally.second_in_single([1e-9; 2]), Ok(()));
        let wrong = |x: &[DVec3; 2]| exponential(x, 1.00001, 1.00003);
        for order in [
            gradient_order(wrong, &x, 0.1, &mut rng),
            hessian_order(wrong, &x, 0.1, &mut rng),
        ] {
            assert!(Tally(vec![order]).second(1e-7).is_err(), "{order:?}");
            let single = Tally(vec![order]).second_in_single([1e-7; 2]);
            assert!(single.is_err(), "{order:?}");
        }
    }

    #[test]
    fn a_negative_eigenvalue_is_seen_and_projected_away() {
        let mut local = Local::<2>::ZERO;
        local.hessian[0][0] = DMat3::from_diagonal(DVec3::new(2.0, 0.5, -1.0));
        assert!((lowest_eigenvalue(&local) + 0.5).abs() < 1e-12);
        let mut want = local.hessian;
        want[0][0] = DMat3::from_diagonal(DVec3::new(2.0, 0.5, 0.0));
        assert!(difference(&projected(&local.hessian), &want) < 1e-12);
    }
}
