//! What lies on the device and changes seldom: cloths, bodies, and the factor.

use muslin_model::{CrowdError, Skin};

use super::{Array, Device};
use crate::cut::Cut;
use crate::factor::{Factor, Sweep};
use crate::ground::Posed;
use crate::pack::Pack;
use crate::rows::flat;
use crate::wearer::Wearer;

/// What all wearers have in common.
pub(super) struct Cloth {
    pub faces: Array,
    pub n_faces: usize,
    /// A vertex's faces: where they start; three times a face's number plus the corner.
    pub shared_starts: Array,
    pub shared: Array,
    pub pinned: Array,
    /// How the cloth follows bones.
    pub starts: Array,
    pub bones: Array,
    pub weights: Array,
}

impl Cloth {
    pub fn new(device: &Device, cut: &Cut, skin: &Skin) -> Result<Self, CrowdError> {
        let mut around = vec![Vec::new(); cut.n_verts()];
        for (f, patch) in cut.patches.iter().enumerate() {
            for (corner, v) in patch.verts.iter().enumerate() {
                around[*v as usize].push((3 * f + corner) as u32);
            }
        }
        let (starts, shared) = flat(&around);
        let faces: Vec<u32> = cut.patches.iter().flat_map(|p| p.verts).collect();
        let mut pinned = vec![0; cut.n_verts()];
        cut.pins.iter().for_each(|v| pinned[*v as usize] = 1);
        let bones: Vec<u32> = skin.bones.iter().map(|b| u32::from(*b)).collect();
        Ok(Self {
            n_faces: cut.patches.len(),
            faces: device.put_counts(&faces)?,
            shared_starts: device.put_counts(&starts)?,
            shared: device.put_counts(&shared)?,
            pinned: device.put_counts(&pinned)?,
            starts: device.put_counts(&skin.starts)?,
            bones: device.put_counts(&bones)?,
            weights: device.put(&skin.weights)?,
        })
    }
}

/// One wearer's body and cut.
pub(super) struct Worn {
    pub patches: Array,
    pub bend_starts: Array,
    pub bent: Array,
    pub bend: Array,
    pub mass: Array,
    pub laid: Array,
    /// The skin around the cloth.
    pub skin_faces: Array,
    pub skin_starts: Array,
    pub around: Array,
    pub rim: Array,
}

impl Worn {
    pub fn new(device: &Device, wearer: &Wearer<'_>) -> Result<Self, CrowdError> {
        let cut = &wearer.cut;
        let patches = cut.patches.iter().flat_map(|p| {
            let [[a, b], [c, d]] = p.slopes;
            let [weft, warp, shear] = p.stretch;
            [a, b, c, d, p.area, weft, warp, shear, p.compression]
        });
        let (bent, bend): (Vec<u32>, Vec<f32>) = cut.bend.iter().copied().unzip();
        let (faces, [skin_starts, around], rim) = wearer.body.skin_faces();
        let rim: Vec<u32> = rim.iter().map(|r| u32::from(*r)).collect();
        Ok(Self {
            patches: device.put(&patches.collect::<Vec<f32>>())?,
            bend_starts: device.put_counts(&cut.bend_starts)?,
            bent: device.put_counts(&bent)?,
            bend: device.put(&bend)?,
            mass: device.put(&cut.mass)?,
            laid: device.put(wearer.template.as_flattened())?,
            skin_faces: device.put_counts(faces.as_flattened())?,
            skin_starts: device.put_counts(skin_starts)?,
            around: device.put_counts(around)?,
            rim: device.put_counts(&rim)?,
        })
    }
}

/// What a pack's bodies look like.
pub(super) struct Skins {
    pub skins: Array,
    pub n_skin: u32,
    pub bytes: usize,
}

impl Skins {
    pub fn new(device: &Device, pack: &Pack) -> Result<Self, CrowdError> {
        let one = |skin: &Posed| {
            let both = skin.verts.iter().zip(&skin.normals);
            both.flat_map(|(x, n)| [x.x, x.y, x.z, n.x, n.y, n.z])
                .collect::<Vec<f32>>()
        };
        let all: Vec<f32> = pack.skins.iter().flat_map(one).collect();
        Ok(Self {
            n_skin: pack.skins[0].verts.len() as u32,
            bytes: 4 * all.len(),
            skins: device.put(&all)?,
        })
    }
}

/// Which of the pack's folds is a vertex's, if one is.
pub(super) fn fold_of(pack: &Pack, n: usize) -> Vec<u32> {
    let mut of = vec![u32::MAX; n];
    for (k, fold) in pack.folds.iter().enumerate() {
        of[fold.0 as usize] = k as u32;
    }
    of
}

/// One half of a solve.
pub(super) struct Half {
    pub levels: Array,
    pub n_levels: u32,
    pub members: Array,
    pub starts: Array,
    pub others: Array,
    pub blocks: Array,
    pub diagonal: Array,
}

impl Half {
    fn new(device: &Device, sweep: &Sweep) -> Result<Self, CrowdError> {
        Ok(Self {
            n_levels: sweep.levels.len() as u32 - 1,
            levels: device.put_counts(&sweep.levels)?,
            members: device.put_counts(&sweep.members)?,
            starts: device.put_counts(&sweep.starts)?,
            others: device.put_counts(&sweep.others)?,
            blocks: device.put(&sweep.blocks)?,
            diagonal: device.put(&sweep.diagonal)?,
        })
    }
}

/// The factor of the stiffness.
pub(super) struct Solver {
    pub order: Array,
    pub places: Array,
    pub down: Half,
    pub up: Half,
}

impl Solver {
    pub fn new(device: &Device, factor: &Factor) -> Result<Self, CrowdError> {
        let [down, up] = factor.sweeps();
        Ok(Self {
            order: device.put_counts(factor.order())?,
            places: device.put_counts(factor.places())?,
            down: Half::new(device, &down)?,
            up: Half::new(device, &up)?,
        })
    }
}
