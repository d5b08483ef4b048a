//! Garments of an outfit that lie over each other.

use std::ops::Range;

use glam::{DVec3, Vec3};
use muslin_geom::Surface;
use muslin_sim::Cloth;

use crate::ground::{Ground, NO_FACE, OPEN, Posed};
use crate::lanes::{LANES, Lane, Row, points, side_by_side};
use crate::laws::Wall;

/// Cloth this deep under another garment is no longer led out of it [m]: where cloth below is crumpled, its inside
/// looks outwards, and with 4 cm a spike and what lay over it drove each other on.
pub(crate) const DEEP: f64 = 0.01;
/// How far from cloth that of other garments is looked for [m].
const NEAR: f64 = 0.03;

/// Garments on one side of which others lie.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    /// The vertices that are to stay on that side.
    pub verts: Range<usize>,
    /// The garments, as one, at rest.
    pub surface: Surface,
    /// Their first vertex.
    first: usize,
    /// Their triangles, to be followed.
    pub ground: Ground,
    /// Whether they are worn below, or above.
    is_below: bool,
}

/// A vertex that cloth of another garment is near to: the layer, the vertex, and the triangle that it was nearest to in
/// every pose.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Near {
    pub layer: u32,
    pub vertex: u32,
    pub faces: [u32; LANES],
}

/// A vertex that lies on cloth of another garment, in sixteen poses.
#[derive(Clone, Debug)]
pub(crate) struct Lying {
    pub vertex: u32,
    /// The plane that it lies on; far off where it lies on none.
    pub plane: [Row; 4],
    /// Corners of the triangle, and their shares of the nearest point; none where it lies on none.
    pub corners: [[u32; 3]; LANES],
    pub shares: [[f32; 3]; LANES],
}

/// The outer garments of a cloth that lies at `template` [m] at rest, each over all that it is worn over.
pub(crate) fn layers(cloth: &Cloth, template: &[DVec3]) -> Vec<Layer> {
    let one = |verts: Range<usize>| {
        let below = 0..verts.start;
        Layer::new((cloth, template), verts, (below, true))
    };
    outer(cloth).map(one).collect()
}

/// The same, and what each is worn over below it.
pub(crate) fn both_ways(cloth: &Cloth, template: &[DVec3]) -> Vec<Layer> {
    let other = |verts: Range<usize>| {
        let below = 0..verts.start;
        Layer::new((cloth, template), below, (verts, false))
    };
    let mut out = layers(cloth, template);
    out.extend(outer(cloth).map(other));
    out
}

/// The vertices of each garment that is worn over another.
fn outer(cloth: &Cloth) -> impl Iterator<Item = Range<usize>> + '_ {
    let most = cloth.layers.iter().copied().max().unwrap_or(0);
    (1..=most).map(|k| {
        let start = cloth.layers.partition_point(|l| *l < k);
        start..cloth.layers.partition_point(|l| *l <= k)
    })
}

impl Layer {
    fn new(
        (cloth, template): (&Cloth, &[DVec3]),
        verts: Range<usize>,
        (others, is_below): (Range<usize>, bool),
    ) -> Self {
        let own = |f: &&[u32; 3]| others.contains(&(f[0] as usize));
        let faces = cloth.faces.iter().filter(own);
        let first = others.start as u32;
        let faces: Vec<[u32; 3]> = faces.map(|f| f.map(|v| v - first)).collect();
        Self {
            verts,
            ground: Ground::new(others.len(), &faces),
            surface: Surface::new(&template[others.clone()], &faces),
            first: others.start,
            is_below,
        }
    }

    /// Where the garments of the layer are among all.
    pub fn others(&self) -> Range<usize> {
        self.first..self.first + self.surface.verts().len()
    }

    /// Whether the vertex is one that is to stay on its side and there are such triangles, or they stand for none.
    pub fn has(&self, near: &Near) -> bool {
        let n = self.ground.faces().len();
        let there = |f: &u32| *f == NO_FACE || (*f as usize) < n;
        self.verts.contains(&(near.vertex as usize)) && near.faces.iter().all(there)
    }

