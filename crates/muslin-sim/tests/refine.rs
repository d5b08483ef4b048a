//! Guesses on a moving ball are led to where cloth rests on it.

#[allow(dead_code, reason = "a part of the scenes is for other tests")]
mod scenes;

use glam::{DVec2, DVec3};
use muslin_sim::{Air, Cloth, Frame, Guesses, Options, Refined, SimError, Walk, drape, refine};
use scenes::{capsule, cotton, cut, grid};

const FRAMES: usize = 8;

/// Cloth at rest on a ball, the ball, and its triangles.
struct Scene {
    cloth: Cloth,
    rest: Vec<DVec3>,
    ball: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
}

/// A sheet of so many cells, and where its vertices lie flat [m].
fn sheet(size: DVec2, cells: [usize; 2]) -> (Cloth, Vec<DVec2>) {
    let (flat, faces) = grid(size, cells);
    let corners = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
    (cut(flat.len(), faces, corners, cotton()), flat)
}

/// So many frames at 30 a second of a body of these triangles, begun at `rest` [m], which is where `at` says.
fn walked<'a>(
    (faces, rest): (&'a [[u32; 3]], &'a [DVec3]),
    frames: usize,
    at: &'a (dyn Fn(usize) -> Frame + Sync),
) -> Walk<'a> {
    Walk {
        faces,
        rest,
        frames,
        lead: 0,
        fps: 30.0,
        at,
    }
}

impl Scene {
    fn new() -> Scene {
        let (cloth, flat) = sheet(DVec2::splat(0.3), [14, 14]);
        let start = flat
            .iter()
            .map(|p| DVec3::new(p.x - 0.15, 0.13, 0.15 - p.y));
        let (ball, faces) = capsule(DVec3::ZERO, DVec3::Y * 1e-6, 0.12, 32);
        let path = [Frame::from(ball.clone())];
        let start: Vec<DVec3> = start.collect();
        // Until nothing creeps any more.
        let still = Options {
            still: 1e-4,
            last_steps: 600,
            ..Options::USUAL
        };
        let settled = drape(&cloth, &start, (&path, &faces), &still);
        let rest = settled.expect("a valid scene").verts;
        Scene {
            cloth,
            rest,
            ball,
            faces,
        }
    }

    /// How far ball and cloth have gone in a frame [m].
    fn way(k: usize) -> DVec3 {
        DVec3::new(0.02 * k as f64, 0.005 * k as f64, 0.0)
    }

    /// The cloth at rest with ripples on it that stay where they are on the cloth.
    fn guesses(&self) -> Vec<Vec<DVec3>> {
        let ripple = |(i, p): (usize, &DVec3), k: usize| {
            let out = p.normalize() * (2e-3 * (1.0 + (1.7 * i as f64).sin()));
            *p + out + Scene::way(k)
        };
        let frame = |k: usize| {
            let all = self.rest.iter().enumerate();
            all.map(|at| ripple(at, k)).collect()
        };
        (0..FRAMES).map(frame).collect()
    }

    /// The frames from `first` on, led by `steps` each.
    fn refined(
        &self,
        (first, steps): (usize, usize),
        (threads, go_on): (usize, bool),
    ) -> Result<Vec<Refined>, SimError> {
        let at = |k: usize| {
            let there = self.ball.iter().map(|p| *p + Scene::way(k));
            there.collect::<Vec<_>>().into()
        };
        let walk = walked((&self.faces, &self.ball), FRAMES, &at);
        let guesses = Guesses {
            begun: None,
            frames: &self.guesses()[first..],
            first,
            steps,
            inertia: 0.0,
            begins_at_rest: false,
            or_none: false,
        };
        let mut out = Vec::new();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            refine(
                &self.cloth,
                &guesses,
                (&walk, &Options::USUAL, &|| go_on),
                |r| out.push(r),
            )
        })?;
        Ok(out)
    }

    /// How much of the ripples is left: how far every vertex stands off its neighbours in the row, other
    /// than at rest, in the mean [m].
    fn off(&self, x: &[DVec3]) -> f64 {
        let stands = |x: &[DVec3], i: usize| x[i] - (x[i - 1] + x[i + 1]) * 0.5;
        let inner = (0..x.len()).filter(|i| (1..14).contains(&(i % 15)));
        let all: Vec<f64> = inner
            .map(|i| stands(x, i).distance(stands(&self.rest, i)))
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    }
}

