//! A training whose steps a device takes.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use muslin_body::Motion;
use muslin_model::{CrowdError, Model};
use muslin_net::Weights;
use muslin_net::learn::Adam;
use rayon::prelude::*;

use super::parts::{PARTS, Parts, TERMS};
use super::upload::{Skins, Solver, fold_of};
use super::{Array, Device, bits, told};
use crate::TrainError;
use crate::lanes::{LANES, Lane, Row};
use crate::laws::G;
use crate::pack::Pack;
use crate::trainer::{Energies, Told, Trainer};
use crate::training::{Training, left_out};
use crate::update::{FARTHEST, FLOOR, factors_at, inverse};
use crate::work::{PIN, Work};

/// Bodies that the device remembers, at most [bytes]; the others are told again.
const REMEMBERED: usize = 4 << 30;

/// A [`Trainer`] on a CUDA device: network, skinning, laws, walls, Adam and the step of the shapes are kernels there. Where
/// cloth is nearest to which skin, and where it meets itself, is looked for on this machine's cores now and then, as
/// they do in a [`Trainer`].
///
/// It learns the same but for the order of sums, the same bits in every run on one kind of device, and keeps what a
/// [`Trainer`] can go on with.
pub struct OnDevice<'a> {
    /// What of it lies on the device is older here while it is stale.
    host: RefCell<Trainer<'a>>,
    is_stale: Cell<bool>,
    device: Device,
    parts: Parts,
    skins: HashMap<u32, Skins>,
    /// How many bytes these are.
    bytes: usize,
}

impl<'a> OnDevice<'a> {
    /// From here on the device takes the steps of this training.
    ///
    /// # Errors
    /// [`TrainError::Device`] where it has no room, or fails; and the trainer as it was.
    pub fn new(
        trainer: Trainer<'a>,
        device: Device,
    ) -> Result<Self, (Box<Trainer<'a>>, TrainError)> {
        let failed = |trainer, e: CrowdError| (Box::new(trainer), TrainError::from(e));
        let parts = match Parts::new(&trainer, &device) {
            Ok(parts) => parts,
            Err(e) => return Err(failed(trainer, e)),
        };
        let mut out = Self {
            parts,
            skins: HashMap::new(),
            bytes: 0,
            host: RefCell::new(trainer),
            is_stale: Cell::new(false),
            device,
        };
        match out.tell() {
            Ok(()) => Ok(out),
            Err(e) => Err(failed(out.host.into_inner(), e)),
        }
    }

    /// Tells the device what is known here.
    fn tell(&mut self) -> Result<(), CrowdError> {
        let (device, learnt) = (&self.device, &mut self.parts.learnt);
        let now = &self.host.get_mut().now;
        // Adam remembers nothing before its first step.
        let still = vec![0.0; now.params.len()];
        let adam = [&now.adam.mean, &now.adam.square];
        let [mean, square] = adam.map(|m| if m.is_empty() { &still } else { m });
        device.write(&mut learnt.params, &now.params)?;
        device.write(&mut learnt.mean, mean)?;
        device.write(&mut learnt.square, square)?;
        device.write(&mut learnt.modes, &now.modes)?;
        device.write(&mut learnt.momentum, &now.momentum)?;
        self.is_stale.set(false);
        Ok(())
    }

    /// Asks the device what it knows. Where it cannot tell, what is known here stays as it was.
    fn ask(&self) -> Result<(), CrowdError> {
        if !self.is_stale.get() {
            return Ok(());
        }
        let read = |array: &Array| self.device.read(array);
        let l = &self.parts.learnt;
        let [params, modes, momentum] = [read(&l.params)?, read(&l.modes)?, read(&l.momentum)?];
        let [mean, square] = [read(&l.mean)?, read(&l.square)?];
        let now = &mut self.host.borrow_mut().now;
        (now.params, now.modes, now.momentum) = (params, modes, momentum);
        (now.adam.mean, now.adam.square) = (mean, square);
        self.is_stale.set(false);
        Ok(())
    }

