//! Where panels stand before they are sewn: beside our body as the pattern has them beside its own.
//!
//! A pattern is drawn for a body that is not in the file. We take it for the standard one of the
//! format (1.72 m, arms 45° down in the frontal plane, feet on the floor) and move every panel as
//! a whole: sleeves turn with the arm, all others go up or down with the height of neck and crotch,
//! and each ends a little before the skin that it covers.

use crate::panels::{Panel, SewingPattern};
use crate::stand::Stand;
use glam::{DAffine3, DQuat, DVec2, DVec3};

/// Heights of the pattern's body [m]: crotch and base of the neck.
const CROTCH: f64 = 0.765;
const NECK: f64 = 1.457;
/// A panel whose middle is farther out than this share of the shoulder's distance is a sleeve.
const SLEEVE: f64 = 1.25;
/// How far before the skin a panel stands [m].
const BEFORE: f64 = 0.03;

/// World from each panel's own plane.
pub fn arrange(pattern: &SewingPattern, stand: &Stand) -> Vec<DAffine3> {
    let one = |panel: &Panel| {
        let side = sleeve(panel, stand);
        let moved = match side {
            Some(side) => along_arm(panel, stand, side),
            None => up_or_down(panel, stand),
        };
        before_skin(panel, moved, (stand, side))
    };
    pattern.panels.iter().map(one).collect()
}

/// The direction of the warp in every panel's plane: along the arm towards the shoulder for
/// sleeves, else the panel's `y`.
pub fn grains(pattern: &SewingPattern, stand: &Stand) -> Vec<DVec2> {
    let one = |panel: &Panel| match sleeve(panel, stand) {
        Some(side) => -outward(panel, stand, side),
        None => DVec2::Y,
    };
    pattern.panels.iter().map(one).collect()
}

/// The panel's middle where the pattern places it [m].
fn middle(panel: &Panel) -> DVec3 {
    let sum: DVec2 = panel.corners.iter().sum();
    let flat = sum / panel.corners.len() as f64;
    panel.world_from_panel.transform_point3(flat.extend(0.0))
}

/// Whose arm a panel is for, if it is a sleeve: 0 left (+X), 1 right.
fn sleeve(panel: &Panel, stand: &Stand) -> Option<usize> {
    let m = middle(panel);
    let side = usize::from(m.x < 0.0);
    let far = SLEEVE * stand.limbs[side].shoulder.x.abs();
    let high = m.y > CROTCH;
    (m.x.abs() > far && high).then_some(side)
}

/// Where the pattern's body has its shoulder [m].
fn their_shoulder(stand: &Stand, side: usize) -> DVec3 {
    let ours = stand.limbs[side].shoulder;
    DVec3::new(ours.x, NECK + (ours.y - stand.neck), 0.0)
}

/// The axis of a sleeve's plane that runs most nearly from shoulder to hand.
fn outward(panel: &Panel, stand: &Stand, side: usize) -> DVec2 {
    let away = middle(panel) - their_shoulder(stand, side);
    let flat = (panel.world_from_panel.matrix3.transpose() * away).truncate();
    match flat.x.abs() > flat.y.abs() {
        true => DVec2::new(flat.x.signum(), 0.0),
        false => DVec2::new(0.0, flat.y.signum()),
    }
}

fn along_arm(panel: &Panel, stand: &Stand, side: usize) -> DAffine3 {
    let axis = outward(panel, stand, side).extend(0.0);
    let theirs = panel.world_from_panel.transform_vector3(axis);
    let limb = &stand.limbs[side];
    let ours = (limb.wrist - limb.shoulder).normalize_or(DVec3::X);
    let turn = DQuat::from_rotation_arc(theirs.normalize_or(DVec3::X), ours);
    DAffine3::from_translation(limb.shoulder)
        * DAffine3::from_quat(turn)
        * DAffine3::from_translation(-their_shoulder(stand, side))
        * panel.world_from_panel
}

fn up_or_down(panel: &Panel, stand: &Stand) -> DAffine3 {
    let high = panel.corners.iter().map(|c| {
        let p = panel.world_from_panel.transform_point3(c.extend(0.0));
        p.y
    });
    let top = high.fold(f64::MIN, f64::max);
    let lift = our_height(stand, top) - top;
    DAffine3::from_translation(DVec3::Y * lift) * panel.world_from_panel
}

/// The height on our body that corresponds to one on the pattern's [m].
fn our_height(stand: &Stand, y: f64) -> f64 {
    if y < CROTCH {
        let skin = stand.map.collision.as_flattened().iter();
        let floor = skin
            .map(|&i| stand.verts[i as usize].y)
            .fold(f64::MAX, f64::min);
        return floor + (stand.crotch.y - floor) * y / CROTCH;
    }
    let share = (y - CROTCH) / (NECK - CROTCH);
    stand.crotch.y + share * (stand.neck - stand.crotch.y)
}

/// Moves a panel along its normal until it stands just before all skin that it covers.
fn before_skin(panel: &Panel, place: DAffine3, (stand, side): (&Stand, Option<usize>)) -> DAffine3 {
    let low = panel.corners.iter().fold(DVec2::MAX, |a, b| a.min(*b)) - 0.01;
    let high = panel.corners.iter().fold(DVec2::MIN, |a, b| a.max(*b)) + 0.01;
    let normal = outer_normal(panel, &place, (stand, side));
    let inverse = place.inverse();
    let arm = |i: usize| match side {
        Some(s) => stand.map.arm[s][i] > 0.5,
        None => stand.map.arm[0][i] + stand.map.arm[1][i] < 0.5,
    };
    let skin = stand.map.collision.as_flattened().iter();
    let covered = skin.filter(|i| arm(**i as usize)).filter_map(|&i| {
        let p = stand.verts[i as usize];
        let flat = inverse.transform_point3(p).truncate();
        let within = flat.cmpge(low).all() && flat.cmple(high).all();
        within.then(|| (p - place.translation).dot(normal))
    });
    match covered.reduce(f64::max) {
        None => place,
        Some(far) => DAffine3::from_translation(normal * (far + BEFORE)) * place,
    }
}

/// The unit normal away from what the panel covers.
fn outer_normal(panel: &Panel, place: &DAffine3, (stand, side): (&Stand, Option<usize>)) -> DVec3 {
    let normal = place.transform_vector3(DVec3::Z).normalize_or(DVec3::Z);
    let sum: DVec2 = panel.corners.iter().sum();
    let at = place.transform_point3((sum / panel.corners.len() as f64).extend(0.0));
    let inside = match side {
        Some(s) => stand.limbs[s].shoulder,
        None => DVec3::new(0.0, at.y, stand.crotch.z),
    };
    if (at - inside).dot(normal) < 0.0 {
        -normal
    } else {
        normal
    }
}
