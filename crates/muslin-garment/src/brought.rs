//! Garments that users bring: sewn from a pattern or read as a mesh, not cut by a recipe.
//!
//! They know their own cut and how they lie around the default body. On another body they are
//! carried along with the nearest skin and then drawn to their own shape outside of it: a size
//! stays that size, and may be too tight, unless it is graded to another.

use crate::garment::{Garment, Rim, Worn};
use crate::recipe::{Opening, Side};
use crate::relax::{Elastic, FOLDS, Memory, Outside, Round};
use crate::settle::Net;
use crate::sheet::{Row, blend};
use crate::stand::{BodyMap, Stand};
use crate::{GarmentError, Recipe};
use glam::{DMat2, DVec2, DVec3};
use muslin_body::{Avatar, Figure, Shape, Sparse};
use muslin_geom::Surface;

/// A garment as it lies around the default body, before it is bound to it.
pub(crate) struct Fitted {
    pub name: String,
    /// Panel of each face.
    pub panel: Vec<u8>,
    /// The panels' names.
    pub panels: Vec<String>,
    /// Faces and their rest shape.
    pub cloth: Elastic,
    /// Vertices [m].
    pub verts: Vec<DVec3>,
}

/// What a brought garment is made of beyond what all garments have.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Brought {
    cloth: Elastic,
    /// Vertices on the default body [m].
    verts: Vec<DVec3>,
    /// Vertex → (bone, weight).
    weights: Sparse,
    pub panels: Vec<String>,
}

/// Rounds in which bone weights and moves are spread over the cloth.
const SPREAD: usize = 12;
/// Bones of a vertex, at most.
const BONES: usize = 8;
/// Rounds of drawing cloth to its shape on another body, or over other cloth.
const ROUNDS: usize = 60;
/// How much cloth is smoothed at first on its way there, and in the end.
const SMOOTHLY: f64 = 0.3;
const CLOSELY: f64 = 0.05;
/// Room between two layers of cloth [m].
const BETWEEN: f64 = 0.004;
/// How far off the skin cloth is put [m], for edges of 12 mm.
pub(crate) const OFF_SKIN: f64 = 0.004;
/// A vertex within this distance counts as staying where it is [m].
const SAME: f64 = 1e-6;

impl Garment {
    /// Binds a garment that lies around the avatar's default body.
    pub(crate) fn bring(avatar: &Avatar, fitted: Fitted) -> Result<Garment, GarmentError> {
        let base = avatar.figure(&Shape::default())?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, &base);
        let Fitted {
            name,
            panel,
            panels,
            cloth,
            verts,
        } = fitted;
        let binding = bind(&stand.skin, &verts);
        let net = Net::new(cloth.faces.clone(), verts.len());
        let rims = rims(&stand, &net, &verts);
        let pins = waist(&rims);
        let anchor = |i: usize| blend(binding.row(i), &base.verts);
        let offset = (0..verts.len()).map(|i| verts[i] - anchor(i)).collect();
        let weights = spread(&cloth, bone_rows(avatar, &binding));
        Ok(Garment {
            name,
            recipe: None,
            faces: cloth.faces.clone(),
            uv: cloth.rest.clone(),
            panel,
            binding,
            pins,
            rims,
            snug: vec![1.0; cloth.faces.len()],
            standing: vec![],
            offset,
            net,
            brought: Some(Box::new(Brought {
                cloth,
                verts,
                weights,
                panels,
            })),
        })
    }
}

impl Garment {
    /// The same brought garment, lying around the default body as at `verts` [m]: what a solver
    /// made of it. A garment that was cut by a recipe stays as it is.
    pub fn resting(self, avatar: &Avatar, verts: Vec<DVec3>) -> Result<Garment, GarmentError> {
        let Some(brought) = self.brought else {
            return Ok(self);
        };
        let fitted = Fitted {
            name: self.name,
            panel: self.panel,
            panels: brought.panels,
            cloth: brought.cloth,
            verts,
        };
        Garment::bring(avatar, fitted)
    }
}

