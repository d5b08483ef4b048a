//! Cloth over time: free fall, the same bits on any number of threads and after a stop.

#[allow(dead_code, reason = "a part of the scenes is for other tests")]
mod scenes;

use std::{f64::consts::PI, ops::ControlFlow};

use glam::{DVec2, DVec3};
use muslin_sim::{Air, CHECKPOINT, Cloth, Moment, Options, State, Walk, simulate};
use scenes::{capsule, cotton, cut, grid};

/// A level square of cloth, `height` above the origin.
fn sheet(cells: usize, height: f64) -> (Cloth, Vec<DVec3>) {
    let (flat, faces) = grid(DVec2::splat(0.3), [cells, cells]);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let place = |p: &DVec2| DVec3::new(p.x - 0.15, height, 0.15 - p.y);
    let start: Vec<DVec3> = flat.iter().map(place).collect();
    (cut(start.len(), faces, rest, cotton()), start)
}

/// What a run delivers: all frames, the states to resume from.
#[derive(Default, PartialEq, Debug)]
struct Film {
    frames: Vec<Vec<DVec3>>,
    met: usize,
    states: Vec<State>,
}

/// A ball under the sheet that goes to the side and up and down, `frames` at 60 a second.
fn film(frames: usize, threads: usize, (second_order, resume): (bool, Option<&State>)) -> Film {
    let (cloth, start) = sheet(14, 0.13);
    let (ball, faces) = capsule(DVec3::ZERO, DVec3::Y * 1e-6, 0.12, 32);
    let at = |k: usize| {
        let t = k as f64 / 60.0;
        let way = DVec3::new(0.6 * t, 0.05 * (9.0 * t).sin(), 0.0);
        ball.iter().map(|p| *p + way).collect::<Vec<_>>().into()
    };
    let walk = Walk {
        faces: &faces,
        rest: &ball,
        frames,
        lead: 0,
        fps: 60.0,
        at: &at,
    };
    let mut film = Film::default();
    let keep = |m: &Moment<'_>| {
        film.frames.push(m.verts.to_vec());
        film.met += m.body_intersections;
        film.states.extend(m.state.cloned());
        ControlFlow::Continue(())
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let options = Options {
        second_order,
        ..Options::default()
    };
    let run = || simulate(&cloth, (&start, resume), (&walk, &options), keep);
    pool.expect("threads").install(run).expect("a valid scene");
    film
}

#[test]
fn frames_are_the_same_bits_on_any_number_of_threads() {
    let one = film(20, 1, (false, None));
    assert_eq!(one.frames.len(), 20);
    assert_eq!(one.met, 0, "cloth in the ball");
    assert_eq!(one, film(20, 2, (false, None)));
    assert_eq!(one, film(20, 3, (false, None)));
}

#[test]
fn a_run_that_was_stopped_goes_on_to_the_same_bits() {
    for second_order in [false, true] {
        let whole = film(CHECKPOINT + 12, 2, (second_order, None));
        assert_eq!((whole.states.len(), whole.met), (1, 0));
        let rest = film(CHECKPOINT + 12, 2, (second_order, Some(&whole.states[0])));
        assert_eq!(rest.frames.len(), 12);
        assert_eq!(rest.frames, whole.frames[CHECKPOINT..]);
        // What presses the cloth is part of the state: friction goes by it.
        let forgetful = State {
            pressed: Vec::new(),
            ..whole.states[0].clone()
        };
        let other = film(CHECKPOINT + 12, 2, (second_order, Some(&forgetful)));
        assert_ne!(other.frames, rest.frames);
    }
}

/// How far a sheet falls in 65 frames of a sixtieth, and in the last of them [m].
fn falls(second_order: bool, air: Air) -> [f64; 2] {
    let (cloth, start) = sheet(6, 0.0);
    let (ball, faces) = capsule(DVec3::Y * -90.0, DVec3::Y * -89.0, 0.1, 8);
    let at = |_: usize| ball.clone().into();
    let (frames, fps) = (66, 60.0);
    let walk = Walk {
        faces: &faces,
        rest: &ball,
        frames,
        lead: 0,
        fps,
        at: &at,
    };
    let options = Options {
        first_steps: 0,
        last_steps: 0,
        second_order,
        air,
        ..Options::default()
    };
    let mut heights = Vec::new();
    simulate(&cloth, (&start, None), (&walk, &options), |m| {
        let mean = m.verts.iter().sum::<DVec3>() / m.verts.len() as f64;
        heights.push(mean.y);
        ControlFlow::Continue(())
    })
    .expect("a valid scene");
    let last = heights[frames - 1];
    [heights[0] - last, heights[frames - 2] - last]
}

