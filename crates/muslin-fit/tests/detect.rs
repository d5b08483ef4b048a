//! People in real photos, against what MediaPipe finds there.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use muslin_fit::detect::{Found, Models, Person, find_people};
use muslin_geom::Image;
use muslin_io::{PhotoLimits, PoseGraphs, pose_graphs, read_photo};

/// Largest mean distance from the reference's points [px].
const MEAN_PX: f64 = 0.25;
/// Largest mean distance from the reference's places [m].
const MEAN_M: f64 = 6e-3;

fn models() -> Models {
    let PoseGraphs {
        detector,
        landmarks,
    } = pose_graphs().expect("the program is whole");
    Models::new(&detector, &landmarks).expect("the networks are the right ones")
}

/// The shared photos, if the tester has them.
fn photos() -> Option<PathBuf> {
    let data = std::env::var_os("MUSLIN_DATA").map(|d| PathBuf::from(d).join("photos"));
    if data.is_none() {
        println!("skipped: needs MUSLIN_DATA");
    }
    data
}

fn picture(path: &Path) -> Image {
    read_photo(path, &PhotoLimits::default())
        .expect("the photo is whole")
        .image
}

/// The reference follows the person its detector is surest of.
fn surest(found: &Found) -> Option<&Person> {
    found
        .people
        .iter()
        .max_by(|a, b| a.score.total_cmp(&b.score))
}

/// Points [px] and places [m] of a stored line.
fn stored(text: &str) -> (Vec<DVec2>, Vec<DVec3>) {
    let (px, mm) = text.split_once(" | ").expect("a line has two parts");
    let numbers = |s: &str| -> Vec<f64> {
        s.split(' ')
            .map(|w| w.parse().expect("the stored values are numbers"))
            .collect()
    };
    let px = numbers(px)
        .chunks(2)
        .map(|p| DVec2::new(p[0], p[1]))
        .collect();
    let mm = numbers(mm);
    (
        px,
        mm.chunks(3)
            .map(|p| DVec3::new(p[0], -p[1], -p[2]) * 1e-3)
            .collect(),
    )
}

/// Mean distances of a person from a stored line [px, m].
fn distances(person: &Person, line: &str) -> (f64, f64) {
    let (px, m) = stored(line);
    let points = person.keypoints.points.iter().map(|p| p.pixel);
    let off = points.zip(&px).map(|(p, q)| p.distance(*q)).sum::<f64>();
    let world = person.keypoints.world.as_ref().expect("places in space");
    let apart = world
        .iter()
        .zip(&m)
        .map(|(p, q)| p.distance(*q))
        .sum::<f64>();
    (off / 33.0, apart / 33.0)
}

#[test]
fn points_agree_with_the_reference_on_every_photo() {
    let Some(folder) = photos() else { return };
    let models = models();
    let mut far = Vec::new();
    for line in include_str!("golden/photos.txt")
        .lines()
        .filter(|l| !l.starts_with('#'))
    {
        let (name, rest) = line.split_once(' ').expect("a line has a name");
        let found = find_people(&models, &picture(&folder.join(name)));
        if rest == "nobody" {
            continue;
        }
        let person = surest(&found).unwrap_or_else(|| panic!("{name}: nobody found"));
        let (px, m) = distances(person, rest);
        println!(
            "{name}: {px:.3} px, {:.2} mm, people {}",
            m * 1e3,
            found.people.len()
        );
        if px > MEAN_PX || m > MEAN_M {
            far.push(format!("{name}: {px:.3} px, {:.2} mm", m * 1e3));
        }
    }
    assert!(far.is_empty(), "{far:#?}");
}

#[test]
fn garments_alone_are_nobody() {
    let Some(folder) = photos() else { return };
    let path = folder.join("garment-flats/openvto_pants_1_front.jpg");
    let found = find_people(&models(), &picture(&path));
    assert!(found.people.is_empty(), "{found:?}");
    assert!(found.best_score < 1.0);
}

#[test]
fn two_people_side_by_side_are_both_found() {
    let Some(folder) = photos() else { return };
    let [a, b] = [
        "sports2d_woman_walk_f080.jpg",
        "sports2d_woman_walk_f140.jpg",
    ]
    .map(|name| picture(&folder.join(name)));
    let found = find_people(&models(), &side_by_side(&a, &b));
    assert_eq!(found.people.len(), 2);
    let sides = [0, 1].map(|i| found.people[i].square.side);
    assert!(sides[0] >= sides[1], "the largest first");
    let seam = a.width as f64;
    let on_left = found
        .people
        .iter()
        .filter(|p| p.square.centre.x < seam)
        .count();
    assert_eq!(on_left, 1);
}

fn side_by_side(a: &Image, b: &Image) -> Image {
    let mut both = Image::filled(
        a.width + b.width,
        a.height.max(b.height),
        [128, 128, 128, 255],
    );
    for (from, image) in [(0, a), (a.width, b)] {
        for (y, row) in image.pixels.chunks(image.width).enumerate() {
            both.pixels[y * both.width + from..][..row.len()].copy_from_slice(row);
        }
    }
    both
}

#[test]
fn an_empty_or_plain_picture_is_nobody() {
    let models = models();
    for image in [
        Image::default(),
        Image::filled(1, 1, [9; 4]),
        Image::filled(300, 20, [200; 4]),
    ] {
        let found = find_people(&models, &image);
        assert!(
            found.people.is_empty() && (0.0..0.5).contains(&found.best_score),
            "{found:?}"
        );
    }
}

#[test]
fn networks_for_something_else_are_refused() {
    let PoseGraphs {
        detector,
        landmarks,
    } = pose_graphs().expect("the program is whole");
    let err = Models::new(&landmarks, &landmarks)
        .err()
        .expect("one is no detector");
    assert!(
        err.to_string().contains("the detector network maps"),
        "{err}"
    );
    assert!(Models::new(&detector, &detector).is_err());
}

#[test]
fn somebody_small_in_a_long_picture_and_four_in_a_row_are_found() {
    let Some(folder) = photos() else { return };
    let models = models();
    let one = picture(&folder.join("openvto_person1.jpg"));
    let wall = Image::filled(one.height, one.height, [150, 150, 150, 255]);
    let alone = find_people(&models, &one);
    let pair = side_by_side(&one, &one);
    let far = side_by_side(&side_by_side(&wall, &one), &wall);
    let far = find_people(&models, &far);
    assert_eq!((alone.people.len(), far.people.len()), (1, 1));
    let points = |f: &Found| f.people[0].keypoints.points.clone();
    let pairs = points(&alone).into_iter().zip(points(&far));
    let moved = DVec2::new(wall.width as f64, 0.0);
    let off = pairs.map(|(a, b)| (a.pixel + moved).distance(b.pixel));
    let off = off.sum::<f64>() / 33.0;
    assert!(off < 0.02 * one.height as f64, "{off} px");
    let four = find_people(&models, &side_by_side(&pair, &pair));
    assert_eq!(four.people.len(), 4);
    // Nobody is found twice, and nothing else is somebody.
    let tall = picture(&folder.join("sports2d_man_f040.jpg"));
    assert!(tall.height as f64 > 1.5 * tall.width as f64);
    assert_eq!(find_people(&models, &tall).people.len(), 1);
}
