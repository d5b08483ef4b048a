//! The CUDA device that this machine has, if it has one, and kernels for it.
//!
//! Driver and compiler are found when the program runs: a program that was built with the feature `cuda` starts on any
//! machine.

#![allow(unsafe_code)]

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Arc;

use cudarc::driver::{CudaContext, CudaModule, DriverError};
use cudarc::nvrtc::{CompileOptions, compile_ptx_with_opts};

use crate::CrowdError;

impl From<DriverError> for CrowdError {
    fn from(e: DriverError) -> Self {
        Self::Failed(format!("{e:?}"))
    }
}

/// Whether the driver and its compiler are here; why not.
fn at_hand() -> Result<(), CrowdError> {
    // SAFETY: looks for libraries by name, and calls nothing of them.
    let here = unsafe {
        [
            cudarc::driver::sys::is_culib_present(),
            cudarc::nvrtc::sys::is_culib_present(),
        ]
    };
    match here {
        [true, true] => Ok(()),
        [false, _] => Err(CrowdError::NoDevice("no NVIDIA driver is installed".into())),
        [_, false] => Err(CrowdError::NoDevice(
            "the driver is here but not NVRTC, CUDA's compiler; install the CUDA toolkit's libnvrtc".into(),
        )),
    }
}

/// The first CUDA device.
///
/// # Errors
/// [`CrowdError::NoDevice`] where there is none, or one whose driver or compiler cannot be used; it says what is missing.
pub fn first() -> Result<Arc<CudaContext>, CrowdError> {
    at_hand()?;
    // A driver that is too old for what is asked of it is found out by panics, which are nobody else's business.
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    let asked = catch_unwind(AssertUnwindSafe(|| CudaContext::new(0)));
    set_hook(hook);
    match asked {
        Ok(Ok(context)) => Ok(context),
        Ok(Err(e)) => Err(CrowdError::NoDevice(format!("{e:?}"))),
        Err(_) => Err(CrowdError::NoDevice("its driver is too old".into())),
    }
}

/// A device's name.
pub fn name(context: &CudaContext) -> String {
    let name = context.name();
    name.unwrap_or_else(|_| "a CUDA device".into())
}

/// Kernels for this device, of their source and of the macros that it is told.
///
/// # Errors
/// [`CrowdError::NoDevice`] if the device's own compiler refuses them, and whatever fails on the device.
pub fn compiled(
    context: &Arc<CudaContext>,
    source: &str,
    told: &[(&str, u32)],
) -> Result<Arc<CudaModule>, CrowdError> {
    let (major, minor) = context.compute_capability()?;
    let mut options = vec![format!("--gpu-architecture=compute_{major}{minor}")];
    options.extend(told.iter().map(|(name, value)| format!("-D{name}={value}")));
    let options = CompileOptions {
        options,
        ..CompileOptions::default()
    };
    let refused = |e| CrowdError::NoDevice(format!("its compiler refuses our kernels: {e:?}"));
    let ptx = compile_ptx_with_opts(source, options).map_err(refused)?;
    Ok(context.load_module(ptx)?)
}
