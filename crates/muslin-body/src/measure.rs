//! A figure's measures: what a scale, a stadiometer and a tape would say.

use crate::stature::span;
use crate::{Avatar, BodyError, Figure, Part, Shape};
use glam::{DVec2, DVec3};

/// Mass of a body by its volume [kg/m³].
///
/// Bodies float with full lungs and sink with empty ones: between 950 and 1,060. The
/// figure is that of the anny package's own anthropometry.
pub const DENSITY: f64 = 980.0;

/// Sliders that widen chest, waist and hip, each by itself.
pub const GIRTHS: [&str; 3] = [
    "measure-bust-circ",
    "measure-waist-circ",
    "measure-hips-circ",
];

/// Measures of a figure in the rest pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Crown to sole [m].
    pub height: f64,
    /// Inside the closed skin [m³].
    pub volume: f64,
    /// Volume times [`DENSITY`] [kg].
    pub mass: f64,
    /// Around the fullest part of the chest, under the arms [m].
    pub chest: f64,
    /// Around the natural waist, along the skin [m].
    pub waist: f64,
    /// Around the fullest part of the seat [m].
    pub hip: f64,
    /// Inside of the leg, crotch to sole [m].
    pub inseam: f64,
    /// Shoulder point to wrist along the arm [m].
    pub arm: f64,
    /// Between the shoulder joints [m].
    pub shoulders: f64,
}

impl Measures {
    /// Chest, waist and hip [m].
    pub fn girths(&self) -> [f64; 3] {
        [self.chest, self.waist, self.hip]
    }
}

impl Avatar {
    /// The measures of `figure`.
    pub fn measure(&self, figure: &Figure) -> Measures {
        let (volume, torso) = (self.volume(figure), self.torso());
        let (crotch, sole) = (
            self.crotch(figure),
            lowest(&figure.verts[self.part(Part::Body)]),
        );
        Measures {
            height: self.height(figure),
            volume,
            mass: volume * DENSITY,
            chest: self.chest(figure, &torso),
            waist: self.waist(figure),
            hip: self.hip(figure, &torso, crotch),
            inseam: crotch - sole,
            arm: self.arm(figure),
            shoulders: self
                .joint(figure, "upperarm01.L")
                .distance(self.joint(figure, "upperarm01.R")),
        }
    }

    /// Crown to sole [m].
    pub fn height(&self, figure: &Figure) -> f64 {
        span(
            self.stature
                .points
                .iter()
                .map(|&i| figure.verts[i as usize].y),
        )
    }

    /// Inside the closed skin [m³], by the divergence theorem.
    pub fn volume(&self, figure: &Figure) -> f64 {
        enclosed(&figure.verts, self.collision_faces())
    }

    /// Inside the closed skin of `shape` [m³]; only the skin is evaluated.
    pub(crate) fn volume_of(&self, shape: &Shape) -> Result<f64, BodyError> {
        let skin = self.moved(shape, self.part(Part::Body).end)?;
        Ok(enclosed(&skin, self.collision_faces()))
    }

    /// Around the waist along the skin [m].
    pub fn waist(&self, figure: &Figure) -> f64 {
        let at: Vec<DVec3> = self
            .parts
            .waist
            .iter()
            .map(|&i| figure.verts[i as usize])
            .collect();
        (0..at.len())
            .map(|i| at[i].distance(at[(i + 1) % at.len()]))
            .sum()
    }

    /// The fullest level of the torso between the shoulder blades and the lowest ribs.
    fn chest(&self, figure: &Figure, torso: &[[u32; 3]]) -> f64 {
        let (low, high) = (
            self.joint(figure, "spine03").y,
            self.joint(figure, "upperarm01.L").y,
        );
        fullest(figure, torso, low, low + 0.9 * (high - low))
    }

    /// The fullest level of the torso from the crotch up to the waist.
    fn hip(&self, figure: &Figure, torso: &[[u32; 3]], crotch: f64) -> f64 {
        fullest(
            figure,
            torso,
            crotch + 0.01,
            self.joint(figure, "spine04").y,
        )
    }

    /// A tape pulled tight around the torso at height `y` [m]: the convex hull of the cut.
    ///
    /// Arms do not count. Zero where nothing is cut.
    pub fn girth(&self, figure: &Figure, y: f64) -> f64 {
        girth(figure, &self.torso(), y)
    }

