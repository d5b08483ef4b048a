//! One Newton step: assemble, solve, make sure that it descends.

use std::borrow::Cow;

use glam::{DMat3, DVec3, Mat3A, Vec3};
use muslin_energy::{contact::Barrier, point};
use rayon::prelude::*;

use crate::{
    air::Drag,
    coarse::Factor,
    elastic::{self, Answer},
    matrix::{Effort, Matrix, narrow},
    ordered,
    pairs::{self, Pair},
    touch::{self, Touch},
    weave::Weave,
};

/// What one time step minimises, with contacts as they were found before it.
pub(crate) struct Problem<'a> {
    pub weave: &'a Weave,
    /// Where every vertex would go unforced [m].
    pub target: &'a [DVec3],
    /// Time step [s] as inertia knows it.
    pub step: f64,
    pub gravity: DVec3,
    /// The air's part, where there is any.
    pub drag: Option<&'a Drag>,
    pub touches: &'a [Touch],
    pub pairs: &'a [Pair],
    /// Whether cloth comes to rest: nothing slides or falls then.
    pub is_calm: bool,
    pub barrier: Barrier,
    /// Vertices held, and where [m].
    pub pins: &'a [(u32, DVec3)],
    /// Stiffness of a pin [N/m].
    pub pin: f64,
}

