//! The pinhole every picture is taken through.

use glam::{DAffine3, DMat3, DVec2, DVec3};

/// A pinhole camera.
///
/// Camera axes: x to the right of the picture, y up, z towards the viewer, so
/// it looks along its own -z. Pixel (i, j) spans [i, i+1) × [j, j+1), y down.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Columns of the picture [px].
    pub width: usize,
    /// Rows of the picture [px].
    pub height: usize,
    /// Focal length [px].
    pub focal: f64,
    /// Where the optical axis meets the picture [px].
    pub centre: DVec2,
    /// The camera's place and attitude; a rotation and a translation.
    pub world_from_camera: DAffine3,
}

/// From where, and how wide, a figure is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Columns of the picture [px].
    pub width: usize,
    /// Rows of the picture [px].
    pub height: usize,
    /// Round the figure [rad]: 0 faces it from +Z, π/2 from +X.
    pub yaw: f64,
    /// How far the camera looks down [rad], within ±π/2.
    pub pitch: f64,
    /// Vertical field of view [rad]; a portrait lens has 0.2 to 0.35.
    pub fov: f64,
    /// Free border on each side, as a share of the picture, below one half.
    pub margin: f64,
}

impl Default for View {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            yaw: 0.0,
            pitch: 0.07,
            fov: 0.3,
            margin: 0.06,
        }
    }
}

impl Camera {
    /// The nearest camera of `view` that sees all `points` [m] inside the margin.
    ///
    /// Without points it looks at the origin from one metre.
    pub fn framing(points: &[DVec3], view: &View) -> Self {
        let axes = axes(view.yaw, view.pitch);
        let tan = view.half_tan();
        let reach = Reach::of(points, axes, DVec3::ZERO, tan);
        let at = (reach.hi + reach.lo) * 0.5;
        view.camera(axes, axes * at.extend(reach.distance(tan)))
    }

    /// `count` cameras of one size and height on a circle, as if the figure turned
    /// round its own middle once; every one of them sees all `points` [m].
    pub fn orbit(points: &[DVec3], view: &View, count: usize) -> Vec<Self> {
        let pivot = middle(points);
        let step = std::f64::consts::TAU / count.max(1) as f64;
        let turns: Vec<DMat3> = (0..count)
            .map(|i| axes(view.yaw + step * i as f64, view.pitch))
            .collect();
        let tan = view.half_tan();
        let reaches = turns
            .iter()
            .map(|&axes| Reach::of(points, axes, pivot, tan));
        let mut all = reaches.reduce(Reach::join).unwrap_or_default();
        all.hi.x = all.hi.x.max(-all.lo.x);
        all.lo.x = -all.hi.x;
        let seat = DVec3::new(0.0, (all.hi.y + all.lo.y) * 0.5, all.distance(tan));
        turns
            .into_iter()
            .map(|axes| view.camera(axes, pivot + axes * seat))
            .collect()
    }

    /// Where a world point [m] falls [px] and how far along the axis it lies [m].
    ///
    /// Points beside or behind the camera (depth ≤ 0) have no meaningful pixel.
    pub fn project(&self, point: DVec3) -> (DVec2, f64) {
        let p = self.world_from_camera.inverse().transform_point3(point);
        let depth = -p.z;
        (
            self.centre + DVec2::new(p.x, -p.y) * (self.focal / depth),
            depth,
        )
    }

    /// The same camera with a picture `scale` times as large.
    pub(crate) fn scaled(&self, width: usize, height: usize) -> Self {
        let sx = width as f64 / self.width.max(1) as f64;
        let sy = height as f64 / self.height.max(1) as f64;
        let focal = self.focal * 0.5 * (sx + sy);
        let centre = self.centre * DVec2::new(sx, sy);
        Self {
            width,
            height,
            focal,
            centre,
            world_from_camera: self.world_from_camera,
        }
    }
}

impl View {
    /// Tangents of half the usable field, across and down.
    fn half_tan(&self) -> DVec2 {
        let t = (self.fov * 0.5).tan();
        let aspect = self.width as f64 / self.height.max(1) as f64;
        DVec2::new(t * aspect, t) * (1.0 - 2.0 * self.margin)
    }

