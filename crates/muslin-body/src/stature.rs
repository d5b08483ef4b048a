//! The points a stadiometer may touch, gathered so that a height costs microseconds.

use std::sync::OnceLock;

use crate::groups;
use crate::{Avatar, AvatarParts, BodyError, Shape, Target};

/// The heights of soles and crown, and what changes them.
#[derive(Clone, Debug)]
pub(crate) struct Stature {
    /// The vertices, in order.
    pub points: Vec<u32>,
    /// Their heights in the mean adult [m].
    mean: Vec<f64>,
    /// How each mode lifts them [m], one mode after the other.
    modes: Vec<f32>,
    /// How each slider lifts some of them [m] at its upper and at its lower end, once asked for.
    targets: OnceLock<Vec<Lifts>>,
}

/// How some points are lifted [m] at either end of a slider.
type Lifts = [Vec<(u32, f32)>; 2];

impl Stature {
    /// Gathered from all points.
    pub fn new(parts: &AvatarParts) -> Self {
        let points = groups::stature(parts);
        let stride = 3 * parts.mean.len().max(1);
        let modes = parts.modes.chunks(stride);
        let at = |mode: &[f32], i: u32| mode[3 * i as usize + 1];
        Self {
            mean: points.iter().map(|&i| parts.mean[i as usize].y).collect(),
            modes: modes
                .flat_map(|m| points.iter().map(move |&i| at(m, i)))
                .collect(),
            targets: OnceLock::new(),
            points,
        }
    }

    /// What sliders do to the points, which are in order.
    fn lifts(&self, targets: &[Target]) -> Vec<Lifts> {
        let place = |i: u32| Some(self.points.binary_search(&i).ok()? as u32);
        let lifts = |side: &[(u32, [f32; 3])]| {
            let found = side.iter().filter_map(|&(i, d)| Some((place(i)?, d[1])));
            found.collect()
        };
        let both = |t: &Target| [lifts(&t.up), lifts(&t.down)];
        targets.iter().map(both).collect()
    }

    /// Adds `Σ w_m mode_m` to the heights.
    fn add_modes(&self, weights: &[f64], heights: &mut [f64]) {
        let rows = self.modes.chunks(heights.len().max(1));
        for (row, w) in rows.zip(weights) {
            for (y, d) in heights.iter_mut().zip(row) {
                *y += w * f64::from(*d);
            }
        }
    }
}

impl Avatar {
    /// How high every point of [`Stature::points`] is at `shape` [m].
    pub(crate) fn stature_at(&self, shape: &Shape) -> Result<Vec<f64>, BodyError> {
        let mut heights = self.stature.mean.clone();
        let weights = self.blend().weights(&shape.phenotypes);
        self.stature.add_modes(&weights, &mut heights);
        for (name, value) in &shape.locals {
            let (index, sense) = self.target_index(name)?;
            let value = value * sense;
            let gathered = || self.stature.lifts(self.targets());
            let [up, down] = &self.stature.targets.get_or_init(gathered)[index];
            for &(k, d) in if value < 0.0 { down } else { up } {
                heights[k as usize] += value.abs() * f64::from(d);
            }
        }
        Ok(heights)
    }
}

/// Highest over lowest [m].
pub(crate) fn span(heights: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
    high - low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gathered_heights_are_those_of_the_whole_body() {
        let avatar = Avatar::embedded().expect("the asset is sound");
        let shape = Shape::default()
            .with_local("measure-upperleg-height", -0.4)
            .with_local("measure-neck-height", 0.7)
            .with_local("measure-lowerleg-height-decr", 0.3);
        let gathered = avatar.stature_at(&shape).expect("an adult");
        let whole = avatar.points_at(&shape, &avatar.stature.points);
        for (a, b) in gathered.iter().zip(whole.expect("an adult")) {
            assert!((a - b.y).abs() < 1e-12, "{a} {b}");
        }
    }
}
