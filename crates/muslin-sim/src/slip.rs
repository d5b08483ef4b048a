//! Cloth that is wedged slips before it stretches beyond its limit.
//!
//! Where two folds of the body hold cloth between them, friction is as strong as they press, and a
//! few triangles next to the fold pay for it. Whatever is beyond its limit is drawn back to it,
//! triangle by triangle, and its neighbours after it (the projections of position based dynamics:
//! Müller et al. 2007, on principal stretches).

use glam::DVec3;
use muslin_energy::{proximity, strain};

use crate::{near::Near, ordered, pattern::Rows, touch::Touch, weave::Weave};

/// What a face may be beyond its limit before anything slips, and what is left of that.
const BEYOND: f64 = 5e-3;
const LEFT: f64 = 5e-4;
/// Sweeps over what is beyond, and what is around it: along a fold of the body slack comes from afar.
const SWEEPS: usize = 300;
/// How many times as far as its limit a face is drawn: slack comes sooner (successive over-relaxation).
const FARTHER: f64 = 1.8;

/// How cloth slips from `x` [m], so that less of it is beyond its limit; none where nothing is.
/// What holds a vertex to the skin gives way as well: skin stretches by more than a waistband does. But into the skin
/// nothing slips: what spans a fold of the body goes along it. Nor into cloth that is `near`: folds push each other aside.
pub(crate) fn moves(
    weave: &Weave,
    x: &[DVec3],
    (touches, near): (&[Touch], &[Near]),
) -> Option<Vec<DVec3>> {
    let is_beyond = |f: usize| beyond(weave, x, f).is_some_and(|b| b.0 > BEYOND);
    let mut known = ordered::map(weave.faces.len(), is_beyond);
    let mut asked: Vec<usize> = (0..known.len()).filter(|f| known[*f]).collect();
    if asked.is_empty() {
        return None;
    }
    let mut slipping = Slipping::new((weave, x), touches);
    let mut folds = Folds::new(near, x.len());
    let mut seen = vec![0; known.len()];
    // How many of those that moved are known to what is near them, and to their faces.
    let (mut met, mut spread) = (0, 0);
    for _ in 0..SWEEPS {
        let mut is_any_beyond = false;
        for &f in &asked {
            is_any_beyond |= slipping.face(f, &mut seen[f]);
        }
        if !is_any_beyond {
            break;
        }
        folds.meet(&slipping.moved[met..], x, 0.5 * weave.radius);
        met = slipping.moved.len();
        for hold in &mut folds.holds {
            slipping.apart(hold);
        }
        let around = slipping.moved[spread..].iter();
        let around = around.flat_map(|v| weave.pattern.corners.row(*v as usize));
        asked.extend(
            around
                .map(|corner| *corner as usize / 3)
                .filter(|f| !std::mem::replace(&mut known[*f], true)),
        );
        if slipping.moved.len() > spread {
            asked.sort_unstable();
        }
        spread = slipping.moved.len();
    }
    let moves = slipping.at.iter().zip(x);
    Some(moves.map(|(to, from)| *to - *from).collect())
}

/// Cloth on its way.
struct Slipping<'a> {
    weave: &'a Weave,
    /// From where [m].
    from: &'a [DVec3],
    /// What of the skin is near each vertex.
    touching: Vec<Option<&'a Touch>>,
    /// Where it is [m].
    at: Vec<DVec3>,
    /// Counts whatever is looked at; and when it moved each vertex last.
    now: u32,
    last: Vec<u32>,
    /// Vertices that did, in the order in which they began to.
    moved: Vec<u32>,
}

impl<'a> Slipping<'a> {
    fn new((weave, from): (&'a Weave, &'a [DVec3]), touches: &'a [Touch]) -> Self {
        let mut touching = vec![None; from.len()];
        for touch in touches.iter().filter(|t| t.face.is_none()) {
            touching[touch.verts[0] as usize] = Some(touch);
        }
        Self {
            weave,
            from,
            touching,
            at: from.to_vec(),
            now: 1,
            last: vec![0; from.len()],
            moved: Vec::new(),
        }
    }

    fn shove(&mut self, v: u32, by: DVec3) {
        let i = v as usize;
        let to = self.at[i] + by;
        let lift = self.touching[i].map_or(DVec3::ZERO, |t| t.lift(self.from[i], to));
        self.at[i] = to + lift;
        if self.last[i] == 0 {
            self.moved.push(v);
        }
        self.last[i] = self.now;
    }

