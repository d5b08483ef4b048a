//! Sewing: panels cut into triangles, stood around the body, drawn together and merged.

mod arrange;

use crate::brought::Fitted;
use crate::growing::Growing;
use crate::panels::{Panel, SewingPattern};
use crate::relax::{Elastic, FOLDS, Memory, Outside, Round};
use crate::stand::{BodyMap, Stand};
use crate::{Garment, GarmentError};
use glam::{DAffine3, DVec2, DVec3};
use muslin_body::{Avatar, Shape};
use muslin_geom::{FillError, Surface, fill};

/// What sewing came to.
#[derive(Clone, Debug)]
pub struct Sewn {
    /// The garment, around the avatar's default body.
    pub garment: Garment,
    /// Largest gap of a seam before its sides were merged [m].
    pub gap: f64,
    /// 99th percentile of the strain that is left (0.1 is 10 % longer than cut).
    pub strain: f64,
    /// One sentence for each thing that was guessed.
    pub warnings: Vec<String>,
}

/// Panels as triangles, side by side in one numbering.
struct Pieces {
    /// Points of the panels, each in its own plane [m].
    flat: Vec<DVec2>,
    faces: Vec<[u32; 3]>,
    /// Panel of each face.
    panel: Vec<u8>,
    /// First point of each panel, and the number of all points.
    first: Vec<usize>,
    /// Points that are sewn together.
    stitches: Vec<[u32; 2]>,
}

impl Garment {
    /// Sews a pattern around the avatar's default body, with triangles of about `edge` [m].
    ///
    /// Panels keep the size they were drawn in. Where the pattern's own body is larger or smaller
    /// than ours only the panels' first places are moved, not the cut.
    pub fn sew(
        avatar: &Avatar,
        pattern: &SewingPattern,
        (name, edge): (&str, f64),
    ) -> Result<Sewn, GarmentError> {
        let base = avatar.figure(&Shape::default())?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, &base);
        let mut body = Growing::new(avatar, &stand);
        let grains = arrange::grains(pattern, &stand);
        let rough = cut(pattern, (ROUGH * edge).clamp(0.025, 0.03))?;
        let x = placed(&rough, &arrange::arrange(pattern, &stand));
        let x = draw_together((&rough, &rest(pattern, &rough, &grains)), x, &body);
        let pieces = cut(pattern, edge)?;
        let x = refined(&rough, &x, &pieces);
        let rest = rest(pattern, &pieces, &grains);
        let (x, gap) = close((&pieces, &rest), x, (&mut body, edge));
        let merged = merge(pattern, &pieces, x)?;
        let rest = merged.keep(rest);
        let cloth = Elastic::new(merged.faces.clone(), rest, merged.verts.len());
        let x = settle(&cloth, merged.verts.clone(), (&stand, edge));
        let strain = percentile(cloth.strains(&x), 0.99);
        let fitted = Fitted {
            name: name.into(),
            panel: merged
                .kept
                .iter()
                .map(|&f| pieces.panel[f as usize])
                .collect(),
            panels: pattern.panels.iter().map(|p| p.name.clone()).collect(),
            cloth,
            verts: x,
        };
        Ok(Sewn {
            garment: Garment::bring(avatar, fitted)?,
            gap,
            strain,
            warnings: Vec::new(),
        })
    }
}

/// How far vertices stay off the skin [m] so that edges of `edge` [m] do, too.
fn off(edge: f64) -> f64 {
    0.0035 + 4.0 * edge * edge
}