#[test]
fn every_frame_is_led_to_rest_and_what_was_led_is_kept() {
    let scene = Scene::new();
    let (guesses, refined) = (
        scene.guesses(),
        scene.refined((0, 3), (2, true)).expect("valid"),
    );
    assert_eq!(refined.len(), FRAMES);
    for (k, (guess, frame)) in guesses.iter().zip(&refined).enumerate() {
        assert_eq!((frame.body_intersections, frame.self_crossings), (0, 0));
        let [before, after] = [guess, &frame.verts].map(|x| scene.off(x));
        assert!(after < 0.4 * before, "frame {k}: {before} m to {after} m");
        assert_eq!(frame.steps, if k == 0 { 9 } else { 3 });
    }
    let same = |threads| scene.refined((0, 3), (threads, true)).expect("valid");
    let verts = |all: &[Refined]| all.iter().map(|r| r.verts.clone()).collect::<Vec<_>>();
    assert_eq!(verts(&same(1)), verts(&refined), "threads change nothing");
}

#[test]
fn frames_before_it_bring_a_frame_nearer_to_rest() {
    let scene = Scene::new();
    let off = |first: usize| {
        let refined = scene.refined((first, 1), (2, true)).expect("valid");
        scene.off(&refined[refined.len() - 1].verts)
    };
    let (alone, after_others) = (off(FRAMES - 1), off(0));
    assert!(
        after_others < 0.8 * alone,
        "{alone} m alone, {after_others} m"
    );
}

#[test]
fn it_stops_when_asked_and_refuses_guesses_of_other_cloth() {
    let mut scene = Scene::new();
    assert!(matches!(
        scene.refined((0, 3), (1, false)),
        Err(SimError::Stopped)
    ));
    scene.rest.pop();
    let fault = scene
        .refined((0, 3), (1, true))
        .expect_err("a vertex short");
    assert!(fault.to_string().contains("guess"), "{fault}");
}

/// Frames in which what a strip hangs from goes aside.
const JERK: usize = 3;

/// A strip that hangs from a ball which jerks aside. In the frame `pinched` two more balls close on it below where it
/// is held, through each other.
fn strip(inertia: f64, pinched: Option<usize>) -> Vec<Refined> {
    let (mut cloth, flat) = sheet(DVec2::new(0.04, 0.4), [2, 20]);
    cloth.pins = (60..63).collect();
    let ball = |y: f64, z: f64, radius: f64| {
        let middle = DVec3::new(0.02, y, z);
        capsule(middle, middle + DVec3::Z * 1e-6, radius, 12)
    };
    let mut held = ball(0.42, 0.0, 0.01);
    let sides = [-0.06, 0.06].map(|z| ball(0.36, z, 0.02));
    for (verts, faces) in &sides {
        let n = held.0.len() as u32;
        held.0.extend(verts);
        held.1.extend(faces.iter().map(|f| f.map(|v| v + n)));
    }
    let (rest, faces) = held;
    let n = sides[0].0.len();
    let way = |k: usize| DVec3::Z * (0.02 * k.min(JERK) as f64);
    let at = |k: usize| {
        let closes = |i: usize| match pinched == Some(k) && i >= rest.len() - 2 * n {
            true if i >= rest.len() - n => DVec3::Z * -0.05,
            true => DVec3::Z * 0.05,
            false => DVec3::ZERO,
        };
        let there = rest.iter().enumerate();
        let there = there.map(|(i, p)| *p + way(k) + closes(i));
        there.collect::<Vec<_>>().into()
    };
    let frames = 60;
    let walk = walked((&faces, &rest), frames, &at);
    let straight =
        |k: usize| -> Vec<DVec3> { flat.iter().map(|p| p.extend(0.0) + way(k)).collect() };
    let guesses = Guesses {
        begun: None,
        frames: &(0..frames).map(straight).collect::<Vec<_>>(),
        first: 0,
        steps: 5,
        inertia,
        begins_at_rest: false,
        or_none: false,
    };
    let options = Options {
        pin: 500.0,
        ..Options::USUAL
    };
    let mut out = Vec::new();
    let deliver = |r: Refined| out.push(r);
    refine(&cloth, &guesses, (&walk, &options, &|| true), deliver).expect("valid");
    out
}

/// How far its hem is from where it hangs [m], frame by frame; all guesses are that it hangs straight.
fn hem(frames: &[Refined]) -> Vec<f64> {
    let off = |r: &Refined| r.verts[1].z - r.verts[61].z;
    frames.iter().map(off).collect()
}

