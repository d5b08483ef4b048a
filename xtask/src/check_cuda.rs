//! `cargo xtask check cuda`: the kernels before CUDA's own compiler and assembler, which need no device.
//!
//! For devices from Turing to Hopper, and for the most and the fewest frames a block: they must compile without a
//! warning and spill nothing. Whether they do what they should is for the tests of `muslin-model` and `muslin-train`, which
//! run them on this machine's processor, and on a device where there is one.

use std::process::Command;

use crate::{Outcome, python};

/// NVIDIA's, under its CUDA EULA: only looked at, in a throw-away environment.
const COMPILERS: [&str; 2] = [
    "nvidia-cuda-nvrtc-cu12==12.9.*",
    "nvidia-cuda-nvcc-cu12==12.9.*",
];

/// Where kernels are, and sets of macros that they are told.
const SOURCES: [(&str, &[&str]); 2] = [
    (
        "crates/muslin-model/src/cuda/kernels.cu",
        &["-DFRAMES=16 -DBLOCK=128", "-DFRAMES=1 -DBLOCK=128"],
    ),
    (
        "crates/muslin-train/src/cuda/kernels.cu",
        &["-DBLOCK=128 -DSOLVERS=1024 -DABREAST=32"],
    ),
];

/// Compiles them all.
pub fn run() -> Outcome {
    let folder = std::env::temp_dir().join("muslin-xtask").join("check-cuda");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let python = python::environment(&folder.join("venv"), &COMPILERS)?;
    for (kernels, told) in SOURCES {
        let status = Command::new(&python)
            .args(["xtask/python/nvrtc.py", kernels])
            .arg(&folder)
            .args(told)
            .status()
            .map_err(|e| format!("python: {e}"))?;
        if !status.success() {
            return Err(format!("the kernels of {kernels} are not sound"));
        }
    }
    Ok(())
}
