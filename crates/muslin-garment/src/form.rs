//! The form a garment is cut on: a smooth union of tubes and of what must stay inside.

use crate::tube::Tube;
use glam::DVec3;
use muslin_geom::{Closest, Surface};

/// What a part is cut off by.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Wall {
    /// A plane through a point [m], with the unit normal out of the part.
    Plane(DVec3, DVec3),
    /// A floor that is lowest at a point [m] and rises before and behind it (±Z), like a saddle:
    /// the radius of its curve [m].
    Saddle(DVec3, f64),
}

impl Wall {
    /// How far `p` is beyond [m], and the direction that grows.
    fn beyond(&self, p: DVec3) -> (f64, DVec3) {
        match *self {
            Wall::Plane(point, out) => ((p - point).dot(out), out),
            Wall::Saddle(low, radius) => {
                let z = (p.z - low.z).clamp(-radius, radius);
                let slope = z / radius;
                let g = DVec3::new(0.0, -1.0, slope);
                let steep = g.length();
                ((low.y + 0.5 * z * slope - p.y) / steep, g / steep)
            }
        }
    }
}

/// One solid of a form.
pub(crate) enum Part<'a> {
    /// A tube that ends at walls; far from its axis [m] it is not asked.
    Tube(&'a Tube, Vec<Wall>, f64),
    /// The body, grown by a gap [m].
    Skin(&'a Surface, f64),
    /// Cloth that is worn under, grown by a gap [m]; its rim's vertices are marked.
    Cloth(&'a Surface, &'a [bool], f64),
}

/// A union of parts; cloth lies on its surface.
pub(crate) struct Form<'a> {
    pub parts: Vec<Part<'a>>,
    /// Width over which parts melt into each other [m].
    pub blend: f64,
}

/// How far from a surface its sign is trusted [m].
const REACH: f64 = 0.05;

/// What a point last learnt about the skins: good for a few millimetres around.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Near {
    known: [Option<Known>; SKINS],
}

#[derive(Clone, Copy, Debug)]
struct Known {
    at: DVec3,
    /// Distance and gradient there; none out of reach.
    found: Option<(f64, DVec3)>,
}

/// More skins than this (a body and what is worn under) are asked anew every time.
const SKINS: usize = 4;

/// How far a skin's distance is continued linearly [m].
const TRUST: f64 = 0.002;

impl<'a> Part<'a> {
    /// A tube that is not asked beyond the range where it could matter.
    pub fn tube(tube: &'a Tube, walls: Vec<Wall>) -> Part<'a> {
        let bound = tube.bound() + REACH;
        Part::Tube(tube, walls, bound)
    }

    fn distance(&self, p: DVec3) -> Option<(f64, DVec3)> {
        match self {
            Part::Tube(tube, walls, bound) => {
                let (_, u, w) = tube.axis.coordinates(p);
                if u * u + w * w > bound * bound {
                    return None;
                }
                let cut = walls.iter().map(|w| w.beyond(p));
                Some(cut.fold(tube.distance(p), |a, b| if b.0 > a.0 { b } else { a }))
            }
            Part::Skin(surface, gap) => {
                let c = surface.closest(p, REACH)?;
                Some((c.signed - gap, away(p, &c)))
            }
            Part::Cloth(surface, rim, gap) => {
                let c = surface.closest(p, REACH)?;
                let f = surface.faces()[c.face as usize];
                let at_rim: f64 = (0..3)
                    .map(|k| c.weights[k] * f64::from(u8::from(rim[f[k] as usize])))
                    .sum();
                if at_rim < 0.999 {
                    return Some((c.signed - gap, away(p, &c)));
                }
                // Beyond its rim the cloth goes on straight, and matters less and less.
                let d = p - c.point;
                let aside = d - c.normal * d.dot(c.normal);
                let g = c.normal + aside.normalize_or_zero() * 0.5;
                Some((d.dot(g) - gap, g))
            }
        }
    }

    fn distance_near(&self, p: DVec3, known: &mut Option<Known>) -> Option<(f64, DVec3)> {
        let fresh = known
            .as_ref()
            .is_some_and(|k| (k.at - p).length_squared() < TRUST * TRUST);
        if !fresh {
            *known = Some(Known {
                at: p,
                found: self.distance(p),
            });
        }
        let k = known.as_ref()?;
        k.found.map(|(d, g)| (d + g.dot(p - k.at), g))
    }
}

impl Form<'_> {
    /// Whether `p` lies in one of the parts or what melts them together.
    pub fn holds(&self, p: DVec3) -> bool {
        self.distance_near(p, &mut Near::default())
            .is_some_and(|d| d.0 < 0.0)
    }

    /// About how far `p` is outside [m], and the direction that grows; none far from everything.
    fn distance_near(&self, p: DVec3, near: &mut Near) -> Option<(f64, DVec3)> {
        let mut skins = near.known.iter_mut().peekable();
        let mut total: Option<(f64, DVec3)> = None;
        for part in &self.parts {
            let cloth = matches!(part, Part::Tube(..));
            let found = match skins.next_if(|_| !cloth) {
                Some(known) => part.distance_near(p, known),
                None => part.distance(p),
            };
            total = match (total, found) {
                (Some(a), Some(b)) => Some(melt(a, b, self.blend)),
                (a, b) => a.or(b),
            };
        }
        total
    }

