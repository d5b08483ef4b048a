//! Pictures of a dressed figure.

use glam::DVec3;
use muslin_body::{Avatar, Part};
use muslin_fit::Camera as Eye;
use muslin_garment::{Fabric, Weave as Cross};
use muslin_geom::Image;
use muslin_picture::{
    Background, Camera, Ground, Layer, Material, Options, Part as Shown, Scene, Stage, View, Weave,
    WeaveKind, overlay,
};

use crate::figure::Sitter;
use crate::options::Backdrop;
use crate::outfit::Outfit;

/// Pixels a side of the front picture.
const FRONT: usize = 1024;
/// Pixels a side of the turntable.
const TURN: usize = 400;
/// Frames of the turntable.
const FRAMES: usize = 24;
/// How long each frame stays [ms].
pub const FRAME_MS: u16 = 100;
/// The turntable stands a little to the left, as a portrait does [rad].
const YAW: f64 = 0.35;

/// Colour of the mannequin's base layer, linear RGB.
const BASE_LAYER: [f32; 3] = [0.30, 0.30, 0.31];

/// A scene with its light gathered, for all pictures of it.
pub fn stage(scene: &Scene) -> Stage<'_> {
    Stage::new(scene, &Options::default())
}

/// A picture of the figure from the front, a little to its side.
pub fn front(stage: &Stage) -> Image {
    stage.shoot(&stage.frame(&view(FRONT)))
}

/// The figure turning round once.
pub fn turning(stage: &Stage) -> Vec<Image> {
    stage.with(&Options::quick()).turn(&view(TURN), FRAMES)
}

/// Where both pictures are taken from, `side` pixels a side.
pub fn view(side: usize) -> View {
    View {
        width: side,
        height: side,
        yaw: YAW,
        ..View::default()
    }
}

/// The fitted body laid over the photo it was fitted to.
pub fn over_photo(avatar: &Avatar, sitter: &Sitter, eye: &Eye, photo: &Image) -> Image {
    let scene = Scene {
        parts: vec![body(avatar, &sitter.posed.verts)],
        ..Scene::default()
    };
    let camera = Camera {
        width: photo.width,
        height: photo.height,
        focal: eye.focal,
        centre: eye.centre,
        world_from_camera: eye.world_from_camera,
    };
    overlay(photo, &scene, &camera, 0.55)
}

/// Everything to be seen: the mannequin in its base layer, the garments, the floor.
///
/// `verts`: of the whole figure; `dressed`: of all garments [m].
pub fn scene(
    (avatar, verts): (&Avatar, &[DVec3]),
    outfit: &Outfit,
    dressed: &[DVec3],
    backdrop: Backdrop,
) -> Scene {
    let mut parts = vec![body(avatar, verts)];
    let floor = lowest(&verts[avatar.part(Part::Body)]);
    for (part, piece) in outfit.parts().iter().zip(&outfit.pieces) {
        let verts = dressed[part.verts.clone()].to_vec();
        let uvs = piece.garment.uv.clone();
        let faces = piece.garment.faces.clone();
        let cloth = Shown::new(verts, faces, cloth(&piece.fabric));
        parts.push(Shown {
            uvs: Some(uvs),
            ..cloth
        });
    }
    let (ground, background) = match backdrop {
        Backdrop::Studio => (true, Background::default()),
        Backdrop::White => (true, Background::Plain([1.0; 3])),
        Backdrop::Transparent => (false, Background::Transparent),
    };
    Scene {
        parts,
        ground: ground.then(|| Ground::at(floor)),
        background,
    }
}

fn body(avatar: &Avatar, verts: &[DVec3]) -> Shown {
    let n = avatar.part(Part::Eyes).end;
    let verts = verts[..n].to_vec();
    let mut field = avatar.base_layer();
    field.truncate(n);
    let layer = Layer {
        field,
        colour: BASE_LAYER,
    };
    let shown = Shown::new(verts, avatar.body_faces().to_vec(), Material::mannequin());
    Shown {
        layer: Some(layer),
        ..shown
    }
}

/// Somebody else's body in its own colours: linear light of every vertex.
pub fn character(verts: Vec<DVec3>, faces: &[[u32; 3]], colours: &[[f32; 3]]) -> Shown {
    let plain = Material {
        colour: [1.0; 3],
        ..Material::mannequin()
    };
    Shown {
        colours: Some(colours.to_vec()),
        ..Shown::new(verts, faces.to_vec(), plain)
    }
}

/// The lowest of points [m].
pub fn lowest(verts: &[DVec3]) -> f64 {
    verts.iter().map(|v| v.y).fold(f64::INFINITY, f64::min)
}

fn cloth(fabric: &Fabric) -> Material {
    let look = &fabric.look;
    let kind = match look.weave {
        Cross::Plain => WeaveKind::Plain,
        Cross::Twill => WeaveKind::Twill,
        Cross::Satin => WeaveKind::Satin,
        Cross::Knit => WeaveKind::Jersey,
    };
    let weave = Weave {
        repeat: look.repeat as f32,
        ..Weave::usual(kind)
    };
    let plain = Material::cloth(look.colour, weave);
    let glow = look.colour.map(|c| look.sheen * (0.15 + 0.5 * c));
    Material {
        roughness: look.roughness,
        sheen: glow,
        ..plain
    }
}
