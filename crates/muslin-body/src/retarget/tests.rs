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
