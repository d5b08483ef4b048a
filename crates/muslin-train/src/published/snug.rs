//! SNUG's recurrent layers over a window, and the way back through time.

use muslin_model::Snug;
use muslin_net::learn::GruTape;

use crate::lanes::LANES;

/// What a forward pass leaves: for every pose every layer's.
pub(crate) struct SnugTape(Vec<Vec<GruTape>>);

impl SnugTape {
    /// The last layer's state (size × lanes) at every pose. Layers start from `states`, or from
    /// zero where there are none.
    pub fn forward(
        net: &Snug,
        params: &[f32],
        (told, states): (&[Vec<f32>], &[Vec<f32>]),
    ) -> (Vec<Vec<f32>>, Self) {
        let mut now: Vec<Vec<f32>> = match states.is_empty() {
            true => (net.layers()).map(|l| vec![0.0; l.size * LANES]).collect(),
            false => states.to_vec(),
        };
        let (mut codes, mut tapes) = (Vec::new(), Vec::new());
        for told in told {
            let (mut x, mut at, mut own) = (told.clone(), 0, Vec::new());
            for (layer, h) in net.layers().zip(&mut now) {
                let span = at..at + layer.n_params();
                at = span.end;
                let mut next = vec![0.0; h.len()];
                let mut tape = GruTape::default();
                layer.forward(&params[span], (&x, h, LANES), (&mut next, &mut tape));
                own.push(tape);
                h.clone_from(&next);
                x = next;
            }
            codes.push(x);
            tapes.push(own);
        }
        (codes, Self(tapes))
    }

    /// From `∂/∂codes` of every pose adds to `∂/∂params`.
    pub fn backward(
        &self,
        (net, params): (&Snug, &[f32]),
        d_codes: &[Vec<f32>],
        d_params: &mut [f32],
    ) {
        let mut later: Vec<Vec<f32>> = (net.layers()).map(|l| vec![0.0; l.size * LANES]).collect();
        for (tapes, d) in self.0.iter().zip(d_codes).rev() {
            let (mut above, mut end) = (d.clone(), params.len());
            let layers: Vec<_> = net.layers().enumerate().collect();
            for (k, layer) in layers.into_iter().rev() {
                let span = end - layer.n_params()..end;
                end = span.start;
                above.iter_mut().zip(&later[k]).for_each(|(a, b)| *a += b);
                let mut dx = vec![0.0; layer.inputs * LANES];
                layer.backward(
                    &params[span.clone()],
                    (&tapes[k], &above),
                    &mut d_params[span],
                    (&mut dx, &mut later[k]),
                );
                above = dx;
            }
        }
    }
}
