//! How much cloth swings: predicted, refined with inertia, and simulated.

use std::ops::ControlFlow;
use std::path::Path;
use std::slice;

use glam::{DMat3, DQuat, DVec3};
use muslin_model::{Model, Skin};
use muslin_sim::{Options, SimError, simulate};

use super::garments::{REFINE, Wearer, set};
use crate::animate::{along, predict};
use crate::evaluate::beyond::{alike, beyond, content};
use crate::failure::{Exit, Failure};
use crate::options::DressOptions;
use crate::simulate::set::Set;
use crate::swings;
use crate::table::Table;
use crate::watch::Watch;

/// Seconds of a clip that are danced, and frames a second that are compared.
const SECONDS: f64 = 2.5;
pub(super) const FPS: f64 = 30.0;
/// Simulated frames for each of them: the simulator at the rate that it is made for.
pub(super) const FINER: usize = 2;

/// Adds the rows of a clip, what cloth does beyond where it would rest, and returns them in short.
///
/// Content is the root mean square of how a vertex moves against the prediction for a body that stands
/// still in each pose, in the frame of the bones it follows; what never changes (a fold that lies
/// elsewhere) does not count.
pub(super) fn rows(
    (who, model): (Wearer, &Model),
    (clip, worn, names): (&Path, &DressOptions, [&str; 2]),
    table: &mut Table,
) -> Result<String, Failure> {
    let set_at = |fps: f64| set((who, model), (clip, fps, worn), Some(SECONDS));
    let mut here = set_at(FPS)?;
    let swinging = swung(&here, model)?;
    let still = predict((&here, slice::from_ref(&swinging)), (0.0, usize::MAX))?.frames;
    let (raw, off) = turned(&mut here, &swinging)?;
    let off = format!("{:.4}", 1e3 * off);
    let refined = along((&here, REFINE, 1.0), (0, &raw, None), &mut Watch::nobody())?;
    let refined: Vec<Vec<DVec3>> = refined.into_iter().map(|s| s.cloth).collect();
    let simulated = simulated(&set_at(FPS * FINER as f64)?)?;
    let turns = turns(&here, model)?;
    let beyond = |x: &[Vec<DVec3>]| beyond(x, &still, &turns);
    let truth = beyond(&simulated);
    let mut short = Vec::new();
    for (tier, x) in [
        ("network", &raw),
        ("refined", &refined),
        ("simulated", &simulated),
    ] {
        let own = beyond(x);
        let first = |name: &str| match tier {
            "network" => name.to_owned(),
            _ => String::new(),
        };
        let share = format!("{:.2}", content(&own) / content(&truth));
        short.push(format!("{tier} {share}"));
        table.row([
            first(names[0]),
            first(names[1]),
            tier.to_owned(),
            format!("{:.1}", content(&own) * 1e3),
            share,
            format!("{:.2}", alike(&own, &truth)),
            first(&off),
        ]);
    }
    short.pop();
    Ok(format!("{} of the simulator's swing", short.join(", ")))
}

/// A model that knows its wearer, with swings for that.
pub(super) fn swung(set: &Set, model: &Model) -> Result<Model, Failure> {
    let told = set.told(0, model.clone())?;
    match swings::are_ours(&told) {
        true => swings::swinging(told, (set.avatar, &set.figure), &set.cloth),
        false => Ok(told),
    }
}

/// Where a model lays the cloth in every frame [m], and how far a vertex is at most from there if body and motion are
/// turned about [m].
fn turned(set: &mut Set, model: &Model) -> Result<(Vec<Vec<DVec3>>, f64), Failure> {
    let raw = predict((set, slice::from_ref(model)), (1.0, usize::MAX))?.frames;
    let poses = set.moving.motion.poses.clone();
    yaw(set);
    let turned = predict((set, slice::from_ref(model)), (1.0, usize::MAX))?.frames;
    set.moving.motion.poses = poses;
    let off = apart(&raw, &turned);
    Ok((raw, off))
}

