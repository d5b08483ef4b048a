//! Room for cloth all along a motion: limbs that graze the body are led a little off, and back.

use std::ops::Range;

use glam::{DQuat, DVec3};
use muslin_body::{Avatar, BodyError, Figure, Limbs, Motion, Pose};
use rayon::prelude::*;

use crate::figure::{FOLDS, Folding, ROOM, Yielding, unfold};

/// Room that hands and forearms leave while they move [m]: between two frames they go as far, and cloth that stands off
/// a thigh they only graze is torn along.
const SWUNG: f64 = 0.045;
/// Looks a second.
const LOOKS: f64 = 15.0;
/// What passes the body fastest; between two looks it is looked at wherever one of these has gone so far about the root [m].
const ENDS: [&str; 4] = ["wrist.L", "wrist.R", "foot.L", "foot.R"];
const PASSED: f64 = 0.08;

/// Somebody in motion: cloth is led in and out of folds as deep as those of a squat, but lean and trained dancers bend
/// their hips farther than our flesh yields.
const MOVING: Folding = Folding {
    deepest: f64::INFINITY,
    crossings: 100,
    bent: 1.9,
    rounds: 8,
    less: 0.12,
};

/// What each limb turns by, as axis times angle [rad].
type Turns = Vec<DVec3>;

/// Turns thighs and upper arms where a motion leads feet, shins, hands or forearms into the body, and bends hips and knees
/// less where they fold it too deep; says by how much at most [rad].
///
/// The body is looked at fifteen times a second, and in between where hands or feet go far: a fist goes past a hip within a frame or
/// two. A turn is there from one look before it is needed to one look after, and grows and fades over a look more, so that no
/// limb jumps.
pub fn make_room(avatar: &Avatar, figure: &Figure, motion: &mut Motion) -> Result<f64, BodyError> {
    let limbs = Limbs::new(avatar, [ROOM, SWUNG])?;
    let stride = (motion.fps / LOOKS).round().max(1.0) as usize;
    let last = motion.poses.len().saturating_sub(1);
    let looks: Vec<usize> = (0..=last.div_ceil(stride))
        .map(|k| (k * stride).min(last))
        .collect();
    let folding = FOLDS.iter().map(|name| avatar.bone(name));
    let mut bones: Vec<usize> = folding
        .chain(limbs.bones().map(Ok))
        .collect::<Result<_, _>>()?;
    bones.sort_unstable();
    bones.dedup();
    let body = Yielding::new(avatar, figure);
    let tips: Vec<usize> = ENDS
        .iter()
        .map(|name| avatar.bone(name))
        .collect::<Result<_, _>>()?;
    let ends = |k: usize| ends((avatar, figure), &tips, &motion.poses[k]);
    // Frames, and the looks that each of them counts for: its own, or both that it lies between.
    let own = looks.iter().enumerate().map(|(i, &k)| (k, i..=i));
    let pairs = looks.windows(2).enumerate();
    let between = pairs.flat_map(|(i, pair)| {
        let passed = passed(pair[0]..pair[1], ends).into_iter();
        passed.map(move |k| (k, i..=i + 1))
    });
    let seen: Vec<_> = own.chain(between).collect();
    let look = |(k, _): &(usize, _)| turns((&limbs, &bones), &body, &motion.poses[*k]);
    let turned: Vec<Turns> = seen.par_iter().map(look).collect::<Result<_, _>>()?;
    let mut needed = vec![vec![DVec3::ZERO; bones.len()]; looks.len()];
    for ((_, counts), turns) in seen.into_iter().zip(&turned) {
        for needed in &mut needed[counts] {
            let both = needed.iter_mut().zip(turns);
            both.for_each(|(a, b)| *a = larger(*a, *b));
        }
    }
    let led = faded(&held(&needed));
    let largest = led.iter().flatten().map(|t| t.length());
    let largest = largest.fold(0.0, f64::max);
    if largest > 0.0 {
        for (k, pose) in motion.poses.iter_mut().enumerate() {
            let (at, t) = (k / stride, (k % stride) as f64 / stride as f64);
            let next = (at + 1).min(led.len() - 1);
            for (j, &b) in bones.iter().enumerate() {
                let turn = led[at][j].lerp(led[next][j], t);
                if turn == DVec3::ZERO {
                    continue;
                }
                pose.rotations[b] = (DQuat::from_scaled_axis(turn) * pose.rotations[b]).normalize();
            }
        }
    }
    Ok(largest)
}

/// Where the joints `tips` are, as the root sees them [m].
fn ends((avatar, figure): (&Avatar, &Figure), tips: &[usize], pose: &Pose) -> Vec<DVec3> {
    let bones = avatar.bones(figure, pose);
    let root = bones[0].inverse();
    let at = |&b: &usize| root.transform_point3(bones[b].transform_point3(figure.joints[b]));
    tips.iter().map(at).collect()
}

/// The frames after the first of `frames` where one of the `ends` has gone far since the last of them, or since the first.
fn passed(frames: Range<usize>, ends: impl Fn(usize) -> Vec<DVec3>) -> Vec<usize> {
    let mut found = Vec::new();
    if frames.len() < 2 {
        return found;
    }
    let mut last = ends(frames.start);
    for k in frames.skip(1) {
        let now = ends(k);
        if last.iter().zip(&now).any(|(a, b)| a.distance(*b) > PASSED) {
            found.push(k);
            last = now;
        }
    }
    found
}

/// The longer of two turns.
fn larger(a: DVec3, b: DVec3) -> DVec3 {
    if b.length() > a.length() { b } else { a }
}

