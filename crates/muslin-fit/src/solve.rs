//! The fit: from keypoints to a shape, a pose and a camera.

use crate::FitError;
use crate::camera::Camera;
use crate::descend::{Descent, Patience, descend};
use crate::evidence::Evidence;
use crate::figure::{Free, Shapes};
use crate::fold::{Folded, N_MARKERS};
use crate::ground::{Stand, at_rest};
use crate::guess::{Guess, Placed, view};
use crate::joint::Habit;
use crate::problem::{Problem, Trust, stature};
use crate::start::Start;
use crate::touch::Touch;
use crate::upright::upright;
use crate::{doubts, place};
use glam::DVec3;
use muslin_body::{Avatar, Keypoints, Pose, Shape};

/// What is known about the person beside the picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitOptions {
    /// Crown to sole [m]; the fitted body has exactly this height.
    pub height_m: Option<f64>,
    /// Mass [kg]; the fitted body's volume agrees with it.
    pub weight_kg: Option<f64>,
    /// Who to expect: gender, age and whatever else is known.
    pub shape: Shape,
    /// Focal length [px], if known; else it is fitted around 1.2 times the longer side.
    pub focal_px: Option<f64>,
}

/// A body over a person in a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Who.
    pub shape: Shape,
    /// How they stand: over the origin, feet on y = 0, facing +z.
    pub pose: Pose,
    /// Who looks.
    pub camera: Camera,
    /// Mean distance of seen points (score at least a half) from the body's own [px].
    pub reprojection_px: f64,
    /// Lowest score among the points that were used.
    pub lowest_score: f64,
    /// How many points were used.
    pub n_points: usize,
    /// What the points do not show, in words for a reader.
    pub uncertain: Vec<String>,
    /// Steps of the solver, over all starts.
    pub iterations: usize,
    /// Half the sum of squares at the end, in standard deviations.
    pub cost: f64,
}

/// The fit's view of an avatar; make it once for many people.
#[derive(Debug, Clone)]
pub struct Fitter<'a> {
    avatar: &'a Avatar,
    folded: Folded,
    habits: Vec<Option<Habit>>,
    lengths: Vec<Free>,
    /// `∂height/∂phenotype` of an average body [m].
    height_slope: f64,
}

/// Fits one body; see [`Fitter::fit`].
pub fn fit(avatar: &Avatar, keypoints: &Keypoints, options: &FitOptions) -> Result<Fit, FitError> {
    Fitter::new(avatar)?.fit(keypoints, options)
}

/// Sliders that make limbs and trunk longer or shorter, with how far people stray.
const LENGTHS: [(&str, f64); 7] = [
    ("height", 0.5),
    ("measure-upperarm-length", 0.35),
    ("measure-shoulder-dist", 0.25),
    ("measure-napetowaist-dist", 0.25),
    ("measure-waisttohip-dist", 0.25),
    ("measure-upperleg-height", 0.35),
    ("measure-lowerleg-height", 0.35),
];

/// Where the height stands among the phenotypes.
const HEIGHT: usize = 4;
/// And the weight.
const WEIGHT: usize = 3;
/// How far off a mass may be [kg], and that of the body a fit starts from.
const MASS_OFF: f64 = 0.005;
const MASS_ABOUT: f64 = 0.5;

/// What the spreads of a leg's joints shrink to where its foot is not seen at all.
const RESTS: [(&str, f64); 3] = [("hip", 0.5), ("knee", 0.15), ("ankle", 0.2)];

/// From this score on a foot counts as seen.
const SEEN: f64 = 0.6;

/// Points that a fit needs.
const LEAST_POINTS: usize = 6;

/// Focal length expected of an unknown camera, over the longer side of the picture, and the
/// spread of its logarithm: from a telephone's main camera (0.75) to a short tele lens (2.4).
const FOCAL: (f64, f64) = (1.2, 0.4);

/// How far a detector's places in space stray across and along the view [m].
const WORLD_SPREAD: [f64; 2] = [0.06, 0.15];

/// First tries are rough, the last one is not.
const ROUGH: Patience = Patience {
    steps: 5,
    saving: 0.05,
    enough: 0.0,
};
const FINE: Patience = Patience {
    steps: 25,
    saving: 1e-3,
    enough: 0.0,
};

const BRIEF: Patience = Patience {
    steps: 2,
    saving: 1e-2,
    enough: 0.0,
};

