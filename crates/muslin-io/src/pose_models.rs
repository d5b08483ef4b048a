//! The pose networks that are part of the program.

use muslin_net::Graph;

use crate::tflite::{TfliteError, read_tflite};

static DETECTOR: &[u8] = include_bytes!("../../../assets/pose/pose_detection.tflite");
static LANDMARKS: &[u8] = include_bytes!("../../../assets/pose/pose_landmark_full.tflite");

/// The networks that find people and their joints, from MediaPipe 0.10.14.
pub struct PoseGraphs {
    /// Finds people in a whole picture.
    pub detector: Graph,
    /// Finds the points of one person in an upright square.
    pub landmarks: Graph,
}

/// Reads the embedded pose networks; an error means a damaged program.
pub fn pose_graphs() -> Result<PoseGraphs, TfliteError> {
    Ok(PoseGraphs {
        detector: read_tflite(DETECTOR)?,
        landmarks: read_tflite(LANDMARKS)?,
    })
}
