//! A crowd on a CUDA device.
//!
//! Poses are read here; network, swings, shapes, skinning and normals are kernels (`cuda/kernels.cu`), which the driver's
//! own compiler makes when a crowd is made. The safe twin is `Crowd::on_cores`.

#![allow(unsafe_code)]

use std::sync::Arc;

use cudarc::driver::{
    CudaContext, CudaFunction, CudaModule, CudaSlice, CudaStream, DeviceRepr, LaunchConfig,
    PinnedHostSlice, PushKernelArg,
};
use glam::DAffine3;
use muslin_body::{Avatar, Pose};
use rayon::prelude::*;

use crate::Model;
use crate::crowd::{CrowdError, moments};
use crate::decode::Affine;
use crate::device;
use crate::player::STEP;
use crate::reading::Reading;
use crate::tables::{Layout, Tables};

/// Threads in a block.
const BLOCK: u32 = 128;
/// Frames that a block drapes, where there is room for them: the first that fits.
const FRAMES: [u32; 5] = [16, 8, 4, 2, 1];
/// Room that any device gives a block [bytes].
const SHARED: u32 = 48 << 10;
/// Frames that one thread of a layer reads.
const LAYER: u32 = 8;
/// Frames whose normals one thread gives.
const TURNED: u32 = 4;

const KERNELS: &str = include_str!("cuda/kernels.cu");

// SAFETY: numbers of four bytes one after the other, as its twin in the kernels has them.
unsafe impl DeviceRepr for Layout {}

/// A crowd and all that it needs on the device.
#[derive(Debug)]
pub(crate) struct OnDevice {
    stream: Arc<CudaStream>,
    kernels: Kernels,
    /// Frames that a block drapes.
    lot: u32,
    tables: Tables,
    floats: CudaSlice<f32>,
    numbers: CudaSlice<u32>,
    params: CudaSlice<f32>,
    state: CudaSlice<f32>,
    seen: CudaSlice<u32>,
    level: f32,
    wearers: usize,
    /// What reads poses.
    reading: Reading,
    /// What came of the last moments, and room for them.
    moments: usize,
    room: Option<Frames>,
}

#[derive(Debug)]
struct Kernels {
    layer: CudaFunction,
    swing: CudaFunction,
    drape: CudaFunction,
    turn: CudaFunction,
}

/// Arrays that have an entry a frame.
#[derive(Debug)]
struct Frames {
    /// How many there is room for.
    count: usize,
    /// What is read of poses, in memory that the device takes it from by itself.
    told: PinnedHostSlice<f32>,
    carried: PinnedHostSlice<f32>,
    input: CudaSlice<f32>,
    bones: CudaSlice<f32>,
    /// What layers give each other, in turns.
    between: [CudaSlice<f32>; 2],
    codes: CudaSlice<f32>,
    x: CudaSlice<f32>,
    normals: CudaSlice<f32>,
}

/// The kernels for this device, which drape so many frames a block.
fn compiled(context: &Arc<CudaContext>, lot: u32) -> Result<Arc<CudaModule>, CrowdError> {
    device::compiled(context, KERNELS, &[("FRAMES", lot), ("BLOCK", BLOCK)])
}

/// Blocks of so many for `n`.
fn blocks(n: usize, of: u32) -> u32 {
    n.div_ceil(of as usize) as u32
}

fn launch(x: u32, y: u32, shared: u32) -> LaunchConfig {
    LaunchConfig {
        grid_dim: (x, y, 1),
        block_dim: (BLOCK, 1, 1),
        shared_mem_bytes: shared,
    }
}

impl OnDevice {
    pub fn new(model: &Model, avatar: &Avatar, wearers: usize) -> Result<Self, CrowdError> {
        let reading = Reading::new(model, avatar)?;
        let mut tables = Tables::new(model).map_err(CrowdError::NotThere)?;
        tables.begin(STEP);
        let context = device::first()?;
        let lot = FRAMES
            .into_iter()
            .find(|f| shared(&tables.layout, *f) <= SHARED);
        let lot = lot.ok_or(CrowdError::NotThere("garments on so many bones"))?;
        let module = compiled(&context, lot)?;
        let kernel = |name| module.load_function(name);
        let stream = context.default_stream();
        let n_state = wearers * tables.layout.n_state as usize;
        Ok(Self {
            kernels: Kernels {
                layer: kernel("layer")?,
                swing: kernel("swing")?,
                drape: kernel("drape")?,
                turn: kernel("turn")?,
            },
            lot,
            floats: stream.clone_htod(&tables.floats)?,
            numbers: stream.clone_htod(&tables.numbers)?,
            params: stream.clone_htod(&tables.network.params)?,
            state: stream.alloc_zeros(n_state.max(1))?,
            seen: stream.alloc_zeros(wearers.max(1))?,
            level: 1.0,
            wearers,
            reading,
            moments: 0,
            room: None,
            tables,
            stream,
        })
    }

