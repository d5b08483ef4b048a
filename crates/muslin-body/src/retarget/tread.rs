//! Toes stay above the floor.
//!
//! Feet follow the directions of somebody else's, whose toes were shorter: as a heel comes up, ours would
//! dip into the floor. They bend up instead.

use glam::{DQuat, DVec3};

use crate::pose::parent_turn;
use crate::{Avatar, BodyError, Figure, Part, Pose};

/// How deep toes may press into the floor [m].
const PRESS: f64 = 0.003;
/// Farthest that a foot bends for it [rad].
const MOST: f64 = 0.6;
/// Toes deeper than this are not about to tread [m].
const DEEPEST: f64 = 0.2;
/// Looks: what is lowest may be another place after a bend.
const ROUNDS: usize = 3;

/// Where feet tread, at rest.
pub struct Soles<'a> {
    avatar: &'a Avatar,
    figure: &'a Figure,
    feet: [Foot; 2],
    /// Height of the floor [m].
    floor: f64,
}

struct Foot {
    bone: usize,
    /// Skin below and ahead of the ankle [m].
    toes: Vec<DVec3>,
}

impl<'a> Soles<'a> {
    /// Of a figure at rest, which stands on its floor.
    pub fn new(avatar: &'a Avatar, figure: &'a Figure) -> Result<Self, BodyError> {
        let foot = |side: &str| {
            let bone = avatar.bone(&format!("foot.{side}"))?;
            let share = avatar.rig().share_of(bone);
            let skin = avatar.part(Part::Body).filter(|&v| share[v] > 0.5);
            let ankle = figure.joints[bone];
            let toes = skin.map(|v| figure.verts[v]);
            let toes = toes.filter(|p| p.y < ankle.y && p.z > ankle.z);
            Ok::<_, BodyError>(Foot {
                bone,
                toes: toes.collect(),
            })
        };
        let feet = [foot("L")?, foot("R")?];
        let all = feet.iter().flat_map(|f| &f.toes);
        let floor = all.map(|p| p.y).fold(f64::INFINITY, f64::min);
        Ok(Self {
            avatar,
            figure,
            feet,
            floor,
        })
    }

    /// The pose with its toes above the floor.
    pub fn lifted(&self, mut pose: Pose) -> Pose {
        for foot in &self.feet {
            let mut bent = 0.0;
            for _ in 0..ROUNDS {
                let bones = self.avatar.bones(self.figure, &pose);
                let here = bones[foot.bone];
                let placed = foot.toes.iter().map(|p| here.transform_point3(*p));
                let Some(lowest) = placed.min_by(|a, b| a.y.total_cmp(&b.y)) else {
                    break;
                };
                let lack = self.floor - PRESS - lowest.y;
                let lever = lowest - here.transform_point3(self.figure.joints[foot.bone]);
                let reach = lever.x.hypot(lever.z);
                let axis = lever.cross(DVec3::Y).try_normalize();
                let (Some(axis), true) = (axis, (1e-4..DEEPEST).contains(&lack)) else {
                    break;
                };
                let angle = lack.atan2(reach).min(MOST - bent);
                bent += angle;
                let frame = parent_turn(self.avatar.rig(), &bones, foot.bone);
                let turn = DQuat::from_axis_angle(axis, angle);
                pose.turn_in_world((foot.bone, frame), turn);
            }
        }
        pose
    }
}