#[test]
fn a_sheet_falls_freely_past_ten_metres_a_second() {
    // Implicit Euler falls by g h² n (n + 1) / 2 in n steps: ahead of g t² / 2 by one part in n.
    let (n, g) = (65.0, 9.81 / 3600.0);
    let [fallen, last] = falls(false, Air::NONE);
    let want = g * n * (n + 1.0) / 2.0;
    assert!((fallen / want - 1.0).abs() < 1e-3, "{fallen} for {want}");
    assert!(last * 60.0 > 10.0, "{last} m in a frame");
    // BDF2 knows parabolas; a first step, Euler's, puts it ahead by three quarters of g h², and where
    // a run may be resumed from, twice on the way, there is another.
    let [fallen, _] = falls(true, Air::NONE);
    let want = g * (n * n / 2.0 + 3.0 * 0.75);
    assert!((fallen / want - 1.0).abs() < 1e-4, "{fallen} for {want}");
}

#[test]
fn a_sheet_that_tumbles_and_quivers_in_flight_keeps_its_momentum() {
    let (cloth, mut verts) = sheet(10, 0.0);
    // Not as cut, and every vertex goes its own way.
    for (i, p) in verts.iter_mut().enumerate() {
        p.y += 0.01 * (1.7 * i as f64).sin();
    }
    let spin = DVec3::new(2.0, 1.0, -3.0);
    let way = |(i, p): (usize, &DVec3)| {
        let own = DVec3::new((0.9 * i as f64).sin(), (2.1 * i as f64).cos(), 0.3) * 0.5;
        DVec3::new(1.0, 0.5, 2.0) + spin.cross(*p) + own
    };
    let state = State {
        velocities: verts.iter().enumerate().map(way).collect(),
        ..at_rest(verts.clone())
    };
    let mut mass = vec![0.0; verts.len()];
    for (face, rest) in cloth.faces.iter().zip(&cloth.rest) {
        let area = 0.5 * (rest[1] - rest[0]).perp_dot(rest[2] - rest[0]).abs();
        face.iter().for_each(|v| mass[*v as usize] += area);
    }
    let whole = mass.iter().sum::<f64>();
    let middle = |x: &[DVec3]| x.iter().zip(&mass).map(|(x, m)| *x * *m).sum::<DVec3>() / whole;
    let (ball, faces) = capsule(DVec3::Y * -90.0, DVec3::Y * -89.0, 0.1, 8);
    let walk = Walk {
        faces: &faces,
        rest: &ball,
        frames: 21,
        lead: 0,
        fps: 60.0,
        at: &|_| ball.clone().into(),
    };
    for second_order in [false, true] {
        let options = Options {
            gravity: DVec3::ZERO,
            air: Air::NONE,
            second_order,
            ..Options::default()
        };
        let mut at = vec![middle(&verts)];
        let run = simulate(&cloth, (&verts, Some(&state)), (&walk, &options), |m| {
            at.push(middle(m.verts));
            ControlFlow::Continue(())
        });
        run.expect("a valid scene");
        let went = middle(&state.velocities) / 60.0;
        for step in at.windows(2) {
            let off = (step[1] - step[0] - went).length() / went.length();
            assert!(off < 1e-9, "{second_order}: {off:e}");
        }
        assert_eq!(at.len(), 21);
    }
}

#[test]
fn in_air_a_level_sheet_falls_as_fast_as_its_weight_and_the_wind_say() {
    // Where ½ ρ C v² is the weight of a square metre: C is 0.6.
    let weight = cotton().density * 9.81;
    let speed = (weight / (0.5 * Air::STILL.density * 0.6)).sqrt();
    for (second_order, up) in [(false, 0.0), (true, 0.0), (false, 3.0)] {
        let wind = DVec3::Y * up;
        let [_, last] = falls(second_order, Air { wind, ..Air::STILL });
        let want = speed - up;
        assert!(
            (60.0 * last - want).abs() < 0.01 * speed,
            "{last} for {want} m/s"
        );
    }
}

/// Speeds [m/s], frame after frame of a sixtieth, of a sheet that begins with `speed` along a level slab under a weight
/// that leans by `angle`.
fn slides_on_skin(friction: f64, speed: f64, angle: f64) -> Vec<f64> {
    let (mut cloth, mut verts) = sheet(15, 3e-3);
    cloth.materials[0].friction = friction;
    verts.iter_mut().for_each(|p| p.y = 2.97e-3);
    let (slab, faces) = slab(0.0);
    let options = Options {
        gravity: DVec3::new(angle.sin(), -angle.cos(), 0.0) * 9.81,
        air: Air::NONE,
        ..Options::default()
    };
    let state = State {
        velocities: vec![DVec3::X * speed; verts.len()],
        ..at_rest(verts)
    };
    let velocities = velocities((&cloth, &state), (&slab, &faces), (&options, 0));
    velocities.into_iter().map(|v| v.x).collect()
}

