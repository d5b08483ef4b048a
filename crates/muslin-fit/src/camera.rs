//! The camera that took the picture.

use glam::{DAffine3, DVec2, DVec3};

/// A pinhole camera that looks along its own −z, x to the right and y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal length [px].
    pub focal: f64,
    /// Where the axis meets the picture [px], y down.
    pub centre: DVec2,
    /// Where the camera stands in the world, and how it is turned.
    pub world_from_camera: DAffine3,
}

impl Camera {
    /// Where a point of the world is in the picture [px], y down; none behind the camera.
    pub fn project(&self, world: DVec3) -> Option<DVec2> {
        self.view(self.world_from_camera.inverse().transform_point3(world))
    }

    /// The same for many points at once.
    pub fn project_all(&self, world: &[DVec3]) -> Vec<Option<DVec2>> {
        let camera_from_world = self.world_from_camera.inverse();
        world
            .iter()
            .map(|p| self.view(camera_from_world.transform_point3(*p)))
            .collect()
    }

    /// Where a point in the camera's frame is in the picture.
    fn view(&self, p: DVec3) -> Option<DVec2> {
        let depth = -p.z;
        (depth > 1e-6).then(|| self.centre + self.focal / depth * DVec2::new(p.x, -p.y))
    }
}