/// Fills every panel; both sides of a seam get equally many points.
fn cut(pattern: &SewingPattern, edge: f64) -> Result<Pieces, GarmentError> {
    let mut pieces = Pieces {
        flat: Vec::new(),
        faces: Vec::new(),
        panel: Vec::new(),
        first: vec![0],
        stitches: Vec::new(),
    };
    let count = |p: u32, k: u32| {
        let length = |(p, k): (u32, u32)| pattern.panels[p as usize].length(k as usize);
        // Two curves that are a chord each would hold no cloth between them.
        let least = |(p, _): (u32, u32)| match pattern.panels[p as usize].curves.len() {
            0..=2 => 2.0,
            _ => 1.0,
        };
        let own = (length((p, k)), least((p, k)));
        let (length, least) = pattern.across(p, k).map_or(own, |(o, _)| {
            (0.5 * (own.0 + length(o)), f64::max(own.1, least(o)))
        });
        (length / edge).round().max(least) as usize
    };
    let mut starts: Vec<Vec<usize>> = Vec::new();
    for (p, panel) in pattern.panels.iter().enumerate() {
        let (mut outline, mut start) = (Vec::new(), Vec::new());
        for k in 0..panel.curves.len() {
            start.push(outline.len());
            outline.extend(panel.spaced(k, count(p as u32, k as u32)));
        }
        let filled = fill(&outline, edge).map_err(|e| unfillable(panel, &start, e))?;
        let first = pieces.flat.len() as u32;
        pieces.panel.extend(filled.faces.iter().map(|_| p as u8));
        let faces = filled.faces.iter().map(|f| f.map(|i| i + first));
        pieces.faces.extend(faces);
        pieces.flat.extend(filled.verts);
        pieces.first.push(pieces.flat.len());
        start.push(outline.len());
        starts.push(start);
    }
    for seam in &pattern.seams {
        let along = |(p, k): (u32, u32)| -> Vec<u32> {
            let (start, first) = (&starts[p as usize], pieces.first[p as usize]);
            let whole = *start.last().expect("the end was pushed");
            let k = k as usize;
            let at = |i: usize| (first + i % whole) as u32;
            (start[k]..=start[k + 1]).map(at).collect()
        };
        let [a, mut b] = seam.sides.map(along);
        if !seam.flipped {
            b.reverse();
        }
        let pairs = a.into_iter().zip(b).filter(|(a, b)| a != b);
        pieces.stitches.extend(pairs.map(|(a, b)| [a, b]));
    }
    Ok(pieces)
}

fn unfillable(panel: &Panel, start: &[usize], e: FillError) -> GarmentError {
    let edge = |i: usize| start.partition_point(|s| *s <= i) - 1;
    GarmentError::Outline {
        panel: panel.name.clone(),
        what: match e {
            FillError::Crossing(i, j) => format!("edges {} and {} cross", edge(i), edge(j)),
            FillError::Flat => "it encloses no area".into(),
        },
    }
}

/// Every face's corners on the cloth [m]: weft across, warp along the panel's grain. Panels that
/// are drawn as seen from inside are mirrored.
fn rest(pattern: &SewingPattern, pieces: &Pieces, grains: &[DVec2]) -> Vec<[DVec2; 3]> {
    let mirrored: Vec<bool> = (pattern.panels.iter())
        .map(|p| {
            let n = p.corners.len();
            let twice = |k: usize| p.corners[k].perp_dot(p.corners[(k + 1) % n]);
            (0..n).map(twice).sum::<f64>() < 0.0
        })
        .collect();
    let one = |(f, &p): (&[u32; 3], &u8)| {
        let warp = grains[p as usize];
        let weft = -warp.perp() * if mirrored[p as usize] { -1.0 } else { 1.0 };
        f.map(|i| {
            let q = pieces.flat[i as usize];
            DVec2::new(q.dot(weft), q.dot(warp))
        })
    };
    pieces.faces.iter().zip(&pieces.panel).map(one).collect()
}

/// Panels where they are to stand [m].
fn placed(pieces: &Pieces, places: &[DAffine3]) -> Vec<DVec3> {
    let mut x = Vec::with_capacity(pieces.flat.len());
    for (p, place) in places.iter().enumerate() {
        let own = &pieces.flat[pieces.first[p]..pieces.first[p + 1]];
        x.extend(own.iter().map(|q| place.transform_point3(q.extend(0.0))));
    }
    x
}

