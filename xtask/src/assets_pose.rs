//! `cargo xtask assets pose [WHEEL]`: the two pose networks out of the mediapipe package.

use std::path::Path;

use crate::wheel::{self, Pin};

/// Where the networks come from. Code and models are Apache-2.0.
const MEDIAPIPE: Pin = Pin {
    requirement: "mediapipe==0.10.14",
    file: "mediapipe-0.10.14-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
    sha256: "a807328339e7356fda0bb14df12fedbf1d33bdf81649c5f8666b0026b1cc30b4",
};

/// In the package, and in the assets.
const FILES: [(&str, &str); 3] = [
    (
        "mediapipe/modules/pose_detection/pose_detection.tflite",
        "pose_detection.tflite",
    ),
    (
        "mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
        "pose_landmark_full.tflite",
    ),
    ("mediapipe-0.10.14.dist-info/LICENSE", "LICENSE"),
];

/// Copies the networks into `assets/pose`; `wheel` is a local copy of the package.
pub fn build(wheel: Option<&str>) -> Result<(), String> {
    let archive = wheel::open(&MEDIAPIPE, wheel)?;
    let folder = Path::new("assets/pose");
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    for (from, to) in FILES {
        let bytes = archive.file(from)?;
        let path = folder.join(to);
        std::fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!(
            "{:>9} bytes  {}  {}",
            bytes.len(),
            crate::sha256::hex(&bytes),
            path.display()
        );
    }
    Ok(())
}
