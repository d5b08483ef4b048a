//! Handles from motion: who moves alike, who follows whom, and where each handle is.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rayon::prelude::*;

use crate::turn::turn_of;

/// Rounds in which vertices choose the group that moves most as they do.
const GROUPING: usize = 8;
/// Rounds of weights for handles and handles for weights.
const ROUNDS: usize = 10;
/// Sweeps in which the handles of a frame are fitted one after the other.
const SWEEPS: usize = 3;
/// Handles that a vertex may choose from, and of which it follows the best few.
const NEAR: usize = 10;
const MOST: usize = 4;

/// Vertex → (handle, weight).
pub type Weights = Vec<Vec<(u32, f64)>>;
/// Handle → (vertex, weight).
type Loads = [Vec<(u32, f64)>];
/// Vertices at rest, and their neighbours.
type Rest<'a> = (&'a [DVec3], &'a [Vec<u32>]);

/// Who follows which of `n` handles.
pub fn weights((rest, near): Rest, frames: &[&[DVec3]], n: usize) -> Weights {
    let mut group = nearest_seed(rest, n);
    let n = 1 + group.iter().max().copied().unwrap_or(0) as usize;
    for _ in 0..GROUPING {
        let lists = members(&group, n);
        let moves = of_groups(rest, frames, &lists);
        let choose = |v: usize| {
            let mut best = (off((rest, frames), &moves, (v, group[v])), group[v]);
            let mut seen = vec![group[v]];
            for j in &near[v] {
                let g = group[*j as usize];
                if !seen.contains(&g) {
                    seen.push(g);
                    best = min(best, (off((rest, frames), &moves, (v, g)), g));
                }
            }
            best.1
        };
        // A group keeps one vertex at least: that which began it may not leave.
        let chosen: Vec<u32> = (0..rest.len()).into_par_iter().map(choose).collect();
        for list in lists.iter().filter(|l| l.len() > 3) {
            list.iter()
                .for_each(|v| group[*v as usize] = chosen[*v as usize]);
        }
    }
    let lists = members(&group, n);
    let mut moves = of_groups(rest, frames, &lists);
    let centres: Vec<DVec3> = lists.iter().map(|l| middle(rest, l)).collect();
    let mut weights = Vec::new();
    for _ in 0..ROUNDS {
        let one = |v: usize| {
            let mut all: Vec<u32> = (0..n as u32).collect();
            let far = |h: &u32| centres[*h as usize].distance_squared(rest[v]);
            if n > NEAR {
                all.select_nth_unstable_by(NEAR - 1, |a, b| {
                    far(a).total_cmp(&far(b)).then(a.cmp(b))
                });
                all.truncate(NEAR);
            }
            all.sort_unstable();
            let gaps = |h: &u32| -> Vec<DVec3> {
                let gap = |t: usize| moves[t][*h as usize].transform_point3(rest[v]) - frames[t][v];
                (0..frames.len()).map(gap).collect()
            };
            let gaps: Vec<Vec<DVec3>> = all.iter().map(gaps).collect();
            let row = convex(&gaps);
            row.into_iter().map(|(k, w)| (all[k], w)).collect()
        };
        weights = (0..rest.len()).into_par_iter().map(one).collect();
        let loads = loads(&weights, n);
        (moves.par_iter_mut().zip(frames))
            .for_each(|(m, x)| fit((rest, &weights, &loads), (x, &[]), m, 1));
    }
    weights
}

/// Weights without the handles that nobody follows, and where the others rest.
pub fn used(rest: &[DVec3], mut weights: Weights) -> (Weights, Vec<DVec3>) {
    let n = 1 + weights.iter().flatten().map(|w| w.0).max().unwrap_or(0) as usize;
    let mut sums = vec![(0.0, DVec3::ZERO); n];
    for (row, x) in weights.iter().zip(rest) {
        for (h, w) in row {
            let s = &mut sums[*h as usize];
            *s = (s.0 + w, s.1 + *w * *x);
        }
    }
    let mut number = vec![u32::MAX; n];
    let mut centres = Vec::new();
    for (h, (w, sum)) in sums.iter().enumerate() {
        if *w > 0.0 {
            number[h] = centres.len() as u32;
            centres.push(*sum / *w);
        }
    }
    let rows = weights.iter_mut().flatten();
    rows.for_each(|w| w.0 = number[w.0 as usize]);
    (weights, centres)
}