    /// What the packs of a step cost, and which vertex of them broke; slopes stay on the device.
    fn try_packs(&mut self, chosen: &[u32], packs: &mut [Pack]) -> Result<Vec<Work>, CrowdError> {
        for (slot, k) in chosen.iter().enumerate() {
            self.place(slot, &packs[*k as usize])?;
        }
        self.look(chosen, packs)?;
        for (slot, k) in chosen.iter().enumerate() {
            let pack = &mut packs[*k as usize];
            let known = self.know(*k, pack)?;
            self.meet(slot, (*k, pack), known.as_ref())?;
            self.weigh(slot, pack, chosen.len())?;
            self.go_back(slot, chosen.len())?;
            pack.visits += 1;
        }
        let n = self.host.get_mut().wearers[0].cut.n_verts();
        let mut out = Vec::with_capacity(chosen.len());
        for (slot, k) in self.parts.slots.iter().zip(chosen) {
            let at = self.device.read(&slot.at)?;
            let faces = at.as_chunks::<LANES>().0.iter();
            packs[*k as usize].faces = faces.map(|row| row.map(f32::to_bits)).collect();
            out.push(work_of(&self.device.read(&slot.told)?, n));
        }
        Ok(out)
    }

    /// Predicts.
    fn place(&mut self, slot: usize, pack: &Pack) -> Result<(), CrowdError> {
        let (host, device) = (self.host.get_mut(), &self.device);
        let (n, k) = (host.wearers[0].cut.n_verts(), host.plan.codes);
        let slot = &mut self.parts.slots[slot];
        device.write(&mut slot.inputs, host.blur(pack).as_flattened())?;
        device.write(&mut slot.bones, pack.bones.as_flattened().as_flattened())?;
        let layers = host.encoder.layers();
        let (last, mut at) = (layers.len() - 1, 0u32);
        for (l, layer) in layers.enumerate() {
            let from = if l == 0 {
                &slot.inputs
            } else {
                &slot.bent[l - 1]
            };
            let (out, bent) = match l == last {
                true => (&slot.codes, &self.parts.work.unused),
                false => (&slot.unbent[l], &slot.bent[l]),
            };
            let (inputs, outputs) = (layer.inputs as u32, layer.outputs as u32);
            let all = told![
                &self.parts.learnt.params,
                at,
                from,
                out,
                bent,
                inputs,
                outputs
            ];
            device.over("dense", layer.outputs * LANES, all)?;
            at += layer.n_params() as u32;
        }
        let (cloth, worn) = (&self.parts.cloth, &self.parts.worn[pack.wearer]);
        let all = told![
            &self.parts.learnt.modes,
            &slot.codes,
            k as u32,
            &worn.laid,
            &cloth.starts,
            &cloth.bones,
            &cloth.weights,
            &slot.bones,
            &slot.x,
            n as u32,
        ];
        device.over("place", n * LANES, all)
    }

    /// Looks for skin and cloth near those packs where that is due.
    fn look(&mut self, chosen: &[u32], packs: &mut [Pack]) -> Result<(), CrowdError> {
        let mut due = Vec::new();
        for (k, pack) in packs.iter_mut().enumerate() {
            let Some(slot) = chosen.iter().position(|c| *c as usize == k) else {
                continue;
            };
            if pack.is_due() || pack.skins.is_empty() {
                due.push((pack, self.device.read(&self.parts.slots[slot].x)?));
            }
        }
        let host = &*self.host.get_mut();
        (due.par_iter_mut()).for_each(|(pack, x)| host.look(pack, x.as_chunks::<LANES>().0));
        Ok(())
    }

