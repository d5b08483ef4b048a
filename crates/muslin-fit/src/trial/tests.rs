//! Promises that the solver keeps on made-up people.

use super::*;
use crate::figure::Free;
use crate::fold::N_MARKERS;
use crate::joint::rotation_vector;
use crate::problem::{Problem, Trust};
use crate::solve::FitOptions;
use crate::touch::Touch;
use glam::DAffine3;
use muslin_body::COCO17;

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
        assert!(
            want.len() == N_MARKERS && off < 2e-6,
            "seed {seed}: {off} m"
        );
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
        let touch = Touch::new(fitter.folded(), &shapes.features(&shapes.start()));
        let trust = Trust {
            priors: true,
            height: Some(1.7),
            ..exact::trust(1800.0)
        };
        let problem = Problem {
            folded: fitter.folded(),
            shapes,
            evidence: &evidence,
            habits: fitter.habits(),
            touch: Some(&touch),
            steps: Vec::new(),
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
    // Four like any others, and those of a hundred that were hardest to find.
    let hard = [108, 119, 151, 153, 175, 176, 181, 182, 199];
    for seed in (100..104).chain(hard) {
        let trip = round_trip(&fitter, seed).expect("a trunk is seen");
        let (mm, degrees) = (1e3 * trip.points, trip.bones.to_degrees());
        println!(
            "seed {seed}: points {mm:.4} mm, bones {degrees:.4} degrees, {} steps, cost {:.1e}",
            trip.steps, trip.cost
        );
        assert!(mm < 1.0 && degrees < 0.5, "seed {seed}: {trip:?}");
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
