//! A model as a device reads it: two arrays, and where what lies in them.

use crate::fans::Fans;
use crate::layers::{Chain, Dense};
use crate::swing::{Swing, n_swings};
use crate::{Encoder, FOLLOWED, Model, Skin, Sway, Wall};

/// The twin of `Layout` in `cuda/kernels.cu`, which says what each is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Layout {
    pub n_verts: u32,
    pub n_codes: u32,
    pub n_posed: u32,
    pub n_swings: u32,
    pub n_bones: u32,
    pub n_points: u32,
    pub n_walls: u32,
    pub n_ties: u32,
    pub n_state: u32,
    base: u32,
    shapes: u32,
    weights: u32,
    starts: u32,
    bones: u32,
    fans: u32,
    spans: u32,
    around: u32,
    masses: u32,
    still: u32,
    lie: u32,
    point_weights: u32,
    means: u32,
    damping: u32,
    inverse: u32,
    point_starts: u32,
    point_bones: u32,
    wall_still: u32,
    wall_lie: u32,
    wall_weights: u32,
    feet: u32,
    feet_weights: u32,
    ways: u32,
    pushes: u32,
    gains: u32,
    wall_starts: u32,
    wall_bones: u32,
    feet_bones: u32,
    longest: u32,
    pairs: u32,
    step: f32,
    tau: f32,
    faint: f32,
}

/// Out of the skin from its point [m]: two points that bones carry, between which the way out lies in a pose.
const TIP: f32 = 0.05;

/// The skin's point below a vertex, and one out of the skin from there [m].
fn foot_and_tip(w: &Wall) -> [[f32; 3]; 2] {
    [w.foot, std::array::from_fn(|i| w.foot[i] + TIP * w.out[i])]
}

/// From the pose's codes to where vertices are before they are carried, axis by axis [m].
fn still(model: &Model, verts: impl Iterator<Item = usize> + Clone) -> Dense {
    let codes = model.n_codes() - 1;
    let rows = verts.flat_map(|v| (0..3).map(move |axis| (v, axis)));
    let row = |(v, axis): (usize, usize)| &model.modes[(3 * v + axis) * (codes + 1)..][..=codes];
    let mixed = rows.clone().flat_map(|r| &row(r)[..codes]);
    let at = rows
        .clone()
        .map(|r| model.template[r.0][r.1] + row(r)[codes]);
    let params: Vec<f32> = mixed.copied().chain(at).collect();
    Dense::of(codes, rows.count(), &params)
}

#[cfg(test)]
impl Layout {
    /// As it lies in memory.
    fn bytes(&self) -> Vec<u8> {
        let debug = format!("{self:?}");
        let fields = debug.trim_start_matches("Layout {").trim_end_matches('}');
        let numbers = fields.split(',').map(|f| {
            let (name, value) = f.split_once(": ").expect("a field has a name");
            match name.trim() {
                "step" => self.step.to_le_bytes(),
                "tau" => self.tau.to_le_bytes(),
                "faint" => self.faint.to_le_bytes(),
                _ => value.trim().parse::<u32>().expect("a number").to_le_bytes(),
            }
        });
        numbers.flatten().collect()
    }
}

/// The most swings that a device plays.
const MOST_SWINGS: usize = 64;

/// A network whose codes depend on the pose alone.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    /// Numbers in, then the size of every layer.
    pub widths: Vec<u32>,
    /// Layer by layer: weights by input, then output; biases.
    pub params: Vec<f32>,
    /// The kernels' number of the nonlinearity.
    pub bend: u32,
    /// Whether the last layer is bent as well.
    pub bends_last: bool,
}

impl Network {
    fn new(chain: &Chain, inputs: usize) -> Self {
        let outputs = chain.layers.iter().map(|l| l.outputs() as u32);
        Self {
            widths: std::iter::once(inputs as u32).chain(outputs).collect(),
            params: (chain.layers.iter())
                .flat_map(|l| l.by_input().chain(l.bias.iter().copied()))
                .collect(),
            bend: 1 + chain.bend as u32,
            bends_last: chain.bends_last,
        }
    }
}