/// Where the handles must be so that those who follow them come nearest to `x`.
pub fn follow(
    (rest, weights, centres): (&[DVec3], &Weights, &[DVec3]),
    x: &[DVec3],
) -> Vec<DAffine3> {
    let loads = loads(weights, centres.len());
    let begin = |load: &Vec<(u32, f64)>| {
        let list: Vec<u32> = (load.iter().filter(|l| l.1 > 0.3)).map(|l| l.0).collect();
        let all: Vec<u32> = load.iter().map(|l| l.0).collect();
        rigid(rest, x, if list.len() < 3 { &all } else { &list })
    };
    let mut moves: Vec<DAffine3> = loads.iter().map(begin).collect();
    fit((rest, weights, &loads), (x, &[]), &mut moves, 2 * SWEEPS);
    moves
}

/// Leads the handles from where they are nearer to `x`, each vertex counting as much as `pull` says.
pub fn lead(
    (rest, weights): (&[DVec3], &Weights),
    (x, pull): (&[DVec3], &[f64]),
    moves: &mut [DAffine3],
) {
    let loads = loads(weights, moves.len());
    fit((rest, weights, &loads), (x, pull), moves, SWEEPS);
}

/// Farthest points first; everybody belongs to the nearest of them.
fn nearest_seed(rest: &[DVec3], n: usize) -> Vec<u32> {
    let mut group = vec![0u32; rest.len()];
    let mut far = vec![f64::INFINITY; rest.len()];
    let mut seed = 0;
    for g in 0..n.min(rest.len()) as u32 {
        let at = rest[seed];
        for (v, x) in rest.iter().enumerate() {
            let d = x.distance_squared(at);
            if d < far[v] {
                (far[v], group[v]) = (d, g);
            }
        }
        let last = |best: usize, v: usize| if far[v] > far[best] { v } else { best };
        seed = (0..rest.len()).fold(0, last);
        if far[seed] == 0.0 {
            break;
        }
    }
    group
}

fn members(group: &[u32], n: usize) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); n];
    for (v, g) in group.iter().enumerate() {
        lists[*g as usize].push(v as u32);
    }
    lists
}

/// Frame → group: how it moves as a whole.
fn of_groups(rest: &[DVec3], frames: &[&[DVec3]], lists: &[Vec<u32>]) -> Vec<Vec<DAffine3>> {
    let frame = |x: &&[DVec3]| lists.iter().map(|l| rigid(rest, x, l)).collect();
    frames.par_iter().map(frame).collect()
}

/// How far a vertex is from where the group takes it, squares summed over the frames.
fn off(
    (rest, frames): (&[DVec3], &[&[DVec3]]),
    moves: &[Vec<DAffine3>],
    (v, group): (usize, u32),
) -> f64 {
    let gap = |(m, x): (&Vec<DAffine3>, &&[DVec3])| {
        m[group as usize]
            .transform_point3(rest[v])
            .distance_squared(x[v])
    };
    moves.iter().zip(frames).map(gap).sum()
}

fn min(a: (f64, u32), b: (f64, u32)) -> (f64, u32) {
    if b.0 < a.0 { b } else { a }
}

fn middle(x: &[DVec3], list: &[u32]) -> DVec3 {
    let sum: DVec3 = list.iter().map(|v| x[*v as usize]).sum();
    sum / list.len().max(1) as f64
}

/// The turn and way that take these vertices nearest to `x`.
fn rigid(rest: &[DVec3], x: &[DVec3], list: &[u32]) -> DAffine3 {
    let (a, b) = (middle(rest, list), middle(x, list));
    let mut s = [[0.0; 3]; 3];
    for v in list {
        add(&mut s, rest[*v as usize] - a, x[*v as usize] - b);
    }
    about(turn_of(s, DQuat::IDENTITY), a, b)
}

fn add(s: &mut [[f64; 3]; 3], a: DVec3, b: DVec3) {
    let b = b.to_array();
    for (row, a) in s.iter_mut().zip(a.to_array()) {
        (0..3).for_each(|j| row[j] += a * b[j]);
    }
}