impl Problem<'_> {
    /// The incremental potential at `x` [J].
    pub fn energy(&self, x: &[DVec3]) -> f64 {
        let w = self.weave;
        let bodies = ordered::sum(x.len(), |range| range.map(|i| self.own_energy(x, i)).sum());
        let pins = self
            .pins
            .iter()
            .map(|&(i, t)| point::pin(x[i as usize], t, self.pin).energy);
        bodies
            + elastic::energy(w, x)
            + touch::energy(self.touches, x)
            + pairs::energy(self.pairs, x, &self.barrier)
            + pins.sum::<f64>()
    }

    /// Inertia, weight and bending of one vertex [J].
    fn own_energy(&self, x: &[DVec3], i: usize) -> f64 {
        let m = self.weave.mass[i];
        // Rows of Q sum to zero, so any point may be the origin; a near one keeps the digits.
        let bend = self
            .weave
            .bending
            .pull(i, x, &self.weave.pattern.near)
            .dot(x[i] - x[0]);
        // Weight is measured from the target, so that no digits go to the height of the room.
        point::inertia(x[i], self.target[i], m, self.step).energy
            + point::gravity(x[i] - self.target[i], m, self.gravity).energy
            + 0.5 * bend
            + self.drag.map_or(0.0, |d| d.at(i, x[i]).energy)
    }

    /// The gradient [N] and the matrix at `x`, and the pairs as they are held there.
    fn assemble(&self, x: &[DVec3]) -> (Vec<DVec3>, Matrix<'_>, Vec<Pair>) {
        let w = self.weave;
        let answers = elastic::answers(w, x);
        let mut gradient = ordered::map(x.len(), |i| self.own_gradient(&answers, x, i));
        let mut blocks = self.blocks(&answers, x);
        let mut add = |place: u32, h: Mat3A| blocks[place as usize] += h;
        for &(i, t) in self.pins {
            let held = point::pin(x[i as usize], t, self.pin);
            gradient[i as usize] += held.gradient;
            add(w.pattern.diagonal[i as usize], narrow(&held.hessian));
        }
        let gives = self.gives();
        let touches = self.touching(x, &gradient, &gives);
        touch::add(&touches, x, &mut gradient, |touch, a, b, h| {
            let (here, h) = (w.pattern.diagonal[touch.verts[a] as usize], narrow(&h));
            add(here, h);
            if let Some(f) = touch.face.filter(|_| a != b) {
                add(w.pattern.places[f as usize][a][b], h);
            }
        });
        let held = self.held(x, &gradient, &gives);
        let links = pairs::add(&held, x, &self.barrier, &mut gradient);
        let matrix = Matrix::new(&w.pattern, &w.bending, blocks, links);
        (gradient, matrix, held)
    }

    /// How far a force leads every vertex that nothing else holds [m/N].
    fn gives(&self) -> Vec<f64> {
        let time = self.step * self.step;
        let mut gives: Vec<f64> = self.weave.mass.iter().map(|m| time / m).collect();
        for &(i, _) in self.pins {
            let give = &mut gives[i as usize];
            *give /= 1.0 + self.pin * *give;
        }
        gives
    }

    /// How far forces lead patches of cloth [m].
    fn ways(&self, gradient: &[DVec3], gives: &[f64]) -> Vec<DVec3> {
        let ways = ordered::map(gradient.len(), |i| gradient[i] * -gives[i]);
        self.weave.pattern.near.smoothed(ways, PATCHES)
    }

    /// The touches at `x` as cloth and weight [N] lead patches of cloth: who slides, or will, slides on where friction
    /// does not hold him.
    fn touching(&self, x: &[DVec3], gradient: &[DVec3], gives: &[f64]) -> Cow<'_, [Touch]> {
        if self.is_calm || self.touches.iter().all(|t| t.rub.grip <= 0.0) {
            return self.touches.into();
        }
        let ways = self.ways(gradient, gives);
        let back = times(&touch::grips(self.touches, x.len()), gives);
        let led = |k: usize| self.touches[k].led_on(x, &ways, &back);
        ordered::map(self.touches.len(), led).into()
    }

    /// The pairs at `x` as all other forces [N] lead patches of cloth: who does not push yet is let go where they lead
    /// apart, and who slides, or will, slides on where friction does not hold them.
    fn held(&self, x: &[DVec3], gradient: &[DVec3], gives: &[f64]) -> Vec<Pair> {
        if self.is_calm || self.pairs.is_empty() {
            return self.pairs.to_vec();
        }
        let ways = self.ways(gradient, gives);
        let fall = self.gravity * (self.step * self.step);
        let back = times(&pairs::grips(self.pairs, x.len()), gives);
        ordered::map(self.pairs.len(), |k| {
            let pair = self.pairs[k].unless_parted(&ways, fall);
            pair.led_on(x, &ways, &back)
        })
    }

    /// The matrix at `x` without inertia, as [`Matrix::rows`] gives it.
    pub fn resistance(&self, x: &[DVec3]) -> (Vec<u32>, Vec<u32>, Vec<DMat3>) {
        let (_, matrix, _) = self.assemble(x);
        let inertia = |i: usize| f64::from((self.weave.mass[i] / (self.step * self.step)) as f32);
        matrix.rows(inertia)
    }

    fn own_gradient(&self, answers: &[Answer], x: &[DVec3], i: usize) -> DVec3 {
        let (w, m) = (self.weave, self.weave.mass[i]);
        point::inertia(x[i], self.target[i], m, self.step).gradient
            + point::gravity(x[i], m, self.gravity).gradient
            + w.bending.pull(i, x, &w.pattern.near)
            + elastic::gradient(w, answers, i)
            + self.drag.map_or(DVec3::ZERO, |d| d.at(i, x[i]).gradient)
    }

    /// Blocks of inertia, air, stretch and bending.
    fn blocks(&self, answers: &[Answer], x: &[DVec3]) -> Vec<Mat3A> {
        let (w, near) = (self.weave, &self.weave.pattern.near);
        let n = w.n_verts();
        let mut blocks = vec![Mat3A::ZERO; near.items.len()];
        let mut left = &mut blocks[..];
        let chunks = (0..n.div_ceil(ordered::CHUNK)).map(|c| {
            let rows = c * ordered::CHUNK..((c + 1) * ordered::CHUNK).min(n);
            let first = near.start[rows.start] as usize;
            let places = near.start[rows.end] as usize - first;
            let out = left.split_off_mut(..places);
            (rows, first, out.expect("rows end where the next begin"))
        });
        let chunks: Vec<_> = chunks.collect();
        chunks.into_par_iter().for_each(|(rows, first, out)| {
            let scalar = |k: f64| Mat3A::from_diagonal(Vec3::splat(k as f32));
            let bent = &w.bending.near[first..first + out.len()];
            out.iter_mut().zip(bent).for_each(|(o, k)| *o = scalar(*k));
            for i in rows {
                elastic::add_row(w, answers, (i, first), out);
                let k = w.mass[i] / (self.step * self.step);
                let drag = self
                    .drag
                    .map_or(Mat3A::ZERO, |d| narrow(&d.at(i, x[i]).hessian));
                out[w.pattern.diagonal[i] as usize - first] = scalar(k) + drag;
            }
        });
        blocks
    }

    /// Moves all of the cloth by as much as what `moves` from `x` [m] leave unsolved took of its momentum, where nothing
    /// but weight acts on it from outside: within it, forces add up to nothing wherever it is.
    fn keep_momentum(&self, x: &[DVec3], moves: &mut [DVec3]) {
        if self.is_calm || self.drag.is_some() || !self.touches.is_empty() || !self.pins.is_empty()
        {
            return;
        }
        let off = self.weave.mean(|i| x[i] + moves[i] - self.target[i]);
        let shift = self.gravity * (self.step * self.step) - off;
        moves.iter_mut().for_each(|m| *m += shift);
    }

    /// A displacement from `x`, where the energy may be known [J], that lowers it; none if nothing
    /// finite was found. `kept`: see [`crate::coarse::Far::new`].
    pub fn descend(
        &self,
        (x, energy): (&[DVec3], Option<f64>),
        effort: &Effort<'_>,
        kept: &mut Option<Factor>,
    ) -> Option<Descent> {
        let (gradient, matrix, pairs) = self.assemble(x);
        let down: Vec<DVec3> = gradient.iter().map(|g| -*g).collect();
        let (mut moves, _) = matrix.solve(&down, effort, kept);
        self.keep_momentum(x, &mut moves);
        let first = energy.unwrap_or_else(|| self.energy(x));
        // Conjugate gradients end where the model falls by half of what its slope says.
        let work = ordered::sum(x.len(), |range| range.map(|i| down[i].dot(moves[i])).sum());
        for halved in 0..HALVINGS {
            touch::keep_out(self.touches, x, &mut moves);
            let there: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
            let energy = self.energy(&there);
            // A rise within rounding of the sum is no rise.
            if energy <= first + 1e-12 * first.abs() {
                let fell = (halved == 0).then(|| 2.0 * (first - energy) / work);
                return Some(Descent { moves, fell, pairs });
            }
            moves.iter_mut().for_each(|m| *m *= 0.5);
        }
        let is_finite = moves.iter().all(|m| m.is_finite());
        is_finite.then_some(Descent {
            moves,
            fell: None,
            pairs,
        })
    }
}

