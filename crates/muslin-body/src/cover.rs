//! A plain base layer, so that no picture shows a bare body.

use crate::{Avatar, Part};
use glam::DVec3;

/// How far below the crotch the legs of the base layer end [m], on the mean body.
const LEG: f64 = 0.06;

/// How far from the base of the neck the neckline runs [m], on the mean body.
const NECKLINE: f64 = 0.095;

/// Bones of the arms, by how their names start.
const ARM: [&str; 6] = [
    "shoulder",
    "upperarm",
    "lowerarm",
    "wrist",
    "finger",
    "metacarpal",
];

/// Bones of the head and the upper neck.
const HEAD: [&str; 6] = ["neck02", "neck03", "head", "jaw", "special", "oris"];

impl Avatar {
    /// How deep every vertex lies under a plain sleeveless suit from shoulder to upper thigh.
    ///
    /// Positive [m] where covered, negative where bare, zero along the hems: interpolated
    /// over a triangle, its sign gives smooth edges. The same on every shape.
    pub fn base_layer(&self) -> Vec<f64> {
        let neck = self.mean_joint("neck01");
        let hem = self.mean_crotch() - LEG;
        let depth = |i: usize| {
            let x = self.parts.mean[i];
            let hem_depth = x.y - hem;
            let neck_depth = x.distance(neck + DVec3::new(0.0, 0.01, 0.0)) - NECKLINE;
            let head_depth = (0.5 - self.share(i, &HEAD)) * 0.15;
            let arm_depth = (0.45 - self.share(i, &ARM)) * 0.15;
            hem_depth.min(neck_depth).min(head_depth).min(arm_depth)
        };
        let body = self.part(Part::Body);
        (0..self.n_verts())
            .map(|i| if body.contains(&i) { depth(i) } else { -1.0 })
            .collect()
    }

    fn mean_joint(&self, name: &str) -> DVec3 {
        self.bone(name)
            .map(|b| self.parts.mean[self.head_point(b)])
            .unwrap_or_default()
    }

    fn mean_crotch(&self) -> f64 {
        let middle = self.parts.mean[self.part(Part::Body)]
            .iter()
            .filter(|v| v.x.abs() < 0.004);
        middle.map(|v| v.y).fold(f64::MAX, f64::min)
    }

    /// How much of a vertex moves with bones whose names start like one of these.
    fn share(&self, vertex: usize, names: &[&str]) -> f64 {
        let ours = |b: u32| {
            names
                .iter()
                .any(|n| self.rig().bones[b as usize].name.starts_with(n))
        };
        let row = self.rig().weights.row(vertex);
        row.iter().filter(|&&(b, _)| ours(b)).map(|&(_, w)| w).sum()
    }
}
