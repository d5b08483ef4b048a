//! What the 3D writers take: named, coloured meshes.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use glam::{DVec2, DVec3};
use muslin_geom::{Image, Mesh};

use crate::error::{Fault, IoError, Place};

/// Things to be seen together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The scene's name.
    pub name: String,
    /// Whose rights the file carries, if anyone's.
    pub copyright: Option<String>,
    /// The things, in the order a reader lists them.
    pub nodes: Vec<Node>,
}

/// One named mesh with its looks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node {
    /// The name a reader shows.
    pub name: String,
    /// Positions [m] and triangles.
    pub mesh: Mesh,
    /// Unit normals, one a vertex; empty means smooth ones computed from the triangles.
    pub normals: Vec<DVec3>,
    /// Texture coordinates, one a vertex, v up, in any unit and range; empty means none.
    pub uvs: Vec<DVec2>,
    /// The looks.
    pub material: Material,
}

/// The looks of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name a reader shows.
    pub name: String,
    /// Colour, sRGB; multiplies the colour map.
    pub colour: [u8; 3],
    /// From 0 (mirror) to 1 (chalk).
    pub roughness: f64,
    /// The glow of fibres at grazing angles.
    pub sheen: Option<Sheen>,
    /// Seen from behind too, as cloth must be.
    pub double_sided: bool,
    /// Pictures laid over the surface.
    pub maps: Option<Maps>,
}

impl Default for Material {
    /// Matte light grey, seen from one side.
    fn default() -> Self {
        Self {
            name: "matte".into(),
            colour: [200; 3],
            roughness: 0.9,
            sheen: None,
            double_sided: false,
            maps: None,
        }
    }
}

/// Cloth sheen as glTF's `KHR_materials_sheen` understands it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// Colour at grazing angles, sRGB.
    pub colour: [u8; 3],
    /// From 0 (a sharp rim, as on velvet) to 1 (all over, as on wool).
    pub roughness: f64,
}

/// Small pictures that repeat over the surface, such as a weave.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// Colour, sRGB.
    pub colour: Option<Image>,
    /// Normals in tangent space, green up.
    pub normal: Option<Image>,
    /// What one picture covers, in the unit of the texture coordinates.
    pub tile: DVec2,
}

impl Node {
    /// The normals: as given, or smooth ones from the triangles.
    pub fn normals_or_smooth(&self) -> Cow<'_, [DVec3]> {
        match self.normals.is_empty() {
            true => self.mesh.vertex_normals().into(),
            false => self.normals.as_slice().into(),
        }
    }

    /// Gives every corner its own texture coordinates: `uv_faces` index `uvs` as the mesh's faces
    /// index its vertices.
    ///
    /// A vertex with several of them is doubled. The copies follow after the last vertex, so that
    /// the order of the vertices stays; normals stay smooth across the seam.
    ///
    /// # Panics
    /// If an index has no vertex or no coordinates.
    pub fn with_corner_uvs(self, uv_faces: &[[u32; 3]], uvs: &[DVec2]) -> Self {
        self.with_corner_uvs_and_sources(uv_faces, uvs).0
    }

    /// As [`Node::with_corner_uvs`], and for each vertex of the result the one it is a copy of.
    ///
    /// # Panics
    /// If an index has no vertex or no coordinates.
    pub fn with_corner_uvs_and_sources(
        mut self,
        uv_faces: &[[u32; 3]],
        uvs: &[DVec2],
    ) -> (Self, Vec<u32>) {
        let n = self.mesh.verts.len();
        let mut sources: Vec<u32> = (0..n as u32).collect();
        self.normals = self.normals_or_smooth().into_owned();
        self.uvs = vec![DVec2::ZERO; n];
        let mut uv_of: Vec<Option<u32>> = vec![None; n];
        let mut copies = BTreeMap::new();
        for (face, uv_face) in self.mesh.faces.iter_mut().zip(uv_faces) {
            for (corner, &uv) in face.iter_mut().zip(uv_face) {
                let vert = *corner as usize;
                if *uv_of[vert].get_or_insert(uv) == uv {
                    self.uvs[vert] = uvs[uv as usize];
                    continue;
                }
                *corner = *copies.entry((*corner, uv)).or_insert_with(|| {
                    self.mesh.verts.push(self.mesh.verts[vert]);
                    self.normals.push(self.normals[vert]);
                    self.uvs.push(uvs[uv as usize]);
                    sources.push(vert as u32);
                    self.mesh.verts.len() as u32 - 1
                });
            }
        }
        (self, sources)
    }

    /// The vertices that triangles use, in order.
    ///
    /// # Panics
    /// If a triangle has a corner that is no vertex.
    pub(crate) fn used(&self) -> Vec<usize> {
        let mut is_used = vec![false; self.mesh.verts.len()];
        for corner in self.mesh.faces.as_flattened() {
            is_used[*corner as usize] = true;
        }
        (0..is_used.len()).filter(|&i| is_used[i]).collect()
    }

    /// Leaves out vertices that no triangle uses; the rest keep their order.
    ///
    /// # Panics
    /// If a triangle has a corner that is no vertex.
    pub fn without_unused(mut self) -> Self {
        let used = self.used();
        let mut new_of = vec![u32::MAX; self.mesh.verts.len()];
        for (new, &old) in used.iter().enumerate() {
            new_of[old] = new as u32;
        }
        for corner in self.mesh.faces.as_flattened_mut() {
            *corner = new_of[*corner as usize];
        }
        self.mesh.verts = used.iter().map(|&i| self.mesh.verts[i]).collect();
        if !self.normals.is_empty() {
            self.normals = used.iter().map(|&i| self.normals[i]).collect();
        }
        if !self.uvs.is_empty() {
            self.uvs = used.iter().map(|&i| self.uvs[i]).collect();
        }
        self
    }
}

