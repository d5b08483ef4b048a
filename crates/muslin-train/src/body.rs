//! The body in a pose, as walls for the cloth.

use glam::{DAffine3, DVec3, Vec3};
use muslin_body::{Avatar, Cores, Figure, Part, Pose};
use muslin_geom::{Closest, Surface, vertex_normals};
use muslin_sim::{Flesh, Frame};

use crate::around::Resting;
use crate::rows::flat;

/// How far from the cloth skin is looked for [m].
const REACH: f64 = 0.06;
/// Cloth deeper in the body than this has slipped [m].
const SHALLOW: f64 = 0.003;
/// Room that cloth needs between two parts of the body [m].
const ROOM: f64 = 0.007;
/// Skin this near to cloth at rest may give way [m].
const SOFT: f64 = 0.05;

/// A wall at one vertex: unit normal, and how far it is from the origin [m].
pub type Wall = [f32; 4];
/// Where there is none.
const OPEN: Wall = [0.0, 0.0, 0.0, -1.0];
/// The face of a vertex that has no wall.
pub const NO_FACE: u32 = u32::MAX;
/// Steps from face to face when a wall is followed.
const HOPS: usize = 12;
/// Followed this far behind the skin, a point has lost its way: it passed by another limb [m].
const LOST: f32 = 0.02;
/// Nearer than this the way to the skin has no direction of its own [m].
const TOUCHING: f32 = 5e-5;

/// The skin around the cloth in a pose.
#[derive(Clone, Debug, Default)]
pub struct Posed {
    /// Positions [m].
    pub verts: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
}

impl Posed {
    /// The memory that it takes [bytes].
    pub fn bytes(&self) -> usize {
        size_of_val(&self.verts[..]) + size_of_val(&self.normals[..])
    }
}

/// Somebody whose skin around the cloth can be asked for.
pub struct Skinned<'a> {
    pub avatar: &'a Avatar,
    pub figure: &'a Figure,
    /// Vertices of the skin around the cloth, and their triangles in that numbering.
    verts: Vec<u32>,
    /// The same at rest, ready to be moved into poses.
    flesh: Flesh,
    /// Triangles around every vertex: where each vertex's start, and they.
    around: (Vec<u32>, Vec<u32>),
    /// Which triangles lie at the rim of what was kept: which side one is on cannot be told there.
    rim: Vec<bool>,
    /// Which vertices may give way.
    soft: Vec<bool>,
    /// All of the skin.
    range: std::ops::Range<usize>,
    /// Cores of the vertices kept, at rest [m].
    cores: Vec<DVec3>,
}

