//! The studio: a scene is set up once and photographed from anywhere.

use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3, Vec4};
use muslin_geom::{Image, widely};
use rayon::prelude::*;

use crate::background::{backdrop, bare, is_graded};
use crate::crevice::{Crevices, Depths};
use crate::dome::{Dome, Probe};
use crate::floor::{Floor, Patch};
use crate::fragment::{Fragment, Fragments, Resolver};
use crate::light_map::LightMap;
use crate::project::{Flat, Projected};
use crate::raster::{Bins, Tile, Tri};
use crate::shade::Shader;
use crate::studio::Studio;
use crate::{Camera, Scene, View, tone};

/// How much care a picture takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Samples along each side of a pixel, 1 to 4.
    pub supersampling: usize,
    /// Texels a side of the key light's shadow map, at least 64.
    pub shadow_map: usize,
    /// Directions from which the dome's light is gathered.
    pub dome: usize,
    /// Whether small crevices are darkened.
    pub crevices: bool,
    /// Factor on all light.
    pub exposure: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            supersampling: 4,
            shadow_map: 2048,
            dome: 96,
            crevices: true,
            exposure: 1.0,
        }
    }
}

impl Options {
    /// Enough for frames of about 512 pixels in motion.
    pub fn quick() -> Self {
        Self {
            supersampling: 3,
            shadow_map: 512,
            ..Self::default()
        }
    }
}

/// One picture of a scene.
pub fn render(scene: &Scene, camera: &Camera, options: &Options) -> Image {
    Stage::new(scene, options).shoot(camera)
}

/// `count` pictures of a scene turning round once, all framed alike.
pub fn turntable(scene: &Scene, view: &View, count: usize, options: &Options) -> Vec<Image> {
    Stage::new(scene, options).turn(view, count)
}

/// A scene with all that does not depend on the camera.
#[derive(Clone)]
pub struct Stage<'a> {
    scene: &'a Scene,
    options: Options,
    flat: Arc<Flat>,
    dome: Arc<Dome>,
}

/// Pixels a side of a tile.
const TILE: usize = 32;
/// Texels a side of the dome's maps.
const DOME_MAP: usize = 256;

impl<'a> Stage<'a> {
    /// Prepares a scene; this is where the light of the dome is gathered.
    pub fn new(scene: &'a Scene, options: &Options) -> Self {
        let flat = Flat::new(scene);
        let mut probes: Vec<Probe> = flat
            .at
            .iter()
            .zip(&flat.normals)
            .map(|(&at, &normal)| Probe { at, normal })
            .collect();
        if let (Some(ground), Some(bounds)) = (&scene.ground, flat.bounds()) {
            probes.extend(Patch::new(ground, bounds).probes());
        }
        let dome = Dome::new(&flat, &probes, options.dome, DOME_MAP);
        Self {
            scene,
            options: *options,
            flat: Arc::new(flat),
            dome: Arc::new(dome),
        }
    }

    /// The same stage for pictures of other care; the dome's light stays as it was gathered.
    pub fn with(&self, options: &Options) -> Self {
        Self {
            options: *options,
            ..self.clone()
        }
    }

    /// A camera that has the whole scene in view.
    pub fn frame(&self, view: &View) -> Camera {
        Camera::framing(&self.flat.verts, view)
    }

    /// `count` pictures of the scene turning round once, all framed alike.
    pub fn turn(&self, view: &View, count: usize) -> Vec<Image> {
        let cameras = Camera::orbit(&self.flat.verts, view, count);
        let bare = self.bare(view.width, view.height);
        let shoot = |camera| self.expose(camera, &bare).develop();
        cameras.par_iter().map(shoot).collect()
    }

    /// Takes a picture.
    pub fn shoot(&self, camera: &Camera) -> Image {
        let bare = self.bare(camera.width, camera.height);
        self.expose(camera, &bare).develop()
    }

