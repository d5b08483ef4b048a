//! Points of a body that a detector finds in a picture.

use glam::{DVec2, DVec3};

/// One point found in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Place in the picture [px], x to the right and y down.
    pub pixel: DVec2,
    /// How sure the detector is that the point is there and seen, 0 to 1.
    pub score: f64,
}

/// Which points, in which order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// 33 points: face, arms, hands, legs, feet (BlazePose).
    BlazePose33,
    /// 17 points: nose, eyes, ears, shoulders to wrists, hips to ankles (COCO).
    Coco17,
    /// 25 points: Coco17 with neck, middle of the hips and feet (OpenPose).
    Body25,
}

/// The points of one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Keypoints {
    /// Which points these are.
    pub layout: Layout,
    /// One for each of the layout's points.
    pub points: Vec<Keypoint>,
    /// The same points in space [m], about the middle of the hips: x to the picture's
    /// right, y up, z toward the camera. Absent where a detector sees only the plane.
    pub world: Option<Vec<DVec3>>,
    /// Width and height of the picture [px].
    pub image_size: [u32; 2],
}

/// The points that [`crate::Avatar::regressors`] finds on the body, in its row order.
pub const REGRESSED: [&str; 23] = [
    "nose",
    "left_eye",
    "right_eye",
    "left_ear",
    "right_ear",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_big_toe",
    "right_big_toe",
    "left_small_toe",
    "right_small_toe",
    "left_heel",
    "right_heel",
];

/// COCO's 17 points as rows of [`REGRESSED`].
pub const COCO17: [usize; 17] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];

/// OpenPose's 25 points as the one or two rows of [`REGRESSED`] whose middle they are.
pub const BODY25: [[usize; 2]; 25] = [
    [0, 0],
    [5, 6],
    [6, 6],
    [8, 8],
    [10, 10],
    [5, 5],
    [7, 7],
    [9, 9],
    [11, 12],
    [12, 12],
    [14, 14],
    [16, 16],
    [11, 11],
    [13, 13],
    [15, 15],
    [2, 2],
    [1, 1],
    [4, 4],
    [3, 3],
    [17, 17],
    [19, 19],
    [21, 21],
    [18, 18],
    [20, 20],
    [22, 22],
];

impl Layout {
    /// How many points a person has.
    pub fn n_points(self) -> usize {
        match self {
            Layout::BlazePose33 => 33,
            Layout::Coco17 => 17,
            Layout::Body25 => 25,
        }
    }

    /// Where point `i` lies on the body: the row or the two rows of [`REGRESSED`] whose
    /// middle it is; none where the body has no such point (mouth, fingers, eye corners).
    pub fn regressed(self, i: usize) -> Option<[usize; 2]> {
        match self {
            Layout::Coco17 => COCO17.get(i).map(|&r| [r, r]),
            Layout::Body25 => BODY25.get(i).copied(),
            Layout::BlazePose33 => blazepose(i).map(|r| [r, r]),
        }
    }
}

/// BlazePose's points that COCO's also name.
fn blazepose(i: usize) -> Option<usize> {
    Some(match i {
        0 => 0,
        2 => 1,
        5 => 2,
        7 => 3,
        8 => 4,
        11..=16 => i - 6,
        23..=28 => i - 12,
        29 => 21,
        30 => 22,
        31 => 17,
        32 => 18,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_agree_on_left_and_right() {
        let name = |l: Layout, i: usize| l.regressed(i).map(|r| REGRESSED[r[0]]);
        assert_eq!(name(Layout::BlazePose33, 11), Some("left_shoulder"));
        assert_eq!(name(Layout::BlazePose33, 28), Some("right_ankle"));
        assert_eq!(name(Layout::BlazePose33, 32), Some("right_big_toe"));
        assert_eq!(name(Layout::Body25, 4), Some("right_wrist"));
        assert_eq!(name(Layout::Body25, 21), Some("left_heel"));
        assert_eq!(name(Layout::BlazePose33, 9), None);
    }
}
