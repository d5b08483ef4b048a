//! The body in a pose, as walls for the cloth.

use glam::{DAffine3, DVec3, Vec3};
use muslin_body::{Avatar, Cores, Figure, Part, Pose};
use muslin_geom::{Closest, Surface};
use muslin_sim::{Flesh, Frame};

use crate::around::Resting;
use crate::ground::{Ground, NO_FACE, OPEN, Posed, Wall, plane};

/// How far from the cloth skin is looked for [m].
const REACH: f64 = 0.06;
/// Cloth deeper in the body than this has slipped [m].
const SHALLOW: f64 = 0.003;
/// Room that cloth needs between two parts of the body [m].
const ROOM: f64 = 0.007;
/// Skin this near to cloth at rest may give way [m].
const SOFT: f64 = 0.05;
/// Followed this far behind the skin, a point has lost its way: it passed by another limb [m].
const LOST: f32 = 0.02;

/// Somebody whose skin around the cloth can be asked for.
pub struct Skinned<'a> {
    pub avatar: &'a Avatar,
    pub figure: &'a Figure,
    /// Vertices of the skin around the cloth, and their triangles in that numbering.
    verts: Vec<u32>,
    /// The same at rest, ready to be moved into poses.
    flesh: Flesh,
    /// Its triangles, to be followed; openings are the rim of what was kept.
    ground: Ground,
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
            ground: Ground::new(at.len(), &faces),
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
        let own = &self.ground;
        (own.faces(), own.around(), own.rim())
    }

    /// Whether there is such a triangle around the cloth, or it stands for none.
    pub fn has(&self, face: u32) -> bool {
        face == NO_FACE || (face as usize) < self.ground.faces().len()
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
        Posed::new(&relief.verts, self.ground.faces())
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
            let lost = self.ground.rim()[hit.face as usize] || crowded(&surface, &hit);
            (!lost).then_some(hit)
        };
        x.iter().map(one).collect()
    }

    /// The wall of a point `p` [m] whose nearest triangle was `face`; follows it over the `skin`.
    ///
    /// None where skin is far, or where the way got lost behind another limb.
    pub fn wall(&self, skin: &Posed, p: Vec3, face: &mut u32) -> Wall {
        let own = self.ground.wall(skin, p, (face, LOST));
        own.map_or(OPEN, |w| w.0)
    }
}

fn over_origin(pose: &Pose) -> Pose {
    Pose {
        root: DVec3::ZERO,
        ..pose.clone()
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
