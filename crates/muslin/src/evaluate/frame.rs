//! What one frame tells.

use glam::DVec3;
use muslin_energy::{hinge, stvk};
use muslin_io::Clip;

use super::contact::{self, Contact, Scene};
use super::material::{G, Reference};

/// A vertex at least so far from the body is free [m].
const FREE: f64 = 5e-3;
/// An outer garment's vertex is asked for its side of an inner garment no farther than this [m].
const LAYER: f64 = 0.02;

/// The measures of a frame.
#[derive(Default)]
pub struct Frame {
    /// Which frame.
    pub t: usize,
    /// Saint Venant-Kirchhoff energy [J].
    pub strain: f64,
    /// Bending energy [J].
    pub bend: f64,
    /// Weight against the height of the origin [J].
    pub gravity: f64,
    /// `m |x_t − 2 x_{t−1} + x_{t−2}|² / 2 dt²` [J], from the third frame on.
    pub inertia: Option<f64>,
    /// Mean of force over weight where the body is not near.
    pub residual: f64,
    /// `|l / l̄ − 1|` of every edge.
    pub edges: Vec<f32>,
    /// Larger and smaller principal stretch of every face.
    pub large: Vec<f32>,
    /// See `large`.
    pub small: Vec<f32>,
    /// Mean of `|area / rest area − 1|`.
    pub area: f64,
    /// Mean size of the folds, and of their change from rest [degrees].
    pub fold: f64,
    /// See `fold`.
    pub fold_change: f64,
    /// Against the body.
    pub contact: Contact,
    /// Edges that pierce a triangle which they do not touch by construction.
    pub crossings: usize,
    /// Vertices of an outer garment on the inner side of an inner one.
    pub wrong_order: usize,
    /// Mean size of the vertices' acceleration [m/s²], from the third frame on.
    pub acceleration: Option<f64>,
    /// Mean size of their jerk [m/s³], from the fourth on.
    pub jerk: Option<f64>,
}

impl Frame {
    /// Everything about frame `t`; the scene shows it from now on.
    pub fn measure(
        clip: &Clip,
        cloth: &Reference,
        scene: &mut Scene,
        at: (usize, &[bool]),
    ) -> Self {
        let (mut frame, force) = Self::energies(clip, cloth, at);
        let (t, _) = at;
        let x = &clip.drape.frames[t];
        scene.show(clip, t);
        frame.stretch(clip, cloth, x);
        let clearance = scene.clearance();
        frame.contact = Contact::of(scene, t, &clearance);
        let free = (0..x.len())
            .filter(|&i| clearance.get(i).is_none_or(|&c| c > FREE) && cloth.mass[i] > 0.0);
        frame.residual = super::mean(free.map(|i| force[i].length() / (cloth.mass[i] * G)));
        frame.crossings = contact::piercing_edges(&scene.cloth);
        frame.wrong_order = wrong_order(clip, scene);
        frame
    }

    /// The energies of frame `t` alone.
    pub fn energy(clip: &Clip, cloth: &Reference, at: (usize, &[bool])) -> Self {
        Self::energies(clip, cloth, at).0
    }

    /// All energies together [J].
    pub fn total(&self) -> f64 {
        self.strain + self.bend + self.gravity + self.inertia.unwrap_or(0.0)
    }

    /// Energies and their gradient [N].
    fn energies(
        clip: &Clip,
        cloth: &Reference,
        (t, sound): (usize, &[bool]),
    ) -> (Self, Vec<DVec3>) {
        let x = &clip.drape.frames[t];
        let mut frame = Self {
            t,
            ..Self::default()
        };
        let mut force = vec![DVec3::ZERO; x.len()];
        for (face, patch) in clip.drape.faces.iter().zip(&cloth.patches) {
            let Some(patch) = patch else { continue };
            let (e, g) = stvk::gradient(&face.map(|i| x[i as usize]), patch, &cloth.lame);
            frame.strain += e;
            (0..3).for_each(|k| force[face[k] as usize] += g[k]);
        }
        let mut folds = [0.0; 2];
        for (stencil, rest) in &cloth.hinges {
            let corners = stencil.verts.map(|i| x[i as usize]);
            let (e, g) = hinge::gradient(&corners, rest);
            frame.bend += e;
            (0..4).for_each(|k| force[stencil.verts[k] as usize] += g[k]);
            let fold = hinge::angle(&corners);
            let change = (fold - rest.angle).abs();
            folds[0] += fold.abs().to_degrees();
            folds[1] += change.min(std::f64::consts::TAU - change).to_degrees();
        }
        let n = cloth.hinges.len().max(1) as f64;
        (frame.fold, frame.fold_change) = (folds[0] / n, folds[1] / n);
        for (i, p) in x.iter().enumerate() {
            frame.gravity += cloth.mass[i] * G * p.y;
            force[i].y += cloth.mass[i] * G;
        }
        frame.motion(clip, cloth, (sound, &mut force));
        (frame, force)
    }

