//! A body to dress: who, how they stand, and how they get there from the rest pose.

use std::sync::OnceLock;

use glam::DVec3;
use muslin_body::{Avatar, BodyError, Cores, Figure, Limbs, Part, Pose, Posed, Shape};
use muslin_sim::{Flesh, Frame};

use crate::failure::{Exit, Failure};

/// Somebody in a pose.
#[derive(Clone, Debug)]
pub struct Sitter {
    /// Who.
    pub shape: Shape,
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
        let limbs = Limbs::new(avatar, [ROOM; 2]).map_err(|e| body_failure(&e))?;
        let turned = limbs.make_room(&mut pose, avatar, &figure);
        let unfolded = unfold(&Yielding::new(avatar, &figure), &mut pose, &STILL)
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
            shape: shape.clone(),
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

    /// The body in the pose, as the solver meets it.
    pub(crate) fn frame(&self, avatar: &Avatar) -> Frame {
        body_frame(avatar, &self.posed, &Cores::new(avatar, &self.figure))
    }

    /// The pose at a share of the way from the rest pose to where they stand.
    pub(crate) fn on_the_way(&self, avatar: &Avatar, share: f64) -> Pose {
        Pose::rest(avatar).toward(&self.pose, share)
    }

    /// Shares of the way from the rest pose to the pose, from one of them on, both ends included.
    ///
    /// The way eases in and out, and no joint turns by more than `most` radians from one to the next.
    pub(crate) fn shares(&self, (from, most): (f64, f64)) -> Vec<f64> {
        if from >= 1.0 {
            return vec![1.0];
        }
        let turns = self
            .pose
            .rotations
            .iter()
            .map(|q| q.to_axis_angle().1.abs());
        let widest = turns
            .map(|a| a.min(std::f64::consts::TAU - a))
            .fold(0.0, f64::max);
        // Easing makes the middle of the way half as fast again as its mean.
        let left = (1.0 - from) * widest;
        let fewest = if from > 0.0 { 2 } else { 8 };
        let steps = ((1.5 * left / most).ceil() as usize).clamp(fewest, 60);
        let share = |i: usize| {
            let t = i as f64 / steps as f64;
            from + (1.0 - from) * t * t * (3.0 - 2.0 * t)
        };
        (0..=steps).map(share).collect()
    }

    /// The body at shares of that way.
    pub(crate) fn path(&self, avatar: &Avatar, shares: &[f64]) -> Vec<Frame> {
        if shares == [1.0] {
            return vec![self.frame(avatar)];
        }
        let cores = Cores::new(avatar, &self.figure);
        let frame = |share: &f64| {
            let pose = self.on_the_way(avatar, *share);
            body_frame(avatar, &avatar.pose(&self.figure, &pose), &cores)
        };
        shares.iter().map(frame).collect()
    }
}

/// A posed figure as the solver meets it.
pub(crate) fn body_frame(avatar: &Avatar, posed: &Posed, cores: &Cores<'_>) -> Frame {
    Frame {
        skin: posed.verts[avatar.part(Part::Body)].to_vec(),
        cores: cores.posed(&posed.bones),
    }
}

/// What is asked of the folds at hips and knees.
pub(crate) struct Folding {
    /// Flesh yields this far at most; where a fold asks for more, the limb is bent less [m].
    pub deepest: f64,
    /// Triangles that may pass through others at a joint all the same.
    pub crossings: usize,
    /// A joint that is bent less than this folds nothing [rad].
    pub bent: f64,
    /// Rounds at most in which a limb is bent less, and by how much in each [rad].
    pub rounds: usize,
    pub less: f64,
}

/// Of somebody who stands still.
const STILL: Folding = Folding {
    deepest: 0.04,
    crossings: 8,
    bent: 0.9,
    rounds: 10,
    less: 0.06,
};
/// Share of the triangles that pass through others that must be gone in the end; else bending less was of no use.
const USE: f64 = 0.3;
/// Skin this far from every joint is not folded by it [m].
const LEG: f64 = 0.25;
/// Joints that fold the body so deep; at armpits flesh has always yielded enough.
pub(crate) const FOLDS: [&str; 4] = [
    "upperleg01.L",
    "upperleg01.R",
    "lowerleg01.L",
    "lowerleg01.R",
];
/// Joints whose crossings are others' concern: fingers that touch, a hand on a thigh.
const OTHERS: [&str; 6] = [
    "wrist.L",
    "wrist.R",
    "lowerarm01.L",
    "lowerarm01.R",
    "upperarm01.L",
    "upperarm01.R",
];

/// Somebody whose flesh yields, once a pose folds it.
pub(crate) struct Yielding<'a> {
    pub avatar: &'a Avatar,
    pub figure: &'a Figure,
    flesh: OnceLock<Flesh>,
}

impl<'a> Yielding<'a> {
    pub fn new(avatar: &'a Avatar, figure: &'a Figure) -> Self {
        Yielding {
            avatar,
            figure,
            flesh: OnceLock::new(),
        }
    }