/// The move that turns about `a` and takes it to `b`.
fn about(turn: DQuat, a: DVec3, b: DVec3) -> DAffine3 {
    let turn = DMat3::from_quat(turn);
    DAffine3 {
        matrix3: turn,
        translation: b - turn * a,
    }
}

/// Handle → (vertex, weight).
fn loads(weights: &Weights, n: usize) -> Vec<Vec<(u32, f64)>> {
    let mut out = vec![Vec::new(); n];
    for (v, row) in weights.iter().enumerate() {
        row.iter()
            .for_each(|(h, w)| out[*h as usize].push((v as u32, *w)));
    }
    out
}

/// Fits handle after handle to what the others leave of `x` (Le and Deng 2012, section 4.2); vertices count
/// as `pull` says, or alike where it is empty.
fn fit(
    (rest, weights, loads): (&[DVec3], &Weights, &Loads),
    (x, pull): (&[DVec3], &[f64]),
    moves: &mut [DAffine3],
    sweeps: usize,
) {
    let place = |moves: &[DAffine3], v: usize| -> DVec3 {
        let one = |(h, w): &(u32, f64)| *w * moves[*h as usize].transform_point3(rest[v]);
        weights[v].iter().map(one).sum()
    };
    let mut now: Vec<DVec3> = (0..rest.len()).map(|v| place(moves, v)).collect();
    for _ in 0..sweeps {
        for (h, load) in loads.iter().enumerate() {
            let old = moves[h];
            // What is left for this handle, weighed: w (w p) against w (x - the others).
            let wanted = |v: usize, w: f64| x[v] - now[v] + w * old.transform_point3(rest[v]);
            let (mut sum, mut a, mut b) = (0.0, DVec3::ZERO, DVec3::ZERO);
            let pulled = |v: usize| pull.get(v).copied().unwrap_or(1.0);
            for (v, w) in load {
                let v = *v as usize;
                let square = pulled(v) * w * w;
                sum += square;
                a += square * rest[v];
                b += pulled(v) * *w * wanted(v, *w);
            }
            if sum < 1e-9 {
                continue;
            }
            let (a, b) = (a / sum, b / sum);
            let mut s = [[0.0; 3]; 3];
            for (v, w) in load {
                let i = *v as usize;
                let a = pulled(i) * *w * (rest[i] - a);
                add(&mut s, a, wanted(i, *w) - *w * b);
            }
            let new = about(turn_of(s, DQuat::from_mat3(&old.matrix3)), a, b);
            for (v, w) in load {
                let p = rest[*v as usize];
                now[*v as usize] += *w * (new.transform_point3(p) - old.transform_point3(p));
            }
            moves[h] = new;
        }
    }
}

/// The few convex weights whose mean of gaps is least: (which, weight).
fn convex(gaps: &[Vec<DVec3>]) -> Vec<(usize, f64)> {
    let dot = |a: usize, b: usize| -> f64 {
        let pairs = gaps[a].iter().zip(&gaps[b]);
        pairs.map(|(a, b)| a.dot(*b)).sum()
    };
    let n = gaps.len();
    let mut g = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            g[i * n + j] = dot(i, j);
            g[j * n + i] = g[i * n + j];
        }
    }
    let trace: f64 = (0..n).map(|i| g[i * n + i]).sum();
    let ridge = 1e-6 * trace + 1e-18;
    let mut active: Vec<usize> = (0..n).collect();
    loop {
        let m = active.len();
        let entry =
            |r: usize, c: usize| g[active[r] * n + active[c]] + if r == c { ridge } else { 0.0 };
        let mut a: Vec<f64> = (0..m * m).map(|k| entry(k / m, k % m)).collect();
        let mut w = vec![1.0; m];
        super::shapes::solve(&mut a, &mut w);
        let sum: f64 = w.iter().sum();
        w.iter_mut().for_each(|w| *w /= sum);
        let least = (0..m).fold(0, |best, k| if w[k] < w[best] { k } else { best });
        if m > 1 && (w[least] <= 1e-4 || m > MOST) {
            active.remove(least);
            continue;
        }
        return active.into_iter().zip(w).collect();
    }
}