    /// Inertia, acceleration and jerk, where the frames before are sound.
    fn motion(&mut self, clip: &Clip, cloth: &Reference, (sound, force): (&[bool], &mut [DVec3])) {
        let (t, fps) = (self.t, clip.drape.fps);
        let back = |k: usize| &clip.drape.frames[t - k];
        if t < 2 || !(sound[t - 1] && sound[t - 2]) {
            return;
        }
        let n = force.len();
        let second = |i: usize, k: usize| back(k)[i] - 2.0 * back(k + 1)[i] + back(k + 2)[i];
        let mut energy = 0.0;
        for i in 0..n {
            let a = second(i, 0) * fps * fps;
            energy += 0.5 * cloth.mass[i] * a.length_squared() / (fps * fps);
            force[i] += cloth.mass[i] * a;
        }
        self.inertia = Some(energy);
        self.acceleration = Some(super::mean(
            (0..n).map(|i| second(i, 0).length() * fps * fps),
        ));
        if t >= 3 && sound[t - 3] {
            let third = |i: usize| (second(i, 0) - second(i, 1)).length() * fps.powi(3);
            self.jerk = Some(super::mean((0..n).map(third)));
        }
    }

    fn stretch(&mut self, clip: &Clip, cloth: &Reference, x: &[DVec3]) {
        let strain = |(ends, rest): &([u32; 2], f64)| {
            let [a, b] = ends.map(|i| x[i as usize]);
            (a.distance(b) / rest - 1.0).abs() as f32
        };
        self.edges = cloth.edges.iter().map(strain).collect();
        let mut area = Vec::with_capacity(cloth.patches.len());
        for (face, patch) in clip.drape.faces.iter().zip(&cloth.patches) {
            let Some(patch) = patch else { continue };
            let [u, v] = patch.deformation(&face.map(|i| x[i as usize]));
            let (a, b, d) = (u.length_squared(), u.dot(v), v.length_squared());
            let large = (0.5 * (a + d) + (0.5 * (a - d)).hypot(b)).sqrt();
            let grown = u.cross(v).length();
            self.large.push(large as f32);
            self.small.push(if large > 0.0 {
                (grown / large) as f32
            } else {
                0.0
            });
            area.push((grown - 1.0).abs());
        }
        self.area = super::mean(area);
    }
}

/// Vertices of outer garments on the inner side of a garment under them.
fn wrong_order(clip: &Clip, scene: &Scene) -> usize {
    let (parts, x) = (&clip.drape.parts, scene.cloth.verts());
    let mut wrong = vec![false; x.len()];
    for (k, inner) in scene.inner.iter().enumerate() {
        for i in parts[k + 1..].iter().flat_map(|p| p.verts.clone()) {
            wrong[i] |= inner.closest(x[i], LAYER).is_some_and(|c| c.signed < 0.0);
        }
    }
    wrong.iter().filter(|w| **w).count()
}

/// Which frames have finite positions only, cloth and body.
pub fn sound(clip: &Clip) -> Vec<bool> {
    let finite = |x: &[DVec3]| x.iter().all(|v| v.is_finite());
    let one =
        |t: usize| finite(&clip.drape.frames[t]) && clip.body.get(t).is_none_or(|b| finite(b));
    (0..clip.drape.frames.len()).map(one).collect()
}

/// How many coordinates are not finite.
pub fn non_finite(clip: &Clip) -> usize {
    let all = clip.drape.frames.iter().chain(&clip.body).flatten();
    all.map(|v| v.to_array().iter().filter(|c| !c.is_finite()).count())
        .sum()
}

/// Mean way of the vertices from the first to the last frame that is `sound`, as in ten seconds [m], if the body is still
/// in all of them.
pub fn drift(clip: &Clip, sound: &[bool]) -> Option<f64> {
    let all: Vec<usize> = (0..clip.drape.frames.len()).filter(|t| sound[*t]).collect();
    let (first, last) = (*all.first()?, *all.last()?);
    let still = clip.body.get(first)?;
    let moved = |t: &usize| {
        let body = clip.body.get(*t).into_iter().flatten();
        still.iter().zip(body).any(|(a, b)| a.distance(*b) > 1e-6)
    };
    if first == last || all.iter().any(moved) {
        return None;
    }
    let pairs = clip.drape.frames[first]
        .iter()
        .zip(&clip.drape.frames[last]);
    let way = super::mean(pairs.map(|(a, b)| a.distance(*b)));
    Some(way * 10.0 * clip.drape.fps / (last - first) as f64)
}
