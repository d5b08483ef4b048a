//! Cut pieces and still bodies for the physical tests; no file, no asset.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use glam::{DVec2, DVec3};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_sim::{Cloth, Material, Options, State, Walk, drape, simulate};

use crate::drape::NEARLY_THERE;

/// How a strip is cut into triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Squares with diagonals that alternate.
    Squares,
    /// Rows of equilateral triangles.
    Equilateral,
}

/// A flat piece: material coordinates [m], faces, vertices per row.
pub struct Piece {
    pub points: Vec<DVec2>,
    pub faces: Vec<[u32; 3]>,
    /// The row that each vertex belongs to, 0 at the first edge.
    pub row: Vec<usize>,
}

/// A surface that stands still: vertices [m] and outward triangles.
pub struct Still {
    pub verts: Vec<DVec3>,
    pub faces: Vec<[u32; 3]>,
}

/// A test cloth: `density` [kg/m²], `stretch` [N/m] along both yarns, `bend` [N m].
///
/// It has no strain limit, so that its laws are the linear ones that the tests have answers for.
pub fn plain([density, stretch, bend]: [f64; 3]) -> Material {
    Material {
        density,
        stretch: Stretch {
            warp: stretch,
            weft: stretch,
            shear: 0.4 * stretch,
            compression: 1.0,
        },
        bend: Bend {
            warp: bend,
            weft: bend,
        },
        limit: None,
        friction: 0.3,
        thickness: 0.5e-3,
    }
}

/// A rectangle `size` [m] (across, along the rows) with edges of about `edge` [m].
pub fn strip(size: DVec2, edge: f64, cut: Cut) -> Piece {
    let even = cut == Cut::Equilateral;
    let tall = if even { 0.75_f64.sqrt() } else { 1.0 };
    let cols = (size.x / edge).round().max(1.0) as usize;
    let rows = (size.y / (edge * tall)).round().max(1.0) as usize;
    let step = size / DVec2::new(cols as f64, rows as f64);
    let (mut points, mut row, mut firsts) = (Vec::new(), Vec::new(), Vec::new());
    for r in 0..=rows {
        firsts.push(points.len());
        // Every second row of an even piece stands half an edge over, with both rims kept.
        let over = even && r % 2 == 1;
        let across: Vec<f64> = if over {
            let inner = (0..cols).map(|c| c as f64 + 0.5);
            [0.0]
                .into_iter()
                .chain(inner)
                .chain([cols as f64])
                .collect()
        } else {
            (0..=cols).map(|c| c as f64).collect()
        };
        row.extend(across.iter().map(|_| r));
        points.extend(across.iter().map(|x| step * DVec2::new(*x, r as f64)));
    }
    firsts.push(points.len());
    let mut faces = Vec::new();
    for r in 0..rows {
        let (low, high) = (firsts[r]..firsts[r + 1], firsts[r + 1]..firsts[r + 2]);
        faces.extend(if even {
            zip_up(&points, low, high)
        } else {
            squares(low.start, high.start, (cols, r))
        });
    }
    Piece { points, faces, row }
}

fn squares(low: usize, high: usize, (cols, r): (usize, usize)) -> Vec<[u32; 3]> {
    let mut faces = Vec::new();
    for c in 0..cols {
        let [a, b, d, e] = [low + c, low + c + 1, high + c, high + c + 1].map(|i| i as u32);
        faces.extend(if (c + r) % 2 == 0 {
            [[a, b, e], [a, e, d]]
        } else {
            [[a, b, d], [b, e, d]]
        });
    }
    faces
}

/// Triangles between two rows of points, the shorter diagonal first.
fn zip_up(
    points: &[DVec2],
    low: std::ops::Range<usize>,
    high: std::ops::Range<usize>,
) -> Vec<[u32; 3]> {
    let (mut i, mut j, mut faces) = (low.start, high.start, Vec::new());
    while i + 1 < low.end || j + 1 < high.end {
        let lower = i + 1 < low.end
            && (j + 1 == high.end
                || points[i + 1].distance(points[j]) < points[i].distance(points[j + 1]) - 1e-12);
        if lower {
            faces.push([i, i + 1, j].map(|k| k as u32));
            i += 1;
        } else {
            faces.push([i, j + 1, j].map(|k| k as u32));
            j += 1;
        }
    }
    faces
}

/// Radii [m] of rings about `edge` apart, out to `radius`, such that a circle of radius `held` runs
/// half way between two of them.
pub fn rings(held: f64, radius: f64, edge: f64) -> Vec<f64> {
    let half = |length: f64| (length / edge - 0.5).round().max(0.0) + 0.5;
    let (inside, outside) = (half(held), half(radius - held));
    let inner = (1..=inside as usize).map(|k| held * k as f64 / inside);
    let outer = (0..=outside as usize).map(|k| (k as f64 + 0.5) / outside);
    inner
        .chain(outer.map(|t| held + (radius - held) * t))
        .collect()
}

/// A disc in rings of these radii [m], of six times as many points as their number; rows are rings.
pub fn disc(radii: &[f64]) -> Piece {
    let rings = radii.len();
    let first = |k: usize| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) };
    let (mut points, mut row, mut faces) = (vec![DVec2::ZERO], vec![0], Vec::new());
    for k in 1..=rings {
        for i in 0..6 * k {
            let angle = TAU * i as f64 / (6 * k) as f64;
            points.push(DVec2::from_angle(angle) * radii[k - 1]);
            row.push(k);
        }
        let outer = |i: usize| (first(k) + i % (6 * k)) as u32;
        let inner = |i: usize| (first(k - 1) + if k == 1 { 0 } else { i % (6 * (k - 1)) }) as u32;
        for side in 0..6 {
            for i in 0..k {
                let (o, n) = (side * k + i, side * (k - 1) + i);
                faces.push([outer(o), outer(o + 1), inner(n)]);
                if i + 1 < k {
                    faces.push([inner(n), outer(o + 1), inner(n + 1)]);
                }
            }
        }
    }
    Piece { points, faces, row }
}