    /// The direction out of it; none far from everything.
    pub fn normal(&self, p: DVec3, near: &mut Near) -> Option<DVec3> {
        self.distance_near(p, near).map(|d| d.1.normalize_or_zero())
    }

    /// The point of the surface that `p` falls on, by up to `steps` Newton steps.
    pub fn project(&self, p: DVec3, steps: usize, near: &mut Near) -> DVec3 {
        self.project_within(p, steps, near, |v| v)
    }

    /// As [`Form::project`], moving only in directions that `allowed` leaves.
    pub fn project_within(
        &self,
        mut p: DVec3,
        steps: usize,
        near: &mut Near,
        allowed: impl Fn(DVec3) -> DVec3,
    ) -> DVec3 {
        for _ in 0..steps {
            let Some((d, g)) = self.distance_near(p, near) else {
                break;
            };
            let g = allowed(g);
            let step = g * (-d / g.length_squared().max(0.05));
            p += step.clamp_length_max(0.02);
            if d.abs() < 1e-6 {
                break;
            }
        }
        p
    }
}

/// The direction in which the distance from a surface grows.
fn away(p: DVec3, c: &Closest) -> DVec3 {
    if c.signed.abs() > 1e-6 {
        (p - c.point).normalize_or_zero() * c.signed.signum()
    } else {
        c.normal
    }
}

/// The smaller of two distances, rounded off where they are within `k` of each other.
///
/// Quadratic smooth minimum: `min(a, b) − h² k / 4` with `h = max(0, 1 − |a − b| / k)`.
fn melt(a: (f64, DVec3), b: (f64, DVec3), k: f64) -> (f64, DVec3) {
    let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
    let h = (1.0 - (far.0 - near.0) / k).max(0.0);
    let share = h / 2.0;
    let g = near.1 * (1.0 - share) + far.1 * share;
    (near.0 - h * h * k / 4.0, g)
}

/// How far from a skin to draw a tube [m], less than nothing being within, so that what the tube and the
/// skin grown by `gap` [m] melt into over a width `k` [m] is `away` [m] from the skin, or `gap` where that
/// is more.
///
/// Where both are within `k` of it, their [`melt`] vanishes if the roots of their distances add up to that of `k`.
pub(crate) fn melted(away: f64, gap: f64, k: f64) -> f64 {
    let to_gap = (away - gap).clamp(0.0, k);
    away.max(gap) - (k.sqrt() - to_gap.sqrt()).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tube::Axis;

    fn pipe() -> Tube {
        let ring: Vec<[DVec3; 2]> = (0..72)
            .map(|k| {
                let (s, c) = f64::from(k * 5).to_radians().sin_cos();
                let foot = DVec3::new(0.1 * s, 0.0, 0.1 * c);
                [foot, foot + DVec3::Y]
            })
            .collect();
        let axis = Axis::new(DVec3::ZERO, DVec3::Y, DVec3::Z);
        Tube::measure(axis, (0.0, 1.0), &ring)
    }

    #[test]
    fn a_tube_so_drawn_melts_with_the_skin_to_where_it_should() {
        let k = 0.015;
        for (away, gap) in [(0.0048, 0.0042), (0.01, 0.004), (0.05, 0.004)] {
            let (tube, skin) = (away - melted(away, gap, k), away - gap);
            let there = melt((tube, DVec3::X), (skin, DVec3::X), k).0;
            assert!(there.abs() < 1e-12, "{away}, {gap}: {there}");
        }
        // Never nearer than the gap, where the tube does not matter any more.
        assert!((melted(0.002, 0.004, k) - (0.004 - k)).abs() < 1e-12);
    }

    fn cut_pipe(pipe: &Tube, out: DVec3, at: f64) -> Part<'_> {
        Part::tube(pipe, vec![Wall::Plane(out * at, out)])
    }

    #[test]
    fn points_inside_and_outside_land_on_the_same_surface() {
        let pipe = pipe();
        let form = Form {
            parts: vec![cut_pipe(&pipe, DVec3::Y, 0.5)],
            blend: 0.02,
        };
        for r in [0.02, 0.07, 0.15] {
            let p = form.project(DVec3::new(0.0, 0.25, r), 20, &mut Near::default());
            assert!((p.z - 0.1).abs() < 1e-6, "{p}");
        }
        let top = form.project(DVec3::new(0.0, 0.53, 0.01), 20, &mut Near::default());
        assert!((top.y - 0.5).abs() < 1e-6);
    }

    #[test]
    fn the_gradient_of_a_melted_union_is_that_of_its_value() {
        let pipe = pipe();
        let parts = vec![
            cut_pipe(&pipe, DVec3::Y, 0.5),
            cut_pipe(&pipe, DVec3::X, 0.05),
        ];
        let form = Form { parts, blend: 0.05 };
        let p = DVec3::new(0.06, 0.49, 0.03);
        let (_, g) = form
            .distance_near(p, &mut Near::default())
            .expect("tubes reach everywhere");
        for axis in DVec3::AXES {
            let at = |s: f64| {
                form.distance_near(p + axis * s, &mut Near::default())
                    .expect("as above")
                    .0
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((slope - g.dot(axis)).abs() < 1e-6, "{slope} against {g}");
        }
    }
}
