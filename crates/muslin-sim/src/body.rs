//! The body as cloth meets it: a moving surface, and the touches on it.

use std::sync::OnceLock;

use glam::DVec3;
use muslin_energy::contact::Barrier;
use muslin_geom::{Closest, Surface};

use crate::{
    ordered,
    pattern::{Pattern, Rows},
    rub::Rub,
    touch::Touch,
    weave::Weave,
};

/// The body at the end of a step, with what it knows about each vertex of the cloth.
pub(crate) struct Body {
    pub now: Surface,
    /// Skin positions one step earlier [m].
    before: Vec<DVec3>,
    seen: Vec<Seen>,
    /// Per vertex, distance that is kept on top of the common gap [m].
    pub extra: Vec<f64>,
    /// Vertices of the skin on which nothing sticks; all others do where there are fewer.
    pub slick: Vec<bool>,
    /// Vertices of the skin that share a face, once asked for.
    near: OnceLock<Rows>,
}

/// The last answer about a vertex.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Where it was asked for [m]; not a number once the body has moved.
    at: DVec3,
    /// A nearby face.
    face: u32,
    /// Signed distance, or what it exceeds [m].
    signed: f64,
}

const UNSEEN: Seen = Seen {
    at: DVec3::NAN,
    face: 0,
    signed: -1.0,
};

/// How cloth meets the body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skin {
    pub barrier: Barrier,
    /// Slide that still counts as sticking [m].
    pub stick: f64,
    /// How far off the skin a touch is worth knowing [m].
    pub reach: f64,
}

/// Depth up to which cloth inside the body is looked for [m].
const DEEP: f64 = 0.25;
/// Depth from which on it is asked whether that is inside at all: skin that a fold turns inside out would draw cloth to
/// its wrong side [m].
const DOUBTED: f64 = 1e-3;

impl Body {
    pub fn new(now: Surface, n_cloth: usize) -> Body {
        let before = now.verts().to_vec();
        Body {
            now,
            before,
            seen: vec![UNSEEN; n_cloth],
            extra: vec![0.0; n_cloth],
            slick: Vec::new(),
            near: OnceLock::new(),
        }
    }

    /// For every vertex of the skin those that share a face with it.
    pub fn near(&self) -> &Rows {
        let skin = &self.now;
        self.near
            .get_or_init(|| Pattern::new(skin.verts().len(), skin.faces()).near)
    }

    /// Moves on; `to` [m] is where the skin is at the end of the next step.
    pub fn advance(&mut self, to: &[DVec3]) {
        self.before.clear();
        self.before.extend_from_slice(self.now.verts());
        self.now.refit(to);
        self.forget();
    }

    /// The body stands still from here on.
    pub fn stand(&mut self) {
        self.before.clear();
        self.before.extend_from_slice(self.now.verts());
    }

    /// Drops what was known about distances, not the hints where to look.
    pub fn forget(&mut self) {
        self.seen.iter_mut().for_each(|s| s.at = DVec3::NAN);
    }

    /// Drops everything that was known about the cloth.
    pub fn forget_all(&mut self) {
        self.seen.fill(UNSEEN);
        self.extra.fill(0.0);
    }

    /// How a skin point moves in this step [m].
    fn drift(&self, hit: &Closest) -> DVec3 {
        let f = self.now.faces()[hit.face as usize];
        let old = f.map(|i| self.before[i as usize]);
        let w = hit.weights;
        hit.point - (old[0] * w[0] + old[1] * w[1] + old[2] * w[2])
    }

    /// Touches of all vertices at `x`, which were at `before` when the step began [m].
    pub fn touches(
        &mut self,
        weave: &Weave,
        (x, before): (&[DVec3], &[DVec3]),
        skin: &Skin,
    ) -> Vec<Touch> {
        let now = &self.now;
        let seen = &self.seen;
        let found = ordered::map(x.len(), |i| {
            look(now, &seen[i], x[i], skin.reach + self.extra[i])
        });
        let touch = |i: usize| {
            let hit = found[i].flatten().filter(|hit| hit.signed < skin.reach)?;
            let mut touch = self.touch(weave, (i, before[i]), &hit, skin);
            let corners = now.faces()[hit.face as usize].iter();
            let mut slick = corners.map(|v| self.slick.get(*v as usize) == Some(&true));
            if !slick.any(|is_slick| is_slick) {
                touch.press(x, weave.friction[i]);
            }
            Some(touch)
        };
        let touches = ordered::map(x.len(), touch).into_iter().flatten();
        let touches = touches.collect();
        ordered::change(&mut self.seen, |i, seen| match found[i] {
            None => seen,
            Some(None) => Seen {
                at: x[i],
                signed: 2.0 * (skin.reach + self.extra[i]),
                ..seen
            },
            Some(Some(hit)) => Seen {
                at: x[i],
                face: hit.face,
                signed: hit.signed,
            },
        });
        touches
    }