    /// All pixels of the backdrop on which no shadow falls.
    pub(crate) fn bare(&self, width: usize, height: usize) -> Vec<[u8; 4]> {
        bare(&self.scene.background, width, height)
    }

    /// Finds out what every pixel sees and sets the lights. `bare`: the backdrop's pixels, were there nothing else.
    pub(crate) fn expose<'s>(&'s self, camera: &'s Camera, bare: &'s [[u8; 4]]) -> Exposure<'s> {
        let studio = Studio::new(camera);
        let dome = self.dome.light(|d| studio.radiance(d));
        let key_map = LightMap::new(&self.flat, studio.key_dir, self.options.shadow_map.max(64));
        let floor = self.floor(&dome, &key_map, &studio);
        let tiles = match self.options.supersampling {
            0 | 1 => self.tiles::<1>(camera, &dome),
            2 => self.tiles::<4>(camera, &dome),
            3 => self.tiles::<9>(camera, &dome),
            _ => self.tiles::<16>(camera, &dome),
        };
        let depths = Depths::new(&tiles, camera.width, camera.height);
        let rotation = camera.world_from_camera.matrix3.as_mat3();
        let crevices = self.options.crevices.then(|| {
            Crevices::new(
                &depths,
                camera.focal as f32,
                camera.centre.as_vec2(),
                rotation,
            )
        });
        Exposure {
            stage: self,
            camera,
            rotation,
            studio,
            key_map,
            floor,
            bare,
            tiles,
            depths,
            crevices,
        }
    }

    fn floor(&self, dome: &[[Vec3; 2]], key: &LightMap, studio: &Studio) -> Option<Floor> {
        let ground = self.scene.ground.as_ref()?;
        let patch = Patch::new(ground, self.flat.bounds()?);
        let lit: Vec<Vec3> = dome[self.flat.at.len()..]
            .iter()
            .map(|sides| sides[0])
            .collect();
        Some(Floor::new(
            ground,
            patch,
            &lit,
            key,
            studio.key.y * studio.key_dir.y,
        ))
    }

    fn tiles<const S: usize>(&self, camera: &Camera, dome: &[[Vec3; 2]]) -> Vec<Fragments> {
        let projected = Projected::new(&self.flat, self.scene, camera);
        let tris: &[Tri] = &projected.tris;
        let bins = Bins::new(tris, [camera.width, camera.height], TILE);
        let resolver = Resolver::new(&self.flat, &projected, dome, camera);
        let resolve = |tile: &mut Tile<S>, bin: usize| {
            let frame = bins.frame(bin);
            let members = bins.members(bin);
            if members.is_empty() {
                return Fragments::none(frame);
            }
            let [x, y, w, h] = frame;
            tile.reset(x, y, w, h);
            widely(
                #[inline(always)]
                || {
                    for &i in members {
                        tile.fill(&tris[i as usize]);
                    }
                },
            );
            resolver.resolve(tile, frame)
        };
        let start = || Tile::<S>::new(0, 0, 0, 0);
        (0..bins.cols * bins.rows)
            .into_par_iter()
            .map_init(start, resolve)
            .collect()
    }
}

/// What a camera caught, before it is shaded.
pub(crate) struct Exposure<'s> {
    stage: &'s Stage<'s>,
    camera: &'s Camera,
    /// The camera's.
    rotation: Mat3,
    studio: Studio,
    key_map: LightMap,
    floor: Option<Floor>,
    /// The backdrop's pixels, were there nothing else.
    bare: &'s [[u8; 4]],
    /// Fragments, tile by tile.
    pub tiles: Vec<Fragments>,
    /// Depth of every pixel.
    pub depths: Depths,
    crevices: Option<Crevices>,
}

