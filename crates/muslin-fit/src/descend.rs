//! Levenberg-Marquardt on rotations.

use crate::guess::Guess;
use crate::problem::{Problem, Skin};
use crate::system::{Sums, System};

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// Steps at most.
    pub steps: usize,
    /// Stop when a step saves less than this part of the cost.
    pub saving: f64,
    /// Stop when the cost is no more than this.
    pub enough: f64,
}

/// Where a descent ended.
#[derive(Debug, Clone)]
pub struct Descent {
    /// The best guess.
    pub guess: Guess,
    /// Its cost.
    pub cost: f64,
    /// How many times the equations were built.
    pub steps: usize,
}

/// Unknowns without evidence are held as if by a row of this square weight.
const FLOOR: f64 = 1.0;

/// Minimises the problem from `start`.
pub fn descend(problem: &Problem, start: Guess, patience: Patience) -> Descent {
    let mut skin = problem.skin(&start, None, true);
    let mut at = Descent {
        cost: problem.cost(&start, &skin),
        guess: start,
        steps: 0,
    };
    let mut lambda = 1e-3;
    while at.steps < patience.steps && at.cost.is_finite() && at.cost > patience.enough {
        at.steps += 1;
        let system = equations(problem, &at.guess, &skin);
        let before = at.cost;
        while lambda < 1e9 {
            match attempt(problem, &system, &at, &skin, lambda) {
                Some((guess, found, cost)) => {
                    (at.guess, at.cost, skin) = (guess, cost, found);
                    lambda = (lambda * 0.1).max(1e-15);
                    break;
                }
                None => lambda *= 6.0,
            }
        }
        if at.cost >= before * (1.0 - patience.saving) {
            break;
        }
        skin = problem.skin(&at.guess, Some(skin), true);
    }
    at
}

fn equations(problem: &Problem, guess: &Guess, skin: &Skin) -> System {
    let mut sums = Sums::new(problem.columns().len());
    problem.rows(guess, skin, &mut |columns, values, r, w| {
        sums.add(columns, values, r, w)
    });
    let mut system = sums.done();
    let first = problem.columns().shape();
    for i in 0..guess.shape.len() {
        // A value at the end of its range stays unless it wants back.
        let mut nudged = guess.shape.clone();
        nudged[i] += 1e-9f64.copysign(system.fall(first + i));
        problem.shapes.clamp(&mut nudged);
        if nudged[i] == guess.shape[i] {
            system.hold(first + i);
        }
    }
    system
}

/// A step that lowers the cost, if this damping gives one.
fn attempt(
    problem: &Problem,
    system: &System,
    at: &Descent,
    skin: &Skin,
    lambda: f64,
) -> Option<(Guess, Skin, f64)> {
    let step = system.solve(lambda, FLOOR)?;
    let mut guess = at.guess.step(&problem.columns(), &step);
    problem.shapes.clamp(&mut guess.shape);
    let skin = problem.skin(&guess, Some(skin.clone()), false);
    let cost = problem.cost(&guess, &skin);
    (cost < at.cost).then_some((guess, skin, cost))
}
