//! What a player reads of a pose.

use glam::DAffine3;
use muslin_body::{Avatar, Pose};

use crate::decode::Affine;
use crate::describe::found;
use crate::{Model, ModelError, Stream};

/// From poses to what the network is told, and to the bones that the cloth follows.
#[derive(Clone, Debug)]
pub(crate) struct Reading {
    stream: Stream,
    scale: Vec<[f32; 2]>,
    /// Numbers of the pose, and after them what does not change with it.
    n_posed: usize,
    told: Vec<f32>,
    /// The model's bones in the avatar's rig.
    rig: Vec<usize>,
}

impl Reading {
    /// Prepares `model` for bodies of this avatar.
    pub fn new(model: &Model, avatar: &Avatar) -> Result<Self, ModelError> {
        let n_posed = model.encoder.n_inputs(model.drivers.len());
        let told = model.traits.iter().zip(&model.scale[n_posed..]);
        Ok(Self {
            stream: Stream::new(&model.encoder, &model.drivers, avatar)?,
            scale: model.scale.clone(),
            n_posed,
            told: told
                .map(|(t, [mean, scale])| (t.value - mean) * scale)
                .take(model.encoder.n_told(model.traits.len()))
                .collect(),
            rig: found(avatar, &model.bones)?,
        })
    }

    /// Starts anew, with that many seconds from pose to pose.
    pub fn begin(&mut self, step: f64) {
        self.stream.begin(step);
    }

    /// How many numbers the network is told.
    pub fn n_inputs(&self) -> usize {
        self.n_posed + self.told.len()
    }

    /// How many bones the cloth follows.
    pub fn n_bones(&self) -> usize {
        self.rig.len()
    }

    /// Reads the next pose; `bones` is `world_from_rest` of all of the rig.
    pub fn read(
        &mut self,
        (pose, bones): (&Pose, &[DAffine3]),
        input: &mut [f32],
        own: &mut [Affine],
    ) {
        let (posed, told) = input.split_at_mut(self.n_posed);
        self.stream.read(pose, bones, posed);
        for (x, [mean, scale]) in posed.iter_mut().zip(&self.scale) {
            *x = (*x - mean) * scale;
        }
        told.copy_from_slice(&self.told);
        for (a, &b) in own.iter_mut().zip(&self.rig) {
            *a = bones[b].to_cols_array().map(|x| x as f32);
        }
    }
}
