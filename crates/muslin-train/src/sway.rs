//! How cloth swings: its slowest shapes of vibration about where it hangs.
//!
//! `K Φ = M Φ Ω²` for the smallest `ω`, with the Hessian `K` of the solver's own laws at rest and the
//! masses `M`: blocks of vectors are led downhill by `(K + σ M)⁻¹` (Knyazev 2001, without his third
//! block). Nothing is learnt, so that another fabric or body costs a second.

use glam::DVec3;
use muslin_energy::check::eigen;
use muslin_geom::Surface;
use muslin_model::{FOLLOWED, Sway, Wall};
use muslin_net::learn::Noise;
use muslin_sim::Hanging;
use rayon::prelude::*;

use crate::factor::{Factor, Matrix, Pattern};

/// Swings that a model is given.
const SWINGS: usize = 16;
/// Vectors that are led along beside them, so that the last converge as well.
const BESIDE: usize = 6;
/// Rounds of leading downhill.
const ROUNDS: usize = 6;
/// Points stand for the cloth within this distance [m], and there are so many at most.
const SPACING: f64 = 0.045;
const SAMPLES: usize = 480;
/// Share of critical damping: what rubs in yarns and stirs the air.
const DAMPING: f64 = 0.2;
/// Nothing swings slower than this [rad/s].
const SLOWEST: f64 = 2.0;
/// Directions in which all vectors together are so small a share of the largest are none.
const NOTHING: f64 = 1e-10;

/// The slowest swings of a cloth that hangs; none where it is too small to have any.
pub fn sway(hanging: &Hanging) -> Option<Sway> {
    let n = hanging.verts.len();
    if 3 * n < 4 * (SWINGS + BESIDE) {
        return None;
    }
    let system = System::new(hanging)?;
    let (values, shapes) = system.slowest(SWINGS + BESIDE);
    let columns = values.len().min(SWINGS);
    let single = |row: &[f64]| row[..columns].iter().map(|x| *x as f32).collect::<Vec<_>>();
    let shapes = shapes.chunks_exact(values.len()).flat_map(single).collect();
    let stiffness: Vec<f64> = values[..columns]
        .iter()
        .map(|k| k.max(SLOWEST * SLOWEST))
        .collect();
    let mut out = Sway {
        shapes,
        damping: (stiffness.iter())
            .map(|k| (2.0 * DAMPING * k.sqrt()) as f32)
            .collect(),
        stiffness: stiffness.iter().map(|k| *k as f32).collect(),
        ..Sway::default()
    };
    stand_for(&mut out, hanging);
    Some(out)
}

/// Vertices that skin holds back, at most.
const WALLS: usize = 400;
/// Cloth farther from the skin than this is not held back [m].
const FAR: f64 = 0.15;

/// Holds the swings of cloth that hangs at `verts` [m] back from the `skin` of the body at rest, whose vertices
/// follow bones by the given weights.
pub fn hold_back(
    sway: &mut Sway,
    verts: &[DVec3],
    (skin, weights): (&Surface, impl Fn(u32) -> Vec<(u8, f64)>),
) {
    for vertex in spread(verts, WALLS, 0.0) {
        let Some(hit) = skin.closest(verts[vertex as usize], FAR) else {
            continue;
        };
        let mut all: Vec<(u8, f64)> = Vec::new();
        for (corner, share) in skin.faces()[hit.face as usize].into_iter().zip(hit.weights) {
            for (bone, w) in weights(corner) {
                match all.iter_mut().find(|e| e.0 == bone) {
                    Some(e) => e.1 += share * w,
                    None => all.push((bone, share * w)),
                }
            }
        }
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all.truncate(FOLLOWED);
        let sum: f64 = all.iter().map(|e| e.1).sum();
        if sum < 0.5 {
            continue;
        }
        all.resize(FOLLOWED, (0, 0.0));
        sway.walls.push(Wall {
            vertex,
            foot: hit.point.as_vec3().to_array(),
            out: hit.normal.as_vec3().to_array(),
            bones: std::array::from_fn(|i| all[i].0),
            weights: std::array::from_fn(|i| (all[i].1 / sum) as f32),
        });
    }
}