    /// A pack's bodies, where the device cannot remember them from now on.
    fn know(&mut self, k: u32, pack: &Pack) -> Result<Option<Skins>, CrowdError> {
        if self.skins.contains_key(&k) {
            return Ok(None);
        }
        let skins = Skins::new(&self.device, pack)?;
        if self.bytes + skins.bytes > REMEMBERED {
            return Ok(Some(skins));
        }
        self.bytes += skins.bytes;
        self.skins.insert(k, skins);
        Ok(None)
    }
}

impl OnDevice<'_> {
    /// Follows the skin.
    fn meet(
        &mut self,
        slot: usize,
        (k, pack): (u32, &Pack),
        known: Option<&Skins>,
    ) -> Result<(), CrowdError> {
        let n = self.host.get_mut().wearers[0].cut.n_verts();
        let (device, room, worn) = (
            &self.device,
            &self.parts.work,
            &self.parts.worn[pack.wearer],
        );
        let slot = &mut self.parts.slots[slot];
        device.write(&mut slot.at, &bits(pack.faces.as_flattened()))?;
        let skins = known.unwrap_or_else(|| &self.skins[&k]);
        let all = told![
            &worn.skin_faces,
            &worn.skin_starts,
            &worn.around,
            &worn.rim,
            &skins.skins,
            skins.n_skin,
            &slot.x,
            &slot.at,
            &room.planes,
            n as u32,
        ];
        device.over("walls", n * LANES, all)
    }

    /// Asks the laws.
    fn weigh(&mut self, slot: usize, pack: &Pack, of: usize) -> Result<(), CrowdError> {
        let first = u32::from(slot == 0);
        let (host, device, room) = (self.host.get_mut(), &self.device, &mut self.parts.work);
        let wearer = &host.wearers[pack.wearer];
        let (n, n_faces) = (wearer.cut.n_verts(), self.parts.cloth.n_faces);
        let (cloth, worn, slot) = (
            &self.parts.cloth,
            &self.parts.worn[pack.wearer],
            &self.parts.slots[slot],
        );
        device.write(&mut room.fold_of, &bits(&fold_of(pack, n)))?;
        let planes: Vec<f32> = pack.folds.iter().flat_map(|f| f.1).flatten().collect();
        let planes = device.put(&planes)?;
        let firmness = wearer.firmness(host.firm_at(host.now.step)) as f32;
        let all = told![
            &cloth.faces,
            &worn.patches,
            firmness,
            &slot.x,
            &room.forces,
            &room.stretch,
            n_faces as u32,
        ];
        device.over("patches", n_faces * LANES, all)?;
        let wall = host.wall();
        let all = told![
            &cloth.shared_starts,
            &cloth.shared,
            &room.forces,
            &worn.bend_starts,
            &worn.bent,
            &worn.bend,
            &worn.mass,
            &worn.laid,
            &cloth.pinned,
            &cloth.starts,
            &cloth.bones,
            &cloth.weights,
            &slot.bones,
            &room.planes,
            &room.fold_of,
            &planes,
            wall.radius,
            wall.width,
            wall.stiffness,
            PIN,
            G,
            &slot.x,
            &room.g,
            &room.costs,
            &room.held,
            &room.broken,
            1.0 / of as f32,
            first,
            n as u32,
        ];
        device.over("gather", n * LANES, all)?;
        let blocks = |n: usize| device.blocks(n * LANES);
        let all = told![
            &room.stretch,
            blocks(n_faces),
            &room.costs,
            &room.broken,
            blocks(n),
            host.plan.fair as f32,
            host.plan.fairness,
            &slot.told,
        ];
        device.over("count", device.block() as usize, all)
    }

    /// From forces back to what is learnt.
    fn go_back(&mut self, slot: usize, of: usize) -> Result<(), CrowdError> {
        let (first, share) = (u32::from(slot == 0), 1.0 / of as f32);
        let (host, device, room) = (self.host.get_mut(), &self.device, &self.parts.work);
        let (n, k) = (host.wearers[0].cut.n_verts(), host.plan.codes);
        let (slot, learnt) = (&self.parts.slots[slot], &self.parts.learnt);
        let all = told![&slot.codes, &slot.told, &room.weighed, k as u32];
        device.over("weigh", k * LANES, all)?;
        for (from, to, rows) in [
            (&room.g, &room.d_modes, 3 * n),
            (&slot.codes, &room.moments, k),
        ] {
            let all = told![from, &room.weighed, to, rows as u32, k as u32, share, first];
            device.over("outer", rows * k, all)?;
        }
        let all = told![&learnt.modes, &room.g, &room.parts, 3 * n as u32, k as u32];
        let block = ("code_parts", device.block());
        device.launch(block, [k as u32, PARTS], all)?;
        let [even, odd] = &room.back;
        let all = told![&room.parts, PARTS, &slot.told, even, k as u32];
        device.over("code_slope", k * LANES, all)?;
        let mut end = host.encoder.n_params() as u32;
        let layers: Vec<_> = host.encoder.layers().collect();
        for (l, layer) in layers.iter().enumerate().rev() {
            let at = end - layer.n_params() as u32;
            end = at;
            let (inputs, outputs) = (layer.inputs as u32, layer.outputs as u32);
            let (d, before) = match (layers.len() - l) % 2 {
                1 => (even, odd),
                _ => (odd, even),
            };
            let into = if l == 0 {
                &slot.inputs
            } else {
                &slot.bent[l - 1]
            };
            let all = told![&room.d_params, at, into, d, inputs, outputs, share, first];
            device.over("dense_slope", layer.outputs * (layer.inputs + 1), all)?;
            if l > 0 {
                let unbent = &slot.unbent[l - 1];
                let all = told![&learnt.params, at, d, unbent, before, inputs, outputs];
                device.over("dense_back", layer.inputs * LANES, all)?;
            }
        }
        Ok(())
    }

    /// Takes a step with the slopes of so many packs.
    fn learn(&mut self, packs: usize) -> Result<(), CrowdError> {
        self.step_network()?;
        self.divide()?;
        self.step_shapes(packs)
    }

    /// Adam's.
    fn step_network(&mut self) -> Result<(), CrowdError> {
        let host = self.host.get_mut();
        let (device, room, learnt) = (&self.device, &self.parts.work, &self.parts.learnt);
        let adam = Adam {
            rate: host.plan.rate * host.fading(),
            ..Adam::default()
        };
        host.now.adam.steps += 1;
        let [rate, floor] = adam.corrected(host.now.adam.steps);
        let ([a, b], n_params) = (adam.memory, host.encoder.n_params());
        let all = told![
            &learnt.params,
            &learnt.mean,
            &learnt.square,
            &room.d_params,
            rate,
            floor,
            a,
            b,
            n_params as u32,
        ];
        device.over("adam", n_params, all)
    }

    /// Divides what is remembered of the slopes in the shapes by the stiffness.
    fn divide(&mut self) -> Result<(), CrowdError> {
        let host = self.host.get_mut();
        let (device, room, learnt) = (&self.device, &self.parts.work, &self.parts.learnt);
        let (n, k) = (host.wearers[0].cut.n_verts(), host.plan.codes);
        let n_modes = 3 * n * k;
        let keep = host.plan.momentum;
        let all = told![&learnt.momentum, &room.d_modes, keep, n_modes as u32];
        device.over("remember", n_modes, all)?;
        host.remember(&device.read(&room.moments)?, &device.read(&room.held)?);
        if factors_at(host.now.step) {
            self.parts.solver = Solver::new(device, &host.factor)?;
        }
        let Solver {
            order, down, up, ..
        } = &self.parts.solver;
        let all = told![
            order,
            &down.levels,
            down.n_levels,
            &down.members,
            &down.starts,
            &down.others,
            &down.blocks,
            &down.diagonal,
            &up.levels,
            up.n_levels,
            &up.members,
            &up.starts,
            &up.others,
            &up.blocks,
            &up.diagonal,
            &learnt.momentum,
            &room.solved,
            k as u32,
            n as u32,
        ];
        device.launch(("solve", device.solvers()), [k as u32, 1], all)
    }

    /// Leads the shapes there, by the inverse of the codes' moments, which is found here meanwhile.
    fn step_shapes(&mut self, packs: usize) -> Result<(), CrowdError> {
        let (host, device, room) = (self.host.get_mut(), &self.device, &mut self.parts.work);
        let (places, learnt) = (&self.parts.solver.places, &self.parts.learnt);
        let (n, k) = (host.wearers[0].cut.n_verts(), host.plan.codes);
        let n_modes = 3 * n * k;
        device.write(&mut room.inverse, &inverse(&host.now.moments, k, FLOOR))?;
        let (solved, inverse) = (&room.solved, &room.inverse);
        let all = told![solved, places, inverse, &room.moves, k as u32, n as u32];
        device.over("lead", n_modes, all)?;
        let blocks = device.blocks(n * LANES);
        for (p, slot) in self.parts.slots[..packs].iter().enumerate() {
            let first = p as u32 * blocks;
            let all = told![
                &room.moves,
                &slot.codes,
                &room.far,
                first,
                k as u32,
                n as u32
            ];
            device.over("farthest", n * LANES, all)?;
        }
        let rate = host.plan.shape_rate * host.fading();
        let all = told![&room.far, packs as u32 * blocks, rate, FARTHEST, &room.by];
        device.over("shorten", device.block() as usize, all)?;
        let all = told![&learnt.modes, &room.moves, &room.by, n_modes as u32];
        device.over("move", n_modes, all)
    }
}

