//! How stiff the cloth is around the body at rest: what a step of the learnt shapes is divided by.

use glam::{DMat3, DVec3};
use muslin_energy::membrane::{self, Stretch};
use muslin_geom::neighbours;

use crate::factor::{Factor, Matrix, Pattern};
use crate::wearer::Wearer;
use crate::work::PIN;

/// Tension that hanging cloth is under on the mean [N/m]: its stiffness across.
///
/// Half a metre of cloth of 0.2 kg/m² weighs 1 N/m at its top.
const TENSION: f64 = 0.5;

/// The constant part of the stiffness.
pub struct Elastic {
    pattern: Pattern,
    matrix: Matrix,
    /// Where each vertex's diagonal block is.
    diagonal: Vec<usize>,
    /// How firm the cloth is in it.
    firm: f64,
}

impl Elastic {
    /// Of the cloth around its wearers at rest, on the mean, and as `firm` as it is taken to be now.
    pub fn new(wearers: &[Wearer<'_>], firm: f64) -> Self {
        let first = &wearers[0];
        let (cloth, x) = (first.lesson.cloth, first.lesson.template);
        let ring = neighbours(x.len(), &cloth.faces);
        let rows = ring.iter().enumerate();
        let near: Vec<Vec<u32>> = rows
            .map(|(i, ring)| coupled(ring, first.cut.bend(i)))
            .collect();
        let mut matrix = Matrix {
            starts: vec![0],
            cols: Vec::new(),
            blocks: Vec::new(),
        };
        let mut diagonal = Vec::with_capacity(x.len());
        for (i, row) in near.iter().enumerate() {
            diagonal.push(matrix.cols.len());
            matrix.cols.push(i as u32);
            matrix.cols.extend(row);
            matrix.starts.push(matrix.cols.len() as u32);
        }
        matrix.blocks = vec![DMat3::ZERO; matrix.cols.len()];
        let find = |i: u32, j: u32| {
            let span = matrix.starts[i as usize] as usize..matrix.starts[i as usize + 1] as usize;
            let at = matrix.cols[span.clone()].iter().position(|c| *c == j);
            span.start + at.expect("what a law couples is near")
        };
        // A spring is how strongly two vertices keep together, whichever way; of bending some push apart.
        let mut springs = |i: usize, j: u32, k: f64| {
            let k = DMat3::from_diagonal(DVec3::splat(k));
            matrix.blocks[diagonal[i]] += k;
            matrix.blocks[find(i as u32, j)] -= k;
        };
        for (i, row) in ring.iter().enumerate() {
            row.iter().for_each(|j| springs(i, *j, TENSION));
        }
        for wearer in wearers {
            for i in 0..x.len() {
                for &(j, q) in wearer.cut.bend(i) {
                    springs(i, j, -f64::from(q) / wearers.len() as f64);
                }
            }
        }
        let held = DMat3::from_diagonal(DVec3::splat(f64::from(PIN)));
        (cloth.pins.iter()).for_each(|v| matrix.blocks[diagonal[*v as usize]] += held);
        let firmness: Vec<f64> = wearers.iter().map(|w| w.firmness(firm)).collect();
        for (f, face) in cloth.faces.iter().enumerate() {
            let places: [[usize; 3]; 3] = face.map(|a| face.map(|b| find(a, b)));
            for (wearer, firmness) in wearers.iter().zip(&firmness) {
                // In full in compression as well: a step that is too short beats one too far.
                let k = Stretch {
                    compression: 1.0,
                    ..wearer.stretch(f)
                };
                let corners = face.map(|v| wearer.lesson.template[v as usize]);
                let answer = membrane::hessian(&corners, &wearer.cut.rest[f], &k);
                for (row, blocks) in places.iter().zip(&answer.hessian) {
                    for (at, block) in row.iter().zip(blocks) {
                        matrix.blocks[*at] += *block * (firmness / wearers.len() as f64);
                    }
                }
            }
        }
        Self {
            pattern: Pattern::new(x, &near),
            matrix,
            diagonal,
            firm,
        }
    }

    /// Whether it is of cloth as `firm` as this.
    pub fn is_of(&self, firm: f64) -> bool {
        self.firm == firm
    }

    /// Factors it with what the walls add to each vertex [N/m]: xx, yy, zz, xy, xz, yz; and with a
    /// little everywhere, so that nothing moves far in one step.
    pub fn factor(&self, walls: &[[f32; 6]], damping: f64) -> Option<Factor> {
        let mut matrix = self.matrix.clone();
        for (w, at) in walls.iter().zip(&self.diagonal) {
            let [xx, yy, zz, xy, xz, yz] = w.map(f64::from);
            matrix.blocks[*at] += DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            matrix.blocks[*at] += DMat3::from_diagonal(DVec3::splat(damping));
        }
        Factor::new(&self.pattern, &matrix)
    }
}

/// Vertices that share an edge or a fold with one, in order.
fn coupled(ring: &[u32], bent: &[(u32, f32)]) -> Vec<u32> {
    let mut all: Vec<u32> = ring
        .iter()
        .copied()
        .chain(bent.iter().map(|e| e.0))
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use muslin_energy::plate;
    use muslin_net::learn::Noise;
    use muslin_sim::Cloth;

    use super::*;
    use crate::Lesson;
    use crate::lesson::Plan;
    use crate::testing::Class;

    /// `dᵀ H d` for the class's shirt, as it is made there.
    fn square(class: &Class, cloth: &Cloth, d: &[DVec3]) -> f64 {
        let lesson = Lesson {
            cloth,
            ..class.lesson()
        };
        let wearer = Wearer::new(lesson, &Plan::default()).expect("sound cloth");
        let m = Elastic::new(&[wearer], 0.0).matrix;
        let row = |i: usize| {
            let entries = m.starts[i] as usize..m.starts[i + 1] as usize;
            let sum: DVec3 = entries.map(|k| m.blocks[k] * d[m.cols[k] as usize]).sum();
            d[i].dot(sum)
        };
        (0..d.len()).map(row).sum()
    }

    #[test]
    fn it_resists_folding_as_the_law_does_and_holds_pins() {
        let class = Class::new();
        let mut noise = Noise::new(3);
        let any = |_| DVec3::from_array([(); 3].map(|()| noise.normal()));
        let d: Vec<DVec3> = (0..class.template.len()).map(any).collect();
        let whole = square(&class, &class.cloth, &d);

        let mut stiffer = class.cloth.clone();
        stiffer.materials[0].bend.warp *= 10.0;
        stiffer.materials[0].bend.weft *= 10.0;
        let of = |_| class.cloth.materials[0].bend;
        let law: f64 = (plate::plates(&class.cloth.faces, &class.cloth.rest, of).iter())
            .map(|(verts, rest)| plate::energy(&verts.map(|v| d[v as usize]), rest))
            .sum();
        let more = square(&class, &stiffer, &d) - whole;
        assert!((more / (18.0 * law) - 1.0).abs() < 1e-4, "{more} {law}");

        let mut loose = class.cloth.clone();
        let held: f64 = (loose.pins.drain(..))
            .map(|v| d[v as usize].length_squared() * f64::from(PIN))
            .sum();
        let less = whole - square(&class, &loose, &d);
        assert!((less / held - 1.0).abs() < 1e-6, "{less} {held}");
    }
}
