//! Skin that swings do not take cloth through.

use std::collections::BTreeMap;

use glam::{Mat3A, Vec3A};
use muslin_net::learn::{Mlp, Nonlinear};
use pulp::Simd;

use crate::decode::{Affine, Points};
use crate::layers::Dense;
use crate::{Encoder, Model, Skin, Sway};

/// Rounds over the walls in a step.
const ROUNDS: usize = 3;
/// How near to the skin cloth may swing [m], and how far it may wherever it lies: held by every fold that touches,
/// a shirt would not swing at all.
const NEAR: f32 = 0.004;
const LEAST: f32 = 0.001;
/// What [`faint`] takes of the most moved cloth: less leaves a dress that swings otherwise when it is turned about.
const FAINT: f32 = 0.05;

/// Walls of a model: `n·(x - f + Φ q)` stays beyond [`NEAR`], or no more than
/// [`LEAST`] below where the pose alone leaves it.
///
/// Skin and the cloth above it turn alike, nearly: the way `n` out of the skin is, in the frame of the cloth, what it
/// is at rest, and only the room before it is found in every pose.
#[derive(Clone, Debug)]
pub(crate) struct Walls {
    /// The cloth's vertices as the pose alone lays them, the skin's points, and the ways out of it there at rest.
    cloth: Points,
    skin: Points,
    outs: Vec<Vec3A>,
    /// Room for where both are [m].
    verts: Vec<[f32; 3]>,
    feet: Vec<(Vec3A, Mat3A)>,
    /// `nᵀ Φ` of every wall, one entry per swing.
    pub ways: Vec<f32>,
    /// How far each may swing towards its skin [m].
    rooms: Vec<f32>,
    /// How far swings take each towards it [m], and room for that.
    towards: Dense,
    all: Vec<f32>,
    /// `A⁻¹ a`, with `A` the system of a step, and `1 / (aᵀ A⁻¹ a + ε)` ([`faint`]).
    pub pushes: Vec<f32>,
    pub gains: Vec<f32>,
}

impl Walls {
    pub fn new(model: &Model, sway: &Sway) -> Self {
        let (k, n) = (sway.len(), sway.walls.len());
        let mut ways = Vec::with_capacity(n * k);
        for w in &sway.walls {
            let rows = &sway.shapes[3 * w.vertex as usize * k..][..3 * k];
            let [x, y, z] = w.out;
            ways.extend((0..k).map(|c| x * rows[c] + y * rows[k + c] + z * rows[2 * k + c]));
        }
        let params: Vec<f32> = ways.iter().map(|a| -a).chain(vec![0.0; n]).collect();
        let verts = sway.walls.iter().map(|w| w.vertex as usize);
        Self {
            verts: vec![[0.0; 3]; n],
            feet: vec![(Vec3A::ZERO, Mat3A::ZERO); n],
            outs: (sway.walls.iter().map(|w| Vec3A::from_array(w.out))).collect(),
            cloth: Points::of(&some_of(model, verts)),
            skin: Points::of(&below(sway)),
            rooms: vec![0.0; n],
            towards: Dense::of(k, n, &params),
            all: vec![0.0; n],
            pushes: vec![0.0; ways.len()],
            gains: vec![0.0; n],
            ways,
        }
    }

    /// Gets ready for steps of that inverse system.
    pub fn ready(&mut self, inverse: &[f32]) {
        let k = self.ways.len() / self.rooms.len().max(1);
        if k == 0 {
            return;
        }
        let pushes = self.pushes.chunks_exact_mut(k);
        for ((push, way), gain) in (pushes.zip(self.ways.chunks_exact(k))).zip(&mut self.gains) {
            for (p, row) in push.iter_mut().zip(inverse.chunks_exact(k)) {
                *p = dot(row, way);
            }
            *gain = dot(push, way);
        }
        let faint = faint(self.gains.iter().copied()).max(f32::MIN_POSITIVE);
        (self.gains.iter_mut()).for_each(|g| *g = 1.0 / (*g + faint));
    }

