//! The safe step: how far each vertex may go so that cloth does not pass through cloth.
//!
//! Every near pair is followed along its own relative motion. Where a pair would come too close, what
//! brings it there is taken from its moves, and nothing of how it slides; then all pairs are followed
//! again, until none objects. Pairs that keep objecting, and those of cloth that is to come to rest, are
//! led towards what their four vertices do in common, which never brings them together, and grow into
//! zones that move as one at last (the impact zones of Provot 1997, without their rotation).

use glam::DVec3;
use muslin_energy::proximity;
use muslin_geom::ccd::{self, Keep};
use rayon::prelude::*;

use crate::{near::Near, ordered::CHUNK};

/// Rounds of parting, of leading together, and of growing zones; then all cloth moves as one.
const PARTED: usize = 6;
const LED: usize = 6;
const ZONES: usize = 40;

/// Changes `moves` [m] from `x` [m] until no pair passes through itself; says whether it had to. Cloth that moves `slides`
/// on where it is stopped; cloth that is to come to rest does not.
pub(crate) fn make_safe(pairs: &[Near], x: &[DVec3], moves: &mut [DVec3], slides: bool) -> bool {
    let parted = if slides { PARTED } else { 0 };
    let mut zones = Zones::new(x.len());
    // A pair of which nothing changed since it was asked would say the same again; one that rests has nothing to say.
    let mut changed: Vec<bool> = moves.iter().map(|m| *m != DVec3::ZERO).collect();
    for round in 0.. {
        let objections = objections(pairs, &changed, (x, moves));
        if objections.is_empty() {
            return round > 0;
        }
        if round < parted {
            part(pairs, &objections, x, (moves, &mut changed));
        } else if round < parted + LED {
            lead(pairs, &objections, (moves, &mut changed));
        } else if round < parted + LED + ZONES {
            changed.fill(false);
            for (k, _) in objections {
                let verts = pairs[k].verts;
                verts.iter().for_each(|v| changed[*v as usize] = true);
                zones.join(verts);
            }
            zones.move_as_one(moves, &mut changed);
        } else {
            let mean = moves.iter().sum::<DVec3>() / moves.len() as f64;
            moves.fill(mean);
            return true;
        }
    }
    true
}

/// Takes from the moves of objecting pairs what brings them too close, and says who `changed`. A vertex of several does
/// what they ask for in the mean, each as far as the vertex is what comes close.
fn part(
    pairs: &[Near],
    objections: &[(usize, f64)],
    x: &[DVec3],
    (moves, changed): (&mut [DVec3], &mut [bool]),
) {
    let mut asked = vec![(DVec3::ZERO, 0.0); moves.len()];
    for &(k, t) in objections {
        let verts = pairs[k].verts;
        let way = verts.map(|v| moves[v as usize]);
        let at: [DVec3; 4] = std::array::from_fn(|i| x[verts[i] as usize] + way[i] * t);
        let weights = pairs[k].weights(&at);
        let normal = proximity::weighted(&at, &weights).normalize_or_zero();
        let closing = -normal.dot(proximity::weighted(&way, &weights));
        let size: f64 = weights.iter().map(|w| w * w).sum();
        let mean = way.iter().sum::<DVec3>() * 0.25;
        for i in 0..4 {
            // What comes close otherwise, with a corner, is led together.
            let (change, count) = match closing > 0.0 {
                true => {
                    let back = closing * (1.0 - SURE * t);
                    (normal * (weights[i] * back / size), weights[i].abs())
                }
                false => ((mean - way[i]) * (1.0 - t), 1.0),
            };
            let asked = &mut asked[verts[i] as usize];
            *asked = (asked.0 + change * count, asked.1 + count);
        }
    }
    let all = moves.iter_mut().zip(changed).zip(asked);
    for ((m, changed), (sum, count)) in all {
        *changed = count > 0.0;
        if *changed {
            *m += sum / count;
        }
    }
}

/// Share that a pair goes of the way on which it is safe: as its moves change, so does that way.
const SURE: f64 = 0.9;

/// Leads the vertices of objecting pairs towards their pair's mean move, and says who `changed`.
fn lead(
    pairs: &[Near],
    objections: &[(usize, f64)],
    (moves, changed): (&mut [DVec3], &mut [bool]),
) {
    let mut share = vec![1.0f64; moves.len()];
    let mut common = vec![(DVec3::ZERO, 0.0); moves.len()];
    for &(k, t) in objections {
        let mean = pairs[k]
            .verts
            .iter()
            .map(|&v| moves[v as usize])
            .sum::<DVec3>()
            * 0.25;
        for v in pairs[k].verts {
            let v = v as usize;
            share[v] = share[v].min(t);
            common[v] = (common[v].0 + mean, common[v].1 + 1.0);
        }
    }
    let all = moves.iter_mut().zip(changed).zip(share.iter().zip(&common));
    for ((m, changed), (t, (sum, n))) in all {
        *changed = *n > 0.0;
        if *changed {
            *m = (*sum / *n).lerp(*m, *t);
        }
    }
}

/// Sets of vertices that move as one.
struct Zones {
    parent: Vec<u32>,
}

impl Zones {
    fn new(n: usize) -> Zones {
        Zones {
            parent: (0..n as u32).collect(),
        }
    }

