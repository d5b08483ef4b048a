//! One garment on many wearers at once.

use glam::DAffine3;
use muslin_body::{Avatar, Pose};
use rayon::prelude::*;

use crate::player::Memory;
use crate::{Model, ModelError, Player};

/// Plays a [`Model`] on many wearers of one body at once, each in a motion of its own: on a CUDA device, or on all cores.
///
/// Moments are told to all wearers together, and a wearer's follow each other in time, as a [`Player`]'s frames do.
#[derive(Debug)]
pub struct Crowd(Kind);

#[derive(Debug)]
enum Kind {
    Cores(Cores),
    #[cfg(feature = "cuda")]
    Cuda(Box<crate::cuda::OnDevice>),
}

/// Why a crowd cannot be played.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CrowdError {
    /// The model fits no such body.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The program was made without the means.
    #[error("this program was built without CUDA; build it with `--features cuda`")]
    NotBuilt,
    /// Nothing here can play it.
    #[error("no CUDA device: {0}")]
    NoDevice(String),
    /// What of the model no device plays.
    #[error("{0} are played on cores alone, not on CUDA devices")]
    NotThere(&'static str),
    /// The device gave up.
    #[error("the CUDA device failed: {0}")]
    Failed(String),
}

impl Crowd {
    /// On a CUDA device if there is one that can, else on all cores.
    pub fn new(model: &Model, avatar: &Avatar, wearers: usize) -> Result<Self, ModelError> {
        match Self::on_cuda(model, avatar, wearers) {
            Ok(crowd) => Ok(crowd),
            Err(CrowdError::Model(e)) => Err(e),
            Err(_) => Self::on_cores(model, avatar, wearers),
        }
    }

    /// On the cores of this machine, whatever else it has.
    pub fn on_cores(model: &Model, avatar: &Avatar, wearers: usize) -> Result<Self, ModelError> {
        let mut player = Player::new(model, avatar)?;
        Ok(Self(Kind::Cores(Cores {
            n_verts: player.n_verts(),
            wearers: vec![player.memory(); wearers],
            players: vec![player; rayon::current_num_threads()],
            moments: 0,
            x: Vec::new(),
            normals: Vec::new(),
        })))
    }

    /// On the first CUDA device.
    ///
    /// # Errors
    /// Also where there is none, or the program was built without the feature `cuda`.
    pub fn on_cuda(model: &Model, avatar: &Avatar, wearers: usize) -> Result<Self, CrowdError> {
        #[cfg(feature = "cuda")]
        {
            let on = crate::cuda::OnDevice::new(model, avatar, wearers)?;
            Ok(Self(Kind::Cuda(Box::new(on))))
        }
        #[cfg(not(feature = "cuda"))]
        {
            let _ = (model, avatar, wearers);
            Err(CrowdError::NotBuilt)
        }
    }

    /// What it is played on.
    pub fn place(&self) -> String {
        match &self.0 {
            Kind::Cores(_) => match rayon::current_num_threads() {
                1 => "one core".into(),
                n => format!("{n} cores"),
            },
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.name(),
        }
    }

    /// How many vertices a frame has.
    pub fn n_verts(&self) -> usize {
        match &self.0 {
            Kind::Cores(c) => c.n_verts,
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.n_verts(),
        }
    }

    /// All sequences start anew, as [`Player::begin`] says.
    pub fn begin(&mut self, step: f64) -> Result<(), CrowdError> {
        match &mut self.0 {
            Kind::Cores(c) => c.begin(step),
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.begin(step)?,
        }
        Ok(())
    }

    /// How much motion counts: [`Player::set_motion_level`].
    pub fn set_motion_level(&mut self, level: f32) {
        match &mut self.0 {
            Kind::Cores(c) => (c.players.iter_mut()).for_each(|p| p.set_motion_level(level)),
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.set_motion_level(level),
        }
    }

    /// The next moments: first all wearers' poses of the first, then of the second, and so on; each with
    /// `world_from_rest` of all bones of the rig. What came of the moments before is forgotten.
    ///
    /// # Panics
    /// Where a moment lacks wearers.
    pub fn play(&mut self, poses: &[(&Pose, &[DAffine3])]) -> Result<(), CrowdError> {
        match &mut self.0 {
            Kind::Cores(c) => c.play(poses),
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.play(poses)?,
        }
        Ok(())
    }

    /// The cloth [m] and its unit normals on a wearer in a moment of the last [`Crowd::play`].
    ///
    /// # Panics
    /// Where there is no such moment or wearer, or a slice is not of one entry per vertex.
    pub fn read(
        &mut self,
        (moment, wearer): (usize, usize),
        (out, normals): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) -> Result<(), CrowdError> {
        match &mut self.0 {
            Kind::Cores(c) => {
                let span = c.span(moment, wearer);
                out.copy_from_slice(&c.x[span.clone()]);
                normals.copy_from_slice(&c.normals[span]);
            }
            #[cfg(feature = "cuda")]
            Kind::Cuda(on) => on.read((moment, wearer), (out, normals))?,
        }
        Ok(())
    }
}

/// A player each core, which goes from wearer to wearer.
#[derive(Debug)]
struct Cores {
    n_verts: usize,
    players: Vec<Player>,
    /// What is remembered of every wearer.
    wearers: Vec<Memory>,
    moments: usize,
    /// Of every wearer in every moment.
    x: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

impl Cores {
    fn begin(&mut self, step: f64) {
        self.players.iter_mut().for_each(|p| p.begin(step));
        if let Some(player) = self.players.first_mut() {
            self.wearers.fill(player.memory());
        }
    }

    fn play(&mut self, poses: &[(&Pose, &[DAffine3])]) {
        let wearers = self.wearers.len();
        let moments = moments(poses.len(), wearers);
        self.moments = moments;
        let lot = moments * self.n_verts;
        self.x.resize(wearers * lot, [0.0; 3]);
        self.normals.resize(wearers * lot, [0.0; 3]);
        if lot == 0 {
            return;
        }
        let share = wearers.div_ceil(self.players.len());
        let room =
            (self.x.par_chunks_mut(share * lot)).zip(self.normals.par_chunks_mut(share * lot));
        let all = (self.wearers.par_chunks_mut(share).zip(room)).zip(&mut self.players);
        all.enumerate().for_each(|(part, ((own, room), player))| {
            let pose = |who: usize, moment: usize| poses[moment * wearers + part * share + who];
            player.frames_of_many((own, moments), pose, room);
        });
    }

    fn span(&self, moment: usize, wearer: usize) -> std::ops::Range<usize> {
        assert!(moment < self.moments, "no moment {moment}");
        let at = (wearer * self.moments + moment) * self.n_verts;
        at..at + self.n_verts
    }
}

/// How many moments so many poses are.
pub(crate) fn moments(poses: usize, wearers: usize) -> usize {
    let n = poses / wearers.max(1);
    assert_eq!(n * wearers, poses, "a pose of every wearer in every moment");
    n
}