    /// Whether something of what was `seen` then moved since; it is seen now.
    fn has_moved(&mut self, verts: &[u32], seen: &mut u32) -> bool {
        self.now += 1;
        let before = std::mem::replace(seen, self.now);
        before == 0 || verts.iter().any(|v| self.last[*v as usize] >= before)
    }

    /// Draws a face back to its limit; says whether it was beyond.
    fn face(&mut self, f: usize, seen: &mut u32) -> bool {
        let verts = self.weave.faces[f];
        if !self.has_moved(&verts, seen) {
            return false;
        }
        let Some((over, pull)) = beyond(self.weave, &self.at, f).filter(|b| b.0 > LEFT) else {
            return false;
        };
        let size: f64 = pull.iter().map(|p| p.length_squared()).sum();
        for (v, pull) in verts.into_iter().zip(pull) {
            self.shove(v, -pull * (FARTHER * over / size));
        }
        true
    }

    /// Keeps two pieces of cloth apart.
    fn apart(&mut self, hold: &mut Hold) {
        if !self.has_moved(&hold.verts, &mut hold.seen) {
            return;
        }
        let short = hold.short(&self.at);
        if short <= 0.0 {
            return;
        }
        let size: f64 = hold.weights.iter().map(|w| w * w).sum();
        for (v, w) in hold.verts.into_iter().zip(hold.weights) {
            if w != 0.0 {
                self.shove(v, hold.normal * (w * short / size));
            }
        }
    }
}

/// Two pieces of cloth that do not slip into each other.
struct Hold {
    verts: [u32; 4],
    weights: [f64; 4],
    /// From the second to the first, where slipping begins.
    normal: DVec3,
    /// How far apart they stay along it [m].
    least: f64,
    /// When it was looked at last.
    seen: u32,
}

impl Hold {
    /// Where slipping begins at `x` [m]; what is farther apart than `room` [m] may come as near as that.
    fn new(near: &Near, x: &[DVec3], room: f64) -> Option<Self> {
        let (gap, weights) = near.gap(x);
        let apart = gap.length();
        (apart > 0.0).then(|| Self {
            verts: near.verts,
            weights,
            normal: gap / apart,
            least: apart.min(room),
            seen: 0,
        })
    }

    /// What the two lack of that at `at` [m].
    fn short(&self, at: &[DVec3]) -> f64 {
        let at = self.verts.map(|v| at[v as usize]);
        self.least - proximity::weighted(&at, &self.weights).dot(self.normal)
    }
}

/// Pairs that may hold what slips.
struct Folds<'a> {
    near: &'a [Near],
    /// Which of them a vertex is of.
    of: Rows,
    known: Vec<bool>,
    /// Those of which a vertex has slipped.
    holds: Vec<Hold>,
}

impl<'a> Folds<'a> {
    fn new(near: &'a [Near], n: usize) -> Self {
        let verts = |(k, near): (usize, &Near)| near.verts.map(|v| (v, k as u32));
        let pairs: Vec<(u32, u32)> = near.iter().enumerate().flat_map(verts).collect();
        Self {
            near,
            of: Rows::counted(n, &pairs),
            known: vec![false; near.len()],
            holds: Vec::new(),
        }
    }

    /// Adds what may hold those that have `moved` from `x` [m].
    fn meet(&mut self, moved: &[u32], x: &[DVec3], room: f64) {
        for k in moved.iter().flat_map(|v| self.of.row(*v as usize)) {
            let k = *k as usize;
            if !std::mem::replace(&mut self.known[k], true) {
                self.holds.extend(Hold::new(&self.near[k], x, room));
            }
        }
    }
}

/// By how much a face is beyond its limit, and how that grows with its corners [1/m].
fn beyond(weave: &Weave, x: &[DVec3], f: usize) -> Option<(f64, [DVec3; 3])> {
    let patch = &weave.patches[f];
    let limit = patch.limit.as_ref()?;
    let deformation = patch.rest.deformation(&weave.corners(x, f));
    if limit.is_far_from(&deformation) {
        return None;
    }
    // Angles are dear, and most of what slipped is within its limit.
    if strain::larger(&deformation) <= 1.0 + limit.limit {
        return None;
    }
    let [u, v] = deformation;
    let [cos, sin] = strain::direction(&deformation);
    let along = u * cos + v * sin;
    let length = along.length();
    let pull = |k: usize| {
        let [to_u, to_v] = patch.rest.slope(k);
        along * ((cos * to_u + sin * to_v) / length)
    };
    Some((length - 1.0 - limit.limit, [0, 1, 2].map(pull)))
}

