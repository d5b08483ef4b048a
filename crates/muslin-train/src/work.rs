//! One pack: prediction, laws, and the way back to the parameters.

#[cfg(test)]
mod double;
mod let_go;

use muslin_geom::widely;
use muslin_net::learn::{MlpTape, View, multiply};
use rayon::prelude::*;

use crate::folds::{LIMBS, PARTS, gathered};
use crate::ground::Wall as Plane;
use crate::lanes::{LANES, Lane, Row, Vec3, points};
use crate::laws::{self, Wall};
use crate::layers::{self, Lying};
use crate::pack::Pack;
use crate::skin;
use crate::skinning::Skinning;
use crate::trainer::{Energies, Trainer};
use crate::wearer::Wearer;

/// Stiffness of a pin [N/m], as in the solver.
pub(crate) const PIN: f32 = 100.0;

/// The entries of a symmetric 3 × 3 matrix that are kept.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// What one pack gives.
#[derive(Clone, Default)]
pub(crate) struct Work {
    pub d_modes: Vec<f32>,
    pub d_params: Vec<f32>,
    /// Of the numbers that skin weights follow from, where those are learnt.
    pub d_skinning: Vec<f32>,
    pub moments: Vec<f32>,
    /// The codes, one row each.
    pub codes: Vec<f32>,
    /// Forces on the cloth in the poses [N], where skin weights are learnt.
    pub forces: Vec<Row>,
    pub walls: Vec<[f32; 6]>,
    pub energies: Energies,
    /// What the cloth costs once it was let go, if it was.
    pub relaxed: Option<Energies>,
    pub under: f64,
    /// How much each pose counts.
    pub counts: Row,
    /// The first vertex whose gradient is not finite.
    pub broken: Option<usize>,
}

impl Work {
    /// What each pose counts in the mean of all.
    fn shares(&self) -> Row {
        let share = 1.0 / LANES as f32;
        self.counts.map(|c| c * share)
    }
}

/// What a pose meets: a triangle of the skin at every vertex, the cloth itself at some, and by layers
/// other garments at some.
type Met = (Vec<u32>, Vec<(u32, Plane)>, Vec<Vec<(u32, u32)>>);
/// A pack with all that its cloth meets.
type Walled<'a> = (&'a Pack, &'a Walls);

/// What the cloth of a pack meets besides itself.
struct Walls {
    /// The skin's wall at every vertex: normal and offset.
    skin: Vec<[Row; 4]>,
    /// Cloth that lies on that of other garments.
    others: Vec<Lying>,
}

