//! What a trained garment consists of.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::{Encoder, Resizer, Sway};

/// Which bones move each vertex, and how strongly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// Where each vertex's entries start, and the end of the last.
    pub starts: Vec<u32>,
    /// Bone of each entry, as an index into [`Model::bones`].
    pub bones: Vec<u8>,
    /// Its weight; those of a vertex sum to one.
    pub weights: Vec<f32>,
}

impl Skin {
    /// How many vertices there are.
    pub fn n_verts(&self) -> usize {
        self.starts.len() - 1
    }

    /// The (bone, weight) entries of vertex `v`.
    pub fn row(&self, v: usize) -> impl Iterator<Item = (usize, f32)> + Clone {
        let span = self.starts[v] as usize..self.starts[v + 1] as usize;
        let bones = self.bones[span.clone()].iter().map(|b| usize::from(*b));
        bones.zip(self.weights[span].iter().copied())
    }
}

/// Something that a network is told besides the pose: of the wearer, or of the cloth.
#[derive(Clone, Debug, PartialEq)]
pub struct Trait {
    /// What it is.
    pub name: String,
    /// Its value: that of the first lesson, until another is told.
    pub value: f32,
    /// The least and the most that was taught.
    pub range: [f32; 2],
}

impl Trait {
    /// How its value stands: see [`Trait::level_of`].
    pub fn level(&self) -> f32 {
        self.level_of(self.value)
    }

    /// From -1, the least that was taught, to 1, the most; 0 where nothing else was.
    pub fn level_of(&self, value: f32) -> f32 {
        let [least, most] = self.range;
        match most > least {
            true => (2.0 * value - least - most) / (most - least),
            false => 0.0,
        }
    }
}

/// A garment that has learnt how to lie on a moving body.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What it is, on which body and from what it was trained, and under which terms.
    pub notes: BTreeMap<String, String>,
    /// Triangles.
    pub faces: Vec<[u32; 3]>,
    /// The cloth around the body at rest [m].
    pub template: Vec<[f32; 3]>,
    /// Bones that the cloth follows, by name.
    pub bones: Vec<String>,
    /// How it follows them.
    pub skin: Skin,
    /// Bones whose turns the network reads, by name; the first is the root.
    pub drivers: Vec<String>,
    /// What the network reads besides the pose: our own as a number after it, SNUG as a number of the body,
    /// [`Trait::level`].
    pub traits: Vec<Trait>,
    /// Mean and 1/deviation of every input over the training poses.
    pub scale: Vec<[f32; 2]>,
    /// The network from inputs to codes.
    pub encoder: Encoder,
    /// Its weights.
    pub params: Vec<f32>,
    /// `M` [m]: for every coordinate of every vertex a row with one entry per code; the last code
    /// is always one.
    pub modes: Vec<f32>,
    /// How the cloth swings, if that is known.
    pub sway: Option<Sway>,
    /// How it lies at rest on others, where that was taught on its own.
    pub resizer: Option<Resizer>,
}

impl Model {
    /// How many vertices the cloth has.
    pub fn n_verts(&self) -> usize {
        self.template.len()
    }

    /// One garment of an outfit that was taught as one: these vertices and triangles, under the same network. What
    /// swings is left out, for it is of the whole.
    ///
    /// # Panics
    /// Where a triangle has a corner outside of them.
    #[must_use]
    pub fn garment(&self, verts: Range<usize>, faces: Range<usize>) -> Self {
        let inside = |v: u32| {
            assert!(verts.contains(&(v as usize)), "a corner of another garment");
            v - verts.start as u32
        };
        let entries = &self.skin.starts[verts.start..=verts.end];
        let own = entries[0] as usize..entries[entries.len() - 1] as usize;
        let row = 3 * self.n_codes();
        Self {
            faces: (self.faces[faces].iter()).map(|f| f.map(inside)).collect(),
            template: self.template[verts.clone()].to_vec(),
            skin: Skin {
                starts: entries.iter().map(|s| s - entries[0]).collect(),
                bones: self.skin.bones[own.clone()].to_vec(),
                weights: self.skin.weights[own].to_vec(),
            },
            modes: self.modes[verts.start * row..verts.end * row].to_vec(),
            sway: None,
            resizer: self.resizer.as_ref().map(|r| Resizer {
                modes: r.modes[3 * verts.start * r.n_codes()..3 * verts.end * r.n_codes()].to_vec(),
                ..r.clone()
            }),
            ..self.clone()
        }
    }

    /// Whether its share of motion can be turned up and down.
    pub fn has_motion_level(&self) -> bool {
        self.encoder.has_motion_level() || self.sway.as_ref().is_some_and(|s| !s.is_empty())
    }

    /// The same for another wearer or cloth; what lies beyond all that was taught is taken as the nearest
    /// that was, and what is not said stays.
    #[must_use]
    pub fn told(mut self, value: impl Fn(&str) -> Option<f64>) -> Self {
        for t in &mut self.traits {
            if let Some(x) = value(&t.name) {
                t.value = (x as f32).clamp(t.range[0], t.range[1]);
            }
        }
        if let Encoder::Snug(s) = &mut self.encoder
            && !self.traits.is_empty()
        {
            s.body = self.traits.iter().map(Trait::level).collect();
        }
        self
    }

    /// How many codes there are, the one that is always one included.
    pub fn n_codes(&self) -> usize {
        self.encoder.n_codes() + 1
    }
}
