//! Motions of our own, so that nobody needs a file to see cloth move.
//!
//! They are drawn, not recorded: feet stand where they carry, the lowest point of the body touches
//! the floor (but for the flight of a run), arms hang clear of the hips of any figure. All start
//! and end without speed. Those on the spot end in the pose they began in, so they loop.

mod gait;
mod puppet;

use glam::{DVec2, DVec3};

use crate::{Avatar, BodyError, Figure, Motion, Pose};
use gait::{Gait, Spot, eased, smooth};
use puppet::{Foot, Key, Leg, Puppet};

/// The motions that [`make`] knows.
pub const NAMES: [&str; 10] = [
    "walk",
    "run",
    "turn",
    "wave",
    "squat",
    "arms-up",
    "sit",
    "spin",
    "dance",
    "cartwheel",
];

/// What each of [`NAMES`] shows.
pub const SAYS: [&str; 10] = [
    "seven steps straight ahead",
    "three strides of each leg, straight ahead",
    "walks ahead, turns about in a bow, walks back",
    "greets with the right hand",
    "down on both knees' bend and up again, arms ahead",
    "both arms up sideways and down again",
    "down on a stool that is not there, a rest, and up again",
    "twice around on the spot with short steps, arms out",
    "four bars of steps to and fro with swinging hips and arms",
    "sideways over both hands",
];

const TAU: f64 = std::f64::consts::TAU;

/// The motion called `name` on this figure, at `fps` poses a second.
///
/// Takes about a millisecond a pose. Lengths scale with the figure's legs.
pub fn make(avatar: &Avatar, figure: &Figure, name: &str, fps: f64) -> Result<Motion, BodyError> {
    let puppet = Puppet::new(avatar, figure)?;
    let (seconds, draw): (f64, fn(&Puppet, f64) -> Key) = match name {
        "walk" => (4.0, walk),
        "run" => (3.4, run),
        "turn" => (5.0, turn),
        "wave" => (3.0, wave),
        "squat" => (3.0, squat),
        "arms-up" => (3.0, arms_up),
        "sit" => (4.0, sit),
        "spin" => (3.6, spin),
        "dance" => (4.0, dance),
        "cartwheel" => (3.0, cartwheel),
        _ => return Err(BodyError::UnknownMotion { name: name.into() }),
    };
    let n = (seconds * fps).round().max(1.0) as usize;
    let pose = |i: usize| puppet.pose(&draw(&puppet, seconds * i as f64 / n as f64));
    let mut poses = (0..=n).map(pose).collect::<Result<Vec<_>, _>>()?;
    if name == "cartwheel" {
        roll(&puppet, &mut poses);
        calm(&mut poses, fps);
    }
    Ok(Motion { fps, poses })
}

/// Standing at ease.
fn stand(puppet: &Puppet) -> Key {
    let [out, ahead] = puppet.stance;
    let foot = |x: f64| {
        Leg::Foot(Foot {
            ball: DVec3::new(x, 0.0, ahead),
            heading: 0.0,
            pitch: 0.0,
        })
    };
    Key {
        hips: DVec3::new(0.0, -0.01, 0.0),
        heading: 0.0,
        pelvis: [0.0; 3],
        chest: [0.0; 3],
        head: [0.0; 3],
        arms: [hang(puppet, 0.0, 10.0); 2],
        legs: [foot(out), foot(-out)],
    }
}

/// An arm that hangs clear of the hips, swung ahead and bent at the elbow [degrees].
fn hang(puppet: &Puppet, swing: f64, bend: f64) -> [DVec3; 2] {
    let at = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        DVec3::new(puppet.clear, -c, s)
    };
    [at(swing), at(swing + bend)]
}

/// A direction between two, turning evenly.
fn between(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    let (a, b) = (a.normalize(), b.normalize());
    glam::DQuat::IDENTITY.slerp(glam::DQuat::from_rotation_arc(a, b), t) * a
}

fn arms_between(a: [DVec3; 2], b: [DVec3; 2], t: f64) -> [DVec3; 2] {
    [between(a[0], b[0], t), between(a[1], b[1], t)]
}

/// How the trunk and arms go with the steps.
struct Swing {
    /// Drop of the hips against standing [legs].
    drop: f64,
    /// Half the rise and fall of the hips in a step [legs].
    bob: f64,
    /// Lean ahead [degrees].
    lean: f64,
    /// Turn of the pelvis to either side; the chest turns back [degrees].
    twist: f64,
    /// Swing of the arms to either side [degrees].
    arms: f64,
    /// Bend of the elbows [degrees].
    bend: f64,
}

