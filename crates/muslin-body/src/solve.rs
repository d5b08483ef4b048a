//! A shape that has exactly this height or this mass.

use crate::measure::span;
use crate::shape::{HEIGHT, WEIGHT};
use crate::{Avatar, BodyError, DENSITY, Shape};

impl Avatar {
    /// How tall `shape` is [m]; much faster than making the figure.
    pub fn height_of(&self, shape: &Shape) -> Result<f64, BodyError> {
        Ok(span(self.points_at(shape, &self.stature)?.into_iter()))
    }

    /// How much `shape` weighs [kg].
    pub fn mass_of(&self, shape: &Shape) -> Result<f64, BodyError> {
        Ok(self.volume(&self.figure(shape)?) * DENSITY)
    }
}

impl Shape {
    /// This shape with the height phenotype that makes it `metres` tall, to a hundredth of a millimetre.
    pub fn with_height(&self, avatar: &Avatar, metres: f64) -> Result<Shape, BodyError> {
        let at = |h: f64| avatar.height_of(&self.set(HEIGHT, h));
        let found = solve(metres, 1e-6, self.phenotypes[HEIGHT], at)?;
        let h = found.map_err(|(least, most)| BodyError::HeightOutOfReach {
            asked: metres,
            least,
            most,
        })?;
        Ok(self.set(HEIGHT, h))
    }

    /// This shape with the weight phenotype that makes it weigh `kg`, to ten grams; its height stays.
    pub fn with_mass(&self, avatar: &Avatar, kg: f64) -> Result<Shape, BodyError> {
        let height = avatar.height_of(self)?;
        self.with_height_and_mass(avatar, height, kg)
    }

    /// This shape with exactly this height [m] and this mass [kg].
    pub fn with_height_and_mass(
        &self,
        avatar: &Avatar,
        metres: f64,
        kg: f64,
    ) -> Result<Shape, BodyError> {
        // The same height phenotype makes another height at another weight, so every try solves it anew.
        let at = |w: f64| avatar.mass_of(&self.set(WEIGHT, w).with_height(avatar, metres)?);
        let found = solve(kg, 0.005, self.phenotypes[WEIGHT], at)?;
        let w = found.map_err(|(least, most)| BodyError::MassOutOfReach {
            asked: kg,
            least,
            most,
        })?;
        self.set(WEIGHT, w).with_height(avatar, metres)
    }

    fn set(&self, index: usize, value: f64) -> Shape {
        let mut shape = self.clone();
        shape.phenotypes[index] = value;
        shape
    }
}

type Reach = (f64, f64);

/// The `t` in 0..=1 where the rising `f` is `want` within `tolerance`, near `guess` if it may be;
/// else the values at both ends. False position with a bisection whenever it stalls.
fn solve(
    want: f64,
    tolerance: f64,
    guess: f64,
    f: impl Fn(f64) -> Result<f64, BodyError>,
) -> Result<Result<f64, Reach>, BodyError> {
    let (mut low, mut high) = ((0.0, f(0.0)?), (1.0, f(1.0)?));
    let reach = (low.1, high.1);
    if !(low.1 - tolerance..=high.1 + tolerance).contains(&want) {
        return Ok(Err(reach));
    }
    let mut t = guess.clamp(0.01, 0.99);
    for k in 0..60 {
        let at = f(t)?;
        if (at - want).abs() <= tolerance {
            break;
        }
        *(if at < want { &mut low } else { &mut high }) = (t, at);
        let slope = (high.1 - low.1).max(1e-12);
        let secant = low.0 + (want - low.1) / slope * (high.0 - low.0);
        t = if k % 3 == 2 {
            (low.0 + high.0) / 2.0
        } else {
            secant.clamp(low.0, high.0)
        };
    }
    Ok(Ok(t))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kinked_rise_is_solved() {
        let f = |t: f64| Ok(if t < 0.5 { t } else { 0.5 + 10.0 * (t - 0.5) });
        for want in [0.0, 0.2, 0.5, 3.0, 5.5] {
            let t = solve(want, 1e-9, 0.3, f)
                .expect("no error")
                .expect("in reach");
            assert!((f(t).expect("fine") - want).abs() < 1e-8, "{want} at {t}");
        }
        assert_eq!(solve(6.0, 1e-9, 0.3, f).expect("no error"), Err((0.0, 5.5)));
    }
}
