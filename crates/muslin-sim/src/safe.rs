//! The safe step: how far each vertex may go so that cloth does not pass through cloth.
//!
//! Every near pair is followed along its own relative motion. Where a pair would come too close,
//! its four vertices are slowed, and all pairs are followed again with the slower motion, until
//! none objects. Slowing few vertices instead of the whole cloth keeps the rest moving.

use glam::DVec3;
use muslin_geom::ccd;
use rayon::prelude::*;

use crate::{near::Near, ordered::CHUNK};

/// Share of its distance that every pair keeps.
const KEEP: f64 = 0.2;
/// Rounds of slowing; after half of them whoever objects stands still.
const ROUNDS: usize = 12;

/// Shortens `moves` [m] from `x` [m] until no pair passes through itself.
pub(crate) fn slow_down(pairs: &[Near], x: &[DVec3], moves: &mut [DVec3]) {
    for round in 0.. {
        let slow = objections(pairs, x, moves);
        if slow.is_empty() {
            return;
        }
        let mut share = vec![1.0f64; x.len()];
        for (k, t) in slow {
            let t = if round < ROUNDS / 2 { t } else { 0.0 };
            for v in pairs[k].verts {
                share[v as usize] = share[v as usize].min(t);
            }
        }
        // Standing still is always safe, so that the last word ends the discussion.
        let stop = round >= ROUNDS;
        moves
            .iter_mut()
            .zip(share)
            .for_each(|(m, s)| *m *= if stop { 0.0 } else { s });
    }
}

/// Pairs that may not go all the way, and how far they may.
fn objections(pairs: &[Near], x: &[DVec3], moves: &[DVec3]) -> Vec<(usize, f64)> {
    let lists: Vec<Vec<(usize, f64)>> = pairs
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(c, chunk)| {
            let share = chunk.iter().map(|pair| share(pair, x, moves));
            let numbered = share.enumerate().filter(|(_, t)| *t < 1.0);
            numbered.map(|(k, t)| (c * CHUNK + k, t)).collect()
        })
        .collect();
    lists.concat()
}

fn share(pair: &Near, x: &[DVec3], moves: &[DVec3]) -> f64 {
    let at = pair.verts.map(|v| x[v as usize]);
    let by = pair.verts.map(|v| moves[v as usize]);
    if pair.is_edges {
        ccd::edge_edge(&at, &by, KEEP)
    } else {
        ccd::vertex_triangle(&at, &by, KEEP)
    }
}
