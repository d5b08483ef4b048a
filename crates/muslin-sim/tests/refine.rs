//! Guesses on a moving ball are led to where cloth rests on it.

#[allow(dead_code, reason = "a part of the scenes is for other tests")]
mod scenes;

use glam::{DVec2, DVec3};
use muslin_sim::{Cloth, Frame, Guesses, Options, Refined, SimError, Walk, drape, refine};
use scenes::{capsule, cotton, cut, grid};

const FRAMES: usize = 8;

/// Cloth at rest on a ball, the ball, and its triangles.
struct Scene {
    cloth: Cloth,
    rest: Vec<DVec3>,
    ball: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
}

impl Scene {
    fn new() -> Scene {
        let (flat, faces) = grid(DVec2::splat(0.3), [14, 14]);
        let corners = faces.iter().map(|f| f.map(|i| flat[i as usize])).collect();
        let cloth = cut(flat.len(), faces, corners, cotton());
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
        let walk = Walk {
            faces: &self.faces,
            rest: &self.ball,
            frames: FRAMES,
            lead: 0,
            fps: 30.0,
            at: &at,
        };
        let guesses = Guesses {
            frames: &self.guesses()[first..],
            first,
            steps,
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
