//! Fans that lie open: where the faces around a vertex cannot be near each other.
//!
//! Most pairs of faces that a search brings up share a vertex, and almost all of them lie spread
//! out side by side. Seen along the fan's mean normal such faces do not overlap; then features
//! without a common vertex are at least as far apart as the fan's smallest height.

use std::array;

use glam::{Mat4, Vec3A, Vec4};

use crate::{ordered, pattern::Rows};

/// Heights count as distances with this much to spare, for fans with obtuse corners.
const SPARE: f32 = 1.25;

/// Faces around a vertex at most: a fan of more is not asked.
const FACES: usize = 16;
/// Faces that are looked at side by side.
const LANES: usize = 4;

/// For every vertex the two sides of each face around it: where they start, how many there are, and their far
/// ends. Fours are filled up with the vertex itself.
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

impl Fans {
    /// `corners`: for every vertex its corners, as `3 face + corner`.
    pub fn new(corners: &Rows, faces: &[[u32; 3]]) -> Fans {
        let (mut starts, mut ends) = (vec![0], Vec::new());
        for i in 0..corners.start.len() - 1 {
            for c in corners.row(i) {
                let (f, k) = (faces[*c as usize / 3], *c as usize % 3);
                ends.push([f[(k + 1) % 3], f[(k + 2) % 3]]);
            }
            while ends.len() % LANES != 0 {
                ends.push([i as u32; 2]);
            }
            starts.push((ends.len() / LANES) as u32);
        }
        Fans {
            starts,
            counts: corners.start.windows(2).map(|s| s[1] - s[0]).collect(),
            ends: ends.as_chunks().0.to_vec(),
        }
    }

    /// Vertices whose faces cannot come within `reach` [m] of each other, but at what they share,
    /// while every vertex goes straight by its entry of `moves` [m]; of those that are `asked` about.
    /// `x`: as seen from somewhere near [m]; `reach` has room for what single precision leaves open.
    pub fn open(
        &self,
        (x, moves): (&[Vec3A], &[Vec3A]),
        (reach, asked): (f32, &[bool]),
        near: &Rows,
    ) -> Vec<bool> {
        ordered::map(x.len(), |i| {
            asked[i] && {
                let stray = |j: &u32| (moves[*j as usize] - moves[i]).length_squared();
                let strays = near.row(i).iter().map(stray);
                let room = SPARE * (reach + 2.0 * strays.fold(0.0, f32::max).sqrt());
                self.is_open(i, x, room)
            }
        })
    }

    /// Whether the faces around a vertex lie side by side with heights of more than `room` [m].
    fn is_open(&self, i: usize, x: &[Vec3A], room: f32) -> bool {
        let ends = &self.ends[self.starts[i] as usize..self.starts[i + 1] as usize];
        let mut sides = [[Four::ZERO; 2]; FACES / LANES];
        let Some(sides) = sides.get_mut(..ends.len()) else {
            return false;
        };
        let here = x[i];
        let at = |j: u32| x[j as usize] - here;
        let mut sum = Four::ZERO;
        for (sides, [e, f, g, h]) in sides.iter_mut().zip(ends) {
            let b = Four::of(at(e[0]), at(f[0]), at(g[0]), at(h[0]));
            let c = Four::of(at(e[1]), at(f[1]), at(g[1]), at(h[1]));
            sum = sum.plus(&b.cross(&c));
            *sides = [b, c];
        }
        let Some(mean) = sum.total().try_normalize() else {
            return false;
        };
        // Seen along the mean normal: what lies in its direction does not count.
        let plane = mean.any_orthonormal_pair();
        let first = sides[0][0].seen(plane).0.map(|axis| Vec4::splat(axis.x));
        let ahead = Flat(first);
        // A fan that goes round more than once has two faces over one direction.
        let (mut over, mut left) = (0, self.counts[i] as usize);
        for [b, c] in sides {
            let asked = (1 << left.min(LANES)) - 1;
            left = left.saturating_sub(LANES);
            let [b, c] = [b.seen(plane), c.seen(plane)];
            let twice = b.perp_dot(&c);
            let longest = b.dot(&b).max(c.dot(&c)).max(b.apart(&c));
            let high = twice.cmpgt(Vec4::ZERO) & (twice * twice).cmpgt(longest * (room * room));
            if high.bitmask() & asked != asked {
                return false;
            }
            let here = b.perp_dot(&ahead).cmpge(Vec4::ZERO)
                & ahead.perp_dot(&c).cmpgt(Vec4::ZERO)
                & (ahead.dot(&b) + ahead.dot(&c)).cmpgt(Vec4::ZERO);
            over += (here.bitmask() & asked).count_ones();
        }
        over <= 1
    }
}

impl Four {
    const ZERO: Four = Four([Vec4::ZERO; 3]);

    #[inline]
    fn of(a: Vec3A, b: Vec3A, c: Vec3A, d: Vec3A) -> Four {
        let all = Mat4::from_cols(a.extend(0.0), b.extend(0.0), c.extend(0.0), d.extend(0.0));
        let all = all.transpose();
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
        // A hub and its rim of three to nine, bent and torn about; whole fans and open ones.
        let mut seed = 7_u64;
        let mut rng = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1_u64 << 31) as f64
        };
        let mut open = 0;
        for case in 0..4000 {
            let n = 3 + case % 7;
            let whole = case % 2 == 0;
            let mut x = vec![DVec3::ZERO];
            let bent = 0.012 * rng();
            for k in 0..n {
                let turn = (k as f64 + 0.6 * rng()) / n as f64 * std::f64::consts::TAU;
                let out = DVec3::new(turn.cos(), turn.sin(), 0.0) * (0.006 + 0.008 * rng());
                x.push(out + DVec3::Z * bent * (2.0 * rng() - 1.0));
            }
            let last = if whole { n } else { n - 1 };
            let face = |k: usize| [0, 1 + k as u32, 1 + ((k + 1) % n) as u32];
            let faces: Vec<[u32; 3]> = (0..last).map(face).collect();
            let moves: Vec<DVec3> = (0..=n)
                .map(|_| DVec3::new(rng(), rng(), rng()) * 5e-4)
                .collect();
            let pattern = Pattern::new(x.len(), &faces);
            let single = |p: &DVec3| p.as_vec3a();
            let (at, by): (Vec<Vec3A>, Vec<Vec3A>) = (
                x.iter().map(single).collect(),
                moves.iter().map(single).collect(),
            );
            let fans = Fans::new(&pattern.corners, &faces);
            let reach = 0.003;
            let found = fans.open((&at, &by), (reach, &vec![true; x.len()]), &pattern.near);
            if !found[0] {
                continue;
            }
            open += 1;
            for t in [0.0, 0.5, 1.0] {
                let there: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m * t).collect();
                for (k, f) in faces.iter().enumerate() {
                    for g in &faces[..k] {
                        let got = apart(&there, *f, *g);
                        assert!(got > f64::from(reach), "case {case}: {got} m");
                    }
                }
            }
        }
        assert!((400..3600).contains(&open), "{open}");
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
        let pattern = Pattern::new(x.len(), &faces);
        let still = vec![Vec3A::ZERO; x.len()];
        let open = |faces: &[[u32; 3]]| {
            let corners = Pattern::new(x.len(), faces).corners;
            let fans = Fans::new(&corners, faces);
            fans.open((&x, &still), (0.001, &vec![true; x.len()]), &pattern.near)[0]
        };
        assert!(open(&faces[..4]));
        assert!(!open(&faces));
    }
}
