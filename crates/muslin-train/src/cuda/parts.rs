//! All arrays that a training has on a device, but bodies.

use muslin_model::CrowdError;

use super::upload::{Cloth, Solver, Worn};
use super::{Array, Device};
use crate::lanes::LANES;
use crate::trainer::Trainer;

/// Terms of the cost that a pack tells, pose by pose; then how much each counts, and what broke.
pub(super) const TERMS: usize = 6;
/// Parts that the rows of the shapes are summed in.
pub(super) const PARTS: u32 = 16;

/// All arrays on the device but bodies.
pub(super) struct Parts {
    pub cloth: Cloth,
    pub worn: Vec<Worn>,
    pub solver: Solver,
    pub slots: Vec<Slot>,
    pub learnt: Learnt,
    pub work: Room,
}

/// What is learnt, and what its steps remember.
pub(super) struct Learnt {
    pub params: Array,
    pub mean: Array,
    pub square: Array,
    pub modes: Array,
    pub momentum: Array,
}

/// A pack of a step.
pub(super) struct Slot {
    pub inputs: Array,
    /// What goes into each layer but the first, and comes out of each but the last before it is bent.
    pub bent: Vec<Array>,
    pub unbent: Vec<Array>,
    pub codes: Array,
    pub bones: Array,
    pub x: Array,
    pub at: Array,
    pub told: Array,
}

/// Room to work in.
pub(super) struct Room {
    pub planes: Array,
    pub forces: Array,
    pub stretch: Array,
    pub costs: Array,
    pub broken: Array,
    pub g: Array,
    pub weighed: Array,
    pub parts: Array,
    /// Slopes in what layers give, in turns.
    pub back: [Array; 2],
    pub unused: Array,
    pub fold_of: Array,
    pub d_params: Array,
    pub d_modes: Array,
    pub moments: Array,
    pub held: Array,
    pub solved: Array,
    pub inverse: Array,
    pub moves: Array,
    pub far: Array,
    pub by: Array,
}

impl Parts {
    pub fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
        let (n, k) = (trainer.wearers[0].cut.n_verts(), trainer.plan.codes);
        let n_params = trainer.encoder.n_params();
        let room = |n: usize| device.room(n);
        let worn = trainer.wearers.iter().map(|w| Worn::new(device, w));
        let slots = (0..trainer.plan.packs).map(|_| Slot::new(trainer, device));
        Ok(Self {
            cloth: Cloth::new(device, &trainer.wearers[0].cut, &trainer.skin)?,
            worn: worn.collect::<Result<_, _>>()?,
            solver: Solver::new(device, &trainer.factor)?,
            slots: slots.collect::<Result<_, _>>()?,
            learnt: Learnt {
                params: room(n_params)?,
                mean: room(n_params)?,
                square: room(n_params)?,
                modes: room(3 * n * k)?,
                momentum: room(3 * n * k)?,
            },
            work: Room::new(trainer, device)?,
        })
    }
}

impl Slot {
    pub fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
        let (n, k) = (trainer.wearers[0].cut.n_verts(), trainer.plan.codes);
        let widths = &trainer.encoder.widths;
        let room = |n: usize| device.room(n);
        let inner = || -> Result<Vec<Array>, CrowdError> {
            let inner = widths[1..widths.len() - 1].iter();
            inner.map(|w| room(w * LANES)).collect()
        };
        // The last of the codes is one, always.
        let mut codes = vec![0.0; k * LANES];
        codes[(k - 1) * LANES..].fill(1.0);
        Ok(Self {
            inputs: room(widths[0] * LANES)?,
            bent: inner()?,
            unbent: inner()?,
            codes: device.put(&codes)?,
            bones: room(12 * trainer.rig.len() * LANES)?,
            x: room(3 * n * LANES)?,
            at: room(n * LANES)?,
            told: room((TERMS + 1) * LANES + 1)?,
        })
    }
}

impl Room {
    pub fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
        let (cut, k) = (&trainer.wearers[0].cut, trainer.plan.codes);
        let (n, n_faces) = (cut.n_verts(), cut.patches.len());
        let room = |n: usize| device.room(n);
        let blocks = |n: usize| device.blocks(n * LANES) as usize;
        let widest = trainer.encoder.widths.iter().max().copied().unwrap_or(1);
        Ok(Self {
            planes: room(4 * n * LANES)?,
            forces: room(6 * n_faces * LANES)?,
            stretch: room(blocks(n_faces) * LANES)?,
            costs: room(blocks(n) * (TERMS - 1) * LANES)?,
            broken: room(blocks(n))?,
            g: room(3 * n * LANES)?,
            weighed: room(k * LANES)?,
            parts: room(PARTS as usize * k * LANES)?,
            back: [room(widest * LANES)?, room(widest * LANES)?],
            unused: room(widest * LANES)?,
            fold_of: room(n)?,
            d_params: room(trainer.encoder.n_params())?,
            d_modes: room(3 * n * k)?,
            moments: room(k * k)?,
            held: room(6 * n)?,
            solved: room(3 * n * k)?,
            inverse: room(k * k)?,
            moves: room(3 * n * k)?,
            far: room(trainer.plan.packs * blocks(n))?,
            by: room(1)?,
        })
    }
}