    fn camera(&self, axes: DMat3, place: DVec3) -> Camera {
        let size = DVec2::new(self.width as f64, self.height as f64);
        Camera {
            width: self.width,
            height: self.height,
            focal: size.y * 0.5 / (self.fov * 0.5).tan(),
            centre: size * 0.5,
            world_from_camera: DAffine3::from_mat3_translation(axes, place),
        }
    }
}

/// Right, up and backwards of a camera at a yaw and pitch.
fn axes(yaw: f64, pitch: f64) -> DMat3 {
    let right = DVec3::new(yaw.cos(), 0.0, -yaw.sin());
    let back = DVec3::new(
        yaw.sin() * pitch.cos(),
        pitch.sin(),
        yaw.cos() * pitch.cos(),
    );
    DMat3::from_cols(right, back.cross(right), back)
}

/// Middle of the bounding box; the origin if there are no points.
fn middle(points: &[DVec3]) -> DVec3 {
    let lo = points
        .iter()
        .copied()
        .reduce(DVec3::min)
        .unwrap_or_default();
    let hi = points
        .iter()
        .copied()
        .reduce(DVec3::max)
        .unwrap_or_default();
    (lo + hi) * 0.5
}

/// How far a figure reaches across the widest sight lines of a field of view.
///
/// A camera at (o, d) with half tangent t sees (x, z) when
/// o - t d ≤ x - t z and x + t z ≤ o + t d: two extremes settle o and d.
#[derive(Clone, Copy, Default)]
struct Reach {
    lo: DVec2,
    hi: DVec2,
}

impl Reach {
    fn of(points: &[DVec3], axes: DMat3, pivot: DVec3, tan: DVec2) -> Self {
        let each = points.iter().map(|&p| {
            let q = axes.transpose() * (p - pivot);
            Self {
                lo: q.truncate() - tan * q.z,
                hi: q.truncate() + tan * q.z,
            }
        });
        each.reduce(Self::join).unwrap_or_default()
    }

    fn join(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    /// Distance from the pivot [m]; a lone point is seen from one metre.
    fn distance(&self, tan: DVec2) -> f64 {
        let d = ((self.hi - self.lo) / (2.0 * tan)).max_element();
        if d > 1e-9 { d } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn box_corners() -> Vec<DVec3> {
        let side = |b: usize, i: usize| if b >> i & 1 == 0 { -1.0 } else { 1.0 };
        let corner = |b| DVec3::new(0.3 * side(b, 0), 0.9 * side(b, 1) + 0.9, 0.2 * side(b, 2));
        (0..8).map(corner).collect()
    }

    #[test]
    fn framing_is_tight_and_keeps_the_margin() {
        let view = View {
            yaw: 0.7,
            width: 600,
            height: 800,
            ..View::default()
        };
        let cam = Camera::framing(&box_corners(), &view);
        let px: Vec<DVec2> = box_corners().iter().map(|&p| cam.project(p).0).collect();
        let lo = px.iter().copied().reduce(DVec2::min).unwrap();
        let hi = px.iter().copied().reduce(DVec2::max).unwrap();
        assert!(
            (lo.y - 48.0).abs() < 1e-6 && (hi.y - 752.0).abs() < 1e-6,
            "{lo} {hi}"
        );
        assert!(lo.x >= 36.0 - 1e-6 && hi.x <= 564.0 + 1e-6);
    }

    #[test]
    fn the_figures_left_is_on_the_right_of_a_frontal_picture() {
        let cam = Camera::framing(&box_corners(), &View::default());
        assert!(cam.project(DVec3::X).0.x > cam.project(DVec3::ZERO).0.x);
        assert!(cam.project(DVec3::Y).0.y < cam.project(DVec3::ZERO).0.y);
        let side = View {
            yaw: std::f64::consts::FRAC_PI_2,
            ..View::default()
        };
        let cam = Camera::framing(&box_corners(), &side);
        assert!(
            cam.project(DVec3::X).1 < cam.project(DVec3::ZERO).1,
            "+X is nearer"
        );
    }

    #[test]
    fn an_orbit_sees_everything_from_everywhere() {
        let view = View::default();
        for cam in Camera::orbit(&box_corners(), &view, 7) {
            for p in box_corners() {
                let (px, depth) = cam.project(p);
                assert!(depth > 0.0 && px.min_element() > 61.0 && px.max_element() < 963.0);
            }
        }
    }
}