impl Trainer<'_> {
    /// Predicts, asks the laws, and goes back as far as the parameters.
    pub(crate) fn work(&self, pack: &mut Pack) -> Work {
        let mut tape = MlpTape::default();
        let (plain, mut x) = self.predict(pack, &mut tape);
        let (n, k) = (x.len() / 3, self.plan.codes);
        let modes = View::new(&self.now.modes, 3 * n, k);
        let codes = View::new(&plain, k, LANES);
        let is_asked = self.plan.relaxed > 0 || self.skinning.is_some();
        let at_rest = is_asked.then(|| x.clone());
        widely(
            #[inline(always)]
            || self.carry(pack, &mut x),
        );
        self.look(pack, &x);
        let walls = Walls {
            skin: self.walls(pack, &x),
            others: self.lying(pack, &x),
        };
        pack.visits += 1;
        let mut work = Work::default();
        let mut g = vec![[0.0; LANES]; 3 * n];
        widely(
            #[inline(always)]
            || self.ask((pack, &walls), (&x, &mut g), &mut work),
        );
        if let (Some(d), None, Some(skinning)) = (&at_rest, work.broken, &self.skinning) {
            self.pull((skinning, pack), d, &mut work);
        }
        let is_let_go = self.plan.relaxed > 0 && work.broken.is_none();
        if let Some(mut at_rest) = at_rest.filter(|_| is_let_go) {
            widely(
                #[inline(always)]
                || work.relaxed = Some(self.let_go((pack, &walls), (&mut at_rest, &mut g))),
            );
            work.broken = broken(&g);
        }
        if work.broken.is_some() {
            return work;
        }
        let shares = work.shares();
        let weigh = |row: &mut [f32]| row.iter_mut().zip(&shares).for_each(|(x, s)| *x *= s);
        g.iter_mut().for_each(|row| weigh(row));
        let g = View::new(g.as_flattened(), 3 * n, LANES);
        work.d_modes = vec![0.0; 3 * n * k];
        multiply(&mut work.d_modes, 0.0, g, codes.transposed());
        let mut d_codes = vec![0.0; k * LANES];
        multiply(&mut d_codes, 0.0, modes.transposed(), g);
        work.d_params = vec![0.0; self.parts().0.len()];
        d_codes.truncate((k - 1) * LANES);
        self.encoder
            .backward(self.parts().0, &tape, &d_codes, &mut work.d_params);
        work.moments = vec![0.0; k * k];
        let mut weighed = plain.clone();
        weighed.chunks_exact_mut(LANES).for_each(weigh);
        let weighed = View::new(&weighed, k, LANES);
        multiply(&mut work.moments, 0.0, weighed, codes.transposed());
        work.codes = plain;
        work
    }

    /// The codes of a pack, one row each, and by how much its cloth is corrected at rest [m].
    fn predict(&self, pack: &Pack, tape: &mut MlpTape) -> (Vec<f32>, Vec<Row>) {
        let inputs = (pack.inputs.as_flattened(), LANES);
        let mut codes = self.encoder.forward(self.parts().0, inputs, tape).to_vec();
        codes.extend([1.0; LANES]);
        let (rows, k) = (self.now.modes.len() / self.plan.codes, self.plan.codes);
        let mut x = vec![[0.0; LANES]; rows];
        let modes = View::new(&self.now.modes, rows, k);
        let told = View::new(&codes, k, LANES);
        multiply(x.as_flattened_mut(), 0.0, modes, told);
        (codes, x)
    }

    /// What skin weights do to the cost of a pack whose cloth lies at rest by `d` off its template [m], from the forces
    /// of its `work`, which are not needed any more.
    fn pull(&self, (skinning, pack): (&Skinning, &Pack), d: &[Row], work: &mut Work) {
        let mut g = std::mem::take(&mut work.forces);
        let shares = work.shares();
        for row in &mut g {
            row.iter_mut().zip(&shares).for_each(|(x, s)| *x *= s);
        }
        work.d_skinning = vec![0.0; skinning.len()];
        let Wearer { cut, template, .. } = &self.wearers[pack.wearer];
        skinning.pull(&pack.bones, (template, d), &g, &mut work.d_skinning);
        skinning.slopes(self.parts().1, &cut.pins, &mut work.d_skinning);
    }

    /// From corrections at rest to positions in the poses, in place.
    #[inline(always)]
    fn carry(&self, pack: &Pack, x: &mut [Row]) {
        let template = &self.wearers[pack.wearer].template;
        for (v, t) in template.iter().enumerate() {
            let a = skin::blend(&self.skin, v, &pack.bones);
            let d = Vec3::of(x, v as u32);
            let p = Vec3([0, 1, 2].map(|i| d.0[i] + t[i]));
            skin::carry(&a, p).put(x, v as u32);
        }
    }

    /// Looks for the nearest skin and for cloth that meets cloth where that is due, the latter while it may be anywhere
    /// between all parts, later between limbs alone: looked for everywhere in cloth that has become soft, its planes
    /// stand in folds, and trainings broke out. Planes that are not found again are forgotten, for they hold up cloth
    /// that has moved on.
    pub(crate) fn look(&self, pack: &mut Pack, x: &[Row]) {
        let wearer = &self.wearers[pack.wearer];
        let Wearer { body, folds, .. } = wearer;
        if pack.skins.is_empty() {
            let pose = |p: &u32| body.skin(&self.pool[*p as usize]);
            pack.skins = pack.poses.par_iter().map(pose).collect();
        }
        if !pack.is_due() {
            return;
        }
        let (skins, before) = (&pack.skins, &pack.faces);
        let is_new = pack.is_new();
        let known = |v: usize, lane: usize| (!is_new).then(|| before[v][lane]);
        let each = |lane: usize| {
            let x = points(x, lane);
            let faces = body.nearest(&skins[lane], &x, |v| known(v, lane));
            let shared = if is_new { PARTS } else { LIMBS };
            let over = wearer.layers.iter().map(|l| l.near(&x));
            (
                faces,
                folds.find(&x, (self.plan.gap, shared)),
                over.collect(),
            )
        };
        let all: Vec<Met> = (0..LANES).into_par_iter().map(each).collect();
        pack.faces = (0..x.len() / 3)
            .map(|v| std::array::from_fn(|lane| all[lane].0[v]))
            .collect();
        let (folds, over): (Vec<_>, Vec<_>) = all.into_iter().map(|a| (a.1, a.2)).unzip();
        pack.folds = gathered(&folds);
        pack.over = layers::gathered(&over);
    }

    /// The wall at every vertex: normal and offset.
    fn walls(&self, pack: &mut Pack, x: &[Row]) -> Vec<[Row; 4]> {
        let body = &self.wearers[pack.wearer].body;
        let mut out = vec![[[0.0; LANES]; 4]; x.len() / 3];
        for lane in 0..LANES {
            let skin = &pack.skins[lane];
            let each = out.iter_mut().zip(x.as_chunks::<3>().0);
            for ((out, p), face) in each.zip(&mut pack.faces) {
                let p = glam::Vec3::from_array(p.map(|row| row[lane]));
                let wall = body.wall(skin, p, &mut face[lane]);
                (0..4).for_each(|c| out[c][lane] = wall[c]);
            }
        }
        out
    }

    /// What garments that lie over others, or under, lie on.
    fn lying(&self, pack: &mut Pack, x: &[Row]) -> Vec<Lying> {
        let layers = &self.wearers[pack.wearer].layers;
        let own = pack.over.chunk_by_mut(|a, b| a.layer == b.layer);
        let each = own.flat_map(|near| layers[near[0].layer as usize].lie(x, near));
        each.collect()
    }

    /// How skin pushes now.
    pub(crate) fn wall(&self) -> Wall {
        Wall {
            radius: self.plan.gap as f32,
            width: 1e-3,
            stiffness: self.skin_stiffness(),
        }
    }

    /// What cloth that lies on another garment adds to the walls' stiffness, where that pushes with `curvature` [N/m]: both
    /// follow nearly the same bones.
    #[inline(always)]
    fn stiffen(&self, (pack, lying): (&Pack, &Lying), curvature: Lane, stiff: &mut [[f32; 6]]) {
        let v = lying.vertex as usize;
        let a = skin::blend(&self.skin, v, &pack.bones);
        let [x, y, z, _] = lying.plane.map(Lane);
        let m = skin::bring_back(&a, Vec3([x, y, z]));
        add_stiffness(&mut stiff[v], m, curvature);
        for (lane, corner, k) in lying.stiffened(curvature) {
            for (sum, (i, j)) in stiff[corner as usize].iter_mut().zip(PAIRS) {
                *sum += m.0[i].0[lane] * m.0[j].0[lane] * k / LANES as f32;
            }
        }
    }

    /// Costs of the positions `x`, and their gradient in the rest frame.
    #[inline(always)]
    fn ask(&self, (pack, walls): Walled<'_>, (x, g): (&[Row], &mut [Row]), work: &mut Work) {
        let wearer = &self.wearers[pack.wearer];
        let Wearer { cut, template, .. } = wearer;
        let n = cut.n_verts();
        let firmness = wearer.firmness(self.firm_at(self.now.step)) as f32;
        let membrane = laws::membrane(cut, firmness, x, g);
        let mut sums = [
            membrane,
            Lane::all(0.0),
            Lane::all(0.0),
            Lane::all(0.0),
            Lane::all(0.0),
        ];
        let wall = self.wall();
        let mut under = Lane::all(0.0);
        work.walls = vec![[0.0; 6]; n];
        work.forces = vec![[0.0; LANES]; if self.skinning.is_some() { 3 * n } else { 0 }];
        for lying in &walls.others {
            let [energy, curvature] = lying.push(&wall, x, g);
            sums[3] += energy;
            self.stiffen((pack, lying), curvature, &mut work.walls);
        }
        let mut folds = pack.folds.iter().peekable();
        let mut pins = cut.pins.iter().peekable();
        for v in 0..n {
            let here = Vec3::of(x, v as u32);
            let (bend, mut force) = laws::bending(cut, x, v);
            // The pull is the gradient of the bending energy with the sign of Q's rows.
            sums[1] += bend;
            force += Vec3::of(g, v as u32);
            let weight = cut.mass[v] * laws::G;
            force.0[1] += Lane::all(weight);
            sums[2] += here.0[1] * weight;
            let a = skin::blend(&self.skin, v, &pack.bones);
            let mut stiff = work.walls[v];
            let mut push = |plane: &[Row; 4], force: &mut Vec3| {
                let normal = Vec3([Lane(plane[0]), Lane(plane[1]), Lane(plane[2])]);
                let gap = normal.dot(here) - Lane(plane[3]);
                let [energy, slope, curvature] = wall.at(gap);
                sums[3] += energy;
                *force += normal.times(slope);
                let m = skin::bring_back(&a, normal);
                add_stiffness(&mut stiff, m, curvature);
                gap
            };
            let gap = push(&walls.skin[v], &mut force);
            under += gap.choose_below(0.0, 1.0, 0.0);
            if let Some(fold) = folds.next_if(|f| f.0 as usize == v) {
                push(&fold.1, &mut force);
            }
            work.walls[v] = stiff;
            if pins.next_if_eq(&&(v as u32)).is_some() {
                let t = template[v];
                let held = skin::carry(&a, Vec3(t.map(Lane::all)));
                let off = here - held;
                sums[4] += off.dot(off) * (0.5 * PIN);
                force += off * PIN;
            }
            if self.skinning.is_some() {
                force.put(&mut work.forces, v as u32);
            }
            skin::bring_back(&a, force).put(g, v as u32);
        }
        let mean = |s: Lane| s.sum() / LANES as f64;
        work.energies = Energies {
            membrane: mean(sums[0]),
            bend: mean(sums[1]),
            weight: mean(sums[2]),
            contact: mean(sums[3]),
            pins: mean(sums[4]),
            inertia: 0.0,
        };
        let hard = sums[0] + sums[3];
        work.counts = hard.0.map(|e| {
            (self.plan.fair as f32 / e.max(1e-9))
                .min(1.0)
                .powf(self.plan.fairness)
        });
        work.under = mean(under) / n as f64;
        work.broken = broken(g);
    }
}

