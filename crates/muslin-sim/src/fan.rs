//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.
//!
//! Why heights are enough, seen so: two straight features that do not cross are nearest at an end of one of
//! them. A rim's end is over a quarter turn away from a spoke, and farther from it than the hub, or
//! less, and then farther from its line than in the face beside it, where the angle is smaller. On the way to another
//! face's rim it either crosses one of that face's spokes, or the rim leans out over it: then it is
//! farther from the rim than from the spoke's line. Where a fan's first and last spoke do
//! not meet, the gap between them has to be as wide.

use std::array;

use glam::{BVec4A, Mat4, Vec3A, Vec4};

use crate::{ordered, pattern::Rows};

/// Faces around a vertex at most: a fan of more is not asked.
const FACES: usize = 16;
/// Faces that are looked at side by side.
const LANES: usize = 4;

/// For every vertex the two sides of each face around it: where they start, how many there are, and their far
/// ends, one face after the other around it; those of a vertex whose faces are no single fan are left out. Fours are
/// filled up with the vertex itself.
#[derive(Clone, Debug)]
pub(crate) struct Fans {
    starts: Vec<u32>,
    counts: Vec<u32>,
    ends: Vec<[[u32; 2]; LANES]>,
}

/// Four points, axis by axis.
#[derive(Clone, Copy)]
struct Four([Vec4; 3]);

/// Four points of a plane.
#[derive(Clone, Copy)]
struct Flat([Vec4; 2]);

/// Two sides of four faces, where they start and where they end.
type Sides = [[Four; 2]; 2];

impl Fans {
    /// `corners`: for every vertex its corners, as `3 face + corner`.
    pub fn new(corners: &Rows, faces: &[[u32; 3]]) -> Fans {
        let (mut starts, mut counts, mut ends) = (vec![0], Vec::new(), Vec::new());
        for i in 0..corners.start.len() - 1 {
            let sides = corners.row(i).iter().map(|c| {
                let (f, k) = (faces[*c as usize / 3], *c as usize % 3);
                [f[(k + 1) % 3], f[(k + 2) % 3]]
            });
            let sides = in_turn(sides.collect()).unwrap_or_default();
            counts.push(sides.len() as u32);
            ends.extend(sides);
            ends.resize(ends.len().next_multiple_of(LANES), [i as u32; 2]);
            starts.push((ends.len() / LANES) as u32);
        }
        let ends = ends.as_chunks().0.to_vec();
        Fans {
            starts,
            counts,
            ends,
        }
    }

    /// Vertices whose faces cannot come within `reach` [m] of each other, but at what they share,
    /// while every vertex goes straight by its entry of `moves` [m]; of those that are `asked` about.
    /// `x`: as seen from somewhere near [m]; `reach` has room for what single precision leaves open.
    pub fn open(
        &self,
        (x, moves): (&[Vec3A], &[Vec3A]),
        (reach, asked): (f32, &[bool]),
    ) -> Vec<bool> {
        ordered::map(x.len(), |i| asked[i] && self.is_open(i, (x, moves), reach))
    }

    /// Whether the faces around a vertex lie side by side with heights of more than `room` [m].
    fn is_open(&self, i: usize, (x, moves): (&[Vec3A], &[Vec3A]), room: f32) -> bool {
        let ends = &self.ends[self.starts[i] as usize..self.starts[i + 1] as usize];
        let mut sides = [[[Four::ZERO; 2]; 2]; FACES / LANES];
        let Some(sides) = sides.get_mut(..ends.len()).filter(|s| !s.is_empty()) else {
            return false;
        };
        let mut sum = Four::ZERO;
        for (sides, ends) in sides.iter_mut().zip(ends) {
            for (way, at) in sides.iter_mut().zip([x, moves]) {
                let to = |j: u32| at[j as usize] - at[i];
                *way = [0, 1].map(|side| Four::of(ends.map(|e| to(e[side]))));
            }
            let [[b, c], [by, cy]] = &*sides;
            sum = sum.plus(&b.plus(b).plus(by).cross(&c.plus(c).plus(cy)));
        }
        // Seen along the mean normal halfway: what lies in its direction does not count.
        let Some(mean) = sum.total().try_normalize() else {
            return false;
        };
        let plane = mean.any_orthonormal_pair();
        let first = sides[0][0][0].seen(plane).0.map(|axis| Vec4::splat(axis.x));
        let ahead = Flat(first);
        // A fan that goes round more than once has two faces over one direction.
        let (mut over, mut left) = (0, self.counts[i] as usize);
        for sides in sides {
            let asked = (1 << left.min(LANES)) - 1;
            left = left.saturating_sub(LANES);
            let way = Turn::of(sides, plane);
            if way.is_high(room).bitmask() & asked != asked {
                return false;
            }
            let [b, c] = way.from;
            let here = b.perp_dot(&ahead).cmpge(Vec4::ZERO) & ahead.perp_dot(&c).cmpgt(Vec4::ZERO);
            over += (here.bitmask() & asked).count_ones();
        }
        let last = self.counts[i] as usize - 1;
        let gap = [ends[last / LANES][last % LANES][1], ends[0][0][0]];
        over <= 1
            && (gap[0] == gap[1] || {
                let sides =
                    [x, moves].map(|at| gap.map(|j| Four::of([at[j as usize] - at[i]; LANES])));
                let way = Turn::of(&sides, plane);
                (way.is_high(room) | way.is_wide()).test(0)
            })
    }
}

