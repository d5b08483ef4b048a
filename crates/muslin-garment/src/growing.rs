//! A body that starts out thinner, with small hands and feet, and grows into the cloth.
//!
//! A foot does not fit through the side of a trouser leg, but a leg without a foot fits into it;
//! when the foot grows, it pushes the hem up its instep as pulling does.

use crate::stand::{Limbs, SIDES, Stand, limb_share};
use glam::DVec3;
use muslin_body::{Avatar, BodyError, Posed};
use muslin_geom::Surface;

/// Bones of hands and of feet.
pub(crate) const HAND: [&str; 2] = ["metacarpal", "finger"];
pub(crate) const FOOT: [&str; 2] = ["foot", "toe"];
/// Size of a hand or foot that has not grown, against its own.
const SMALL: f64 = 0.1;

/// A body between small ends and its own.
pub(crate) struct Growing {
    /// Full-grown [m].
    verts: Vec<DVec3>,
    /// For each hand and foot: what it turns about [m], and the share of it in every vertex.
    ends: Vec<(DVec3, Vec<f64>)>,
    pub skin: Surface,
}

impl Growing {
    /// The body with its ends small.
    pub fn new(avatar: &Avatar, stand: &Stand) -> Growing {
        let end = |s: usize| {
            let Limbs { wrist, ankle, .. } = stand.limbs[s];
            [(wrist, &HAND), (ankle, &FOOT)]
                .map(|(pivot, names)| (pivot, limb_share(avatar, names, SIDES[s])))
        };
        let mut body = Growing {
            verts: stand.verts.to_vec(),
            ends: [0, 1].into_iter().flat_map(end).collect(),
            skin: stand.skin.clone(),
        };
        body.grow(0.0);
        body
    }

    /// The same, posed.
    pub fn posed(mut self, avatar: &Avatar, posed: &Posed) -> Result<Growing, BodyError> {
        self.verts.clone_from(&posed.verts);
        let names = SIDES.map(|s| [format!("wrist.{s}"), format!("foot.{s}")]);
        for ((pivot, _), name) in self.ends.iter_mut().zip(names.as_flattened()) {
            *pivot = posed.bones[avatar.bone(name)?].transform_point3(*pivot);
        }
        self.grow(0.0);
        Ok(self)
    }

    /// Grows hands and feet: 0 is small, 1 their own size.
    pub fn grow(&mut self, grown: f64) {
        let mut verts = self.verts.clone();
        let size = SMALL + (1.0 - SMALL) * grown;
        for (pivot, share) in &self.ends {
            for (v, share) in verts.iter_mut().zip(share) {
                *v = v.lerp(*pivot + (*v - *pivot) * size, *share);
            }
        }
        self.skin.refit(&verts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stand::BodyMap;
    use glam::DQuat;
    use muslin_body::{Pose, Shape};

    #[test]
    fn hands_of_turned_arms_grow_out_of_their_own_wrists() {
        let avatar = Avatar::embedded().expect("the embedded avatar is sound");
        let figure = avatar.figure(&Shape::default()).expect("a figure");
        let map = BodyMap::new(&avatar, &figure).expect("it has tights");
        let stand = Stand::new(&map, &figure);
        let mut pose = Pose::rest(&avatar);
        let arm = avatar.bone("upperarm01.L").expect("an arm");
        pose.rotations[arm] = DQuat::from_rotation_z(-0.8);
        let posed = avatar.pose(&figure, &pose);
        let mut body = Growing::new(&avatar, &stand)
            .posed(&avatar, &posed)
            .expect("it has wrists");
        let wrist = avatar.bone("wrist.L").expect("a wrist");
        let wrist = posed.bones[wrist].transform_point3(stand.limbs[0].wrist);
        let fingers = limb_share(&avatar, &["finger"], "L");
        let fingers: Vec<usize> = (0..fingers.len()).filter(|i| fingers[*i] > 0.99).collect();
        let far = |body: &Growing| {
            let all = fingers
                .iter()
                .map(|i| body.skin.verts()[*i].distance(wrist));
            all.fold(0.0, f64::max)
        };
        let small = far(&body);
        body.grow(1.0);
        assert!(small < 0.025 && far(&body) > 0.15, "{small} {}", far(&body));
        let off = body.skin.verts().iter().zip(&posed.verts);
        assert!(off.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) < 1e-12);
    }
}
