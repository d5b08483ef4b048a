//! Flesh that gives way over a whole motion: dents that grow and fade, never jump.

use glam::{DMat3, DVec3};
use muslin_geom::vertex_normals;

use crate::{
    cloth::SimError,
    ordered,
    relief::{Flesh, Frame, within},
    simulate::Walk,
};

/// Time from one look at how the body folds into itself to the next [s].
const STRIDE: f64 = 0.27;
/// Where skin draws back so far at either of two looks [m], so many are taken from the one to the other: a fold that deep
/// opens and shuts sooner.
const DEEP: f64 = 0.02;
const FINER: usize = 8;
/// So many looks are kept: those around a frame, around its stride, and as many for the next.
const KEPT: usize = 8;
/// Skin that has drawn back by less counts as where it was posed [m].
const DRAWN: f64 = 2e-4;
/// Skin this near to what cloth is worn on gives way too [m].
pub(crate) const AROUND: f64 = 0.03;

/// Where every vertex of the skin has drawn back to from where it was posed, at some looks: as its own skin sees it
/// [m], for a body that turns takes its dents along.
pub(crate) struct Dents<'a> {
    walk: &'a Walk<'a>,
    flesh: Flesh,
    worn_on: Vec<bool>,
    /// A neighbour of every vertex.
    beside: Vec<u32>,
    room: f64,
    /// Frames from one look to the next.
    stride: usize,
    /// The one asked for last comes last.
    looks: Vec<Look>,
}

/// How far all skin has drawn back in a frame.
struct Look {
    frame: usize,
    drawn: Vec<DVec3>,
    /// The farthest [m].
    deepest: f64,
}

