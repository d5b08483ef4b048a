use super::*;
use crate::Shape;

#[test]
fn names_of_all_schools_are_understood() {
    let part = |n: &str| {
        let (side, name) = super::part(n);
        (side.map(|s| ["left", "right"][s]), name)
    };
    assert_eq!(part("Neo_LeftUpLeg"), (Some("left"), "upleg".into()));
    assert_eq!(
        part("mixamorig:RightForeArm"),
        (Some("right"), "forearm".into())
    );
    assert_eq!(part("lShldr"), (Some("left"), "shldr".into()));
    assert_eq!(part("upper_arm.R"), (Some("right"), "upperarm".into()));
    assert_eq!(part("UpperLeg_L"), (Some("left"), "upperleg".into()));
    assert_eq!(part("LowerBack"), (None, "lowerback".into()));
    assert_eq!(part("rightEye").1, "eye");
    assert_eq!(part("LHipJoint"), (Some("left"), "hipjoint".into()));
}

/// A stick figure in a T-pose, in centimetres.
fn stick() -> Skeleton {
    let mut s = Skeleton::default();
    let mut add = |name: &str, parent: Option<usize>, at: [f64; 3]| {
        s.names.push(name.into());
        s.parents.push(parent);
        s.offsets.push(DVec3::from(at));
        s.ends.push(None);
        s.names.len() - 1
    };
    let hips = add("Hips", None, [0.0, 90.0, 0.0]);
    for (side, x) in [("Left", 1.0), ("Right", -1.0)] {
        let thigh = add(&format!("{side}UpLeg"), Some(hips), [10.0 * x, 0.0, 0.0]);
        let shin = add(&format!("{side}Leg"), Some(thigh), [0.0, -42.0, 0.0]);
        let foot = add(&format!("{side}Foot"), Some(shin), [0.0, -42.0, 0.0]);
        add(&format!("{side}ToeBase"), Some(foot), [0.0, -5.0, 15.0]);
        let arm = add(&format!("{side}Arm"), Some(hips), [18.0 * x, 50.0, 0.0]);
        let fore = add(&format!("{side}ForeArm"), Some(arm), [28.0 * x, 0.0, 0.0]);
        add(&format!("{side}Hand"), Some(fore), [25.0 * x, 0.0, 0.0]);
    }
    s
}

fn posed(edit: impl Fn(&Skeleton, &mut Frame)) -> (Avatar, Figure, Pose) {
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let skeleton = stick();
    let n = skeleton.names.len();
    let mut frame = Frame {
        translations: skeleton.offsets.clone(),
        rotations: vec![DQuat::IDENTITY; n],
    };
    edit(&skeleton, &mut frame);
    let recording = Recording {
        skeleton,
        fps: 30.0,
        frames: vec![frame],
    };
    let pose = retarget(&avatar, &figure, &recording, 0).expect("a human");
    (avatar, figure, pose)
}

fn direction(setup: &(Avatar, Figure, Pose), from: &str, to: &str) -> DVec3 {
    let (avatar, figure, pose) = setup;
    let bones = avatar.pose(figure, pose).bones;
    let at = |name: &str| {
        let b = avatar.bone(name).expect("a bone");
        bones[b].transform_point3(figure.joints[b])
    };
    (at(to) - at(from)).normalize()
}

#[test]
fn limbs_point_where_the_recorded_ones_do() {
    let knee = DQuat::from_rotation_x(1.0);
    let setup = posed(|s, f| {
        let at = |n: &str| s.names.iter().position(|m| m == n).expect("a joint");
        f.rotations[at("LeftLeg")] = knee;
        f.rotations[at("RightForeArm")] = DQuat::from_rotation_y(0.9);
    });
    let off = |from, to, want: DVec3| direction(&setup, from, to).angle_between(want);
    assert!(off("upperarm01.L", "lowerarm01.L", DVec3::X) < 1e-6);
    assert!(off("lowerleg01.L", "foot.L", knee * DVec3::NEG_Y) < 1e-6);
    assert!(off("upperleg01.R", "lowerleg01.R", DVec3::NEG_Y) < 1e-6);
    assert!(
        off(
            "lowerarm01.R",
            "wrist.R",
            DQuat::from_rotation_y(0.9) * DVec3::NEG_X
        ) < 1e-6
    );
}

/// The stick's left arm raised by so much out of the T-pose [rad].
fn raised(by: f64) -> (Avatar, Figure, Pose) {
    posed(|s, f| {
        let arm = s.names.iter().position(|m| m == "LeftArm");
        f.rotations[arm.expect("an arm")] = DQuat::from_rotation_z(by);
    })
}

