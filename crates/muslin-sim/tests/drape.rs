//! Scenes whose answer is known: from a formula, or because it must be clean.

mod scenes;

use glam::{DVec2, DVec3};
use muslin_sim::{Cloth, Frame, Options, Settled, SimError, drape, drape_along, drape_while};
use scenes::{capsule, cotton, cut, grid, look, tube};

/// A body far below everything, for scenes without one.
fn nobody() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    capsule(DVec3::Y * -9.0, DVec3::Y * -8.0, 0.1, 8)
}

fn assert_clean(settled: &Settled) {
    assert!(settled.verts.iter().all(|v| v.is_finite()));
    assert_eq!(settled.body_intersections, 0, "cloth meets body");
    assert_eq!(settled.vertices_inside, 0, "vertices inside");
    assert_eq!(settled.self_crossings, 0, "cloth meets cloth");
}

#[test]
fn a_hanging_strip_stretches_by_its_own_weight() {
    let mut material = cotton();
    material.limit = None;
    material.stretch.warp = 20.0;
    let (size, cells) = (DVec2::new(0.05, 0.5), [4, 40]);
    let (flat, faces) = grid(size, cells);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let start: Vec<DVec3> = flat.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
    let top = (start.len() - 5) as u32;
    let pins = (top..start.len() as u32).collect();
    let cloth = Cloth {
        pins,
        ..cut(start.len(), faces, rest, material)
    };
    let (body, body_faces) = nobody();
    let options = Options {
        last_steps: 300,
        iterations: 80,
        pin: 100.0,
        still: 1e-4,
        ..Options::default()
    };
    let settled =
        drape(&cloth, &start, (&[body.into()], &body_faces), &options).expect("valid scene");
    // Above height y hangs ρ g y: the end sinks by ρ g L² / (2 k).
    let want = material.density * 9.81 * 0.5 * 0.5 / (2.0 * 20.0);
    let got = -settled.verts[2].y;
    assert!(
        (got / want - 1.0).abs() < 0.01,
        "sank {got} m, expected {want} m"
    );
    assert!(settled.converged);
}

fn on_a_sphere(threads: usize) -> Settled {
    let (flat, faces) = grid(DVec2::splat(0.6), [30, 30]);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    // The material seen from above: x to the right, y away, so that faces look up.
    let place = |p: &DVec2| DVec3::new(p.x - 0.3, 0.21, 0.3 - p.y);
    let start: Vec<DVec3> = flat.iter().map(place).collect();
    let cloth = cut(start.len(), faces, rest, cotton());
    let (body, body_faces) = capsule(DVec3::ZERO, DVec3::Y * 1e-6, 0.2, 48);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let run = || {
        drape(
            &cloth,
            &start,
            (&[body.clone().into()], &body_faces),
            &Options::default(),
        )
    };
    let settled = pool
        .expect("threads can be started")
        .install(run)
        .expect("valid scene");
    look(
        "sphere",
        &[(&body, &body_faces), (&settled.verts, &cloth.faces)],
    );
    settled
}

#[test]
fn a_cloth_over_a_sphere_ends_clean_with_the_same_bits_on_any_threads() {
    let one = on_a_sphere(1);
    assert_clean(&one);
    assert!(one.stretch_p99 < 0.07, "stretch {}", one.stretch_p99);
    let lowest = one.verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min);
    assert!(
        (-0.2..-0.06).contains(&lowest),
        "the corners hang at {lowest}"
    );
    for threads in [2, 3, 8] {
        assert!(
            one == on_a_sphere(threads),
            "{threads} threads gave other bits"
        );
    }
}

/// A torso with one arm at `angle` [rad] off the side; its upper end is sunk into the torso.
fn torso_with_arm(angle: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (mut verts, mut faces) = capsule(DVec3::Y * 0.9, DVec3::Y * 1.35, 0.14, 40);
    let shoulder = DVec3::new(0.17, 1.38, 0.0);
    let hand = shoulder + DVec3::new(angle.sin(), -angle.cos(), 0.0) * 0.55;
    let (arm, arm_faces) = capsule(shoulder, hand, 0.05, 24);
    let base = verts.len() as u32;
    verts.extend(arm);
    faces.extend(arm_faces.iter().map(|f| f.map(|i| i + base)));
    (verts, faces)
}