/// How much coarser the triangles are in which panels are brought together.
const ROUGH: f64 = 2.5;
/// Rounds in which seams are drawn shut.
const DRAW: usize = 160;
/// By how much the body is thinner at first [m].
const THIN: f64 = 0.012;
/// Off the skin for coarse triangles [m].
const ROUGH_OFF: f64 = 0.008;

/// Draws seams shut, ever more strongly, on a body that starts out thinner.
fn draw_together(
    (pieces, rest): (&Pieces, &[[DVec2; 3]]),
    mut x: Vec<DVec3>,
    body: &Growing,
) -> Vec<DVec3> {
    let cloth = Elastic::new(pieces.faces.clone(), rest.to_vec(), x.len());
    let cloth = cloth.stitched(&pieces.stitches);
    let mut memory = Memory::default();
    for round in 0..DRAW {
        let t = round as f64 / DRAW as f64;
        let grown = (2.0 * t - 0.6).clamp(0.0, 1.0);
        let outside = [Outside {
            surface: &body.skin,
            gap: ROUGH_OFF - THIN * (1.0 - grown),
            rim: None,
        }];
        let how = Round {
            stitch: 0.02 * (500f64).powf(t),
            smooth: 0.3,
            most: 0.012,
            slack: 0.0,
        };
        cloth.round(&mut x, (&outside, &mut memory), &how);
    }
    x
}

/// Where the points of finer triangles of the same panels are [m].
fn refined(rough: &Pieces, x: &[DVec3], fine: &Pieces) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(fine.flat.len());
    for p in 0..rough.first.len() - 1 {
        let (from, to) = (rough.first[p], rough.first[p + 1]);
        let flat: Vec<DVec3> = rough.flat[from..to].iter().map(|q| q.extend(0.0)).collect();
        let own = rough.faces.iter().zip(&rough.panel);
        let own = own.filter(|(_, panel)| **panel as usize == p);
        let faces: Vec<[u32; 3]> = own.map(|(f, _)| f.map(|i| i - from as u32)).collect();
        let surface = Surface::new(&flat, &faces);
        for q in &fine.flat[fine.first[p]..fine.first[p + 1]] {
            let q = q.extend(0.0);
            let hit = surface.closest(q, 1e3).unwrap_or_else(|| surface.at(q, 0));
            let f = faces[hit.face as usize].map(|i| x[from + i as usize]);
            let w = hit.weights;
            out.push(f[0] * w[0] + f[1] * w[1] + f[2] * w[2]);
        }
    }
    out
}

/// Rounds in which the seams of the fine panels close and hands and feet grow.
const CLOSE: usize = 60;

/// Closes the seams, and says how far the widest is open then [m].
fn close(
    (pieces, rest): (&Pieces, &[[DVec2; 3]]),
    mut x: Vec<DVec3>,
    (body, edge): (&mut Growing, f64),
) -> (Vec<DVec3>, f64) {
    let cloth = Elastic::new(pieces.faces.clone(), rest.to_vec(), x.len());
    let cloth = cloth.stitched(&pieces.stitches);
    let mut memory = Memory::default();
    for round in 0..CLOSE {
        if round % 4 == 0 {
            body.grow((1.3 * round as f64 / CLOSE as f64).min(1.0));
        }
        let outside = [Outside {
            surface: &body.skin,
            gap: off(edge),
            rim: None,
        }];
        let how = Round {
            stitch: 10.0,
            smooth: 0.3,
            most: 0.012,
            slack: 0.0,
        };
        cloth.round(&mut x, (&outside, &mut memory), &how);
    }
    let gap = cloth.gap(&x);
    (x, gap)
}

/// Rounds after the seams are merged.
const SETTLE: usize = 40;

/// More rounds while cloth passes through cloth.
const MEND: usize = 60;

