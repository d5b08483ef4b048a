//! A shape that has exactly this height or this mass.

use crate::shape::{HEIGHT, MUSCLE, WEIGHT};
use crate::stature::span;
use crate::{Avatar, BodyError, DENSITY, GIRTHS, Shape};

/// Sliders that make a body stouter than the phenotypes can.
const STOUT: [&str; 6] = [
    GIRTHS[1],
    GIRTHS[2],
    "measure-thigh-circ",
    GIRTHS[0],
    "measure-upperarm-circ",
    "measure-calf-circ",
];

impl Avatar {
    /// How tall `shape` is [m]; much faster than making the figure.
    pub fn height_of(&self, shape: &Shape) -> Result<f64, BodyError> {
        shape.check()?;
        Ok(span(self.stature_at(shape)?.into_iter()))
    }

    /// How much `shape` weighs [kg].
    pub fn mass_of(&self, shape: &Shape) -> Result<f64, BodyError> {
        Ok(self.volume_of(shape)? * DENSITY)
    }
}

impl Shape {
    /// This shape with the height phenotype that makes it `metres` tall, to a micrometre.
    ///
    /// The phenotype has two anchors, so every point runs along a line between them and no
    /// more than two shapes need evaluating.
    pub fn with_height(&self, avatar: &Avatar, metres: f64) -> Result<Shape, BodyError> {
        self.check()?;
        let ends = [0.0, 1.0].map(|h| avatar.stature_at(&self.set(HEIGHT, h)));
        let [short, tall] = ends;
        let (short, tall) = (short?, tall?);
        let at = |h: f64| span(short.iter().zip(&tall).map(|(a, b)| a + h * (b - a)));
        let h = solve(metres, 1e-6, |h| Ok(at(h)))?;
        let reached = |(least, most)| BodyError::HeightOutOfReach {
            asked: metres,
            least,
            most,
        };
        Ok(self.set(HEIGHT, h.map_err(reached)?))
    }

    /// This shape made to weigh `kg`; its height stays. See [`Shape::with_height_and_mass`].
    pub fn with_mass(&self, avatar: &Avatar, kg: f64) -> Result<Shape, BodyError> {
        let height = avatar.height_of(self)?;
        self.with_height_and_mass(avatar, height, kg)
    }

    /// This shape with exactly this height [m], and this mass [kg] to five grams.
    ///
    /// The weight phenotype changes first. Where its range ends, muscle wastes away: with
    /// little muscle the weight phenotype reaches much thinner and much heavier bodies. Where
    /// that ends too, sliders make chest, waist, hips and limbs stouter.
    pub fn with_height_and_mass(
        &self,
        avatar: &Avatar,
        metres: f64,
        kg: f64,
    ) -> Result<Shape, BodyError> {
        let mass = |s: &Shape| avatar.mass_of(&s.with_height(avatar, metres)?);
        let path = self.path_of_mass();
        let on = |k: usize, t: f64| path[k].between(&path[k + 1], t);
        let span = |k: usize| solve(kg, 0.005, |t| mass(&on(k, t)));
        let met = |k: usize, t: f64| on(k, t).with_height(avatar, metres);
        // The weight phenotype's own span first; then whichever way the mass lies.
        let own = match span(1)? {
            Ok(t) => return met(1, t),
            Err(reach) => reach,
        };
        for k in if kg < own.0 { vec![0] } else { vec![2, 3] } {
            if let Ok(t) = span(k)? {
                return met(k, t);
            }
        }
        Err(BodyError::MassOutOfReach {
            asked: kg,
            least: mass(&path[0])?,
            most: mass(&path[path.len() - 1])?,
        })
    }

