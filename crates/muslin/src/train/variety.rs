//! Those for whom a garment is taught besides the wearer and the fabric that were asked for.

use muslin_body::Shape;
use muslin_garment::Fabric;
use muslin_net::learn::Noise;

use crate::size::{CutFor, Wearer};

/// Fabrics in all, where these may vary; and wearers, each in a fabric, where these may.
pub(super) const FABRICS: usize = 32;
pub(super) const WEARERS: usize = 96;

/// One in so many lessons has a fabric of the list itself.
const BETWEEN: usize = 3;

/// How far a phenotype goes towards its ends.
const WIDE: (f64, f64) = (0.05, 0.95);
/// Least age, the body's youngest adult, and most.
const AGES: (f64, f64) = (muslin_body::ADULT, 0.95);

/// How much heavier than the wearer those are whom sizes are cut for: a size too small to several too
/// large.
const STOUTER: (f64, f64) = (0.88, 2.0);
/// How far the girths of those go either way beside that, as a share of a slider's way: labels and bodies differ in
/// chest, waist and hip, each by itself.
const OTHERWISE: f64 = 0.6;

/// Any adult shape.
pub(super) fn any_shape(noise: &mut Noise) -> Shape {
    let mut shape = Shape::default();
    for (k, name) in muslin_body::PHENOTYPES.iter().enumerate() {
        let (least, most) = if *name == "age" { AGES } else { WIDE };
        shape.phenotypes[k] = least + (most - least) * noise.unit();
    }
    shape
}

/// Somebody as tall as the wearer and built alike, for whom a size may be cut that the wearer has on.
pub(super) fn any_cut(who: Wearer<'_>, noise: &mut Noise) -> CutFor {
    // Half of them within a fifth of the wearer.
    let share = STOUTER.0 + (STOUTER.1 - STOUTER.0) * noise.unit().powi(2);
    let pushed = [0; 3].map(|_| OTHERWISE * (2.0 * noise.unit() - 1.0));
    let other = who.reach().and_then(|[least, most]| {
        let kg = (share * who.mass()?).clamp(least, most);
        who.built(kg, pushed)
    });
    // The least of bodies are out of reach if they are to be stouter and as tall: made to measure.
    CutFor::new(who, None, other.unwrap_or_else(|_| who.figure.clone()))
}

/// The fabrics that others lie between: those of real cloth, and the paper one that models are compared
/// in.
pub(crate) fn fabrics() -> Vec<Fabric> {
    let known = |f: &Fabric| !f.is_paper() || f.name == "paper-snug-cotton";
    Fabric::presets().into_iter().filter(known).collect()
}

/// The fabric of lesson `k`, from 1 on: each of the list once, two somewhere between them after each.
pub(super) fn lesson_fabric(fabrics: &[Fabric], k: usize, noise: &mut Noise) -> Fabric {
    let drawn = any_fabric(fabrics, noise);
    match (k % BETWEEN, fabrics.get(k / BETWEEN)) {
        (1, Some(fabric)) => fabric.clone(),
        _ => drawn,
    }
}

/// A fabric somewhere between two of them, and now and then one of them.
pub(crate) fn any_fabric(fabrics: &[Fabric], noise: &mut Noise) -> Fabric {
    let [a, b] = [0; 2].map(|_| &fabrics[noise.below(fabrics.len())]);
    let t = noise.unit();
    let between = |of: fn(&Fabric) -> f64| ((1.0 - t) * of(a).ln() + t * of(b).ln()).exp();
    Fabric {
        density: between(|f| f.density),
        thickness: between(|f| f.thickness),
        stretch_warp: between(|f| f.stretch_warp),
        stretch_weft: between(|f| f.stretch_weft),
        shear: between(|f| f.shear),
        bend_warp: between(|f| f.bend_warp),
        bend_weft: between(|f| f.bend_weft),
        ..a.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traits::of_fabric;

    #[test]
    fn every_fabric_of_the_list_is_taught_whatever_the_seed() {
        let fabrics = fabrics();
        for seed in [1, 2] {
            let noise = &mut Noise::new(seed);
            let taught: Vec<Fabric> = (1..FABRICS)
                .map(|k| lesson_fabric(&fabrics, k, noise))
                .collect();
            for fabric in &fabrics {
                assert!(taught.contains(fabric), "{}", fabric.name);
            }
            let between = taught.iter().filter(|f| !fabrics.contains(f)).count();
            assert!(between > FABRICS / 2, "{between}");
        }
    }

    #[test]
    fn what_is_drawn_lies_between_the_fabrics_and_is_the_same_for_the_same_seed() {
        let fabrics = fabrics();
        assert!(fabrics.len() >= 8, "{}", fabrics.len());
        let draw = |seed| {
            let noise = &mut Noise::new(seed);
            (0..50)
                .map(|_| of_fabric(&any_fabric(&fabrics, noise)))
                .collect::<Vec<_>>()
        };
        assert!(draw(1) == draw(1) && draw(1) != draw(2));
        for k in 0..4 {
            let known = fabrics.iter().map(|f| of_fabric(f)[k].1);
            let (least, most) = known.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
            let drawn = draw(3);
            let inside = |x: f64| x >= least - 1e-9 && x <= most + 1e-9;
            assert!(drawn.iter().all(|d| inside(d[k].1)));
            let spread = drawn.iter().map(|d| d[k].1).fold(f64::MIN, f64::max)
                - drawn.iter().map(|d| d[k].1).fold(f64::MAX, f64::min);
            assert!(spread > 0.6 * (most - least), "{k}: {spread}");
        }
    }
}