impl Training for OnDevice<'_> {
    fn steps(&self) -> u64 {
        self.host.borrow().steps()
    }

    fn looks(&self, steps: Range<u64>) -> u64 {
        self.host.borrow().looks(steps)
    }

    fn step(&mut self) -> Result<Told, TrainError> {
        let chosen = self.host.get_mut().choose();
        let mut packs = std::mem::take(&mut self.host.get_mut().now.packs);
        let works = self.try_packs(&chosen, &mut packs);
        let host = self.host.get_mut();
        host.now.packs = packs;
        let works = works?;
        let told = host.told(&works);
        host.now.step += 1;
        if let Some(fault) = host.fault(&works) {
            return left_out(&mut host.now.bad, fault, told);
        }
        host.now.bad = 0;
        self.is_stale.set(true);
        self.learn(works.len())?;
        Ok(told)
    }

    fn judge(&self, motion: &Motion) -> Result<Told, TrainError> {
        self.ask()?;
        self.host.borrow().judge(motion)
    }

    fn model(&self, notes: BTreeMap<String, String>) -> Result<Model, TrainError> {
        self.ask()?;
        self.host.borrow().model(notes)
    }

    fn keep(&self) -> Result<Weights, TrainError> {
        self.ask()?;
        self.host.borrow().keep()
    }

    fn restore(&mut self, kept: &Weights) -> Result<(), TrainError> {
        let host = self.host.get_mut();
        host.restore(kept)?;
        self.parts.solver = Solver::new(&self.device, &host.factor)?;
        Ok(self.tell()?)
    }
}

/// What a pack of a cloth of `n` vertices costs, and the vertex that broke.
fn work_of(told: &[f32], n: usize) -> Work {
    let rows: &[Row] = told.as_chunks::<LANES>().0;
    let mean = |row: &Row| Lane(*row).sum() / LANES as f64;
    let broken = told[(TERMS + 1) * LANES];
    Work {
        energies: Energies {
            membrane: mean(&rows[0]),
            bend: mean(&rows[1]),
            weight: mean(&rows[2]),
            contact: mean(&rows[3]),
            pins: mean(&rows[4]),
            inertia: 0.0,
        },
        under: mean(&rows[5]) / n as f64,
        broken: (broken >= 0.0).then_some(broken as usize),
        ..Work::default()
    }
}

#[cfg(test)]
mod tests;