/// The sides of a vertex's faces, each face followed by the one that begins where it ends; nothing where they are no
/// single fan.
fn in_turn(mut sides: Vec<[u32; 2]>) -> Option<Vec<[u32; 2]>> {
    if sides.len() > FACES {
        return None;
    }
    let after = |sides: &[[u32; 2]], end: u32| sides.iter().position(|s| s[0] == end);
    let first = |s: &[u32; 2]| sides.iter().all(|other| other[1] != s[0]);
    let mut next = sides.iter().position(first).or(Some(0));
    for k in 0..sides.len() {
        sides.swap(k, next?);
        next = after(&sides[k + 1..], sides[k][1]).map(|n| k + 1 + n);
    }
    Some(sides)
}

/// Two sides of four faces on their straight way, as seen on a plane.
struct Turn {
    from: [Flat; 2],
    to: [Flat; 2],
    /// What the whole way adds to each side.
    by: [Flat; 2],
}

impl Turn {
    fn of([from, by]: &Sides, plane: (Vec3A, Vec3A)) -> Turn {
        let from = from.each_ref().map(|s| s.seen(plane));
        let by = by.each_ref().map(|s| s.seen(plane));
        Turn {
            from,
            to: [0, 1].map(|k| from[k].plus(&by[k])),
            by,
        }
    }

    /// Whether all heights stay above `room` [m]. Twice the area goes as a square of time does, which dips by a quarter of
    /// its bend at most below both of its ends; lengths are greatest at an end.
    fn is_high(&self, room: f32) -> BVec4A {
        let twice = |s: &[Flat; 2]| s[0].perp_dot(&s[1]);
        let least = twice(&self.from).min(twice(&self.to)) - dip(twice(&self.by));
        let longest = |[b, c]: &[Flat; 2]| b.dot(b).max(c.dot(c)).max(b.apart(c));
        let longest = longest(&self.from).max(longest(&self.to));
        least.cmpgt(Vec4::ZERO) & (least * least).cmpgt(longest * (room * room))
    }

    /// Whether it stays wider than a quarter turn, or wider than half of one.
    fn is_wide(&self) -> BVec4A {
        let dot = |s: &[Flat; 2]| s[0].dot(&s[1]);
        let perp = |s: &[Flat; 2]| s[0].perp_dot(&s[1]);
        let most =
            |of: &dyn Fn(&[Flat; 2]) -> Vec4| of(&self.from).max(of(&self.to)) + dip(-of(&self.by));
        most(&dot).cmplt(Vec4::ZERO) | most(&perp).cmplt(Vec4::ZERO)
    }
}

/// By how much a square of time, in `[0, 1]` and with this factor, goes below both of its ends at most.
fn dip(bend: Vec4) -> Vec4 {
    0.25 * bend.max(Vec4::ZERO)
}

impl Four {
    const ZERO: Four = Four([Vec4::ZERO; 3]);

    #[inline]
    fn of(points: [Vec3A; LANES]) -> Four {
        let [a, b, c, d] = points.map(|p| p.extend(0.0));
        let all = Mat4::from_cols(a, b, c, d).transpose();
        Four([all.x_axis, all.y_axis, all.z_axis])
    }

    fn plus(&self, other: &Four) -> Four {
        Four(array::from_fn(|axis| self.0[axis] + other.0[axis]))
    }

    fn cross(&self, other: &Four) -> Four {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, other.0);
        Four([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    }

    fn total(&self) -> Vec3A {
        Vec3A::from(self.0.map(|axis| axis.element_sum()))
    }

    /// Along two directions.
    fn seen(&self, (right, up): (Vec3A, Vec3A)) -> Flat {
        let [x, y, z] = self.0;
        Flat([right, up].map(|to| x * to.x + y * to.y + z * to.z))
    }
}

impl Flat {
    fn plus(&self, other: &Flat) -> Flat {
        Flat(array::from_fn(|axis| self.0[axis] + other.0[axis]))
    }

    fn dot(&self, other: &Flat) -> Vec4 {
        self.0[0] * other.0[0] + self.0[1] * other.0[1]
    }

    fn perp_dot(&self, other: &Flat) -> Vec4 {
        self.0[0] * other.0[1] - self.0[1] * other.0[0]
    }

