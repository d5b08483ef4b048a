//! What cloth does beyond where a body that stands still in each pose would leave it: its dynamic content.

use glam::{DMat3, DVec3};
use muslin_geom::vertex_normals;
use muslin_io::Clip;

use super::frame::sound;
use super::same_cloth;
use crate::failure::Failure;

/// The same cloth in the same motion without swing.
pub(super) struct Still {
    clip: Clip,
    /// Which of its frames are finite.
    sound: Vec<bool>,
    /// What the cloth itself does beyond it, as [`Still::content`] tells it.
    pub own: [f64; 2],
}

impl Still {
    /// `still`: of the same cloth and motion as `clip`.
    pub fn of(clip: &Clip, still: Clip) -> Result<Self, Failure> {
        same_cloth(clip, &still, "--still")?;
        let mut out = Self {
            sound: sound(&still),
            clip: still,
            own: [f64::NAN; 2],
        };
        out.own = out.content(&clip.drape.frames);
        Ok(out)
    }

    /// How much cloth at `x` [m] does, frame after frame, that is not in the still one: its dynamic content, and its
    /// swing, without what never changes [mm].
    pub fn content(&self, x: &[Vec<DVec3>]) -> [f64; 2] {
        let drape = &self.clip.drape;
        let finite = |t: &usize| self.sound[*t] && x[*t].iter().all(|p| p.is_finite());
        let seen = |t: usize| {
            let still = &drape.frames[t];
            apart(&x[t], still, &frames(still, &drape.faces))
        };
        let all: Vec<Vec<DVec3>> = (0..x.len()).filter(finite).map(seen).collect();
        // Turns change no length.
        let whole = content(&all);
        [whole, content(&without_mean(all))].map(|c| 1000.0 * c)
    }
}

/// A frame for each vertex that turns with the cloth around it: its normal, and the way to a corner beside it.
fn frames(x: &[DVec3], faces: &[[u32; 3]]) -> Vec<DMat3> {
    let mut out = vec![DMat3::IDENTITY; x.len()];
    let mut known = vec![false; x.len()];
    let normals = vertex_normals(x, faces);
    for f in faces {
        for k in 0..3 {
            let [v, w] = [f[k], f[(k + 1) % 3]].map(|i| i as usize);
            let n = normals[v].normalize_or_zero();
            let along = (x[w] - x[v]).reject_from(n).normalize_or_zero();
            if !known[v] && along != DVec3::ZERO {
                known[v] = true;
                out[v] = DMat3::from_cols(n, along, n.cross(along));
            }
        }
    }
    out
}

/// Of every vertex and frame, what it does beyond `still`, as seen from its frame in `turns`, less the mean over time.
pub(crate) fn beyond(
    x: &[Vec<DVec3>],
    still: &[Vec<DVec3>],
    turns: &[Vec<DMat3>],
) -> Vec<Vec<DVec3>> {
    let frames = x.iter().zip(still).zip(turns);
    without_mean(frames.map(|((x, y), turns)| apart(x, y, turns)).collect())
}

/// What one frame does beyond another, as seen from that one's own turns.
fn apart(x: &[DVec3], still: &[DVec3], turns: &[DMat3]) -> Vec<DVec3> {
    let each = x.iter().zip(still).zip(turns);
    each.map(|((x, y), turn)| turn.transpose() * (*x - *y))
        .collect()
}

fn without_mean(mut x: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    let n = x.len() as f64;
    for v in 0..x.first().map_or(0, Vec::len) {
        let mean = x.iter().map(|f| f[v]).sum::<DVec3>() / n;
        x.iter_mut().for_each(|f| f[v] -= mean);
    }
    x
}

fn dot(a: &[Vec<DVec3>], b: &[Vec<DVec3>]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.map(|(a, b)| a.dot(*b)).sum()
}

/// Root mean square [m].
pub(crate) fn content(x: &[Vec<DVec3>]) -> f64 {
    (dot(x, x) / x.iter().map(Vec::len).sum::<usize>().max(1) as f64).sqrt()
}

/// Cosine of the angle between two motions: 1 where one is a multiple of the other.
pub(crate) fn alike(a: &[Vec<DVec3>], b: &[Vec<DVec3>]) -> f64 {
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_never_changes_and_what_turns_with_the_bones_is_no_swing() {
        let turn = |k: usize| DMat3::from_rotation_y(0.3 * k as f64);
        let turns: Vec<Vec<DMat3>> = (0..8).map(|k| vec![turn(k)]).collect();
        let still: Vec<Vec<DVec3>> = (0..8).map(|k| vec![turn(k) * DVec3::X]).collect();
        let off = |k: usize, swing: f64| {
            let own = DVec3::new(
                1.1,
                0.0,
                swing * if k.is_multiple_of(2) { 1.0 } else { -1.0 },
            );
            vec![turn(k) * own]
        };
        let film = |swing: f64| (0..8).map(|k| off(k, swing)).collect::<Vec<_>>();
        let [none, some, more] = [0.0, 0.02, 0.05].map(|s| beyond(&film(s), &still, &turns));
        assert!(content(&none) < 1e-12);
        assert!((content(&some) - 0.02).abs() < 1e-12);
        assert!((alike(&some, &more) - 1.0).abs() < 1e-12);
    }
}
