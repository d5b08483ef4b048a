//! Our body in the likeness of characters that are made of our own, so that what must come out is known.

use std::sync::LazyLock;

use glam::{DAffine3, DQuat, DVec3};
use muslin_body::{Avatar, BodyError, Character, Figure, Part, Pose, Shape, Sparse, Twin};
use muslin_geom::Surface;

static AVATAR: LazyLock<Avatar> =
    LazyLock::new(|| Avatar::embedded().expect("the embedded body decodes"));

/// The joints of a plain skeleton, by our bones' names.
const JOINTS: [&str; 17] = [
    "root",
    "spine03",
    "spine01",
    "neck01",
    "head",
    "upperarm01.L",
    "lowerarm01.L",
    "wrist.L",
    "upperarm01.R",
    "lowerarm01.R",
    "wrist.R",
    "upperleg01.L",
    "lowerleg01.L",
    "foot.L",
    "upperleg01.R",
    "lowerleg01.R",
    "foot.R",
];

/// A heavy person with arms spread, on the joints named, as a character.
fn person(kept: &[&str]) -> Character {
    let avatar = &*AVATAR;
    let shape = Shape::default().with("weight", 0.7).expect("a phenotype");
    let figure = avatar.figure(&shape).expect("a figure");
    let mut pose = Pose::rest(avatar);
    for (name, turn) in [("upperarm01.L", 0.6), ("upperarm01.R", -0.6)] {
        let b = avatar.bone(name).expect("an arm");
        pose.rotations[b] = DQuat::from_rotation_z(turn);
    }
    let posed = avatar.pose(&figure, &pose);
    let rig = avatar.rig();
    let joint = |b: usize| {
        let up = std::iter::successors(Some(b), |b| rig.bones[*b].parent);
        let name = |b: usize| kept.iter().position(|k| *k == rig.bones[b].name);
        up.into_iter().find_map(name)
    };
    let bone = |k: usize| avatar.bone(kept[k]).expect("a bone");
    let mut weights = Sparse::new();
    let body = avatar.part(Part::Body);
    for i in body.clone() {
        let mut shares = vec![0.0; kept.len()];
        for (b, w) in rig.weights.row(i) {
            shares[joint(*b as usize).unwrap_or(0)] += w;
        }
        let row = shares.into_iter().enumerate().filter(|w| w.1 > 0.0);
        weights.push(row.map(|(j, w)| (j as u32, w)));
    }
    Character {
        names: kept.iter().map(|n| (*n).to_owned()).collect(),
        parents: (0..kept.len())
            .map(|k| rig.bones[bone(k)].parent.and_then(joint))
            .collect(),
        bound: (0..kept.len())
            .map(|k| {
                let b = bone(k);
                posed.bones[b] * DAffine3::from_translation(figure.joints[b])
            })
            .collect(),
        verts: posed.verts[body].to_vec(),
        faces: avatar.collision_faces().to_vec(),
        weights,
    }
}

fn twin(character: &Character) -> (Twin, Figure) {
    let twin = Twin::new(&AVATAR, &Shape::default(), character).expect("a whole person");
    let figure = twin.avatar.figure(&Shape::default()).expect("a figure");
    (twin, figure)
}

/// The character skinned by the law itself.
fn skinned(character: &Character, joints: &[DAffine3]) -> Vec<DVec3> {
    let place = |(p, row): (&DVec3, &[(u32, f64)])| {
        row.iter()
            .map(|(j, w)| {
                let j = *j as usize;
                (joints[j] * character.bound[j].inverse()).transform_point3(*p) * *w
            })
            .sum()
    };
    character
        .verts
        .iter()
        .zip(character.weights.rows())
        .map(place)
        .collect()
}

