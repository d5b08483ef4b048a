//! Meshes flattened into one list, and how they fall on a picture.

use glam::{DVec3, Vec2, Vec3};
use muslin_geom::vertex_normals;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::clip::Lens;
use crate::raster::Tri;
use crate::{Part, Scene, hem};

/// All parts of a scene over one vertex numbering.
#[derive(Default)]
pub(crate) struct Flat {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// The same, for shading.
    pub at: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Linear RGB factor.
    pub colours: Vec<Vec3>,
    /// Signed distance from the painted layer's edge [m]; negative without one.
    pub layer: Vec<f32>,
    /// Distance from the open edge [m].
    pub hem: Vec<f32>,
    /// Corner indices.
    pub faces: Vec<[u32; 3]>,
    /// Material coordinates of the corners [m].
    pub uvs: Vec<[Vec2; 3]>,
    /// Which part a face belongs to.
    pub part: Vec<u16>,
}

/// A distance that stands for "nowhere near" [m].
pub(crate) const FAR: f32 = 1.0;

impl Flat {
    /// Joins the parts of a scene, leaving out faces that cannot be drawn and
    /// vertices that no face uses.
    pub fn new(scene: &Scene) -> Self {
        let mut flat = Self::default();
        for (i, part) in scene.parts.iter().enumerate() {
            let kept = Kept::of(part);
            flat.push_faces(part, &kept, i as u16);
            flat.push_verts(part, &kept);
        }
        flat
    }

    fn push_faces(&mut self, part: &Part, kept: &Kept, index: u16) {
        let first = self.verts.len() as u32;
        for (&i, face) in kept.origin.iter().zip(&kept.faces) {
            let uv = part.uvs.as_ref().and_then(|uvs| uvs.get(i));
            self.uvs
                .push(uv.map_or([Vec2::ZERO; 3], |uv| uv.map(|c| c.as_vec2())));
            self.faces.push(face.map(|v| first + v));
            self.part.push(index);
        }
    }

    fn push_verts(&mut self, part: &Part, kept: &Kept) {
        let used = &kept.verts;
        let verts: Vec<DVec3> = used.iter().map(|&v| part.verts[v]).collect();
        self.at.extend(verts.iter().map(|p| p.as_vec3()));
        match part
            .normals
            .as_ref()
            .filter(|n| n.len() == part.verts.len())
        {
            Some(given) => self
                .normals
                .extend(used.iter().map(|&v| given[v].as_vec3())),
            None => {
                let own = vertex_normals(&verts, &kept.faces);
                self.normals.extend(own.iter().map(|n| n.as_vec3()));
            }
        }
        let colour = |&v: &usize| part.colours.as_ref().and_then(|c| c.get(v)).copied();
        self.colours
            .extend(used.iter().map(|v| colour(v).map_or(Vec3::ONE, Vec3::from)));
        let field = |&v: &usize| part.layer.as_ref().and_then(|l| l.field.get(v)).copied();
        self.layer
            .extend(used.iter().map(|v| field(v).map_or(-FAR, |d| d as f32)));
        self.hem.extend(hem::distances(
            &verts,
            &kept.faces,
            hem::reach(part.material.hem),
        ));
        self.verts.extend(verts);
    }

    /// Least and greatest corner of the box around all drawn vertices [m].
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let all = || self.verts.iter().copied();
        Some((all().reduce(DVec3::min)?, all().reduce(DVec3::max)?))
    }

    /// Corners of a face, for shading [m].
    pub fn corners(&self, face: u32) -> [Vec3; 3] {
        self.faces[face as usize].map(|v| self.at[v as usize])
    }
}

/// What of a part can be drawn, over a numbering of its own.
struct Kept {
    /// Where each kept face stood in the part.
    origin: Vec<usize>,
    faces: Vec<[u32; 3]>,
    /// Where each kept vertex stood in the part.
    verts: Vec<usize>,
}

impl Kept {
    fn of(part: &Part) -> Self {
        let good = |v: u32| part.verts.get(v as usize).is_some_and(|p| p.is_finite());
        let origin: Vec<usize> = (0..part.faces.len())
            .filter(|&i| part.faces[i].iter().all(|&v| good(v)))
            .collect();
        let mut number = vec![u32::MAX; part.verts.len()];
        origin
            .iter()
            .flat_map(|&i| part.faces[i])
            .for_each(|v| number[v as usize] = 0);
        let verts: Vec<usize> = (0..number.len()).filter(|&v| number[v] == 0).collect();
        verts
            .iter()
            .enumerate()
            .for_each(|(new, &old)| number[old] = new as u32);
        let faces = origin
            .iter()
            .map(|&i| part.faces[i].map(|v| number[v as usize]))
            .collect();
        Self {
            origin,
            faces,
            verts,
        }
    }
}

/// A flat scene as one camera sees it.
pub(crate) struct Projected {
    /// Vertices in the camera's frame: x right, y down, depth [m].
    pub seen: Vec<Vec3>,
    /// What is left of the faces on the picture; ids are face indices.
    pub tris: Vec<Tri>,
}

impl Projected {
    /// Moves, culls, clips and snaps. Faces of one-sided parts turned away are dropped.
    pub fn new(flat: &Flat, scene: &Scene, camera: &Camera) -> Self {
        let camera_from_world = camera.world_from_camera.inverse();
        let flip = DVec3::new(1.0, -1.0, -1.0);
        let place = |p: &DVec3| camera_from_world.transform_point3(*p) * flip;
        let seen: Vec<DVec3> = flat.verts.par_iter().map(place).collect();
        let size = glam::DVec2::new(camera.width as f64, camera.height as f64);
        let lens = Lens {
            focal: camera.focal,
            centre: camera.centre,
            size,
        };
        let two_sided: Vec<bool> = scene.parts.iter().map(|p| p.material.two_sided).collect();
        let chunks = flat
            .faces
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, faces)| {
                let mut tris = Vec::with_capacity(faces.len());
                for (i, face) in faces.iter().enumerate() {
                    let id = chunk * CHUNK + i;
                    let p = face.map(|v| seen[v as usize]);
                    if two_sided[flat.part[id] as usize] || faces_eye(p) {
                        push(&mut tris, &lens, p, id as u32);
                    }
                }
                tris
            });
        let tris: Vec<Vec<Tri>> = chunks.collect();
        Self {
            seen: seen.iter().map(|p| p.as_vec3()).collect(),
            tris: tris.concat(),
        }
    }
}

/// Faces projected by one task.
const CHUNK: usize = 4096;

/// Whether a counter-clockwise triangle of the camera's frame shows its front.
pub(crate) fn faces_eye(p: [DVec3; 3]) -> bool {
    // The frame is turned, not mirrored: y and depth both change sign.
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[0]) < 0.0
}

fn push(tris: &mut Vec<Tri>, lens: &Lens, p: [DVec3; 3], id: u32) {
    if p.iter().all(|&p| lens.is_safe(p)) {
        tris.extend(snapped(lens, p, id));
        return;
    }
    let poly = lens.clip(p);
    for i in 2..poly.len() {
        tris.extend(snapped(lens, [poly[0], poly[i - 1], poly[i]], id));
    }
}

fn snapped(lens: &Lens, p: [DVec3; 3], id: u32) -> Option<Tri> {
    Tri::new(p.map(|p| lens.pixel(p)), p.map(|p| (1.0 / p.z) as f32), id)
}
