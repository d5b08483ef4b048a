//! The free part of the shape: which phenotypes and sliders the solver may move.

use crate::FitError;
use crate::fold::Folded;
use glam::DVec3;
use muslin_body::{Avatar, PHENOTYPES, Shape};

/// A shape parameter that the solver may change.
#[derive(Debug, Clone)]
struct Free {
    name: String,
    kind: Kind,
    prior: f64,
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
    avatar: &'a Avatar,
    folded: &'a Folded,
    base: Shape,
    free: Vec<Free>,
}

impl<'a> Shapes<'a> {
    /// Shapes that differ from `base` in the phenotypes and sliders `free`: name and spread.
    pub fn new(
        avatar: &'a Avatar,
        folded: &'a Folded,
        base: &Shape,
        free: &[(&str, f64)],
    ) -> Result<Shapes<'a>, FitError> {
        let mut list = Vec::new();
        for &(name, spread) in free {
            let phenotype = PHENOTYPES.iter().position(|p| *p == name);
            let (kind, prior) = match phenotype {
                Some(i) => (Kind::Phenotype(i), base.phenotypes[i]),
                None => (Kind::Slider(folded.slider(avatar, name)?), local(base, name)),
            };
            list.push(Free { name: name.to_string(), kind, prior, spread });
        }
        Ok(Shapes { avatar, folded, base: base.clone(), free: list })
    }

    /// How many parameters are free.
    pub fn n_free(&self) -> usize {
        self.free.len()
    }

    /// Their values at the base shape.
    pub fn start(&self) -> Vec<f64> {
        self.free.iter().map(|f| f.prior).collect()
    }

    /// Expected value and spread of parameter `i`.
    pub fn prior(&self, i: usize) -> (f64, f64) {
        (self.free[i].prior, self.free[i].spread)
    }

    /// Brings values into the ranges that shapes may have.
    pub fn clamp(&self, values: &mut [f64]) {
        for (free, value) in self.free.iter().zip(values) {
            *value = match free.kind {
                Kind::Phenotype(i) if PHENOTYPES[i] == "age" => value.clamp(2.0 / 3.0, 1.0),
                Kind::Phenotype(_) => value.clamp(0.0, 1.0),
                Kind::Slider(_) => value.clamp(-1.0, 1.0),
            };
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
    pub fn features(&self, values: &[f64]) -> Result<Vec<DVec3>, FitError> {
        let mut shape = self.base.clone();
        for (free, &value) in self.free.iter().zip(values) {
            match free.kind {
                Kind::Phenotype(i) => shape.phenotypes[i] = value,
                Kind::Slider(_) => shape.locals.retain(|l| l.0 != free.name),
            }
        }
        let mut features = self.folded.features(self.avatar, &shape)?;
        for (free, &value) in self.free.iter().zip(values) {
            if let Kind::Slider(sides) = &free.kind {
                let side = &sides[usize::from(value < 0.0)];
                features.iter_mut().zip(side).for_each(|(f, d)| *f += value.abs() * *d);
            }
        }
        Ok(features)
    }

    /// `∂features/∂value` for every free parameter.
    pub fn slopes(&self, values: &[f64]) -> Vec<Vec<DVec3>> {
        let phenotype = |f: &Free| if let Kind::Phenotype(i) = f.kind { Some(i) } else { None };
        let which: Vec<usize> = self.free.iter().filter_map(phenotype).collect();
        let shape = self.shape(values);
        let mut by_phenotype = match which.is_empty() {
            true => Vec::new(),
            false => self.folded.slopes(&shape, &which),
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

fn local(shape: &Shape, name: &str) -> f64 {
    shape.locals.iter().find(|l| l.0 == name).map_or(0.0, |l| l.1)
}