fn at_rest(verts: Vec<DVec3>) -> State {
    State {
        frame: 1,
        velocities: vec![DVec3::ZERO; verts.len()],
        verts,
        ..State::default()
    }
}

/// Velocities [m/s], in 30 frames of a sixtieth, of the cloth from vertex `first` on, on a body that stands still.
fn velocities(
    (cloth, state): (&Cloth, &State),
    (body, faces): (&[DVec3], &[[u32; 3]]),
    (options, first): (&Options, usize),
) -> Vec<DVec3> {
    let walk = Walk {
        faces,
        rest: body,
        frames: 31,
        lead: 0,
        fps: 60.0,
        at: &|_| body.to_vec().into(),
    };
    let mean = |x: &[DVec3]| x[first..].iter().sum::<DVec3>() / (x.len() - first) as f64;
    let mut at = vec![mean(&state.verts)];
    simulate(cloth, (&state.verts, Some(state)), (&walk, options), |m| {
        at.push(mean(m.verts));
        ControlFlow::Continue(())
    })
    .expect("a valid scene");
    at.windows(2).map(|w| (w[1] - w[0]) * 60.0).collect()
}

#[test]
fn cloth_slides_on_skin_as_fast_as_friction_lets_it() {
    let angle = 5f64.to_radians();
    let free = slides_on_skin(0.0, 0.0, angle)[29];
    let want = 9.81 * angle.sin() * 0.5;
    assert!((free / want - 1.0).abs() < 0.01, "{free} for {want} m/s");
    // Where it leans by less than 16.7 degrees it stays.
    for angle in [5.0f64, 10.0, 15.0] {
        let speeds = slides_on_skin(0.3, 0.0, angle.to_radians());
        assert!(speeds[29] < 2e-3, "{angle}: {speeds:?}");
    }
    for angle in [20.0f64, 25.0, 35.0] {
        let angle = angle.to_radians();
        let speeds = slides_on_skin(0.3, 0.0, angle);
        let gained = (speeds[29] - speeds[2]) * 60.0 / 27.0;
        let law = 9.81 * (angle.sin() - 0.3 * angle.cos());
        assert!(
            (gained / law - 1.0).abs() < 0.02,
            "{gained} for {law} m/s2: {speeds:?}"
        );
    }
    let thrown = slides_on_skin(0.3, 1.0, 0.0);
    let slowed = (thrown[0] - thrown[18]) * 60.0 / 18.0;
    assert!(
        (slowed / (0.3 * 9.81) - 1.0).abs() < 0.1,
        "{slowed}: {thrown:?}"
    );
    assert!(thrown[28].abs() < 2e-3, "{thrown:?}");
}

