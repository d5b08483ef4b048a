//! A body to dress: who, how they stand, and how they get there from the rest pose.

use glam::DVec3;
use muslin_body::{Avatar, Figure, Part, Pose, Posed, Shape};

use crate::failure::{Exit, Failure};

/// Somebody in a pose.
#[derive(Clone, Debug)]
pub struct Sitter {
    /// The rest pose.
    pub figure: Figure,
    /// How they stand.
    pub pose: Pose,
    /// The body in that pose.
    pub posed: Posed,
    /// By how much the upper arms were turned to make room for cloth at most [rad].
    pub arms_turned: f64,
}

/// Room that hands and forearms leave for cloth [m].
const ROOM: f64 = 0.012;

impl Sitter {
    /// Somebody of this shape in this pose.
    pub fn new(avatar: &Avatar, shape: &Shape, mut pose: Pose) -> Result<Self, Failure> {
        let figure = avatar.figure(shape).map_err(|e| body_failure(&e))?;
        pose.relax_hands(avatar, &figure)
            .map_err(|e| body_failure(&e))?;
        let arms_turned = pose
            .make_room(avatar, &figure, ROOM)
            .map_err(|e| body_failure(&e))?;
        let posed = avatar.pose(&figure, &pose);
        if posed.verts.iter().any(|v| !v.is_finite()) {
            return Err(Failure::new(
                Exit::Numbers,
                "body",
                "the posed body is not finite",
            ));
        }
        Ok(Self {
            figure,
            pose,
            posed,
            arms_turned,
        })
    }

    /// The same person with the skin [m] that cloth was draped on: where a pose folds the body into
    /// itself, flesh gives way.
    pub fn with_skin(&self, avatar: &Avatar, skin: &[DVec3]) -> Self {
        let mut other = self.clone();
        other.posed.verts[avatar.part(Part::Body)].copy_from_slice(skin);
        other
    }

    /// The skin's vertices [m] on the way from the rest pose to the pose, both included.
    ///
    /// The way eases in and out, and no joint turns by more than `most` radians a step.
    pub fn path(&self, avatar: &Avatar, most: f64) -> Vec<Vec<DVec3>> {
        let rest = Pose::rest(avatar);
        let turns = self
            .pose
            .rotations
            .iter()
            .map(|q| q.to_axis_angle().1.abs());
        let widest = turns
            .map(|a| a.min(std::f64::consts::TAU - a))
            .fold(0.0, f64::max);
        // Easing makes the middle of the way half as fast again as its mean.
        let steps = ((1.5 * widest / most).ceil() as usize).clamp(8, 60);
        let skin = avatar.part(Part::Body);
        let frame = |i: usize| {
            let t = i as f64 / steps as f64;
            let pose = rest.toward(&self.pose, t * t * (3.0 - 2.0 * t));
            avatar.pose(&self.figure, &pose).verts[skin.clone()].to_vec()
        };
        (0..=steps).map(frame).collect()
    }
}

/// A body that cannot be made is the user's input out of range.
pub fn body_failure(e: &muslin_body::BodyError) -> Failure {
    match e {
        muslin_body::BodyError::Corrupt(_) => {
            Failure::new(Exit::Invalid, "body-asset", e.to_string())
        }
        _ => Failure::new(Exit::Invalid, "body", e.to_string()),
    }
}