/// Adds the mean stiffness of walls with these normals and curvatures [N/m].
#[inline(always)]
fn add_stiffness(stiff: &mut [f32; 6], m: Vec3, curvature: Lane) {
    for (sum, (i, j)) in stiff.iter_mut().zip(PAIRS) {
        let k = m.0[i] * m.0[j] * curvature;
        *sum += k.0.iter().sum::<f32>() / LANES as f32;
    }
}

/// The first vertex whose gradient is not finite.
fn broken(g: &[Row]) -> Option<usize> {
    let sound = |row: &Row| row.iter().all(|x| x.is_finite());
    g.iter().position(|row| !sound(row)).map(|at| at / 3)
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use muslin_model::Skin;

    use super::*;
    use crate::testing::{Class, Other, USUAL, go_on_alike};
    use crate::{Plan, TrainError, Training};

    static CLASS: LazyLock<Class> = LazyLock::new(Class::new);
    static OUTFIT: LazyLock<Class> = LazyLock::new(Class::outfit);

    /// The cost of a pack whose walls are known.
    fn cost(trainer: &Trainer, pack: &Pack) -> f64 {
        trainer.work(&mut pack.clone()).energies.total()
    }

    #[test]
    fn the_gradients_are_those_of_the_cost_in_shapes_and_in_the_network() {
        gradients(CLASS.trainer(), 0);
        let other = Other::new(&CLASS);
        gradients(CLASS.taught(other.lessons(&CLASS)), 1);
        gradients(OUTFIT.trainer(), 0);
    }

    fn binding() -> Trainer<'static> {
        let plan = Plan {
            skinning: true,
            ..CLASS.trainer().plan
        };
        Trainer::new(vec![CLASS.lesson()], plan, CLASS.poses.clone()).expect("enough poses")
    }

    #[test]
    fn skin_weights_that_are_learnt_have_the_slopes_of_the_cost_and_go_on_to_the_same_bits() {
        let mut trainer = binding();
        let before = trainer.skin.clone();
        while trainer.steps() < 3 {
            trainer.step().expect("finite");
        }
        // Of the bones that moved each vertex before, and of no vertex that bones hold.
        assert_eq!(trainer.skin.bones, before.bones);
        let row = |s: &Skin, v: u32| s.row(v as usize).map(|e| e.1).collect::<Vec<_>>();
        for v in 0..before.n_verts() as u32 {
            let [was, is] = [&before, &trainer.skin].map(|s| row(s, v));
            let off = was.iter().zip(&is).map(|(a, b)| (a - b).abs());
            let off = off.fold(0.0, f32::max);
            let is_held = CLASS.cloth.pins.contains(&v);
            assert!(was.len() == 1 || is_held == (off < 1e-6), "{v}: {off}");
        }
        let mut again = binding();
        again
            .restore(&trainer.keep().expect("on cores"))
            .expect("of the same training");
        assert!(again.skin == trainer.skin);
        go_on_alike([&mut trainer, &mut again], 5);
        let model = trainer.model(Default::default()).expect("on cores");
        assert_eq!(model.check(), Ok(()));
        assert!(model.skin == trainer.skin && model.params.len() == trainer.encoder.n_params());
        gradients(binding(), 0);
    }

    /// What the slope of a pack's cost says of garments that push each other, with and without.
    #[test]
    fn garments_over_others_push_them_and_are_pushed_and_no_force_is_lost() {
        let mut trainer = OUTFIT.trainer();
        trainer.step().expect("finite");
        // Nothing else is to push: no weight, no stretch, no bending, no pins.
        let cut = &mut trainer.wearers[0].cut;
        cut.mass.fill(0.0);
        cut.patches.clear();
        cut.bend.clear();
        cut.bend_starts.fill(0);
        cut.pins.clear();
        trainer.plan.fair = f64::INFINITY;
        let mut pack = trainer.now.packs[0].clone();
        pack.visits = 0;
        let with = trainer.work(&mut pack.clone());
        let layers = std::mem::take(&mut trainer.wearers[0].layers);
        assert_eq!(layers.len(), 2);
        let without = trainer.work(&mut pack);
        let contact = [&with, &without].map(|w| w.energies.contact);
        assert!(contact[0] > 1.5 * contact[1], "{contact:?}");
        // A constant code's slope is the mean force in the rest frame: what one garment feels of the other, both feel.
        let k = trainer.plan.codes;
        let n = OUTFIT.template.len();
        let force = |work: &Work, half: usize| -> f32 {
            let rows = half * 3 * n / 2..(half + 1) * 3 * n / 2;
            rows.map(|r| work.d_modes[r * k + k - 1].abs()).sum()
        };
        let felt = [0, 1].map(|half| force(&with, half) - force(&without, half));
        assert!(felt.iter().all(|f| *f > 0.0), "{felt:?}");
        assert!((felt[0] / felt[1] - 1.0).abs() < 0.2, "{felt:?}");
        // Both are stiffer against it.
        let stiff = |work: &Work, half: usize| -> f32 {
            let own = &work.walls[half * n / 2..(half + 1) * n / 2];
            own.iter().map(|w| w[0] + w[1] + w[2]).sum()
        };
        for half in [0, 1] {
            assert!(stiff(&with, half) > stiff(&without, half));
        }
    }

    #[test]
    fn an_outer_shirt_learns_to_lie_outside_and_goes_on_to_the_same_bits() {
        let mut trainer = OUTFIT.trainer();
        while trainer.steps() < 20 {
            trainer.step().expect("finite");
        }
        let mut again = OUTFIT.trainer();
        again
            .restore(&trainer.keep().expect("on cores"))
            .expect("of the same training");
        go_on_alike([&mut trainer, &mut again], 24);
        // What learnt without minding it lies in the shirt below.
        let mut heedless = OUTFIT.trainer();
        let layers = std::mem::take(&mut heedless.wearers[0].layers);
        for trainer in [&mut trainer, &mut heedless] {
            while trainer.steps() < 40 {
                trainer.step().expect("finite");
            }
        }
        heedless.wearers[0].layers = layers;
        let contact = [trainer, heedless]
            .map(|t| t.judge(&OUTFIT.wave()).expect("on cores").energies.contact);
        assert!(contact[0] < 0.5 * contact[1], "{contact:?}");
    }

    #[test]
    fn poses_are_told_inexactly_in_every_step_anew_and_traits_as_they_are() {
        let other = Other::new(&CLASS);
        let mut trainer = CLASS.taught(other.lessons(&CLASS));
        trainer.step().expect("finite");
        let mut pack = trainer.now.packs[0].clone();
        let told = pack.inputs.clone();
        let clear = trainer.work(&mut pack.clone());
        let mut blurred = || trainer.blurred(&mut pack).codes;
        let (a, again) = (blurred(), blurred());
        assert_eq!(a, again, "as after a stop in this step");
        assert_eq!(pack.inputs, told);
        let off =
            |a: &[f32], b: &[f32]| -> f32 { a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum() };
        assert!(off(&a, &clear.codes) > 0.0);
        trainer.step().expect("finite");
        trainer.now.params.fill(0.0);
        // A network that hears traits alone hears nothing else in the next step.
        let first = trainer.encoder.widths[1];
        let inputs = trainer.encoder.widths[0];
        let traits = trainer.wearers[0].lesson.traits.len();
        assert!(traits > 0);
        for o in 0..first {
            for i in inputs - traits..inputs {
                trainer.now.params[o * inputs + i] = 0.1 * (o + i) as f32;
            }
        }
        let alike = trainer.work(&mut pack.clone()).codes;
        assert_eq!(trainer.blurred(&mut pack).codes, alike);
    }

    #[test]
    fn hard_poses_count_for_less_and_as_steeply_as_is_asked() {
        let mut trainer = CLASS.trainer();
        trainer.step().expect("finite");
        let pack = trainer.now.packs[0].clone();
        let mut counts = |fairness: f32| {
            trainer.plan.fairness = fairness;
            trainer.work(&mut pack.clone()).counts
        };
        let (once, twice, alike) = (counts(1.0), counts(2.0), counts(0.0));
        assert_eq!(alike, [1.0; LANES]);
        assert!(once.iter().any(|c| *c < 0.5), "{once:?}");
        for (a, b) in once.iter().zip(&twice) {
            assert!((a * a - b).abs() <= 1e-4 * b, "{a} {b}");
        }
    }

    /// The gradients of a pack of the wearer of that number.
    fn gradients(mut trainer: Trainer, wearer: usize) {
        trainer.plan.fair = f64::INFINITY;
        for _ in 0..4 {
            trainer.step().expect("finite");
        }
        let own = |p: &&Pack| p.wearer == wearer;
        let mut pack = trainer
            .now
            .packs
            .iter()
            .find(own)
            .expect("one each")
            .clone();
        pack.visits = 0;
        trainer.work(&mut pack);
        // Between two looks.
        pack.visits = 3;
        let work = trainer.work(&mut pack.clone());
        let n = trainer.encoder.n_params();
        let last = if trainer.skinning.is_some() { 3 } else { 2 };
        for which in 0..last {
            let (first, gradient) = match which {
                0 => (0, &work.d_modes),
                1 => (0, &work.d_params),
                _ => (n, &work.d_skinning),
            };
            let norm = gradient
                .iter()
                .map(|g| f64::from(*g).powi(2))
                .sum::<f64>()
                .sqrt();
            let step = 2e-3 / norm;
            let mut at = |sign: f64| {
                let now = if which == 0 {
                    &mut trainer.now.modes
                } else {
                    &mut trainer.now.params
                };
                let old = now.clone();
                now[first..]
                    .iter_mut()
                    .zip(gradient)
                    .for_each(|(m, g)| *m += (sign * step * f64::from(*g)) as f32);
                trainer.bind();
                let cost = cost(&trainer, &pack);
                if which == 0 {
                    trainer.now.modes = old
                } else {
                    trainer.now.params = old
                }
                trainer.bind();
                cost
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            assert!(
                (slope / (norm * norm) - 1.0).abs() < 0.02,
                "{which}: {slope} against {}",
                norm * norm
            );
        }
    }

    #[test]
    fn wearers_share_the_poses_and_the_model_is_of_the_first_and_told_of_all() {
        let other = Other::new(&CLASS);
        let mut trainer = CLASS.taught(other.lessons(&CLASS));
        let of = |k: usize| trainer.now.packs.iter().filter(|p| p.wearer == k).count();
        assert!(
            of(0).abs_diff(of(1)) <= 1 && of(1) > 0,
            "{} {}",
            of(0),
            of(1)
        );
        while trainer.steps() < 3 {
            trainer.step().expect("finite");
        }
        let kept = trainer.keep().expect("on cores");
        let mut again = CLASS.taught(other.lessons(&CLASS));
        again.restore(&kept).expect("of the same training");
        go_on_alike([&mut trainer, &mut again], 5);
        let mut changed = other.lessons(&CLASS);
        changed[1].traits = &USUAL;
        let foreign = CLASS.taught(changed).restore(&kept);
        assert!(
            matches!(foreign, Err(TrainError::OtherTraining(_))),
            "{foreign:?}"
        );
        let model = trainer.model(Default::default()).expect("on cores");
        assert_eq!(model.check(), Ok(()));
        assert_eq!(model.template.len(), CLASS.template.len());
        let first = CLASS.template[0].as_vec3().to_array();
        assert_eq!(model.template[0], first);
        let bend = &model.traits[0];
        assert_eq!((bend.name.as_str(), bend.value), ("ln_bend", -11.5));
        assert_eq!(bend.range, [-11.5, -9.2]);
    }

    #[test]
    fn lessons_of_other_cloth_or_other_traits_are_refused_by_name() {
        let other = Other::new(&CLASS);
        let mut lessons = other.lessons(&CLASS);
        lessons[1].traits = &[];
        let plan = crate::Plan::default();
        let told = |lessons| match Trainer::new(lessons, plan.clone(), CLASS.poses.clone()) {
            Err(e) => e.to_string(),
            Ok(_) => String::new(),
        };
        assert!(told(lessons).contains("traits"));
        let mut cloth = other.cloth.clone();
        cloth.pins = vec![1];
        let mut lessons = other.lessons(&CLASS);
        lessons[1].cloth = &cloth;
        assert!(told(lessons).contains("pins"));
        assert!(told(Vec::new()).contains("none"));
    }

    #[test]
    fn what_is_not_a_number_is_skipped_a_few_times_and_then_named() {
        let mut trainer = CLASS.trainer();
        trainer.step().expect("finite");
        let sound = trainer.keep().expect("on cores");
        trainer.now.modes[5 * 3 * 8] = f32::NAN;
        let before = trainer.now.params.clone();
        let mut fault = None;
        for _ in 0..10 {
            if let Err(e) = trainer.step() {
                fault = Some(e);
                break;
            }
            assert_eq!(
                trainer.now.params, before,
                "nothing is learnt from such a batch"
            );
        }
        assert!(
            matches!(fault, Some(TrainError::NotFinite { vertex, .. }) if vertex <= 6),
            "{fault:?}"
        );
        // Back where it was sound, it goes on with its poses in another order.
        let mut as_before = CLASS.trainer();
        as_before.restore(&sound).expect("of the same training");
        let other = crate::in_another_order(sound, 1).expect("a training");
        trainer.restore(&other).expect("of the same training");
        assert_eq!((trainer.steps(), trainer.now.bad), (1, 0));
        for t in [&mut trainer, &mut as_before] {
            t.step().expect("finite");
        }
        assert!(trainer.now.modes.iter().all(|m| m.is_finite()));
        assert_ne!(trainer.now.queue, as_before.now.queue);
    }

    #[test]
    fn a_resumed_training_gives_the_bits_of_an_unbroken_one_on_any_number_of_threads() {
        let run = |threads: usize, stop: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads").install(|| {
                let mut trainer = CLASS.trainer();
                while trainer.steps() < stop {
                    trainer.step().expect("finite");
                }
                let kept = trainer.keep().expect("on cores");
                let mut again = CLASS.trainer();
                again.restore(&kept).expect("of the same training");
                while again.steps() < 6 {
                    again.step().expect("finite");
                }
                again.keep().expect("on cores")
            })
        };
        let whole = run(1, 6);
        assert!(run(3, 0) == whole && run(2, 3) == whole);
        let mut other = whole.clone();
        other.notes.insert("identity".into(), "another".into());
        assert!(CLASS.trainer().restore(&other).is_err());
    }

    #[test]
    fn forty_steps_lower_the_cost_and_bring_the_cloth_out_of_the_body() {
        let mut trainer = CLASS.trainer();
        let wave = CLASS.wave();
        let first = trainer.judge(&wave).expect("on cores");
        let mut told = Vec::new();
        while trainer.steps() < 40 {
            told.push(trainer.step().expect("finite"));
        }
        let last = trainer.judge(&wave).expect("on cores");
        // A motion that is too short to fill a pack is judged by what it has.
        let mut short = wave.clone();
        short.poses.truncate(3);
        let few = trainer.judge(&short).expect("three poses");
        assert!(few.energies.membrane > 0.0, "{few:?}");
        short.poses.clear();
        assert!(trainer.judge(&short).is_err());
        let excess = |t: &crate::Told| t.energies.membrane + t.energies.contact;
        assert!(excess(&last) < 0.35 * excess(&first), "{first:?} {last:?}");
        assert!(last.under < 0.2 * first.under, "{first:?} {last:?}");
        assert_eq!(
            trainer.model(Default::default()).expect("on cores").check(),
            Ok(())
        );
    }
}