/// Heads of the table that [`rows`] fills.
pub(super) const HEADS: [&str; 7] = [
    "clip",
    "model",
    "tier",
    "swing mm",
    "of the simulator's",
    "alike",
    "turned about mm",
];

/// How far the body is turned about the vertical [rad], to see whether the cloth is the same.
const YAW: f64 = 2.0;

/// Turns a whole motion about the vertical.
fn yaw(set: &mut Set) {
    let (turn, head) = (DQuat::from_rotation_y(YAW), set.figure.joints[0]);
    for pose in &mut set.moving.motion.poses {
        pose.rotations[0] = turn * pose.rotations[0];
        pose.root = turn * (head + pose.root) - head;
    }
}

/// How far a vertex is at most from where it is in the motion that was turned about [m].
fn apart(x: &[Vec<DVec3>], turned: &[Vec<DVec3>]) -> f64 {
    let turn = DQuat::from_rotation_y(YAW);
    let pairs = x.iter().flatten().zip(turned.iter().flatten());
    pairs
        .map(|(x, y)| y.distance(turn * *x))
        .fold(0.0, f64::max)
}

/// Every `FINER`-th simulated frame.
pub(super) fn simulated(set: &Set) -> Result<Vec<Vec<DVec3>>, Failure> {
    let (rest, at) = (set.rest(), |k: usize| set.frame(k));
    let walk = set.walk(&rest, &at);
    let mut out = Vec::new();
    let ended = simulate(
        &set.cloth,
        (&set.start, None),
        (&walk, &Options::default()),
        |m| {
            if m.frame.is_multiple_of(FINER) {
                out.push(m.verts.to_vec());
            }
            ControlFlow::Continue(())
        },
    );
    ended.map_err(|e: SimError| Failure::new(Exit::Numbers, "simulate", e.to_string()))?;
    Ok(out)
}

/// The mean turn of every vertex's bones, frame after frame.
fn turns(set: &Set, model: &Model) -> Result<Vec<Vec<DMat3>>, Failure> {
    let find = |name: &String| set.avatar.bone(name);
    let rig: Result<Vec<usize>, _> = model.bones.iter().map(find).collect();
    let rig = rig.map_err(|e| crate::figure::body_failure(&e))?;
    let one = |pose| {
        let bones = set.avatar.bones(&set.figure, pose);
        let turn = |v: usize| mean_turn(&model.skin, v, |b| bones[rig[b]].matrix3);
        (0..model.n_verts()).map(turn).collect()
    };
    Ok(set.moving.motion.poses[set.moving.lead..]
        .iter()
        .map(one)
        .collect())
}

fn mean_turn(skin: &Skin, v: usize, bone: impl Fn(usize) -> DMat3) -> DMat3 {
    let all = skin.row(v).map(|(b, w)| bone(b) * f64::from(w));
    all.fold(DMat3::ZERO, |a, m| a + m)
}

#[cfg(test)]
mod tests {
    use muslin_body::Avatar;

    use super::*;
    use crate::wardrobe;

    #[test]
    fn garments_that_are_shipped_swing_alike_whichever_way_they_face() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for (garment, _) in wardrobe::TAUGHT {
            let model = wardrobe::model(garment).expect("it is shipped");
            let worn = DressOptions::default();
            let walk = (Path::new("walk"), FPS, &worn);
            let mut here = set(((&avatar, None), &model), walk, Some(2.0)).expect("it is worn");
            let swinging = swung(&here, &model).expect("it swings");
            let (raw, off) = turned(&mut here, &swinging).expect("it plays");
            let still = predict((&here, slice::from_ref(&swinging)), (0.0, usize::MAX));
            let still = still.expect("it plays").frames;
            let swing = raw.iter().flatten().zip(still.iter().flatten());
            let swing = swing.map(|(x, y)| x.distance(*y)).fold(0.0, f64::max);
            // A tenth of a millimetre, of centimetres.
            assert!(
                off < 1e-4 && swing > 0.01,
                "{garment}: {off} m of {swing} m"
            );
        }
    }
}