impl<'a> Skinned<'a> {
    /// The skin around a cloth at `x` [m] at rest.
    pub fn new((avatar, figure): (&'a Avatar, &'a Figure), x: &[DVec3]) -> Self {
        let skin = &figure.verts[avatar.part(Part::Body)];
        let cloth = Resting::new(x);
        let met = cloth.meets(skin);
        let faces = avatar.collision_faces().iter();
        let kept: Vec<[u32; 3]> = faces
            .filter(|f| f.iter().all(|v| met[*v as usize]))
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
            rim: rim(&faces),
            around: around(at.len(), &faces),
            flesh: Flesh::new(&at, &faces),
            soft: at.iter().map(|p| cloth.is_near(*p, SOFT)).collect(),
            range: avatar.part(Part::Body),
            cores: {
                let still = vec![DAffine3::IDENTITY; avatar.rig().n_bones()];
                let all = Cores::new(avatar, figure).posed(&still);
                verts.iter().map(|v| all[*v as usize]).collect()
            },
            avatar,
            figure,
            verts,
        }
    }

    /// Triangles of the skin around the cloth, those around each of its vertices (where they start, and they), and which
    /// lie at the rim.
    #[cfg(any(test, feature = "cuda"))]
    pub fn skin_faces(&self) -> (&[[u32; 3]], [&[u32]; 2], &[bool]) {
        let (starts, around) = &self.around;
        (self.flesh.rest().faces(), [starts, around], &self.rim)
    }

    /// Whether there is such a triangle around the cloth, or it stands for none.
    pub fn has(&self, face: u32) -> bool {
        face == NO_FACE || (face as usize) < self.flesh.rest().faces().len()
    }

    /// Bones in a pose with the root over the origin: `world_from_rest`.
    ///
    /// Single precision keeps more digits near the origin, and no law minds where the body is.
    pub fn bones(&self, pose: &Pose) -> Vec<DAffine3> {
        self.avatar.bones(self.figure, &over_origin(pose))
    }

    /// The skin around the cloth in a pose [m]; where the body folds into itself it gives way, as
    /// it does in the solver.
    pub fn skin(&self, pose: &Pose) -> Posed {
        let posed = self.avatar.pose(self.figure, &over_origin(pose));
        let skin = &posed.verts[self.range.clone()];
        let here: Vec<DVec3> = self.verts.iter().map(|v| skin[*v as usize]).collect();
        let weights = &self.avatar.rig().weights;
        let core = |(p, v): (&DVec3, &u32)| {
            let by = weights.row(*v as usize).iter();
            by.map(|&(b, w)| posed.bones[b as usize].transform_point3(*p) * w)
                .sum()
        };
        let here = Frame {
            skin: here,
            cores: self.cores.iter().zip(&self.verts).map(core).collect(),
        };
        let relief = self.flesh.relieve(&here, ROOM, &self.soft);
        let normals = vertex_normals(&relief.verts, self.flesh.rest().faces());
        let single = |list: &[DVec3]| list.iter().map(|p| p.as_vec3()).collect();
        Posed {
            verts: single(&relief.verts),
            normals: single(&normals),
        }
    }

    /// The triangle of the `skin` nearest to each vertex of the cloth at `x` [m]; none where skin is
    /// far, or where the body still folds into itself, so that no cloth could lie between.
    ///
    /// Where the way from there is `known`, cloth that lies deep stays with the triangle it was followed to:
    /// the nearest may be on the far side of a limb.
    pub fn nearest(
        &self,
        skin: &Posed,
        x: &[DVec3],
        known: impl Fn(usize) -> Option<u32>,
    ) -> Vec<u32> {
        let face = |(v, hit): (usize, Option<Closest>)| match (hit, known(v)) {
            (Some(hit), Some(face)) if hit.signed < -SHALLOW => face,
            (Some(hit), _) => hit.face,
            (None, _) => NO_FACE,
        };
        self.closest(skin, x)
            .into_iter()
            .enumerate()
            .map(face)
            .collect()
    }

    /// The wall of the `skin` nearest to each vertex of the cloth at `x` [m], however deep the vertex
    /// lies behind it; none where there is no nearest triangle.
    pub fn walls(&self, skin: &Posed, x: &[DVec3]) -> Vec<Wall> {
        let wall = |(hit, x): (Option<Closest>, &DVec3)| hit.map_or(OPEN, |hit| plane(&hit, *x));
        self.closest(skin, x).into_iter().zip(x).map(wall).collect()
    }

    fn closest(&self, skin: &Posed, x: &[DVec3]) -> Vec<Option<Closest>> {
        let verts: Vec<DVec3> = skin.verts.iter().map(|p| p.as_dvec3()).collect();
        let surface = self.flesh.rest().moved(&verts);
        let mut hint = 0;
        let one = |x: &DVec3| {
            let hit = surface.closest_near(*x, REACH, hint)?;
            hint = hit.face;
            let lost = self.rim[hit.face as usize] || crowded(&surface, &hit);
            (!lost).then_some(hit)
        };
        x.iter().map(one).collect()
    }

    /// The wall of a point `p` [m] whose nearest triangle was `face`; follows it over the `skin`.
    ///
    /// None where skin is far, or where the way got lost behind another limb.
    pub fn wall(&self, skin: &Posed, p: Vec3, face: &mut u32) -> Wall {
        if *face == NO_FACE {
            return OPEN;
        }
        let hit = self.follow(skin, p, face);
        let f = self.flesh.rest().faces()[*face as usize];
        let smooth: Vec3 = (0..3)
            .map(|k| skin.normals[f[k] as usize] * hit.weights[k])
            .sum();
        let away = p - hit.point;
        let lost = away.dot(smooth) < 0.0 && hit.square > LOST * LOST;
        if lost || self.rim[*face as usize] {
            return OPEN;
        }
        let n = match hit.square > TOUCHING * TOUCHING {
            true => away * (away.dot(smooth).signum() / hit.square.sqrt()),
            false => smooth.normalize_or_zero(),
        };
        [n.x, n.y, n.z, n.dot(hit.point)]
    }

    /// Goes from triangle to neighbouring triangle for as long as that leads nearer to `p`.
    fn follow(&self, skin: &Posed, p: Vec3, face: &mut u32) -> Near {
        let faces = self.flesh.rest().faces();
        let corners = |f: u32| faces[f as usize].map(|v| skin.verts[v as usize]);
        let mut hit = near_triangle(p, corners(*face));
        for _ in 0..HOPS {
            // Inside a triangle the way to the skin is along its normal: no neighbour is nearer.
            if hit.weights.iter().all(|w| *w > 0.0) {
                break;
            }
            let pivot = (0..3).max_by(|a, b| hit.weights[*a].total_cmp(&hit.weights[*b]));
            let pivot = faces[*face as usize][pivot.expect("three corners")] as usize;
            let span = self.around.0[pivot] as usize..self.around.0[pivot + 1] as usize;
            let before = *face;
            for &f in &self.around.1[span] {
                let next = near_triangle(p, corners(f));
                if next.square < hit.square {
                    (hit, *face) = (next, f);
                }
            }
            if *face == before {
                break;
            }
        }
        hit
    }
}

fn over_origin(pose: &Pose) -> Pose {
    Pose {
        root: DVec3::ZERO,
        rotations: pose.rotations.clone(),
    }
}

/// Whether other skin faces the one that was hit, so near that no cloth fits between.
fn crowded(surface: &Surface, hit: &Closest) -> bool {
    if hit.signed >= 0.02 {
        return false;
    }
    let beyond = hit.point + hit.normal * ROOM;
    let other = surface.closest_near(beyond, 2.0 * ROOM, hit.face);
    other.is_some_and(|c| c.signed < 0.3 * ROOM)
}