/// What one pose needs.
fn turns(
    (limbs, bones): (&Limbs, &[usize]),
    body: &Yielding<'_>,
    pose: &Pose,
) -> Result<Turns, BodyError> {
    let mut freed = pose.clone();
    unfold(body, &mut freed, &MOVING)?;
    limbs.make_room(&mut freed, body.avatar, body.figure);
    let turn = |&b: &usize| {
        let turn = freed.rotations[b] * pose.rotations[b].inverse();
        let shorter = if turn.w < 0.0 { -turn } else { turn };
        shorter.to_scaled_axis()
    };
    Ok(bones.iter().map(turn).collect())
}

/// Every turn of the looks before and after as well, the largest where they meet.
fn held(looks: &[Turns]) -> Vec<Turns> {
    around(looks, |before, now, after| {
        larger(larger(now, before), after)
    })
}

/// Turns that fade from one look to the next.
fn faded(looks: &[Turns]) -> Vec<Turns> {
    around(looks, |before, now, after| {
        (before + now * 2.0 + after) * 0.25
    })
}

/// `of` each joint's turns at a look and at those beside it.
fn around(looks: &[Turns], of: impl Fn(DVec3, DVec3, DVec3) -> DVec3) -> Vec<Turns> {
    let last = looks.len().saturating_sub(1);
    let one = |k: usize| {
        let (before, after) = (&looks[k.saturating_sub(1)], &looks[(k + 1).min(last)]);
        let now = looks[k].iter().enumerate();
        now.map(|(j, now)| of(before[j], *now, after[j])).collect()
    };
    (0..looks.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use muslin_body::Shape;

    use super::*;

    /// A motion of so many poses, before and after room is made, and by how much limbs were turned at most [rad].
    fn made_room(
        (avatar, figure): (&Avatar, &Figure),
        poses: impl Iterator<Item = Pose>,
    ) -> (Motion, Motion, f64) {
        let before = Motion {
            fps: 30.0,
            poses: poses.collect(),
        };
        let mut motion = before.clone();
        let turned = make_room(avatar, figure, &mut motion).expect("the default rig");
        for k in [0, before.poses.len() - 1] {
            assert_eq!(motion.poses[k], before.poses[k]);
        }
        (before, motion, turned)
    }

    /// How far a bone turns from one pose to the next at most [rad].
    fn jump(motion: &Motion, bone: usize) -> f64 {
        let pairs = motion.poses.windows(2);
        let turns = pairs.map(|p| p[0].rotations[bone].angle_between(p[1].rotations[bone]));
        turns.fold(0.0, f64::max)
    }

    /// An arm brought down by so much [rad] in each of 41 poses: before and after room is made, by how much limbs were
    /// turned for it at most, and still would be in one pose of either [rad].
    fn brought_down(down: impl Fn(i32) -> f64, looked_at: usize) -> ([Motion; 2], f64, [f64; 2]) {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.figure(&Shape::default()).expect("a body");
        let arm = avatar.bone(ARM).expect("an arm");
        let pose = |k: i32| {
            let mut pose = Pose::rest(&avatar);
            pose.rotations[arm] = DQuat::from_rotation_z(-down(k));
            pose
        };
        let (before, motion, turned) = made_room((&avatar, &figure), (0..41).map(pose));
        assert!((0.02..0.6).contains(&turned), "{turned}");
        let limbs = Limbs::new(&avatar, [ROOM, SWUNG]).expect("limbs");
        let left = [&before, &motion]
            .map(|m| limbs.make_room(&mut m.poses[looked_at].clone(), &avatar, &figure));
        ([before, motion], turned, left)
    }

    const ARM: &str = "upperarm01.L";

    #[test]
    fn an_arm_that_swings_into_the_hip_keeps_off_it_and_nothing_jumps() {
        let down = |k: i32| 0.85 * (-(f64::from(k - 20) / 8.0).powi(2)).exp();
        let ([before, motion], turned, [_, left]) = brought_down(down, 20);
        assert!(left < 0.3 * turned, "{left} of {turned}");
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let arm = avatar.bone(ARM).expect("an arm");
        assert!(jump(&motion, arm) < jump(&before, arm) + 0.05);
    }

    #[test]
    fn an_arm_that_is_in_the_hip_between_two_looks_alone_keeps_off_it() {
        // Every other of 30 frames a second is looked at.
        let down = |k: i32| if k == 21 { 0.85 } else { 0.3 };
        let (_, _, left) = brought_down(down, 21);
        assert!(left[1] < 0.3 * left[0], "{left:?}");
    }

    #[test]
    fn a_thigh_that_a_motion_presses_through_the_belly_is_bent_less_for_as_long_as_it_is() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let shape = Shape::default().with("weight", 0.9).expect("a phenotype");
        let figure = avatar.figure(&shape).expect("a heavy person");
        let [thigh, shin] =
            ["upperleg01.L", "lowerleg01.L"].map(|b| avatar.bone(b).expect("a leg"));
        let pose = |k: i32| {
            let mut pose = Pose::rest(&avatar);
            let up = (-(f64::from(k - 30) / 6.0).powi(2)).exp();
            pose.rotations[thigh] = DQuat::from_rotation_x(-2.2 * up);
            pose.rotations[shin] = DQuat::from_rotation_x(0.5 * up);
            pose
        };
        let (before, motion, turned) = made_room((&avatar, &figure), (0..61).map(pose));
        assert!((0.05..1.0).contains(&turned), "{turned}");
        let bend = |m: &Motion, k: usize| m.poses[k].rotations[thigh].to_axis_angle().1;
        let less = bend(&before, 30) - bend(&motion, 30);
        assert!((less - turned).abs() < 1e-6, "{less} of {turned}");
        // Nothing folds there.
        assert_eq!(
            motion.poses[30].rotations[shin],
            before.poses[30].rotations[shin]
        );
        assert!(jump(&motion, thigh) < jump(&before, thigh) + 0.05);
    }
}