    fn find(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let up = self.parent[self.parent[v as usize] as usize];
            self.parent[v as usize] = up;
            v = up;
        }
        v
    }

    fn join(&mut self, verts: [u32; 4]) {
        let roots = verts.map(|v| self.find(v));
        let least = roots.into_iter().min().expect("there are four");
        roots
            .into_iter()
            .for_each(|r| self.parent[r as usize] = least);
    }

    /// Gives every vertex what its zone does, and adds whoever that is new for to the `changed`.
    fn move_as_one(&mut self, moves: &mut [DVec3], changed: &mut [bool]) {
        let mut sums = vec![(DVec3::ZERO, 0.0); moves.len()];
        for v in 0..moves.len() {
            let sum = &mut sums[self.find(v as u32) as usize];
            *sum = (sum.0 + moves[v], sum.1 + 1.0);
        }
        for v in 0..moves.len() {
            let (sum, n) = sums[self.find(v as u32) as usize];
            let before = moves[v];
            if n > 1.0 {
                moves[v] = sum / n;
            }
            changed[v] |= moves[v] != before;
        }
    }
}

/// Pairs that may not go all the way, and how far they may, of those with a vertex that has `changed`.
fn objections(
    pairs: &[Near],
    changed: &[bool],
    (x, moves): (&[DVec3], &[DVec3]),
) -> Vec<(usize, f64)> {
    let lists: Vec<Vec<(usize, f64)>> = pairs
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(c, chunk)| {
            let asked = chunk.iter().enumerate();
            let asked = asked.filter(|(_, pair)| pair.verts.iter().any(|v| changed[*v as usize]));
            let shares = asked.map(|(k, pair)| (c * CHUNK + k, share(pair, x, moves)));
            shares.filter(|(_, t)| *t < 1.0).collect()
        })
        .collect();
    lists.concat()
}

fn share(pair: &Near, x: &[DVec3], moves: &[DVec3]) -> f64 {
    let at = pair.verts.map(|v| x[v as usize]);
    let by = pair.verts.map(|v| moves[v as usize]);
    if pair.is_edges {
        ccd::edge_edge(&at, &by, Keep::CLOTH)
    } else {
        ccd::vertex_triangle(&at, &by, Keep::CLOTH)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::near::sum;

    #[test]
    fn a_blocked_vertex_still_goes_where_everybody_goes() {
        let x = [
            DVec3::Y * 0.01,
            DVec3::X,
            DVec3::Z,
            DVec3::new(-1.0, 0.0, -1.0),
        ];
        let wind = DVec3::X * 3.0;
        let mut moves = [wind - DVec3::Y * 0.05, wind, wind, wind];
        let pair = Near {
            verts: [0, 1, 2, 3],
            is_edges: false,
        };
        assert!(make_safe(&[pair], &x, &mut moves, true));
        assert!(moves.iter().all(|m| (m.x - 3.0).abs() < 1e-9), "{moves:?}");
        assert!(moves[0].y - moves[1].y > -0.01);
    }

    #[test]
    fn who_comes_too_close_slides_on_as_before() {
        // Falls on the middle of a triangle, aslant.
        let x = [
            DVec3::new(0.0, 1.4e-3, 0.0),
            DVec3::new(-0.3, 0.0, -0.3),
            DVec3::new(0.3, 0.0, -0.3),
            DVec3::new(0.0, 0.0, 0.3),
        ];
        let [none, fall] = [DVec3::ZERO, DVec3::new(2e-3, -3e-3, 0.0)];
        let pair = Near {
            verts: [0, 1, 2, 3],
            is_edges: false,
        };
        // On its way to rest it does not.
        for (slides, least, most) in [(true, 1.999e-3, 2.001e-3), (false, 0.0, 1.5e-3)] {
            let mut moves = [fall, none, none, none];
            assert!(make_safe(&[pair], &x, &mut moves, slides));
            let slid = moves[0].x - moves[1].x;
            assert!(slid > least && slid < most, "{moves:?}");
            let gap = pair.gap(&sum(&x, &moves)).0;
            assert!(gap.y > 2e-4 && gap.y < 1e-3, "{gap}");
        }
    }

    #[test]
    fn what_is_safe_in_the_end_is_safe_for_every_pair_though_few_were_asked_again() {
        // A strip of triangles falls on another at speeds that differ from vertex to vertex.
        let n = 24_u32;
        let at = |v: u32, height: f64| {
            let (a, b) = (f64::from(v / 2), f64::from(v % 2));
            DVec3::new(0.01 * a, height, 0.012 * b)
        };
        let below = (0..n).map(|v| at(v, 0.0));
        let x: Vec<DVec3> = below.chain((0..n).map(|v| at(v, 0.004))).collect();
        let vertices =
            (n..2 * n).flat_map(|v| (0..n - 2).map(move |t| ([v, t, t + 1, t + 2], false)));
        let edges =
            (n..2 * n - 1).flat_map(|e| (0..n - 1).map(move |f| ([e, e + 1, f, f + 1], true)));
        let pairs: Vec<Near> = vertices
            .chain(edges)
            .map(|(verts, is_edges)| Near { verts, is_edges })
            .collect();
        let fall = |v: u32| f64::from(v >= n) * -0.006 * (1.0 + (2.7 * f64::from(v)).sin());
        let mut moves: Vec<DVec3> = (0..2 * n)
            .map(|v| DVec3::new(1e-3 * (1.9 * f64::from(v)).cos(), fall(v), 0.0))
            .collect();
        let all = vec![true; x.len()];
        assert!(objections(&pairs, &all, (&x, &moves)).len() > 20);
        assert!(make_safe(&pairs, &x, &mut moves, true));
        assert_eq!(objections(&pairs, &all, (&x, &moves)), []);
    }
}
