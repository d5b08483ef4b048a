//! The free part of the shape: which phenotypes and sliders the solver may move.

use crate::FitError;
use crate::fold::Folded;
use glam::DVec3;
use muslin_body::{Avatar, PHENOTYPES, Shape};

/// Phenotypes with two anchors: features are linear in each (gender, age, height, proportions).
const STRAIGHT: [usize; 4] = [0, 1, 4, 5];

/// How far from a kink a slope is surely that of one side.
const KINK: f64 = 1e-9;

/// A shape parameter that the solver may change, made ready.
#[derive(Debug, Clone)]
pub struct Free {
    name: String,
    kind: Kind,
    spread: f64,
}

#[derive(Debug, Clone)]
enum Kind {
    /// Index in [`PHENOTYPES`].
    Phenotype(usize),
    /// How the features move when the slider goes up by one, and down by one.
    Slider([Vec<DVec3>; 2]),
}

/// Shapes around `base`, by the values of their free parameters.
#[derive(Debug, Clone)]
pub struct Shapes<'a> {
    folded: &'a Folded,
    base: Shape,
    free: &'a [Free],
    /// What all shapes have in common: sliders that are not free, and the phenotypes where
    /// `slope` is known.
    fixed: Vec<DVec3>,
    /// How features change with the only free phenotype, if they are linear in it; empty if
    /// no phenotype is free.
    slope: Option<Vec<DVec3>>,
    /// Least and greatest value of every free parameter.
    ranges: Vec<[f64; 2]>,
}

impl Free {
    /// Makes phenotypes and sliders ready: name, and how far people stray.
    pub fn list(
        avatar: &Avatar,
        folded: &Folded,
        free: &[(&str, f64)],
    ) -> Result<Vec<Free>, FitError> {
        let one = |&(name, spread): &(&str, f64)| {
            let phenotype = PHENOTYPES.iter().position(|p| *p == name);
            let kind = match phenotype {
                Some(i) => Kind::Phenotype(i),
                None => Kind::Slider(folded.slider(avatar, name)?),
            };
            Ok(Free {
                name: name.to_string(),
                kind,
                spread,
            })
        };
        free.iter().map(one).collect()
    }

    fn range(&self) -> [f64; 2] {
        match self.kind {
            Kind::Phenotype(i) if PHENOTYPES[i] == "age" => [2.0 / 3.0, 1.0],
            Kind::Phenotype(_) => [0.0, 1.0],
            Kind::Slider(_) => [-1.0, 1.0],
        }
    }

    fn prior(&self, base: &Shape) -> f64 {
        match self.kind {
            Kind::Phenotype(i) => base.phenotypes[i],
            Kind::Slider(_) => base
                .locals
                .iter()
                .find(|l| l.0 == self.name)
                .map_or(0.0, |l| l.1),
        }
    }
}