/// All of a model that a device needs.
#[derive(Clone, Debug)]
pub(crate) struct Tables {
    pub layout: Layout,
    pub floats: Vec<f32>,
    pub numbers: Vec<u32>,
    pub network: Network,
    swing: Option<Swing>,
}

impl Tables {
    /// Of a model; else what of it a device does not play.
    pub fn new(model: &Model) -> Result<Self, &'static str> {
        let (mlp, bends_last) = match &model.encoder {
            Encoder::Plain(m) => (m, false),
            Encoder::Pbns(m) => (m, true),
            Encoder::Snug(_) | Encoder::Ncs(_) => return Err("networks that remember poses"),
        };
        if n_swings(model) > MOST_SWINGS {
            return Err("more than 64 swings");
        }
        // A device asks nobody whether a place is in an array.
        if !fits(model) {
            return Err("models whose parts do not fit each other");
        }
        let chain = Chain::new(mlp, &model.params, bends_last);
        let mut out = Self {
            layout: Layout {
                n_verts: model.n_verts() as u32,
                n_posed: model.n_codes() as u32 - 1,
                n_swings: n_swings(model) as u32,
                n_codes: (model.n_codes() - 1 + n_swings(model)) as u32,
                n_bones: model.bones.len() as u32,
                ..Layout::default()
            },
            floats: Vec::new(),
            numbers: Vec::new(),
            network: Network::new(&chain, mlp.widths[0]),
            swing: None,
        };
        out.cloth(model);
        if let (Some(sway), Some(swing)) = (&model.sway, Swing::new(model)) {
            out.points(model, sway, &swing);
            out.walls(model, sway, &swing);
            out.swing = Some(swing);
        }
        Ok(out)
    }

    /// Where floats begin that are added here.
    fn put(&mut self, all: impl IntoIterator<Item = f32>) -> u32 {
        let at = self.floats.len() as u32;
        self.floats.extend(all);
        at
    }

    fn put_numbers(&mut self, all: impl IntoIterator<Item = u32>) -> u32 {
        let at = self.numbers.len() as u32;
        self.numbers.extend(all);
        at
    }

    /// Vertices, shapes, bones and neighbours.
    fn cloth(&mut self, model: &Model) {
        let (n, row) = (model.n_verts(), model.n_codes());
        let laid = model.laid();
        let fixed = |v: usize, axis: usize| model.modes[(3 * v + axis) * row + row - 1];
        let axes = (0..3).flat_map(|axis| (0..n).map(move |v| (v, axis)));
        self.layout.base = self.put(axes.clone().map(|(v, a)| laid[v][a] + fixed(v, a)));
        self.layout.shapes = self.floats.len() as u32;
        for c in 0..row - 1 {
            self.put(
                axes.clone()
                    .map(|(v, a)| model.modes[(3 * v + a) * row + c]),
            );
        }
        if let Some(sway) = &model.sway {
            let k = sway.len();
            for c in 0..k {
                self.put(axes.clone().map(|(v, a)| sway.shapes[(3 * v + a) * k + c]));
            }
        }
        [self.layout.starts, self.layout.bones, self.layout.weights] =
            self.followed(&model.skin, 0..n);
        let fans = Fans::new(&model.faces, n);
        self.layout.fans = self.put_numbers(fans.starts);
        self.layout.spans = self.put_numbers(fans.spans);
        self.layout.around = self.put_numbers(fans.around);
    }

    /// Where the bones of these vertices start, the bones, and how much they are followed.
    fn followed(&mut self, skin: &Skin, verts: impl Iterator<Item = usize> + Clone) -> [u32; 3] {
        let mut end = 0;
        let ends = verts.clone().map(|v| {
            end += skin.row(v).count() as u32;
            end
        });
        let starts: Vec<u32> = std::iter::once(0).chain(ends).collect();
        let rows = verts.flat_map(|v| skin.row(v));
        [
            self.put_numbers(starts),
            self.put_numbers(rows.clone().map(|e| e.0 as u32)),
            self.put(rows.map(|e| e.1)),
        ]
    }

    /// Points that stand for the cloth, and what ties them.
    fn points(&mut self, model: &Model, sway: &Sway, swing: &Swing) {
        let verts = || sway.samples.iter().map(|v| *v as usize);
        let mixed = still(model, verts());
        self.layout.masses = self.put(sway.masses.iter().copied());
        self.layout.still = self.put(mixed.by_input());
        self.layout.lie = self.put(mixed.bias);
        [
            self.layout.point_starts,
            self.layout.point_bones,
            self.layout.point_weights,
        ] = self.followed(&model.skin, verts());
        self.layout.means = self.put(sway.means.iter().copied());
        self.layout.damping = self.put(sway.damping.iter().copied());
        self.layout.inverse = self.put(swing.inverse.iter().copied());
        self.layout.longest = self.put(swing.ties.longest.iter().copied());
        self.layout.pairs = self.put_numbers(swing.ties.pairs.iter().flatten().copied());
        self.layout.n_points = sway.samples.len() as u32;
        self.layout.n_ties = swing.ties.pairs.len() as u32;
        self.layout.n_walls = sway.walls.len() as u32;
        let [n, k, w, t] = [
            self.layout.n_points,
            self.layout.n_swings,
            self.layout.n_walls,
            self.layout.n_ties,
        ];
        // Places and speeds of two frames and codes of two; frames of the points, pulls and places; rooms, ways, ties.
        self.layout.n_state = 12 * n + 2 * k + 18 * n + 2 * w + t;
    }

    fn walls(&mut self, model: &Model, sway: &Sway, swing: &Swing) {
        let verts = || sway.walls.iter().map(|w| w.vertex as usize);
        let mixed = still(model, verts());
        self.layout.wall_still = self.put(mixed.by_input());
        self.layout.wall_lie = self.put(mixed.bias);
        [
            self.layout.wall_starts,
            self.layout.wall_bones,
            self.layout.wall_weights,
        ] = self.followed(&model.skin, verts());
        self.layout.feet = self.put(sway.walls.iter().flat_map(foot_and_tip).flatten());
        let bones = (sway.walls.iter()).flat_map(|w| w.bones.map(u32::from));
        self.layout.feet_bones = self.put_numbers(bones);
        self.layout.feet_weights = self.put(sway.walls.iter().flat_map(|w| w.weights));
        self.layout.ways = self.put(swing.walls.ways.iter().copied());
        self.layout.pushes = self.put(swing.walls.pushes.iter().copied());
        self.layout.gains = self.put(swing.walls.gains.iter().copied());
        debug_assert_eq!(FOLLOWED, 4, "as the kernels have it");
    }

    /// For that many seconds from frame to frame: what depends on it.
    pub fn begin(&mut self, step: f64) {
        self.layout.step = step as f32;
        self.layout.tau = 2.0 / 3.0 * step as f32;
        let Some(swing) = &mut self.swing else {
            return;
        };
        swing.begin(step);
        self.layout.faint = swing.ties.faint;
        let parts = [
            (self.layout.inverse, &swing.inverse),
            (self.layout.pushes, &swing.walls.pushes),
            (self.layout.gains, &swing.walls.gains),
        ];
        for (at, part) in parts {
            self.floats[at as usize..][..part.len()].copy_from_slice(part);
        }
    }
}

/// Whether whatever names a vertex, a bone or an input names one that there is.
fn fits(model: &Model) -> bool {
    let (n, bones) = (model.n_verts(), model.bones.len());
    let told = model.encoder.n_told(model.traits.len());
    model.encoder.fits(model.drivers.len(), told)
        && model.skin.n_verts() == n
        && model.skin.bones.iter().all(|b| usize::from(*b) < bones)
        && model.sway.as_ref().is_none_or(|s| s.fits(n, bones))
}

#[cfg(test)]
mod tests;
