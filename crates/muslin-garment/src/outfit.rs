//! An outfit: garments in the order in which they lie on the body.

use crate::stand::{BodyMap, Stand};
use crate::{Garment, GarmentError, Opening, Worn};
use glam::DVec3;
use muslin_body::{Avatar, Figure};
use rayon::prelude::*;

/// What somebody wears, from the skin outward.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outfit {
    /// Innermost first.
    pub garments: Vec<Garment>,
}

impl Outfit {
    /// Puts everything on, each garment outside of those before it.
    ///
    /// A shirt under trousers is tucked in. The result has one entry per garment, in order.
    pub fn worn(&self, avatar: &Avatar, figure: &Figure) -> Result<Vec<Worn>, GarmentError> {
        let base = avatar.standard()?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, figure);
        let waist = |g: &Garment| g.height_of(Opening::Waist, &stand);
        let all = self.garments.par_iter().enumerate();
        let alone = all.map(|(k, garment)| {
            let tuck = self.garments[k + 1..].iter().find_map(waist);
            (garment.alone(&stand, tuck), tuck)
        });
        let alone: Vec<(Vec<DVec3>, Option<f64>)> = alone.collect();
        let mut done: Vec<Worn> = Vec::with_capacity(self.garments.len());
        for (garment, alone) in self.garments.iter().zip(alone) {
            let under: Vec<(&Garment, &Worn)> = self.garments.iter().zip(&done).collect();
            let worn = garment.put_on(&stand, &under, alone);
            done.push(worn);
        }
        Ok(done)
    }
}