#[test]
fn an_arm_overhead_takes_the_shoulder_along_and_points_where_it_did() {
    let setup = raised(1.5);
    let (avatar, figure, pose) = &setup;
    let want = DQuat::from_rotation_z(1.5) * DVec3::X;
    assert!(direction(&setup, "upperarm01.L", "lowerarm01.L").angle_between(want) < 1e-6);
    let turn = |pose: &Pose, name: &str| {
        let b = avatar.bone(name).expect("a bone");
        pose.rotations[b].angle_between(DQuat::IDENTITY)
    };
    let inner = turn(pose, "clavicle.L");
    let outer = turn(pose, "shoulder01.L");
    assert!(
        0.05 < inner && inner < outer && outer < 0.5,
        "{inner} {outer}"
    );
    assert_eq!(turn(pose, "clavicle.R"), 0.0);
    // All of it in the arm, skin folds over the collarbone.
    let mut alone = pose.clone();
    let [a, b, arm] = ["clavicle.L", "shoulder01.L", "upperarm01.L"]
        .map(|name| avatar.bone(name).expect("a bone"));
    alone.rotations[arm] = pose.rotations[a] * pose.rotations[b] * pose.rotations[arm];
    (alone.rotations[a], alone.rotations[b]) = (DQuat::IDENTITY, DQuat::IDENTITY);
    let crossings = |pose: &Pose| {
        let skin = avatar.part(crate::Part::Body);
        let posed = avatar.pose(figure, pose);
        let shoulder = posed.bones[arm].transform_point3(figure.joints[arm]);
        let mesh = muslin_geom::Mesh {
            verts: posed.verts[skin].to_vec(),
            faces: avatar.collision_faces().to_vec(),
        };
        let corner = |f: u32| mesh.verts[mesh.faces[f as usize][0] as usize];
        let pairs = muslin_geom::self_intersections(&mesh);
        let near = pairs
            .iter()
            .filter(|p| corner(p[0]).distance(shoulder) < 0.2);
        near.count()
    };
    let (with, without) = (crossings(pose), crossings(&alone));
    assert!(2 * with < without, "{with} with, {without} without");
}

#[test]
fn a_shoulder_never_jumps_as_an_arm_goes_up_and_on_across_the_head() {
    let poses: Vec<_> = (0..60).map(|k| raised(0.05 * f64::from(k))).collect();
    for (bone, most) in [("clavicle.L", 1.5), ("shoulder01.L", 2.0)] {
        let turn = |(avatar, _, pose): &(Avatar, _, Pose)| -> DQuat {
            pose.rotations[avatar.bone(bone).expect("a bone")]
        };
        let turns: Vec<DQuat> = poses.iter().map(turn).collect();
        assert_eq!(turns[0], DQuat::IDENTITY);
        assert_ne!(turns[25], DQuat::IDENTITY);
        for pair in turns.windows(2) {
            let step = pair[0].angle_between(pair[1]);
            assert!(step < most * 0.05, "{bone}: {step}");
        }
    }
}

#[test]
fn a_standing_figure_stands_on_our_floor() {
    let (avatar, figure, pose) = posed(|_, _| {});
    let low = |verts: &[DVec3]| verts.iter().map(|v| v.y).fold(f64::MAX, f64::min);
    let body = avatar.part(crate::Part::Body);
    let rest = low(&figure.verts[body.clone()]);
    let now = low(&avatar.pose(&figure, &pose).verts[body]);
    assert!((rest - now).abs() < 0.03, "{rest} {now}");
}

#[test]
fn a_skeleton_without_arms_is_refused_by_name() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let mut skeleton = stick();
    for name in &mut skeleton.names {
        *name = name.replace("RightForeArm", "tentacle");
    }
    let recording = Recording {
        skeleton,
        fps: 30.0,
        frames: Vec::new(),
    };
    let error = retarget(&avatar, &figure, &recording, 0).expect_err("no right elbow");
    assert!(error.to_string().contains("right lowerarm"), "{error}");
}

/// Somebody who stands still at nine places, a third of a second each, on a floor that rises by `slope` [m/m] along z.
fn walk(skeleton: &Skeleton, slope: f64) -> Recording {
    let stand = |k: usize| {
        let mut frame = Frame {
            translations: skeleton.offsets.clone(),
            rotations: vec![DQuat::IDENTITY; skeleton.names.len()],
        };
        let ahead = 50.0 * (k / 10) as f64;
        frame.translations[0] += DVec3::new(0.0, slope * ahead, ahead);
        frame
    };
    Recording {
        skeleton: skeleton.clone(),
        fps: 30.0,
        frames: (0..90).map(stand).collect(),
    }
}

/// Heights of the soles along a recording [m], the rest pose's first.
fn soles(recording: &Recording) -> Vec<f64> {
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let motion = retarget_all(&avatar, &figure, recording).expect("a human");
    let low = |verts: &[DVec3]| {
        let body = &verts[avatar.part(crate::Part::Body)];
        body.iter().map(|v| v.y).fold(f64::MAX, f64::min)
    };
    let poses = motion.poses.iter().step_by(10);
    let heights = poses.map(|pose| low(&avatar.pose(&figure, pose).verts));
    std::iter::once(low(&figure.verts)).chain(heights).collect()
}