#[test]
fn a_tube_stays_clean_while_an_arm_comes_down_beside_it_and_all_walk_away() {
    let (cloth, start) = tube((0.16, 0.165), (0.85, 0.42), 0.018, cotton());
    // What is held by its neighbours must still go where the body goes.
    let frame = |k: i32| {
        let (mut verts, _) = torso_with_arm(1.1 - 0.06 * f64::from(k));
        verts.iter_mut().for_each(|v| v.z += 0.04 * f64::from(k));
        verts
    };
    let path: Vec<Frame> = (0..=16).map(|k| frame(k).into()).collect();
    let body_faces = torso_with_arm(1.0).1;
    let options = Options::default();
    let settled = drape(&cloth, &start, (&path, &body_faces), &options).expect("valid scene");
    look(
        "tube",
        &[(&settled.body, &body_faces), (&settled.verts, &cloth.faces)],
    );
    assert_clean(&settled);
    assert!(
        settled.stretch_p99 < 0.07,
        "stretch {}",
        settled.stretch_p99
    );
}

/// Two legs under a hip, one `angle` [rad] forward and the other as far back.
fn stride(angle: f64) -> (Frame, Vec<[u32; 3]>) {
    let mut frame = Frame::default();
    let mut faces = Vec::new();
    let mut add = |a: DVec3, b: DVec3, radius: f64| {
        let (verts, more) = capsule(a, b, radius, 24);
        let base = frame.skin.len() as u32;
        let core = |p: &DVec3| {
            a.lerp(
                b,
                ((*p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0),
            )
        };
        frame.cores.extend(verts.iter().map(core));
        frame.skin.extend(verts);
        faces.extend(more.iter().map(|f| f.map(|i| i + base)));
    };
    add(
        DVec3::new(-0.05, 1.0, 0.0),
        DVec3::new(0.05, 1.0, 0.0),
        0.09,
    );
    for side in [-1.0, 1.0] {
        let hip = DVec3::new(0.07 * side, 0.98, 0.0);
        let swing = DVec3::new(0.0, -angle.cos(), side * angle.sin());
        add(hip, hip + swing * 0.7, 0.06);
    }
    (frame, faces)
}

#[test]
fn a_slim_skirt_rides_up_over_legs_in_a_stride() {
    let mut material = cotton();
    material.limit = Some(0.04);
    let (mut cloth, start) = tube((0.15, 0.145), (0.45, 0.6), 0.02, material);
    let waist = start.iter().map(|p| p.y).fold(0.0, f64::max) - 1e-6;
    cloth.pins = (0..start.len() as u32)
        .filter(|&i| start[i as usize].y > waist)
        .collect();
    let at = |k: i32| stride(0.025 * f64::from(k)).0;
    let path: Vec<Frame> = (0..=20).map(at).collect();
    let body_faces = stride(0.0).1;
    let run = |again: bool| {
        let options = Options {
            again,
            ..Options::default()
        };
        drape(&cloth, &start, (&path, &body_faces), &options).expect("valid scene")
    };
    assert!(run(false).body_intersections > 0, "it takes care");
    let settled = run(true);
    look(
        "stride",
        &[(&settled.body, &body_faces), (&settled.verts, &cloth.faces)],
    );
    assert_clean(&settled);
    assert!(
        settled.stretch_p99 < 0.05,
        "stretch {}",
        settled.stretch_p99
    );
    let hem = settled
        .verts
        .iter()
        .map(|p| p.y)
        .fold(f64::INFINITY, f64::min);
    assert!(hem > 0.5, "the hem is at {hem}");
}

#[test]
fn cloth_that_the_body_would_tear_apart_is_called_too_tight() {
    let mut material = cotton();
    material.limit = Some(0.04);
    let (cloth, start) = tube((0.07, 0.07), (0.2, 0.3), 0.02, material);
    let (a, b) = (DVec3::Y * -0.4, DVec3::Y * 0.4);
    let (thin, faces) = capsule(a, b, 0.06, 24);
    let at = |k: i32| {
        let grown = DVec3::new(1.0 + 0.16 * f64::from(k), 1.0, 1.0 + 0.16 * f64::from(k));
        Frame::from(thin.iter().map(|p| *p * grown).collect::<Vec<_>>())
    };
    let path: Vec<Frame> = (0..=12).map(at).collect();
    let ended = drape(&cloth, &start, (&path, &faces), &Options::default());
    assert!(
        matches!(ended, Err(SimError::TooTight(beyond)) if beyond > 0.3),
        "{ended:?}"
    );
}

#[test]
fn a_finger_thinner_than_the_weave_does_not_poke_through() {
    let (cloth, start) = tube((0.2, 0.2), (0.85, 0.42), 0.018, cotton());
    let scene = |depth: f64| {
        let (mut verts, mut faces) = capsule(DVec3::Y * 0.9, DVec3::Y * 1.35, 0.14, 40);
        let tip = DVec3::new(0.004, 1.003, 0.23 - depth);
        let (finger, finger_faces) = capsule(tip + DVec3::Z * 0.12, tip, 0.006, 10);
        let base = verts.len() as u32;
        verts.extend(finger);
        faces.extend(finger_faces.iter().map(|f| f.map(|i| i + base)));
        (verts, faces)
    };
    let path: Vec<Frame> = (0..=12)
        .map(|k| scene(0.004 * f64::from(k)).0.into())
        .collect();
    let body_faces = scene(0.0).1;
    let settled = drape(&cloth, &start, (&path, &body_faces), &Options::default());
    let settled = settled.expect("valid scene");
    look(
        "finger",
        &[(&settled.body, &body_faces), (&settled.verts, &cloth.faces)],
    );
    assert_clean(&settled);
    assert_eq!(settled.body, path[12].skin, "it is pushed, not dented");
}

#[test]
fn cloth_that_is_too_tight_is_tugged_at_and_the_body_is_back_where_it_was() {
    // A finger wide is what the tube lacks: no tug can help, and none may harm.
    let mut material = cotton();
    material.limit = Some(0.01);
    let (mut cloth, start) = tube((0.16, 0.165), (0.85, 0.3), 0.018, material);
    let tight = |t: &mut [DVec2; 3]| t.iter_mut().for_each(|p| p.x *= 0.84);
    cloth.rest.iter_mut().for_each(tight);
    let (body, faces) = capsule(DVec3::Y * 0.3, DVec3::Y * 1.7, 0.14, 40);
    let centre = |p: &DVec3| DVec3::new(0.0, p.y.clamp(0.3, 1.7), 0.0);
    let frame = Frame {
        cores: body.iter().map(centre).collect(),
        skin: body.clone(),
    };
    let run = |tugs: usize| {
        let options = Options {
            tugs,
            ..Options::default()
        };
        drape(
            &cloth,
            &start,
            (std::slice::from_ref(&frame), &faces),
            &options,
        )
        .expect("valid")
    };
    let (left_alone, tugged) = (run(0), run(1));
    assert!(tugged.steps > left_alone.steps + 25, "a tug takes steps");
    assert_clean(&tugged);
    assert!(tugged.stretch_p99 > 0.01);
    assert!(tugged.stretch_p99 < left_alone.stretch_p99 + 0.01);
    let away = tugged.body.iter().zip(&body).map(|(a, b)| a.distance(*b));
    let away = away.fold(0.0, f64::max);
    assert!((away - tugged.yielded).abs() < 1e-3, "{away}");
}

#[test]
fn arrays_that_do_not_fit_are_refused_by_name() {
    let (cloth, start) = tube((0.16, 0.165), (0.85, 0.1), 0.05, cotton());
    let (body, faces) = nobody();
    let path = [body.clone().into()];
    let options = Options::default();
    let run = |cloth: &Cloth, start: &[DVec3]| drape(cloth, start, (&path, &faces), &options);
    let said = |r: Result<Settled, muslin_sim::SimError>| r.expect_err("bad input").to_string();
    assert!(said(run(&cloth, &start[1..])).contains("start has"));
    let mut bad = cloth.clone();
    bad.faces[3][1] = 9999;
    assert!(said(run(&bad, &start)).contains("vertex 9999 of face 3"));
    let mut bad = cloth.clone();
    bad.rest[2] = [DVec2::ZERO; 3];
    assert!(said(run(&bad, &start)).contains("face 2 has no rest shape"));
    let mut bad = start.clone();
    bad[5].y = f64::NAN;
    assert!(said(run(&cloth, &bad)).contains("start vertex 5 is not finite"));
    assert!(drape(&cloth, &start, (&[], &faces), &options).is_err());
}

#[test]
fn a_drape_stops_between_two_steps_when_asked() {
    let (flat, faces) = grid(DVec2::splat(0.2), [8, 8]);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let start: Vec<DVec3> = flat.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
    let cloth = cut(start.len(), faces, rest, cotton());
    let (body, body_faces) = nobody();
    let left = std::sync::atomic::AtomicI32::new(3);
    let go_on = || left.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) > 0;
    let path = [body.into()];
    let options = (&Options::default(), &go_on as &(dyn Fn() -> bool + Sync));
    let stopped = drape_while(&cloth, &start, (&path, &body_faces), options);
    assert_eq!(stopped.err(), Some(SimError::Stopped));
    assert_eq!(left.into_inner(), -1, "asked once more, then no longer");
}

