//! Where kernels run: a CUDA device, or in tests this machine's own processor.
//!
//! All arrays are of numbers of four bytes; counts lie in them as the bits of floats. The kernels are `cuda/kernels.cu`; their
//! safe twin is `Trainer`, which they are compared with step by step.

#![allow(unsafe_code)]

#[cfg(test)]
mod emulated;
mod learner;
mod parts;
mod upload;

#[cfg(feature = "cuda")]
pub use learner::OnDevice;

#[cfg(feature = "cuda")]
use std::collections::HashMap;
#[cfg(feature = "cuda")]
use std::sync::Arc;

#[cfg(feature = "cuda")]
use cudarc::driver::{CudaFunction, CudaSlice, CudaStream, LaunchConfig, PushKernelArg};
use muslin_model::CrowdError;

#[cfg(feature = "cuda")]
const KERNELS: &str = include_str!("cuda/kernels.cu");
/// Their names.
#[cfg(feature = "cuda")]
const NAMES: [&str; 19] = [
    "dense",
    "dense_slope",
    "dense_back",
    "place",
    "walls",
    "patches",
    "gather",
    "count",
    "weigh",
    "outer",
    "code_parts",
    "code_slope",
    "adam",
    "remember",
    "solve",
    "lead",
    "farthest",
    "shorten",
    "move",
];

/// Something that runs kernels.
#[derive(Debug)]
pub enum Device {
    /// The first CUDA device.
    #[cfg(feature = "cuda")]
    Cuda(Cuda),
    /// The processor.
    #[cfg(test)]
    Emulated(emulated::Emulated),
}

/// A CUDA device with our kernels.
#[cfg(feature = "cuda")]
#[derive(Debug)]
pub struct Cuda {
    stream: Arc<CudaStream>,
    kernels: HashMap<&'static str, CudaFunction>,
}

/// Numbers on a device.
#[derive(Debug)]
pub(crate) enum Array {
    #[cfg(feature = "cuda")]
    Cuda(CudaSlice<f32>),
    #[cfg(test)]
    Emulated(Vec<std::cell::Cell<f32>>),
}

/// What a kernel is told.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Arg<'a> {
    Array(&'a Array),
    Count(u32),
    Number(f32),
}

impl<'a> From<&'a Array> for Arg<'a> {
    fn from(array: &'a Array) -> Self {
        Self::Array(array)
    }
}

impl From<u32> for Arg<'_> {
    fn from(count: u32) -> Self {
        Self::Count(count)
    }
}

impl From<f32> for Arg<'_> {
    fn from(number: f32) -> Self {
        Self::Number(number)
    }
}

/// The arguments of a kernel, one after the other.
macro_rules! told {
    ($($arg:expr),* $(,)?) => { &[$(crate::cuda::Arg::from($arg)),*] };
}
pub(crate) use told;

impl Device {
    /// The first CUDA device of this machine.
    ///
    /// # Errors
    /// Where there is none, or the program was built without the feature `cuda`.
    pub fn cuda() -> Result<Self, CrowdError> {
        #[cfg(feature = "cuda")]
        {
            let context = muslin_model::device::first()?;
            let sizes = [
                ("BLOCK", CUDA_BLOCK),
                ("SOLVERS", CUDA_SOLVERS),
                ("ABREAST", 32),
            ];
            let module = muslin_model::device::compiled(&context, KERNELS, &sizes)?;
            let kernels = NAMES.map(|name| Ok((name, module.load_function(name)?)));
            let kernels: Result<_, CrowdError> = kernels.into_iter().collect();
            Ok(Self::Cuda(Cuda {
                stream: context.default_stream(),
                kernels: kernels?,
            }))
        }
        #[cfg(not(feature = "cuda"))]
        Err(CrowdError::NotBuilt)
    }

