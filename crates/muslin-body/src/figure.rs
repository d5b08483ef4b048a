//! A body of some shape, standing in the rest pose.

use crate::{Avatar, BodyError, Shape};
use glam::DVec3;
use muslin_geom::widely;

/// The rest pose of one shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// All vertices [m]: body, eyes, tights, skirt (see [`Avatar::part`]).
    pub verts: Vec<DVec3>,
    /// Where each bone of the full rig turns [m].
    pub joints: Vec<DVec3>,
    /// Where each bone of the full rig ends [m].
    pub tails: Vec<DVec3>,
}

/// Floats that are summed over all modes at a time: they and their sums stay in the fastest cache.
const BLOCK: usize = 1536;

impl Avatar {
    /// The rest pose of `shape`.
    ///
    /// `x = mean + Σ w_m mode_m + Σ s_l target_l`, for vertices and joints alike.
    pub fn figure(&self, shape: &Shape) -> Result<Figure, BodyError> {
        let points = self.moved(shape, self.n_points())?;
        let n = self.n_verts();
        let at = |bone_points: fn(&Avatar, usize) -> usize| {
            (0..self.rig().n_bones())
                .map(|b| points[bone_points(self, b)])
                .collect()
        };
        let (joints, tails) = (at(Avatar::head_point), at(Avatar::tail_point));
        let mut verts = points;
        verts.truncate(n);
        Ok(Figure {
            verts,
            joints,
            tails,
        })
    }

    /// The first `n` points [m] of `shape`.
    pub(crate) fn moved(&self, shape: &Shape, n: usize) -> Result<Vec<DVec3>, BodyError> {
        shape.check()?;
        let sums = self.mode_sum(&self.blend().weights(&shape.phenotypes), n);
        let mut points: Vec<DVec3> = self.parts.mean[..n].to_vec();
        for (p, s) in points.iter_mut().zip(sums.as_chunks().0) {
            *p += lift(s);
        }
        for (name, value) in &shape.locals {
            let (target, sense) = self.target(name)?;
            let value = value * sense;
            let side = if value < 0.0 {
                &target.down
            } else {
                &target.up
            };
            for (i, d) in side.iter().filter(|(i, _)| (*i as usize) < n) {
                points[*i as usize] += value.abs() * lift(d);
            }
        }
        Ok(points)
    }

    /// `Σ w_m mode_m` over the first `n` points, flat.
    fn mode_sum(&self, weights: &[f64], n: usize) -> Vec<f32> {
        let stride = 3 * self.n_points();
        let mut sums = vec![0.0f32; 3 * n];
        widely(
            #[inline(always)]
            || {
                for (k, block) in sums.chunks_mut(BLOCK).enumerate() {
                    let start = k * BLOCK;
                    for (m, &w) in weights.iter().enumerate() {
                        let mode = &self.parts.modes[m * stride + start..][..block.len()];
                        let w = w as f32;
                        for (sum, x) in block.iter_mut().zip(mode) {
                            *sum += w * x;
                        }
                    }
                }
            },
        );
        sums
    }

    /// Where `points` (indices into [`Avatar::mean`]) are at `shape` [m], without the rest.
    pub fn points_at(&self, shape: &Shape, points: &[u32]) -> Result<Vec<DVec3>, BodyError> {
        let weights = self.blend().weights(&shape.phenotypes);
        let mut at: Vec<DVec3> = points
            .iter()
            .map(|&i| self.parts.mean[i as usize])
            .collect();
        for (m, &w) in weights.iter().enumerate() {
            let mode = self.mode(m);
            for (x, &i) in at.iter_mut().zip(points) {
                *x += w * lift(&mode[i as usize]);
            }
        }
        for (name, value) in &shape.locals {
            let (target, sense) = self.target(name)?;
            let value = value * sense;
            let side = if value < 0.0 {
                &target.down
            } else {
                &target.up
            };
            for (x, &i) in at.iter_mut().zip(points) {
                if let Ok(k) = side.binary_search_by_key(&i, |d| d.0) {
                    *x += value.abs() * lift(&side[k].1);
                }
            }
        }
        Ok(at)
    }
}

fn lift(d: &[f32; 3]) -> DVec3 {
    DVec3::from(d.map(f64::from))
}
