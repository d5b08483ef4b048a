//! Fitting: a garment that comes as a mesh, put around our body.
//!
//! The mesh is cleaned (welded, turned outside out, split into pieces), given a size and a place by
//! looking where it surrounds the body most closely, rid of what is turned in at its openings, meshed
//! evenly, drawn out of the skin and bound. Where its sleeves point another way than our arms do, it is
//! fitted on a body that holds its arms alike, and comes with them.

mod clean;
mod ends;
mod hems;
mod place;
mod sleeves;

use crate::GarmentError;
use crate::brought::{Fitted, OFF_SKIN, bind, bone_rows, spread};
use crate::garment::Garment;
use crate::growing::Growing;
use crate::pattern::{Laid, flatten, lay_flat, turn};
use crate::relax::{Elastic, FOLDS, Memory, Outside, Round};
use crate::sewing::percentile;
use crate::stand::{BodyMap, Stand};
use clean::Piece;
use glam::{DAffine3, DMat3, DVec2, DVec3};
use muslin_body::{Avatar, Posed, Shape, Sparse};
use muslin_geom::{Mesh, RemeshOptions, Surface, remesh};
use place::Found;

/// What fitting a mesh came to.
#[derive(Clone, Debug)]
pub struct Tailored {
    /// The garments that the mesh holds, innermost first, around the avatar's default body.
    pub garments: Vec<Garment>,
    /// One sentence for each thing that was guessed or mended.
    pub warnings: Vec<String>,
}

/// Panels that a mesh without a pattern is laid out in.
const PANELS: [&str; 4] = ["front", "back", "left sleeve", "right sleeve"];
/// Strain of the median face and the 99th percentile beyond which a mesh is let out to our body: it
/// has no pattern whose size would have to be kept.
const TIGHT: (f64, f64) = (0.02, 0.05);
/// Arms that are turned down for a mesh by more than this [rad] lie beside the trunk.
const HANGING: f64 = 0.3;
/// Rounds of drawing a garment out of the skin.
const ROUNDS: usize = 60;

impl Garment {
    /// Fits a mesh in unknown units, with triangles of about `edge` [m].
    ///
    /// Its rest shape is the shape it has: a mesh that was draped before keeps those folds.
    pub fn tailor(
        avatar: &Avatar,
        mesh: &Mesh,
        (name, edge): (&str, f64),
    ) -> Result<Tailored, GarmentError> {
        let base = avatar.figure(&Shape::default())?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, &base);
        let mut warnings = Vec::new();
        let pieces = clean::pieces(mesh, &mut warnings)?;
        let on_body = || place::find(avatar, (&base, &stand), &pieces);
        let found = match pieces.iter().filter(|p| p.ends()).count() {
            0 => on_body()?,
            n => match ends::find(avatar, (&base, &stand), &pieces) {
                Err(_) if n < pieces.len() => on_body()?,
                found => found?,
            },
        };
        warnings.push(found.told.clone());
        let mut garments = Vec::new();
        for (k, piece) in pieces.iter().enumerate() {
            let name = match pieces.len() {
                1 => name.to_owned(),
                _ => format!("{name}-{}", k + 1),
            };
            let (placed, turned_in) =
                hems::turned_out(piece.moved(&found.world_from_file), &piece.rims);
            if turned_in > 0 {
                warnings.push(format!(
                    "{turned_in} triangles that {name} has turned in at its openings are left out"
                ));
            }
            let made = even(placed, edge, &mut warnings);
            let who = (&stand, &found);
            let (garment, grown) = made.fitted(avatar, who, (name, piece.ends()))?;
            warnings.extend(grown);
            garments.push(garment);
        }
        garments.sort_by(|a, b| room(a, &stand).total_cmp(&room(b, &stand)));
        Ok(Tailored { garments, warnings })
    }
}

