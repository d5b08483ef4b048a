//! Cores: for every place of the skin a point inside, where flesh gives way to.
//!
//! Normals lead astray where a posed body folds: there they point at each other, cross, or turn
//! over from one vertex to the next. The nearest points of the bones that move a place, mixed by
//! their weights at rest and taken along by the same bones, lie inside in any pose and change
//! smoothly over the skin.

use glam::{DAffine3, DVec3};

use crate::pose::skin;
use crate::{Avatar, Figure, Part};

/// Cores of a figure at rest.
#[derive(Clone, Debug)]
pub struct Cores<'a> {
    avatar: &'a Avatar,
    /// One for every vertex of the skin [m].
    rest: Vec<DVec3>,
}

impl<'a> Cores<'a> {
    /// The cores of a figure's skin.
    pub fn new(avatar: &'a Avatar, figure: &Figure) -> Cores<'a> {
        let core = |(p, row): (&DVec3, &[(u32, f64)])| {
            row.iter()
                .map(|&(b, w)| on_bone(figure, b as usize, *p) * w)
                .sum()
        };
        let skin = &figure.verts[avatar.part(Part::Body)];
        let rest = skin.iter().zip(avatar.rig().weights.rows());
        Cores {
            avatar,
            rest: rest.map(core).collect(),
        }
    }

    /// Where they are [m] once the bones moved by `bones` ([`crate::Posed::bones`]).
    pub fn posed(&self, bones: &[DAffine3]) -> Vec<DVec3> {
        skin(&self.rest, self.avatar.rig(), bones)
    }
}

/// The nearest point of a bone at rest [m].
fn on_bone(figure: &Figure, b: usize, p: DVec3) -> DVec3 {
    let (head, tail) = (figure.joints[b], figure.tails[b]);
    let along = tail - head;
    let t = (p - head).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
    head + along * t.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use muslin_geom::Surface;

    use super::*;
    use crate::{Pose, Shape};

    #[test]
    fn cores_lie_inside_at_rest_and_on_a_bent_knee() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let cores = Cores::new(&avatar, &figure);
        let mut pose = Pose::rest(&avatar);
        let outside = |pose: &Pose| {
            let posed = avatar.pose(&figure, pose);
            let skin = &posed.verts[avatar.part(Part::Body)];
            let surface = Surface::new(skin, avatar.collision_faces());
            let cores = cores.posed(&posed.bones);
            let out = |c: &&DVec3| surface.closest(**c, 0.3).is_some_and(|h| h.signed > 1e-3);
            cores.iter().filter(out).count() as f64 / cores.len() as f64
        };
        let rest = outside(&pose);
        assert!(rest < 0.03, "{rest}");
        let knee = avatar.bone("lowerleg01.L").expect("a knee");
        pose.rotations[knee] = DQuat::from_rotation_x(2.2);
        let bent = outside(&pose);
        assert!(bent < 0.03, "{bent}");
    }
}
