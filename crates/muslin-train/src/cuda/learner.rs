//! A training whose steps a device takes.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, HashMap};

use muslin_body::Motion;
use muslin_model::{CrowdError, Model};
use muslin_net::Weights;
use muslin_net::learn::Adam;
use rayon::prelude::*;

use super::upload::{Cloth, Skins, Solver, Worn, fold_of};
use super::{Array, Device, bits, told};
use crate::TrainError;
use crate::lanes::{LANES, Row};
use crate::laws::G;
use crate::pack::Pack;
use crate::trainer::{Energies, Told, Trainer};
use crate::training::{Training, fault, left_out};
use crate::update::{FARTHEST, FLOOR, factors_at, inverse};
use crate::work::PIN;

/// Terms of the cost that a pack tells, pose by pose; then how much each counts, and what broke.
const TERMS: usize = 6;
/// Parts that the rows of the shapes are summed in.
const PARTS: u32 = 16;
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
    /// Why the device could not tell what it knows.
    failed: Cell<Option<CrowdError>>,
    device: Device,
    parts: Parts,
    skins: HashMap<u32, Skins>,
    /// How many bytes these are.
    bytes: usize,
}

/// All arrays on the device but bodies.
struct Parts {
    cloth: Cloth,
    worn: Vec<Worn>,
    solver: Solver,
    slots: Vec<Slot>,
    learnt: Learnt,
    work: Room,
}

/// What is learnt, and what its steps remember.
struct Learnt {
    params: Array,
    mean: Array,
    square: Array,
    modes: Array,
    momentum: Array,
}

/// A pack of a step.
struct Slot {
    inputs: Array,
    /// What goes into each layer but the first, and comes out of each but the last before it is bent.
    bent: Vec<Array>,
    unbent: Vec<Array>,
    codes: Array,
    bones: Array,
    x: Array,
    at: Array,
    told: Array,
}

/// Room to work in.
struct Room {
    planes: Array,
    forces: Array,
    stretch: Array,
    costs: Array,
    broken: Array,
    g: Array,
    weighed: Array,
    parts: Array,
    /// Slopes in what layers give, in turns.
    back: [Array; 2],
    unused: Array,
    fold_of: Array,
    d_params: Array,
    d_modes: Array,
    moments: Array,
    held: Array,
    solved: Array,
    inverse: Array,
    moves: Array,
    far: Array,
    by: Array,
}

