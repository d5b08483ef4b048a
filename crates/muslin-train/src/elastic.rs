//! How stiff the cloth is around the body at rest: what a step of the learnt shapes is divided by.

use glam::{DMat3, DVec3};
use muslin_energy::membrane::{self, Stretch};
use muslin_geom::neighbours;

use crate::factor::{Factor, Matrix, Pattern};
use crate::wearer::Wearer;

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
        let first = &wearers[0].lesson;
        let (cloth, x) = (first.cloth, first.template);
        let near = neighbours(x.len(), &cloth.faces);
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
            matrix.blocks.push(DMat3::from_diagonal(DVec3::splat(
                TENSION * row.len() as f64,
            )));
            matrix.blocks.extend(
                row.iter()
                    .map(|_| DMat3::from_diagonal(DVec3::splat(-TENSION))),
            );
            matrix.starts.push(matrix.cols.len() as u32);
        }
        let find = |i: u32, j: u32| {
            let span = matrix.starts[i as usize] as usize..matrix.starts[i as usize + 1] as usize;
            let at = matrix.cols[span.clone()].iter().position(|c| *c == j);
            span.start + at.expect("corners of a face are neighbours")
        };
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
