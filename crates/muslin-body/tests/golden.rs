//! People whose vertices the original files place: `cargo xtask check body --bless` writes them.

use glam::{DQuat, DVec3};
use muslin_body::{Avatar, Pose, Shape};

/// What a vertex may be off at worst, and all of them in the mean square [m].
const ALLOWED: [f64; 2] = [1.2e-3, 0.06e-3];

#[test]
fn people_are_where_the_original_files_place_them() {
    let avatar = Avatar::embedded().expect("the embedded avatar is whole");
    let people = include_str!("golden/people.txt").split("person\n").skip(1);
    let mut off = Vec::new();
    for person in people {
        off.extend(distances(&avatar, person));
    }
    let rms = (off.iter().map(|d| d * d).sum::<f64>() / off.len() as f64).sqrt();
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(off.len() > 90, "{} vertices", off.len());
    assert!(
        worst < ALLOWED[0] && rms < ALLOWED[1],
        "worst {worst:e} m, RMS {rms:e} m"
    );
}

/// How far the listed vertices of one person are off [m].
fn distances(avatar: &Avatar, person: &str) -> Vec<f64> {
    let (mut shape, mut pose) = (Shape::default(), Pose::rest(avatar));
    let mut wanted = Vec::new();
    for line in person.lines() {
        let (kind, rest) = line.split_once(' ').expect("a kind and what follows");
        let (name, numbers) = rest.split_once(' ').expect("a name and numbers");
        let n: Vec<f64> = numbers
            .split(' ')
            .map(|w| w.parse().expect("a number"))
            .collect();
        match kind {
            "phenotype" => shape = shape.with(name, n[0]).expect("in range"),
            "slider" => shape = shape.with_local(name, n[0]),
            "root" => pose.root = DVec3::new(name.parse().expect("a number"), n[0], n[1]),
            "turn" => {
                let bone = avatar.bone(name).expect("a bone");
                pose.rotations[bone] = DQuat::from_xyzw(n[0], n[1], n[2], n[3]);
            }
            _ => wanted.push((
                name.parse::<usize>().expect("an index"),
                DVec3::from_slice(&n),
            )),
        }
    }
    let posed = avatar.pose(&avatar.figure(&shape).expect("a figure"), &pose);
    wanted
        .into_iter()
        .map(|(i, at)| posed.verts[i].distance(at))
        .collect()
}
