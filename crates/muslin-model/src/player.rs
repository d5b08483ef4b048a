//! Playing a model: pose in, vertices out.

use glam::DAffine3;
use muslin_body::{Avatar, Pose};

use crate::{Model, ModelError, Reader};

/// Vertices that are computed side by side.
const WIDE: usize = 16;

/// Plays a [`Model`]; all memory it needs is taken when it is made.
#[derive(Clone, Debug)]
pub struct Player {
    reader: Reader,
    scale: Vec<[f32; 2]>,
    /// Layers: weights by input, then output; bias.
    layers: Vec<Layer>,
    bend: muslin_net::learn::Nonlinear,
    /// Rows of `M`, for 16 vertices at a time: `[group][axis][code][vertex]`.
    modes: Vec<[f32; WIDE]>,
    template: Vec<[f32; 3]>,
    skin: crate::Skin,
    /// The model's bones in the avatar's rig.
    rig: Vec<usize>,
    input: Vec<f32>,
    hidden: [Vec<f32>; 2],
    code: Vec<f32>,
    affine: Vec<[f32; 12]>,
}

#[derive(Clone, Debug)]
struct Layer {
    /// By input, then output.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Player {
    /// Prepares `model` for bodies of this avatar.
    pub fn new(model: &Model, avatar: &Avatar) -> Result<Self, ModelError> {
        let reader = Reader::new(avatar, &model.drivers)?;
        let find = |name: &String| {
            let bone = avatar.bone(name);
            bone.map_err(|_| ModelError::NoBone(name.clone()))
        };
        let rig = model
            .bones
            .iter()
            .map(find)
            .collect::<Result<Vec<_>, _>>()?;
        let widest = model.encoder.widths.iter().copied().max().unwrap_or(0);
        Ok(Self {
            input: vec![0.0; reader.n_inputs()],
            reader,
            scale: model.scale.clone(),
            layers: layers(model),
            bend: model.encoder.bend,
            modes: packed(&model.modes, model.n_codes()),
            template: model.template.clone(),
            skin: model.skin.clone(),
            affine: vec![[0.0; 12]; rig.len()],
            rig,
            hidden: [vec![0.0; widest], vec![0.0; widest]],
            code: vec![0.0; model.n_codes()],
        })
    }

    /// How many vertices a frame has.
    pub fn n_verts(&self) -> usize {
        self.template.len()
    }

    /// The cloth [m] in a pose; `bones` is `world_from_rest` of all of the rig, as
    /// [`Avatar::bones`] gives it.
    pub fn frame(&mut self, pose: &Pose, bones: &[DAffine3], out: &mut [[f32; 3]]) {
        self.reader.read(pose, bones, &mut self.input);
        for (x, [mean, scale]) in self.input.iter_mut().zip(&self.scale) {
            *x = (*x - mean) * scale;
        }
        for (a, &b) in self.affine.iter_mut().zip(&self.rig) {
            *a = bones[b].to_cols_array().map(|x| x as f32);
        }
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                self.encode();
                self.decode(out);
            },
        );
    }

    #[inline(always)]
    fn encode(&mut self) {
        let last = self.layers.len() - 1;
        let [mut from, mut to] = std::mem::take(&mut self.hidden);
        from[..self.input.len()].copy_from_slice(&self.input);
        for (k, layer) in self.layers.iter().enumerate() {
            let out = &mut to[..layer.bias.len()];
            out.copy_from_slice(&layer.bias);
            for (x, row) in from.iter().zip(layer.weights.chunks_exact(out.len())) {
                out.iter_mut().zip(row).for_each(|(y, w)| *y += w * x);
            }
            if k < last {
                self.bend.forward(out, &mut from[..out.len()]);
            }
        }
        let n = self.code.len() - 1;
        self.code[..n].copy_from_slice(&to[..n]);
        self.code[n] = 1.0;
        self.hidden = [from, to];
    }

    #[inline(always)]
    fn decode(&self, out: &mut [[f32; 3]]) {
        let n = self.code.len();
        for (g, out) in out.chunks_mut(WIDE).enumerate() {
            let group = &self.modes[g * 3 * n..(g + 1) * 3 * n];
            let mut d = [[0.0f32; WIDE]; 3];
            for axis in 0..3 {
                let mut sum = [0.0f32; WIDE];
                for (row, z) in group[axis * n..(axis + 1) * n].iter().zip(&self.code) {
                    for i in 0..WIDE {
                        sum[i] += row[i] * z;
                    }
                }
                d[axis] = sum;
            }
            for (i, out) in out.iter_mut().enumerate() {
                *out = self.skinned(g * WIDE + i, [d[0][i], d[1][i], d[2][i]]);
            }
        }
    }

    #[inline(always)]
    fn skinned(&self, v: usize, d: [f32; 3]) -> [f32; 3] {
        let mut a = [0.0f32; 12];
        for (b, w) in self.skin.row(v) {
            let bone = &self.affine[b];
            for k in 0..12 {
                a[k] += w * bone[k];
            }
        }
        let t = self.template[v];
        let p = [t[0] + d[0], t[1] + d[1], t[2] + d[2]];
        let axis = |i: usize| a[i] * p[0] + a[3 + i] * p[1] + a[6 + i] * p[2] + a[9 + i];
        [axis(0), axis(1), axis(2)]
    }
}

fn layers(model: &Model) -> Vec<Layer> {
    let mut rest = model.params.as_slice();
    let one = |l: muslin_net::learn::Linear| {
        let (own, later) = rest.split_at(l.n_params());
        rest = later;
        let (w, b) = own.split_at(l.inputs * l.outputs);
        let by_input = (0..l.inputs * l.outputs).map(|k| {
            let (i, o) = (k / l.outputs, k % l.outputs);
            w[o * l.inputs + i]
        });
        let bias = if b.is_empty() {
            vec![0.0; l.outputs]
        } else {
            b.to_vec()
        };
        Layer {
            weights: by_input.collect(),
            bias,
        }
    };
    model.encoder.layers().map(one).collect()
}

fn packed(modes: &[f32], n: usize) -> Vec<[f32; WIDE]> {
    let n_verts = modes.len() / (3 * n);
    let mut out = vec![[0.0; WIDE]; n_verts.div_ceil(WIDE) * 3 * n];
    for v in 0..n_verts {
        for axis in 0..3 {
            for k in 0..n {
                let row = (v / WIDE * 3 + axis) * n + k;
                out[row][v % WIDE] = modes[(3 * v + axis) * n + k];
            }
        }
    }
    out
}
