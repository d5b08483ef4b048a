//! What the keypoints of a person say about the markers of the body.

use crate::fold::N_MARKERS;
use glam::{DQuat, DVec2, DVec3};
use muslin_body::{Keypoints, Layout, REGRESSED};

/// Points below this score say nothing.
const LEAST_SCORE: f64 = 0.05;

/// How much a point beyond the picture's edge counts.
const BEYOND: f64 = 0.15;

/// What is known about one marker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Which marker.
    pub marker: usize,
    /// Where it is in the picture, from the middle, y up [px].
    pub pixel: DVec2,
    /// Where it is in space, about some origin [m]; axes of the camera.
    pub world: Option<DVec3>,
    /// How sure the detector is, 0 to 1.
    pub score: f64,
    /// One standard deviation relative to that of a good joint.
    pub spread: f64,
}

/// All that is known about one person.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// In order of the markers.
    pub seen: Vec<Seen>,
    /// Largest extent of the seen points in the picture [px].
    pub size: f64,
    /// Middle of the picture [px].
    pub centre: DVec2,
    /// Longer side of the picture [px].
    pub longest: f64,
}

impl Evidence {
    /// Sorts the keypoints by marker; points that are missing or not finite are left out.
    pub fn new(keypoints: &Keypoints) -> Evidence {
        let [w, h] = keypoints.image_size.map(f64::from);
        let centre = 0.5 * DVec2::new(w, h);
        let mut seen = Vec::new();
        for (i, point) in keypoints.points.iter().enumerate() {
            let world = keypoints.world.as_ref().and_then(|w| w.get(i).copied());
            let finite = point.pixel.is_finite() && world.is_none_or(DVec3::is_finite);
            let Some((marker, spread)) = marker(keypoints.layout, i) else {
                continue;
            };
            // Beyond the edge a point is guessed, whatever its score.
            let inside = point.pixel.cmpge(DVec2::ZERO) & point.pixel.cmple(2.0 * centre);
            let score = point.score.min(1.0) * if inside.all() { 1.0 } else { BEYOND };
            if finite && score >= LEAST_SCORE {
                let pixel = (point.pixel - centre) * DVec2::new(1.0, -1.0);
                seen.push(Seen {
                    marker,
                    pixel,
                    world,
                    score,
                    spread,
                });
            }
        }
        seen.sort_by_key(|s| s.marker);
        let low = seen.iter().fold(DVec2::INFINITY, |m, s| m.min(s.pixel));
        let high = seen.iter().fold(DVec2::NEG_INFINITY, |m, s| m.max(s.pixel));
        let size = if seen.is_empty() {
            0.0
        } else {
            (high - low).max_element()
        };
        Evidence {
            seen,
            size,
            centre,
            longest: w.max(h),
        }
    }

    /// The pixel and world place of a marker, if seen.
    pub fn marker(&self, marker: usize) -> Option<&Seen> {
        self.seen
            .binary_search_by_key(&marker, |s| s.marker)
            .ok()
            .map(|i| &self.seen[i])
    }

    /// Whether most points have a place in space.
    pub fn has_depth(&self) -> bool {
        2 * self.seen.iter().filter(|s| s.world.is_some()).count() > self.seen.len()
    }

    /// Turns the places in space from the frame of the ray to the person into the camera's.
    ///
    /// A detector that looks at a cut-out of the picture takes its middle for straight ahead.
    pub fn turn_from_ray(&mut self, focal: f64) {
        let sum: DVec2 = self.seen.iter().map(|s| s.pixel).sum();
        let middle = sum / self.seen.len().max(1) as f64;
        let ray = DVec3::new(middle.x, middle.y, -focal).normalize();
        let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, ray);
        for seen in &mut self.seen {
            seen.world = seen.world.map(|w| turn * w);
        }
    }
}

/// The marker of point `i`, and how much less exactly it is found than a joint.
fn marker(layout: Layout, i: usize) -> Option<(usize, f64)> {
    if let Some([a, b]) = layout.regressed(i) {
        // The middle of two points that are there themselves says nothing new.
        return (a == b).then_some((a, spread(a)));
    }
    let knuckle = match (layout, i) {
        (Layout::BlazePose33, 17..=22) => i - 17,
        _ => return None,
    };
    Some((REGRESSED.len() + knuckle, 2.0))
}

/// Joints under clothes are guessed, ends of feet are blurred; faces and wrists are seen.
fn spread(marker: usize) -> f64 {
    match marker {
        0..=4 => 0.8,
        11 | 12 => 1.4,
        17..N_MARKERS => 1.5,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use muslin_body::Keypoint;

    #[test]
    fn points_that_say_nothing_are_left_out() {
        let point = |x: f64, score| Keypoint {
            pixel: DVec2::new(x, 10.0),
            score,
        };
        let mut points = vec![point(5.0, 0.9); 17];
        points[3].score = 0.0;
        points[4].pixel.x = f64::NAN;
        let keypoints = Keypoints {
            layout: Layout::Coco17,
            points,
            world: None,
            image_size: [20, 40],
        };
        let evidence = Evidence::new(&keypoints);
        assert_eq!(evidence.seen.len(), 15);
        assert!(evidence.marker(3).is_none() && evidence.marker(5).is_some());
        assert_eq!(evidence.seen[0].pixel, DVec2::new(-5.0, 10.0));
    }

    #[test]
    fn middles_of_other_points_are_not_counted_twice() {
        assert_eq!(marker(Layout::Body25, 1), None);
        assert_eq!(marker(Layout::Body25, 8), None);
        assert_eq!(
            marker(Layout::Body25, 5).map(|m| REGRESSED[m.0]),
            Some("left_shoulder")
        );
        assert_eq!(marker(Layout::BlazePose33, 17).map(|m| m.0), Some(23));
    }
}