impl<'a> Shapes<'a> {
    /// Shapes that differ from `base` in `free`.
    pub fn new(
        avatar: &Avatar,
        folded: &'a Folded,
        base: &Shape,
        free: &'a [Free],
    ) -> Result<Shapes<'a>, FitError> {
        let mut fixed = vec![DVec3::ZERO; folded.n_features()];
        for (name, value) in &base.locals {
            if !free.iter().any(|f| f.name == *name) {
                add_side(&mut fixed, &folded.slider(avatar, name)?, *value);
            }
        }
        let base = base.clone();
        let mut shapes = Shapes {
            folded,
            base,
            free,
            fixed,
            slope: None,
            ranges: free.iter().map(Free::range).collect(),
        };
        let phenotypes = shapes.free_phenotypes();
        if phenotypes.len() < 2 && phenotypes.iter().all(|i| STRAIGHT.contains(i)) {
            folded.add_phenotypes(&shapes.base.phenotypes, &mut shapes.fixed);
            let slopes = folded.slopes(&shapes.base.phenotypes, &phenotypes);
            shapes.slope = Some(slopes.into_iter().next().unwrap_or_default());
        }
        Ok(shapes)
    }

    /// The base shape alone, with nothing free.
    pub fn frozen(&self) -> Shapes<'a> {
        let fixed = self.features(&self.start());
        Shapes {
            fixed,
            free: &[],
            slope: Some(Vec::new()),
            ranges: Vec::new(),
            ..self.clone()
        }
    }

    fn free_phenotypes(&self) -> Vec<usize> {
        let index = |f: &Free| {
            if let Kind::Phenotype(i) = f.kind {
                Some(i)
            } else {
                None
            }
        };
        self.free.iter().filter_map(index).collect()
    }

    /// How many parameters are free.
    pub fn n_free(&self) -> usize {
        self.free.len()
    }

    /// Their values at the base shape.
    pub fn start(&self) -> Vec<f64> {
        self.free.iter().map(|f| f.prior(&self.base)).collect()
    }

    /// Expected value and spread of parameter `i`.
    pub fn prior(&self, i: usize) -> (f64, f64) {
        (self.free[i].prior(&self.base), self.free[i].spread)
    }

    /// Brings values into the ranges that shapes may have.
    pub fn clamp(&self, values: &mut [f64]) {
        for (&[least, most], value) in self.ranges.iter().zip(values) {
            *value = value.clamp(least, most);
        }
    }

    /// Keeps parameter `i` on one side of the middle of its range, where it may have a kink.
    pub fn keep_side(&mut self, i: usize, upper: bool) {
        let [least, most] = &mut self.ranges[i];
        let middle = 0.5 * (*least + *most);
        if upper {
            *least = middle + KINK;
        } else {
            *most = middle - KINK;
        }
    }

    /// The shape that these values stand for.
    pub fn shape(&self, values: &[f64]) -> Shape {
        let mut shape = self.base.clone();
        for (free, &value) in self.free.iter().zip(values) {
            match free.kind {
                Kind::Phenotype(i) => shape.phenotypes[i] = value,
                Kind::Slider(_) => shape = shape.with_local(&free.name, value),
            }
        }
        shape
    }

    /// The features of that shape [m].
    pub fn features(&self, values: &[f64]) -> Vec<DVec3> {
        let mut phenotypes = self.base.phenotypes;
        let mut features = self.fixed.clone();
        for (free, &value) in self.free.iter().zip(values) {
            match (&free.kind, &self.slope) {
                (Kind::Phenotype(i), Some(slope)) => {
                    let change = value - phenotypes[*i];
                    features
                        .iter_mut()
                        .zip(slope)
                        .for_each(|(f, s)| *f += change * *s);
                }
                (Kind::Phenotype(i), None) => phenotypes[*i] = value,
                (Kind::Slider(sides), _) => add_side(&mut features, sides, value),
            }
        }
        if self.slope.is_none() {
            self.folded.add_phenotypes(&phenotypes, &mut features);
        }
        features
    }

    /// `∂features/∂value` for every free parameter.
    pub fn slopes(&self, values: &[f64]) -> Vec<Vec<DVec3>> {
        let mut by_phenotype = match &self.slope {
            Some(slope) => vec![slope.clone()],
            None => self
                .folded
                .slopes(&self.shape(values).phenotypes, &self.free_phenotypes()),
        }
        .into_iter();
        let slope = |(free, &value): (&Free, &f64)| match &free.kind {
            Kind::Phenotype(_) => by_phenotype.next().expect("one slope per phenotype"),
            Kind::Slider([up, _]) if value >= 0.0 => up.clone(),
            Kind::Slider([_, down]) => down.iter().map(|d| -*d).collect(),
        };
        self.free.iter().zip(values).map(slope).collect()
    }
}

/// Adds what a slider at `value` does.
fn add_side(features: &mut [DVec3], [up, down]: &[Vec<DVec3>; 2], value: f64) {
    let side = if value < 0.0 { down } else { up };
    features
        .iter_mut()
        .zip(side)
        .for_each(|(f, d)| *f += value.abs() * *d);
}
