//! The lamps: one key light, and softboxes on a dome that turns with the camera.

use glam::Vec3;

use crate::camera::Camera;

/// The lights of one picture, standing round the figure as the camera does.
pub(crate) struct Studio {
    right: Vec3,
    back: Vec3,
    /// Unit vector towards the key light.
    pub key_dir: Vec3,
    /// The key light's strength on a surface that faces it.
    pub key: Vec3,
}

/// Tangent of the key light's angular radius.
pub(crate) const KEY_RADIUS: f32 = 0.075;

impl Studio {
    /// Lights placed for a camera; its pitch does not tip them over.
    pub fn new(camera: &Camera) -> Self {
        let right = camera.world_from_camera.matrix3.x_axis.as_vec3();
        let level = Vec3::new(right.x, 0.0, right.z).normalize_or(Vec3::X);
        let back = level.cross(Vec3::Y);
        let key_dir = (level * -0.72 + Vec3::Y * 0.85 + back * 0.62).normalize();
        Self {
            right: level,
            back,
            key_dir,
            key: Vec3::new(0.98, 0.955, 0.92),
        }
    }

    /// Light that comes from a direction of the dome.
    pub fn radiance(&self, dir: Vec3) -> Vec3 {
        let d = Vec3::new(dir.dot(self.right), dir.y, dir.dot(self.back));
        let lobe = |at: Vec3, power: i32| d.dot(at.normalize()).max(0.0).powi(power);
        let floor = Vec3::new(0.24, 0.235, 0.225);
        let ceiling = Vec3::new(0.30, 0.31, 0.33);
        let fill = lobe(Vec3::new(0.85, 0.15, 0.5), 3) * 0.30;
        let top = lobe(Vec3::new(-0.1, 1.0, 0.25), 6) * 0.6;
        let rim_left = lobe(Vec3::new(-0.8, 0.35, -0.55), 10) * 1.5;
        let rim_right = lobe(Vec3::new(0.8, 0.35, -0.6), 10) * 2.2;
        floor.lerp(ceiling, 0.5 + 0.5 * d.y)
            + Vec3::new(0.97, 0.99, 1.03) * (fill + top)
            + Vec3::new(1.0, 1.0, 1.02) * (rim_left + rim_right)
    }
}