impl<'a> Fitter<'a> {
    /// Prepares an avatar. Takes some milliseconds.
    pub fn new(avatar: &'a Avatar) -> Result<Fitter<'a>, FitError> {
        let folded = Folded::new(avatar)?;
        let mut features = vec![DVec3::ZERO; folded.n_features()];
        folded.add_phenotypes(&Shape::default().phenotypes, &mut features);
        let habits = habits(&folded, &features);
        let lengths = Free::list(avatar, &folded, &LENGTHS)?;
        let slope = folded.slopes(&Shape::default().phenotypes, &[HEIGHT]);
        let height_slope = stature(&slope[0]);
        Ok(Fitter {
            avatar,
            folded,
            habits,
            lengths,
            height_slope,
        })
    }

    /// Fits shape, pose and camera to the keypoints of one person.
    ///
    /// Height and mass are met exactly, where given. Girth and the twist of straight limbs
    /// are not in keypoints: they stay as expected and are listed as uncertain.
    /// Fails with fewer than six usable points, or without both hips or both shoulders.
    pub fn fit(&self, keypoints: &Keypoints, options: &FitOptions) -> Result<Fit, FitError> {
        let mut evidence = Evidence::new(keypoints);
        enough(&evidence)?;
        let base = match options.weight_kg {
            Some(_) => self.met(options.shape.clone(), options, MASS_ABOUT)?,
            None => options.shape.clone(),
        };
        let focal = options.focal_px.unwrap_or(FOCAL.0 * evidence.longest);
        evidence.turn_from_ray(focal);
        let fine = Shapes::new(self.avatar, &self.folded, &base, &self.lengths)?;
        let rough = fine.frozen();
        // The solver's crown and sole are two points; the tallest and lowest may be others.
        let folded_height = stature(&rough.features(&[]));
        let grow = match options.height_m {
            Some(m) => m - self.avatar.height_of(&base)?,
            None => 0.0,
        };
        let trust = Trust {
            pixel: 0.012,
            world: WORLD_SPREAD,
            doubt: Some(3.0),
            priors: true,
            focal: (
                focal,
                if options.focal_px.is_some() {
                    1e-3
                } else {
                    FOCAL.1
                },
            ),
            scale: 0.3,
            height: Some(folded_height + grow),
            slopes_hold: 0.2,
        };
        let end = self.search(&evidence, trust, [rough, fine.clone()]);
        let shape = self.met(fine.shape(&end.guess.shape), options, MASS_OFF)?;
        let known = Shapes::new(self.avatar, &self.folded, &shape, &self.lengths)?;
        let known = known.features(&known.start());
        Ok(self.finish(&evidence, options, (shape, known), end))
    }

    /// `shape` with the height that is given, and the mass to `off` [kg].
    fn met(&self, shape: Shape, options: &FitOptions, off: f64) -> Result<Shape, FitError> {
        let Some(kg) = options.weight_kg else {
            return match options.height_m {
                Some(m) => self.of_height(shape, m),
                None => Ok(shape),
            };
        };
        let metres = match options.height_m {
            Some(m) => m,
            None => self.avatar.height_of(&shape)?,
        };
        // Where secants leave what a body can be, another height may have the weight all the same.
        match self.of_mass(&shape, metres, (kg, off)) {
            Ok(Some(met)) => Ok(met),
            _ => Ok(shape.with_height_and_mass(self.avatar, metres, kg)?),
        }
    }

    /// `shape` with this height and mass [m, kg] by its weight phenotype alone, if a few secants
    /// get there: a mass costs milliseconds.
    fn of_mass(
        &self,
        shape: &Shape,
        metres: f64,
        (kg, off): (f64, f64),
    ) -> Result<Option<Shape>, FitError> {
        let mut met = self.of_height(shape.clone(), metres)?;
        let mut missing = kg - self.avatar.mass_of(&met)?;
        // From thin to heavy a mass about doubles.
        let mut slope = kg;
        for _ in 0..5 {
            if missing.abs() < off {
                return Ok(Some(met));
            }
            let mut next = met.clone();
            next.phenotypes[WEIGHT] = (met.phenotypes[WEIGHT] + missing / slope).clamp(0.0, 1.0);
            let step = next.phenotypes[WEIGHT] - met.phenotypes[WEIGHT];
            if step == 0.0 {
                return Ok(None);
            }
            met = self.of_height(next, metres)?;
            let still = kg - self.avatar.mass_of(&met)?;
            slope = (missing - still) / step;
            missing = still;
        }
        Ok((missing.abs() < off).then_some(met))
    }

    /// `shape` made `metres` tall. Heights are linear in the height phenotype while crown and
    /// sole stay the same vertices, so a secant hits; the body's own way where they do not.
    fn of_height(&self, shape: Shape, metres: f64) -> Result<Shape, FitError> {
        let mut tall = shape.clone();
        let mut slope = self.height_slope;
        let mut missing = metres - self.avatar.height_of(&tall)?;
        for _ in 0..3 {
            if missing.abs() < 1e-6 {
                return Ok(tall);
            }
            let h = tall.phenotypes[HEIGHT];
            let next = (h + missing / slope).clamp(0.0, 1.0);
            tall.phenotypes[HEIGHT] = next;
            if next == h {
                break;
            }
            let still = metres - self.avatar.height_of(&tall)?;
            slope = (missing - still) / (next - h);
            missing = still;
        }
        match missing.abs() < 1e-5 {
            true => Ok(tall),
            false => Ok(shape.with_height(self.avatar, metres)?),
        }
    }

    pub(crate) fn avatar(&self) -> &'a Avatar {
        self.avatar
    }