#[test]
fn cloth_that_is_led_stays_where_it_is_led_while_skin_slides_below() {
    let (flat, faces) = grid(DVec2::new(0.2, 0.4), [10, 20]);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let place = |p: &DVec2| DVec3::new(p.x - 0.1, 0.106, 0.2 - p.y);
    let start: Vec<DVec3> = flat.iter().map(place).collect();
    let cloth = cut(start.len(), faces, rest, cotton());
    // A bar along which the skin moves by 8 cm.
    let bar = |x: f64| capsule(DVec3::X * (x - 0.5), DVec3::X * (x + 0.5), 0.1, 24);
    let path: Vec<Frame> = (0..=8).map(|k| bar(0.01 * k as f64).0.into()).collect();
    let body_faces = bar(0.0).1;
    let options = Options::default();
    let how = (&options, &(|| true) as &(dyn Fn() -> bool + Sync));
    let body = (&path[..], &body_faces[..]);
    let went = |settled: &Settled| {
        assert_clean(settled);
        let ways = settled.verts.iter().zip(&start).map(|(a, b)| a.x - b.x);
        ways.sum::<f64>() / start.len() as f64
    };
    let carried = drape_while(&cloth, &start, body, how).expect("valid scene");
    assert!((went(&carried) - 0.08).abs() < 0.01, "{}", went(&carried));
    let told_nothing = drape_along(&cloth, (&start, &[]), body, how).expect("valid scene");
    assert!(told_nothing == carried);
    // It is thought to lie where it is, or to go the other way.
    for speed in [0.0, -0.005] {
        let laid = |k: usize| {
            start
                .iter()
                .map(|p| *p + DVec3::X * (speed * k as f64))
                .collect()
        };
        let laid: Vec<Vec<DVec3>> = (0..=8).map(laid).collect();
        let led = drape_along(&cloth, (&start, &laid), body, how).expect("valid scene");
        assert!((went(&led) - 8.0 * speed).abs() < 0.01, "{}", went(&led));
        let short = drape_along(&cloth, (&start, &laid[1..]), body, how).unwrap_err();
        assert!(short.to_string().contains("laid cloth"), "{short}");
        let mut bad = laid.clone();
        bad[3][7].z = f64::NAN;
        let bad = drape_along(&cloth, (&start, &bad), body, how).unwrap_err();
        assert!(bad.to_string().contains("laid vertex 7"), "{bad}");
    }
}