/// Chooses points that stand for the cloth around them.
fn stand_for(sway: &mut Sway, hanging: &Hanging) {
    let (x, k) = (&hanging.verts, sway.len());
    let samples = spread(x, SAMPLES, SPACING);
    let nearest = |p: &DVec3| {
        let far = |s: &usize| p.distance_squared(x[samples[*s] as usize]);
        (0..samples.len()).min_by(|a, b| far(a).total_cmp(&far(b)))
    };
    let mut masses = vec![0.0; samples.len()];
    let mut means = vec![0.0; 3 * samples.len() * k];
    for (v, p) in x.iter().enumerate() {
        let s = nearest(p).expect("there are samples");
        masses[s] += hanging.mass[v];
        let rows = sway.shapes[3 * v * k..3 * (v + 1) * k].iter();
        let to = means[3 * s * k..3 * (s + 1) * k].iter_mut();
        to.zip(rows)
            .for_each(|(m, x)| *m += hanging.mass[v] * f64::from(*x));
    }
    for (rows, mass) in means.chunks_exact_mut(3 * k).zip(&masses) {
        rows.iter_mut().for_each(|m| *m /= mass);
    }
    sway.means = means.iter().map(|x| *x as f32).collect();
    sway.masses = masses.iter().map(|x| *x as f32).collect();
    sway.samples = samples;
}

/// Points evenly spread over others, each the farthest from those before: until none is farther than `spacing` [m], and
/// `count` at most.
fn spread(x: &[DVec3], count: usize, spacing: f64) -> Vec<u32> {
    let mut far = vec![f64::INFINITY; x.len()];
    let mut out = vec![0u32];
    while out.len() < count {
        let last = x[out[out.len() - 1] as usize];
        for (far, p) in far.iter_mut().zip(x) {
            *far = far.min(p.distance_squared(last));
        }
        let next = (0..x.len()).max_by(|a, b| far[*a].total_cmp(&far[*b]));
        let next = next.expect("there are points");
        if far[next] <= spacing * spacing {
            break;
        }
        out.push(next as u32);
    }
    out
}

/// Stiffness and masses, and a way downhill.
struct System<'a> {
    hanging: &'a Hanging,
    factor: Factor,
}

/// Columns of vectors side by side: one row for every coordinate of every vertex.
struct Block {
    width: usize,
    rows: Vec<f64>,
}

impl<'a> System<'a> {
    fn new(hanging: &'a Hanging) -> Option<Self> {
        let n = hanging.verts.len();
        let mut matrix = Matrix {
            starts: hanging.starts.clone(),
            cols: hanging.cols.clone(),
            blocks: hanging.blocks.clone(),
        };
        let mut near = vec![Vec::new(); n];
        for i in 0..n {
            for e in hanging.starts[i] as usize..hanging.starts[i + 1] as usize {
                match hanging.cols[e] as usize == i {
                    false => near[i].push(hanging.cols[e]),
                    true => {
                        let shift = DVec3::splat(hanging.mass[i] * SHIFT);
                        matrix.blocks[e] += glam::DMat3::from_diagonal(shift);
                    }
                }
            }
        }
        let pattern = Pattern::new(&hanging.verts, &near);
        Some(Self {
            factor: Factor::new(&pattern, &matrix)?,
            hanging,
        })
    }

    /// The smallest `ω²` [1/s²] in order, and their shapes of unit mass.
    fn slowest(&self, count: usize) -> (Vec<f64>, Vec<f64>) {
        let n = 3 * self.hanging.verts.len();
        let mut noise = Noise::new(7);
        let start: Vec<f32> = noise.normals(n * count).into_iter().collect();
        let mut x = self.downhill(&start, count);
        let mut values = vec![0.0; count];
        for round in 0..=ROUNDS {
            let all = match round {
                0 => x,
                _ => {
                    let mut rest = self.stiff(&x);
                    for (r, (row, x)) in (rest.rows.chunks_exact_mut(x.width))
                        .zip(x.rows.chunks_exact(x.width))
                        .enumerate()
                    {
                        let mass = self.hanging.mass[r / 3];
                        let each = row.iter_mut().zip(x).zip(&values);
                        each.for_each(|((r, x), value)| *r -= mass * value * x);
                    }
                    // Columns of one size, for they are solved in single precision.
                    let single = scaled(&rest);
                    side_by_side(&x, &self.downhill(&single, rest.width))
                }
            };
            (values, x) = self.sorted(&all, count);
        }
        (values, x.rows)
    }