/// A slab whose top is at `y` [m].
fn slab(y: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| {
        let side = |bit: u32| if i & bit == 0 { -2.0 } else { 2.0 };
        DVec3::new(side(1), if i & 2 == 0 { y - 0.5 } else { y }, side(4))
    };
    let quads = [
        [2, 6, 7, 3],
        [0, 1, 5, 4],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let faces = quads.into_iter().flat_map(halves).collect();
    ((0..8).map(corner).collect(), faces)
}

#[test]
fn skin_that_strikes_cloth_takes_it_along_by_no_more_than_friction_allows() {
    // Without weight, a sheet is struck at 0.5 m/s by what slides under it at 1 m/s: as much as the blow
    // is worth, times 0.3, goes into the slide.
    let (cloth, start) = sheet(8, 0.03);
    let (rest, faces) = slab(0.0);
    let (fps, struck) = (60.0, DVec3::new(1.0, 0.5, 0.0));
    let at = |k: usize| {
        // It stands at first, for cloth sets off with the speed of what it is worn on.
        let way = struck * (k.saturating_sub(2) as f64 / fps);
        rest.iter().map(|p| *p + way).collect::<Vec<_>>().into()
    };
    let walk = Walk {
        faces: &faces,
        rest: &rest,
        frames: 16,
        lead: 0,
        fps,
        at: &at,
    };
    let options = Options {
        gravity: DVec3::ZERO,
        first_steps: 0,
        last_steps: 0,
        ..Options::default()
    };
    let mut middles = Vec::new();
    simulate(&cloth, (&start, None), (&walk, &options), |m| {
        middles.push(m.verts.iter().sum::<DVec3>() / m.verts.len() as f64);
        ControlFlow::Continue(())
    })
    .expect("a valid scene");
    let speed = (middles[15] - middles[14]) * fps;
    assert!((speed.y - 0.5).abs() < 0.02, "not taken along: {speed}");
    let law = 0.3 * 0.5;
    assert!((speed.x / law - 1.0).abs() < 0.1, "{speed}");
}

/// Velocities [m/s], frame after frame of a sixtieth, of a small sheet that begins with `speed` along a long one under
/// it, which is held, where weight leans by `angle`.
fn lies_on_cloth(speed: f64, angle: f64) -> Vec<DVec3> {
    let piece = |size: DVec2, [cols, rows]: [usize; 2], at: DVec3| {
        let (flat, faces) = grid(size, [cols, rows]);
        let placed: Vec<DVec3> = flat
            .iter()
            .map(|p| at + DVec3::new(p.x, 0.0, -p.y))
            .collect();
        (flat, faces, placed)
    };
    let (mut flat, mut faces, mut start) =
        piece(DVec2::new(0.8, 0.2), [40, 10], DVec3::new(0.0, 3e-3, 0.0));
    let held = start.len() as u32;
    let on_it = piece(
        DVec2::splat(0.1),
        [5, 5],
        DVec3::new(0.105, 3e-3 + 1.45e-3, -0.053),
    );
    flat.extend(on_it.0);
    faces.extend(on_it.1.iter().map(|f| f.map(|i| i + held)));
    start.extend(on_it.2);
    let rest = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    let cloth = Cloth {
        pins: (0..held).collect(),
        ..cut(start.len(), faces, rest, cotton())
    };
    let (ground, faces) = slab(0.0);
    let options = Options {
        gravity: DVec3::new(angle.sin(), -angle.cos(), 0.0) * 9.81,
        air: Air::NONE,
        ..Options::default()
    };
    let held = held as usize;
    let along = |i: usize| DVec3::X * if i < held { 0.0 } else { speed };
    let state = State {
        frame: 1,
        velocities: (0..start.len()).map(along).collect(),
        verts: start,
        ..State::default()
    };
    velocities((&cloth, &state), (&ground, &faces), (&options, held))
}

/// Its speeds along the long one [m/s].
fn slides_on_cloth(speed: f64, angle: f64) -> Vec<f64> {
    let velocities = lies_on_cloth(speed, angle);
    velocities.into_iter().map(|v| v.x).collect()
}

#[test]
fn cloth_leaves_cloth_as_if_it_had_not_lain_there() {
    let off: Vec<f64> = lies_on_cloth(0.0, PI).iter().map(|v| v.y).collect();
    // Frames in which it is near the other sheet, and near the body under that, and all after.
    for frames in [2..6, 6..12, 12..29] {
        let law = 9.81 * frames.len() as f64 / 60.0;
        let gained = off[frames.end] - off[frames.start];
        assert!((gained / law - 1.0).abs() < 0.01, "{frames:?}: {off:?}");
    }
}

#[test]
fn cloth_leaves_skin_as_if_it_had_not_been_near() {
    // Weight leads off the skin: cloth under an arm or a chin.
    let (cloth, verts) = sheet(8, 5e-3);
    let (slab, faces) = slab(0.0);
    let options = Options {
        gravity: DVec3::Y * 9.81,
        air: Air::NONE,
        ..Options::default()
    };
    let off = velocities((&cloth, &at_rest(verts)), (&slab, &faces), (&options, 0));
    for (k, v) in off.iter().enumerate() {
        let law = 9.81 * (k + 1) as f64 / 60.0;
        assert!((v.y / law - 1.0).abs() < 0.01, "{v} after {k} frames");
    }
}

#[test]
fn cloth_slides_on_cloth_and_friction_slows_it() {
    // Coulomb's coefficient is 0.3. What pushed before the first frame is not known.
    let thrown = slides_on_cloth(1.0, 0.0);
    let slowed = (thrown[0] - thrown[12]) / 0.2;
    assert!(
        (slowed / (0.3 * 9.81) - 1.0).abs() < 0.05,
        "{slowed}: {thrown:?}"
    );
    assert!(thrown[0] > 0.9 && thrown[28].abs() < 2e-3, "{thrown:?}");
    // Where it leans by less than 16.7 degrees it stays.
    for angle in [10.0f64, 15.0] {
        let speeds = slides_on_cloth(0.0, angle.to_radians());
        assert!(speeds.iter().all(|v| v.abs() < 2e-3), "{angle}: {speeds:?}");
    }
    let angle = 25f64.to_radians();
    let slides = slides_on_cloth(0.0, angle);
    let law = 9.81 * (angle.sin() - 0.3 * angle.cos()) * 0.5;
    assert!(
        (0.92 * law..law).contains(&slides[29]),
        "{slides:?} for {law}"
    );
}
