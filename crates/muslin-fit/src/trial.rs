//! Made-up people with exact keypoints, and the promises that the solver keeps on them.

use crate::descend::{Patience, descend};
use crate::evidence::Evidence;
use crate::figure::{Free, Shapes};
use crate::fold::{KNUCKLES, N_MARKERS};
use crate::guess::{Guess, Placed, view};
use crate::joint::rotation_vector;
use crate::problem::{Problem, Trust};
use crate::solve::{FitOptions, Fitter};
use crate::start::Start;
use glam::{DAffine3, DQuat, DVec2, DVec3};
use muslin_body::{Avatar, COCO17, Keypoint, Keypoints, Layout, Pose, Shape};

/// Numbers that look random and are the same everywhere (SplitMix64).
struct Chance(u64);

impl Chance {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A person, where the camera sees them from.
struct Person {
    shape: Shape,
    pose: Pose,
    focal: f64,
}

const SIZE: [u32; 2] = [1200, 1600];

/// A random body in a random stance, a few metres before the camera.
fn person(fitter: &Fitter, avatar: &Avatar, seed: u64) -> Person {
    let mut chance = Chance(seed);
    let mut shape = Shape::default();
    for p in &mut shape.phenotypes[..6] {
        *p = chance.between(0.15, 0.85);
    }
    shape.phenotypes[1] = chance.between(0.7, 0.95);
    let mut pose = Pose::rest(avatar);
    for joint in &fitter.folded().joints {
        if let Some(habit) = fitter.habits()[joint.group] {
            let same = &mut Chance(seed ^ (joint.group as u64 * 7919 + 13));
            let draw = DVec3::from_array(std::array::from_fn(|_| same.between(-1.2, 1.2)));
            let phi = (habit.mean + habit.spread * draw).clamp(habit.range[0], habit.range[1]);
            pose.rotations[joint.bone] = DQuat::from_scaled_axis(habit.axes * phi);
        }
    }
    let turn = DQuat::from_rotation_y(chance.between(-3.1, 3.1));
    pose.rotations[0] = turn * DQuat::from_rotation_x(chance.between(-0.3, 0.4));
    pose.root = DVec3::new(
        chance.between(-0.4, 0.4),
        chance.between(-0.3, 0.3),
        -chance.between(3.0, 5.0),
    );
    Person {
        shape,
        pose,
        focal: chance.between(1400.0, 2400.0),
    }
}

impl Person {
    /// All markers in the camera's frame, by way of the whole mesh.
    fn markers(&self, avatar: &Avatar) -> Vec<DVec3> {
        let figure = avatar.figure(&self.shape).expect("an adult");
        let posed = avatar.pose(&figure, &self.pose);
        let regressed = avatar.regressors().rows().map(|row| {
            row.iter()
                .map(|&(v, w)| w * posed.verts[v as usize])
                .sum::<DVec3>()
        });
        let knuckle = |name: &&str| {
            let bone = avatar.bone(name).expect("a knuckle");
            posed.bones[bone].transform_point3(figure.joints[bone])
        };
        regressed.chain(KNUCKLES.iter().map(knuckle)).collect()
    }

    /// All markers in the camera's frame, by way of the folded body.
    fn folded_markers(&self, fitter: &Fitter, avatar: &Avatar) -> Vec<DVec3> {
        let folded = fitter.folded();
        let shapes = Shapes::new(avatar, folded, &self.shape, &[]).expect("a shape");
        let features = shapes.features(&[]);
        let mut turns = vec![DQuat::IDENTITY; folded.groups.len()];
        folded
            .joints
            .iter()
            .for_each(|j| turns[j.group] = self.pose.rotations[j.bone]);
        let root = features[0] + self.pose.root;
        let guess = Guess {
            root,
            turns,
            log_focal: 0.0,
            origin: DVec3::ZERO,
            log_scale: 0.0,
            shape: vec![],
        };
        Placed::new(folded, &features, &guess).markers
    }

    /// Exact keypoints as BlazePose would number them.
    fn keypoints(&self, avatar: &Avatar, depth: bool) -> Keypoints {
        self.keypoints_at(&self.markers(avatar), depth)
    }