    /// Finds the rooms of a pose, which mixes shapes by `z`.
    #[inline(always)]
    pub fn stand(&mut self, z: &[f32], bones: &[Affine]) {
        if self.rooms.is_empty() {
            return;
        }
        self.cloth.laid((z, bones), &mut self.verts);
        self.skin.turned((&[], bones), &mut self.feet);
        let points = self.verts.iter().zip(&self.feet).zip(&self.outs);
        for (room, ((x, (foot, turn)), out)) in self.rooms.iter_mut().zip(points) {
            let out = (*turn * *out).normalize_or_zero();
            *room = (out.dot(Vec3A::from_array(*x) - *foot) - NEAR).max(LEAST);
        }
    }

    /// Codes that leave all of them in front of the skin, as far as a few rounds get.
    #[inline(always)]
    pub fn hold<S: Simd>(&mut self, on: S, q: &mut [f32]) {
        if self.rooms.is_empty() {
            return;
        }
        let k = q.len();
        for _ in 0..ROUNDS {
            self.towards.apply(on, q, &mut self.all);
            let mut held = true;
            for (w, (by, room)) in self.all.iter().zip(&self.rooms).enumerate() {
                if by <= room {
                    continue;
                }
                held = false;
                let row = w * k..(w + 1) * k;
                let behind = -room - dot(&self.ways[row.clone()], q);
                if behind > 0.0 {
                    let by = behind * self.gains[w];
                    let push = &self.pushes[row];
                    q.iter_mut().zip(push).for_each(|(q, p)| *q += by * p);
                }
            }
            if held {
                return;
            }
        }
    }
}

/// Some of its vertices, as a cloth of their own that does not swing.
pub(crate) fn some_of(model: &Model, verts: impl Iterator<Item = usize> + Clone) -> Model {
    let row = 3 * model.n_codes();
    let laid = model.laid();
    let modes = (verts.clone()).flat_map(|v| &model.modes[v * row..(v + 1) * row]);
    points(
        model.encoder.clone(),
        (
            verts.clone().map(|v| laid[v]).collect(),
            modes.copied().collect(),
        ),
        skin(verts.map(|v| model.skin.row(v))),
    )
}

/// The skin's points, as a cloth that no pose corrects.
fn below(sway: &Sway) -> Model {
    let nothing = Mlp {
        widths: vec![0],
        bend: Nonlinear::Silu,
        bias: false,
    };
    let template: Vec<[f32; 3]> = sway.walls.iter().map(|w| w.foot).collect();
    let rows = (sway.walls.iter()).map(|w| w.bones.map(usize::from).into_iter().zip(w.weights));
    let modes = vec![0.0; 3 * template.len()];
    points(Encoder::Plain(nothing), (template, modes), skin(rows))
}

/// Points without triangles, of which nothing is known but where they go.
fn points(encoder: Encoder, (template, modes): (Vec<[f32; 3]>, Vec<f32>), skin: Skin) -> Model {
    Model {
        notes: BTreeMap::new(),
        faces: Vec::new(),
        bones: Vec::new(),
        drivers: Vec::new(),
        traits: Vec::new(),
        scale: Vec::new(),
        params: Vec::new(),
        sway: None,
        resizer: None,
        template,
        skin,
        encoder,
        modes,
    }
}

/// How points follow bones by these rows.
fn skin<R: Iterator<Item = (usize, f32)>>(rows: impl Iterator<Item = R>) -> Skin {
    let mut out = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for row in rows {
        for (bone, weight) in row {
            out.bones.push(bone as u8);
            out.weights.push(weight);
        }
        out.starts.push(out.bones.len() as u32);
    }
    out
}

/// How softly walls push and ties pull, from how far a unit push moves the cloth of each: where swings hardly move
/// it, to lead it back would throw all other cloth about.
pub(crate) fn faint(moved: impl Iterator<Item = f32>) -> f32 {
    FAINT * moved.fold(0.0, f32::max)
}

/// Of two rows of one length.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let (a, b) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (r, c) in a.0.iter().zip(b.0) {
        (0..8).for_each(|i| sums[i] += r[i] * c[i]);
    }
    let rest = a.1.iter().zip(b.1).map(|(r, c)| r * c);
    sums.iter().sum::<f32>() + rest.sum::<f32>()
}
