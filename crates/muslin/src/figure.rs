//! A body to dress: who, how they stand, and how they get there from the rest pose.

use glam::DVec3;
use muslin_body::{Avatar, BodyError, Figure, Part, Pose, Posed, Shape};
use muslin_geom::{Mesh, self_intersections};
use muslin_sim::{Relief, relieve};

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
    /// By how much limbs were turned to make room for cloth at most [rad].
    pub turned: f64,
}

/// Room that hands, forearms, shins and feet leave for cloth [m].
pub(crate) const ROOM: f64 = 0.012;

impl Sitter {
    /// Somebody of this shape in this pose.
    pub fn new(avatar: &Avatar, shape: &Shape, mut pose: Pose) -> Result<Self, Failure> {
        let figure = avatar.figure(shape).map_err(|e| body_failure(&e))?;
        pose.relax_hands(avatar, &figure)
            .map_err(|e| body_failure(&e))?;
        let turned = pose
            .make_room(avatar, &figure, ROOM)
            .map_err(|e| body_failure(&e))?;
        let unfolded = unfold(avatar, &figure, &mut pose).map_err(|e| body_failure(&e))?;
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
            turned: turned.max(unfolded),
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

/// Flesh yields this far at most; where a fold asks for more, the limb is bent less [m].
const FOLD: f64 = 0.04;
/// By how much less in a round [rad], and rounds at most.
const UNBEND: f64 = 0.06;
const ROUNDS: usize = 10;
/// Pairs of triangles that may pass through each other at a joint all the same: counted twice.
const CROSSINGS: usize = 8;
/// Skin this far from every such joint is not folded by it [m].
const LEG: f64 = 0.25;
/// Joints that fold the body so deep; at armpits flesh has always yielded enough.
const FOLDS: [&str; 4] = [
    "upperleg01.L",
    "upperleg01.R",
    "lowerleg01.L",
    "lowerleg01.R",
];

/// Bends hips and knees less where the body folds deeper into itself than flesh
/// yields; says by how much at most [rad].
fn unfold(avatar: &Avatar, figure: &Figure, pose: &mut Pose) -> Result<f64, BodyError> {
    let rest = Pose::rest(avatar);
    let bones = FOLDS.map(|name| avatar.bone(name));
    let bones: Vec<usize> = bones.into_iter().collect::<Result<_, _>>()?;
    let skin = avatar.part(Part::Body);
    let wanted = vec![true; skin.len()];
    let mut unbent = vec![0.0; bones.len()];
    for _ in 0..ROUNDS {
        let posed = avatar.pose(figure, pose);
        let joints = bones
            .iter()
            .map(|&b| posed.bones[b].transform_point3(figure.joints[b]));
        let joints: Vec<DVec3> = joints.collect();
        let (before, after) = (&figure.verts[skin.clone()], &posed.verts[skin.clone()]);
        let relief = relieve((before, after), avatar.collision_faces(), ROOM, &wanted);
        let Some(k) = folded(avatar, (after, &relief), &joints) else {
            break;
        };
        let (from, to) = (pose.rotations[bones[k]], rest.rotations[bones[k]]);
        let bend = from.angle_between(to);
        let less = UNBEND.min(bend);
        pose.rotations[bones[k]] = from.slerp(to, less / bend.max(1e-9));
        unbent[k] += less;
    }
    Ok(unbent.into_iter().fold(0.0, f64::max))
}

/// Which of the `joints` [m] folds the body deeper than flesh yields, if one does: where it drew
/// back too far, or passes through itself all the same.
fn folded(avatar: &Avatar, (skin, relief): (&[DVec3], &Relief), joints: &[DVec3]) -> Option<usize> {
    let nearest = |p: DVec3| {
        let away = |k: &usize| joints[*k].distance_squared(p);
        let k = (0..joints.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        (away(&k) < LEG * LEG).then_some(k)
    };
    let drawn = |i: &usize| relief.verts[*i].distance(skin[*i]);
    let worst = (0..skin.len()).max_by(|a, b| drawn(a).total_cmp(&drawn(b)))?;
    if relief.deepest > FOLD && nearest(skin[worst]).is_some() {
        return nearest(skin[worst]);
    }
    if relief.left == 0 {
        return None;
    }
    let mesh = Mesh {
        verts: relief.verts.clone(),
        faces: avatar.collision_faces().to_vec(),
    };
    let mut votes = vec![0; joints.len()];
    for f in self_intersections(&mesh).iter().flatten() {
        let corner = mesh.faces[*f as usize][0];
        if let Some(k) = nearest(relief.verts[corner as usize]) {
            votes[k] += 1;
        }
    }
    let most = (0..votes.len()).max_by_key(|&k| votes[k])?;
    (votes[most] > CROSSINGS).then_some(most)
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

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn thighs_pressed_through_the_belly_come_down_until_flesh_can_yield_and_others_stay() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let shape = Shape::default().with("weight", 0.9).expect("a phenotype");
        let figure = avatar.figure(&shape).expect("a heavy person");
        let mut pose = Pose::stance(&avatar, &figure, "walk").expect("a stance");
        assert_eq!(unfold(&avatar, &figure, &mut pose), Ok(0.0));
        let thigh = avatar.bone("upperleg01.L").expect("a leg");
        pose = Pose::rest(&avatar);
        pose.rotations[thigh] = DQuat::from_rotation_x(-2.2);
        let less = unfold(&avatar, &figure, &mut pose).expect("the default rig");
        assert!((0.05..0.61).contains(&less), "{less}");
        let bend = pose.rotations[thigh].to_axis_angle().1;
        assert!((bend - (2.2 - less)).abs() < 1e-9, "{bend}");
    }
}