    fn keypoints_at(&self, markers: &[DVec3], depth: bool) -> Keypoints {
        let hips = 0.5 * (markers[11] + markers[12]);
        let layout = Layout::BlazePose33;
        let marker = |i: usize| match layout.regressed(i) {
            Some([a, _]) => Some(a),
            None => (17..=22).contains(&i).then(|| 23 + i - 17),
        };
        let centre = 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
        let point = |i: usize| match marker(i) {
            Some(k) => {
                let pixel = view(markers[k], self.focal).0 * DVec2::new(1.0, -1.0) + centre;
                Keypoint { pixel, score: 1.0 }
            }
            None => Keypoint {
                pixel: centre,
                score: 0.0,
            },
        };
        let world = |i: usize| marker(i).map_or(DVec3::ZERO, |k| markers[k] - hips);
        Keypoints {
            layout,
            points: (0..33).map(point).collect(),
            world: depth.then(|| (0..33).map(world).collect()),
            image_size: SIZE,
        }
    }

    /// Directions of the long bones: upper arms, forearms, thighs, shins, trunk.
    fn directions(&self, avatar: &Avatar) -> Vec<DVec3> {
        let figure = avatar.figure(&self.shape).expect("an adult");
        let posed = avatar.pose(&figure, &self.pose);
        let at = |name: &str| {
            let b = avatar.bone(name).expect("a bone");
            posed.bones[b].transform_point3(figure.joints[b])
        };
        let middle = |n: &str| 0.5 * (at(&format!("{n}.L")) + at(&format!("{n}.R")));
        let mut all = vec![middle("upperarm01") - middle("upperleg01")];
        for side in ["L", "R"] {
            let at = |name: &str| at(&format!("{name}.{side}"));
            all.push(at("lowerarm01") - at("upperarm01"));
            all.push(at("wrist") - at("lowerarm01"));
            all.push(at("lowerleg01") - at("upperleg01"));
            all.push(at("foot") - at("lowerleg01"));
        }
        all.into_iter().map(DVec3::normalize).collect()
    }
}

/// The phenotypes that change a skeleton most; the others keep their expected values.
const BUILD: [(&str, f64); 6] = [
    ("gender", 1.0),
    ("age", 1.0),
    ("muscle", 1.0),
    ("weight", 1.0),
    ("height", 1.0),
    ("proportions", 1.0),
];

fn exact() -> Trust {
    Trust {
        pixel: 0.002,
        world: [0.01, 0.01],
        doubt: None,
        priors: false,
        focal: (1800.0, 1.0),
        scale: 1e-4,
        height: None,
        slopes_hold: 0.0,
    }
}

#[test]
fn folding_is_exact() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    for seed in 0..4 {
        let person = person(&fitter, &avatar, seed);
        let got = person.folded_markers(&fitter, &avatar);
        let want = person.markers(&avatar);
        let off = got
            .iter()
            .zip(&want)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        // The modes are summed in single precision over the whole mesh, in double here.
        assert!(got.len() == N_MARKERS && off < 2e-6, "seed {seed}: {off} m");
    }
}

#[test]
fn every_slope_is_what_finite_differences_say() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    let free = [
        ("height", 0.5),
        ("gender", 0.5),
        ("measure-upperleg-height", 0.3),
        ("measure-shoulder-dist", 0.3),
    ];
    for seed in 0..3 {
        let evidence = Evidence::new(&person(&fitter, &avatar, seed).keypoints(&avatar, true));
        let base = Shape::default().with_local("measure-shoulder-dist", -0.2);
        let free = Free::list(&avatar, fitter.folded(), &free).expect("sliders");
        let shapes = Shapes::new(&avatar, fitter.folded(), &base, &free).expect("sliders");
        let trust = Trust {
            priors: true,
            height: Some(1.7),
            ..exact()
        };
        let problem = Problem {
            folded: fitter.folded(),
            shapes,
            evidence: &evidence,
            habits: fitter.habits(),
            trust,
        };
        // Another person's stance: residuals are large and joints are beyond their ranges.
        let mut guess = stance(&fitter, &person(&fitter, &avatar, seed + 50));
        guess.shape = vec![0.4, 0.6, 0.1, -0.1];
        guess.turns.iter_mut().skip(1).for_each(|q| *q = *q * *q);
        let (n, slopes) = dense(&problem, &guess);
        for k in 0..n {
            let step = |h: f64| {
                let mut d = vec![0.0; n];
                d[k] = h;
                residuals(&problem, &guess.step(&problem.columns(), &d))
            };
            let (a, b) = (step(1e-6), step(-1e-6));
            assert_eq!(a.len(), slopes.len());
            for (row, slope) in slopes.iter().enumerate() {
                let fd = (a[row] - b[row]) / 2e-6;
                let scale = 1.0 + fd.abs().max(slope[k].abs());
                assert!(
                    (fd - slope[k]).abs() < 2e-5 * scale,
                    "row {row} column {k}: {fd} {}",
                    slope[k]
                );
            }
        }
    }
}