    /// `(K + σ M)⁻¹ B`.
    fn downhill(&self, b: &[f32], width: usize) -> Block {
        let solved = self.factor.solve(b, width);
        Block {
            width,
            rows: solved.into_iter().map(f64::from).collect(),
        }
    }

    /// `K X`.
    fn stiff(&self, x: &Block) -> Block {
        let (h, w) = (self.hanging, x.width);
        let mut rows = vec![0.0; x.rows.len()];
        rows.par_chunks_mut(3 * w).enumerate().for_each(|(i, out)| {
            for e in h.starts[i] as usize..h.starts[i + 1] as usize {
                let from = &x.rows[3 * w * h.cols[e] as usize..][..3 * w];
                for (r, out) in out.chunks_exact_mut(w).enumerate() {
                    for (c, from) in from.chunks_exact(w).enumerate() {
                        let k = h.blocks[e].col(c)[r];
                        out.iter_mut().zip(from).for_each(|(o, x)| *o += k * x);
                    }
                }
            }
        });
        Block { width: w, rows }
    }

    /// The `count` slowest directions that the columns span, and their `ω²`: Rayleigh and Ritz.
    fn sorted(&self, x: &Block, count: usize) -> (Vec<f64>, Block) {
        let stiff = self.stiff(x);
        let gram = product(x, x, |row| self.hanging.mass[row / 3]);
        // Columns of unit mass first, so that no direction is lost for being short.
        let unit: Vec<f64> = (0..x.width)
            .map(|i| 1.0 / gram[i][i].sqrt().max(f64::MIN_POSITIVE))
            .collect();
        let by_unit = |m: Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            let entry = |i: usize, row: &Vec<f64>| -> Vec<f64> {
                row.iter()
                    .zip(&unit)
                    .map(|(x, u)| x * u * unit[i])
                    .collect()
            };
            m.iter().enumerate().map(|(i, row)| entry(i, row)).collect()
        };
        let spans = eigen(&by_unit(gram));
        let most = spans.values.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> = (0..x.width)
            .filter(|k| spans.values[*k] > NOTHING * most)
            .collect();
        // From directions that were kept to columns.
        let whiten = |i: usize, k: usize| spans.vectors[i][k] / spans.values[k].sqrt();
        let stiff = by_unit(product(x, &stiff, |_| 1.0));
        let half: Vec<Vec<f64>> = stiff
            .iter()
            .map(|row| {
                let one = |k: &usize| (0..x.width).map(|j| row[j] * whiten(j, *k)).sum();
                kept.iter().map(one).collect()
            })
            .collect();
        let small: Vec<Vec<f64>> = kept
            .iter()
            .map(|a| {
                let one = |b: usize| (0..x.width).map(|i| whiten(i, *a) * half[i][b]).sum();
                (0..kept.len()).map(one).collect()
            })
            .collect();
        let found = eigen(&small);
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_by(|a, b| found.values[*a].total_cmp(&found.values[*b]));
        order.truncate(count);
        let mixing: Vec<Vec<f64>> = (0..x.width)
            .map(|i| {
                let one = |o: &usize| {
                    let share = |(k, at): (usize, &usize)| whiten(i, *at) * found.vectors[k][*o];
                    unit[i] * kept.iter().enumerate().map(share).sum::<f64>()
                };
                order.iter().map(one).collect()
            })
            .collect();
        let values = order.iter().map(|o| found.values[*o]).collect();
        (values, mixed(x, &mixing))
    }
}

/// What is added to the stiffness of every kilogram [1/s²], so that it can be factored.
const SHIFT: f64 = 40.0;

/// `Xᵀ diag(weights) Y`.
fn product(x: &Block, y: &Block, weight: impl Fn(usize) -> f64 + Sync) -> Vec<Vec<f64>> {
    let lots = x
        .rows
        .par_chunks(LOT * x.width)
        .zip(y.rows.par_chunks(LOT * y.width));
    let one = |(l, (xs, ys)): (usize, (&[f64], &[f64]))| {
        let mut out = vec![vec![0.0; y.width]; x.width];
        let rows = xs.chunks_exact(x.width).zip(ys.chunks_exact(y.width));
        for (r, (xs, ys)) in rows.enumerate() {
            let w = weight(LOT * l + r);
            for (x, out) in xs.iter().zip(&mut out) {
                out.iter_mut().zip(ys).for_each(|(o, y)| *o += x * w * y);
            }
        }
        out
    };
    let sums: Vec<Vec<Vec<f64>>> = lots.enumerate().map(one).collect();
    let mut out = vec![vec![0.0; y.width]; x.width];
    for sum in &sums {
        for (out, sum) in out.iter_mut().zip(sum) {
            out.iter_mut().zip(sum).for_each(|(o, s)| *o += s);
        }
    }
    out
}