    pub(crate) fn folded(&self) -> &Folded {
        &self.folded
    }

    pub(crate) fn habits(&self) -> &[Option<Habit>] {
        &self.habits
    }

    /// The best descent from all starts, with `shapes` for rough and for fine tries.
    fn search(&self, evidence: &Evidence, trust: Trust, shapes: [Shapes; 2]) -> Descent {
        let features = shapes[0].features(&[]);
        let touch = Touch::new(&self.folded, &features);
        let habits = at_rest_unseen(&self.folded, &self.habits, evidence);
        let [rough, mut fine] = shapes.map(|shapes| Problem {
            folded: &self.folded,
            shapes,
            evidence,
            habits: &habits,
            touch: None,
            steps: Vec::new(),
            trust,
        });
        fine.touch = Some(&touch);
        let start = Start {
            folded: &self.folded,
            features: &features,
            evidence,
            habits: &self.habits,
            focal: trust.focal.0,
            shape: Vec::new(),
        };
        let shown = if evidence.has_depth() {
            start.shown()
        } else {
            None
        };
        let tries = match shown {
            Some(guess) => vec![Descent {
                guess,
                cost: 0.0,
                steps: 0,
            }],
            None => all_round(&rough, &start),
        };
        let spent: usize = tries.iter().map(|t| t.steps).sum();
        let ends = tries.into_iter().take(2).map(|mut tried| {
            tried.guess.shape = fine.shapes.start();
            descend(&fine, tried.guess, FINE)
        });
        let ends: Vec<Descent> = ends.collect();
        let steps = spent + ends.iter().map(|e| e.steps).sum::<usize>();
        let best = ends.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = best.expect("at least one try");
        let end = self.set_down(&mut fine, best);
        Descent {
            steps: steps + end.steps,
            ..end
        }
    }

    /// Brings a foot that is near the floor down to it, and a trunk that is nearly upright up.
    fn set_down(&self, problem: &mut Problem, at: Descent) -> Descent {
        let features = problem.shapes.features(&at.guess.shape);
        let placed = Placed::new(&self.folded, &features, &at.guess);
        let stand = Stand::new(&self.folded, &features, &placed);
        let up = stand.up();
        problem.steps = stand.steps(up);
        let ease = upright(&self.folded, &features, &placed, up);
        problem.steps.extend(ease);
        if problem.steps.is_empty() {
            return Descent { steps: 0, ..at };
        }
        descend(problem, at.guess, BRIEF)
    }

    fn finish(
        &self,
        evidence: &Evidence,
        options: &FitOptions,
        (shape, features): (Shape, Vec<DVec3>),
        end: Descent,
    ) -> Fit {
        let markers = Placed::new(&self.folded, &features, &end.guess).markers;
        let (pose, world_from_camera) =
            place::world(self.avatar, &self.folded, &features, &end.guess);
        let camera = Camera {
            focal: end.guess.log_focal.exp(),
            centre: evidence.centre,
            world_from_camera,
        };
        let scores = evidence.seen.iter().map(|s| s.score);
        Fit {
            shape,
            pose,
            camera,
            reprojection_px: reprojection(evidence, &end.guess, &markers),
            lowest_score: scores.fold(1.0, f64::min),
            n_points: evidence.seen.len(),
            uncertain: doubts::list(evidence, options),
            iterations: end.steps,
            cost: end.cost,
        }
    }
}