/// How far off the skin a garment lies in the middle of the body [m], or anywhere if it is nowhere there: what is worn
/// over what.
fn room(garment: &Garment, stand: &Stand) -> f64 {
    let worn = || garment.brought_verts().iter().zip(garment.binding.rows());
    let off = |(x, row): (&DVec3, &[(u32, f64)])| {
        let skin: DVec3 = row.iter().map(|&(i, w)| stand.verts[i as usize] * w).sum();
        x.distance(skin)
    };
    let is_middle = |(x, _): &(&DVec3, &[(u32, f64)])| {
        let middle = (x.y - stand.crotch.y) / stand.trunk();
        (0.05..0.6).contains(&middle)
    };
    let mut all: Vec<f64> = worn().filter(is_middle).map(off).collect();
    if all.is_empty() {
        all = worn().map(off).collect();
    }
    all.iter().sum::<f64>() / all.len().max(1) as f64
}

/// Meshes whose edges are so many times the asked length are kept as they are.
const KEPT: (f64, f64) = (0.5, 2.0);

/// Meshes a piece evenly, unless its triangles are near the asked size.
fn even(piece: Mesh, edge: f64, warnings: &mut Vec<String>) -> Even {
    let mean = mean_edge(&piece.verts, &piece.faces);
    if (KEPT.0..KEPT.1).contains(&(mean / edge)) {
        return Even(piece);
    }
    warnings.push(format!(
        "meshed anew with edges of {:.0} mm, {:.0} mm before: vertices are not those of the file",
        edge * 1e3,
        mean * 1e3
    ));
    Even(remesh(&piece, RemeshOptions { edge, rounds: 8 }).mesh)
}

/// Mean length of the triangles' sides.
pub(crate) fn mean_edge(verts: &[DVec3], faces: &[[u32; 3]]) -> f64 {
    let length = |f: &[u32; 3], k: usize| {
        let (a, b) = (f[k] as usize, f[(k + 1) % 3] as usize);
        verts[a].distance(verts[b])
    };
    let sum: f64 = faces
        .iter()
        .map(|f| (0..3).map(|k| length(f, k)).sum::<f64>())
        .sum();
    sum / (3 * faces.len()).max(1) as f64
}

/// An even mesh around the posed body.
struct Even(Mesh);

impl Even {
    fn fitted(
        self,
        avatar: &Avatar,
        (stand, found): (&Stand, &Found),
        (name, ends): (String, bool),
    ) -> Result<(Garment, Option<String>), GarmentError> {
        let Mesh {
            verts: mut x,
            faces,
        } = self.0;
        let posed = &found.posed;
        let skin = Surface::new(&posed.verts, avatar.collision_faces());
        let faces = outward(faces, &x, &skin);
        // Sleeves that hang lie against the trunk: which skin is theirs is not told by what is nearest.
        let hang = match found.turned > HANGING {
            true => sleeves::parts(&faces, &x, stand.crotch.y),
            false => None,
        };
        let own = x.clone();
        if let Some(parts) = &hang {
            let arms = [0, 1].map(|s| &stand.limbs[s]);
            let arms = arms.map(|l| [l.shoulder, l.elbow, l.wrist]);
            sleeves::onto_arms(&mut x, parts, &arms);
        }
        let binding = bind(if hang.is_some() { &stand.skin } else { &skin }, &x);
        let arm = |row: &[(u32, f64)], s: usize| -> f64 {
            row.iter()
                .map(|&(i, w)| stand.map.arm[s][i as usize] * w)
                .sum()
        };
        let arms: Vec<[f64; 2]> = binding.rows().map(|r| [arm(r, 0), arm(r, 1)]).collect();
        let laid = lay(&faces, &x, &arms);
        let uv = flatten(&x, &faces, &laid);
        let rest = own_shapes(&faces, &own, &uv);
        let cloth = Elastic::new(faces, rest, x.len());
        if hang.is_none() {
            let growing = Growing::new(avatar, stand).posed(avatar, posed)?;
            draw(&cloth, &mut x, (growing, ends));
            let weights = spread(&cloth, bone_rows(avatar, &bind(&skin, &x)));
            bring_back(&mut x, &weights, posed);
        }
        draw(&cloth, &mut x, (Growing::new(avatar, stand), ends));
        let [half, worst] = [0.5, 0.99].map(|share| percentile(cloth.strains(&x), share));
        let strain = half.max(worst);
        let grown = (half > TIGHT.0 || worst > TIGHT.1).then(|| {
            format!(
                "{name} was made for a slimmer body: let out by {:.0} %",
                strain * 100.0
            )
        });
        let cloth = match grown {
            None => cloth,
            Some(_) => Elastic::new(
                cloth.faces.clone(),
                own_shapes(&cloth.faces, &x, &uv),
                x.len(),
            ),
        };
        let fitted = Fitted {
            name,
            panel: laid.iter().map(|l| l.panel as u8).collect(),
            panels: PANELS.map(String::from).to_vec(),
            cloth,
            verts: x,
        };
        Ok((Garment::bring(avatar, fitted)?, grown))
    }
}