impl Scene {
    /// Checks what every writer relies on: finite numbers, one normal and one texture coordinate
    /// a vertex if there are any, corners that are vertices, something to see.
    pub(crate) fn check(&self) -> Result<(), IoError> {
        self.nodes
            .iter()
            .enumerate()
            .try_for_each(|(i, node)| node.check(i))
    }
}

impl Node {
    fn check(&self, i: usize) -> Result<(), IoError> {
        let fault = |what: &str| {
            let place = Place::Pointer(format!("/nodes/{i} ({})", self.name));
            Err(Fault::new("bad-scene", "the scene to write", what)
                .at(place)
                .invalid())
        };
        let n = self.mesh.verts.len();
        let fits = |len: usize| len == 0 || len == n;
        if self.mesh.faces.is_empty() || n == 0 {
            return fault("it has no triangles");
        }
        if !fits(self.normals.len()) || !fits(self.uvs.len()) {
            return fault("normals or texture coordinates differ in number from the vertices");
        }
        if self
            .mesh
            .faces
            .as_flattened()
            .iter()
            .any(|&c| c as usize >= n)
        {
            return fault("a triangle has a corner that is no vertex");
        }
        let mut vectors = self.mesh.verts.iter().chain(&self.normals);
        if !vectors.all(|v| v.is_finite()) || !self.uvs.iter().all(|uv| uv.is_finite()) {
            return fault("a position, normal or texture coordinate is not a finite number");
        }
        Ok(())
    }
}

/// Corners of faces (coordinates of each face's three) as a list in which those of one vertex that agree to a tenth of a
/// micrometre share an entry, and what each face uses of it.
pub fn shared_corners(faces: &[[u32; 3]], corners: &[[DVec2; 3]]) -> (Vec<[u32; 3]>, Vec<DVec2>) {
    let mut seen = HashMap::new();
    let mut list = Vec::new();
    let mut index = |vert: u32, at: DVec2| {
        let key = (vert, [at.x, at.y].map(|c| (c * 1e7).round() as i64));
        *seen.entry(key).or_insert_with(|| {
            list.push(at);
            (list.len() - 1) as u32
        })
    };
    let one = |(f, u): (&[u32; 3], &[DVec2; 3])| [0, 1, 2].map(|k| index(f[k], u[k]));
    let used = faces.iter().zip(corners).map(one).collect();
    (used, list)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Node {
        let verts = vec![DVec3::ZERO, DVec3::X, DVec3::ONE.with_z(0.0), DVec3::Y];
        Node {
            mesh: Mesh {
                verts,
                faces: vec![[0, 1, 2], [0, 2, 3]],
            },
            ..Node::default()
        }
    }

    #[test]
    fn a_seam_doubles_its_vertices_behind_the_last_one() {
        let uvs: Vec<DVec2> = (0..6).map(|i| DVec2::splat(f64::from(i))).collect();
        let node = square().with_corner_uvs(&[[0, 1, 2], [3, 4, 5]], &uvs);
        assert_eq!(node.mesh.verts[..4], square().mesh.verts);
        assert_eq!(node.mesh.verts[4..], [DVec3::ZERO, DVec3::ONE.with_z(0.0)]);
        assert_eq!(node.mesh.faces, [[0, 1, 2], [4, 5, 3]]);
        assert_eq!(node.uvs, [0, 1, 2, 5, 3, 4].map(|i| uvs[i]));
        assert_eq!(node.normals, [DVec3::Z; 6]);
    }

    #[test]
    fn a_seam_doubles_a_vertex_and_nothing_else_does() {
        let p = |x: f64, y: f64| DVec2::new(x, y);
        let faces = [[0, 1, 2], [0, 2, 3]];
        let whole = [
            [p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)],
            [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)],
        ];
        assert_eq!(shared_corners(&faces, &whole).1.len(), 4);
        let cut = [whole[0], whole[1].map(|q| q + p(3.0, 0.0))];
        assert_eq!(shared_corners(&faces, &cut).1.len(), 6);
    }

    #[test]
    fn without_seams_nothing_is_doubled() {
        let uvs = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let node = square().with_corner_uvs(&[[0, 1, 2], [0, 2, 3]], &uvs);
        assert_eq!((node.mesh, node.uvs), (square().mesh, uvs.to_vec()));
    }

    #[test]
    fn unused_vertices_go_and_the_order_stays() {
        let mut node = square();
        node.mesh.verts.insert(1, DVec3::NAN);
        node.mesh.faces = vec![[0, 2, 3], [0, 3, 4]];
        assert_eq!(node.without_unused().mesh, square().mesh);
    }

    #[test]
    fn a_scene_that_no_reader_could_take_is_an_error() {
        let breaks: [fn(&mut Node); 5] = [
            |n| n.mesh.verts[0].x = f64::NAN,
            |n| n.mesh.faces[0][0] = 4,
            |n| n.mesh.faces.clear(),
            |n| n.normals = vec![DVec3::X],
            |n| n.uvs = vec![DVec2::X],
        ];
        for harm in breaks {
            let mut node = square();
            harm(&mut node);
            let scene = Scene {
                nodes: vec![square(), node],
                ..Scene::default()
            };
            let err = scene.check().expect_err("it is broken");
            assert!(err.to_string().contains("/nodes/1"), "{err}");
        }
    }
}