    pub fn name(&self) -> String {
        device::name(self.stream.context())
    }

    pub fn n_verts(&self) -> usize {
        self.tables.layout.n_verts as usize
    }

    pub fn begin(&mut self, step: f64) -> Result<(), CrowdError> {
        self.reading.begin(step);
        self.tables.begin(step);
        self.stream
            .memcpy_htod(&self.tables.floats, &mut self.floats)?;
        self.stream.memset_zeros(&mut self.seen)?;
        Ok(())
    }

    pub fn set_motion_level(&mut self, level: f32) {
        self.level = level;
    }

    pub fn play(&mut self, poses: &[(&Pose, &[DAffine3])]) -> Result<(), CrowdError> {
        let n = moments(poses.len(), self.wearers);
        if self.room.as_ref().is_none_or(|r| r.count < poses.len()) {
            // Never both at once.
            self.room = None;
            self.room = Some(self.frames(poses.len())?);
        }
        self.moments = n;
        if !poses.is_empty() {
            self.read_poses(poses)?;
            self.drape(poses.len())?;
        }
        self.stream.synchronize()?;
        Ok(())
    }

    /// What the network is told of every pose, and the bones.
    fn read_poses(&mut self, poses: &[(&Pose, &[DAffine3])]) -> Result<(), CrowdError> {
        let (n, m) = (self.reading.n_inputs(), self.reading.n_bones());
        let room = self.room.as_mut().expect("there is room");
        let input = &mut room.told.as_mut_slice()?[..poses.len() * n];
        let affine = &mut room.carried.as_mut_slice()?[..12 * poses.len() * m];
        let affine: &mut [Affine] = affine.as_chunks_mut().0;
        // What is played here remembers nothing of the poses before.
        let part = poses.len().div_ceil(rayon::current_num_threads()).max(1);
        let reading = &self.reading;
        let room =
            (input.par_chunks_mut((part * n).max(1))).zip(affine.par_chunks_mut((part * m).max(1)));
        poses
            .par_chunks(part)
            .zip(room)
            .for_each(|(poses, (input, affine))| {
                let mut reading = reading.clone();
                let room = input.chunks_exact_mut(n).zip(affine.chunks_exact_mut(m));
                for (pose, (input, own)) in poses.iter().zip(room) {
                    reading.read(*pose, input, own);
                }
            });
        Ok(())
    }

    /// Room for so many frames.
    fn frames(&self, n: usize) -> Result<Frames, CrowdError> {
        let l = &self.tables.layout;
        let room = |each: usize| self.stream.alloc_zeros::<f32>((n * each).max(1));
        let widest = self
            .tables
            .network
            .widths
            .iter()
            .max()
            .map_or(1, |w| *w as usize);
        let pinned = |each: usize| -> Result<PinnedHostSlice<f32>, CrowdError> {
            // SAFETY: nobody reads it before it is filled, here. Zero flags: it is read as well as written.
            let mut room = unsafe {
                let context = self.stream.context();
                context.alloc_pinned_with_flags((n * each).max(1), 0)
            }?;
            room.as_mut_slice()?.fill(0.0);
            Ok(room)
        };
        Ok(Frames {
            count: n,
            told: pinned(self.reading.n_inputs())?,
            carried: pinned(12 * l.n_bones as usize)?,
            input: room(self.reading.n_inputs())?,
            bones: room(12 * l.n_bones as usize)?,
            between: [room(widest)?, room(widest)?],
            codes: room(l.n_codes as usize)?,
            x: room(3 * l.n_verts as usize)?,
            normals: room(3 * l.n_verts as usize)?,
        })
    }