fn settle(cloth: &Elastic, mut x: Vec<DVec3>, (stand, edge): (&Stand, f64)) -> Vec<DVec3> {
    let outside = [Outside {
        surface: &stand.skin,
        gap: off(edge),
        rim: None,
    }];
    let mut memory = Memory::default();
    for round in 0..SETTLE + MEND {
        let how = Round {
            stitch: 0.0,
            smooth: if round < SETTLE / 2 { 0.3 } else { 0.05 },
            most: 0.01,
            slack: if round < SETTLE / 4 { 0.0 } else { FOLDS },
        };
        let clean = round % 3 == 2 && cloth.find_crossings(&x, &mut memory) == 0;
        if clean && round >= SETTLE {
            break;
        }
        cloth.round(&mut x, (&outside, &mut memory), &how);
    }
    x
}

/// Panels merged into one mesh.
struct Merged {
    faces: Vec<[u32; 3]>,
    verts: Vec<DVec3>,
    /// Which faces are left.
    kept: Vec<u32>,
}

impl Merged {
    fn keep<T: Copy>(&self, all: Vec<T>) -> Vec<T> {
        self.kept.iter().map(|&f| all[f as usize]).collect()
    }
}

/// Makes one vertex of all that are sewn together, in their middle.
fn merge(pattern: &SewingPattern, pieces: &Pieces, x: Vec<DVec3>) -> Result<Merged, GarmentError> {
    let mut label: Vec<u32> = (0..x.len() as u32).collect();
    for &[a, b] in &pieces.stitches {
        let (a, b) = (root(&mut label, a), root(&mut label, b));
        label[a.max(b) as usize] = a.min(b);
    }
    let mut new = vec![u32::MAX; x.len()];
    let mut verts: Vec<(DVec3, f64)> = Vec::new();
    for i in 0..x.len() {
        let r = root(&mut label, i as u32) as usize;
        if new[r] == u32::MAX {
            new[r] = verts.len() as u32;
            verts.push((DVec3::ZERO, 0.0));
        }
        new[i] = new[r];
        let sum = &mut verts[new[r] as usize];
        *sum = (sum.0 + x[i], sum.1 + 1.0);
    }
    let mut merged = Merged {
        faces: Vec::with_capacity(pieces.faces.len()),
        verts: verts.into_iter().map(|(sum, n)| sum / n).collect(),
        kept: Vec::with_capacity(pieces.faces.len()),
    };
    for (k, f) in pieces.faces.iter().enumerate() {
        let f = f.map(|i| new[i as usize]);
        // A corner whose two sides are sewn to each other vanishes into the seam.
        if f[0] != f[1] && f[1] != f[2] && f[2] != f[0] {
            merged.faces.push(f);
            merged.kept.push(k as u32);
        }
    }
    check(pattern, pieces, &merged)?;
    Ok(merged)
}

/// Whether every side is shared by two faces at most, which run against each other.
fn check(pattern: &SewingPattern, pieces: &Pieces, merged: &Merged) -> Result<(), GarmentError> {
    let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * merged.faces.len());
    for (f, kept) in merged.faces.iter().zip(&merged.kept) {
        sides.extend((0..3).map(|k| ([f[k], f[(k + 1) % 3]], *kept)));
    }
    sides.sort_unstable();
    match sides.windows(2).find(|w| w[0].0 == w[1].0) {
        None => Ok(()),
        Some(w) => {
            let name = |f: u32| {
                pattern.panels[pieces.panel[f as usize] as usize]
                    .name
                    .clone()
            };
            Err(GarmentError::Seam {
                panels: [name(w[0].1), name(w[1].1)],
            })
        }
    }
}

fn root(label: &mut [u32], mut i: u32) -> u32 {
    while label[i as usize] != i {
        label[i as usize] = label[label[i as usize] as usize];
        i = label[i as usize];
    }
    i
}

/// The value that a share of all stay below; zero of none.
pub(crate) fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = (values.len().saturating_sub(1) as f64 * share).round() as usize;
    values.get(at).copied().unwrap_or(0.0)
}
