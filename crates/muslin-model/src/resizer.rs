//! Where cloth lies at rest on another wearer, or cut in another size.

use muslin_net::learn::Mlp;

use crate::encoder::sound;
use crate::layers::Chain;
use crate::{Model, Trait};

/// A second network, from [`Model::traits`] to codes of shapes that are added to the template: the resizer of PBNS
/// (Bertiche et al. 2021).
#[derive(Clone, Debug, PartialEq)]
pub struct Resizer {
    /// The network, whose last layer is bent as well; it reads [`Trait::level`]s.
    pub net: Mlp,
    /// Its weights.
    pub params: Vec<f32>,
    /// Shapes [m]: for every coordinate of every vertex a row with one entry per code.
    pub modes: Vec<f32>,
}

impl Resizer {
    /// How many codes there are.
    pub fn n_codes(&self) -> usize {
        self.net.widths.last().copied().unwrap_or(0)
    }

    /// Whether it is of `n` vertices and that many traits.
    pub(crate) fn fits(&self, n: usize, traits: usize) -> bool {
        let all = [&self.params, &self.modes];
        sound(&self.net.widths)
            && self.net.widths[0] == traits
            && self.params.len() == self.net.n_params()
            && self.modes.len() == 3 * n * self.n_codes()
            && all.iter().all(|a| a.iter().all(|x| x.is_finite()))
    }

    /// What it adds to every coordinate [m].
    fn moves(&self, levels: &[f32]) -> Vec<f32> {
        let mut net = Chain::new(&self.net, &self.params, true);
        let codes = net.run(pulp::Scalar::new(), levels);
        let rows = self.modes.chunks_exact(codes.len().max(1));
        rows.map(|row| row.iter().zip(codes).map(|(m, z)| m * z).sum())
            .collect()
    }
}

impl Model {
    /// Where the cloth lies at rest before anybody moves [m]: the template, resized for what the model is told of
    /// wearer and cut.
    pub fn laid(&self) -> Vec<[f32; 3]> {
        let mut out = self.template.clone();
        if let Some(resizer) = &self.resizer {
            let levels: Vec<f32> = self.traits.iter().map(Trait::level).collect();
            let moves = resizer.moves(&levels);
            out.as_flattened_mut()
                .iter_mut()
                .zip(moves)
                .for_each(|(x, by)| *x += by);
        }
        out
    }
}
