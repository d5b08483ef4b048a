//! A sewing pattern: flat panels, and which of their edges are sewn together.
//!
//! Panels are what a cutter cuts: closed outlines of straight and curved edges, in metres, `y`
//! along the body (up) unless a panel is laid around an arm. Seen from outside of the garment an
//! outline runs counter-clockwise, so that two edges sewn together run against each other.

use glam::{DAffine3, DVec2};

/// Panels and seams, as read from a pattern file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SewingPattern {
    /// The pieces of cloth.
    pub panels: Vec<Panel>,
    /// What is sewn to what; an edge is in one seam at most.
    pub seams: Vec<Seam>,
}

/// One piece of cloth, flat.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// As the pattern calls it.
    pub name: String,
    /// Corners [m] in the order of the outline; edge `k` goes from corner `k` to the next.
    pub corners: Vec<DVec2>,
    /// How each edge goes.
    pub curves: Vec<Curve>,
    /// Where the pattern places the panel beside the body it was drawn for [m].
    pub world_from_panel: DAffine3,
}

/// The way from one corner to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// Straight.
    Line,
    /// A quadratic Bézier curve with this control point [m].
    Quadratic(DVec2),
    /// A cubic Bézier curve with these control points [m].
    Cubic(DVec2, DVec2),
    /// A piece of a circle; a radius below half the chord counts as half the chord.
    Arc {
        /// Radius [m].
        radius: f64,
        /// Whether it is more than half of the circle.
        large: bool,
        /// Whether it turns left (counter-clockwise).
        left: bool,
    },
}

/// Two edges that are sewn together, each as (panel, edge).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seam {
    /// The two edges.
    pub sides: [(u32, u32); 2],
    /// The right side of one is sewn to the wrong side of the other: the edges run alike.
    pub flipped: bool,
}

/// Chords that stand for a curve when its length is measured.
const FINE: usize = 200;

impl Panel {
    /// The point [m] of edge `k` at parameter `t` from 0 to 1.
    pub fn point(&self, k: usize, t: f64) -> DVec2 {
        let (a, b) = (self.corners[k], self.corners[(k + 1) % self.corners.len()]);
        let s = 1.0 - t;
        match self.curves[k] {
            Curve::Line => a * s + b * t,
            Curve::Quadratic(c) => a * (s * s) + c * (2.0 * s * t) + b * (t * t),
            Curve::Cubic(c, d) => {
                a * (s * s * s) + c * (3.0 * s * s * t) + d * (3.0 * s * t * t) + b * (t * t * t)
            }
            Curve::Arc {
                radius,
                large,
                left,
            } => arc((a, b), radius, (large, left), t),
        }
    }

    /// Length of edge `k` [m].
    pub fn length(&self, k: usize) -> f64 {
        self.measured(k).last().copied().unwrap_or(0.0)
    }

    /// `n` points [m] of edge `k` at equal steps of its length: its start and not its end.
    pub fn spaced(&self, k: usize, n: usize) -> Vec<DVec2> {
        let far = self.measured(k);
        let whole = far[FINE];
        let at = |i: usize| {
            let want = whole * i as f64 / n as f64;
            let j = far.partition_point(|d| *d <= want).clamp(1, FINE);
            let piece = (far[j] - far[j - 1]).max(f64::MIN_POSITIVE);
            let t = (j - 1) as f64 + ((want - far[j - 1]) / piece).clamp(0.0, 1.0);
            self.point(k, t / FINE as f64)
        };
        (0..n).map(at).collect()
    }

    /// Way along edge `k` [m] at every `1 / FINE` of its parameter.
    fn measured(&self, k: usize) -> Vec<f64> {
        let mut far = Vec::with_capacity(FINE + 1);
        far.push(0.0);
        let mut last = (self.point(k, 0.0), 0.0);
        for i in 1..=FINE {
            let p = self.point(k, i as f64 / FINE as f64);
            last = (p, last.1 + p.distance(last.0));
            far.push(last.1);
        }
        far
    }
}

fn arc((a, b): (DVec2, DVec2), radius: f64, (large, left): (bool, bool), t: f64) -> DVec2 {
    let half = 0.5 * (b - a);
    let r = radius.max(half.length());
    let rise = (r * r - half.length_squared()).max(0.0).sqrt();
    let side = if left != large { 1.0 } else { -1.0 };
    let middle = a + half + half.perp().normalize_or_zero() * (rise * side);
    let (from, to) = (a - middle, b - middle);
    let turn = from.angle_to(to).rem_euclid(std::f64::consts::TAU);
    let turn = if left {
        turn
    } else {
        turn - std::f64::consts::TAU
    };
    middle + DVec2::from_angle(turn * t).rotate(from)
}

impl SewingPattern {
    /// The other side of the seam that edge `k` of panel `p` is in, and whether it is flipped.
    pub fn across(&self, p: u32, k: u32) -> Option<((u32, u32), bool)> {
        self.seams.iter().find_map(|s| {
            let [a, b] = s.sides;
            match () {
                () if a == (p, k) => Some((b, s.flipped)),
                () if b == (p, k) => Some((a, s.flipped)),
                () => None,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(curve: Curve) -> Panel {
        Panel {
            name: "p".into(),
            corners: vec![DVec2::ZERO, DVec2::X, DVec2::Y],
            curves: vec![curve, Curve::Line, Curve::Line],
            world_from_panel: DAffine3::IDENTITY,
        }
    }

    #[test]
    fn arcs_bulge_to_the_side_they_turn_from() {
        let (radius, large) = (0.5, false);
        let of = |left| {
            panel(Curve::Arc {
                radius,
                large,
                left,
            })
        };
        assert!(of(true).point(0, 0.5).distance(DVec2::new(0.5, -0.5)) < 1e-12);
        assert!(of(false).point(0, 0.5).distance(DVec2::new(0.5, 0.5)) < 1e-12);
        assert!((of(true).length(0) - std::f64::consts::FRAC_PI_2).abs() < 1e-4);
        let wide = panel(Curve::Arc {
            radius: 1.0,
            large: true,
            left: true,
        });
        let turn = 5.0 / 3.0 * std::f64::consts::PI;
        assert!((wide.length(0) - turn).abs() < 1e-3);
        assert!(wide.point(0, 1.0).distance(DVec2::X) < 1e-12);
    }

    #[test]
    fn spaced_points_are_evenly_apart_on_a_lopsided_curve() {
        let p = panel(Curve::Cubic(DVec2::new(0.05, 0.4), DVec2::new(0.1, 0.1)));
        let mut at = p.spaced(0, 20);
        at.push(DVec2::X);
        let steps: Vec<f64> = at.windows(2).map(|w| w[0].distance(w[1])).collect();
        let want = p.length(0) / 20.0;
        // Chords of the sharp bend are a little shorter than the way along it.
        assert!(
            steps.iter().all(|s| (0.9..1.001).contains(&(s / want))),
            "{steps:?}"
        );
    }
}
