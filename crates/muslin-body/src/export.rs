//! The rig that other programs get: fewer bones, four influences at most.
//!
//! It is the full rig with the bones of face, tongue, breast, palm and small toes folded
//! into the nearest bone above them, and every vertex's four strongest influences kept. A
//! kept bone moves exactly as in the full rig, so a pose needs no conversion.

use crate::sparse::strongest;
use crate::{Avatar, Bone, Rig, Sparse};

/// A rig cut down for export.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportRig {
    /// Bones and skin weights; at most four influences on each vertex.
    pub rig: Rig,
    /// The full rig's bone that each bone is; its `world_from_rest` is the same.
    pub source: Vec<usize>,
}

/// What the names of folded bones start with.
const FOLDED: [&str; 15] = [
    "tongue",
    "jaw",
    "oris",
    "special",
    "levator",
    "orbicularis",
    "temporalis",
    "oculi",
    "risorius",
    "breast",
    "metacarpal",
    "toe2",
    "toe3",
    "toe4",
    "toe5",
];

/// As many influences as a glTF vertex has in its first set.
const INFLUENCES: usize = 4;

impl Avatar {
    /// The rig for export.
    pub fn export_rig(&self) -> ExportRig {
        let full = self.rig();
        let source: Vec<usize> = (0..full.n_bones())
            .filter(|&b| is_kept(&full.bones[b]))
            .collect();
        let kept = |b: usize| {
            let mut at = b;
            while !is_kept(&full.bones[at]) {
                at = full.bones[at].parent.expect("the first bone is kept");
            }
            source.binary_search(&at).expect("a kept bone is listed")
        };
        let renamed = |&b: &usize| Bone {
            parent: full.bones[b].parent.map(kept),
            ..full.bones[b].clone()
        };
        let bones = source.iter().map(renamed).collect();
        let mut weights = Sparse::new();
        for row in full.weights.rows() {
            let named = row.iter().map(|&(b, w)| (kept(b as usize) as u32, w));
            weights.push(strongest(named, INFLUENCES));
        }
        ExportRig {
            rig: Rig { bones, weights },
            source,
        }
    }
}

fn is_kept(bone: &Bone) -> bool {
    bone.parent.is_none() || !FOLDED.iter().any(|f| bone.name.starts_with(f))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folded_influences_add_up_and_the_weakest_goes() {
        let row = [(0, 0.1), (1, 0.3), (2, 0.25), (3, 0.05), (4, 0.2), (0, 0.1)];
        let kept = strongest(row.into_iter(), INFLUENCES);
        let bones: Vec<u32> = kept.iter().map(|k| k.0).collect();
        assert_eq!(bones, [1, 2, 0, 4]);
        assert!((kept.iter().map(|k| k.1).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