impl Exposure<'_> {
    /// Shades every pixel.
    pub fn develop(&self) -> Image {
        let shader = Shader {
            scene: self.stage.scene,
            flat: &self.stage.flat,
            studio: &self.studio,
            key_map: &self.key_map,
            eye: self.camera.world_from_camera.translation.as_vec3(),
            focal: self.camera.focal as f32,
            exposure: self.stage.options.exposure,
        };
        let tile = |tile: &Fragments| -> Vec<[u8; 4]> {
            let [x, y, w, h] = tile.frame;
            let pixel = |at| self.pixel(&shader, tile.of(at), x + at % w, y + at / w);
            (0..w * h).map(pixel).collect()
        };
        let done: Vec<Vec<[u8; 4]>> = self.tiles.par_iter().map(tile).collect();
        let mut image = Image::filled(self.camera.width, self.camera.height, [0; 4]);
        for (tile, pixels) in self.tiles.iter().zip(&done) {
            let [x, y, w, _] = tile.frame;
            for (row, line) in pixels.chunks(w).enumerate() {
                let start = (y + row) * self.camera.width + x;
                image.pixels[start..start + w].copy_from_slice(line);
            }
        }
        image
    }

    fn pixel(&self, shader: &Shader, fragments: &[Fragment], x: usize, y: usize) -> [u8; 4] {
        if fragments.is_empty() {
            let light = self.floor_light(x, y);
            return match light == 1.0 {
                true => self.bare[y * self.camera.width + x],
                false => self.before((Vec3::ZERO, 0.0), (x, y), light),
            };
        }
        let (mut sum, mut cover) = (Vec3::ZERO, 0.0);
        for f in fragments {
            let open = self
                .crevices
                .as_ref()
                .map_or(1.0, |c| c.at(&self.depths, x, y, f.depth));
            sum += shader.colour(f, x, y, open) * f.weight;
            cover += f.weight;
        }
        if 1.0 - cover < 1e-3 {
            return opaque(sum / cover, 0.0);
        }
        self.before((sum, cover), (x, y), self.floor_light(x, y))
    }

    /// A premultiplied colour that covers so much of a pixel, before a floor that lets `light` (0 to 1) through.
    fn before(&self, (sum, cover): (Vec3, f32), (x, y): (usize, usize), light: f32) -> [u8; 4] {
        let free = 1.0 - cover;
        let behind = self.behind(x, y, light);
        let alpha = cover + free * behind.w;
        let colour = (sum + behind.truncate() * free) / alpha.max(1e-6);
        let noise = if is_graded(&self.stage.scene.background) {
            tone::dither(x, y)
        } else {
            0.0
        };
        let [r, g, b, _] = opaque(colour, noise * free);
        match (alpha * 255.0 + 0.5) as u8 {
            0 => [0; 4],
            a => [r, g, b, a],
        }
    }

    /// The backdrop of a pixel under a floor that lets `light` (0 to 1) through, premultiplied.
    fn behind(&self, x: usize, y: usize, light: f32) -> Vec4 {
        let size = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        backdrop(&self.stage.scene.background, middle(x, y), size, light)
    }

    /// How much light the floor has that a pixel sees, 0 to 1.
    fn floor_light(&self, x: usize, y: usize) -> f32 {
        let Some(floor) = &self.floor else {
            return 1.0;
        };
        let camera = self.camera;
        let off = (middle(x, y) - camera.centre.as_vec2()) / camera.focal as f32;
        let ray = self.rotation * Vec3::new(off.x, -off.y, -1.0);
        let eye = camera.world_from_camera.translation.as_vec3();
        let t = (floor.height - eye.y) / ray.y;
        match t.is_finite() && t > 0.0 && eye.y > floor.height {
            true => floor.light(eye + ray * t, &self.key_map),
            false => 1.0,
        }
    }
}

/// The middle of a pixel [px].
fn middle(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

fn opaque(colour: Vec3, dither: f32) -> [u8; 4] {
    let [r, g, b] = tone::bytes(colour, dither);
    [r, g, b, 255]
}