fn stance(fitter: &Fitter, person: &Person) -> Guess {
    let mut turns = vec![DQuat::IDENTITY; fitter.folded().groups.len()];
    fitter
        .folded()
        .joints
        .iter()
        .for_each(|j| turns[j.group] = person.pose.rotations[j.bone]);
    let log_focal = person.focal.ln() + 0.1;
    let origin = DVec3::new(0.1, 0.2, -3.0);
    Guess {
        root: person.pose.root,
        turns,
        log_focal,
        origin,
        log_scale: 0.1,
        shape: vec![],
    }
}

fn dense(problem: &Problem, guess: &Guess) -> (usize, Vec<Vec<f64>>) {
    let n = problem.columns().len();
    let skin = problem.skin(guess, None, true);
    let mut rows = Vec::new();
    problem.rows(guess, &skin, &mut |columns, values, _, _| {
        let mut row = vec![0.0; n];
        columns.iter().zip(values).for_each(|(&c, v)| row[c] = *v);
        rows.push(row);
    });
    (n, rows)
}

fn residuals(problem: &Problem, guess: &Guess) -> Vec<f64> {
    let skin = problem.skin(guess, None, true);
    let mut residuals = Vec::new();
    problem.rows(guess, &skin, &mut |_, _, r, _| residuals.push(r));
    residuals
}

#[test]
fn exact_points_bring_back_the_body() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    let (mut worst, mut turned) = (0.0f64, Vec::new());
    for seed in 100..110 {
        let person = person(&fitter, &avatar, seed);
        // In double precision: a micrometre can hide half a degree of how arm and collar share.
        let markers = person.folded_markers(&fitter, &avatar);
        let evidence = Evidence::new(&person.keypoints_at(&markers, true));
        let free = Free::list(&avatar, fitter.folded(), &BUILD).expect("phenotypes");
        let base = Shape::default();
        let shapes = Shapes::new(&avatar, fitter.folded(), &base, &free).expect("a shape");
        let features = shapes.features(&shapes.start());
        let start = Start {
            folded: fitter.folded(),
            features: &features,
            evidence: &evidence,
            habits: fitter.habits(),
            focal: 1800.0,
            shape: shapes.start(),
        };
        let problem = Problem {
            folded: fitter.folded(),
            shapes,
            evidence: &evidence,
            habits: fitter.habits(),
            trust: exact(),
        };
        // Phenotypes have kinks where they are average, so there is a valley on either side.
        let builds = [
            [0.5, 0.5, 0.5],
            [0.2, 0.8, 0.2],
            [0.8, 0.2, 0.8],
            [0.8, 0.8, 0.2],
        ];
        let ends = builds.into_iter().map(|build| {
            let mut guess = start.shown().expect("trunk seen");
            guess.log_scale = 0.0;
            [0, 2, 3]
                .into_iter()
                .zip(build)
                .for_each(|(k, v)| guess.shape[k] = v);
            descend(
                &problem,
                guess,
                Patience {
                    steps: 60,
                    saving: 1e-6,
                },
            )
        });
        let end = ends
            .into_iter()
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .expect("four ends");
        let patience = Patience {
            steps: 600,
            saving: 0.0,
        };
        // What is all but hidden (how collar and shoulder share a lift) comes last.
        let end = descend(&problem, end.guess, patience);
        let found = back(&fitter, &avatar, &problem, &end.guess);
        let off = found
            .markers(&avatar)
            .into_iter()
            .zip(person.markers(&avatar));
        let off = off.map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
        let angle = found
            .directions(&avatar)
            .into_iter()
            .zip(person.directions(&avatar));
        let angle = angle
            .map(|(a, b)| a.angle_between(b).to_degrees())
            .fold(0.0, f64::max);
        println!(
            "seed {seed}: points {:.3} mm, bones {angle:.3} degrees, {} steps, cost {:.1e}",
            1e3 * off,
            end.steps,
            end.cost
        );
        worst = worst.max(off);
        turned.push(angle);
    }
    assert!(worst < 1e-3, "points {worst} m");
    // One in ten ends in a valley beside the true one: points within 10 µm, an arm that bears
    // half a degree of its lift in the collar.
    turned.sort_by(f64::total_cmp);
    assert!(
        turned[8] < 0.5 && turned[9] < 1.0,
        "bones {turned:?} degrees"
    );
}

