//! The laws of sixteen poses at once, in single precision: energy and gradient.
//!
//! The same formulas as in `muslin_energy` (`membrane`, `plate`, `point`, `contact`), on coordinate
//! differences; held to them by the tests below. Positions lie `[vertex][axis][pose]` [m];
//! gradients [N] are added, energies [J] returned, one for each pose.

use crate::cut::{Cut, Patch};
use crate::lanes::{Lane, Row, Vec3};

/// Gravity [m/s²].
pub const G: f32 = 9.81;

/// Stretch and shear of all faces, `firmness` times as stiff as they are.
#[inline(always)]
pub fn membrane(cut: &Cut, firmness: f32, x: &[Row], g: &mut [Row]) -> Lane {
    let mut energy = Lane::all(0.0);
    for p in &cut.patches {
        energy += one_patch(p, firmness * p.area, x, g);
    }
    energy
}

#[inline(always)]
fn one_patch(p: &Patch, area: f32, x: &[Row], g: &mut [Row]) -> Lane {
    let [x0, x1, x2] = p.verts.map(|v| Vec3::of(x, v));
    let (a, b) = (x1 - x0, x2 - x0);
    let [s, t] = p.slopes;
    let f = [a * s[0] + b * t[0], a * s[1] + b * t[1]];
    let shear = f[0].dot(f[1]);
    let mut density = shear * shear * p.stretch[2];
    let mut stress = [
        f[1].times(shear * p.stretch[2]),
        f[0].times(shear * p.stretch[2]),
    ];
    for i in 0..2 {
        // A yarn of length zero has no direction; nothing is divided by zero.
        let length = f[i].dot(f[i]).max(Lane::all(1e-24)).sqrt();
        let strain = length - 1.0;
        let k = length.choose_below(1.0, p.stretch[i] * p.compression, p.stretch[i]);
        density += k * strain * strain;
        stress[i] += f[i].times(k * strain / length);
    }
    let spread = |s: [f32; 2]| (stress[0] * s[0] + stress[1] * s[1]) * area;
    let (g1, g2) = (spread(s), spread(t));
    (g1 + g2).times(Lane::all(-1.0)).add_to(g, p.verts[0]);
    g1.add_to(g, p.verts[1]);
    g2.add_to(g, p.verts[2]);
    density * (0.5 * area)
}

/// Bending at one vertex: its pull is row `v` of `Q x`.
#[inline(always)]
pub fn bending(cut: &Cut, x: &[Row], v: usize) -> (Lane, Vec3) {
    let here = Vec3::of(x, v as u32);
    let (mut pull, mut energy) = (Vec3::ZERO, Lane::all(0.0));
    for &(j, q) in cut.bend(v) {
        let d = Vec3::of(x, j) - here;
        pull += d * q;
        energy += d.dot(d) * q;
    }
    // ½ xᵀQx = −¼ ΣΣ q |xᵢ − xⱼ|² where rows sum to zero.
    (energy * -0.25, pull)
}

/// How cloth meets the body: `muslin_energy::contact::Barrier` in single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Gap at which the push begins [m].
    pub radius: f32,
    /// Depth over which its curvature rises [m].
    pub width: f32,
    /// Largest curvature [N/m].
    pub stiffness: f32,
}

impl Wall {
    /// Energy [J], slope [N] and curvature [N/m] at a gap [m].
    #[inline(always)]
    pub fn at(&self, gap: Lane) -> [Lane; 3] {
        let (w, k) = (self.width, self.stiffness);
        let s = (-gap + self.radius).max(Lane::all(0.0));
        let soft = s.min(Lane::all(w));
        let over = s - soft;
        [
            soft * soft * soft * (k / (6.0 * w)) + over * (over + w) * (0.5 * k),
            soft * soft * (-0.5 * k / w) - over * k,
            soft * (k / w),
        ]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use muslin_energy::{contact::Barrier, membrane as exact, plate};

    use super::*;
    use crate::lanes::{LANES, points};
    use crate::testing::{agree, sheet, states};

    #[test]
    fn stretch_of_sixteen_poses_is_the_reference_law() {
        let (cloth, x) = (sheet(), states());
        let cut = Cut::new(&cloth).expect("a valid cloth");
        let mut g = vec![[0.0; LANES]; x.len()];
        let energy = membrane(&cut, 1.0, &x, &mut g);
        let (mut want, mut sums) = (vec![vec![DVec3::ZERO; 12]; LANES], vec![0.0; LANES]);
        for pose in 0..LANES {
            let x = points(&x, pose);
            for (face, rest) in cloth.faces.iter().zip(&cut.rest) {
                let corners = face.map(|v| x[v as usize]);
                let (e, d) = exact::gradient(&corners, rest, &cloth.materials[0].stretch);
                sums[pose] += e;
                (0..3).for_each(|k| want[pose][face[k] as usize] += d[k]);
            }
        }
        agree("membrane", &g, &want, (energy, &sums));
    }

    #[test]
    fn bending_of_sixteen_poses_is_the_reference_law() {
        let (cloth, x) = (sheet(), states());
        let cut = Cut::new(&cloth).expect("a valid cloth");
        let mut g = vec![[0.0; LANES]; x.len()];
        let mut energy = Lane::all(0.0);
        for v in 0..12 {
            let (e, pull) = bending(&cut, &x, v);
            energy += e;
            pull.add_to(&mut g, v as u32);
        }
        let (mut want, mut sums) = (vec![vec![DVec3::ZERO; 12]; LANES], vec![0.0; LANES]);
        for pose in 0..LANES {
            let x = points(&x, pose);
            for (verts, rest) in
                plate::plates(&cloth.faces, &cloth.rest, |_| cloth.materials[0].bend)
            {
                let (e, d) = plate::gradient(&verts.map(|v| x[v as usize]), &rest);
                sums[pose] += e;
                (0..6).for_each(|k| want[pose][verts[k] as usize] += d[k]);
            }
        }
        agree("bending", &g, &want, (energy, &sums));
    }

    #[test]
    fn the_wall_is_the_reference_barrier_on_all_three_of_its_pieces() {
        let exact = Barrier {
            radius: 3e-3,
            width: 1e-3,
            stiffness: 400.0,
        };
        let wall = Wall {
            radius: 3e-3,
            width: 1e-3,
            stiffness: 400.0,
        };
        let mut gaps = Lane::all(0.0);
        (0..LANES).for_each(|i| gaps.0[i] = 5e-3 - 7e-4 * i as f32);
        let got = wall.at(gaps);
        for i in 0..LANES {
            let want = exact.at(f64::from(gaps.0[i]));
            for k in 0..3 {
                let size = [1e-5, 1e-2, 10.0][k];
                assert!(
                    (f64::from(got[k].0[i]) - want[k]).abs() < 1e-4 * size + 1e-5 * want[k].abs()
                );
            }
        }
    }
}
