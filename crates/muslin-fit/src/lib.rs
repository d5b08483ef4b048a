//! From a photo or keypoints to a posed, measured body.