#[test]
fn cloth_that_gets_caught_goes_on_from_there_and_not_from_a_guess() {
    let frame = JERK + 3;
    let [free, caught] = [None, Some(frame)].map(|pinched| strip(1.0, pinched));
    assert!(free.iter().all(|r| r.body_intersections == 0));
    assert!(caught[frame].body_intersections > 0, "nothing is caught");
    let [free, caught] = [free, caught].map(|frames| hem(&frames)[frame + 1]);
    assert!(free > 0.07, "{free} m");
    assert!(
        (0.7 * free..1.1 * free).contains(&caught),
        "{caught} m, {free} m"
    );
}

#[test]
fn with_inertia_cloth_swings_and_more_of_it_swings_slower() {
    // Seconds from the jerk's end to where the hem, which went on ahead, has swung back.
    let back = |inertia: f64| {
        let hem = hem(&strip(inertia, None));
        let most = hem.iter().copied().fold(0.0, f64::max);
        let ahead = (0..hem.len()).find(|k| hem[*k] > 0.5 * most);
        let returned = |k: &usize| *k > ahead.expect("it goes on") && hem[*k] < 0.0;
        let at = (0..hem.len()).find(returned).expect("swung back");
        (most, (at - JERK) as f64 / 30.0)
    };
    let still = hem(&strip(0.0, None)).iter().all(|z| z.abs() < 4e-3);
    assert!(still, "at rest in every frame");
    let ((most, usual), (_, heavy)) = (back(1.0), back(4.0));
    assert!((0.1..0.2).contains(&most), "{most} m");
    // Half of a hanging chain's period, π / (2.405 / 2 √(g / L)).
    let law = std::f64::consts::PI / (0.5 * 2.405 * (9.81f64 / 0.4).sqrt());
    assert!((usual / law - 1.0).abs() < 0.1, "{usual} s for {law} s");
    assert!(
        (heavy / usual / 2.0 - 1.0).abs() < 0.1,
        "{heavy} s of {usual} s"
    );
}

#[test]
fn cloth_that_swings_is_within_its_limit_from_the_first_frame_on() {
    // A strip that is held at both ends, a fifth farther apart than it is long.
    let (mut cloth, flat) = sheet(DVec2::new(0.04, 0.4), [2, 20]);
    cloth.pins = (0..3).chain(60..63).collect();
    let drawn = |p: &DVec2| DVec3::new(p.x, 1.2 * p.y, 0.0);
    let guess: Vec<DVec3> = flat.iter().map(drawn).collect();
    let middle = DVec3::new(0.02, 0.5, 0.1);
    let (rest, faces) = capsule(middle, middle + DVec3::Z * 1e-6, 0.01, 12);
    let at = |_: usize| Frame::from(rest.clone());
    let walk = walked((&faces, &rest), 2, &at);
    let options = Options {
        pin: 1e6,
        ..Options::USUAL
    };
    let longest = |inertia: f64| {
        let guesses = Guesses {
            begun: None,
            frames: &[guess.clone(), guess.clone()],
            first: 0,
            steps: 5,
            inertia,
            begins_at_rest: false,
            or_none: false,
        };
        let mut first = None;
        let deliver = |r: Refined| {
            first.get_or_insert(r.verts);
        };
        refine(&cloth, &guesses, (&walk, &options, &|| true), deliver).expect("valid");
        let x = first.expect("there are two frames");
        let along = (0..20).map(|k| x[3 * k].distance(x[3 * k + 3]) / 0.02 - 1.0);
        along.fold(0.0, f64::max)
    };
    let (held, slipped) = (longest(0.0), longest(1.0));
    assert!(held > 0.15, "{held}");
    assert!(slipped < 0.07, "{slipped}");
}