    /// Its name.
    pub fn name(&self) -> String {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(d) => muslin_model::device::name(d.stream.context()),
            #[cfg(test)]
            Self::Emulated(_) => "this machine's processor".into(),
        }
    }

    /// Threads of a block that work together.
    pub(crate) fn block(&self) -> u32 {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(_) => CUDA_BLOCK,
            #[cfg(test)]
            Self::Emulated(_) => emulated::BLOCK,
        }
    }

    /// Threads of a block that solves.
    pub(crate) fn solvers(&self) -> u32 {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(_) => CUDA_SOLVERS,
            #[cfg(test)]
            Self::Emulated(_) => emulated::SOLVERS,
        }
    }

    /// These numbers; one at least, so that there is an array.
    pub(crate) fn put(&self, numbers: &[f32]) -> Result<Array, CrowdError> {
        let numbers = if numbers.is_empty() { &[0.0] } else { numbers };
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(d) => Ok(Array::Cuda(d.stream.clone_htod(numbers)?)),
            #[cfg(test)]
            Self::Emulated(_) => Ok(Array::Emulated(
                numbers.iter().map(|x| std::cell::Cell::new(*x)).collect(),
            )),
        }
    }

    /// These counts.
    pub(crate) fn put_counts(&self, counts: &[u32]) -> Result<Array, CrowdError> {
        self.put(&bits(counts))
    }

    /// Room for so many numbers, all of them zero.
    pub(crate) fn room(&self, n: usize) -> Result<Array, CrowdError> {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(d) => Ok(Array::Cuda(d.stream.alloc_zeros(n.max(1))?)),
            #[cfg(test)]
            Self::Emulated(_) => self.put(&vec![0.0; n]),
        }
    }

    /// Writes numbers over the first of an array.
    pub(crate) fn write(&self, array: &mut Array, numbers: &[f32]) -> Result<(), CrowdError> {
        match (self, array) {
            #[cfg(feature = "cuda")]
            (Self::Cuda(d), Array::Cuda(to)) => {
                if !numbers.is_empty() {
                    let mut to = to.slice_mut(..numbers.len());
                    d.stream.memcpy_htod(numbers, &mut to)?;
                }
            }
            #[cfg(test)]
            (Self::Emulated(_), Array::Emulated(to)) => {
                let to = to[..numbers.len()].iter();
                to.zip(numbers).for_each(|(to, x)| to.set(*x));
            }
            #[cfg(all(test, feature = "cuda"))]
            _ => panic!("an array of another device"),
        }
        Ok(())
    }

    /// All numbers of an array.
    pub(crate) fn read(&self, array: &Array) -> Result<Vec<f32>, CrowdError> {
        match (self, array) {
            #[cfg(feature = "cuda")]
            (Self::Cuda(d), Array::Cuda(from)) => {
                let out = d.stream.clone_dtoh(from)?;
                d.stream.synchronize()?;
                Ok(out)
            }
            #[cfg(test)]
            (Self::Emulated(_), Array::Emulated(from)) => {
                Ok(from.iter().map(std::cell::Cell::get).collect())
            }
            #[cfg(all(test, feature = "cuda"))]
            _ => panic!("an array of another device"),
        }
    }

    /// A thread each for `n` things, or for what a number of whole blocks takes.
    pub(crate) fn over(
        &self,
        kernel: &'static str,
        n: usize,
        args: &[Arg<'_>],
    ) -> Result<(), CrowdError> {
        self.launch((kernel, self.block()), [self.blocks(n), 1], args)
    }

    /// Blocks that have a thread each for `n` things.
    pub(crate) fn blocks(&self, n: usize) -> u32 {
        n.div_ceil(self.block() as usize) as u32
    }

    /// Runs a kernel over so many blocks of so many threads. `args` are those that it has, in their order.
    pub(crate) fn launch(
        &self,
        (kernel, block): (&'static str, u32),
        grid: [u32; 2],
        args: &[Arg<'_>],
    ) -> Result<(), CrowdError> {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda(d) => {
                let mut job = d.stream.launch_builder(&d.kernels[kernel]);
                for arg in args {
                    match arg {
                        Arg::Array(Array::Cuda(array)) => job.arg(array),
                        Arg::Count(count) => job.arg(count),
                        Arg::Number(number) => job.arg(number),
                        #[cfg(test)]
                        Arg::Array(Array::Emulated(_)) => panic!("an array of another device"),
                    };
                }
                let over = LaunchConfig {
                    grid_dim: (grid[0], grid[1], 1),
                    block_dim: (block, 1, 1),
                    shared_mem_bytes: 0,
                };
                // SAFETY: the kernel's own arguments, in number, order and kind, which the tests hold against its
                // definition on this machine's processor; one stream, so that kernels follow each other.
                unsafe { job.launch(over) }?;
                Ok(())
            }
            #[cfg(test)]
            Self::Emulated(d) => {
                d.launch((kernel, block), grid, args);
                Ok(())
            }
        }
    }
}

/// Threads of a block on a CUDA device, and of one that solves.
#[cfg(feature = "cuda")]
const CUDA_BLOCK: u32 = 128;
#[cfg(feature = "cuda")]
const CUDA_SOLVERS: u32 = 1024;

/// Counts as the bits of floats.
pub(crate) fn bits(counts: &[u32]) -> Vec<f32> {
    counts.iter().map(|n| f32::from_bits(*n)).collect()
}
