//! Any rigged avatar: shape, skeleton, pose, motion, skinning, measurements.