/// A strip that hangs from its upper end, guessed to hang aslant, for so many frames on a body that then goes aside by
/// a centimetre a frame; and its frames [m].
fn hung(stands: usize, begins_at_rest: bool, wind: f64) -> Vec<Vec<DVec3>> {
    let (mut cloth, flat) = sheet(DVec2::new(0.04, 0.4), [2, 20]);
    cloth.pins = (60..63).collect();
    let aslant = |p: &DVec2| DVec3::new(p.x, p.y, 0.2 * (0.4 - p.y));
    let guess: Vec<DVec3> = flat.iter().map(aslant).collect();
    let middle = DVec3::new(0.02, 0.5, 0.1);
    let (rest, faces) = capsule(middle, middle + DVec3::Z * 1e-6, 0.01, 12);
    let frames = stands + 4;
    let at = |k: usize| {
        let way = DVec3::X * (0.01 * (k + 1).saturating_sub(stands) as f64);
        Frame::from(rest.iter().map(|p| *p + way).collect::<Vec<_>>())
    };
    let walk = walked((&faces, &rest), frames, &at);
    let options = Options {
        pin: 1e3,
        handles: true,
        air: Air {
            wind: DVec3::X * wind,
            ..Options::USUAL.air
        },
        ..Options::USUAL
    };
    let guesses = Guesses {
        begun: None,
        frames: &vec![guess.clone(); frames],
        first: 0,
        steps: 5,
        inertia: 1.0,
        begins_at_rest,
        or_none: false,
    };
    let mut out = Vec::new();
    let deliver = |r: Refined| out.push(r.verts);
    refine(&cloth, &guesses, (&walk, &options, &|| true), deliver).expect("valid");
    out
}

#[test]
fn cloth_that_begins_at_rest_stays_where_it_is_until_the_body_moves() {
    let drift = |begins_at_rest: bool, wind: f64| {
        let x = hung(20, begins_at_rest, wind);
        let farthest = |k: usize| {
            let pairs = x[0].iter().zip(&x[k]);
            pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
        };
        assert!(farthest(23) > 0.02, "it goes with the body");
        (0..20).map(farthest).fold(0.0, f64::max)
    };
    // Wind keeps it awake, however little of it: what begins at rest is at rest indeed.
    let (moves, awake, asleep) = (drift(false, 1e-9), drift(true, 1e-9), drift(true, 0.0));
    assert!(moves > 2e-3, "{moves} m");
    assert!(awake < 0.2 * moves && awake < 1e-3, "{awake} of {moves} m");
    assert!(awake > 0.0 && asleep == 0.0, "{asleep} and {awake} m");
}

#[test]
fn cloth_that_begins_at_rest_sets_off_with_a_body_in_motion() {
    let x = hung(1, true, 0.0);
    let hem = x[1][1].x - x[0][1].x;
    assert!((hem - 0.01).abs() < 1e-3, "{hem} m");
}

#[test]
fn a_first_frame_that_crosses_itself_is_not_led_to_rest_where_it_is_no_use() {
    // Two sheets through each other, all their edges held.
    const N: usize = 6;
    let side = 0.01 * N as f64;
    let (flat, faces) = grid(DVec2::splat(side), [N, N]);
    let n = flat.len();
    let lies = flat.iter().map(|p| DVec3::new(p.x, 0.47 * side, p.y));
    let stands = flat.iter().map(|p| DVec3::new(p.x, p.y, 0.52 * side));
    let guess: Vec<DVec3> = lies.chain(stands).collect();
    let other = faces.iter().map(|f| f.map(|v| v + n as u32));
    let both: Vec<[u32; 3]> = faces.iter().copied().chain(other).collect();
    let corners = faces.iter().map(|f| f.map(|i| flat[i as usize]));
    let mut cloth = cut(
        2 * n,
        both,
        corners.clone().chain(corners).collect(),
        cotton(),
    );
    let at_edge = |p: &DVec2| p.min_element() < 1e-9 || p.max_element() > side - 1e-9;
    let held = (0..n).filter(|i| at_edge(&flat[*i]));
    cloth.pins = held.flat_map(|i| [i as u32, (i + n) as u32]).collect();
    let far = DVec3::Y * 0.5;
    let (rest, faces) = capsule(far, far + DVec3::Z * 1e-6, 0.01, 12);
    let at = |_: usize| Frame::from(rest.clone());
    let walk = walked((&faces, &rest), 2, &at);
    let led = |or_none: bool| {
        let guesses = Guesses {
            begun: None,
            frames: &[guess.clone(), guess.clone()],
            first: 0,
            steps: 5,
            inertia: 1.0,
            begins_at_rest: true,
            or_none,
        };
        let mut out = Vec::new();
        let deliver = |r: Refined| out.push((r.self_crossings, r.steps));
        let how = (
            &walk,
            &Options::USUAL,
            &(|| true) as &(dyn Fn() -> bool + Sync),
        );
        refine(&cloth, &guesses, how, deliver).expect("valid");
        out
    };
    let (all, none) = (led(false), led(true));
    assert!(all.len() == 2 && all[0].1 > 15, "{all:?}");
    assert!(
        none.len() == 1 && none[0].0 > 0 && none[0].1 == 15,
        "{none:?}"
    );
}