    /// Distance squared [m²].
    fn apart(&self, other: &Flat) -> Vec4 {
        let off = Flat(array::from_fn(|axis| self.0[axis] - other.0[axis]));
        off.dot(&off)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use muslin_energy::check::Rng;
    use muslin_geom::closest::{on_segments, on_triangle};

    use super::*;
    use crate::pattern::Pattern;

    /// How near two faces come to each other but at what they share [m].
    fn apart(x: &[DVec3], f: [u32; 3], g: [u32; 3]) -> f64 {
        let at = |v: u32| x[v as usize];
        let to_face = |f: [u32; 3], g: [u32; 3]| {
            let free = f.into_iter().filter(move |v| !g.contains(v));
            free.map(move |v| on_triangle(at(v), &g.map(at)).point.distance(at(v)))
        };
        let edges = |f: [u32; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
        let of_edges = edges(f).into_iter().flat_map(|e| edges(g).map(|o| (e, o)));
        let of_edges = of_edges.filter(|(e, o)| e.iter().all(|v| !o.contains(v)));
        let of_edges = of_edges.map(|(e, o)| on_segments(e.map(at), o.map(at)).distance);
        let all = to_face(f, g).chain(to_face(g, f)).chain(of_edges);
        all.fold(f64::MAX, f64::min)
    }

    #[test]
    fn faces_around_a_vertex_that_is_open_stay_apart_on_their_way() {
        // A hub and its rim of three to nine, bent and torn about; whole fans and open ones, up to once around.
        let mut rng = Rng::new(7);
        let mut open = [0; 2];
        for case in 0..20_000 {
            let n = 3 + case % 7;
            let whole = case % 2 == 0;
            let sweep = if whole {
                n as f64
            } else {
                rng.between(n as f64 - 1.0, n as f64 + 1.0)
            };
            let mut x = vec![DVec3::ZERO];
            let bent = rng.between(0.0, 0.012);
            for k in 0..n {
                let turn = (k as f64 + rng.between(0.0, 0.6)) / sweep * std::f64::consts::TAU;
                let out = DVec3::new(turn.cos(), turn.sin(), 0.0) * rng.between(0.004, 0.014);
                x.push(out + DVec3::Z * rng.between(-bent, bent));
            }
            let last = if whole { n } else { n - 1 };
            let face = |k: usize| [0, 1 + k as u32, 1 + ((k + 1) % n) as u32];
            let mut faces: Vec<[u32; 3]> = (0..last).map(face).collect();
            faces.rotate_left(case % last);
            let most = rng.scale(1e-4, 1.2e-2);
            let moves: Vec<DVec3> = (0..=n).map(|_| rng.vector() * most).collect();
            let pattern = Pattern::new(x.len(), &faces);
            let single = |p: &DVec3| p.as_vec3a();
            let (at, by): (Vec<Vec3A>, Vec<Vec3A>) = (
                x.iter().map(single).collect(),
                moves.iter().map(single).collect(),
            );
            let fans = Fans::new(&pattern.corners, &faces);
            let reach = 0.003;
            if !fans.open((&at, &by), (reach, &vec![true; x.len()]))[0] {
                continue;
            }
            open[case % 2] += 1;
            for t in 0..=8 {
                let on = |(x, m): (&DVec3, &DVec3)| *x + *m * (f64::from(t) / 8.0);
                let there: Vec<DVec3> = x.iter().zip(&moves).map(on).collect();
                for (k, f) in faces.iter().enumerate() {
                    for g in &faces[..k] {
                        let got = apart(&there, *f, *g);
                        assert!(got > f64::from(reach) - 1e-8, "case {case}: {got} m");
                    }
                }
            }
        }
        assert!(open.iter().all(|n| (1_000..9_000).contains(n)), "{open:?}");
    }

    #[test]
    fn a_fan_that_goes_round_twice_is_not_open() {
        let rim = |k: usize| {
            let turn = k as f32 / 10.0 * 2.0 * std::f32::consts::TAU;
            Vec3A::new(turn.cos(), turn.sin(), 0.02 * k as f32) * 0.01
        };
        let x: Vec<Vec3A> = std::iter::once(Vec3A::ZERO)
            .chain((0..10).map(rim))
            .collect();
        let faces: Vec<[u32; 3]> = (0..9).map(|k| [0, 1 + k, 2 + k]).collect();
        let still = vec![Vec3A::ZERO; x.len()];
        let open = |faces: &[[u32; 3]]| {
            let corners = Pattern::new(x.len(), faces).corners;
            let fans = Fans::new(&corners, faces);
            fans.open((&x, &still), (0.001, &vec![true; x.len()]))[0]
        };
        assert!(open(&faces[..4]));
        assert!(!open(&faces));
        // Nor one whose ends overlap, whichever of its faces comes first.
        for first in 0..6 {
            let mut some = faces[..6].to_vec();
            some.rotate_left(first);
            assert!(!open(&some), "{first}");
        }
    }
}
