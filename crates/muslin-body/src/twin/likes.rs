//! Points that two bodies have in common: joints, soles, crown, and four sides of every limb.

use glam::DVec3;

use crate::retarget::Stance;
use crate::{Avatar, BodyError, Figure, Posed};

/// Where our limbs are in a pose [m].
pub(super) fn standing(base: &Avatar, figure: &Figure, posed: &Posed) -> Result<Stance, BodyError> {
    let at = |name: &str| -> Result<DVec3, BodyError> {
        let b = base.bone(name)?;
        Ok(posed.bones[b].transform_point3(figure.joints[b]))
    };
    let limb = |names: [&str; 3], side: &str| -> Result<[DVec3; 3], BodyError> {
        let [a, b, c] = names.map(|n| at(&format!("{n}.{side}")));
        Ok([a?, b?, c?])
    };
    let (leg, arm) = (
        ["upperleg01", "lowerleg01", "foot"],
        ["upperarm01", "lowerarm01", "wrist"],
    );
    Ok(Stance {
        leg: [limb(leg, "L")?, limb(leg, "R")?],
        arm: [limb(arm, "L")?, limb(arm, "R")?],
        toe: [Some(at("toe3-1.L")?), Some(at("toe3-1.R")?)],
        hand: [None, None],
        neck: Some(at("neck01")?),
        head: Some(at("head")?),
    })
}

/// A body whose like points are to be found on another.
pub(super) struct Likes<'a> {
    pub stance: Stance,
    /// The skin [m].
    pub verts: &'a [DVec3],
    /// The limb of each vertex: 0 for the trunk and head, then arms and legs, left before right.
    pub limb: &'a [usize],
}

/// Points of one body, and where they are on the other [m].
pub(super) fn correspondences(ours: &Likes, theirs: &Likes) -> (Vec<DVec3>, Vec<DVec3>) {
    let (mut from, mut to) = (Vec::new(), Vec::new());
    let mut add = |a: Option<DVec3>, b: Option<DVec3>| {
        if let (Some(a), Some(b)) = (a, b)
            && from.iter().all(|f: &DVec3| f.distance(a) > 0.01)
        {
            from.push(a);
            to.push(b);
        }
    };
    let (a, b) = (&ours.stance, &theirs.stance);
    for s in 0..2 {
        for k in 0..3 {
            add(Some(a.leg[s][k]), Some(b.leg[s][k]));
            add(Some(a.arm[s][k]), Some(b.arm[s][k]));
        }
        add(ours.sole(s), theirs.sole(s));
        add(ours.fingertip(s), theirs.fingertip(s));
        add(ours.toe_tip(s), theirs.toe_tip(s));
        for k in 0..2 {
            for t in [0.3, 0.7] {
                for way in 0..4 {
                    let leg = |body: &Likes| body.around(3 + s, &body.stance.leg[s][k..], (t, way));
                    add(leg(ours), leg(theirs));
                    let arm = |body: &Likes| body.around(1 + s, &body.stance.arm[s][k..], (t, way));
                    add(arm(ours), arm(theirs));
                }
            }
        }
    }
    add(a.neck, b.neck);
    if b.neck.is_some() {
        add(a.head, b.head);
    }
    add(ours.crown(), theirs.crown());
    for way in 0..4 {
        // Across, the shoulders are the arms' concern.
        let levels = if way < 2 { 0.0..0.9 } else { 0.0..0.5 };
        for t in [0.0, 0.3, 0.6, 0.85]
            .into_iter()
            .filter(|t| levels.contains(t))
        {
            let trunk = |body: &Likes| body.around(0, &body.trunk(), (t, way));
            add(trunk(ours), trunk(theirs));
        }
        let head = |body: &Likes| body.around(0, &body.head()?, (0.5, way));
        add(head(ours), head(theirs));
    }
    (from, to)
}

impl Likes<'_> {
    fn of(&self, limb: usize) -> impl Iterator<Item = DVec3> {
        let all = self.verts.iter().zip(self.limb);
        all.filter(move |(_, l)| **l == limb).map(|(p, _)| *p)
    }

    /// Straight below the ankle.
    fn sole(&self, side: usize) -> Option<DVec3> {
        let low = self.of(3 + side).map(|p| p.y).reduce(f64::min)?;
        Some(self.stance.leg[side][2].with_y(low))
    }

    fn toe_tip(&self, side: usize) -> Option<DVec3> {
        self.of(3 + side)
            .filter(|p| p.y < self.stance.leg[side][2].y)
            .max_by(|a, b| a.z.total_cmp(&b.z))
    }

    /// The end of the hand along the forearm.
    fn fingertip(&self, side: usize) -> Option<DVec3> {
        let [_, elbow, wrist] = self.stance.arm[side];
        let along = (wrist - elbow).normalize_or_zero();
        let reach = self
            .of(1 + side)
            .map(|p| (p - wrist).dot(along))
            .reduce(f64::max)?;
        Some(wrist + along * reach)
    }

    fn crown(&self) -> Option<DVec3> {
        let top = self.of(0).max_by(|a, b| a.y.total_cmp(&b.y))?;
        Some(DVec3::new(
            self.stance.hips().x,
            top.y,
            self.stance.neck.or(self.stance.head)?.z,
        ))
    }

    /// From the hips to the shoulders.
    fn trunk(&self) -> [DVec3; 2] {
        let shoulders = 0.5 * (self.stance.arm[0][0] + self.stance.arm[1][0]);
        [self.stance.hips(), shoulders]
    }

    /// From the lower end of the head or neck to the crown.
    fn head(&self) -> Option<[DVec3; 2]> {
        Some([self.stance.neck.or(self.stance.head)?, self.crown()?])
    }

    /// The farthest skin from the line between two places, a share of the way along it, to one of four
    /// sides: before, behind, and across.
    fn around(&self, limb: usize, line: &[DVec3], (t, way): (f64, usize)) -> Option<DVec3> {
        let along = line[1] - line[0];
        let at = line[0] + along * t;
        let across = along.cross(DVec3::Z).normalize_or(DVec3::X);
        let side = [DVec3::Z, DVec3::NEG_Z, across, -across][way];
        let thick = 0.06 * along.length();
        let near = self
            .of(limb)
            .filter(|p| (*p - at).dot(along).abs() < thick * along.length());
        let reach = near.map(|p| (p - at).dot(side)).reduce(f64::max)?;
        Some(at + side * reach.max(0.0))
    }
}