/// Rough descents from eight directions, the best first.
fn all_round(problem: &Problem, start: &Start) -> Vec<Descent> {
    let eighth = |k: i32| f64::from(k) * std::f64::consts::FRAC_PI_4;
    let mut tries: Vec<Descent> = (0..8)
        .map(|k| descend(problem, start.turned(eighth(k)), ROUGH))
        .collect();
    tries.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    tries
}

/// What each joint group likes, with the direction of its bone at rest.
fn habits(folded: &Folded, features: &[DVec3]) -> Vec<Option<Habit>> {
    let markers = Placed::new(folded, features, &at_rest(folded, features)).markers;
    let along = |group: usize| {
        let first = folded
            .joints
            .iter()
            .position(|j| j.group == group)
            .unwrap_or(0);
        let last = folded
            .joints
            .iter()
            .rposition(|j| j.group == group)
            .unwrap_or(0);
        let child = folded.joints.iter().position(|j| j.parent == Some(last));
        let end = match (folded.groups[group].split('.').next(), child) {
            (Some("ankle"), _) => markers[17 + usize::from(folded.groups[group].ends_with('R'))],
            (Some("wrist"), _) => {
                markers[N_MARKERS - 4 + usize::from(folded.groups[group].ends_with('R'))]
            }
            (Some("waist" | "chest" | "neck" | "head"), _) => features[first] + DVec3::Y,
            (_, Some(child)) => features[child],
            _ => features[first] + DVec3::Y,
        };
        end - features[first]
    };
    folded
        .groups
        .iter()
        .enumerate()
        .map(|(g, name)| Habit::of(name, along(g)))
        .collect()
}

/// Habits by what a picture shows: a leg whose foot is not seen rests more than it strays.
fn at_rest_unseen(
    folded: &Folded,
    habits: &[Option<Habit>],
    evidence: &Evidence,
) -> Vec<Option<Habit>> {
    let mut habits = habits.to_vec();
    for (side, [ankle, heel]) in [("L", [15, 21]), ("R", [16, 22])] {
        let score = |k: usize| evidence.marker(k).map_or(0.0, |s| s.score);
        let seen = (score(ankle).min(score(heel)) / SEEN).min(1.0);
        for (joint, rest) in RESTS {
            let group = folded.group(&format!("{joint}.{side}"));
            if let Some(habit) = group.and_then(|g| habits[g].as_mut()) {
                habit.spread *= rest + (1.0 - rest) * seen;
            }
        }
    }
    habits
}

fn enough(evidence: &Evidence) -> Result<(), FitError> {
    let found = evidence.seen.len();
    let pair = |m: [usize; 2]| m.iter().all(|&k| evidence.marker(k).is_some());
    if found < LEAST_POINTS || !(pair([5, 6]) || pair([11, 12])) {
        return Err(FitError::TooFewPoints {
            found,
            need: LEAST_POINTS,
        });
    }
    Ok(())
}

/// Mean distance of the seen points from the markers [px].
fn reprojection(evidence: &Evidence, guess: &Guess, markers: &[DVec3]) -> f64 {
    let focal = guess.log_focal.exp();
    let miss = |s: &&crate::evidence::Seen| view(markers[s.marker], focal).0.distance(s.pixel);
    let clear: Vec<_> = evidence.seen.iter().filter(|s| s.score >= 0.5).collect();
    let counted = if clear.is_empty() {
        evidence.seen.iter().collect()
    } else {
        clear
    };
    counted.iter().map(miss).sum::<f64>() / counted.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_light_people_have_a_body_and_no_number_is_lost() {
        let avatar = Avatar::embedded().expect("a sound body");
        let fitter = Fitter::new(&avatar).expect("a human rig");
        let asked = |metres: f64, kg: f64| {
            let options = FitOptions {
                height_m: Some(metres),
                weight_kg: Some(kg),
                ..FitOptions::default()
            };
            fitter.met(Shape::default(), &options, MASS_OFF)
        };
        let shape = asked(1.29, 30.0).expect("in reach");
        let off = avatar.height_of(&shape).expect("a height") - 1.29;
        assert!(off.abs() < 1e-3, "{off}");
        let fault = asked(0.9, 30.0).expect_err("no adult is as short");
        assert!(!fault.to_string().contains("NaN"), "{fault}");
    }
}
