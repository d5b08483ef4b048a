//! Playing a model: pose in, vertices out.

use glam::DAffine3;
use muslin_body::{Avatar, Pose};
use muslin_net::learn::{Linear, Nonlinear};

use crate::blocks::{Blocks, Wide};
use crate::decode::{Affine, Many, One};
use crate::{Model, ModelError, Reader};

/// Frames that [`Player::frames`] works on together.
const BATCH: usize = 32;

/// Plays a [`Model`]; all memory it needs is taken when it is made.
#[derive(Clone, Debug)]
pub struct Player {
    reader: Reader,
    scale: Vec<[f32; 2]>,
    /// Layers: weights by input, then output; bias.
    layers: Vec<Layer>,
    bend: Nonlinear,
    blocks: Blocks,
    /// The model's bones in the avatar's rig.
    rig: Vec<usize>,
    input: Vec<f32>,
    hidden: [Vec<f32>; 2],
    /// Codes and bones of a batch.
    codes: Vec<f32>,
    affine: Vec<Affine>,
    room: Vec<Wide>,
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
        let blocks = Blocks::new(model);
        Ok(Self {
            input: vec![0.0; reader.n_inputs()],
            reader,
            scale: model.scale.clone(),
            layers: layers(model),
            bend: model.encoder.bend,
            affine: vec![[0.0; 12]; BATCH * rig.len()],
            rig,
            hidden: [vec![0.0; widest], vec![0.0; widest]],
            codes: vec![0.0; BATCH * blocks.n_codes],
            room: vec![Wide::default(); 3 * blocks.n_codes],
            blocks,
        })
    }

    /// How many vertices a frame has.
    pub fn n_verts(&self) -> usize {
        self.blocks.n_verts
    }

    /// The cloth [m] in a pose; `bones` is `world_from_rest` of all of the rig, as
    /// [`Avatar::bones`] gives it. `out` has one entry per vertex.
    ///
    /// # Panics
    /// Where `out` is of another length.
    pub fn frame(&mut self, pose: &Pose, bones: &[DAffine3], out: &mut [[f32; 3]]) {
        assert_eq!(out.len(), self.n_verts(), "one entry per vertex");
        self.read((pose, bones), 0);
        pulp::Arch::new().dispatch(One {
            blocks: &self.blocks,
            codes: &self.codes[..self.blocks.n_codes],
            bones: &self.affine[..self.rig.len()],
            out,
        });
    }

    /// The cloth [m] in several poses, as [`Player::frame`] gives it one by one, in less time.
    ///
    /// `out` has one entry per vertex of each pose, pose after pose.
    ///
    /// # Panics
    /// Where `out` is of another length.
    pub fn frames(&mut self, poses: &[(&Pose, &[DAffine3])], out: &mut [[f32; 3]]) {
        assert_eq!(
            out.len(),
            poses.len() * self.n_verts(),
            "one entry per vertex of each pose"
        );
        let lots = out.chunks_mut(BATCH * self.n_verts().max(1));
        for (poses, out) in poses.chunks(BATCH).zip(lots) {
            for (slot, pose) in poses.iter().enumerate() {
                self.read(*pose, slot);
            }
            pulp::Arch::new().dispatch(Many {
                blocks: &self.blocks,
                codes: &self.codes[..poses.len() * self.blocks.n_codes],
                bones: &self.affine[..poses.len() * self.rig.len()],
                room: &mut self.room,
                out,
            });
        }
    }

    /// Codes and bones of a pose into a slot of the batch.
    fn read(&mut self, (pose, bones): (&Pose, &[DAffine3]), slot: usize) {
        self.reader.read(pose, bones, &mut self.input);
        for (x, [mean, scale]) in self.input.iter_mut().zip(&self.scale) {
            *x = (*x - mean) * scale;
        }
        let n = self.rig.len();
        let own = &mut self.affine[slot * n..(slot + 1) * n];
        for (a, &b) in own.iter_mut().zip(&self.rig) {
            *a = bones[b].to_cols_array().map(|x| x as f32);
        }
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.encode(slot),
        );
    }

    #[inline(always)]
    fn encode(&mut self, slot: usize) {
        let last = self.layers.len() - 1;
        let [mut from, mut to] = std::mem::take(&mut self.hidden);
        from[..self.input.len()].copy_from_slice(&self.input);
        for (k, layer) in self.layers.iter().enumerate() {
            let out = &mut to[..layer.bias.len()];
            out.copy_from_slice(&layer.bias);
            for (lot, rows) in from.chunks(4).zip(layer.weights.chunks(4 * out.len())) {
                gather(out, lot, rows);
            }
            if k < last {
                self.bend.forward(out, &mut from[..out.len()]);
            }
        }
        let n = self.blocks.n_codes;
        let own = &mut self.codes[slot * n..(slot + 1) * n];
        for ((code, z), worth) in own.iter_mut().zip(&to).zip(&self.blocks.by_code) {
            *code = z * worth;
        }
        self.hidden = [from, to];
    }
}

/// Adds up to four inputs, each times its row of weights.
#[inline(always)]
fn gather(out: &mut [f32], x: &[f32], rows: &[f32]) {
    let n = out.len();
    match (x, rows.len() == 4 * n) {
        ([a, b, c, d], true) => {
            let (r, s) = (&rows[..n], &rows[n..2 * n]);
            let (t, u) = (&rows[2 * n..3 * n], &rows[3 * n..]);
            for i in 0..n {
                out[i] += (r[i] * a + s[i] * b) + (t[i] * c + u[i] * d);
            }
        }
        _ => {
            for (x, row) in x.iter().zip(rows.chunks_exact(n)) {
                out.iter_mut().zip(row).for_each(|(y, w)| *y += w * x);
            }
        }
    }
}

fn layers(model: &Model) -> Vec<Layer> {
    let mut rest = model.params.as_slice();
    let one = |l: Linear| {
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