#[test]
fn our_skin_lies_over_a_heavy_person_s_in_any_pose_and_its_joints_come_back() {
    let character = person(&JOINTS);
    let (twin, figure) = twin(&character);
    assert!(twin.uncovered < 0.01, "{}", twin.uncovered);
    for stance in ["stand", "walk", "sit"] {
        let pose = Pose::stance(&twin.avatar, &figure, stance).expect("built in");
        let posed = twin.avatar.pose(&figure, &pose);
        let joints = twin.joints(&posed.bones, &[]);
        let verts = twin.posed(&character, &joints, &[]);
        for (a, b) in verts.iter().zip(skinned(&character, &joints)) {
            assert!(a.distance(b) < 1e-9, "{stance}: {a} {b}");
        }
        // Hands and head are not drawn over.
        let skin = Surface::new(&posed.verts, twin.avatar.collision_faces());
        let rows = character.weights.rows();
        let bare = |row: &[(u32, f64)]| {
            let of = |name: &str| JOINTS.iter().position(|j| *j == name);
            let left_out = ["head", "neck01", "wrist.L", "wrist.R", "foot.L", "foot.R"].map(of);
            row.iter().all(|w| !left_out.contains(&Some(w.0 as usize)))
        };
        let away: Vec<f64> = (verts.iter().zip(rows))
            .filter(|(_, row)| bare(row))
            .filter_map(|(p, _)| skin.closest(*p, 0.1).map(|h| h.signed))
            .collect();
        let far = away
            .iter()
            .filter(|d| !(-0.012..0.004).contains(*d))
            .count();
        let share = far as f64 / away.len() as f64;
        assert!(away.len() > 2000 && share < 0.02, "{stance}: {share}");
        // The pose is found again from where the joints are.
        let again = twin.pose_of(&joints);
        let back = twin.joints(&twin.avatar.bones(&figure, &again), &[]);
        for (name, (a, b)) in JOINTS.iter().zip(joints.iter().zip(&back)) {
            let (off, turn) = (
                a.translation.distance(b.translation),
                (a.matrix3.x_axis - b.matrix3.x_axis).length(),
            );
            // Bones between joints turn along with one of them.
            assert!(
                off < 0.01 && turn < 1e-6,
                "{stance} {name}: {off} m, {turn}"
            );
        }
    }
}

#[test]
fn joints_that_move_apart_take_our_bones_along_and_what_leads_none_does_what_it_did() {
    let mut kept = JOINTS.to_vec();
    kept.push("finger3-1.L");
    let character = person(&kept);
    let (twin, figure) = twin(&character);
    // As it was bound nothing is apart, and bones have their heads where joints are.
    let bound = twin.pose_of(twin.stance());
    assert!(bound.shifts.is_empty());
    let bones = twin.avatar.bones(&figure, &bound);
    for (name, joint) in JOINTS.iter().zip(twin.stance()) {
        let b = twin.avatar.bone(name).expect("a bone");
        let off = bones[b]
            .transform_point3(figure.joints[b])
            .distance(joint.translation);
        assert!(off < 1e-6, "{name}: {off}");
    }
    let walk = Pose::stance(&twin.avatar, &figure, "walk").expect("built in");
    let mut joints = twin.joints(&twin.avatar.bones(&figure, &walk), &[]);
    let of = |name: &str| kept.iter().position(|k| *k == name).expect("a joint");
    let apart = DVec3::new(0.04, 0.03, -0.02);
    for name in ["upperarm01.L", "lowerarm01.L", "wrist.L", "finger3-1.L"] {
        joints[of(name)].translation += apart;
    }
    let finger = of("finger3-1.L");
    joints[finger] *= DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, 2.0, 1.0),
        DQuat::from_rotation_x(1.0),
        DVec3::X * 0.01,
    );
    let pose = twin.pose_of(&joints);
    let bones = twin.avatar.bones(&figure, &pose);
    let same = |a: &DAffine3, b: &DAffine3| a.abs_diff_eq(*b, 1e-6);
    let led = twin.joints(&bones, &[]);
    for (j, name) in kept.iter().enumerate() {
        assert_eq!(same(&led[j], &joints[j]), j != finger, "{name}");
    }
    let beyond = twin.beyond(&bones, &joints);
    let whole = twin.joints(&bones, &beyond);
    assert!(whole.iter().zip(&joints).all(|(a, b)| same(a, b)));
    // The skin of the arm goes with it, as far as no other joint holds it.
    let before = twin.avatar.pose(
        &figure,
        &twin.pose_of(&twin.joints(&twin.avatar.bones(&figure, &walk), &[])),
    );
    let after = twin.avatar.pose(&figure, &pose);
    let forearm = twin.avatar.bone("lowerarm01.L").expect("a bone") as u32;
    let only = |row: &[(u32, f64)]| row.iter().all(|w| w.0 == forearm || w.1 < 1e-3);
    let rows = twin.avatar.rig().weights.rows().enumerate();
    let whole = rows.filter(|(v, row)| twin.avatar.part(Part::Body).contains(v) && only(row));
    let off = whole.map(|(v, _)| (after.verts[v] - before.verts[v]).distance(apart));
    let off: Vec<f64> = off.collect();
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(off.len() > 20 && worst < 1e-9, "{} {worst}", off.len());
    // Halfway is halfway, from a pose without any as well.
    let half = twin.pose_of(twin.stance()).toward(
        &Pose {
            beyond,
            ..pose.clone()
        },
        0.5,
    );
    let arm = twin.avatar.bone("upperarm01.L").expect("a bone");
    assert!(half.shifts[arm].distance(0.5 * pose.shifts[arm]) < 1e-12);
    // What is hidden by shrinking it to nothing has a size that can be undone.
    joints[finger].matrix3 = glam::DMat3::ZERO;
    let hidden = twin.joints(&bones, &twin.beyond(&bones, &joints))[finger];
    assert!(hidden.translation.distance(joints[finger].translation) < 1e-6);
    assert!(hidden.inverse().is_finite() && hidden.matrix3.x_axis.length() < 2e-3);
}