/// The plane through the nearest point of a surface that looks towards `x` [m] from the outside.
pub(crate) fn plane(hit: &Closest, x: DVec3) -> Wall {
    let n = match hit.signed.abs() > f64::from(TOUCHING) {
        true => (x - hit.point) / hit.signed,
        false => hit.normal,
    };
    let [a, b, c] = n.as_vec3().to_array();
    [a, b, c, n.dot(hit.point) as f32]
}

/// Which triangles have a corner on an edge that belongs to no other.
pub(crate) fn rim(faces: &[[u32; 3]]) -> Vec<bool> {
    let mut edges: Vec<[u32; 2]> = (faces.iter())
        .flat_map(|f| (0..3).map(|k| [f[k].min(f[(k + 1) % 3]), f[k].max(f[(k + 1) % 3])]))
        .collect();
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| a == b).filter(|e| e.len() == 1);
    let mut verts: Vec<u32> = single.flat_map(|e| e[0]).collect();
    verts.sort_unstable();
    let on = |v: &u32| verts.binary_search(v).is_ok();
    faces.iter().map(|f| f.iter().any(on)).collect()
}

/// Triangles around every vertex.
fn around(n: usize, faces: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut rows = vec![Vec::new(); n];
    for (f, face) in faces.iter().enumerate() {
        face.iter().for_each(|v| rows[*v as usize].push(f as u32));
    }
    flat(&rows)
}

/// The point of a triangle nearest to another.
#[derive(Clone, Copy)]
struct Near {
    point: Vec3,
    weights: [f32; 3],
    /// Squared distance [m²].
    square: f32,
}

/// The point of triangle `t` nearest to `p`: `muslin_geom`'s in single precision, seen from `p`.
fn near_triangle(p: Vec3, t: [Vec3; 3]) -> Near {
    let t = t.map(|c| c - p);
    let [a, b, c] = t;
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (-ab.dot(a), -ac.dot(a));
    let at = |u: f32, v: f32, w: f32| {
        let off = a * u + b * v + c * w;
        Near {
            point: p + off,
            weights: [u, v, w],
            square: off.length_squared(),
        }
    };
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(1.0, 0.0, 0.0);
    }
    let (d3, d4) = (-ab.dot(b), -ac.dot(b));
    if d3 >= 0.0 && d4 <= d3 {
        return at(0.0, 1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return at(1.0 - v, v, 0.0);
    }
    let (d5, d6) = (-ab.dot(c), -ac.dot(c));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return at(1.0 - w, 0.0, w);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(0.0, 1.0 - w, w);
    }
    let s = 1.0 / (va + vb + vc);
    at(1.0 - vb * s - vc * s, vb * s, vc * s)
}

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;
    use crate::testing::Class;

    #[test]
    fn a_wall_that_is_followed_is_that_of_the_nearest_skin() {
        let class = Class::new();
        let body = Skinned::new((&class.avatar, &class.figure), &class.template);
        let skin = body.skin(&class.poses[0]);
        let verts: Vec<DVec3> = skin.verts.iter().map(|p| p.as_dvec3()).collect();
        let surface = Surface::new(&verts, body.flesh.rest().faces());
        let mut faces = body.nearest(&skin, &verts, |_| None);
        let mut noise = Noise::new(5);
        let (mut n, mut right) = (0, 0);
        for (p, face) in verts.iter().zip(&mut faces) {
            let p = *p + DVec3::from_array([0; 3].map(|_| 0.01 * noise.normal()));
            let wall = body.wall(&skin, p.as_vec3(), face);
            let truth = surface.closest(p, 0.2).expect("skin is near");
            if wall == OPEN || truth.signed < 0.0 {
                continue;
            }
            let gap = f64::from(Vec3::from_slice(&wall[..3]).dot(p.as_vec3()) - wall[3]);
            n += 1;
            right += usize::from((gap - truth.signed).abs() < 1e-5);
        }
        assert!(n > 500 && right as f64 > 0.95 * n as f64, "{right} of {n}");
        let deep: Vec<DVec3> = verts
            .iter()
            .zip(&skin.normals)
            .map(|(p, n)| *p - n.as_dvec3() * 0.03)
            .collect();
        let walls = body.walls(&skin, &deep);
        let gap = |(w, p): (&Wall, &DVec3)| Vec3::from_slice(&w[..3]).dot(p.as_vec3()) - w[3];
        let walled = || walls.iter().zip(&deep).filter(|(w, _)| **w != OPEN);
        assert!(
            walled().count() > 500,
            "deep behind it, too, there is a wall"
        );
        for (wall, p) in walled() {
            let truth = surface.closest(*p, 0.2).expect("skin is near").signed;
            assert!((f64::from(gap((wall, p))) - truth).abs() < 1e-5);
            assert!((Vec3::from_slice(&wall[..3]).length() - 1.0).abs() < 1e-5);
        }
        let far = body.wall(&skin, Vec3::splat(9.0), &mut NO_FACE.clone());
        assert_eq!(far, OPEN);
    }
}
