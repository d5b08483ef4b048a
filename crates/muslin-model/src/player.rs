//! Playing a model: pose in, vertices out.

use std::sync::Arc;

use glam::{DAffine3, Vec3A};
use muslin_body::{Avatar, Pose};
use pulp::Simd;

use crate::blocks::{Blocks, Wide};
use crate::decode::{Affine, One, Placed};
use crate::group::{GROUP, Group, Room};
use crate::mind::Mind;
use crate::reading::Reading;
use crate::steps::{self, Job, Sums, Two};
use crate::swing::{Past, Swing};
use crate::{Model, ModelError};

/// Seconds from pose to pose until a sequence says otherwise.
pub(crate) const STEP: f64 = 1.0 / 30.0;

/// Plays a [`Model`]; all memory it needs is taken when it is made.
///
/// A model that knows motion is told poses in the order of time; [`Player::begin`] starts anew. Copies share the shapes,
/// which are most of it.
#[derive(Clone, Debug)]
pub struct Player {
    reading: Reading,
    mind: Mind,
    swing: Option<Swing>,
    blocks: Arc<Blocks>,
    /// What the network is told.
    input: Vec<f32>,
    /// Codes and bones of a group.
    codes: Vec<f32>,
    affine: Vec<Affine>,
    room: Room,
    /// Codes of a frame in steps, and room for its vertices and its normals' lengths.
    twos: Vec<Two>,
    lie: Vec<Placed>,
    lengths: Vec<Wide>,
    /// Whether blocks come from the last on, as they do every other time.
    backwards: bool,
}

/// What a player remembers of a sequence, and what reads its poses.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    reading: Reading,
    states: Vec<Vec<f32>>,
    swing: Option<Past>,
}

impl Player {
    /// Prepares `model` for bodies of this avatar.
    pub fn new(model: &Model, avatar: &Avatar) -> Result<Self, ModelError> {
        let reading = Reading::new(model, avatar)?;
        let blocks = Blocks::new(model);
        let mut swing = Swing::new(model);
        swing.iter_mut().for_each(|s| s.begin(STEP));
        Ok(Self {
            swing,
            input: vec![0.0; reading.n_inputs()],
            mind: Mind::new(&model.encoder, &model.params),
            affine: vec![[0.0; 12]; GROUP * reading.n_bones()],
            codes: vec![0.0; GROUP * blocks.n_codes],
            room: Room::new(&blocks, reading.n_bones()),
            twos: vec![[0; 2]; blocks.n_twos()],
            lie: vec![[Vec3A::ZERO; 2]; blocks.n_verts],
            lengths: vec![Wide::default(); blocks.base.len()],
            backwards: false,
            reading,
            blocks: Arc::new(blocks),
        })
    }

    /// How many vertices a frame has.
    pub fn n_verts(&self) -> usize {
        self.blocks.n_verts
    }

    /// Starts a sequence: the next pose is its first, and the body came to it without motion.
    /// `step` is the time from pose to pose [s]; 1/30 s until it is said. Where a frame depends on
    /// its pose alone, this changes nothing.
    pub fn begin(&mut self, step: f64) {
        self.reading.begin(step);
        self.mind.begin();
        self.swing.iter_mut().for_each(|s| s.begin(step));
    }

    /// What it remembers.
    pub(crate) fn memory(&mut self) -> Memory {
        Memory {
            reading: self.reading.clone(),
            states: self.mind.cells().iter().map(|c| c.state.clone()).collect(),
            swing: self.swing.as_ref().map(|s| s.past.clone()),
        }
    }

    /// Goes on with another sequence of the same step, and leaves what it remembers of this one in its place.
    fn exchange(&mut self, memory: &mut Memory) {
        std::mem::swap(&mut self.reading, &mut memory.reading);
        for (cell, state) in self.mind.cells().iter_mut().zip(&mut memory.states) {
            std::mem::swap(&mut cell.state, state);
        }
        for (swing, past) in self.swing.iter_mut().zip(&mut memory.swing) {
            std::mem::swap(&mut swing.past, past);
        }
    }

    /// How much motion counts, where the model can tell it from the pose
    /// ([`Model::has_motion_level`]): 1 as it was taught, 0 as if the body stood still.
    pub fn set_motion_level(&mut self, level: f32) {
        self.swing.iter_mut().for_each(|s| s.level = level);
        if let Mind::Ncs(moving) = &mut self.mind {
            moving.level = level;
        }
    }

    /// The cloth [m] in a pose; `bones` is `world_from_rest` of all of the rig, as
    /// [`Avatar::bones`] gives it. `out` has one entry per vertex.
    ///
    /// # Panics
    /// Where `out` is of another length.
    pub fn frame(&mut self, pose: &Pose, bones: &[DAffine3], out: &mut [[f32; 3]]) {
        self.one((pose, bones), out, None);
    }

    /// [`Player::frame`], and the unit normals of its vertices: those of the faces around, weighted by area; up where no
    /// face has any.
    ///
    /// # Panics
    /// Where `out` or `normals` is of another length.
    pub fn frame_with_normals(
        &mut self,
        pose: &Pose,
        bones: &[DAffine3],
        (out, normals): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) {
        assert_eq!(normals.len(), self.n_verts(), "one normal per vertex");
        self.one((pose, bones), out, Some(normals));
    }

