//! The resizer of PBNS: how a garment lies at rest on any of its wearers, cut in any size.
//!
//! A batch is sixteen wearers at rest. Each has its own template, rest lengths and skin; shapes and network are
//! shared. Poses are then learnt from there, by the first wearer.

use muslin_body::Pose;
use muslin_model::{Resizer, Trait};
use muslin_net::learn::{Mlp, Noise, Nonlinear, Sgd, View, multiply};
use rayon::prelude::*;

use super::net::{Bent, glorot};
use super::recipe::{RESIZER, RESIZING, sizes};
use super::wearer::Wearer;
use super::work::{Met, ask, broken};
use crate::ground::Posed;
use crate::lanes::{LANES, Row, points};

/// What does not change.
pub(crate) struct Resizing {
    net: Mlp,
    /// What each wearer is told of, from -1 to 1, and their skin at rest.
    told: Vec<Vec<f32>>,
    skins: Vec<Posed>,
}

/// What changes from step to step.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Resized {
    /// The network's, then the shapes: a row for every coordinate of every vertex.
    pub params: Vec<f32>,
    pub velocity: Vec<f32>,
}

impl Resizing {
    /// For wearers who differ in their `traits`, and where its training starts: with no change.
    pub fn new(wearers: &[Wearer<'_>], traits: &[Trait], noise: &mut Noise) -> (Self, Resized) {
        let net = Mlp {
            widths: [&[traits.len()], &sizes::RESIZER[..]].concat(),
            bend: Nonlinear::Selu,
            bias: true,
        };
        let told = |w: &Wearer| {
            let own = traits.iter().zip(w.lesson.traits);
            own.map(|(t, (_, x))| t.level_of(*x as f32)).collect()
        };
        let skin = |w: &Wearer| w.body.skin(&Pose::rest(w.lesson.avatar));
        let mut params = glorot(&net, noise);
        let rows = 3 * wearers[0].template.len();
        params.resize(params.len() + rows * sizes::RESIZER[3], 0.0);
        let own = Self {
            net,
            told: wearers.iter().map(told).collect(),
            skins: wearers.par_iter().map(skin).collect(),
        };
        (
            own,
            Resized {
                params,
                velocity: Vec::new(),
            },
        )
    }

    fn split<'p>(&self, params: &'p [f32]) -> (&'p [f32], &'p [f32]) {
        params.split_at(self.net.n_params())
    }

    /// As a model keeps it.
    pub fn model(&self, now: &Resized) -> Resizer {
        let (params, modes) = self.split(&now.params);
        Resizer {
            net: self.net.clone(),
            params: params.to_vec(),
            modes: modes.to_vec(),
        }
    }

    /// Learns from sixteen `wearers` by their number; gives what they cost in the mean [J], or the first vertex that
    /// is not finite, of which nothing is learnt.
    pub fn step(
        &self,
        now: &mut Resized,
        (wearers, chosen): (&[Wearer<'_>], &[usize; LANES]),
    ) -> Result<f64, usize> {
        let (cost, slopes) = self.slopes(&now.params, (wearers, chosen))?;
        let [rate, momentum] = RESIZING;
        let sgd = Sgd {
            rate: rate * LANES as f32,
            momentum,
        };
        sgd.step(&mut now.velocity, &mut now.params, &slopes);
        Ok(cost)
    }

    /// Mean cost [J] of these wearers, and its slopes.
    pub fn slopes(
        &self,
        params: &[f32],
        (wearers, chosen): (&[Wearer<'_>], &[usize; LANES]),
    ) -> Result<(f64, Vec<f32>), usize> {
        let (network, modes) = self.split(params);
        let told = |k: usize| chosen.iter().map(move |w| self.told[*w][k]);
        let input: Vec<f32> = (0..self.net.widths[0]).flat_map(told).collect();
        let mut tape = Bent::default();
        let codes = tape.forward(&self.net, network, (&input, LANES));
        let (rows, k) = (3 * wearers[0].template.len(), codes.len() / LANES);
        let mut d = vec![[0.0f32; LANES]; rows];
        let (shapes, z) = (View::new(modes, rows, k), View::new(&codes, k, LANES));
        multiply(d.as_flattened_mut(), 0.0, shapes, z);
        if let Some(vertex) = broken(&d) {
            return Err(vertex);
        }
        let one = |lane: usize| {
            let who = chosen[lane];
            let (wearer, skin) = (&wearers[who], &self.skins[who]);
            let d: Vec<Row> = d.iter().map(|row| [row[lane]; LANES]).collect();
            let at = |(row, t): (&Row, &f32)| [row[0] + t; LANES];
            let x: Vec<Row> = d
                .iter()
                .zip(wearer.template.as_flattened())
                .map(at)
                .collect();
            let met = Met::alone(wearer, skin, &points(&x, 0));
            let mut asked = ask(&RESIZER, (&wearer.sheet, &met, false), (&x, &d));
            for (v, force) in std::mem::take(&mut asked.held) {
                force.add_to(&mut asked.g, v);
            }
            let slope: Vec<f32> = asked.g.iter().map(|row| row[0]).collect();
            (asked.energies.total(), slope)
        };
        let all: Vec<(f64, Vec<f32>)> = (0..LANES).into_par_iter().map(one).collect();
        let share = 1.0 / LANES as f32;
        let row = |i: usize| std::array::from_fn(|l| all[l].1[i] * share);
        let g: Vec<Row> = (0..rows).map(row).collect();
        if let Some(vertex) = broken(&g) {
            return Err(vertex);
        }
        let mut slopes = vec![0.0; params.len()];
        let (d_network, d_modes) = slopes.split_at_mut(network.len());
        let g = View::new(g.as_flattened(), rows, LANES);
        multiply(d_modes, 0.0, g, z.transposed());
        let mut d_codes = vec![0.0; k * LANES];
        multiply(&mut d_codes, 0.0, shapes.transposed(), g);
        tape.backward((&self.net, network), d_codes, d_network, None);
        let cost = all.iter().map(|a| a.0).sum::<f64>() / LANES as f64;
        Ok((cost, slopes))
    }

    /// Where the cloth of a wearer lies at rest [m].
    pub fn laid(&self, now: &Resized, (wearer, who): (&Wearer<'_>, usize)) -> Vec<[f32; 3]> {
        let (network, modes) = self.split(&now.params);
        let codes = Bent::default().forward(&self.net, network, (&self.told[who], 1));
        let mut out = wearer.template.clone();
        let rows = modes.chunks_exact(codes.len());
        for (x, row) in out.as_flattened_mut().iter_mut().zip(rows) {
            *x += row.iter().zip(&codes).map(|(m, z)| m * z).sum::<f32>();
        }
        out
    }
}