fn times(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// A Newton step.
pub(crate) struct Descent {
    /// Where it leads [m].
    pub moves: Vec<DVec3>,
    /// By how much the energy fell, as a share of what its gradient and matrix promised; none where the step had to
    /// be made shorter.
    pub fell: Option<f64>,
    /// The pairs as they were held.
    pub pairs: Vec<Pair>,
}

/// Forces are looked at as patches of cloth feel them, spread to neighbours so many times: within a patch cloth pulls
/// this way and that.
const PATCHES: usize = 3;
/// Steps are halved this often; a step of a sixteenth is taken whatever the energy says.
const HALVINGS: usize = 4;

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use muslin_energy::{hinge::Bend, membrane::Stretch};

    use super::*;
    use crate::{
        air::Air,
        cloth::{Cloth, Material},
        near::Near,
        pairs::Rule,
        rub::Rub,
    };

    /// A crumpled square of 3 × 3 vertices over a plane, with everything that can act acting.
    fn crumpled() -> (Cloth, Vec<DVec3>) {
        let flat: Vec<DVec2> = (0..9)
            .map(|i| DVec2::new(f64::from(i % 3), f64::from(i / 3)) * 0.01)
            .collect();
        let mut faces = Vec::new();
        for c in [0, 1, 3, 4] {
            faces.extend([[c, c + 1, c + 4], [c, c + 4, c + 3]]);
        }
        let material = Material {
            density: 0.2,
            stretch: Stretch {
                warp: 300.0,
                weft: 200.0,
                shear: 50.0,
                compression: 1.0,
            },
            bend: Bend {
                warp: 1e-5,
                weft: 2e-5,
            },
            limit: Some(0.05),
            friction: 0.3,
            thickness: 1e-3,
        };
        let cloth = Cloth {
            rest: faces
                .iter()
                .map(|f: &[u32; 3]| f.map(|i| flat[i as usize]))
                .collect(),
            materials: vec![material],
            material_of: vec![0; faces.len()],
            layers: vec![0; 9],
            pins: Vec::new(),
            faces,
        };
        let wave = |(i, p): (usize, &DVec2)| {
            let lift = 1e-3 * (2.3 * i as f64).sin();
            DVec3::new(1.03 * p.x, 1.002 + lift, -1.06 * p.y)
        };
        let x = flat.iter().enumerate().map(wave).collect();
        (cloth, x)
    }

    #[test]
    fn the_gradient_is_that_of_the_energy_and_the_step_descends() {
        let (cloth, x) = crumpled();
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let target: Vec<DVec3> = x
            .iter()
            .map(|p| *p + DVec3::new(2e-4, -1e-4, 1e-4))
            .collect();
        let barrier = Barrier {
            radius: 3e-3,
            width: 1e-3,
            stiffness: 400.0,
        };
        let touch = Touch {
            verts: [4, 7, 8],
            weights: [0.5, 0.2, 0.3],
            face: Some(7),
            skin: DVec3::new(0.0, 1.0, 0.0),
            rub: Rub::new((DVec3::Y, x[4] + DVec3::X * 1e-4), 0.02, 5e-5),
            barrier,
        };
        let cloth_barrier = Barrier {
            radius: 0.025,
            width: 0.01,
            stiffness: 150.0,
        };
        let rule = Rule {
            barrier: cloth_barrier,
            friction: &[0.3; 9],
            grip: 1.0,
            stick: 5e-5,
            from: &target,
            pushed: None,
            fall: DVec3::ZERO,
        };
        let near = Near {
            verts: [0, 2, 6, 8],
            is_edges: true,
        };
        let wind = Air {
            wind: DVec3::new(0.3, -2.0, 1.0),
            ..Air::STILL
        };
        let drag = Drag::new(&weave, &x, &wind, (0.04, 1.0)).expect("there is air");
        let problem = Problem {
            weave: &weave,
            target: &target,
            step: 0.03,
            gravity: DVec3::Y * -9.81,
            drag: Some(&drag),
            touches: &[touch],
            pairs: &pairs::gripping(&[near], &x, &rule),
            is_calm: false,
            barrier: cloth_barrier,
            pins: &[(2, x[2] + DVec3::Z * 1e-4)],
            pin: 100.0,
        };
        let (gradient, ..) = problem.assemble(&x);
        for (i, axis) in (0..9).flat_map(|i| [(i, DVec3::X), (i, DVec3::Y), (i, DVec3::Z)]) {
            let at = |h: f64| {
                let mut y = x.clone();
                y[i] += axis * h;
                problem.energy(&y)
            };
            let (h, got) = (1e-7, gradient[i].dot(axis));
            let want = (at(h) - at(-h)) / (2.0 * h);
            assert!(
                (got - want).abs() < 1e-5 * (1.0 + want.abs()),
                "{i} {axis}: {got} {want}"
            );
        }
        let effort = Effort {
            iterations: 60,
            handles: None,
            tolerance: 1e-8,
        };
        let moves = problem
            .descend((&x, None), &effort, &mut None)
            .expect("finite")
            .moves;
        let there: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        assert!(problem.energy(&there) < problem.energy(&x));
    }

    #[test]
    fn the_energy_falls_by_what_was_promised_where_laws_are_straight_and_else_it_is_told() {
        let (cloth, x) = long_sheet();
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let effort = Effort {
            iterations: 500,
            handles: None,
            tolerance: 1e-6,
        };
        // The sheet is pulled down by its hem, or turned about its upper edge, where yarns turn as well.
        let fell = |by: f64, way: fn(&DVec3) -> DVec3| {
            let target: Vec<DVec3> = x.iter().map(|p| *p + way(p) * by).collect();
            let problem = Problem {
                target: &target,
                ..untouched(&weave, &x, (0.02, &[]))
            };
            let descent = problem.descend((&x, None), &effort, &mut None);
            descent.expect("finite").fell
        };
        let longer = |p: &DVec3| DVec3::Y * p.y;
        let swung = |p: &DVec3| DVec3::Z * p.y;
        let little = fell(1e-4, longer).expect("a whole step");
        assert!((little - 1.0).abs() < 2e-3, "{little}");
        assert!(fell(1.0, swung).is_none_or(|share| (share - 1.0).abs() > 0.05));
    }

    /// Cloth that starts from `x` [m] and meets nothing, in a step of `step` [s].
    fn untouched<'a>(
        weave: &'a Weave,
        x: &'a [DVec3],
        (step, pins): (f64, &'a [(u32, DVec3)]),
    ) -> Problem<'a> {
        Problem {
            weave,
            target: x,
            step,
            gravity: DVec3::ZERO,
            drag: None,
            touches: &[],
            pairs: &[],
            is_calm: false,
            barrier: Barrier {
                radius: 3e-3,
                width: 1e-3,
                stiffness: 400.0,
            },
            pins,
            pin: 100.0,
        }
    }

    #[test]
    fn conjugate_gradients_solve_the_system() {
        let (cloth, x) = crumpled();
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let problem = untouched(&weave, &x, (0.03, &[]));
        let (gradient, matrix, _) = problem.assemble(&x);
        let (solution, _) = matrix.solve(
            &gradient,
            &Effort {
                iterations: 200,
                handles: None,
                tolerance: 1e-10,
            },
            &mut None,
        );
        let back = matrix.times(&solution);
        let worst = back
            .iter()
            .zip(&gradient)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        let size = gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
        assert!(worst < 1e-6 * size, "residual {worst} of {size}");
    }

    /// A sheet of 10 × 60 vertices, 1 cm apart, hanging along −Y.
    fn long_sheet() -> (Cloth, Vec<DVec3>) {
        let flat: Vec<DVec2> = (0..600)
            .map(|i| DVec2::new(f64::from(i % 10), -f64::from(i / 10)) * 0.01)
            .collect();
        let cells = (0..590_u32).filter(|v| v % 10 < 9);
        let faces: Vec<[u32; 3]> = cells
            .flat_map(|v| [[v, v + 10, v + 11], [v, v + 11, v + 1]])
            .collect();
        let cloth = Cloth {
            rest: faces.iter().map(|f| f.map(|i| flat[i as usize])).collect(),
            material_of: vec![0; faces.len()],
            layers: vec![0; 600],
            faces,
            ..crumpled().0
        };
        (cloth, flat.iter().map(|p| p.extend(0.0)).collect())
    }

    #[test]
    fn handles_see_what_their_moves_do_to_the_whole_matrix() {
        let (cloth, mut x) = long_sheet();
        for (i, x) in x.iter_mut().enumerate() {
            x.z = 1e-3 * (1.9 * i as f64).sin();
        }
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let pins = [(7, x[7])];
        let problem = untouched(&weave, &x, (0.02, &pins));
        let (_, matrix, _) = problem.assemble(&x);
        let handles = crate::coarse::Handles::new(&weave.pattern.near, &weave.bending);
        let handles = handles.expect("one sheet");
        for (a, row) in crate::coarse::seen(&matrix, &handles).iter().enumerate() {
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let mut p = vec![DVec3::ZERO; x.len()];
                for &(v, share) in handles.moved(a) {
                    p[v as usize] = axis * f64::from(share);
                }
                let pulls = matrix.times(&p);
                for (b, block) in row.iter().enumerate() {
                    let on = |&(v, share): &(u32, f32)| pulls[v as usize] * f64::from(share);
                    let want: DVec3 = handles.moved(b).iter().map(on).sum();
                    let got = (block.transpose() * axis.as_vec3a()).as_dvec3();
                    let size = f64::from((row[a] * axis.as_vec3a()).length());
                    assert!((got - want).length() < 1e-3 * size, "{a} {b}: {got} {want}");
                }
            }
        }
    }

    #[test]
    fn handles_carry_a_pull_across_cloth_in_a_few_iterations() {
        let (cloth, x) = long_sheet();
        let weave = Weave::new(&cloth).expect("a valid cloth");
        let pins: Vec<(u32, DVec3)> = (0..10)
            .map(|i| (i, x[i as usize] + DVec3::Y * 1e-3))
            .collect();
        let problem = untouched(&weave, &x, (0.02, &pins));
        let (gradient, matrix, _) = problem.assemble(&x);
        let down: Vec<DVec3> = gradient.iter().map(|g| -*g).collect();
        let handles = crate::coarse::Handles::new(&weave.pattern.near, &weave.bending);
        assert!(handles.is_some());
        let hem = |handles, iterations| {
            let effort = Effort {
                iterations,
                handles,
                tolerance: 1e-9,
            };
            let (moves, _) = matrix.solve(&down, &effort, &mut None);
            moves[590..].iter().map(|m| m.y).sum::<f64>() / 10.0
        };
        let exact = hem(None, 5000);
        assert!((hem(handles.as_ref(), 500) - exact).abs() < 1e-4 * exact);
        let off = |got: f64| (got / exact - 1.0).abs();
        let (without, with) = (off(hem(None, 25)), off(hem(handles.as_ref(), 25)));
        assert!(
            with < 1e-3 && without > 0.05,
            "{with} with, {without} without"
        );
    }
}