/// A body `s` along a gait.
fn step(puppet: &Puppet, gait: &Gait, s: f64, swing: &Swing) -> Key {
    let spot = (gait.way)(s);
    let beat = TAU * gait.phase(s, 0);
    // The left foot lands at beat 0; half a stance later the hips are over it.
    let over = beat - 0.5 * TAU * gait.duty;
    let side = 0.02 * over.cos();
    let (sin, cos) = spot.heading.sin_cos();
    let rise = swing.bob * (2.0 * over).cos();
    let arm = |sign: f64| {
        let angle = 5.0 - sign * swing.arms * (beat - 0.3).cos();
        hang(
            puppet,
            angle,
            swing.bend + 0.4 * swing.arms * (1.0 - sign * (beat - 0.3).cos()),
        )
    };
    let twist = -swing.twist * (beat - 0.2).cos();
    Key {
        hips: DVec3::new(
            spot.at.x + side * cos,
            rise - swing.drop,
            spot.at.y - side * sin,
        ),
        heading: spot.heading,
        pelvis: [0.4 * swing.lean, -2.0 * over.cos(), twist],
        chest: [0.6 * swing.lean, 2.0 * over.cos(), -1.8 * twist],
        head: [-0.5 * swing.lean, 0.0, 0.8 * twist],
        arms: [arm(1.0), arm(-1.0)],
        legs: [0, 1].map(|side| Leg::Foot(gait.foot(s, side))),
    }
}

fn straight(s: f64) -> Spot {
    Spot {
        at: DVec2::new(0.0, s),
        heading: 0.0,
    }
}

fn walk(puppet: &Puppet, time: f64) -> Key {
    let gait = Gait {
        way: &straight,
        end: 3.5 * 1.45,
        stride: 1.45,
        duty: 0.62,
        lift: 0.07,
        roll: [32.0, 14.0],
        stance: [0.7 * puppet.stance[0], puppet.stance[1]],
    };
    let swing = Swing {
        drop: 0.045,
        bob: 0.012,
        lean: 4.0,
        twist: 5.0,
        arms: 20.0,
        bend: 14.0,
    };
    let s = gait.end * eased(time, 4.0, 0.7);
    step(puppet, &gait, s, &swing)
}

fn run(puppet: &Puppet, time: f64) -> Key {
    let gait = Gait {
        way: &straight,
        end: 3.0 * 2.3,
        stride: 2.3,
        duty: 0.38,
        lift: 0.24,
        roll: [42.0, 4.0],
        stance: [0.5 * puppet.stance[0], puppet.stance[1]],
    };
    let swing = Swing {
        drop: 0.09,
        bob: -0.03,
        lean: 12.0,
        twist: 8.0,
        arms: 32.0,
        bend: 62.0,
    };
    let s = gait.end * eased(time, 3.4, 0.7);
    let mut key = step(puppet, &gait, s, &swing);
    // Both feet leave the floor between the steps.
    let speed = smooth(time / 0.7) * smooth((3.4 - time) / 0.7);
    let over = 2.0 * (TAU * gait.phase(s, 0) - 0.5 * TAU * gait.duty);
    let flight = 0.035 * speed * (0.5 - 0.5 * over.cos()).powi(2);
    for leg in &mut key.legs {
        if let Leg::Foot(foot) = leg {
            foot.ball.y += flight;
        }
    }
    key.hips.y += flight;
    key
}

/// Ahead, half around in a bow of radius 0.7 legs, and back.
fn bow(s: f64) -> Spot {
    const STEPS: usize = 64;
    let heading = |s: f64| 0.5 * TAU * smooth((s - 1.2) / 3.0);
    // The trapezoid rule over a smooth turn is exact to a fraction of a millimetre.
    let h = s / STEPS as f64;
    let ahead = |i: usize| {
        let half = if i == 0 || i == STEPS { 0.5 } else { 1.0 };
        half * h * DVec2::from(heading(i as f64 * h).sin_cos())
    };
    Spot {
        at: (0..=STEPS).map(ahead).sum(),
        heading: heading(s),
    }
}

