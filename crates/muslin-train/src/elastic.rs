//! How stiff the cloth is around the body at rest: what a step of the learnt shapes is divided by.

use glam::{DMat3, DVec3};
use muslin_energy::membrane::{self, Stretch};
use muslin_sim::Cloth;

use crate::cut::Cut;
use crate::factor::{Factor, Matrix, Pattern};
use crate::weights::neighbours;

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
}

impl Elastic {
    /// Of `cloth` at `x` [m].
    pub fn new(cloth: &Cloth, cut: &Cut, x: &[DVec3]) -> Self {
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
        for (f, face) in cloth.faces.iter().enumerate() {
            // In full in compression as well: a step that is too short beats one too far.
            let k = Stretch {
                compression: 1.0,
                ..cloth.materials[cloth.material_of[f] as usize].stretch
            };
            let answer = membrane::hessian(&face.map(|v| x[v as usize]), &cut.rest[f], &k);
            for a in 0..3 {
                for b in 0..3 {
                    matrix.blocks[find(face[a], face[b])] += answer.hessian[a][b];
                }
            }
        }
        Self {
            pattern: Pattern::new(x, &near),
            matrix,
            diagonal,
        }
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