    fn one(
        &mut self,
        pose: (&Pose, &[DAffine3]),
        out: &mut [[f32; 3]],
        normals: Option<&mut [[f32; 3]]>,
    ) {
        assert_eq!(out.len(), self.n_verts(), "one entry per vertex");
        self.read(pose, 0);
        self.backwards = !self.backwards;
        steps::fastest(One {
            blocks: &self.blocks,
            codes: &self.codes[..self.blocks.n_codes],
            bones: &self.affine[..self.reading.n_bones()],
            twos: &mut self.twos,
            lie: &mut self.lie,
            backwards: self.backwards,
            out,
            normals: normals.map(|n| (&mut self.lengths[..], n)),
        });
    }

    /// The cloth [m] in several poses in the order of time, as [`Player::frame`] gives it one by
    /// one, in less time.
    ///
    /// `out` has one entry per vertex of each pose, pose after pose.
    ///
    /// # Panics
    /// Where `out` is of another length.
    pub fn frames(&mut self, poses: &[(&Pose, &[DAffine3])], out: &mut [[f32; 3]]) {
        self.many(poses, out, None);
    }

    /// [`Player::frames`], and the normals of [`Player::frame_with_normals`], in the same order.
    ///
    /// # Panics
    /// Where `out` or `normals` is of another length.
    pub fn frames_with_normals(
        &mut self,
        poses: &[(&Pose, &[DAffine3])],
        (out, normals): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) {
        assert_eq!(
            normals.len(),
            out.len(),
            "one normal per vertex of each pose"
        );
        self.many(poses, out, Some(normals));
    }

    fn many(
        &mut self,
        poses: &[(&Pose, &[DAffine3])],
        out: &mut [[f32; 3]],
        normals: Option<&mut [[f32; 3]]>,
    ) {
        assert_eq!(
            out.len(),
            poses.len() * self.n_verts(),
            "one entry per vertex of each pose"
        );
        let lot = GROUP * self.n_verts().max(1);
        let mut normals = normals.map(|n| n.chunks_mut(lot));
        for (poses, out) in poses.chunks(GROUP).zip(out.chunks_mut(lot)) {
            for (slot, pose) in poses.iter().enumerate() {
                self.read(*pose, slot);
            }
            let normals = normals.as_mut().and_then(Iterator::next);
            self.group(poses.len(), out, normals);
        }
    }

    /// The next moments of several sequences, one after the other; `pose` gives that of a sequence in a moment.
    pub(crate) fn frames_of_many<'a>(
        &mut self,
        (sequences, moments): (&mut [Memory], usize),
        pose: impl Fn(usize, usize) -> (&'a Pose, &'a [DAffine3]),
        (out, normals): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) {
        let (n, lot) = (sequences.len() * moments, GROUP * self.n_verts().max(1));
        let room = out.chunks_mut(lot).zip(normals.chunks_mut(lot));
        for (first, (out, normals)) in (0..n).step_by(GROUP).zip(room) {
            let slots = GROUP.min(n - first);
            for slot in 0..slots {
                let (who, moment) = ((first + slot) / moments, (first + slot) % moments);
                self.exchange(&mut sequences[who]);
                self.read(pose(who, moment), slot);
                self.exchange(&mut sequences[who]);
            }
            self.group(slots, out, Some(normals));
        }
    }

    /// The frames whose codes and bones are in so many slots.
    fn group(&mut self, slots: usize, out: &mut [[f32; 3]], normals: Option<&mut [[f32; 3]]>) {
        self.backwards = !self.backwards;
        steps::fastest(Group {
            blocks: &self.blocks,
            codes: &self.codes[..slots * self.blocks.n_codes],
            bones: &self.affine[..slots * self.reading.n_bones()],
            room: &mut self.room,
            backwards: self.backwards,
            out,
            normals,
        });
    }

    /// Codes and bones of a pose into a slot of the batch.
    fn read(&mut self, pose: (&Pose, &[DAffine3]), slot: usize) {
        let n = self.reading.n_bones();
        let own = &mut self.affine[slot * n..(slot + 1) * n];
        self.reading.read(pose, &mut self.input, own);
        steps::widely(Encode(self, slot));
    }

    #[inline(always)]
    fn encode<S: Simd>(&mut self, on: S, slot: usize) {
        let n = self.blocks.n_codes;
        let own = &mut self.codes[slot * n..(slot + 1) * n];
        let codes = self.mind.codes(on, &self.input);
        let (posed, swung) = own.split_at_mut(codes.len());
        posed.copy_from_slice(codes);
        if let Some(swing) = &mut self.swing {
            let m = self.reading.n_bones();
            swing.codes(on, (codes, &self.affine[slot * m..(slot + 1) * m]), swung);
        }
        for (code, worth) in own.iter_mut().zip(&self.blocks.by_code) {
            *code *= worth;
        }
    }
}

/// Codes of the pose that a player has read into a slot of its batch.
struct Encode<'a>(&'a mut Player, usize);

impl Job for Encode<'_> {
    #[inline(always)]
    fn run<S: Simd, M: Sums>(self, on: S, _: M) {
        self.0.encode(on, self.1);
    }
}
