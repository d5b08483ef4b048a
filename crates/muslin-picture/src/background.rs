//! What is seen where nothing stands.

use glam::{Vec2, Vec3, Vec4};

use crate::Background;

/// Colour and opacity of the backdrop at a pixel, under a floor that lets
/// `light` (0 to 1) through; colour is premultiplied.
pub(crate) fn backdrop(background: &Background, pixel: Vec2, size: Vec2, light: f32) -> Vec4 {
    match *background {
        Background::Transparent => Vec4::new(0.0, 0.0, 0.0, 1.0 - light),
        Background::Plain(colour) => (Vec3::from(colour) * shadow_tint(light)).extend(1.0),
        Background::Gradient { centre, edge } => {
            let off = (pixel / size - Vec2::new(0.5, 0.46)) * Vec2::new(1.25, 1.1);
            let t = (off.length() / 0.78).min(1.0);
            let t = t * t * (3.0 - 2.0 * t);
            let colour = Vec3::from(centre).lerp(Vec3::from(edge), t);
            (colour * shadow_tint(light)).extend(1.0)
        }
    }
}

/// Shadows on a studio floor are a little cool: the key light is warm.
fn shadow_tint(light: f32) -> Vec3 {
    let shade = 1.0 - light;
    Vec3::new(1.0 - shade, 1.0 - 0.985 * shade, 1.0 - 0.965 * shade)
}

/// Whether the backdrop needs dithering against bands.
pub(crate) fn is_graded(background: &Background) -> bool {
    matches!(background, Background::Gradient { .. })
}
