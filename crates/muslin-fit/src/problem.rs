//! What the solver minimises: weighted residuals of one person, and their slopes.
//!
//! Every residual is divided by its standard deviation, so that the sum of squares is minus
//! twice the logarithm of a probability. Points are robust (Geman-McClure, `ρ = e²/(1+e²/c²)`):
//! a point that is far off counts like one that is merely off.

use crate::evidence::{Evidence, Seen};
use crate::figure::Shapes;
use crate::fold::{Folded, N_MARKERS};
use crate::ground::Step;
use crate::guess::{Columns, Guess, Placed, view};
use crate::joint::{Habit, log_slope};
use crate::touch::{Tie, Touch};
use glam::{DMat3, DVec3};

/// How much each kind of evidence is trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trust {
    /// One standard deviation of a joint in the picture, as a part of the person's extent.
    pub pixel: f64,
    /// The same in space, across the view and along it [m].
    pub world: [f64; 2],
    /// How many standard deviations a point may be off before it is doubted; none: no doubts.
    pub doubt: Option<f64>,
    /// Whether habits, limits and expectations count.
    pub priors: bool,
    /// Expected focal length [px] and the spread of its logarithm.
    pub focal: (f64, f64),
    /// Spread of the logarithm of the hints' scale.
    pub scale: f64,
    /// Crown to sole of the folded body [m], if the shape is free.
    pub height: Option<f64>,
    /// The shape's slopes are taken as good this far from where they were computed.
    pub slopes_hold: f64,
}

/// One person to fit.
pub struct Problem<'a> {
    /// The folded body.
    pub folded: &'a Folded,
    /// Free shape parameters.
    pub shapes: Shapes<'a>,
    /// Keypoints by marker.
    pub evidence: &'a Evidence,
    /// One habit per joint group; none for the root.
    pub habits: &'a [Option<Habit>],
    /// Limbs that keep apart; none where they may pass through each other.
    pub touch: Option<&'a Touch>,
    /// Feet that come down to the floor.
    pub steps: Vec<Step>,
    /// Weights.
    pub trust: Trust,
}

/// A row `values·δ + r ≈ 0`: columns, values, residual, weight.
pub type Emit<'e> = dyn FnMut(&[usize], &[f64], f64, f64) + 'e;

/// The shape's features and slopes at some values, kept while they hold.
#[derive(Debug, Clone, Default)]
pub struct Skin {
    features: Vec<DVec3>,
    slopes: Vec<Vec<DVec3>>,
    at: Vec<f64>,
}

/// Sums of squares are cut off here [standard deviations]: stiff, yet finite.
const HEIGHT_SPREAD: f64 = 1e-4;
/// A joint beyond its range by this much costs one standard deviation [rad].
const LIMIT_SPREAD: f64 = 0.04;
/// People stand upright more often than not: spread of the trunk's lean.
const LEAN_SPREAD: f64 = 0.7;

impl<'a> Problem<'a> {
    /// Where the unknowns stand.
    pub fn columns(&self) -> Columns {
        Columns {
            n_groups: self.folded.groups.len(),
            n_shape: self.shapes.n_free(),
        }
    }

    /// Features at the guess's shape; slopes too, from nearby if they are known there.
    pub fn skin(&self, guess: &Guess, old: Option<Skin>, slopes: bool) -> Skin {
        let hold = self.trust.slopes_hold;
        let near = |s: &Skin| {
            s.at.iter()
                .zip(&guess.shape)
                .all(|(a, b)| (a - b).abs() < hold)
        };
        let mut skin = match old {
            Some(skin) if guess.shape.is_empty() => return skin,
            Some(skin) => Skin {
                features: self.shapes.features(&guess.shape),
                ..skin
            },
            None => Skin {
                features: self.shapes.features(&guess.shape),
                ..Skin::default()
            },
        };
        if slopes && !guess.shape.is_empty() && (skin.slopes.is_empty() || !near(&skin)) {
            skin.slopes = self.shapes.slopes(&guess.shape);
            skin.at = guess.shape.clone();
        }
        skin
    }

