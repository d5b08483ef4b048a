//! Who a body is: phenotypes, and sliders for single parts.

use crate::BodyError;

/// The phenotypes by name, in the order of [`Shape::phenotypes`]. Each runs from 0 to 1.
///
/// `gender` 0 is male, 1 female; `age` runs from 2/3 (about 25 years) to 1 (about 90);
/// `african`, `asian` and `caucasian` count by their share of the sum of the three.
pub const PHENOTYPES: [&str; 11] = [
    "gender",
    "age",
    "muscle",
    "weight",
    "height",
    "proportions",
    "cupsize",
    "firmness",
    "african",
    "asian",
    "caucasian",
];

/// The youngest age the body is made for.
pub const ADULT: f64 = 2.0 / 3.0;

/// The shape of one body; the default is an adult of average build, between the genders.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// In the order of [`PHENOTYPES`], each in 0..=1.
    pub phenotypes: [f64; 11],
    /// Sliders by name (see [`crate::Avatar::target_names`]), each in -1..=1.
    pub locals: Vec<(String, f64)>,
}

impl Default for Shape {
    /// About 35 years old and 1.69 m tall (the middle of the ANSUR II means).
    fn default() -> Self {
        let third = 1.0 / 3.0;
        let phenotypes = [
            0.5, 0.72, 0.5, 0.5, 0.365, 0.5, 0.5, 0.5, third, third, third,
        ];
        Self {
            phenotypes,
            locals: Vec::new(),
        }
    }
}

impl Shape {
    /// The value of a phenotype.
    pub fn get(&self, name: &str) -> Result<f64, BodyError> {
        Ok(self.phenotypes[index(name)?])
    }

    /// This shape with one phenotype changed.
    pub fn with(mut self, name: &str, value: f64) -> Result<Self, BodyError> {
        self.phenotypes[index(name)?] = value;
        self.check()?;
        Ok(self)
    }

    /// This shape with a slider set; setting it again replaces it.
    ///
    /// Names are checked when the figure is made.
    pub fn with_local(mut self, name: &str, value: f64) -> Self {
        self.locals.retain(|(n, _)| n != name);
        self.locals.push((name.into(), value));
        self
    }

    /// Whether every value lies in its range: adults only, no other extrapolation.
    pub fn check(&self) -> Result<(), BodyError> {
        for (name, &value) in PHENOTYPES.iter().zip(&self.phenotypes) {
            within(name, value, 0.0, 1.0)?;
        }
        for (name, value) in &self.locals {
            within(name, *value, -1.0, 1.0)?;
        }
        // A hair below the anchor is rounding, not a child.
        match self.phenotypes[AGE] {
            age if age < ADULT - 1e-9 => Err(BodyError::Child(age)),
            _ => Ok(()),
        }
    }
}

pub(crate) const AGE: usize = 1;
pub(crate) const MUSCLE: usize = 2;
pub(crate) const WEIGHT: usize = 3;
pub(crate) const HEIGHT: usize = 4;

fn index(name: &str) -> Result<usize, BodyError> {
    let found = PHENOTYPES.iter().position(|&p| p == name);
    found.ok_or_else(|| BodyError::UnknownPhenotype { name: name.into() })
}

fn within(name: &str, value: f64, least: f64, most: f64) -> Result<(), BodyError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(BodyError::OutOfRange {
        name: name.into(),
        value,
        least,
        most,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_refused_with_a_clear_message() {
        let error = Shape::default().with("age", 0.3).expect_err("a child");
        assert!(error.to_string().contains("for adults"), "{error}");
    }

    #[test]
    fn values_must_be_numbers_in_range() {
        assert!(Shape::default().with("height", 1.2).is_err());
        assert!(Shape::default().with("height", f64::NAN).is_err());
        assert!(Shape::default().with("hieght", 0.5).is_err());
        assert!(
            Shape::default()
                .with_local("head-oval", -3.0)
                .check()
                .is_err()
        );
        assert!(Shape::default().with("age", 2.0 / 3.0).is_ok());
    }

    #[test]
    fn a_slider_set_twice_keeps_the_last_value() {
        let shape = Shape::default().with_local("a", 0.1).with_local("a", 0.2);
        assert_eq!(shape.locals, vec![("a".to_string(), 0.2)]);
    }
}