/// Rows that are summed by one thread.
const LOT: usize = 1024;

/// `X A`.
fn mixed(x: &Block, a: &[Vec<f64>]) -> Block {
    let width = a[0].len();
    let mut rows = vec![0.0; x.rows.len() / x.width * width];
    for (out, x) in rows
        .chunks_exact_mut(width)
        .zip(x.rows.chunks_exact(x.width))
    {
        for (x, a) in x.iter().zip(a) {
            out.iter_mut().zip(a).for_each(|(o, a)| *o += x * a);
        }
    }
    Block { width, rows }
}

/// All columns of both.
fn side_by_side(x: &Block, y: &Block) -> Block {
    let rows = x
        .rows
        .chunks_exact(x.width)
        .zip(y.rows.chunks_exact(y.width));
    Block {
        width: x.width + y.width,
        rows: rows
            .flat_map(|(x, y)| x.iter().chain(y).copied().collect::<Vec<_>>())
            .collect(),
    }
}

/// The columns, each of unit length, in single precision.
fn scaled(x: &Block) -> Vec<f32> {
    let mut squares = vec![0.0; x.width];
    for row in x.rows.chunks_exact(x.width) {
        squares.iter_mut().zip(row).for_each(|(s, x)| *s += x * x);
    }
    let scale: Vec<f64> = squares
        .iter()
        .map(|s: &f64| 1.0 / s.sqrt().max(1e-30))
        .collect();
    let rows = x.rows.chunks_exact(x.width);
    rows.flat_map(|row| {
        row.iter()
            .zip(&scale)
            .map(|(x, s)| (x * s) as f32)
            .collect::<Vec<_>>()
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2};
    use muslin_energy::{hinge::Bend, membrane::Stretch};
    use muslin_sim::{Cloth, Frame, Material, Options, hang};

    use super::*;

    /// A strip of soft cloth, 4 cm wide and 40 long, that hangs from its upper end far from any skin.
    fn strip() -> Hanging {
        let (cols, rows) = (4_u32, 40_u32);
        let at = |c: u32, r: u32| r * (cols + 1) + c;
        let flat: Vec<DVec2> = (0..(cols + 1) * (rows + 1))
            .map(|i| DVec2::new(f64::from(i % (cols + 1)), -f64::from(i / (cols + 1))) * 0.01)
            .collect();
        let cells = (0..rows).flat_map(|r| (0..cols).map(move |c| (c, r)));
        let faces: Vec<[u32; 3]> = cells
            .flat_map(|(c, r)| {
                let [a, b, d, e] = [at(c, r), at(c + 1, r), at(c, r + 1), at(c + 1, r + 1)];
                [[a, d, e], [a, e, b]]
            })
            .collect();
        let material = Material {
            density: 0.15,
            stretch: Stretch {
                warp: 1000.0,
                weft: 1000.0,
                shear: 200.0,
                compression: 1.0,
            },
            bend: Bend {
                warp: 1e-8,
                weft: 1e-8,
            },
            limit: None,
            friction: 0.3,
            thickness: 5e-4,
        };
        let cloth = Cloth {
            rest: faces.iter().map(|f| f.map(|i| flat[i as usize])).collect(),
            material_of: vec![0; faces.len()],
            materials: vec![material],
            layers: vec![0; flat.len()],
            pins: (0..=cols).collect(),
            faces,
        };
        let start: Vec<DVec3> = flat.iter().map(|p| p.extend(0.0)).collect();
        let far = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * 0.1 + DVec3::X * 3.0);
        let body = Frame::from(far.to_vec());
        let options = Options {
            pin: 5000.0,
            handles: true,
            again: false,
            ..Options::USUAL
        };
        hang(&cloth, &start, (&body, &[[0, 1, 2]]), &options).expect("a valid scene")
    }

    #[test]
    fn a_hanging_strip_swings_as_fast_as_a_hanging_chain() {
        let sway = sway(&strip()).expect("large enough");
        let slowest = f64::from(sway.stiffness[0]).sqrt();
        // Zeros of J0 over 2, times √(g / L) (Bernoulli 1732).
        let root = (9.81f64 / 0.4).sqrt();
        let [first, second] = [2.405, 5.520].map(|zero| 0.5 * zero * root);
        assert!(
            (slowest / first - 1.0).abs() < 0.03,
            "{slowest} for {first}"
        );
        let all: Vec<f64> = (sway.stiffness.iter())
            .map(|k| f64::from(*k).sqrt())
            .collect();
        let near = all.iter().any(|w| (w / second - 1.0).abs() < 0.03);
        assert!(near, "{second} among {all:?}");
        let damping = f64::from(sway.damping[0]);
        assert!((damping / (2.0 * DAMPING * slowest) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn shapes_are_of_unit_mass_and_solve_the_equation_of_vibration() {
        let hanging = strip();
        let n = 3 * hanging.verts.len();
        let system = System::new(&hanging).expect("positive definite");
        let (values, rows) = system.slowest(SWINGS + BESIDE);
        let x = Block {
            width: values.len(),
            rows,
        };
        let gram = product(&x, &x, |row| hanging.mass[row / 3]);
        for (i, row) in gram.iter().enumerate() {
            for (j, g) in row.iter().enumerate() {
                assert!(
                    (g - f64::from(u8::from(i == j))).abs() < 1e-6,
                    "{i} {j}: {g}"
                );
            }
        }
        let stiff = system.stiff(&x);
        for k in 0..SWINGS / 2 {
            let (mut off, mut all) = (0.0, 0.0);
            for r in 0..n {
                let at = r * x.width + k;
                let inertia = hanging.mass[r / 3] * values[k] * x.rows[at];
                off += (stiff.rows[at] - inertia).powi(2);
                all += inertia * inertia;
            }
            assert!(off < 1e-4 * all, "{k}: {off} of {all}");
        }
        assert!(values.is_sorted());
    }

    #[test]
    fn samples_stand_for_all_mass_and_every_steady_pull() {
        let hanging = strip();
        let sway = sway(&hanging).expect("large enough");
        assert!(sway.fits(hanging.verts.len(), 0));
        let mass: f64 = hanging.mass.iter().sum();
        let stood: f64 = sway.masses.iter().map(|m| f64::from(*m)).sum();
        assert!((stood / mass - 1.0).abs() < 1e-5);
        for (k, axis) in (0..sway.len()).flat_map(|k| (0..3).map(move |a| (k, a))) {
            let pull = |masses: &[f64], rows: &[f32]| -> f64 {
                let one =
                    |(v, m): (usize, &f64)| m * f64::from(rows[(3 * v + axis) * sway.len() + k]);
                masses.iter().enumerate().map(one).sum()
            };
            let masses: Vec<f64> = sway.masses.iter().map(|m| f64::from(*m)).collect();
            let [all, few] = [
                pull(&hanging.mass, &sway.shapes),
                pull(&masses, &sway.means),
            ];
            assert!((all - few).abs() < 1e-5, "{k} {axis}: {all} {few}");
        }
    }

    #[test]
    fn larger_cloth_has_more_samples_and_none_of_it_is_far_from_one() {
        let grid = |n: u32| -> Vec<DVec3> {
            let at = |k: u32| DVec3::new(f64::from(k % n), f64::from(k / n), 0.0) * 0.01;
            (0..n * n).map(at).collect()
        };
        let count = |n: u32| {
            let x = grid(n);
            let samples = spread(&x, usize::MAX, SPACING);
            let near = |p: &DVec3| {
                samples
                    .iter()
                    .any(|s| p.distance(x[*s as usize]) <= SPACING)
            };
            assert!(x.iter().all(near));
            samples.len()
        };
        assert!(count(60) > 3 * count(30), "{} {}", count(60), count(30));
        assert_eq!(spread(&grid(60), 7, SPACING).len(), 7);
    }

    #[test]
    fn a_rag_too_small_to_swing_has_no_swings() {
        let hanging = Hanging {
            verts: vec![DVec3::ZERO; 3],
            mass: vec![1.0; 3],
            starts: vec![0, 1, 2, 3],
            cols: vec![0, 1, 2],
            blocks: vec![DMat3::IDENTITY; 3],
        };
        assert_eq!(sway(&hanging), None);
    }
}