fn turn(puppet: &Puppet, time: f64) -> Key {
    let gait = Gait {
        way: &bow,
        end: 4.5 * 1.2,
        stride: 1.2,
        duty: 0.62,
        lift: 0.07,
        roll: [28.0, 10.0],
        stance: [0.8 * puppet.stance[0], puppet.stance[1]],
    };
    let swing = Swing {
        drop: 0.035,
        bob: 0.01,
        lean: 3.0,
        twist: 4.0,
        arms: 15.0,
        bend: 14.0,
    };
    step(puppet, &gait, gait.end * eased(time, 5.0, 0.7), &swing)
}

fn spin(puppet: &Puppet, time: f64) -> Key {
    let way = |s: f64| Spot {
        at: DVec2::ZERO,
        heading: s,
    };
    let gait = Gait {
        way: &way,
        end: 2.0 * TAU,
        stride: TAU / 3.0,
        duty: 0.6,
        lift: 0.05,
        roll: [12.0, 0.0],
        stance: [puppet.stance[0], 0.5 * puppet.stance[1]],
    };
    let swing = Swing {
        drop: 0.03,
        bob: 0.004,
        lean: 0.0,
        twist: 0.0,
        arms: 0.0,
        bend: 10.0,
    };
    let mut key = step(puppet, &gait, gait.end * eased(time, 3.6, 0.9), &swing);
    let out = smooth(time / 0.8) * smooth((3.6 - time) / 0.8);
    let wide = [DVec3::new(1.0, -0.35, 0.1), DVec3::new(1.0, -0.25, 0.35)];
    key.arms = key.arms.map(|arm| arms_between(arm, wide, out));
    key
}

fn wave(puppet: &Puppet, time: f64) -> Key {
    let mut key = stand(puppet);
    let up = smooth(time / 0.9) * smooth((3.0 - time) / 0.9);
    let beat = TAU * 1.8 * (time - 0.7);
    let sway = 0.35 * smooth((time - 0.5) / 0.5) * smooth((2.5 - time) / 0.5) * beat.sin();
    // The way up leads outwards, not through the chest.
    let raised = [
        DVec3::new(1.0, 0.25, 0.25),
        DVec3::new(0.25 + sway, 1.0, 0.25),
    ];
    key.arms[1] = arms_between(key.arms[1], raised, up);
    key.hips.x = 0.03 * up;
    key.pelvis[1] = -2.0 * up;
    key.chest = [0.0, 5.0 * up, -4.0 * up];
    key.head = [0.0, -5.0 * up, -6.0 * up];
    key
}

fn squat(puppet: &Puppet, time: f64) -> Key {
    let mut key = stand(puppet);
    let down = smooth(time / 1.3) * smooth((3.0 - time) / 1.3);
    key.hips += DVec3::new(0.0, -0.46, -0.3) * down;
    key.pelvis[0] = 28.0 * down;
    key.chest[0] = 14.0 * down;
    key.head[0] = -24.0 * down;
    let ahead = [DVec3::new(0.2, -0.25, 1.0), DVec3::new(0.05, -0.1, 1.0)];
    key.arms = key.arms.map(|arm| arms_between(arm, ahead, down));
    for (leg, turn) in key.legs.iter_mut().zip([1.0, -1.0]) {
        if let Leg::Foot(foot) = leg {
            // Wider and toes out from the start, as one does.
            foot.ball.x *= 1.5;
            foot.heading = 0.25 * turn;
        }
    }
    key
}

fn arms_up(puppet: &Puppet, time: f64) -> Key {
    let mut key = stand(puppet);
    let t = smooth(time / 1.3) * smooth((3.0 - time) / 1.3);
    let out = [DVec3::new(1.0, 0.05, 0.1), DVec3::new(1.0, 0.1, 0.2)];
    let up = [DVec3::new(0.42, 1.0, 0.05), DVec3::new(0.2, 1.0, 0.1)];
    // By way of level: the straight way is the same, but it may lead through the back.
    let level = |arm: [DVec3; 2]| arms_between(arm, out, (2.0 * t).min(1.0));
    key.arms = key
        .arms
        .map(|arm| arms_between(level(arm), up, (2.0 * t - 1.0).max(0.0)));
    key.chest[0] = -4.0 * t;
    key
}

