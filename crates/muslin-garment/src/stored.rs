//! A garment as bytes, so that what many wear need not be cut each time.
//!
//! `MUSLINGA`, then as the built-in body is packed ([`muslin_body::packed`]): the recipe in words, a checksum of
//! the body it was cut on, and whole numbers, lengths in micrometres. A garment just cut is rounded to the same,
//! so that it is the one that comes out of the bytes.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use muslin_body::packed::{self, Damaged, Reader, Writer};
use muslin_body::{Avatar, Sparse};

use crate::GarmentError;
use crate::garment::{Garment, name_rims, pins};
use crate::recipe::Recipe;
use crate::settle::Net;
use crate::sheet::{Row, blend};

const MAGIC: &[u8; 8] = b"MUSLINGA";
const VERSION: u32 = 1;
/// No garment is larger than this when unpacked.
const LARGEST: usize = 16 << 20;
/// Steps of lengths [m] and of shares of one.
const STEP: f64 = 1e-6;
/// A vertex hangs on others by so many parts of one.
const PARTS: i32 = 65535;

/// In whole steps.
fn steps(length: f64) -> i32 {
    (length / STEP).round() as i32
}

fn length(steps: i32) -> f64 {
    f64::from(steps) * STEP
}

/// Rounded to what is stored.
pub(crate) fn round(value: f64) -> f64 {
    length(steps(value))
}

pub(crate) fn round_lengths(v: DVec3) -> DVec3 {
    DVec3::from(v.to_array().map(round))
}

/// Shares as they are stored, which sum to one.
pub(crate) fn round_shares(row: &mut Row) {
    let all = parts(row);
    for (entry, parts) in row.iter_mut().zip(all) {
        entry.1 = f64::from(parts) / f64::from(PARTS);
    }
}

/// Parts of one; what rounding leaves goes to the largest.
fn parts(row: &[(u32, f64)]) -> Vec<i32> {
    let whole = |e: &(u32, f64)| (e.1 * f64::from(PARTS)).round() as i32;
    let mut parts: Vec<i32> = row.iter().map(whole).collect();
    let left = PARTS - parts.iter().sum::<i32>();
    if let Some(most) = parts.iter_mut().max_by_key(|p| **p) {
        *most += left;
    }
    parts
}