    /// Joints and markers at the guess.
    pub fn place(&self, guess: &Guess, skin: &Skin) -> Placed {
        Placed::new(self.folded, &skin.features, guess)
    }

    /// Half the robust sum of squares.
    pub fn cost(&self, guess: &Guess, skin: &Skin) -> f64 {
        let placed = self.place(guess, skin);
        let mut sum = 0.0;
        for seen in &self.evidence.seen {
            let (pixel, world) = self.misses(seen, guess, &placed);
            sum += self.rho(pixel[0].powi(2) + pixel[1].powi(2));
            sum += world.map_or(0.0, |w| self.rho(w.length_squared()));
        }
        sum += self
            .ties(&placed)
            .iter()
            .map(|t| t.miss * t.miss)
            .sum::<f64>();
        self.expectations(guess, skin, &mut |_, _, r, w| sum += w * r * r);
        0.5 * sum
    }

    fn rho(&self, square: f64) -> f64 {
        self.trust
            .doubt
            .map_or(square, |c| square / (1.0 + square / (c * c)))
    }

    fn weight(&self, square: f64) -> f64 {
        self.trust
            .doubt
            .map_or(1.0, |c| (1.0 + square / (c * c)).powi(-2))
    }

    /// One standard deviation in the picture [px] and in space [m].
    fn spreads(&self, seen: &Seen) -> (f64, DVec3) {
        let k = seen.spread / seen.score.max(0.05);
        let [across, along] = self.trust.world;
        let pixel = k * self.trust.pixel * self.evidence.size.max(1.0);
        (pixel, k * DVec3::new(across, across, along))
    }

    /// By how many standard deviations a marker misses its pixel and its place.
    fn misses(&self, seen: &Seen, guess: &Guess, placed: &Placed) -> ([f64; 2], Option<DVec3>) {
        let (pixel_spread, world_spread) = self.spreads(seen);
        let x = placed.markers[seen.marker];
        let (pixel, _) = view(x, guess.log_focal.exp());
        let miss = (pixel - seen.pixel) / pixel_spread;
        let place = |w: DVec3| (x - guess.origin - guess.log_scale.exp() * w) / world_spread;
        (miss.to_array(), seen.world.map(place))
    }

    /// All rows at the guess, to be minimised together.
    pub fn rows(&self, guess: &Guess, skin: &Skin, emit: &mut Emit) {
        let placed = self.place(guess, skin);
        let by_shape: Vec<Vec<DVec3>> = skin
            .slopes
            .iter()
            .map(|s| placed.shape_slope(self.folded, s))
            .collect();
        let mut scratch = Scratch::default();
        for seen in &self.evidence.seen {
            scratch.fill(self, &placed, &by_shape, seen.marker);
            self.pixel_rows(seen, guess, &placed, &mut scratch, emit);
            self.world_rows(seen, guess, &placed, &mut scratch, emit);
        }
        for tie in self.ties(&placed) {
            self.tie_row(&tie, &placed, &by_shape, emit);
        }
        self.expectations(guess, skin, emit);
    }

    /// What limbs and feet want.
    fn ties(&self, placed: &Placed) -> Vec<Tie> {
        let mut ties = self.touch.map_or(Vec::new(), |t| t.ties(placed));
        ties.extend(self.steps.iter().map(|s| s.tie(placed)));
        ties
    }

