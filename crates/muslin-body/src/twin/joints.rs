//! Which joint of a character plays which part, and which of our bones it goes with.

use glam::DVec3;

use crate::retarget::{Roles, Skeleton, Spot};
use crate::{Avatar, BodyError, Character};

/// The parts that a character's joints play.
pub(crate) struct Joints {
    pub roles: Roles,
    /// Our bone that each joint goes with; none for what the hips hang from, which stays.
    pub follows: Vec<Option<usize>>,
    /// The joint that each of our bones has its head at, if one.
    pub heads: Vec<Option<usize>>,
}

impl Joints {
    /// The joint that turns each of our bones, if one: the first that goes with it, but a wrist is turned by the hand where
    /// a character has both.
    pub fn leads(&self, character: &Character) -> Vec<Option<usize>> {
        let mut leads: Vec<Option<usize>> = vec![None; self.heads.len()];
        for (j, b) in self.follows.iter().enumerate() {
            let is_first = character.parents[j].is_none_or(|p| self.follows[p] != *b);
            if let (Some(b), true) = (b, is_first) {
                leads[*b].get_or_insert(j);
            }
        }
        for palm in self.roles.palm.into_iter().flatten() {
            if let Some(b) = self.follows[palm] {
                leads[b] = Some(palm);
            }
        }
        leads
    }

    /// Finds arms, legs, trunk and head by the joints' names, or else by where the joints are.
    pub fn find(avatar: &Avatar, character: &Character) -> Result<Joints, BodyError> {
        let roles = Roles::find(&skeleton(character));
        let roles = roles.or_else(|e| guessed(character).ok_or(e))?;
        let mut found = Joints {
            follows: vec![None; character.parents.len()],
            heads: vec![None; avatar.rig().n_bones()],
            roles,
        };
        found.limbs(avatar, character)?;
        found.trunk(avatar, character)?;
        // What is left goes with what it hangs from.
        for j in 0..character.parents.len() {
            if found.follows[j].is_none() {
                found.follows[j] = character.parents[j].and_then(|p| found.follows[p]);
            }
        }
        Ok(found)
    }

    fn goes_with(&mut self, avatar: &Avatar, joint: usize, bone: &str) -> Result<(), BodyError> {
        let b = avatar.bone(bone)?;
        self.follows[joint] = Some(b);
        self.heads[b].get_or_insert(joint);
        Ok(())
    }

    fn limbs(&mut self, avatar: &Avatar, character: &Character) -> Result<(), BodyError> {
        let chest = self.chest(character);
        for (s, side) in ["L", "R"].into_iter().enumerate() {
            let leg = ["upperleg01", "lowerleg01", "foot"];
            for (j, name) in self.roles.leg[s].into_iter().zip(leg) {
                self.goes_with(avatar, j, &format!("{name}.{side}"))?;
            }
            let arm = ["upperarm01", "lowerarm01", "wrist"];
            for (spot, name) in self.roles.arm[s].into_iter().zip(arm) {
                if let Spot::Head(j) = spot {
                    self.goes_with(avatar, j, &format!("{name}.{side}"))?;
                }
            }
            let Spot::Head(upper) = self.roles.arm[s][0] else {
                continue;
            };
            for j in between(character, chest, upper) {
                self.goes_with(avatar, j, &format!("clavicle.{side}"))?;
            }
        }
        Ok(())
    }

    fn trunk(&mut self, avatar: &Avatar, character: &Character) -> Result<(), BodyError> {
        let legs = self.roles.leg.map(|l| l[0]);
        let hips = common(character, legs[0], legs[1]);
        let chest = self.chest(character);
        self.goes_with(avatar, hips, "root")?;
        let mut spine = between(character, hips, chest);
        if chest != hips {
            spine.push(chest);
        }
        self.spread(
            avatar,
            &spine,
            &["spine05", "spine04", "spine03", "spine02", "spine01"],
        )?;
        let mut neck = match (self.roles.neck, self.roles.head) {
            (_, Some(Spot::Head(head))) => {
                self.goes_with(avatar, head, "head")?;
                between(character, chest, head)
            }
            (Some(neck), _) => vec![neck],
            _ => Vec::new(),
        };
        neck.retain(|j| self.follows[*j].is_none());
        if let Some(first) = neck.first() {
            self.goes_with(avatar, *first, "neck01")?;
        }
        self.spread(avatar, &neck[neck.len().min(1)..], &["neck02", "neck03"])
    }

    /// Hands a chain of joints on to a chain of bones, whose last turns as far as the last joint.
    fn spread(
        &mut self,
        avatar: &Avatar,
        chain: &[usize],
        bones: &[&str],
    ) -> Result<(), BodyError> {
        for (i, j) in chain.iter().enumerate() {
            let share = (i + 1) as f64 / chain.len() as f64;
            let bone = (share * bones.len() as f64).round().max(1.0) as usize - 1;
            self.goes_with(avatar, *j, bones[bone])?;
        }
        Ok(())
    }

    /// The joint that both arms hang from.
    fn chest(&self, character: &Character) -> usize {
        match self.roles.arm.map(|a| a[0]) {
            [Spot::Head(l) | Spot::End(l), Spot::Head(r) | Spot::End(r)] => common(character, l, r),
        }
    }
}

fn skeleton(character: &Character) -> Skeleton {
    let places = character.places();
    let parents = character.parents.iter().enumerate();
    let offsets = parents.map(|(j, p)| places[j] - p.map_or(DVec3::ZERO, |p| places[p]));
    Skeleton {
        names: character.names.clone(),
        offsets: offsets.collect(),
        parents: character.parents.clone(),
        ends: vec![None; places.len()],
    }
}

