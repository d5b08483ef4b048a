//! One model in several fabrics: how wide the hem flies in a spin, predicted, refined and simulated.

use std::path::Path;
use std::slice;

use glam::DVec3;
use muslin_garment::Opening;
use muslin_model::Model;

use super::garments::{REFINE, Wearer, set};
use super::swing::{FINER, FPS, simulated};
use crate::animate::{along, predict};
use crate::failure::Failure;
use crate::options::DressOptions;
use crate::swings;
use crate::table::Table;
use crate::watch::Watch;

/// From the most supple to the stiffest.
pub(super) const FABRICS: [&str; 4] = ["silk-charmeuse", "cotton-jersey", "wool-suiting", "denim"];
/// A built-in motion, and how much of it is danced [s].
const SPIN: (&str, f64) = ("spin", 3.0);

/// Heads of the table that [`rows`] fills.
pub(super) const HEADS: [&str; 5] = ["model", "fabric", "hem cm, network", "refined", "simulated"];

/// Whether a model was taught in any fabric.
pub(super) fn knows_any(model: &Model) -> bool {
    model.traits.iter().any(|t| t.name == "ln_bend")
}

/// Adds a row for each fabric, if the garment hangs freely down to a hem, and says how many.
pub(super) fn rows(
    (who, model): (Wearer, &Model),
    (worn, name): (&DressOptions, &str),
    table: &mut Table,
) -> Result<String, Failure> {
    for (k, fabric) in FABRICS.into_iter().enumerate() {
        let mut worn = worn.clone();
        worn.outfit[0].fabric = Some(fabric.into());
        let at = |fps: f64| set((who, model), (Path::new(SPIN.0), fps, &worn), Some(SPIN.1));
        let here = at(FPS)?;
        let garment = &here.outfit.pieces[0].garment;
        let hem = garment.rims.iter().find(|r| r.opening == Opening::Hem);
        let Some(hem) = hem.filter(|_| garment.hangs_freely()) else {
            return Ok("no hem that hangs freely".into());
        };
        let told = here.told(0, model.clone())?;
        let model = swings::swinging(told, (here.avatar, &here.figure), &here.cloth)?;
        let raw = predict((&here, slice::from_ref(&model)), (1.0, usize::MAX))?.frames;
        let led = along((&here, REFINE, 1.0), (0, &raw, None), &mut Watch::nobody())?;
        let led: Vec<Vec<DVec3>> = led.into_iter().map(|s| s.cloth).collect();
        let simulated = simulated(&at(FPS * FINER as f64)?)?;
        let wide = |x: &[Vec<DVec3>]| format!("{:.1}", 100.0 * width(x, &hem.verts));
        table.row([
            if k == 0 {
                name.to_owned()
            } else {
                String::new()
            },
            fabric.to_owned(),
            wide(&raw),
            wide(&led),
            wide(&simulated),
        ]);
    }
    Ok(format!("{} fabrics in a spin", FABRICS.len()))
}

/// Mean distance of a hem from its middle over the second half of the frames, seen from above [m].
fn width(frames: &[Vec<DVec3>], hem: &[u32]) -> f64 {
    let late = &frames[frames.len() / 2..];
    let one = |x: &Vec<DVec3>| {
        let at = || hem.iter().map(|v| x[*v as usize].with_y(0.0));
        let middle = at().sum::<DVec3>() / hem.len() as f64;
        at().map(|p| p.distance(middle)).sum::<f64>() / hem.len() as f64
    };
    late.iter().map(one).sum::<f64>() / late.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_width_of_a_ring_is_its_radius_wherever_it_is_and_however_high() {
        let ring = |r: f64, height: f64| -> Vec<DVec3> {
            let at = |k: i32| {
                let (s, c) = (f64::from(k) * std::f64::consts::TAU / 8.0).sin_cos();
                DVec3::new(3.0 + r * c, height * f64::from(k), r * s - 1.0)
            };
            (0..8).map(at).collect()
        };
        let hem: Vec<u32> = (0..8).collect();
        let frames = [ring(9.0, 0.0), ring(0.3, 0.1), ring(0.5, 0.0)];
        assert!((width(&frames, &hem) - 0.4).abs() < 1e-12);
    }
}