impl Garment {
    /// The same brought garment in the size of a figure: cut as much longer and wider in every place as the skin
    /// under it is longer and wider than the default body's, whatever it was graded to before. How it lies around
    /// the default body stays. A garment that was cut by a recipe, which fits whoever wears it, stays as it is.
    ///
    /// A waistband is of the size of the figure `held_by`, and so is less and less of the cloth below it: too wide
    /// for who wears it, it is taken in.
    pub fn graded(
        self,
        avatar: &Avatar,
        (figure, held_by): (&Figure, &Figure),
    ) -> Result<Garment, GarmentError> {
        let Some(brought) = &self.brought else {
            return Ok(self);
        };
        let base = avatar.standard()?;
        let map = BodyMap::new(avatar, &base)?;
        let sized = |figure: &Figure| {
            let scale = Stand::new(&map, figure).scale();
            let moves = brought.moves((&self.binding, &self.offset), (&figure.verts, scale));
            let pairs = brought.verts.iter().zip(&moves);
            let there: Vec<DVec3> = pairs.map(|(x, m)| *x + *m).collect();
            grown((&self.faces, &self.uv), &brought.verts, &there)
        };
        let mut rest = sized(figure);
        if !self.pins.is_empty() && figure.verts != held_by.verts {
            let slack = self.slack(&brought.verts);
            for ((f, rest), band) in self.faces.iter().zip(&mut rest).zip(sized(held_by)) {
                let t = f.iter().map(|v| slack[*v as usize]).sum::<f64>() / 3.0;
                *rest = std::array::from_fn(|k| band[k].lerp(rest[k], t));
            }
        }
        let faces = self.faces.clone();
        let cloth = Elastic::new(faces, rest, brought.verts.len());
        let brought = Brought {
            cloth,
            ..(**brought).clone()
        };
        Ok(Garment {
            brought: Some(Box::new(brought)),
            ..self
        })
    }
}

/// Below a waistband, cloth reaches its own width over this height [m].
const GATHERED: f64 = 0.12;

impl Garment {
    /// For each vertex of the garment as it lies at `verts` [m], how far it is from being held: 0 at a waistband,
    /// 1 from a hand's breadth below it on, and everywhere where nothing is held.
    pub fn slack(&self, verts: &[DVec3]) -> Vec<f64> {
        slack(&self.pins, verts)
    }
}