    fn tie_row(&self, tie: &Tie, placed: &Placed, by_shape: &[Vec<DVec3>], emit: &mut Emit) {
        let columns = self.columns();
        let mut row = vec![0.0; columns.len()];
        let mut by_turn = Vec::new();
        for &(k, w) in &tie.ends {
            let along = tie.along * (w / tie.spread);
            let mut add = |first: usize, v: [f64; 3]| (0..3).for_each(|i| row[first + i] += v[i]);
            add(0, along.to_array());
            placed.turn_slopes(self.folded, k, &mut by_turn);
            for (g, slope) in &by_turn {
                add(columns.turn(*g), (slope.transpose() * along).to_array());
            }
            for (i, slope) in by_shape.iter().enumerate() {
                row[columns.shape() + i] += along.dot(slope[k]);
            }
        }
        let used: Vec<usize> = (0..row.len()).filter(|&i| row[i] != 0.0).collect();
        let values: Vec<f64> = used.iter().map(|&i| row[i]).collect();
        emit(&used, &values, tie.miss, 1.0);
    }

    fn pixel_rows(
        &self,
        seen: &Seen,
        guess: &Guess,
        placed: &Placed,
        s: &mut Scratch,
        emit: &mut Emit,
    ) {
        let (miss, _) = self.misses(seen, guess, placed);
        let weight = self.weight(miss[0].powi(2) + miss[1].powi(2));
        let (spread, _) = self.spreads(seen);
        let (pixel, slope) = view(placed.markers[seen.marker], guess.log_focal.exp());
        for k in 0..2 {
            let by_point = DVec3::from(slope.map(|s| s[k])) / spread;
            s.values.clear();
            s.values.extend(s.slopes.iter().map(|x| by_point.dot(*x)));
            // The focal length stands between the turns and the shape, and moves the root too.
            s.values
                .insert(s.n_motion, pixel[k] / spread + by_point.dot(guess.root));
            emit(&s.columns_pixel, &s.values, miss[k], weight);
        }
    }

    fn world_rows(
        &self,
        seen: &Seen,
        guess: &Guess,
        placed: &Placed,
        s: &mut Scratch,
        emit: &mut Emit,
    ) {
        let (_, Some(miss)) = self.misses(seen, guess, placed) else {
            return;
        };
        let Some(world) = seen.world else { return };
        let weight = self.weight(miss.length_squared());
        let (_, spread) = self.spreads(seen);
        for k in 0..3 {
            let (motion, shape) = s.slopes.split_at(s.n_motion);
            let slope = |x: &DVec3| x[k] / spread[k];
            s.values.clear();
            s.values.extend(motion.iter().map(slope));
            // The three rows have all columns in common, if only to be added up together.
            s.values.extend((-DVec3::AXES[k] / spread).to_array());
            s.values.push(-guess.log_scale.exp() * world[k] / spread[k]);
            s.values.extend(shape.iter().map(slope));
            emit(&s.columns_world, &s.values, miss[k], weight);
        }
    }

    /// Rows that no picture gives: habits, limits, height, expected camera.
    fn expectations(&self, guess: &Guess, skin: &Skin, emit: &mut Emit) {
        let columns = self.columns();
        if let Some(height) = self.trust.height.filter(|_| !guess.shape.is_empty()) {
            self.height_row(height, skin, emit);
        }
        emit(
            &[columns.scale()],
            &[1.0 / self.trust.scale],
            guess.log_scale / self.trust.scale,
            1.0,
        );
        if !self.trust.priors {
            return;
        }
        for (g, habit) in self.habits.iter().enumerate() {
            if let Some(habit) = habit {
                habit_rows(habit, guess, g, columns.turn(g), emit);
            }
        }
        self.lean_rows(guess, emit);
        let (focal, spread) = self.trust.focal;
        emit(
            &[columns.focal()],
            &[1.0 / spread],
            (guess.log_focal - focal.ln()) / spread,
            1.0,
        );
        for (i, value) in guess.shape.iter().enumerate() {
            let (mean, spread) = self.shapes.prior(i);
            emit(
                &[columns.shape() + i],
                &[1.0 / spread],
                (value - mean) / spread,
                1.0,
            );
        }
    }