    /// The vertices that the garments of the layer are near to, and the triangles nearest to them; the cloth is at `x`
    /// [m].
    pub fn near(&self, x: &[DVec3]) -> Vec<(u32, u32)> {
        let surface = self.surface.moved(&x[self.others()]);
        let one = |v: usize| Some((v as u32, surface.closest(x[v], NEAR)?.face));
        self.verts.clone().filter_map(one).collect()
    }

    /// What such vertices lie on now; the cloth is at `x` [m], and their triangles are followed.
    pub fn lie(&self, x: &[Row], near: &mut [Near]) -> Vec<Lying> {
        let mut out: Vec<Lying> = near.iter().map(|n| Lying::on_none(n.vertex)).collect();
        let (first, Range { start, end }) = (self.first as u32, self.others());
        for lane in 0..LANES {
            let others = points(&x[3 * start..3 * end], lane);
            let others = Posed::new(&others, self.ground.faces());
            for (out, near) in out.iter_mut().zip(&mut *near) {
                let p = x.as_chunks::<3>().0[near.vertex as usize];
                let p = Vec3::from_array(p.map(|row| row[lane]));
                let face = &mut near.faces[lane];
                let Some((plane, shares)) = self.ground.wall(&others, p, (face, DEEP as f32))
                else {
                    continue;
                };
                let plane = match self.is_below {
                    true => plane,
                    false => plane.map(|c| -c),
                };
                let gap = Vec3::from_slice(&plane[..3]).dot(p) - plane[3];
                if gap > -(DEEP as f32) {
                    (0..4).for_each(|c| out.plane[c][lane] = plane[c]);
                    out.corners[lane] = self.ground.faces()[*face as usize].map(|v| v + first);
                    out.shares[lane] = shares;
                }
            }
        }
        out
    }
}

impl Lying {
    fn on_none(vertex: u32) -> Self {
        Self {
            vertex,
            plane: OPEN.map(|c| [c; LANES]),
            corners: [[0; 3]; LANES],
            shares: [[0.0; 3]; LANES],
        }
    }

    /// Adds to `g` [N] how it and the cloth that it lies on push each other where the cloth is at `x` [m]; the energy [J], and
    /// the curvature [N/m] along the plane's normal.
    #[inline(always)]
    pub fn push(&self, wall: &Wall, x: &[Row], g: &mut [Row]) -> [Lane; 2] {
        let v = self.vertex as usize;
        let [a, b, c, offset] = self.plane.map(Lane);
        let gap = a * Lane(x[3 * v]) + b * Lane(x[3 * v + 1]) + c * Lane(x[3 * v + 2]) - offset;
        let [energy, slope, curvature] = wall.at(gap);
        for axis in 0..3 {
            for lane in (0..LANES).filter(|l| slope.0[*l] != 0.0) {
                let force = slope.0[lane] * self.plane[axis][lane];
                g[3 * v + axis][lane] += force;
                for (corner, share) in self.corners[lane].iter().zip(self.shares[lane]) {
                    g[3 * *corner as usize + axis][lane] -= share * force;
                }
            }
        }
        [energy, curvature]
    }

    /// How much of `curvature` [N/m] each corner that it lies on has: lane, corner, and that.
    pub fn stiffened(&self, curvature: Lane) -> impl Iterator<Item = (usize, u32, f32)> + '_ {
        let pushed = (0..LANES).filter(move |l| curvature.0[*l] > 0.0);
        pushed.flat_map(move |l| {
            let each = self.corners[l].into_iter().zip(self.shares[l]);
            each.map(move |(corner, share)| (l, corner, share * share * curvature.0[l]))
        })
    }
}

/// The triangles that vertices of sixteen poses are near to, layer after layer, side by side; none where a pose has
/// none.
pub(crate) fn gathered(poses: &[Vec<Vec<(u32, u32)>>]) -> Vec<Near> {
    let n_layers = poses.first().map_or(0, Vec::len);
    let one = |layer: usize| {
        let of = poses.iter().map(move |p| &p[layer]);
        let all = side_by_side(of, &[NO_FACE; LANES], |faces, lane, face| {
            faces[lane] = *face;
        });
        all.into_iter().map(move |(vertex, faces)| Near {
            layer: layer as u32,
            vertex,
            faces,
        })
    };
    (0..n_layers).flat_map(one).collect()
}
