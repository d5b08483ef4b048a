//! Flesh that gives way over a whole motion: dents that grow and fade, never jump.

use glam::DVec3;

use crate::{
    cloth::SimError,
    relief::{Flesh, Frame, within},
    simulate::Walk,
};

/// Time from one look at how the body folds into itself to the next [s].
const STRIDE: f64 = 0.27;
/// Skin that has drawn back by less counts as where it was posed [m].
const DRAWN: f64 = 2e-4;
/// Skin this near to what cloth is worn on gives way too [m].
pub(crate) const AROUND: f64 = 0.03;

/// Where every vertex of the skin has drawn back to from where it was posed [m], at two looks.
pub(crate) struct Dents<'a> {
    walk: &'a Walk<'a>,
    flesh: Flesh,
    worn_on: Vec<bool>,
    room: f64,
    /// Frames from one look to the next.
    stride: usize,
    looks: [(usize, Vec<DVec3>); 2],
}

impl<'a> Dents<'a> {
    pub fn new(walk: &'a Walk<'a>, worn_on: Vec<bool>, room: f64) -> Dents<'a> {
        let nothing = || (usize::MAX, Vec::new());
        Dents {
            flesh: Flesh::new(walk.rest, walk.faces),
            walk,
            worn_on,
            room,
            stride: ((STRIDE * walk.fps).round() as usize).max(1),
            looks: [nothing(), nothing()],
        }
    }

    /// The body in a frame, drawn back where it would press on itself.
    pub fn frame(&mut self, k: usize) -> Result<Frame, SimError> {
        let (from, to) = self.around(k);
        let mut body = (self.walk.at)(k);
        body.check(self.walk.rest.len())?;
        if self.looks[0].0 != from {
            self.looks.swap(0, 1);
        }
        for (slot, at) in [(0, from), (1, to)] {
            if self.looks[slot].0 != at {
                self.looks[slot] = (at, self.look(at));
            }
        }
        let t = (k - from) as f64 / (to - from).max(1) as f64;
        let [(_, a), (_, b)] = &self.looks;
        for ((p, a), b) in body.skin.iter_mut().zip(a).zip(b) {
            *p += a.lerp(*b, t);
        }
        Ok(body)
    }

    /// How far the skin has drawn back at most in a frame asked for last [m].
    pub fn depth(&self, k: usize) -> f64 {
        let (from, to) = self.around(k);
        let t = (k - from) as f64 / (to - from).max(1) as f64;
        let [(_, a), (_, b)] = &self.looks;
        let depth = a.iter().zip(b).map(|(a, b)| a.lerp(*b, t).length());
        depth.fold(0.0, f64::max)
    }

    /// Where the skin has drawn back from other skin in a frame asked for last: cloth that is caught there
    /// is free to slide out, for the flesh that holds it is not really where it was posed.
    pub fn slick(&self, k: usize) -> Vec<bool> {
        let (from, to) = self.around(k);
        let t = (k - from) as f64 / (to - from).max(1) as f64;
        let [(_, a), (_, b)] = &self.looks;
        let drawn = a.iter().zip(b).map(|(a, b)| a.lerp(*b, t).length() > DRAWN);
        drawn.collect()
    }

    fn around(&self, k: usize) -> (usize, usize) {
        let from = k / self.stride * self.stride;
        (
            from,
            (from + self.stride).min(self.walk.frames - 1).max(from),
        )
    }

    fn look(&self, k: usize) -> Vec<DVec3> {
        let body = (self.walk.at)(k);
        let wanted = within(&body.skin, &self.worn_on, AROUND);
        let relief = self.flesh.relieve(&body, self.room, &wanted);
        let pairs = relief.verts.iter().zip(&body.skin);
        pairs.map(|(a, b)| *a - *b).collect()
    }
}