    /// Shapes from the thinnest to the stoutest: wasted, thin, heavy, fat, stout.
    fn path_of_mass(&self) -> [Shape; 5] {
        let wasted = self.set(WEIGHT, 0.0).set(MUSCLE, 0.0);
        let fat = self.set(WEIGHT, 1.0).set(MUSCLE, 0.0);
        let mut stout = fat.clone();
        for name in STOUT {
            stout = stout.with_local(name, 1.0);
        }
        [
            wasted,
            self.set(WEIGHT, 0.0),
            self.set(WEIGHT, 1.0),
            fat,
            stout,
        ]
    }

    /// `t` = 0 is this shape, 1 is `other`.
    pub fn between(&self, other: &Shape, t: f64) -> Shape {
        let mix = |a: f64, b: f64| a + t * (b - a);
        let mut out = self.clone();
        for (p, q) in out.phenotypes.iter_mut().zip(&other.phenotypes) {
            *p = mix(*p, *q);
        }
        for (name, value) in &mut out.locals {
            *value = mix(*value, other.local(name));
        }
        for (name, value) in &other.locals {
            if !self.locals.iter().any(|(n, _)| n == name) {
                out.locals.push((name.clone(), t * value));
            }
        }
        out
    }

    /// How far a slider is pushed; zero when it is not set.
    pub fn local(&self, name: &str) -> f64 {
        self.locals
            .iter()
            .find(|(n, _)| n == name)
            .map_or(0.0, |(_, v)| *v)
    }

    fn set(&self, index: usize, value: f64) -> Shape {
        let mut shape = self.clone();
        shape.phenotypes[index] = value;
        shape
    }
}

type Reach = (f64, f64);

/// The `t` in 0..=1 where the monotone `f` is `want` within `tolerance`; else
/// the values at both ends.
///
/// False position, where an end that stays twice counts half (the Illinois rule): it passes
/// kinks without stalling.
fn solve(
    want: f64,
    tolerance: f64,
    f: impl Fn(f64) -> Result<f64, BodyError>,
) -> Result<Result<f64, Reach>, BodyError> {
    let (mut a, mut b) = ((0.0, f(0.0)? - want), (1.0, f(1.0)? - want));
    if a.1.min(b.1) > tolerance || a.1.max(b.1) < -tolerance {
        let (least, most) = (a.1.min(b.1) + want, a.1.max(b.1) + want);
        return Ok(Err((least, most)));
    }
    let mut t = 0.0;
    for _ in 0..100 {
        let slope = b.1 - a.1;
        if slope == 0.0 {
            break;
        }
        t = ((a.0 * b.1 - b.0 * a.1) / slope).clamp(0.0, 1.0);
        let off = f(t)? - want;
        if off.abs() <= tolerance || a.0 == b.0 {
            break;
        }
        if (off < 0.0) == (b.1 < 0.0) {
            // The newest end is always `b`; an `a` that stays is halved.
            (b, a.1) = ((t, off), a.1 / 2.0);
        } else {
            (a, b) = (b, (t, off));
        }
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
            let t = solve(want, 1e-9, f).expect("no error").expect("in reach");
            assert!((f(t).expect("fine") - want).abs() < 1e-8, "{want} at {t}");
        }
        let (least, most) = solve(6.0, 1e-9, f)
            .expect("no error")
            .expect_err("out of reach");
        assert!(least.abs() < 1e-12 && (most - 5.5).abs() < 1e-12);
    }

    #[test]
    fn a_fall_is_solved_too() {
        let t = solve(0.7, 1e-9, |t| Ok(1.0 - t * t))
            .expect("no error")
            .expect("in reach");
        assert!((t - 0.3f64.sqrt()).abs() < 1e-8);
    }

    #[test]
    fn between_two_shapes_sliders_of_either_fade() {
        let a = Shape::default().with_local("x", 1.0);
        let b = Shape::default().with_local("y", -1.0);
        let half = a.between(&b, 0.5);
        assert_eq!(
            (half.local("x"), half.local("y"), half.local("z")),
            (0.5, -0.5, 0.0)
        );
    }
}