    fn drape(&mut self, n: usize) -> Result<(), CrowdError> {
        let room = self.room.as_mut().expect("there is room");
        let (stream, l, frames) = (&self.stream, &self.tables.layout, n as u32);
        // Both go their way while kernels are told; nobody writes to them before the device has done all.
        for (from, to, each) in [
            (&room.told, &mut room.input, self.reading.n_inputs()),
            (&room.carried, &mut room.bones, 12 * l.n_bones as usize),
        ] {
            let mut to = to.slice_mut(..n * each);
            stream.memcpy_htod(&from.as_slice()?[..n * each], &mut to)?;
        }

        let net = &self.tables.network;
        let (n_layers, mut at) = (net.widths.len() - 1, 0);
        for (k, w) in net.widths.windows(2).enumerate() {
            let (is_last, n_params) = (k + 1 == n_layers, ((w[0] + 1) * w[1]) as usize);
            let params = self.params.slice(at..at + n_params);
            at += n_params;
            let stride = if is_last { l.n_codes } else { w[1] };
            let bend = if is_last && !net.bends_last {
                0
            } else {
                net.bend
            };
            let [even, odd] = &mut room.between;
            let (from, to) = match k % 2 {
                0 => (&*even, odd),
                _ => (&*odd, even),
            };
            let from = if k == 0 { &room.input } else { from };
            let to = if is_last { &mut room.codes } else { to };
            let mut job = stream.launch_builder(&self.kernels.layer);
            job.arg(&params).arg(from).arg(to).arg(&w[0]).arg(&w[1]);
            job.arg(&stride).arg(&frames).arg(&bend);
            let over = launch(blocks(n, LAYER), blocks(w[1] as usize, BLOCK), 0);
            // SAFETY: the kernel's own arguments; every array is of the length that they tell.
            unsafe { job.launch(over) }?;
        }

        let (wearers, moments) = (self.wearers as u32, (n / self.wearers) as u32);
        if l.n_swings > 0 {
            let mut job = stream.launch_builder(&self.kernels.swing);
            job.arg(l).arg(&self.floats).arg(&self.numbers);
            job.arg(&room.bones).arg(&mut room.codes);
            job.arg(&mut self.state).arg(&mut self.seen);
            job.arg(&wearers).arg(&moments).arg(&self.level);
            // SAFETY: as above; a block has a wearer's state for itself.
            unsafe { job.launch(launch(wearers, 1, 0)) }?;
        }

        let verts = blocks(l.n_verts as usize, BLOCK);
        let mut job = stream.launch_builder(&self.kernels.drape);
        job.arg(l).arg(&self.floats).arg(&self.numbers);
        job.arg(&room.codes)
            .arg(&room.bones)
            .arg(&mut room.x)
            .arg(&frames);
        let over = launch(blocks(n, self.lot), verts, shared(l, self.lot));
        // SAFETY: as above; what blocks share is as large as they are told.
        unsafe { job.launch(over) }?;

        let mut job = stream.launch_builder(&self.kernels.turn);
        job.arg(l)
            .arg(&self.numbers)
            .arg(&room.x)
            .arg(&mut room.normals)
            .arg(&frames);
        // SAFETY: as above.
        unsafe { job.launch(launch(blocks(n, TURNED), verts, 0)) }?;
        Ok(())
    }

    pub fn read(
        &mut self,
        (moment, wearer): (usize, usize),
        (out, normals): (&mut [[f32; 3]], &mut [[f32; 3]]),
    ) -> Result<(), CrowdError> {
        assert!(moment < self.moments, "no moment {moment}");
        assert!(wearer < self.wearers, "no wearer {wearer}");
        let each = [out.len(), normals.len()];
        assert_eq!(each, [self.n_verts(); 2], "one entry per vertex");
        let room = self.room.as_ref().expect("there are moments");
        let n = 3 * self.n_verts();
        let at = (moment * self.wearers + wearer) * n;
        for (from, to) in [(&room.x, out), (&room.normals, normals)] {
            let from = from.slice(at..at + n);
            self.stream.memcpy_dtoh(&from, to.as_flattened_mut())?;
        }
        self.stream.synchronize()?;
        Ok(())
    }
}

/// What the blocks of `drape` share [bytes].
fn shared(l: &Layout, frames: u32) -> u32 {
    4 * frames * (l.n_codes + 12 * l.n_bones)
}