    fn height_row(&self, height: f64, skin: &Skin, emit: &mut Emit) {
        let first = self.columns().shape();
        let columns: Vec<usize> = (first..self.columns().len()).collect();
        let values: Vec<f64> = skin
            .slopes
            .iter()
            .map(|s| stature(s) / HEIGHT_SPREAD)
            .collect();
        let miss = (stature(&skin.features) - height) / HEIGHT_SPREAD;
        emit(&columns[..values.len()], &values, miss, 1.0);
    }

    fn lean_rows(&self, guess: &Guess, emit: &mut Emit) {
        let turn = DMat3::from_quat(guess.turns[0]);
        let first = self.columns().turn(0);
        for k in [0, 2] {
            // ∂(R exp δ) y = R (δ × y)
            let slope: [f64; 3] =
                std::array::from_fn(|i| (turn * DVec3::AXES[i].cross(DVec3::Y))[k]);
            let values = slope.map(|s| s / LEAN_SPREAD);
            emit(
                &[first, first + 1, first + 2],
                &values,
                turn.y_axis[k] / LEAN_SPREAD,
                1.0,
            );
        }
    }
}

/// Crown to sole of a folded body [m].
pub fn stature(features: &[DVec3]) -> f64 {
    features[features.len() - 2].y - features[features.len() - 1].y
}

/// Rows that draw a joint to where it rests, and back into its range.
fn habit_rows(habit: &Habit, guess: &Guess, group: usize, first: usize, emit: &mut Emit) {
    let phi = habit.read(guess.turns[group]);
    let slope = habit.axes.transpose() * log_slope(habit.axes * phi);
    let columns = [first, first + 1, first + 2];
    for k in 0..3 {
        let row = slope.row(k);
        let spread = habit.spread[k];
        emit(
            &columns,
            &(row / spread).to_array(),
            (phi[k] - habit.mean[k]) / spread,
            1.0,
        );
        let beyond = phi[k] - phi[k].clamp(habit.range[0][k], habit.range[1][k]);
        if beyond != 0.0 {
            emit(
                &columns,
                &(row / LIMIT_SPREAD).to_array(),
                beyond / LIMIT_SPREAD,
                1.0,
            );
        }
    }
}

/// Slopes of one marker: columns and values, used again for every marker.
#[derive(Default)]
struct Scratch {
    by_turn: Vec<(usize, DMat3)>,
    slopes: Vec<DVec3>,
    columns_pixel: Vec<usize>,
    columns_world: Vec<usize>,
    values: Vec<f64>,
    /// Entries of `slopes` before the shape.
    n_motion: usize,
}

impl Scratch {
    fn fill(&mut self, p: &Problem, placed: &Placed, by_shape: &[Vec<DVec3>], marker: usize) {
        debug_assert!(marker < N_MARKERS);
        placed.turn_slopes(p.folded, marker, &mut self.by_turn);
        self.by_turn.sort_by_key(|t| t.0);
        let columns = p.columns();
        self.slopes.clear();
        self.slopes.extend(DVec3::AXES);
        self.columns_pixel.clear();
        self.columns_pixel.extend([0, 1, 2]);
        for (g, m) in &self.by_turn {
            let first = columns.turn(*g);
            self.columns_pixel.extend([first, first + 1, first + 2]);
            self.slopes.extend([m.x_axis, m.y_axis, m.z_axis]);
        }
        self.n_motion = self.slopes.len();
        self.slopes.extend(by_shape.iter().map(|s| s[marker]));
        self.columns_world.clone_from(&self.columns_pixel);
        self.columns_pixel.push(columns.focal());
        let origin = columns.origin();
        self.columns_world
            .extend([origin, origin + 1, origin + 2, columns.scale()]);
        let shape = columns.shape()..columns.shape() + by_shape.len();
        self.columns_pixel.extend(shape.clone());
        self.columns_world.extend(shape);
    }
}
