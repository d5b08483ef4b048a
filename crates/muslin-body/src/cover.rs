//! A plain base layer, so that no picture shows a bare body.

use crate::{Avatar, Part};
use glam::DVec3;

/// How far below the crotch the legs of the base layer end [m], on the mean body.
const LEG: f64 = 0.06;

/// How far from the base of the neck the neckline runs [m], on the mean body.
const NECKLINE: f64 = 0.095;

/// Bones from which on the body is an arm.
const ARMS: [&str; 2] = ["shoulder01.L", "shoulder01.R"];

/// Bones from which on the body is a head.
const HEAD: [&str; 1] = ["neck02"];

impl Avatar {
    /// How deep every vertex lies under a plain sleeveless suit from shoulder to upper thigh.
    ///
    /// Positive [m] where covered, negative where bare, zero along the hems: interpolated
    /// over a triangle, its sign gives smooth edges. The same on every shape.
    pub fn base_layer(&self) -> Vec<f64> {
        let neck = self.mean_joint("neck01");
        let hem = self.mean_crotch() - LEG;
        let (arms, head) = (self.beyond(&ARMS), self.beyond(&HEAD));
        let depth = |i: usize| {
            let x = self.parts.mean[i];
            let hem_depth = x.y - hem;
            let neck_depth = x.distance(neck + DVec3::new(0.0, 0.01, 0.0)) - NECKLINE;
            let head_depth = (0.5 - self.share(i, &head)) * 0.15;
            let arm_depth = (0.45 - self.share(i, &arms)) * 0.15;
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

    /// For every bone, whether it is one of these or hangs from one.
    fn beyond(&self, names: &[&str]) -> Vec<bool> {
        let rig = self.rig();
        let roots: Vec<usize> = names.iter().filter_map(|n| self.bone(n).ok()).collect();
        (0..rig.n_bones())
            .map(|b| roots.iter().any(|&r| rig.descends(b, r)))
            .collect()
    }

    /// How much of a vertex moves with these bones.
    fn share(&self, vertex: usize, ours: &[bool]) -> f64 {
        let row = self.rig().weights.row(vertex);
        row.iter()
            .filter(|&&(b, _)| ours[b as usize])
            .map(|&(_, w)| w)
            .sum()
    }
}