impl Parts {
    fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
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
    fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
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
    fn new(trainer: &Trainer<'_>, device: &Device) -> Result<Self, CrowdError> {
        let (cut, k) = (&trainer.wearers[0].cut, trainer.plan.codes);
        let (n, n_faces) = (cut.n_verts(), cut.patches.len());
        let room = |n: usize| device.room(n);
        let blocks = |n: usize| (n * LANES).div_ceil(device.block() as usize);
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
            failed: Cell::new(None),
            device,
        };
        match out.tell() {
            Ok(()) => Ok(out),
            Err(e) => Err(failed(out.host.into_inner(), e)),
        }
    }

    /// Tells the device what is known here.
    fn tell(&mut self) -> Result<(), CrowdError> {
        let (host, device, learnt) = (self.host.get_mut(), &self.device, &mut self.parts.learnt);
        let now = &mut host.now;
        now.adam.mean.resize(now.params.len(), 0.0);
        now.adam.square.resize(now.params.len(), 0.0);
        device.write(&mut learnt.params, &now.params)?;
        device.write(&mut learnt.mean, &now.adam.mean)?;
        device.write(&mut learnt.square, &now.adam.square)?;
        device.write(&mut learnt.modes, &now.modes)?;
        device.write(&mut learnt.momentum, &now.momentum)?;
        if now.step == 0 {
            // As a training that has not begun is kept.
            (now.adam.mean, now.adam.square) = (Vec::new(), Vec::new());
        }
        self.parts.solver = Solver::new(device, &host.factor)?;
        self.is_stale.set(false);
        Ok(())
    }

    /// Asks the device what it knows. Where it cannot tell, what is known here stays, and the next step fails.
    fn ask(&self) {
        if !self.is_stale.get() {
            return;
        }
        let read = |array: &Array| self.device.read(array);
        let all = || -> Result<[Vec<f32>; 5], CrowdError> {
            let l = &self.parts.learnt;
            Ok([
                read(&l.params)?,
                read(&l.mean)?,
                read(&l.square)?,
                read(&l.modes)?,
                read(&l.momentum)?,
            ])
        };
        match all() {
            Ok([params, mean, square, modes, momentum]) => {
                let now = &mut self.host.borrow_mut().now;
                (now.params, now.modes, now.momentum) = (params, modes, momentum);
                (now.adam.mean, now.adam.square) = (mean, square);
                self.is_stale.set(false);
            }
            Err(e) => self.failed.set(Some(e)),
        }
    }

    /// What the packs of a step cost, and the first vertex of them that broke; slopes stay on the device.
    fn try_packs(
        &mut self,
        chosen: &[u32],
        packs: &mut [Pack],
    ) -> Result<Vec<(Told, Option<usize>)>, CrowdError> {
        for (slot, k) in chosen.iter().enumerate() {
            self.place(slot, &packs[*k as usize])?;
        }
        self.look(chosen, packs)?;
        for (slot, k) in chosen.iter().enumerate() {
            let pack = &mut packs[*k as usize];
            let known = self.know(*k, pack)?;
            self.meet((slot, chosen.len()), (*k, pack), known.as_ref())?;
            self.go_back(slot, chosen.len())?;
            pack.visits += 1;
        }
        let n = self.host.get_mut().wearers[0].cut.n_verts();
        let mut out = Vec::with_capacity(chosen.len());
        for (slot, k) in self.parts.slots.iter().zip(chosen) {
            let at = self.device.read(&slot.at)?;
            let faces = at.as_chunks::<LANES>().0.iter();
            packs[*k as usize].faces = faces.map(|row| row.map(f32::to_bits)).collect();
            out.push(of(&self.device.read(&slot.told)?, n));
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
    /// Asks the laws.
    fn meet(
        &mut self,
        (slot, of): (usize, usize),
        (k, pack): (u32, &Pack),
        known: Option<&Skins>,
    ) -> Result<(), CrowdError> {
        let first = u32::from(slot == 0);
        let (host, device, room) = (self.host.get_mut(), &self.device, &mut self.parts.work);
        let wearer = &host.wearers[pack.wearer];
        let (n, n_faces) = (wearer.cut.n_verts(), self.parts.cloth.n_faces);
        let (cloth, worn, slot) = (
            &self.parts.cloth,
            &self.parts.worn[pack.wearer],
            &mut self.parts.slots[slot],
        );
        device.write(&mut slot.at, &bits(pack.faces.as_flattened()))?;
        device.write(&mut room.fold_of, &bits(&fold_of(pack, n)))?;
        let planes: Vec<f32> = pack.folds.iter().flat_map(|f| f.1).flatten().collect();
        let planes = device.put(&planes)?;
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
        device.over("walls", n * LANES, all)?;
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
        let blocks = |n: usize| (n * LANES).div_ceil(device.block() as usize) as u32;
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
        let mut end = learnt_params(host) as u32;
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
        let (host, device, room, learnt) = (
            self.host.get_mut(),
            &self.device,
            &mut self.parts.work,
            &self.parts.learnt,
        );
        let (n, k) = (host.wearers[0].cut.n_verts(), host.plan.codes);
        let adam = Adam {
            rate: host.plan.rate * host.fading(),
            ..Adam::default()
        };
        host.now.adam.steps += 1;
        let [rate, floor] = adam.corrected(host.now.adam.steps);
        let ([a, b], n_params) = (adam.memory, learnt_params(host));
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
        device.over("adam", n_params, all)?;
        let n_modes = 3 * n * k;
        let keep = host.plan.momentum;
        let all = told![&learnt.momentum, &room.d_modes, keep, n_modes as u32];
        device.over("remember", n_modes, all)?;
        host.remember(&device.read(&room.moments)?, &device.read(&room.held)?);
        if factors_at(host.now.step) {
            self.parts.solver = Solver::new(device, &host.factor)?;
        }
        let Solver {
            order,
            places,
            down,
            up,
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
        device.launch(("solve", device.solvers()), [k as u32, 1], all)?;
        // Meanwhile, here.
        device.write(&mut room.inverse, &inverse(&host.now.moments, k, FLOOR))?;
        let (solved, inverse) = (&room.solved, &room.inverse);
        let all = told![solved, places, inverse, &room.moves, k as u32, n as u32];
        device.over("lead", n_modes, all)?;
        let blocks = (n * LANES).div_ceil(device.block() as usize) as u32;
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

/// How many parameters the network has.
fn learnt_params(host: &Trainer<'_>) -> usize {
    host.encoder.n_params()
}

impl Training for OnDevice<'_> {
    fn steps(&self) -> u64 {
        self.host.borrow().steps()
    }

    fn step(&mut self) -> Result<Told, TrainError> {
        if let Some(e) = self.failed.take() {
            return Err(e.into());
        }
        let chosen = self.host.get_mut().choose();
        let mut packs = std::mem::take(&mut self.host.get_mut().now.packs);
        let works = self.try_packs(&chosen, &mut packs);
        let host = self.host.get_mut();
        host.now.packs = packs;
        let (works, share) = (works?, 1.0 / chosen.len() as f64);
        let mut all = Told {
            step: host.now.step + 1,
            ..Told::default()
        };
        for (told, _) in &works {
            all.energies.add(&told.energies, share);
            all.under += share * told.under;
        }
        host.now.step += 1;
        let broken = works
            .iter()
            .find_map(|(told, broken)| Some((told, (*broken)?)));
        if let Some((told, vertex)) = broken {
            let fault = fault(&told.energies, vertex, host.now.step);
            return left_out(&mut host.now.bad, fault, all);
        }
        host.now.bad = 0;
        self.is_stale.set(true);
        self.learn(works.len())?;
        Ok(all)
    }

    fn judge(&self, motion: &Motion) -> Told {
        self.ask();
        self.host.borrow().judge(motion)
    }

    fn model(&self, notes: BTreeMap<String, String>) -> Model {
        self.ask();
        self.host.borrow().model(notes)
    }

    fn keep(&self) -> Weights {
        self.ask();
        self.host.borrow().keep()
    }

    fn restore(&mut self, kept: &Weights) -> Result<(), TrainError> {
        self.host.get_mut().restore(kept)?;
        Ok(self.tell()?)
    }
}

/// What a pack costs, and the vertex that broke.
fn of(told: &[f32], n: usize) -> (Told, Option<usize>) {
    let rows: &[Row] = told.as_chunks::<LANES>().0;
    let mean = |row: &Row| row.iter().map(|x| f64::from(*x)).sum::<f64>() / LANES as f64;
    let told_of = Told {
        step: 0,
        energies: Energies {
            membrane: mean(&rows[0]),
            bend: mean(&rows[1]),
            weight: mean(&rows[2]),
            contact: mean(&rows[3]),
            pins: mean(&rows[4]),
            inertia: 0.0,
        },
        under: mean(&rows[5]) / n as f64,
    };
    let broken = told[(TERMS + 1) * LANES];
    (told_of, (broken >= 0.0).then_some(broken as usize))
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use super::*;
    use crate::cuda::emulated::Emulated;
    use crate::testing::{Class, Other, go_on_alike};

    static CLASS: LazyLock<Class> = LazyLock::new(Class::new);

    /// This machine's processor, and the CUDA device if there is one; nothing where there is no C compiler.
    fn devices() -> Vec<Device> {
        let mut out: Vec<Device> = Emulated::new().map(Device::Emulated).into_iter().collect();
        match Device::cuda() {
            Ok(device) => out.push(device),
            Err(why) => println!("skipped on a device: {why}"),
        }
        out
    }

    /// Trainings of one wearer, and of two.
    fn trainings<'a>(other: &'a Other) -> [Trainer<'a>; 2] {
        [CLASS.trainer(), CLASS.taught(other.lessons(&CLASS))]
    }

    fn bits_of(x: &[f32]) -> Vec<u32> {
        x.iter().map(|x| x.to_bits()).collect()
    }

    fn off(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!(a.len(), b.len());
        let square = |x: &mut dyn Iterator<Item = f32>| x.map(|x| x * x).sum::<f32>();
        let off = square(&mut a.iter().zip(b).map(|(a, b)| a - b));
        (off / square(&mut b.iter().copied()).max(1e-30)).sqrt()
    }

    #[test]
    fn a_device_learns_what_a_trainer_does() {
        let other = Other::new(&CLASS);
        for device in devices() {
            println!("on {}", device.name());
            for mut host in trainings(&other) {
                // Beyond where skin is followed, and the factor is made anew.
                while host.steps() < 3 {
                    host.step().expect("finite");
                }
                let mut on = CLASS.taught(match host.wearers.len() {
                    1 => vec![CLASS.lesson()],
                    _ => other.lessons(&CLASS),
                });
                on.restore(&host.keep()).expect("the same training");
                let same = match &device {
                    Device::Emulated(d) => Device::Emulated(d.clone()),
                    #[cfg(feature = "cuda")]
                    Device::Cuda(_) => Device::cuda().expect("it was there"),
                };
                let mut on = OnDevice::new(on, same)
                    .map_err(|e| e.1)
                    .expect("there is room");
                assert_eq!(on.keep(), host.keep(), "nothing is learnt by moving");
                for _ in 0..4 {
                    let (a, b) = (on.step().expect("finite"), host.step().expect("finite"));
                    for ((name, a), (_, b)) in a.energies.terms().iter().zip(b.energies.terms()) {
                        assert!(
                            (a - b).abs() <= 2e-4 * b.abs() + 1e-6,
                            "{name}: {a} for {b}"
                        );
                    }
                    assert!(
                        (a.under - b.under).abs() < 2e-3,
                        "{} for {}",
                        a.under,
                        b.under
                    );
                }
                on.ask();
                let on = on.host.borrow();
                let (a, b) = (&on.now, &host.now);
                assert_eq!(
                    (a.step, a.adam.steps, &a.queue),
                    (b.step, b.adam.steps, &b.queue)
                );
                let pairs = [
                    ("modes", off(&a.modes, &b.modes)),
                    ("momentum", off(&a.momentum, &b.momentum)),
                    ("parameters", off(&a.params, &b.params)),
                    ("means", off(&a.adam.mean, &b.adam.mean)),
                    ("walls", off(a.walls.as_flattened(), b.walls.as_flattened())),
                ];
                println!("{pairs:?}");
                for (what, off) in pairs {
                    assert!(off < 5e-3, "{what}: {off}");
                }
            }
        }
    }

    #[test]
    fn a_device_goes_on_to_the_same_bits() {
        for device in devices() {
            let same = || match &device {
                Device::Emulated(d) => Device::Emulated(d.clone()),
                #[cfg(feature = "cuda")]
                Device::Cuda(_) => Device::cuda().expect("it was there"),
            };
            let start = || {
                OnDevice::new(CLASS.trainer(), same())
                    .map_err(|e| e.1)
                    .expect("there is room")
            };
            let (mut whole, mut broken) = (start(), start());
            while broken.steps() < 2 {
                broken.step().expect("finite");
            }
            let kept = broken.keep();
            let mut broken = start();
            broken.restore(&kept).expect("the same training");
            go_on_alike([&mut whole, &mut broken], 4);
        }
    }

    #[test]
    fn a_batch_that_is_not_finite_is_left_out_on_a_device_and_said() {
        for device in devices() {
            let mut host = CLASS.trainer();
            // Of one vertex alone, and so that it is there from the first step on.
            host.now.modes[host.plan.codes - 1] = f32::NAN;
            let mut on = OnDevice::new(host, device)
                .map_err(|e| e.1)
                .expect("there is room");
            let bits = |on: &OnDevice<'_>| bits_of(&on.host.borrow().now.modes);
            let before = bits(&on);
            for _ in 0..5 {
                on.step().expect("left out");
            }
            // What the device has.
            on.is_stale.set(true);
            on.ask();
            assert_eq!(bits(&on), before);
            let failed = on.step().expect_err("six in a row");
            assert!(
                matches!(
                    failed,
                    TrainError::NotFinite {
                        step: 6,
                        vertex: 0,
                        ..
                    }
                ),
                "{failed}"
            );
        }
    }
}
