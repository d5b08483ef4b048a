//! Bones, their tree, and how strongly each moves each vertex.

use crate::{BodyError, Sparse, names};

/// One bone of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// As in `upperarm01.L`; `.L` is the body's own left (+X).
    pub name: String,
    /// The bone it hangs from; only the first bone has none.
    pub parent: Option<usize>,
    /// Which anchor point is its head (its pivot).
    pub head: u32,
    /// Which anchor point is its tail.
    pub tail: u32,
}

/// A skeleton and its skin weights. Parents come before their children.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// All bones.
    pub bones: Vec<Bone>,
    /// Vertex → (bone, weight); each row sums to one.
    pub weights: Sparse,
}

impl Rig {
    /// How many bones there are.
    pub fn n_bones(&self) -> usize {
        self.bones.len()
    }

    /// The index of the bone called `name`.
    pub fn bone(&self, name: &str) -> Result<usize, BodyError> {
        self.bones
            .iter()
            .position(|b| b.name == name)
            .ok_or_else(|| BodyError::UnknownBone {
                name: name.into(),
                nearest: names::nearest(name, self.bones.iter().map(|b| b.name.as_str())),
            })
    }

    /// Whether moving `ancestor` moves `bone` (a bone is its own ancestor).
    pub fn descends(&self, bone: usize, ancestor: usize) -> bool {
        let mut at = Some(bone);
        while let Some(b) = at {
            if b == ancestor {
                return true;
            }
            at = self.bones[b].parent;
        }
        false
    }

    /// For every vertex, the weight of a bone and all that descend from it.
    pub(crate) fn share_of(&self, bone: usize) -> Vec<f64> {
        let sum = |row: &[(u32, f64)]| {
            row.iter()
                .filter(|(b, _)| self.descends(*b as usize, bone))
                .map(|(_, w)| w)
                .sum()
        };
        self.weights.rows().map(sum).collect()
    }
}