fn slack(pins: &[u32], verts: &[DVec3]) -> Vec<f64> {
    let Some(band) = (pins.iter().map(|i| verts[*i as usize].y)).reduce(f64::min) else {
        return vec![1.0; verts.len()];
    };
    let share = |v: &DVec3| {
        let t = ((band - v.y) / GATHERED).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    verts.iter().map(share).collect()
}

/// Least and most that cloth is cut longer in any direction.
const GROWN: (f64, f64) = (0.3, 3.0);

/// Shapes of faces [m], as much larger as these are at `there` than they are at `here` [m].
fn grown(
    (faces, shapes): (&[[u32; 3]], &[[DVec2; 3]]),
    here: &[DVec3],
    there: &[DVec3],
) -> Vec<[DVec2; 3]> {
    let one = |(f, u): (&[u32; 3], &[DVec2; 3])| {
        let flat = DMat2::from_cols(u[1] - u[0], u[2] - u[0]).inverse();
        let metric = |x: &[DVec3]| {
            let [a, b, c] = f.map(|i| x[i as usize]);
            let (p, q) = (b - a, c - a);
            let on_edges = DMat2::from_cols_array(&[p.dot(p), p.dot(q), p.dot(q), q.dot(q)]);
            flat.transpose() * on_edges * flat
        };
        // By what the cloth is strained here it may be strained there as well.
        let strained = with_stretches(metric(here), |l| 1.0 / l.sqrt().max(1e-6));
        let growth = strained * metric(there) * strained;
        let growth = with_stretches(growth, |l| l.max(0.0).sqrt().clamp(GROWN.0, GROWN.1));
        match growth.is_finite() {
            true => u.map(|p| growth * p),
            false => *u,
        }
    };
    faces.iter().zip(shapes).map(one).collect()
}

/// The symmetric matrix with other eigenvalues.
fn with_stretches(m: DMat2, of: impl Fn(f64) -> f64) -> DMat2 {
    let (a, b, c) = (m.x_axis.x, m.x_axis.y, m.y_axis.y);
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let (mean, half) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let turn = DMat2::from_angle(angle);
    turn * DMat2::from_diagonal(DVec2::new(of(mean + half), of(mean - half))) * turn.transpose()
}

impl Brought {
    /// The garment on a body, outside of the cloth `under` it.
    pub fn put_on(
        &self,
        (binding, offset): (&Sparse, &[DVec3]),
        stand: &Stand,
        under: &[(Surface, Vec<bool>)],
    ) -> Worn {
        let moves = self.moves((binding, offset), (stand.verts, 1.0));
        let still = moves.iter().all(|m| m.length() < SAME);
        let mut x: Vec<DVec3> = self
            .verts
            .iter()
            .zip(&moves)
            .map(|(x, m)| *x + *m)
            .collect();
        if !still || !under.is_empty() {
            self.draw(&mut x, stand, under);
        }
        Worn {
            verts: x,
            rest: self.cloth.rest.clone(),
        }
    }

    fn draw(&self, x: &mut [DVec3], stand: &Stand, under: &[(Surface, Vec<bool>)]) {
        let mut outside = vec![Outside {
            surface: &stand.skin,
            gap: OFF_SKIN,
            rim: None,
        }];
        outside.extend(under.iter().map(|(surface, rim)| Outside {
            surface,
            gap: BETWEEN,
            rim: Some(rim),
        }));
        let drawn = |smooth: f64| {
            let (mut x, mut memory) = (x.to_vec(), Memory::default());
            for round in 0..ROUNDS {
                let how = Round {
                    stitch: 0.0,
                    smooth: if round < ROUNDS / 2 { smooth } else { CLOSELY },
                    most: 0.01,
                    slack: if round < ROUNDS / 3 { 0.0 } else { FOLDS },
                };
                if round % 5 == 4 {
                    self.cloth.find_crossings(&x, &mut memory);
                }
                self.cloth.round(&mut x, (&outside, &mut memory), &how);
            }
            let crossing = self.cloth.find_crossings(&x, &mut memory);
            (crossing, x)
        };
        let mut best = drawn(SMOOTHLY);
        if best.0 > 0 {
            // Smoothed, the walls of a folded-over collar come through each other.
            let closely = drawn(CLOSELY);
            if closely.0 < best.0 {
                best = closely;
            }
        }
        x.copy_from_slice(&best.1);
    }

    /// How far cloth goes with the skin to where that is `there` [m], so many times as far off it; evened out over
    /// the cloth [m].
    fn moves(
        &self,
        (binding, offset): (&Sparse, &[DVec3]),
        (there, scale): (&[DVec3], f64),
    ) -> Vec<DVec3> {
        let own = |i: usize| blend(binding.row(i), there) + offset[i] * scale - self.verts[i];
        let mut moves: Vec<DVec3> = (0..self.verts.len()).map(own).collect();
        for _ in 0..SPREAD {
            let mean = |(m, row): (&DVec3, &Vec<(u32, f64)>)| {
                let all: DVec3 = row.iter().map(|&(j, _)| moves[j as usize]).sum();
                (*m + all) / (1 + row.len()) as f64
            };
            moves = moves.iter().zip(&self.cloth.rows).map(mean).collect();
        }
        moves
    }

    /// Vertex → (bone of the full rig, weight).
    pub fn weights(&self) -> &Sparse {
        &self.weights
    }
}

/// Each vertex on the three corners of its nearest skin.
pub(crate) fn bind(skin: &Surface, verts: &[DVec3]) -> Sparse {
    let mut out = Sparse::new();
    for v in verts {
        let hit = skin.closest(*v, 1e3).unwrap_or_else(|| skin.at(*v, 0));
        let f = skin.faces()[hit.face as usize];
        let total: f64 = hit.weights.iter().sum();
        out.push((0..3).map(|k| (f[k], hit.weights[k] / total)));
    }
    out
}

/// The bones of what each vertex is bound to.
pub(crate) fn bone_rows(avatar: &Avatar, binding: &Sparse) -> Vec<Row> {
    let bones = &avatar.rig().weights;
    let one = |row: &[(u32, f64)]| {
        let all = row.iter();
        gather(all.flat_map(|&(i, w)| bones.row(i as usize).iter().map(move |&(b, s)| (b, s * w))))
    };
    binding.rows().map(one).collect()
}

/// Bone weights evened out over the cloth, so that no seam between two limbs tears.
pub(crate) fn spread(cloth: &Elastic, mut rows: Vec<Row>) -> Sparse {
    for _ in 0..SPREAD {
        let mean = |(own, near): (&Row, &Vec<(u32, f64)>)| {
            let share = 1.0 / (1 + near.len()) as f64;
            let all = near.iter().flat_map(|&(j, _)| &rows[j as usize]).chain(own);
            most(gather(all.map(|&(b, w)| (b, w * share))))
        };
        rows = rows.iter().zip(&cloth.rows).map(mean).collect();
    }
    let mut out = Sparse::new();
    rows.into_iter().for_each(|r| out.push(r));
    out
}

fn gather(all: impl Iterator<Item = (u32, f64)>) -> Row {
    let mut row: Row = all.collect();
    row.sort_by_key(|e| e.0);
    row.dedup_by(|b, a| {
        let same = a.0 == b.0;
        a.1 += if same { b.1 } else { 0.0 };
        same
    });
    row
}

/// The heaviest few, summing to one.
fn most(mut row: Row) -> Row {
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    row.truncate(BONES);
    row.sort_by_key(|e| e.0);
    let sum: f64 = row.iter().map(|e| e.1).sum();
    row.iter_mut().for_each(|e| e.1 /= sum);
    row
}

/// Whether anything reaches above the armpits: then shoulders carry it, else the waist must.
fn hangs_on_shoulders(stand: &Stand, verts: &[DVec3]) -> bool {
    let top = verts.iter().map(|v| v.y).fold(f64::MIN, f64::max);
    top > stand.armpit
}

fn waist(rims: &[Rim]) -> Vec<u32> {
    let waist = rims.iter().filter(|r| r.opening == Opening::Waist);
    let mut all: Vec<u32> = waist.flat_map(|r| r.verts.clone()).collect();
    all.sort_unstable();
    all
}

/// Names the openings by where they are.
fn rims(stand: &Stand, net: &Net, x: &[DVec3]) -> Vec<Rim> {
    let middle =
        |ring: &Vec<u32>| ring.iter().map(|&i| x[i as usize]).sum::<DVec3>() / ring.len() as f64;
    let middles: Vec<DVec3> = net.loops.iter().map(middle).collect();
    let top = middles.iter().map(|m| m.y).fold(f64::MIN, f64::max);
    let low = middles.iter().map(|m| m.y).fold(f64::MAX, f64::min);
    // What ends at a hand or a foot is held where it begins.
    let carried = middles.len() > 1 && hangs_on_shoulders(stand, x);
    let name = |m: &DVec3| {
        let aside = m.x.abs() > 0.6 * stand.limbs[0].shoulder.x.abs();
        let below = m.y < stand.crotch.y;
        let side = Side::of(*m);
        match () {
            () if m.y == top && carried => Opening::Neck,
            () if m.y == top => Opening::Waist,
            () if carried && aside && m.y > low + 0.02 && !below => Opening::Cuff(side),
            () if below && m.x.abs() > 0.04 => Opening::LegHem(side),
            () => Opening::Hem,
        }
    };
    let rim = |(m, ring): (&DVec3, &Vec<u32>)| Rim {
        opening: name(m),
        verts: ring.clone(),
    };
    middles.iter().zip(&net.loops).map(rim).collect()
}

impl Garment {
    /// The panels' names, in the order of their numbers.
    pub fn panels(&self) -> Vec<&str> {
        match &self.brought {
            Some(b) => b.panels.iter().map(String::as_str).collect(),
            None => self
                .recipe
                .iter()
                .flat_map(Recipe::panels)
                .copied()
                .collect(),
        }
    }
}

impl Garment {
    /// Vertices of a brought garment on the default body [m]; none of one that was cut.
    pub(crate) fn brought_verts(&self) -> &[DVec3] {
        self.brought.as_ref().map_or(&[], |b| &b.verts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_lies_at_a_band_is_held() {
        let verts: Vec<DVec3> = (0..4).map(|k| DVec3::NEG_Y * 0.05 * k as f64).collect();
        let held = slack(&[0], &verts);
        assert_eq!((held[0], held[3]), (0.0, 1.0));
        assert!(held.windows(2).all(|w| w[1] > w[0]));
        assert_eq!(slack(&[], &verts), [1.0; 4]);
    }

    #[test]
    fn cloth_is_cut_longer_where_and_in_the_direction_that_it_grows() {
        // Turned on the cloth and strained by a fiftieth, which is not to be taken for growth.
        let on_cloth = DMat2::from_angle(0.4) / 1.02;
        let flat = [DVec2::ZERO, DVec2::new(0.02, 0.0), DVec2::new(0.006, 0.015)];
        let rest = [flat.map(|p| on_cloth * p)];
        let cloth = (&[[0, 1, 2]][..], &rest[..]);
        let here = flat.map(|p| p.extend(0.3));
        let there = here.map(|p| DVec3::new(p.x, 7.0 - p.z, 1.5 * p.y));
        let out = grown(cloth, &here, &there)[0];
        let back = on_cloth.inverse();
        for (was, is) in flat.iter().zip(out) {
            let is = back * (is - out[0]);
            assert!(
                (is - DVec2::new(was.x, 1.5 * was.y)).length() < 1e-12,
                "{was} {is}"
            );
        }
        let same = grown(cloth, &here, &here)[0];
        assert!(
            same.iter()
                .zip(rest[0])
                .all(|(a, b)| (*a - b).length() < 1e-12)
        );
    }
}