#[test]
fn a_character_is_dressed_with_its_arms_clear_of_its_trunk_and_leaves_its_cloth_at_rest() {
    let character = person(&JOINTS);
    let (twin, figure) = twin(&character);
    let (pose, stood) = twin.avatar.dressing(&figure);
    let posed = twin.avatar.pose(&figure, &pose);
    assert_eq!(stood.verts, posed.verts);
    let weights = &twin.avatar.rig().weights;
    let rest = twin.avatar.at_rest(&figure, (weights, &posed.verts));
    // What follows the tights' bones as they do comes back to where they are at rest.
    for i in twin.avatar.part(Part::Tights) {
        assert!(rest[i].distance(figure.verts[i]) < 1e-6, "{i}");
    }
    let own = AVATAR.figure(&Shape::default()).expect("a figure");
    assert_eq!(twin.avatar.standard().expect("ours"), own);
}

#[test]
fn joints_without_names_are_known_by_where_they_are_whichever_way_and_however_large() {
    let named = person(&JOINTS);
    let mut nameless = named.clone();
    nameless.names.iter_mut().for_each(String::clear);
    let away = DAffine3::from_scale_rotation_translation(
        DVec3::splat(100.0),
        DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
        DVec3::new(3.0, 7.0, -2.0),
    );
    nameless
        .verts
        .iter_mut()
        .for_each(|p| *p = away.transform_point3(*p));
    nameless.bound.iter_mut().for_each(|b| *b = away * *b);
    let tall = named.height();
    let ours = nameless.stand(&AVATAR, Some(tall)).expect("a whole person");
    assert!((nameless.height() - tall).abs() < 1e-9);
    let scale = ours.matrix3.determinant().cbrt();
    assert!((scale - 0.01).abs() < 1e-9, "{scale}");
    let mut stood = named.clone();
    stood.stand(&AVATAR, None).expect("a whole person");
    for (a, b) in nameless.verts.iter().zip(&stood.verts) {
        assert!(a.distance(*b) < 1e-6, "{a} {b}");
    }
    let follows = |c: &Character| {
        let twin = Twin::new(&AVATAR, &Shape::default(), c).expect("a whole person");
        twin.follows
    };
    assert_eq!(follows(&nameless), follows(&stood));
}

#[test]
fn what_is_no_person_is_refused_by_name() {
    let legless: Vec<&str> = JOINTS
        .iter()
        .copied()
        .filter(|j| !j.contains("leg"))
        .collect();
    let fault = Twin::new(&AVATAR, &Shape::default(), &person(&legless));
    let fault = fault.expect_err("it has no legs");
    assert!(
        matches!(fault, BodyError::UnknownSkeleton { .. }),
        "{fault}"
    );
    assert!(fault.to_string().contains("left upperleg"), "{fault}");
}