/// From the root to a joint, both included.
fn path(character: &Character, joint: usize) -> Vec<usize> {
    let up = std::iter::successors(Some(joint), |j| character.parents[*j]);
    let mut all: Vec<usize> = up.collect();
    all.reverse();
    all
}

/// The last joint that both hang from.
fn common(character: &Character, a: usize, b: usize) -> usize {
    let (a, b) = (path(character, a), path(character, b));
    let same = a.iter().zip(&b).take_while(|(a, b)| a == b);
    same.last().map_or(a[0], |(a, _)| *a)
}

/// Joints on the way from one down to another, both left out.
fn between(character: &Character, above: usize, below: usize) -> Vec<usize> {
    let way = path(character, below);
    let start = way.iter().position(|j| *j == above).map_or(0, |i| i + 1);
    way[start..way.len() - 1].to_vec()
}

/// The parts by where joints are: feet lowest, hands farthest out, the head highest.
fn guessed(character: &Character) -> Option<Roles> {
    let at = character.places();
    let children = character.children();
    let mut moves = vec![false; at.len()];
    for row in character.weights.rows() {
        row.iter()
            .filter(|w| w.1 > 0.0)
            .for_each(|w| moves[w.0 as usize] = true);
    }
    for j in (0..at.len()).rev() {
        moves[j] |= children[j].iter().any(|c| moves[*c]);
    }
    let heirs = |j: usize| children[j].iter().filter(|c| moves[**c]).count();
    let ends: Vec<usize> = (0..at.len())
        .filter(|j| moves[*j] && heirs(*j) == 0)
        .collect();
    let best = |rank: &dyn Fn(usize) -> f64, of: &dyn Fn(usize) -> bool| {
        let fit = ends.iter().copied().filter(|j| of(*j));
        fit.max_by(|a, b| rank(*a).total_cmp(&rank(*b)))
    };
    let chain = |above: usize, end: usize| {
        let mut way = between(character, above, end);
        way.push(end);
        way
    };
    // One foot, and the lowest end of another limb: ends of one foot part below its ankle.
    let one = best(&|j| -at[j].y, &|_| true)?;
    let apart = |j: usize| j != one && chain(common(character, one, j), one).len() > 2;
    let other = best(&|j| -at[j].y, &apart)?;
    let hips = common(character, one, other);
    // Feet point ahead of their ankles.
    let ahead = |end: usize| {
        let ankle = *chain(hips, end).get(2)?;
        let in_foot = |j: u32| path(character, j as usize).contains(&ankle);
        let rows = character.verts.iter().zip(character.weights.rows());
        let foot = rows.filter(|(_, row)| row.iter().any(|w| w.1 > 0.5 && in_foot(w.0)));
        let (sum, n) = foot.fold((DVec3::ZERO, 0.0), |(s, n), (p, _)| (s + *p, n + 1.0));
        (n > 0.0).then(|| (sum / n - at[ankle]).with_y(0.0))
    };
    let ahead = ahead(one).unwrap_or(DVec3::ZERO) + ahead(other).unwrap_or(DVec3::ZERO);
    let ahead = match ahead.x.abs() > ahead.z.abs() {
        true => DVec3::X * ahead.x.signum(),
        false => DVec3::Z * if ahead.z < 0.0 { -1.0 } else { 1.0 },
    };
    let left = DVec3::Y.cross(ahead);
    let (l, r) = match (at[one] - at[other]).dot(left) > 0.0 {
        true => (one, other),
        false => (other, one),
    };
    let legs = [chain(hips, l), chain(hips, r)];
    let leg = |c: &Vec<usize>| Some([*c.first()?, *c.get(1)?, *c.get(2)?]);
    let leg = [leg(&legs[0])?, leg(&legs[1])?];
    let in_leg = |j: usize| {
        let way = path(character, j);
        leg.iter().any(|l| way.contains(&l[0]))
    };
    let middle = at[hips].dot(left);
    let out = |j: usize, s: f64| s * (at[j].dot(left) - middle);
    let hands = [1.0, -1.0].map(|s| best(&|j| out(j, s), &|j| out(j, s) > 1e-3 && !in_leg(j)));
    let (l, r) = (hands[0]?, hands[1]?);
    let chest = common(character, l, r);
    let arm = |end: usize| {
        let mut way = chain(chest, end);
        if let Some(palm) = way.iter().position(|j| heirs(*j) > 1) {
            way.truncate(palm + 1);
        }
        let first = usize::from(way.len() > 3);
        let joint = |k: usize| way.get(first + k).map(|j| Spot::Head(*j));
        Some([joint(0)?, joint(1)?, joint(2)?])
    };
    let arm = [arm(l)?, arm(r)?];
    let in_arm = |j: usize| {
        let way = path(character, j);
        [l, r].iter().any(|h| way.contains(&chain(chest, *h)[0]))
    };
    let crown = best(&|j| at[j].y, &|j| {
        !in_leg(j) && !in_arm(j) && at[j].y > at[chest].y
    });
    let neck = crown.map(|c| chain(common(character, c, chest), c));
    let toe = |c: &Vec<usize>| c.get(3).map(|j| Spot::Head(*j));
    Some(Roles {
        leg,
        toe: [toe(&legs[0]), toe(&legs[1])],
        arm,
        hand: [None, None],
        palm: [None, None],
        neck: neck.as_ref().filter(|n| n.len() > 1).map(|n| n[0]),
        head: neck.and_then(|n| n.last().map(|j| Spot::Head(*j))),
    })
}
