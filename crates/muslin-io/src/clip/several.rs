//! Garments of one outfit in files of their own: `walk.tee.npz` beside `walk.trousers.npz`.

use std::path::{Path, PathBuf};

use super::{Clip, MAX_BYTES};
use crate::error::{Fault, IoError};
use crate::input::{files_in, read_file};
use crate::npz::{self, Npz, Values};

/// The array that says which layer a garment is, 0 next to the skin.
pub(super) const LAYER: &str = "layer";

/// The files of the garments of `walk.npz`, where there is no such file itself: `walk.GARMENT.npz`.
pub(super) fn beside(path: &Path) -> Vec<PathBuf> {
    if !super::is_kind(path, "npz") || path.exists() {
        return Vec::new();
    }
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let stem = format!("{}.", super::stem(path));
    let own = |p: &PathBuf| {
        let garment = super::stem(p).strip_prefix(&stem).map(str::to_owned);
        garment.is_some_and(|g| !g.is_empty() && !g.contains('.'))
    };
    let all = files_in(folder, &["npz"]).unwrap_or_default();
    all.into_iter().filter(own).collect()
}

/// The garments of these files as one clip, by their layers and then by name.
pub(super) fn read(files: &[PathBuf]) -> Result<Clip, IoError> {
    let mut garments = Vec::with_capacity(files.len());
    for path in files {
        let input = read_file(path, MAX_BYTES)?;
        let npz = npz::read(&input.file, &input.bytes)?;
        let (layer, mut clip) = (layer(&npz), Clip::of_npz(&input.file, &npz)?);
        for part in &mut clip.drape.parts {
            let garment = part.name.rsplit('.').next().map(str::to_owned);
            part.name = garment.unwrap_or_default();
        }
        garments.push((layer, input.file, clip));
    }
    garments.sort_by_key(|g| g.0);
    if let [(_, first, one), rest @ ..] = garments.as_slice()
        && let Some(other) = rest.iter().find(|g| !is_same_body(one, &g.2))
    {
        let what = format!("its body moves otherwise than that of {first}");
        let fault = Fault::new("bad-clip", other.1.clone(), what);
        let fault = fault.hint("keep the garments of one motion in a folder, without others");
        return Err(fault.invalid());
    }
    Clip::joined(garments.into_iter().map(|g| g.2).collect())
}

/// Which layer a garment is; the outermost where that is not said.
fn layer(npz: &Npz) -> u32 {
    match npz.get(LAYER).map(|a| &a.values) {
        Some(Values::Int(v)) => v.first().and_then(|l| u32::try_from(*l).ok()),
        _ => None,
    }
    .unwrap_or(u32::MAX)
}

fn is_same_body(a: &Clip, b: &Clip) -> bool {
    a.body_faces == b.body_faces && a.body == b.body
}
