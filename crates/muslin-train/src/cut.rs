//! Cloth prepared for the laws of sixteen poses: single precision, everything in flat lists.

use muslin_energy::{RestTriangle, plate};
use muslin_sim::Cloth;

use crate::TrainError;

/// A face's share of the membrane.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    pub verts: [u32; 3],
    /// `∂F/∂x₁` and `∂F/∂x₂`, each by weft and warp [1/m].
    pub slopes: [[f32; 2]; 2],
    /// Rest area [m²].
    pub area: f32,
    /// Weft, warp, shear [N/m].
    pub stretch: [f32; 3],
    /// Share of the first two that is left in compression.
    pub compression: f32,
}

/// Everything that depends on the cut alone.
#[derive(Clone, Debug)]
pub struct Cut {
    pub patches: Vec<Patch>,
    /// Rest shapes in double precision.
    pub rest: Vec<RestTriangle>,
    /// Mass of every vertex [kg].
    pub mass: Vec<f32>,
    /// Bending, `E = ½ xᵀ Q x`: for every vertex where its entries start.
    pub bend_starts: Vec<u32>,
    /// Other vertex and entry [N/m].
    pub bend: Vec<(u32, f32)>,
    pub pins: Vec<u32>,
}

impl Cut {
    pub fn new(cloth: &Cloth) -> Result<Self, TrainError> {
        cloth.check()?;
        let mut mass = vec![0.0; cloth.n_verts()];
        let mut rest = Vec::with_capacity(cloth.faces.len());
        let mut patches = Vec::with_capacity(cloth.faces.len());
        for (f, verts) in cloth.faces.iter().enumerate() {
            let material = &cloth.materials[cloth.material_of[f] as usize];
            let shape =
                RestTriangle::new(cloth.rest[f]).ok_or(muslin_sim::SimError::NoRestShape(f))?;
            let k = material.stretch;
            for &v in verts {
                mass[v as usize] += (material.density * shape.area / 3.0) as f32;
            }
            patches.push(Patch {
                verts: *verts,
                slopes: [1, 2].map(|i| shape.slope(i).map(|s| s as f32)),
                area: shape.area as f32,
                stretch: [k.weft, k.warp, k.shear].map(|k| k as f32),
                compression: k.compression as f32,
            });
            rest.push(shape);
        }
        let (bend_starts, bend) = bending(cloth);
        Ok(Self {
            patches,
            rest,
            mass,
            bend_starts,
            bend,
            pins: cloth.pins.clone(),
        })
    }

    pub fn n_verts(&self) -> usize {
        self.mass.len()
    }

    /// The row of `Q` of vertex `v`: other vertices and entries [N/m]; its diagonal is minus their sum.
    pub fn bend(&self, v: usize) -> &[(u32, f32)] {
        &self.bend[self.bend_starts[v] as usize..self.bend_starts[v + 1] as usize]
    }
}

/// The rows of `Q` without their diagonals, which are minus the sum of the rest.
fn bending(cloth: &Cloth) -> (Vec<u32>, Vec<(u32, f32)>) {
    let of = |f: usize| cloth.materials[cloth.material_of[f] as usize].bend;
    let mut entries = plate::entries(&cloth.faces, &cloth.rest, of);
    entries.retain(|e| e.0 != e.1);
    entries.sort_by_key(|e| (e.0, e.1));
    let mut starts = vec![0u32; cloth.n_verts() + 1];
    let mut out: Vec<(u32, f32)> = Vec::new();
    for group in entries.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let sum: f64 = group.iter().map(|e| e.2).sum();
        out.push((group[0].1, sum as f32));
        starts[group[0].0 as usize + 1] = out.len() as u32;
    }
    for i in 1..starts.len() {
        starts[i] = starts[i].max(starts[i - 1]);
    }
    (starts, out)
}