/// Tells bodies apart, by where the vertices of the one that garments are cut on are.
fn checksum(verts: &[DVec3]) -> u32 {
    let places = verts.iter().flat_map(|v| v.to_array().map(steps));
    // FNV-1a.
    places.fold(0x811c_9dc5, |sum, place| {
        let mix = |sum: u32, byte: u8| (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        place.to_le_bytes().into_iter().fold(sum, mix)
    })
}

/// For every corner a value, as the difference from the last that its vertex had in its panel, else from the
/// corner before.
struct Corners {
    last: HashMap<(u32, u8), [i32; 2]>,
    before: [i32; 2],
}

impl Corners {
    fn new() -> Self {
        Self {
            last: HashMap::new(),
            before: [0; 2],
        }
    }

    fn foretold(&self, corner: (u32, u8)) -> [i32; 2] {
        self.last.get(&corner).copied().unwrap_or(self.before)
    }

    fn is(&mut self, corner: (u32, u8), value: [i32; 2]) {
        self.last.insert(corner, value);
        self.before = value;
    }
}

/// Corner by corner: vertex and panel.
fn corners<'a>(faces: &'a [[u32; 3]], panel: &'a [u8]) -> impl Iterator<Item = (u32, u8)> + 'a {
    let both = faces.iter().zip(panel);
    both.flat_map(|(f, p)| f.map(|v| (v, *p)))
}

impl Garment {
    /// The bytes of a garment that was cut on this avatar; none for one that was brought.
    pub fn encode(&self, avatar: &Avatar) -> Result<Option<Vec<u8>>, GarmentError> {
        let (Some(recipe), None) = (&self.recipe, &self.brought) else {
            return Ok(None);
        };
        let mut w = Writer::default();
        let words = format!("{recipe:?}");
        w.names([words.as_str()].into_iter());
        w.number(checksum(&avatar.standard()?.verts));
        for k in 0..3 {
            w.differences(self.faces.iter().map(|f| f[k] as i32));
        }
        w.differences(self.panel.iter().map(|p| i32::from(*p)));
        let mut known = Corners::new();
        let mut off = Vec::with_capacity(3 * self.faces.len());
        let places = self.uv.iter().flatten();
        for (corner, uv) in corners(&self.faces, &self.panel).zip(places) {
            let value = uv.to_array().map(steps);
            let foretold = known.foretold(corner);
            off.push([value[0] - foretold[0], value[1] - foretold[1]]);
            known.is(corner, value);
        }
        (0..2).for_each(|k| w.ints(off.iter().map(|o| o[k])));
        w.ints(self.binding.rows().map(|r| r.len() as i32));
        w.differences(self.binding.rows().flatten().map(|e| e.0 as i32));
        w.ints(self.binding.rows().flat_map(parts));
        for k in 0..3 {
            w.differences(self.offset.iter().map(|o| steps(o[k])));
        }
        w.differences(self.snug.iter().map(|s| steps(*s)));
        for k in 0..3 {
            w.differences(self.standing.iter().map(|x| steps(x[k])));
        }
        Ok(Some(packed::pack(MAGIC, VERSION, w)))
    }

    /// The garment in these bytes; none if it is by another recipe, or was cut on another avatar.
    pub fn decode(
        avatar: &Avatar,
        recipe: &Recipe,
        bytes: &[u8],
    ) -> Result<Option<Garment>, GarmentError> {
        let raw = packed::unpack(MAGIC, VERSION, bytes, LARGEST)?;
        let mut r = Reader::new(&raw);
        if r.names()? != [format!("{recipe:?}")] {
            return Ok(None);
        }
        let base = avatar.standard()?;
        if r.number()? != checksum(&base.verts) {
            return Ok(None);
        }
        let [a, b, c] = [r.differences()?, r.differences()?, r.differences()?];
        let panel = r.differences()?;
        let off = [r.ints()?, r.ints()?];
        let (sizes, hung_on, shares) = (r.ints()?, r.differences()?, r.ints()?);
        let offset = [r.differences()?, r.differences()?, r.differences()?];
        let snug = r.differences()?;
        let standing = [r.differences()?, r.differences()?, r.differences()?];
        r.finish()?;
        let (n, n_verts) = (a.len(), sizes.len());
        let whole = [b.len(), c.len(), panel.len(), snug.len()] == [n; 4]
            && off.iter().all(|o| o.len() == 3 * n)
            && offset.iter().chain(&standing).all(|o| o.len() == n_verts)
            && hung_on.len() == shares.len();
        if !whole {
            return Err(Damaged("its parts differ in length").into());
        }
        let index = |i: i32, n: usize| {
            let i = u32::try_from(i).ok().filter(|i| (*i as usize) < n);
            i.ok_or(Damaged("an index out of range"))
        };
        let face = |k: usize| {
            Ok([
                index(a[k], n_verts)?,
                index(b[k], n_verts)?,
                index(c[k], n_verts)?,
            ])
        };
        let faces: Vec<[u32; 3]> = (0..n).map(face).collect::<Result<_, Damaged>>()?;
        let panel: Vec<u8> = panel.iter().map(|p| *p as u8).collect();
        let mut known = Corners::new();
        let places = corners(&faces, &panel).enumerate().map(|(k, corner)| {
            let foretold = known.foretold(corner);
            let value = [0, 1].map(|axis| foretold[axis].wrapping_add(off[axis][k]));
            known.is(corner, value);
            DVec2::from(value.map(length))
        });
        let places: Vec<DVec2> = places.collect();
        let mut binding = Sparse::new();
        let mut next = 0;
        for size in sizes {
            let end = next + usize::try_from(size).map_err(|_| Damaged("a row of shares"))?;
            let row = hung_on.get(next..end).zip(shares.get(next..end));
            let (hung_on, shares) = row.ok_or(Damaged("a row of shares"))?;
            let entry = |(i, parts): (&i32, &i32)| {
                Ok((
                    index(*i, base.verts.len())?,
                    f64::from(*parts) / f64::from(PARTS),
                ))
            };
            let row = hung_on.iter().zip(shares).map(entry);
            binding.push(row.collect::<Result<Vec<_>, Damaged>>()?);
            next = end;
        }
        if next != shares.len() || !binding.is_convex(base.verts.len()) {
            return Err(Damaged("shares that do not sum to one").into());
        }
        let points = |of: &[Vec<i32>; 3]| -> Vec<DVec3> {
            let point = |i: usize| DVec3::new(length(of[0][i]), length(of[1][i]), length(of[2][i]));
            (0..n_verts).map(point).collect()
        };
        let offset = points(&offset);
        let on_body = binding.rows().zip(&offset);
        let x: Vec<DVec3> = on_body.map(|(r, o)| blend(r, &base.verts) + *o).collect();
        let net = Net::new(faces, n_verts);
        let rims = name_rims(recipe, &net, &x);
        Ok(Some(Garment {
            name: recipe.name().into(),
            recipe: Some(recipe.clone()),
            faces: net.faces.clone(),
            uv: places.as_chunks::<3>().0.to_vec(),
            panel,
            binding,
            pins: pins(&rims),
            rims,
            snug: snug.into_iter().map(length).collect(),
            offset,
            standing: points(&standing),
            net,
            brought: None,
        }))
    }
}
