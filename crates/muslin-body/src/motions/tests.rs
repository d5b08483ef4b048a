use super::*;
use crate::{Part, Shape};
use muslin_geom::Surface;

fn figure(avatar: &Avatar, gender: f64, weight: f64) -> Figure {
    let shape = Shape::default().with("gender", gender).expect("known");
    let shape = shape.with("weight", weight).expect("known");
    avatar.figure(&shape).expect("an adult")
}

fn avatar() -> Avatar {
    Avatar::embedded().expect("the embedded body decodes")
}

fn low(verts: &[DVec3]) -> f64 {
    verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min)
}

#[test]
fn every_motion_is_sound_smooth_and_on_the_floor_on_slim_and_stout_figures() {
    let avatar = avatar();
    for (gender, weight) in [(0.0, 0.2), (1.0, 0.8)] {
        let figure = figure(&avatar, gender, weight);
        let floor = low(&figure.verts[avatar.part(Part::Body)]);
        for name in NAMES {
            let motion = make(&avatar, &figure, name, 60.0).expect("a known motion");
            assert!(motion.is_sound(), "{name}");
            let turn = motion.largest_turn();
            assert!(turn < 0.35, "{name} turns a joint by {turn} in a frame");
            let steps = motion.poses.windows(2);
            let far = steps
                .map(|p| p[0].root.distance(p[1].root))
                .fold(0.0, f64::max);
            assert!(far < 0.12, "{name} moves by {far} m in a frame");
            for (i, pose) in motion.poses.iter().enumerate().step_by(9) {
                let skin = &avatar.pose(&figure, pose).verts[avatar.part(Part::Body)];
                let height = low(skin) - floor;
                let most = if name == "run" {
                    0.09
                } else if name == "cartwheel" {
                    0.08
                } else {
                    1e-6
                };
                assert!(
                    (-0.08..=most).contains(&height),
                    "{name} {i} hovers at {height} m"
                );
                assert!(
                    name == "cartwheel" || height > -1e-6,
                    "{name} {i} sinks {height} m"
                );
            }
        }
    }
}

#[test]
fn feet_do_not_slide_in_a_walk() {
    let avatar = avatar();
    let figure = figure(&avatar, 0.5, 0.5);
    let motion = make(&avatar, &figure, "walk", 60.0).expect("a known motion");
    let balls = ["toe3-1.L", "toe3-1.R"].map(|b| avatar.bone(b).expect("a bone"));
    let places: Vec<[DVec3; 2]> = motion
        .poses
        .iter()
        .map(|p| {
            let bones = avatar.pose(&figure, p).bones;
            balls.map(|b| bones[b].transform_point3(figure.joints[b]))
        })
        .collect();
    let flat = figure.joints[balls[0]].y + 0.004;
    for (i, pair) in places.windows(2).enumerate() {
        for side in (0..2).filter(|&s| pair[0][s].y.max(pair[1][s].y) < flat) {
            let slid = (pair[1][side] - pair[0][side]).with_y(0.0).length();
            assert!(slid < 0.012, "a foot slides {slid} m in frame {i}");
        }
    }
    let far = (motion.poses.last().expect("poses").root - motion.poses[0].root).length();
    assert!((3.5..5.5).contains(&far), "walked {far} m");
}

/// Share of the forearms' and hands' vertices that are closer to trunk or legs than half a centimetre.
fn touching(avatar: &Avatar, figure: &Figure, pose: &Pose) -> f64 {
    let rig = avatar.rig();
    let fore = ["lowerarm01.L", "lowerarm01.R"].map(|b| rig.bone(b).expect("a bone"));
    let arms = ["shoulder01.L", "shoulder01.R"].map(|b| rig.bone(b).expect("a bone"));
    let share = |v: usize, roots: [usize; 2]| -> f64 {
        let row = rig.weights.row(v).iter();
        let on = row.filter(|(b, _)| roots.iter().any(|&r| rig.descends(*b as usize, r)));
        on.map(|w| w.1).sum()
    };
    let verts = avatar.pose(figure, pose).verts;
    let off_arm = |f: &&[u32; 3]| f.iter().all(|&i| share(i as usize, arms) < 0.05);
    let faces: Vec<[u32; 3]> = avatar
        .collision_faces()
        .iter()
        .filter(off_arm)
        .copied()
        .collect();
    let trunk = Surface::new(&verts, &faces);
    let hands: Vec<usize> = avatar
        .part(Part::Body)
        .filter(|&v| share(v, fore) > 0.95)
        .step_by(7)
        .collect();
    let near = |&&v: &&usize| {
        trunk
            .closest(verts[v], 0.25)
            .is_some_and(|c| c.signed < 0.005)
    };
    hands.iter().filter(near).count() as f64 / hands.len() as f64
}

#[test]
fn arms_stay_clear_of_trunk_and_legs() {
    let avatar = avatar();
    for (gender, weight) in [(0.0, 0.5), (1.0, 0.9)] {
        let figure = figure(&avatar, gender, weight);
        for name in NAMES {
            let motion = make(&avatar, &figure, name, 10.0).expect("a known motion");
            for (i, pose) in motion.poses.iter().enumerate().step_by(2) {
                let touching = touching(&avatar, &figure, pose);
                assert!(
                    touching == 0.0,
                    "{name} {i}: {touching} of the forearm touches"
                );
            }
        }
    }
}

#[test]
fn motions_on_the_spot_end_as_they_began() {
    let avatar = avatar();
    let figure = figure(&avatar, 0.5, 0.5);
    for name in ["wave", "squat", "arms-up", "sit"] {
        let motion = make(&avatar, &figure, name, 30.0).expect("a known motion");
        let (first, last) = (&motion.poses[0], motion.poses.last().expect("poses"));
        assert!(first.root.distance(last.root) < 1e-9, "{name}");
        let pairs = first.rotations.iter().zip(&last.rotations);
        assert!(
            pairs.map(|(a, b)| a.dot(*b).abs()).all(|c| c > 1.0 - 1e-9),
            "{name}"
        );
    }
}

#[test]
fn an_unknown_motion_names_all_there_are() {
    let avatar = avatar();
    let figure = figure(&avatar, 0.5, 0.5);
    let fault = make(&avatar, &figure, "wlak", 30.0).unwrap_err();
    assert!(fault.to_string().contains("cartwheel"), "{fault}");
}