    fn flesh(&self) -> &Flesh {
        self.flesh.get_or_init(|| {
            let rest = &self.figure.verts[self.avatar.part(Part::Body)];
            Flesh::new(rest, self.avatar.collision_faces())
        })
    }
}

/// Bends hips and knees less where the body folds deeper into itself than flesh yields; says by how
/// much at most [rad].
pub(crate) fn unfold(
    body: &Yielding<'_>,
    pose: &mut Pose,
    folding: &Folding,
) -> Result<f64, BodyError> {
    let avatar = body.avatar;
    let rest = Pose::rest(avatar);
    let bones = FOLDS.iter().chain(&OTHERS).map(|name| avatar.bone(name));
    let bones: Vec<usize> = bones.collect::<Result<_, _>>()?;
    let before = pose.clone();
    let mut unbent = [0.0; FOLDS.len()];
    let mut crossings = Vec::new();
    for _ in 0..folding.rounds {
        let bend = |k: usize| pose.rotations[bones[k]].angle_between(rest.rotations[bones[k]]);
        let bent: [bool; FOLDS.len()] = std::array::from_fn(|k| bend(k) > folding.bent);
        if !bent.contains(&true) {
            break;
        }
        let fold = Fold::seen(body, pose, &bones);
        crossings.push(fold.crossings.iter().sum::<usize>());
        let Some(k) = fold.worst(&bent, folding) else {
            break;
        };
        let (from, to) = (pose.rotations[bones[k]], rest.rotations[bones[k]]);
        pose.rotations[bones[k]] = from.slerp(to, folding.less / bend(k));
        unbent[k] += folding.less;
    }
    let [first, .., last] = crossings[..] else {
        return Ok(0.0);
    };
    if last as f64 > (1.0 - USE) * first as f64 {
        *pose = before;
        return Ok(0.0);
    }
    Ok(unbent.into_iter().fold(0.0, f64::max))
}

/// How a pose folds the body at hips and knees, flesh having yielded.
struct Fold {
    /// How far skin drew back at most [m], and the joint next to it.
    deepest: f64,
    next_to: Option<usize>,
    /// Triangles that pass through others all the same, by the joint they are next to.
    crossings: [usize; FOLDS.len()],
}

impl Fold {
    /// `bones`: [`FOLDS`], then [`OTHERS`].
    fn seen(body: &Yielding<'_>, pose: &Pose, bones: &[usize]) -> Fold {
        let (figure, flesh) = (body.figure, body.flesh());
        let skin = body.avatar.part(Part::Body);
        let posed = body.avatar.pose(figure, pose);
        // Straight in: where that leads astray, the fold is too deep.
        let bent = Frame::from(posed.verts[skin].to_vec());
        let now = &bent.skin;
        let relief = flesh.relieve(&bent, ROOM, &vec![true; now.len()]);
        let joint = |b: &usize| posed.bones[*b].transform_point3(figure.joints[*b]);
        let joints: Vec<DVec3> = bones.iter().map(joint).collect();
        let nearest = |p: DVec3| {
            let away = |k: &usize| joints[*k].distance_squared(p);
            let k = (0..joints.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
            (k < FOLDS.len() && away(&k) < LEG * LEG).then_some(k)
        };
        let drawn = |i: &usize| relief.verts[*i].distance(now[*i]);
        let most = (0..now.len()).max_by(|a, b| drawn(a).total_cmp(&drawn(b)));
        let (led, faces) = (&relief.verts, flesh.rest().faces());
        let mut crossings = [0; FOLDS.len()];
        let crossing = flesh.rest().moved(led).self_intersections();
        for f in crossing.as_flattened() {
            if let Some(k) = nearest(led[faces[*f as usize][0] as usize]) {
                crossings[k] += 1;
            }
        }
        Fold {
            deepest: most.map_or(0.0, |i| drawn(&i)),
            next_to: most.and_then(|i| nearest(now[i])),
            crossings,
        }
    }

    /// Which of the joints that are bent to bend less, if one.
    fn worst(&self, bent: &[bool], folding: &Folding) -> Option<usize> {
        let is_deep = self.deepest > folding.deepest;
        let deep = self.next_to.filter(|k| is_deep && bent[*k]);
        let most = (0..FOLDS.len())
            .filter(|k| bent[*k])
            .max_by_key(|k| self.crossings[*k]);
        deep.or(most.filter(|k| self.crossings[*k] > folding.crossings))
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
        let body = Yielding::new(&avatar, &figure);
        assert_eq!(unfold(&body, &mut pose, &STILL), Ok(0.0));
        let thigh = avatar.bone("upperleg01.L").expect("a leg");
        pose = Pose::rest(&avatar);
        pose.rotations[thigh] = DQuat::from_rotation_x(-2.2);
        let less = unfold(&body, &mut pose, &STILL).expect("the default rig");
        assert!((0.05..0.61).contains(&less), "{less}");
        let bend = pose.rotations[thigh].to_axis_angle().1;
        assert!((bend - (2.2 - less)).abs() < 1e-9, "{bend}");
    }
}