/// The person that a guess stands for.
fn back(fitter: &Fitter, avatar: &Avatar, problem: &Problem, guess: &Guess) -> Person {
    let mut pose = Pose::rest(avatar);
    fitter
        .folded()
        .joints
        .iter()
        .for_each(|j| pose.rotations[j.bone] = guess.turns[j.group]);
    let shape = problem.shapes.shape(&guess.shape);
    let head = avatar.figure(&shape).expect("an adult").joints[0];
    pose.root = guess.root - head;
    Person {
        shape,
        pose,
        focal: guess.log_focal.exp(),
    }
}

#[test]
fn a_photo_fit_lies_over_its_points_and_stands_on_the_floor() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    for (seed, depth) in (200..206).flat_map(|s| [(s, true), (s, false)]) {
        let person = person(&fitter, &avatar, seed);
        let keypoints = person.keypoints(&avatar, depth);
        let options = FitOptions {
            height_m: Some(1.75),
            weight_kg: Some(70.0),
            ..FitOptions::default()
        };
        let fit = fitter.fit(&keypoints, &options).expect("a person");
        let figure = avatar.figure(&fit.shape).expect("an adult");
        assert!((avatar.height(&figure) - 1.75).abs() < 1e-4);
        assert!((avatar.measure(&figure).mass - 70.0).abs() < 0.1);
        println!(
            "seed {seed} depth {depth}: {:.1} px, {} steps, cost {:.0}",
            fit.reprojection_px, fit.iterations, fit.cost
        );
        assert!(
            fit.reprojection_px < 12.0,
            "seed {seed}: {} px",
            fit.reprojection_px
        );
        let seen = Person {
            shape: fit.shape.clone(),
            pose: fit.pose.clone(),
            focal: 1.0,
        };
        let pixels = fit.camera.project_all(&seen.markers(&avatar));
        let nose = pixels[0]
            .expect("before the camera")
            .distance(keypoints.points[0].pixel);
        assert!(nose < 40.0, "nose {nose} px off");
        let posed = avatar.pose(&figure, &fit.pose);
        let low = posed.verts[avatar.part(muslin_body::Part::Body)]
            .iter()
            .map(|v| v.y)
            .fold(1.0, f64::min);
        assert!(low.abs() < 0.06, "feet {low} m off the floor");
    }
}

#[test]
fn other_layouts_fit_too() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    let person = person(&fitter, &avatar, 301);
    let full = person.keypoints(&avatar, false);
    let markers = person.markers(&avatar);
    for layout in [Layout::Coco17, Layout::Body25] {
        let point = |i: usize| {
            let [a, b] = layout.regressed(i).expect("all points are on the body");
            let at = 0.5 * (markers[a] + markers[b]);
            let pixel = view(at, person.focal).0 * DVec2::new(1.0, -1.0) + DVec2::new(600.0, 800.0);
            Keypoint { pixel, score: 0.9 }
        };
        let points = (0..layout.n_points()).map(point).collect();
        let fit = fitter.fit(
            &Keypoints {
                layout,
                points,
                ..full.clone()
            },
            &FitOptions::default(),
        );
        let fit = fit.expect("a person");
        assert!(
            fit.reprojection_px < 15.0,
            "{layout:?}: {} px",
            fit.reprojection_px
        );
    }
    assert_eq!(COCO17.len(), 17);
}

#[test]
fn too_few_points_are_refused() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let fitter = Fitter::new(&avatar).expect("a human rig");
    let mut keypoints = person(&fitter, &avatar, 1).keypoints(&avatar, true);
    keypoints
        .points
        .iter_mut()
        .skip(11)
        .for_each(|p| p.score = 0.0);
    let error = fitter
        .fit(&keypoints, &FitOptions::default())
        .expect_err("a face alone");
    assert!(error.to_string().contains("head to knee"), "{error}");
    keypoints
        .points
        .iter_mut()
        .for_each(|p| p.pixel = DVec2::NAN);
    assert!(fitter.fit(&keypoints, &FitOptions::default()).is_err());
}

#[test]
fn rotation_vectors_come_back() {
    for phi in [DVec3::new(0.1, 0.2, -0.3), DVec3::new(-2.0, 1.0, 0.5)] {
        assert!(rotation_vector(DQuat::from_scaled_axis(phi)).distance(phi) < 1e-12);
    }
    assert_eq!(DAffine3::IDENTITY.transform_point3(DVec3::X), DVec3::X);
}
