//! The frames so far, as they are kept on disk to go on from.

use glam::DVec3;
use muslin_sim::State;

use crate::anew::Solved;

/// What the simulator says of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// How far the skin drew back at most [m].
    pub yielded: f64,
    /// Pairs of cloth and body triangles that meet.
    pub body_intersections: f64,
    /// Steps that the frame took.
    pub steps: f64,
    /// How long it took [s].
    pub seconds: f64,
}

/// Frames in order. Positions are of single precision, as files hold them, so that frames that come
/// back from the disk are the same bits as those that never left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reel {
    /// Cloth [m].
    pub cloth: Vec<Vec<DVec3>>,
    /// The skin it lies on [m].
    pub body: Vec<Vec<DVec3>>,
    /// What was told of each.
    pub told: Vec<Told>,
    /// How many were reached once more, which is not kept on disk.
    pub again: usize,
}

impl FromIterator<Solved> for Reel {
    fn from_iter<I: IntoIterator<Item = Solved>>(frames: I) -> Self {
        let mut reel = Self::default();
        for s in frames {
            reel.again += usize::from(s.again);
            reel.push(&s.cloth, &s.body, s.told);
        }
        reel
    }
}

impl Reel {
    /// How many frames there are.
    pub fn len(&self) -> usize {
        self.told.len()
    }

    /// Adds a frame.
    pub fn push(&mut self, cloth: &[DVec3], body: &[DVec3], told: Told) {
        let single = |list: &[DVec3]| list.iter().map(|v| v.as_vec3().as_dvec3()).collect();
        self.cloth.push(single(cloth));
        self.body.push(single(body));
        self.told.push(told);
    }

    /// Every frame on its own. Whether cloth crosses itself is not known here: a frame's faults are those with the body.
    pub fn into_frames(self) -> impl Iterator<Item = Solved> {
        let frames = self.cloth.into_iter().zip(self.body).zip(self.told);
        frames.map(|((cloth, body), told)| Solved {
            faults: told.body_intersections as usize,
            cloth,
            body,
            told,
            again: false,
        })
    }

    /// The frames from number `first` on, and where to go on from after them.
    pub fn record(&self, first: usize, state: Option<&State>) -> Vec<u8> {
        let mut out = Vec::new();
        number(&mut out, (self.len() - first) as f64);
        for i in first..self.len() {
            let t = self.told[i];
            [t.yielded, t.body_intersections, t.steps, t.seconds]
                .iter()
                .for_each(|x| number(&mut out, *x));
            let points = self.cloth[i].iter().chain(&self.body[i]);
            let singles = points.flat_map(|v| v.as_vec3().to_array());
            singles.for_each(|x| out.extend(x.to_le_bytes()));
        }
        number(&mut out, state.map_or(-1.0, |s| s.frame as f64));
        if let Some(s) = state {
            let points = s.verts.iter().chain(&s.velocities);
            points
                .flat_map(|v| v.to_array())
                .chain(s.pressed.iter().chain(&s.pushed).copied())
                .for_each(|x| number(&mut out, x));
        }
        out
    }

    /// Adds the frames of a [`record`](Self::record) of `n_verts` of cloth and of body, and gives
    /// the state after them; none if the bytes are not of that kind.
    pub fn read(&mut self, mut bytes: &[u8], n_verts: [usize; 2]) -> Option<Option<State>> {
        let from = &mut bytes;
        for _ in 0..count(from)? {
            let told = [take(from)?, take(from)?, take(from)?, take(from)?];
            let [cloth, body] = [singles(from, n_verts[0])?, singles(from, n_verts[1])?];
            self.cloth.push(cloth);
            self.body.push(body);
            self.told.push(Told {
                yielded: told[0],
                body_intersections: told[1],
                steps: told[2],
                seconds: told[3],
            });
        }
        let frame = take(from)?;
        let state = match frame >= 0.0 {
            true => Some(State {
                frame: frame as usize,
                verts: doubles(from, n_verts[0])?,
                velocities: doubles(from, n_verts[0])?,
                pressed: numbers_if_any(from, n_verts[0])?,
                pushed: numbers_if_any(from, n_verts[0])?,
            }),
            false => None,
        };
        from.is_empty().then_some(state)
    }
}

fn number(out: &mut Vec<u8>, x: f64) {
    out.extend(x.to_le_bytes());
}

fn take(from: &mut &[u8]) -> Option<f64> {
    let (bytes, rest) = from.split_first_chunk::<8>()?;
    *from = rest;
    Some(f64::from_le_bytes(*bytes))
}

fn count(from: &mut &[u8]) -> Option<usize> {
    take(from)
        .filter(|n| (0.0..1e9).contains(n))
        .map(|n| n as usize)
}

fn singles(from: &mut &[u8], n: usize) -> Option<Vec<DVec3>> {
    let (bytes, rest) = from.split_at_checked(n.checked_mul(12)?)?;
    *from = rest;
    let one = |b: &[u8; 4]| f64::from(f32::from_le_bytes(*b));
    let flat: Vec<f64> = bytes.as_chunks::<4>().0.iter().map(one).collect();
    Some(points(&flat))
}

fn doubles(from: &mut &[u8], n: usize) -> Option<Vec<DVec3>> {
    numbers(from, n.checked_mul(3)?).map(|flat| points(&flat))
}

fn numbers(from: &mut &[u8], n: usize) -> Option<Vec<f64>> {
    let (bytes, rest) = from.split_at_checked(n.checked_mul(8)?)?;
    *from = rest;
    let all = bytes.as_chunks::<8>().0.iter();
    Some(all.map(|b| f64::from_le_bytes(*b)).collect())
}

/// Numbers that a record ends with, unless it ended before them.
fn numbers_if_any(from: &mut &[u8], n: usize) -> Option<Vec<f64>> {
    numbers(from, if from.is_empty() { 0 } else { n })
}

fn points(flat: &[f64]) -> Vec<DVec3> {
    let chunks = flat.as_chunks::<3>().0.iter();
    chunks.map(|c| DVec3::from_array(*c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_and_state_come_back_to_the_bit_and_cut_ones_do_not() {
        let at = |k: usize, n: usize| {
            (0..n)
                .map(|i| DVec3::new(0.1, i as f64 / 3.0, k as f64))
                .collect::<Vec<_>>()
        };
        let mut reel = Reel::default();
        for k in 0..3 {
            let told = Told {
                yielded: 0.1 * k as f64,
                body_intersections: 1.0,
                steps: 4.0,
                seconds: 0.3,
            };
            reel.push(&at(k, 5), &at(k, 7), told);
        }
        let state = State {
            frame: 18,
            verts: at(3, 5),
            velocities: at(4, 5),
            pressed: vec![0.0, 0.25, 0.0, 0.5, 3.0],
            pushed: vec![0.5, 0.0, 0.125, 0.0, 1.0],
        };
        let mut back = Reel::default();
        let [early, late] = [reel.record(0, None), reel.record(2, Some(&state))];
        let mut first = Reel::default();
        assert_eq!(first.read(&early, [5, 7]), Some(None));
        assert_eq!(first, reel);
        assert_eq!(back.read(&late, [5, 7]), Some(Some(state)));
        assert_eq!((back.len(), &back.cloth[0]), (1, &reel.cloth[2]));
        assert_eq!(Reel::default().read(&late[..late.len() - 1], [5, 7]), None);
        assert_eq!(Reel::default().read(&late, [5, 8]), None);
    }
}