/// Brings cloth that follows bones by `weights` from a pose back to the body at rest.
fn bring_back(x: &mut [DVec3], weights: &Sparse, posed: &Posed) {
    for (x, row) in x.iter_mut().zip(weights.rows()) {
        let sum = row
            .iter()
            .fold((DMat3::ZERO, DVec3::ZERO), |(m, t), &(b, w)| {
                let bone = &posed.bones[b as usize];
                (m + bone.matrix3 * w, t + bone.translation * w)
            });
        let moved = DAffine3 {
            matrix3: sum.0,
            translation: sum.1,
        };
        *x = moved.inverse().transform_point3(*x);
    }
}

/// Draws cloth out of the skin, keeping its shape, while hands and feet grow: a mesh was made for others than ours. What
/// `ends` at a hand or a foot has fingers or toes that would be smoothed away.
fn draw(cloth: &Elastic, x: &mut [DVec3], (mut body, ends): (Growing, bool)) {
    let mut memory = Memory::default();
    for round in 0..ROUNDS {
        if round % 4 == 0 {
            body.grow((1.3 * round as f64 / ROUNDS as f64).min(1.0));
        }
        let outside = [Outside {
            surface: &body.skin,
            gap: OFF_SKIN + 0.001,
            rim: None,
        }];
        let how = Round {
            stitch: 0.0,
            smooth: match ends || round >= ROUNDS / 2 {
                true => 0.05,
                false => 0.3,
            },
            most: 0.008,
            slack: if round < ROUNDS / 3 { 0.0 } else { FOLDS },
        };
        if round % 4 == 3 {
            cloth.find_crossings(x, &mut memory);
        }
        cloth.round(x, (&outside, &mut memory), &how);
    }
}

/// Faces turned over where most look at the body rather than away from it.
fn outward(mut faces: Vec<[u32; 3]>, x: &[DVec3], skin: &Surface) -> Vec<[u32; 3]> {
    let looks = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|i| x[i as usize]);
        let hit = skin.closest((a + b + c) / 3.0, 0.3)?;
        Some((b - a).cross(c - a).dot(hit.normal))
    };
    if faces.iter().filter_map(looks).sum::<f64>() < 0.0 {
        faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    faces
}

/// A first guess of the flat pattern: sleeves along x, front and back by their shadows.
fn lay(faces: &[[u32; 3]], x: &[DVec3], arms: &[[f64; 2]]) -> Vec<Laid> {
    let one = |f: &[u32; 3]| {
        let corners = f.map(|i| x[i as usize]);
        let arm = |s: usize| f.iter().map(|&i| arms[i as usize][s]).sum::<f64>() / 3.0;
        let [a, b, c] = corners;
        let panel = match () {
            () if arm(0) > 0.5 => 2,
            () if arm(1) > 0.5 => 3,
            () if (b - a).cross(c - a).z >= 0.0 => 0,
            () => 1,
        };
        Laid {
            panel,
            corners: corners.map(DVec3::truncate),
        }
    };
    faces.iter().map(one).collect()
}

/// Each face's own shape, turned as its pattern is.
fn own_shapes(faces: &[[u32; 3]], x: &[DVec3], uv: &[[DVec2; 3]]) -> Vec<[DVec2; 3]> {
    let one = |(f, uv): (&[u32; 3], &[DVec2; 3])| {
        let flat = lay_flat(f.map(|i| x[i as usize]));
        let r = turn(&flat, uv);
        flat.map(|p| r.rotate(p))
    };
    faces.iter().zip(uv).map(one).collect()
}

impl Piece {
    fn moved(&self, world_from_file: &DAffine3) -> Mesh {
        let moved = |v: &DVec3| world_from_file.transform_point3(*v);
        Mesh {
            verts: self.mesh.verts.iter().map(moved).collect(),
            faces: self.mesh.faces.clone(),
        }
    }
}
