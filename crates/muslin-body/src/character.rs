//! Somebody else's character, as it was made: joints, a skin, and which joints move which skin.

use glam::{DAffine3, DQuat, DVec3};

use crate::twin::Joints;
use crate::{Avatar, BodyError, Sparse};

/// Heights that are taken as metres, and what any other becomes unless one is asked for [m].
const HEIGHTS: std::ops::RangeInclusive<f64> = 1.2..=2.3;
const USUAL: f64 = 1.7;

/// A rigged character where its skin was bound to its joints. Metres, Y up, facing +Z.
#[derive(Clone, Debug, Default)]
pub struct Character {
    /// One name a joint, as in the file; empty where it has none.
    pub names: Vec<String>,
    /// The joint that each joint hangs from. Parents come before their children.
    pub parents: Vec<Option<usize>>,
    /// `world_from_joint` of every joint.
    pub bound: Vec<DAffine3>,
    /// Vertices of all skinned meshes [m].
    pub verts: Vec<DVec3>,
    /// Their triangles.
    pub faces: Vec<[u32; 3]>,
    /// Vertex to (joint, weight); each row sums to one.
    pub weights: Sparse,
}

impl Character {
    /// Where each joint is [m].
    pub fn places(&self) -> Vec<DVec3> {
        self.bound.iter().map(|b| b.translation).collect()
    }

    /// From sole to crown [m].
    pub fn height(&self) -> f64 {
        let ys = self.verts.iter().map(|v| v.y);
        let (low, high) = ys.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
        (high - low).max(0.0)
    }

    /// Stands it on the floor at the origin, facing +Z, as tall as asked for [m]; gives
    /// `ours_from_file`. A character that is not 1.2 to 2.3 m tall becomes 1.7 m tall if no height is
    /// asked for: files come in centimetres, in units of games, and of every size.
    ///
    /// Fails where arms or legs cannot be found.
    pub fn stand(&mut self, avatar: &Avatar, height: Option<f64>) -> Result<DAffine3, BodyError> {
        let joints = Joints::find(avatar, self)?;
        let places: Vec<[DVec3; 2]> = self.places().iter().map(|p| [*p; 2]).collect();
        let stance = joints.roles.stance(&places);
        let across = (stance.leg[0][0] - stance.leg[1][0]).with_y(0.0);
        // To the nearest quarter turn: hips are never quite level.
        let quarter = (across.z.atan2(across.x) / std::f64::consts::FRAC_PI_2).round();
        let turn = DQuat::from_rotation_y(quarter * std::f64::consts::FRAC_PI_2);
        let tall = self.height();
        let scale = match height {
            Some(h) => h / tall,
            None if HEIGHTS.contains(&tall) => 1.0,
            None => USUAL / tall,
        };
        if !(scale.is_finite() && scale > 0.0) {
            return Err(BodyError::NoBody("it has no height"));
        }
        let hips = turn * stance.hips() * scale;
        let floor = self.verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min) * scale;
        let ours_from_file = DAffine3::from_scale_rotation_translation(
            DVec3::splat(scale),
            turn,
            -DVec3::new(hips.x, floor, hips.z),
        );
        self.verts
            .iter_mut()
            .for_each(|v| *v = ours_from_file.transform_point3(*v));
        self.bound.iter_mut().for_each(|b| *b = ours_from_file * *b);
        Ok(ours_from_file)
    }

    /// The same with vertices of one place made one: seams of textures double them.
    pub(crate) fn welded(&self) -> Character {
        let mut known = std::collections::HashMap::new();
        let mut out = Character {
            names: self.names.clone(),
            parents: self.parents.clone(),
            bound: self.bound.clone(),
            ..Character::default()
        };
        let mut new = Vec::with_capacity(self.verts.len());
        for (i, p) in self.verts.iter().enumerate() {
            let key = p.to_array().map(|c| (c * 1e5).round() as i64);
            new.push(*known.entry(key).or_insert_with(|| {
                out.verts.push(*p);
                out.weights.push(self.weights.row(i).iter().copied());
                out.verts.len() as u32 - 1
            }));
        }
        let faces = self.faces.iter().map(|f| f.map(|i| new[i as usize]));
        out.faces = faces
            .filter(|f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0])
            .collect();
        out
    }

    /// The joints that hang from each joint.
    pub(crate) fn children(&self) -> Vec<Vec<usize>> {
        let mut all = vec![Vec::new(); self.parents.len()];
        for (j, parent) in self.parents.iter().enumerate() {
            if let Some(p) = parent {
                all[*p].push(j);
            }
        }
        all
    }
}