impl<'a> Dents<'a> {
    pub fn new(walk: &'a Walk<'a>, worn_on: Vec<bool>, room: f64) -> Dents<'a> {
        let mut beside: Vec<u32> = (0..walk.rest.len() as u32).collect();
        for &[a, b, c] in walk.faces {
            for (v, next) in [(a, b), (b, c), (c, a)] {
                beside[v as usize] = next;
            }
        }
        Dents {
            flesh: Flesh::new(walk.rest, walk.faces),
            walk,
            worn_on,
            beside,
            room,
            stride: ((STRIDE * walk.fps).round() as usize).max(1),
            looks: Vec::new(),
        }
    }

    /// The body in a frame, drawn back where it would press on itself.
    pub fn frame(&mut self, k: usize) -> Result<Frame, SimError> {
        let body = (self.walk.at)(k);
        body.check(self.walk.rest.len())?;
        let (from, to) = self.stride(k);
        [from, to].into_iter().for_each(|at| self.take(at));
        let (from, to) = self.around(k);
        [from, to].into_iter().for_each(|at| self.take(at));
        if self.at(from).deepest == 0.0 && self.at(to).deepest == 0.0 {
            return Ok(body);
        }
        let drawn = self.drawn(k);
        let frames = self.frames(&body.skin);
        let skin = |i: usize| match drawn(i) {
            DVec3::ZERO => body.skin[i],
            by => body.skin[i] + frames(i) * by,
        };
        let skin = ordered::map(body.skin.len(), skin);
        Ok(Frame { skin, ..body })
    }

    /// How far the skin has drawn back at most in a frame asked for of late [m].
    pub fn depth(&self, k: usize) -> f64 {
        let depth = (0..self.beside.len()).map(self.drawn(k));
        depth.fold(0.0, |most, d| d.length().max(most))
    }

    /// Where the skin has drawn back from other skin in a frame asked for of late: cloth that is caught there
    /// is free to slide out, for the flesh that holds it is not really where it was posed.
    pub fn slick(&self, k: usize) -> Vec<bool> {
        let drawn = (0..self.beside.len()).map(self.drawn(k));
        drawn.map(|d| d.length() > DRAWN).collect()
    }

    /// How far a vertex has drawn back in a frame around which looks were taken [m].
    fn drawn(&self, k: usize) -> impl Fn(usize) -> DVec3 + Sync + Send {
        let (from, to) = self.around(k);
        let t = (k - from) as f64 / (to - from).max(1) as f64;
        let [a, b] = [from, to].map(|at| &self.at(at).drawn);
        move |i| a[i].lerp(b[i], t)
    }

    /// The frames at the ends of the stride that frame `k` is in.
    fn stride(&self, k: usize) -> (usize, usize) {
        let from = k / self.stride * self.stride;
        let to = (from + self.stride).min(self.walk.frames - 1);
        (from, to.max(from))
    }

    /// The looks around frame `k`; those at the ends of its stride are known.
    fn around(&self, k: usize) -> (usize, usize) {
        let (from, to) = self.stride(k);
        if self.at(from).deepest <= DEEP && self.at(to).deepest <= DEEP {
            return (from, to);
        }
        let finer = self.stride.div_ceil(FINER);
        let from = from + (k - from) / finer * finer;
        (from, (from + finer).min(to))
    }

    fn at(&self, k: usize) -> &Look {
        let mut looks = self.looks.iter();
        looks.find(|l| l.frame == k).expect("a look that is kept")
    }

    /// Looks at frame `k`, unless that is known.
    fn take(&mut self, k: usize) {
        let look = match self.looks.iter().position(|l| l.frame == k) {
            Some(known) => self.looks.remove(known),
            None => {
                let drawn = self.look(k);
                Look {
                    frame: k,
                    deepest: drawn.iter().fold(0.0, |most, d| d.length().max(most)),
                    drawn,
                }
            }
        };
        self.looks.push(look);
        if self.looks.len() > KEPT {
            self.looks.remove(0);
        }
    }

    fn look(&self, k: usize) -> Vec<DVec3> {
        let body = (self.walk.at)(k);
        let wanted = within(&body.skin, &self.worn_on, AROUND);
        let relief = self.flesh.relieve(&body, self.room, &wanted);
        let frames = self.frames(&body.skin);
        let seen = |i: usize| match relief.verts[i] - body.skin[i] {
            DVec3::ZERO => DVec3::ZERO,
            drawn => frames(i).transpose() * drawn,
        };
        ordered::map(body.skin.len(), seen)
    }

    /// How the skin at `skin` [m] is turned at every vertex: outwards, towards a neighbour, and across.
    fn frames<'s>(&'s self, skin: &'s [DVec3]) -> impl Fn(usize) -> DMat3 + Sync + Send + 's {
        let normals = vertex_normals(skin, self.walk.faces);
        move |i| {
            let out = normals[i];
            let along = (skin[self.beside[i] as usize] - skin[i])
                .reject_from(out)
                .normalize_or_zero();
            DMat3::from_cols(out, along, out.cross(along))
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::testing::balls;

    #[test]
    fn a_body_that_turns_between_two_looks_takes_its_dents_along() {
        let (rest, faces) = balls(0.4);
        let pressed = balls(0.17).0;
        // A quarter of a turn from one look to the next.
        let turn = |k: usize| DQuat::from_rotation_y(0.5 * std::f64::consts::PI * k as f64 / 8.0);
        let at = |k: usize| {
            let skin: Vec<DVec3> = pressed.iter().map(|p| turn(k) * *p).collect();
            Frame::from(skin)
        };
        let walk = Walk {
            faces: &faces,
            rest: &rest,
            frames: 9,
            lead: 0,
            fps: 30.0,
            at: &at,
        };
        let mut dents = Dents::new(&walk, vec![true; rest.len()], 0.004);
        assert_eq!(dents.stride, 8);
        let first = dents.frame(0).expect("a body").skin;
        assert!(dents.depth(0) > 0.015);
        for k in [3, 4, 8] {
            let skin = dents.frame(k).expect("a body").skin;
            let off = |(p, q): (&DVec3, &DVec3)| (turn(k) * *p).distance(*q);
            let off = first.iter().zip(&skin).map(off).fold(0.0, f64::max);
            assert!(off < 1e-4, "{off} in frame {k}");
        }
    }
}