impl Piece {
    /// The piece cut from a material, with its vertices in `pinned` held.
    pub fn cloth(&self, of: Material, pinned: impl Fn(usize) -> bool) -> Cloth {
        let n = self.points.len();
        let rest = |f: &[u32; 3]| f.map(|i| self.points[i as usize]);
        Cloth {
            faces: self.faces.clone(),
            rest: self.faces.iter().map(rest).collect(),
            materials: vec![of],
            material_of: vec![0; self.faces.len()],
            layers: vec![0; n],
            pins: (0..n).filter(|&i| pinned(i)).map(|i| i as u32).collect(),
        }
    }

    /// Mean place of a row of a strip [m], every vertex weighed by the width that it stands for.
    pub fn middle(&self, row: usize, x: &[DVec3]) -> DVec3 {
        let of = |i: &usize| self.row[*i] == row;
        let all: Vec<usize> = (0..x.len()).filter(of).collect();
        let (mut sum, mut width) = (DVec3::ZERO, 0.0);
        for pair in all.windows(2) {
            let share = self.points[pair[1]].x - self.points[pair[0]].x;
            sum += 0.5 * share * (x[pair[0]] + x[pair[1]]);
            width += share;
        }
        sum / width
    }

    /// Number of the last row.
    pub fn last(&self) -> usize {
        self.row.last().copied().unwrap_or(0)
    }
}

/// A box from `low` to `high` [m].
pub fn block(low: DVec3, high: DVec3) -> Still {
    let corner = |i: usize| {
        let pick = |bit: usize, axis: usize| {
            if i >> bit & 1 == 1 {
                high[axis]
            } else {
                low[axis]
            }
        };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
    };
    let faces = vec![
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    Still {
        verts: (0..8).map(corner).collect(),
        faces,
    }
}

/// A small box where no cloth comes.
pub fn far_away() -> Still {
    let at = DVec3::new(0.0, -300.0, 0.0);
    block(at, at + DVec3::splat(0.1))
}

/// An upright drum from the floor up to `top` [m], `radius` [m].
pub fn drum(radius: f64, top: f64) -> Still {
    const N: u32 = 72;
    let ring = |y: f64| {
        (0..N).map(move |i| {
            let p = DVec2::from_angle(-TAU * f64::from(i) / f64::from(N)) * radius;
            DVec3::new(p.x, y, p.y)
        })
    };
    let (low, high) = (DVec3::Y * (top - 0.1), DVec3::Y * top);
    let verts = ring(low.y).chain(ring(high.y)).chain([low, high]).collect();
    let mut faces = Vec::new();
    for i in 0..N {
        let j = (i + 1) % N;
        faces.extend([[i, j, N + j], [i, N + j, N + i]]);
        faces.extend([[2 * N, j, i], [2 * N + 1, N + i, N + j]]);
    }
    Still { verts, faces }
}

/// Stiffness of the clamp that holds a sample, per vertex [N/m].
const CLAMP: f64 = 1e4;

/// The cloth at rest under its weight, from `start`; no vertex then moves faster than `still` [m/s].
pub fn at_rest(cloth: &Cloth, start: &[DVec3], on: &Still, still: f64) -> Vec<DVec3> {
    let usual = Options::default().iterations;
    at_rest_by(usual, cloth, (start, on, still))
}

/// The same with so many iterations at most on each step's system.
pub fn at_rest_by(
    iterations: usize,
    cloth: &Cloth,
    (start, on, still): (&[DVec3], &Still, f64),
) -> Vec<DVec3> {
    let options = Options {
        iterations,
        first_steps: 0,
        last_steps: 4000,
        still,
        pin: CLAMP,
        handles: true,
        ..Options::default()
    };
    draped(cloth, start, on, &options)
}

/// The cloth after so many steps of the kind that refines what was predicted.
pub fn led(cloth: &Cloth, start: &[DVec3], on: &Still, steps: usize) -> Vec<DVec3> {
    let options = Options {
        last_steps: steps,
        rounds: 1,
        pin: CLAMP,
        ..NEARLY_THERE
    };
    draped(cloth, start, on, &options)
}

/// Where cloth ends; nothing, if the simulator refuses.
fn draped(cloth: &Cloth, start: &[DVec3], on: &Still, options: &Options) -> Vec<DVec3> {
    let path = [on.verts.clone().into()];
    let settled = drape(cloth, start, (&path, &on.faces), options);
    settled.map_or_else(|_| Vec::new(), |s| s.verts)
}

/// Frames of a simulation, 60 a second, from a state, over a body that stands still.
pub fn film(
    cloth: &Cloth,
    from: &State,
    on: &Still,
    (gravity, frames): (DVec3, usize),
) -> Vec<Vec<DVec3>> {
    let walk = Walk {
        faces: &on.faces,
        rest: &on.verts,
        frames: frames + 1,
        lead: 0,
        fps: 60.0,
        at: &|_| on.verts.clone().into(),
    };
    let options = Options {
        gravity,
        pin: CLAMP,
        ..Options::default()
    };
    let mut shots = vec![from.verts.clone()];
    let run = simulate(cloth, (&from.verts, Some(from)), (&walk, &options), |m| {
        shots.push(m.verts.to_vec());
        ControlFlow::Continue(())
    });
    if run.is_err() {
        shots.clear();
    }
    shots
}
