//! Light from all around: which directions each point of the scene can see.
//!
//! The scene is looked at once from directions spread over the whole sphere;
//! what every vertex sees stays true whichever way the lights are then turned.

use glam::Vec3;
use muslin_geom::widely;
use rayon::prelude::*;

use crate::light_map::LightMap;
use crate::project::Flat;

/// A point that gathers light on both sides of a surface.
pub(crate) struct Probe {
    /// Its position [m].
    pub at: Vec3,
    /// The front's unit normal.
    pub normal: Vec3,
}

/// Visibility of every direction from every probe.
pub(crate) struct Dome {
    dirs: Vec<Vec3>,
    /// The probes' normals.
    normals: Vec<Vec3>,
    /// Openness 0 to 255 per direction and probe; zero where the last lanes have none.
    open: Vec<Vec<[u8; LANES]>>,
}

/// Probes lit together, side by side in the processor's registers.
const LANES: usize = 16;
/// Probes that one task lights.
const CHUNK: usize = 32 * LANES;

impl Dome {
    /// Looks along `count` directions, in opposite pairs, with maps of `size` texels a side.
    pub fn new(flat: &Flat, probes: &[Probe], count: usize, size: usize) -> Self {
        let above: Vec<Vec3> = (0..count.div_ceil(2))
            .map(|i| direction(i, count))
            .collect();
        let look = |&dir: &Vec3| {
            let maps = LightMap::opposite(flat, dir, size);
            maps.map(|map| {
                let open = probes.chunks(LANES).map(|probes| {
                    widely(
                        #[inline(always)]
                        || openness(&map, probes),
                    )
                });
                open.collect()
            })
        };
        let open: Vec<[Vec<[u8; LANES]>; 2]> = above.par_iter().map(look).collect();
        let dirs = above.iter().flat_map(|&dir| [dir, -dir]).collect();
        Self {
            dirs,
            normals: probes.iter().map(|probe| probe.normal).collect(),
            open: open.into_iter().flatten().collect(),
        }
    }

    /// Light arriving at the front and back of every probe under a sky of
    /// `radiance`, over π: one for a probe in the open under a white sky.
    pub fn light(&self, radiance: impl Fn(Vec3) -> Vec3) -> Vec<[Vec3; 2]> {
        let share = 4.0 / self.dirs.len().max(1) as f32 / 255.0;
        let sky: Vec<Vec3> = self.dirs.iter().map(|&d| radiance(d) * share).collect();
        let mut lit = vec![[Vec3::ZERO; 2]; self.normals.len()];
        let chunks = lit.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(i, out)| {
            widely(
                #[inline(always)]
                || {
                    for (k, out) in out.chunks_mut(LANES).enumerate() {
                        self.light_some(i * (CHUNK / LANES) + k, &sky, out);
                    }
                },
            );
        });
        lit
    }

    /// Lights the `group`th [`LANES`] probes.
    #[inline(always)]
    fn light_some(&self, group: usize, sky: &[Vec3], out: &mut [[Vec3; 2]]) {
        let mut normal = [[0.0f32; LANES]; 3];
        for (k, n) in self.normals[group * LANES..][..out.len()]
            .iter()
            .enumerate()
        {
            [normal[0][k], normal[1][k], normal[2][k]] = n.to_array();
        }
        let (mut front, mut back) = ([[0.0f32; LANES]; 3], [[0.0f32; LANES]; 3]);
        for ((dir, sky), open) in self.dirs.iter().zip(sky).zip(&self.open) {
            // Copied at a length that is known: a call would take all sums out of their registers.
            let seen = open[group];
            for k in 0..LANES {
                let cos = normal[0][k] * dir.x + normal[1][k] * dir.y + normal[2][k] * dir.z;
                let seen = f32::from(seen[k]);
                let (ahead, behind) = (cos.max(0.0) * seen, (-cos).max(0.0) * seen);
                for c in 0..3 {
                    front[c][k] += sky[c] * ahead;
                    back[c][k] += sky[c] * behind;
                }
            }
        }
        for (k, sides) in out.iter_mut().enumerate() {
            *sides = [&front, &back].map(|s| Vec3::new(s[0][k], s[1][k], s[2][k]));
        }
    }
}

/// Points of a spiral spread evenly over the upper half of the sphere, `count` for
/// both halves.
fn direction(i: usize, count: usize) -> Vec3 {
    let y = 1.0 - (i as f64 + 0.5) / count.div_ceil(2) as f64;
    let turn = i as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let r = (1.0 - y * y).sqrt();
    Vec3::new((r * turn.cos()) as f32, y as f32, (r * turn.sin()) as f32)
}

/// How open the way to a light is from at most [`LANES`] probes, 0 to 255.
#[inline(always)]
fn openness(map: &LightMap, probes: &[Probe]) -> [u8; LANES] {
    let (mut places, mut heights) = ([[0.0; LANES]; 2], [0.0; LANES]);
    for (k, probe) in probes.iter().enumerate() {
        let side = probe.normal.dot(map.toward).signum();
        let lift = probe.normal * (side * 1.1 * map.texel) + map.toward * (0.9 * map.texel);
        let p = map.place(probe.at + lift);
        (places[0][k], places[1][k], heights[k]) = (p.x, p.y, p.z);
    }
    let lit = map.lit(&places, &heights);
    let mut open = lit.map(|lit| (lit * 255.0) as u8);
    open[probes.len()..].fill(0);
    open
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_balanced() {
        let dirs: Vec<Vec3> = (0..48).map(|i| direction(i, 96)).collect();
        let level =
            |axis: fn(&Vec3) -> f32| dirs.iter().map(|d| axis(d).powi(2)).sum::<f32>() / 48.0;
        assert!(
            (level(|d| d.x) - 1.0 / 3.0).abs() < 0.02 && (level(|d| d.z) - 1.0 / 3.0).abs() < 0.02
        );
        assert!(dirs.iter().all(|d| (d.length() - 1.0).abs() < 1e-5));
    }

    #[test]
    fn an_open_point_gathers_the_whole_sky() {
        let probes = [Probe {
            at: Vec3::ZERO,
            normal: Vec3::Y,
        }];
        let dome = Dome::new(&Flat::default(), &probes, 96, 16);
        let [front, back] = dome.light(|_| Vec3::ONE)[0];
        assert!((front - Vec3::ONE).length() < 0.03 && (back - Vec3::ONE).length() < 0.03);
        let [front, back] = dome.light(|d| Vec3::splat(d.y.max(0.0)))[0];
        assert!((front.x - 2.0 / 3.0).abs() < 0.02 && back.x == 0.0);
    }
}