    /// Triangles of the trunk and the thighs.
    fn torso(&self) -> Vec<[u32; 3]> {
        let names = ["root", "spine", "pelvis", "breast", "upperleg", "clavicle"];
        let bones = &self.rig().bones;
        let trunk: Vec<bool> = bones
            .iter()
            .map(|b| names.iter().any(|t| b.name.starts_with(t)))
            .collect();
        let mostly = |&v: &u32| {
            let row = self.rig().weights.row(v as usize).iter();
            row.filter(|(b, _)| trunk[*b as usize])
                .map(|(_, w)| w)
                .sum::<f64>()
                > 0.5
        };
        self.collision_faces()
            .iter()
            .filter(|f| f.iter().all(mostly))
            .copied()
            .collect()
    }

    /// The lowest skin between the legs [m above the origin].
    fn crotch(&self, figure: &Figure) -> f64 {
        let skin = &figure.verts[self.part(Part::Body)];
        let lowest = |far: f64| {
            let middle = skin.iter().filter(|v| v.x.abs() < far);
            middle.map(|v| v.y).reduce(f64::min)
        };
        // Not every skin is symmetric; wider than this there are legs.
        let wider = [0.004, 0.008, 0.016].into_iter().find_map(lowest);
        wider.unwrap_or_default()
    }

    /// Shoulder joint, elbow, wrist: the mean of both sides.
    fn arm(&self, figure: &Figure) -> f64 {
        let side = |s: &str| {
            let at = ["upperarm01", "lowerarm01", "wrist"]
                .map(|b| self.joint(figure, &format!("{b}{s}")));
            at[0].distance(at[1]) + at[1].distance(at[2])
        };
        (side(".L") + side(".R")) / 2.0
    }

    /// The head of the bone called `name`; the origin in a rig that has none.
    fn joint(&self, figure: &Figure, name: &str) -> DVec3 {
        self.bone(name)
            .map(|b| figure.joints[b])
            .unwrap_or_default()
    }
}

/// The longest tape around the torso over 24 levels between `low` and `high` [m].
fn fullest(figure: &Figure, torso: &[[u32; 3]], low: f64, high: f64) -> f64 {
    let level = |k: usize| low + (high - low) * k as f64 / 23.0;
    (0..24)
        .map(|k| girth(figure, torso, level(k)))
        .fold(0.0, f64::max)
}

fn girth(figure: &Figure, torso: &[[u32; 3]], y: f64) -> f64 {
    let mut cut = Vec::new();
    for f in torso {
        cut_triangle(f.map(|i| figure.verts[i as usize]), y, &mut cut);
    }
    hull_length(cut)
}

fn enclosed(verts: &[DVec3], faces: &[[u32; 3]]) -> f64 {
    let six = faces.iter().map(|f| {
        let [a, b, c] = f.map(|i| verts[i as usize]);
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}

fn lowest(at: &[DVec3]) -> f64 {
    at.iter().map(|v| v.y).fold(f64::MAX, f64::min)
}

/// Where the plane of height `y` cuts the edges of a triangle.
fn cut_triangle(t: [DVec3; 3], y: f64, cut: &mut Vec<DVec2>) {
    for k in 0..3 {
        let (a, b) = (t[k], t[(k + 1) % 3]);
        if (a.y < y) != (b.y < y) {
            let at = a.lerp(b, (y - a.y) / (b.y - a.y));
            cut.push(DVec2::new(at.x, at.z));
        }
    }
}

/// Length of the convex hull of points (Andrew's monotone chain).
fn hull_length(mut points: Vec<DVec2>) -> f64 {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let lower = chain(points.iter().copied());
    let upper = chain(points.iter().rev().copied());
    lower + upper
}

/// Length of the hull's one side, from the first point to the last.
fn chain(points: impl Iterator<Item = DVec2>) -> f64 {
    let mut hull: Vec<DVec2> = Vec::new();
    for p in points {
        while let [.., a, b] = hull[..]
            && (b - a).perp_dot(p - a) <= 0.0
        {
            hull.pop();
        }
        hull.push(p);
    }
    hull.windows(2).map(|w| w[0].distance(w[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tape_around_a_square_ignores_what_is_inside() {
        let corners = [
            (0.0, 0.0),
            (1.0, 0.0),
            (1.0, 1.0),
            (0.0, 1.0),
            (0.5, 0.5),
            (0.2, 0.0),
        ];
        let points = corners.map(|(x, y)| DVec2::new(x, y)).to_vec();
        assert!((hull_length(points) - 4.0).abs() < 1e-12);
        assert_eq!(hull_length(Vec::new()), 0.0);
    }
}
