//! SNUG's recurrent layers over a window, and the way back through time.
//!
//! Windows are three poses long, but sequences are not: a state that was never met there leads cloth anywhere. So
//! before a window the state goes through poses of the motion, from which nothing is learnt.

use muslin_model::Snug;
use muslin_net::learn::GruTape;

use crate::lanes::LANES;

/// What a forward pass leaves: for every decoded pose every layer's.
pub(crate) struct SnugTape(Vec<Vec<GruTape>>);

impl SnugTape {
    /// The last layer's state (size × lanes) at the last `decoded` poses of those `told`. Layers start from `states`,
    /// or from zero where there are none.
    pub fn forward(
        net: &Snug,
        params: &[f32],
        (told, decoded): (&[Vec<f32>], usize),
        states: &[Vec<f32>],
    ) -> (Vec<Vec<f32>>, Self) {
        let mut now: Vec<Vec<f32>> = match states.is_empty() {
            true => (net.layers()).map(|l| vec![0.0; l.size * LANES]).collect(),
            false => states.to_vec(),
        };
        let (mut codes, mut tapes) = (Vec::new(), Vec::new());
        let first = told.len() - decoded;
        for (k, told) in told.iter().enumerate() {
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
            if k >= first {
                codes.push(x);
                tapes.push(own);
            }
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

#[cfg(test)]
mod tests {
    use muslin_net::learn::Noise;

    use super::*;

    #[test]
    fn a_state_that_went_through_poses_before_is_that_of_the_whole_sequence() {
        let net = Snug {
            body: vec![0.0; 2],
            widths: vec![5, 4, 3],
        };
        let mut noise = Noise::new(2);
        let params = noise.normals(net.layers().map(|l| l.n_params()).sum());
        let told: Vec<Vec<f32>> = (0..7).map(|_| noise.normals(5 * LANES)).collect();
        let states: Vec<Vec<f32>> = (net.layers())
            .map(|l| noise.normals(l.size * LANES))
            .collect();
        let (whole, _) = SnugTape::forward(&net, &params, (&told, 7), &states);
        let (window, tape) = SnugTape::forward(&net, &params, (&told, 3), &states);
        assert_eq!(window, whole[4..]);
        assert_eq!(tape.0.len(), 3);
        let (alone, _) = SnugTape::forward(&net, &params, (&told[4..], 3), &states);
        assert!(window != alone);
    }
}