    fn touch(
        &self,
        weave: &Weave,
        (i, before): (usize, DVec3),
        hit: &Closest,
        skin: &Skin,
    ) -> Touch {
        let lift = self.extra[i] + LAYER * f64::from(weave.layers[i]);
        Touch {
            verts: [i as u32; 3],
            weights: [1.0, 0.0, 0.0],
            face: None,
            skin: hit.point,
            rub: Rub::new((hit.normal, before + self.drift(hit)), 0.0, skin.stick),
            barrier: Barrier {
                radius: skin.barrier.radius + lift,
                ..skin.barrier
            },
        }
    }

    /// A touch of a point inside a face of the cloth, wherever the skin is.
    pub fn face_touch(
        &self,
        weave: &Weave,
        (x, face, weights): (&[DVec3], u32, [f64; 3]),
        skin: &Skin,
    ) -> Option<Touch> {
        let verts = weave.faces[face as usize];
        let c = weave.corners(x, face as usize);
        let p = c[0] * weights[0] + c[1] * weights[1] + c[2] * weights[2];
        let hit = self.now.closest(p, skin.reach.max(0.03))?;
        let hit = sure(&self.now, p, hit);
        let extra = verts
            .map(|i| self.extra[i as usize])
            .into_iter()
            .fold(0.0, f64::max);
        let touch = self.touch(weave, (verts[0] as usize, p), &hit, skin);
        let radius = skin.barrier.radius + extra;
        let barrier = Barrier {
            radius,
            ..skin.barrier
        };
        Some(Touch {
            verts,
            weights,
            face: Some(face),
            barrier,
            ..touch
        })
    }
}

/// Extra distance from the skin per layer worn below [m].
const LAYER: f64 = 2.5e-3;

/// `None`: surely no touch. `Some(None)`: nothing within reach. Otherwise the nearest skin.
fn look(now: &Surface, seen: &Seen, x: DVec3, reach: f64) -> Option<Option<Closest>> {
    let moved = seen.at.distance(x);
    if seen.signed - moved > reach - 1e-9 && seen.signed > 0.0 {
        // Not a number compares false: after the body moved, everybody is asked.
        return None;
    }
    let within = if seen.signed < 0.5 * reach {
        DEEP
    } else {
        reach * 2.0
    };
    let hit = now.closest_near(x, within, seen.face);
    Some(hit.map(|hit| sure(now, x, hit)))
}

/// The answer about `x`, with its side looked at again if it is said to be deep inside.
fn sure(now: &Surface, x: DVec3, hit: Closest) -> Closest {
    match hit.signed < -DOUBTED {
        true => now.sided(x, hit),
        false => hit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skin_that_a_fold_turns_inside_out_draws_nobody_to_its_wrong_side() {
        // A top whose upper tip is pulled down through its lower one.
        let around = [DVec3::X, DVec3::Z, -DVec3::X, -DVec3::Z];
        let shoulder = around.map(|p| p * 0.3 + DVec3::Y * 0.7);
        let tips = [DVec3::Y * -1.4, -DVec3::Y];
        let verts = [&around[..], &shoulder[..], &tips[..]].concat();
        let sides = (0..4_u32).map(|i| (i, (i + 1) % 4));
        let faces: Vec<[u32; 3]> = sides
            .flat_map(|(a, b)| {
                [
                    [a, a + 4, b],
                    [b, a + 4, b + 4],
                    [a + 4, 8, b + 4],
                    [a, b, 9],
                ]
            })
            .collect();
        let skin = Surface::new(&verts, &faces);
        let hit = |p: DVec3| skin.closest(p, 9.0).expect("near");
        let beside = DVec3::new(0.1, -1.3, 0.05);
        assert!(hit(beside).signed < -DOUBTED, "the nearest face is misled");
        let told = sure(&skin, beside, hit(beside));
        assert!(told.signed > 0.0 && told.normal.dot(beside - told.point) > 0.0);
        let within = DVec3::new(0.5, -0.2, 0.01);
        assert_eq!(sure(&skin, within, hit(within)), hit(within));
        assert!(hit(within).signed < -DOUBTED);
    }
}