fn sit(puppet: &Puppet, time: f64) -> Key {
    let mut key = stand(puppet);
    let down = smooth(time / 1.4) * smooth((4.0 - time) / 1.4);
    // Leaning is greatest half way.
    let lean = 4.0 * down * (1.0 - down);
    key.hips += DVec3::new(0.0, -0.5, -0.42) * down;
    key.pelvis[0] = 26.0 * lean + 4.0 * down;
    key.chest[0] = 14.0 * lean + 4.0 * down;
    key.head[0] = -20.0 * lean;
    let rest = [DVec3::new(0.45, -1.0, 0.45), DVec3::new(0.1, -0.2, 1.0)];
    key.arms = key.arms.map(|arm| arms_between(arm, rest, down));
    key
}

fn dance(puppet: &Puppet, time: f64) -> Key {
    // Twice to and fro over four seconds; each bar has four steps.
    let way = |s: f64| Spot {
        at: DVec2::new(
            0.12 * (TAU * s / 2.0).sin(),
            0.16 * (1.0 - (TAU * s / 2.0).cos()),
        ),
        heading: 0.35 * (TAU * s / 2.0).sin(),
    };
    let gait = Gait {
        way: &way,
        end: 4.0,
        stride: 0.5,
        duty: 0.6,
        lift: 0.07,
        roll: [25.0, 0.0],
        stance: puppet.stance,
    };
    let swing = Swing {
        drop: 0.05,
        bob: 0.015,
        lean: 2.0,
        twist: 10.0,
        arms: 10.0,
        bend: 30.0,
    };
    let s = gait.end * eased(time, 4.0, 0.5);
    let mut key = step(puppet, &gait, s, &swing);
    let life = smooth(time / 0.6) * smooth((4.0 - time) / 0.6);
    let beat = TAU * s;
    key.pelvis[1] += 6.0 * life * (beat * 2.0).sin();
    key.chest[1] -= 9.0 * life * (beat * 2.0).sin();
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let high = 0.5 + 0.5 * sign * (0.5 * beat).sin();
        let low = [DVec3::new(0.9, -0.6, 0.3), DVec3::new(0.4, 0.1, 1.0)];
        let top = [DVec3::new(0.8, 0.7, 0.25), DVec3::new(0.25, 1.0, 0.35)];
        let arm = arms_between(low, top, smooth(high));
        key.arms[side] = arms_between(key.arms[side], arm, life);
    }
    key
}

fn cartwheel(puppet: &Puppet, time: f64) -> Key {
    let mut key = stand(puppet);
    let open = smooth(time / 0.6) * smooth((3.0 - time) / 0.6);
    let around = smooth((time - 0.45) / 2.1);
    let down = DVec3::new(0.04, -1.0, 0.0);
    let thigh = between(down, DVec3::new(0.75, -1.0, 0.0), open);
    key.legs = [Leg::Free([thigh, thigh - DVec3::new(0.0, 0.0, 0.04)]); 2];
    let up = [DVec3::new(0.5, 1.0, 0.08), DVec3::new(0.4, 1.0, 0.12)];
    key.arms = key.arms.map(|arm| arms_between(arm, up, open));
    key.pelvis = [0.0, 360.0 * around, 0.0];
    key
}

/// Moves each pose so that its lowest point stays where it was: what touches the floor does not
/// slide.
fn roll(puppet: &Puppet, poses: &mut [Pose]) {
    let skins: Vec<Vec<DVec3>> = poses.iter().map(|p| puppet.skin(p)).collect();
    let lowest = |skin: &[DVec3]| {
        let by_height = |a: &usize, b: &usize| skin[*a].y.total_cmp(&skin[*b].y);
        (0..skin.len()).min_by(by_height).expect("a body has skin")
    };
    let mut moved = DVec3::ZERO;
    for i in 1..poses.len() {
        let (before, now) = (&skins[i - 1], &skins[i]);
        let (a, b) = (lowest(before), lowest(now));
        let slid = 0.5 * ((now[a] - before[a]) + (now[b] - before[b]));
        moved -= slid.with_y(0.0);
        poses[i].root += moved;
    }
}

/// Smooths the way of the root over about a tenth of a second: a wheel with five spokes bumps.
/// The ends stay.
fn calm(poses: &mut [Pose], fps: f64) {
    let reach = (0.05 * fps).round() as usize;
    for _ in 0..2 {
        let roots: Vec<DVec3> = poses.iter().map(|p| p.root).collect();
        for i in 0..roots.len() {
            let r = reach.min(i).min(roots.len() - 1 - i);
            let sum: DVec3 = roots[i - r..=i + r].iter().sum();
            poses[i].root = sum / (2 * r + 1) as f64;
        }
    }
}

#[cfg(test)]
mod tests;