#[cfg(test)]
mod tests {
    use muslin_energy::contact::Barrier;

    use super::*;
    use crate::{quality, rub::Rub, testing::sheets};

    /// Cloth that may stretch by 5 %, a little slack [m].
    fn slack() -> (Weave, Vec<DVec3>) {
        let (mut cloth, flat) = sheets(0.1);
        cloth.materials[0].limit = Some(0.05);
        let weave = Weave::new(&cloth).expect("a valid cloth");
        (weave, flat.iter().map(|p| *p * 0.99).collect())
    }

    #[test]
    fn a_pulled_vertex_shares_its_stretch_with_the_cloth_around_it() {
        let (weave, mut x) = slack();
        assert_eq!(moves(&weave, &x, (&[], &[])), None);
        x[66].z += 5e-3;
        assert!(quality::excess(&weave, &x) > 0.05);
        let moves = moves(&weave, &x, (&[], &[])).expect("it is far beyond its limit");
        let slipped: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        let left = quality::excess(&weave, &slipped);
        assert!(left < BEYOND, "{left}");
        // No more than needed, and nobody is carried away.
        assert_eq!(moves[0], DVec3::ZERO);
        assert!(moves.iter().all(|m| m.length() < 5e-3));
        assert!(moves.iter().sum::<DVec3>().length() < 1e-12);
    }

    #[test]
    fn what_skin_holds_up_stays_and_the_cloth_around_it_comes() {
        let (weave, mut x) = slack();
        x[66].z += 5e-3;
        let barrier = Barrier {
            radius: 3e-3,
            width: 1e-3,
            stiffness: 400.0,
        };
        let on_skin = Touch {
            verts: [66; 3],
            weights: [1.0, 0.0, 0.0],
            face: None,
            skin: x[66] - DVec3::Z * 1e-3,
            rub: Rub::new((DVec3::Z, x[66]), 0.0, 1e-4),
            barrier,
        };
        let moves = moves(&weave, &x, (&[on_skin], &[])).expect("it is far beyond its limit");
        let slipped: Vec<DVec3> = x.iter().zip(&moves).map(|(x, m)| *x + *m).collect();
        let left = quality::excess(&weave, &slipped);
        assert!(left < BEYOND, "{left}");
        assert!(moves[66].z > -1e-9, "{}", moves[66]);
        assert!(moves.iter().all(|m| m.length() < 5e-3));
    }

    #[test]
    fn what_slips_pushes_cloth_in_its_way_aside() {
        let (weave, mut x) = slack();
        // The other sheet, a little below what is pulled up.
        let below = x[210] + DVec3::Z * 4e-3;
        x[210].z += 5e-3;
        x[..144].iter_mut().for_each(|p| p.z = below.z);
        let face = weave.faces.iter().find(|f| f.contains(&66));
        let [a, b, c] = *face.expect("66 is a vertex of the sheet");
        let near = [Near {
            verts: [210, a, b, c],
            is_edges: false,
        }];
        let slipped = |near: &[Near]| -> Vec<DVec3> {
            let moves = moves(&weave, &x, (&[], near)).expect("it is far beyond its limit");
            x.iter().zip(&moves).map(|(x, m)| *x + *m).collect()
        };
        let through = slipped(&[]);
        assert!(through[210].z < below.z, "{}", through[210]);
        let aside = slipped(&near);
        assert!(quality::excess(&weave, &aside) < BEYOND);
        let hold = Hold::new(&near[0], &x, 0.5 * weave.radius).expect("they are apart");
        assert!((hold.least - 1e-3).abs() < 1e-9, "{}", hold.least);
        assert!(hold.short(&aside) < 1e-4, "{}", hold.short(&aside));
        // Both went: the one that is free to is pushed.
        assert!(aside[66].z < below.z - 1e-4, "{}", aside[66]);
    }
}