/// How far some heights are from the first of all.
fn off(heights: &[f64], of: impl Iterator<Item = usize>) -> f64 {
    of.map(|k| (heights[k] - heights[0]).abs())
        .fold(0.0, f64::max)
}

#[test]
fn a_floor_that_slopes_is_levelled_and_a_hill_is_not() {
    let flat = soles(&walk(&stick(), 0.0));
    let sloped = soles(&walk(&stick(), 0.02));
    assert!(off(&flat, 1..10) < 0.006, "{flat:?}");
    // Eight centimetres in four metres; feet stand too near each other to take all of it out.
    assert!(off(&sloped, 1..10) < 0.012, "{sloped:?}");
    let hill = soles(&walk(&stick(), 0.2));
    assert!(hill[9] - hill[1] > 0.5, "{hill:?}");
}

#[test]
fn feet_that_stand_are_flat_however_their_skeleton_is_built() {
    let mut steep = stick();
    for (name, at) in steep.names.iter().zip(&mut steep.offsets) {
        if name.ends_with("ToeBase") {
            *at = DVec3::new(0.0, -12.0, 12.0);
        }
    }
    let heights = soles(&walk(&steep, 0.0));
    assert!(off(&heights, 1..10) < 0.006, "{heights:?}");
    // Feet too short to point anywhere, but all bones lie along their own y.
    let mut along = stick();
    let names = along.names.clone();
    let ends = |name: &str, all: &[&str]| all.iter().any(|e| name.ends_with(e));
    for (name, at) in names.iter().zip(&mut along.offsets) {
        if ends(name, &["Leg", "Foot", "Arm", "Hand"]) && !ends(name, &["UpLeg", "tArm"]) {
            *at = DVec3::Y * at.length();
        }
    }
    let keep: Vec<usize> = (0..names.len())
        .filter(|&j| !names[j].ends_with("ToeBase"))
        .collect();
    let moved = |p: usize| {
        keep.iter()
            .position(|&j| j == p)
            .expect("no toe is a parent")
    };
    let along = Skeleton {
        names: keep.iter().map(|&j| names[j].clone()).collect(),
        parents: keep.iter().map(|&j| along.parents[j].map(moved)).collect(),
        offsets: keep.iter().map(|&j| along.offsets[j]).collect(),
        ends: vec![None; keep.len()],
    };
    let mut recording = walk(&along, 0.0);
    for frame in &mut recording.frames {
        for (name, turn) in along.names.iter().zip(&mut frame.rotations) {
            let down = DQuat::from_rotation_arc(DVec3::Y, DVec3::NEG_Y);
            match name.as_str() {
                "LeftUpLeg" | "RightUpLeg" => *turn = down,
                // From down along the shin to ahead and a little down, in the shin's frame.
                "LeftFoot" | "RightFoot" => {
                    let foot = DVec3::new(0.0, -0.5, 0.87);
                    *turn = DQuat::from_rotation_arc(DVec3::Y, down.inverse() * foot);
                }
                "LeftArm" => *turn = DQuat::from_rotation_arc(DVec3::Y, DVec3::X),
                "RightArm" => *turn = DQuat::from_rotation_arc(DVec3::Y, DVec3::NEG_X),
                _ => {}
            }
        }
    }
    let heights = soles(&recording);
    assert!(off(&heights, 1..10) < 0.006, "{heights:?}");
}

#[test]
fn toes_stay_above_the_floor_where_a_heel_comes_up_and_a_foot_in_the_air_points_as_recorded() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let figure = avatar.figure(&Shape::default()).expect("an adult");
    let mut recording = walk(&stick(), 0.0);
    let names = recording.skeleton.names.clone();
    let at = |n: &str| names.iter().position(|m| m == n).expect("a joint");
    let frames = recording.frames.len();
    // The last two moments: the left heel comes up by 29 degrees, on the floor and then in the air.
    for (k, frame) in recording.frames[frames - 2..].iter_mut().enumerate() {
        frame.rotations[at("LeftFoot")] = DQuat::from_rotation_x(0.5);
        frame.translations[0].y += 40.0 * k as f64;
    }
    let motion = retarget_all(&avatar, &figure, &recording).expect("a human");
    let low = |verts: &[DVec3]| {
        let body = &verts[avatar.part(crate::Part::Body)];
        body.iter().map(|v| v.y).fold(f64::MAX, f64::min)
    };
    let rest = low(&figure.verts);
    let dip = rest - low(&avatar.pose(&figure, &motion.poses[frames - 2]).verts);
    assert!((0.001..0.012).contains(&dip), "{dip}");
    let foot = avatar.bone("foot.L").expect("a bone");
    let turned = |f: usize| motion.poses[f].rotations[foot].angle_between(DQuat::IDENTITY);
    assert!(turned(frames - 1) > 0.45, "{}", turned(frames - 1));
    assert!(turned(frames - 2) < 0.25, "{}", turned(frames - 2));
}
