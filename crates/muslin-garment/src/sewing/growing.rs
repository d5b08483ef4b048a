//! A body that starts out thinner, with small hands and feet, and grows into the cloth.
//!
//! A foot does not fit through the side of a trouser leg, but a leg without a foot fits into it;
//! when the foot grows, it pushes the hem up its instep as pulling does.

use crate::stand::{Limbs, SIDES, Stand, limb_share};
use glam::DVec3;
use muslin_body::Avatar;
use muslin_geom::Surface;

/// Bones of hands and of feet.
const HAND: [&str; 2] = ["metacarpal", "finger"];
const FOOT: [&str; 2] = ["foot", "toe"];
/// Size of a hand or foot that has not grown, against its own.
const SMALL: f64 = 0.1;

/// A body between small ends and its own.
pub struct Growing<'a> {
    stand: &'a Stand<'a>,
    /// For each hand and foot: what it turns about [m], and the share of it in every vertex.
    ends: Vec<(DVec3, Vec<f64>)>,
    pub skin: Surface,
}

impl<'a> Growing<'a> {
    /// The body with its ends small.
    pub fn new(avatar: &Avatar, stand: &'a Stand<'a>) -> Growing<'a> {
        let end = |s: usize| {
            let Limbs { wrist, ankle, .. } = stand.limbs[s];
            [(wrist, &HAND), (ankle, &FOOT)]
                .map(|(pivot, names)| (pivot, limb_share(avatar, names, SIDES[s])))
        };
        let mut body = Growing {
            stand,
            ends: [0, 1].into_iter().flat_map(end).collect(),
            skin: stand.skin.clone(),
        };
        body.grow(0.0);
        body
    }

    /// Grows hands and feet: 0 is small, 1 their own size.
    pub fn grow(&mut self, grown: f64) {
        let mut verts = self.stand.verts.to_vec();
        let size = SMALL + (1.0 - SMALL) * grown;
        for (pivot, share) in &self.ends {
            for (v, share) in verts.iter_mut().zip(share) {
                *v = v.lerp(*pivot + (*v - *pivot) * size, *share);
            }
        }
        self.skin.refit(&verts);
    }
}
