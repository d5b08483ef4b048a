//! The body in a pose, as walls for the cloth.

use glam::{DAffine3, DVec3};
use muslin_body::{Avatar, Cores, Figure, Part, Pose};
use muslin_geom::{Aabb, Bvh, Surface};
use muslin_sim::{Frame, relieve};

/// How far from the cloth skin is looked for [m].
const REACH: f64 = 0.06;
/// Room that cloth needs between two parts of the body [m].
const ROOM: f64 = 0.007;
/// Skin farther than this from the cloth at rest is no wall [m]: hands, head, lower legs.
const AROUND: f64 = 0.10;
/// Skin this near to cloth at rest may give way [m].
const SOFT: f64 = 0.05;

/// A wall at one vertex: unit normal, and how far it is from the origin [m].
pub type Wall = [f32; 4];
/// Where there is none.
const OPEN: Wall = [0.0, 0.0, 0.0, -1.0];

/// Somebody whose skin around the cloth can be asked for.
pub struct Skinned<'a> {
    pub avatar: &'a Avatar,
    pub figure: &'a Figure,
    /// Vertices of the skin around the cloth, and their triangles in that numbering.
    verts: Vec<u32>,
    /// The same at rest, ready to be moved into poses.
    surface: Surface,
    /// Which of these may give way.
    soft: Vec<bool>,
    /// All of the skin.
    range: std::ops::Range<usize>,
    cores: Cores<'a>,
}

impl<'a> Skinned<'a> {
    /// The skin around a cloth at `x` [m] at rest.
    pub fn new((avatar, figure): (&'a Avatar, &'a Figure), x: &[DVec3]) -> Self {
        let skin = &figure.verts[avatar.part(Part::Body)];
        let boxes: Vec<Aabb> = x.iter().map(|p| Aabb::of(&[*p])).collect();
        let tree = Bvh::over(&boxes);
        let within = |far: f64| -> Vec<bool> {
            let near = |p: &DVec3| {
                tree.nearest(*p, far * far, |k| x[k as usize].distance_squared(*p))
                    .is_some()
            };
            skin.iter().map(near).collect()
        };
        let near = within(AROUND);
        let faces = avatar.collision_faces().iter();
        let kept: Vec<[u32; 3]> = faces
            .filter(|f| f.iter().all(|v| near[*v as usize]))
            .copied()
            .collect();
        let mut verts = kept.concat();
        verts.sort_unstable();
        verts.dedup();
        let place = |v: u32| {
            verts
                .binary_search(&v)
                .expect("corners of kept faces are kept") as u32
        };
        let faces: Vec<[u32; 3]> = kept.iter().map(|f| f.map(place)).collect();
        let at: Vec<DVec3> = verts.iter().map(|v| skin[*v as usize]).collect();
        Self {
            surface: Surface::new(&at, &faces),
            soft: {
                let soft = within(SOFT);
                verts.iter().map(|v| soft[*v as usize]).collect()
            },
            range: avatar.part(Part::Body),
            cores: Cores::new(avatar, figure),
            avatar,
            figure,
            verts,
        }
    }

    /// The skin around the cloth at rest, to be moved into poses.
    pub fn surface(&self) -> Surface {
        self.surface.clone()
    }

    /// Bones in a pose with the root over the origin: `world_from_rest`.
    ///
    /// Single precision keeps more digits near the origin, and no law minds where the body is.
    pub fn bones(&self, pose: &Pose) -> Vec<DAffine3> {
        self.avatar.bones(self.figure, &over_origin(pose))
    }

    /// The skin around the cloth in a pose [m]; where the body folds into itself it gives way, as
    /// it does in the solver.
    pub fn skin(&self, pose: &Pose) -> Vec<[f32; 3]> {
        let posed = self.avatar.pose(self.figure, &over_origin(pose));
        let skin = &posed.verts[self.range.clone()];
        let here: Vec<DVec3> = self.verts.iter().map(|v| skin[*v as usize]).collect();
        let cores = self.cores.posed(&posed.bones);
        let here = Frame {
            skin: here,
            cores: self.verts.iter().map(|v| cores[*v as usize]).collect(),
        };
        let way = (self.surface.verts(), &here);
        let relief = relieve(way, self.surface.faces(), ROOM, &self.soft);
        relief
            .verts
            .iter()
            .map(|p| p.as_vec3().to_array())
            .collect()
    }
}

fn over_origin(pose: &Pose) -> Pose {
    Pose {
        root: DVec3::ZERO,
        rotations: pose.rotations.clone(),
    }
}

/// The wall nearest to each vertex of the cloth at `x` [m], by exact distance from the `skin`.
///
/// Where the body still folds into itself no cloth could lie between; there is no wall then.
pub fn walls(surface: &mut Surface, skin: &[[f32; 3]], x: &[DVec3], out: &mut [Wall]) {
    let skin: Vec<DVec3> = skin
        .iter()
        .map(|p| DVec3::from_array(p.map(f64::from)))
        .collect();
    surface.refit(&skin);
    let mut hint = 0;
    for (x, out) in x.iter().zip(out) {
        *out = match surface.closest_near(*x, REACH, hint) {
            Some(hit) => {
                hint = hit.face;
                wall(surface, &hit)
            }
            None => OPEN,
        };
    }
}

fn wall(surface: &Surface, hit: &muslin_geom::Closest) -> Wall {
    if hit.signed < 0.02 {
        let beyond = hit.point + hit.normal * ROOM;
        let crowded = surface.closest_near(beyond, 2.0 * ROOM, hit.face);
        if crowded.is_some_and(|c| c.signed < 0.3 * ROOM) {
            return OPEN;
        }
    }
    let n = hit.normal.as_vec3();
    [n.x, n.y, n.z, hit.normal.dot(hit.point) as f32]
}
