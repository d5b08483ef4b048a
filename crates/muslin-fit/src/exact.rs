//! A body from exact points: no habits, no doubts, and a build that is free.
//!
//! Points that were measured rather than detected pin a body down by themselves. What remains
//! hard is to find it: phenotypes have kinks where they are average, and how collar and shoulder
//! share the lift of an arm all but hides, so that valleys with almost no cost lie side by side.
//! Hence a start on either side of every kink, and nudges to the collars until nothing is left.

use crate::FitError;
use crate::descend::{Descent, Patience, descend};
use crate::evidence::Evidence;
use crate::figure::{Free, Shapes};
use crate::guess::Guess;
use crate::problem::{Problem, Trust};
use crate::solve::Fitter;
use crate::start::Start;
use glam::{DQuat, DVec3};
use muslin_body::Shape;

/// The phenotypes that change a skeleton most; the others keep their expected values.
pub const BUILD: [(&str, f64); 6] = [
    ("gender", 1.0),
    ("age", 1.0),
    ("muscle", 1.0),
    ("weight", 1.0),
    ("height", 1.0),
    ("proportions", 1.0),
];

/// Those of them that have a kink in the middle.
const KINKED: [usize; 2] = [2, 3];

/// Half the sum of squares at which points count as met: some millionths of a millimetre.
const MET: f64 = 1e-14;

/// A first descent, and one that goes all the way.
const FIRST: Patience = Patience {
    steps: 150,
    saving: 1e-7,
    enough: MET,
};
const LAST: Patience = Patience {
    steps: 600,
    saving: 0.0,
    enough: MET,
};

/// How far a collar is nudged [rad].
const NUDGES: [f64; 2] = [0.15, 0.3];

/// Weights under which nothing but the points counts.
pub fn trust(focal: f64) -> Trust {
    Trust {
        pixel: 0.002,
        world: [0.01, 0.01],
        doubt: None,
        priors: false,
        focal: (focal, 1.0),
        scale: 1e-4,
        height: None,
        slopes_hold: 0.0,
    }
}

/// The free part of a build.
pub fn build(fitter: &Fitter) -> Result<Vec<Free>, FitError> {
    Free::list(fitter.avatar(), fitter.folded(), &BUILD)
}

/// The shape and stance that meet exact points in picture and space.
///
/// `focal`: about the camera's focal length [px]. None without shoulders and hips in space.
pub fn meet(
    fitter: &Fitter,
    evidence: &Evidence,
    focal: f64,
) -> Result<Option<(Shape, Descent)>, FitError> {
    let free = build(fitter)?;
    let whole = Shapes::new(fitter.avatar(), fitter.folded(), &Shape::default(), &free)?;
    let features = whole.features(&whole.start());
    let start = Start {
        folded: fitter.folded(),
        features: &features,
        evidence,
        habits: fitter.habits(),
        focal,
        shape: whole.start(),
    };
    let Some(mut first) = start.shown() else {
        return Ok(None);
    };
    first.log_scale = 0.0;
    let mut tries = corners(&whole, &start, &first);
    tries.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let mut steps: usize = tries.iter().map(|t| t.1.steps).sum();
    for (problem, end) in &mut tries {
        let further = descend(problem, end.guess.clone(), LAST);
        steps += further.steps;
        *end = further;
        if end.cost <= MET {
            break;
        }
    }
    tries.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let (problem, end) = tries.swap_remove(0);
    let best = over_ridges(fitter, &problem, end);
    steps += best.steps;
    let shape = whole.shape(&best.guess.shape);
    Ok(Some((shape, Descent { steps, ..best })))
}

/// A first descent on either side of every kink.
fn corners<'a>(
    whole: &Shapes<'a>,
    start: &Start<'a>,
    first: &Guess,
) -> Vec<(Problem<'a>, Descent)> {
    let corner = |corner: usize| {
        let (mut shapes, mut guess) = (whole.clone(), first.clone());
        for (bit, &k) in KINKED.iter().enumerate() {
            let upper = corner >> bit & 1 == 1;
            shapes.keep_side(k, upper);
            guess.shape[k] = if upper { 0.75 } else { 0.25 };
        }
        let problem = Problem {
            folded: start.folded,
            shapes,
            evidence: start.evidence,
            habits: start.habits,
            touch: None,
            steps: Vec::new(),
            trust: trust(start.focal),
        };
        let end = descend(&problem, guess, FIRST);
        (problem, end)
    };
    (0..1 << KINKED.len()).map(corner).collect()
}

/// Nudges the collars over the ridges to neighbouring valleys while points are not met.
fn over_ridges(fitter: &Fitter, problem: &Problem, from: Descent) -> Descent {
    let mut best = Descent { steps: 0, ..from };
    for nudge in nudges() {
        if best.cost <= MET {
            break;
        }
        let mut guess = best.guess.clone();
        nudge.apply(fitter, &mut guess);
        let end = descend(problem, guess, LAST);
        let steps = best.steps + end.steps;
        if end.cost < best.cost {
            best = end;
        }
        best.steps = steps;
    }
    best
}

/// A turn of one collar that the arm takes back.
struct Nudge {
    side: &'static str,
    turn: DQuat,
}

impl Nudge {
    fn apply(&self, fitter: &Fitter, guess: &mut Guess) {
        let group = |name: &str| fitter.folded().group(&format!("{name}.{}", self.side));
        if let (Some(collar), Some(shoulder)) = (group("collar"), group("shoulder")) {
            // Two bones share the collar's turn, so the arm takes it back twice.
            guess.turns[collar] *= self.turn;
            guess.turns[shoulder] = (self.turn * self.turn).inverse() * guess.turns[shoulder];
        }
    }
}

/// Small and larger ones, about each axis and both ways, left and right.
fn nudges() -> impl Iterator<Item = Nudge> {
    let along = |angle: f64| {
        DVec3::AXES
            .into_iter()
            .flat_map(move |a| [a * angle, -a * angle])
    };
    let turns = NUDGES.into_iter().flat_map(along);
    turns.flat_map(|t| {
        ["L", "R"].map(|side| Nudge {
            side,
            turn: DQuat::from_scaled_axis(t),
        })
    })
}
