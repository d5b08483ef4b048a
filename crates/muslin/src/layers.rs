//! Predicted garments one over the other: each network knows its own garment on a bare body.

use glam::DVec3;
use muslin_garment::Garment;
use muslin_geom::{Surface, neighbours};

/// Room between two layers of cloth [m].
const ROOM: f64 = 0.004;
/// Deeper inside another garment than this cloth is elsewhere: a hem under a waistband, not a sleeve
/// beside a hip [m].
const DEEP: f64 = 0.04;
/// Rounds of pushing out, and in each how often what is pushed takes its neighbours along.
const ROUNDS: usize = 8;
const SPREAD: usize = 6;
/// Where no vertex is pushed farther, all lie outside [m].
const DONE: f64 = 1e-4;

/// A garment that others lie over.
pub(crate) struct Under {
    surface: Surface,
    /// Which vertices are on an opening: which side one is on cannot be told there.
    rim: Vec<bool>,
}

impl Under {
    /// The garment at `x` [m].
    pub fn new(garment: &Garment, x: &[DVec3]) -> Self {
        let mut rim = vec![false; x.len()];
        let edges = garment.rims.iter().flat_map(|r| &r.verts);
        edges.for_each(|v| rim[*v as usize] = true);
        Self {
            surface: Surface::new(x, &garment.faces),
            rim,
        }
    }

    /// How a point gets outside, if it is within.
    fn push(&self, p: DVec3) -> Option<DVec3> {
        let hit = self.surface.closest(p, DEEP)?;
        let face = self.surface.faces()[hit.face as usize];
        let lack = ROOM - hit.signed;
        let at_rim = face.iter().any(|v| self.rim[*v as usize]);
        (lack > 0.0 && !at_rim).then(|| hit.normal * lack)
    }
}

/// Leads the cloth at `x` [m] out of all that it is worn over.
pub(crate) fn over(x: &mut [DVec3], faces: &[[u32; 3]], under: &[Under]) {
    let near = neighbours(x.len(), faces);
    for layer in under {
        for _ in 0..ROUNDS {
            let pushes: Vec<Option<DVec3>> = x.iter().map(|p| layer.push(*p)).collect();
            let most = pushes.iter().flatten().map(|d| d.length());
            if most.fold(0.0, f64::max) < DONE {
                break;
            }
            let own = |d: &Option<DVec3>| d.unwrap_or(DVec3::ZERO);
            let mut moves: Vec<DVec3> = pushes.iter().map(own).collect();
            for _ in 0..SPREAD {
                let even = |v: usize| match pushes[v] {
                    Some(d) => d,
                    None => {
                        near[v].iter().map(|j| moves[*j as usize]).sum::<DVec3>()
                            / near[v].len().max(1) as f64
                    }
                };
                moves = (0..x.len()).map(even).collect();
            }
            x.iter_mut().zip(&moves).for_each(|(p, d)| *p += *d);
        }
    }
}

#[cfg(test)]
mod tests {
    use muslin_body::Avatar;
    use muslin_garment::{Recipe, Tee};

    use super::*;

    #[test]
    fn a_shirt_in_a_shirt_is_led_out_of_it_and_one_around_it_stays() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.standard().expect("the default body");
        let recipe = Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::default()
        });
        let tee = Garment::make(&avatar, &recipe).expect("a shirt");
        let worn = tee.worn(&avatar, &figure, &[]).expect("it can be worn");
        let under = [Under::new(&tee, &worn.verts)];
        let normals = muslin_geom::vertex_normals(&worn.verts, &tee.faces);
        let shifted = |by: f64| -> Vec<DVec3> {
            let pairs = worn.verts.iter().zip(&normals);
            pairs.map(|(p, n)| *p + *n * by).collect()
        };
        let mut outer = shifted(0.01);
        let before = outer.clone();
        over(&mut outer, &tee.faces, &under);
        let stayed = outer.iter().zip(&before).filter(|(a, b)| a == b).count();
        // In the armpits a shirt is near itself.
        assert!(stayed * 10 > 8 * outer.len(), "{stayed} of {}", outer.len());
        let mut inner = shifted(-0.006);
        over(&mut inner, &tee.faces, &under);
        let within = inner
            .iter()
            .filter(|p| under[0].push(**p).is_some_and(|d| d.length() > 1e-3));
        assert!(within.count() * 50 < inner.len());
    }
}
