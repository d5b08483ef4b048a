//! A garment: one mesh for every body, and how it is put on.

use crate::GarmentError;
use crate::brought::Brought;
use crate::form::Part as Solid;
use crate::pattern::{flatten, lay_flat, turn};
use crate::recipe::{Opening, Plan, Recipe};
use crate::settle::{Net, Track};
use crate::sheet::{Row, Sheet, blend};
use crate::stand::{BodyMap, Stand};
use crate::stored::{round, round_lengths, round_shares};
use glam::{DVec2, DVec3};
use muslin_body::{Avatar, Figure, Sparse};
use muslin_geom::Surface;
use std::f64::consts::TAU;

/// Something to wear. Topology, pattern and binding are the same on every body.
#[derive(Clone, Debug, PartialEq)]
pub struct Garment {
    /// What it is, as in the wardrobe's list.
    pub name: String,
    /// How it was cut; none if it was brought by a user.
    pub recipe: Option<Recipe>,
    /// Triangles, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// The pattern: where each face's corners lie on the cloth [m]; x across the grain
    /// (weft), y along it (warp, up on the body). Panels lie apart only by their number.
    pub uv: Vec<[DVec2; 3]>,
    /// Panel of each face; names by [`Garment::panels`].
    pub panel: Vec<u8>,
    /// Vertex → (avatar vertex, share); each row sums to one.
    pub binding: Sparse,
    /// Vertices that are held on the body: the waistband.
    pub pins: Vec<u32>,
    /// The openings.
    pub rims: Vec<Rim>,
    /// How much shorter than its place on the form each face is knitted: the neckband's pull.
    pub(crate) snug: Vec<f64>,
    /// How far each vertex lies off what it is bound to on the default body [m].
    pub(crate) offset: Vec<DVec3>,
    /// Where it lies around the default figure [m]; nowhere, if it was brought.
    pub(crate) standing: Vec<DVec3>,
    pub(crate) net: Net,
    pub(crate) brought: Option<Box<Brought>>,
}

/// The edge of an opening.
#[derive(Clone, Debug, PartialEq)]
pub struct Rim {
    /// Which opening.
    pub opening: Opening,
    /// Its vertices in order, a closed loop.
    pub verts: Vec<u32>,
}

/// A garment on a body in its rest pose, free of the body and of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Worn {
    /// Vertices [m].
    pub verts: Vec<DVec3>,
    /// The cloth without strain: each face's corners on the cloth [m], x weft, y warp. The same
    /// shape as in `verts`, but for a neckband, which pulls, and where a full body leaves it no room.
    pub rest: Vec<[DVec2; 3]>,
}

/// Slides of a new mesh over its form.
const SETTLE: usize = 30;

/// Slides of a finished mesh over the form of a body.
const SETTLE_AGAIN: usize = 30;

/// Room between two layers of cloth [m].
const BETWEEN_LAYERS: f64 = 0.004;

impl Garment {
    /// Makes a garment, on the avatar's default body.
    pub fn make(avatar: &Avatar, recipe: &Recipe) -> Result<Garment, GarmentError> {
        recipe.check()?;
        let base = avatar.standard()?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, &base);
        let (mut sheet, x) = mesh(recipe, &stand)?;
        sheet.rows.iter_mut().for_each(round_shares);
        let net = Net::new(sheet.faces, sheet.rows.len());
        let rims = name_rims(recipe, &net, &x);
        let mut binding = Sparse::new();
        sheet
            .rows
            .iter()
            .for_each(|r| binding.push(r.iter().copied()));
        let mut garment = Garment {
            name: recipe.name().into(),
            recipe: Some(recipe.clone()),
            faces: net.faces.clone(),
            uv: vec![],
            panel: vec![],
            binding,
            pins: pins(&rims),
            rims,
            snug: vec![],
            offset: x
                .iter()
                .zip(&sheet.rows)
                .map(|(x, r)| round_lengths(*x - blend(r, &base.verts)))
                .collect(),
            standing: vec![],
            net,
            brought: None,
        };
        let x = garment.settled(recipe, &stand, (&[], None));
        let x: Vec<DVec3> = x.into_iter().map(round_lengths).collect();
        garment.snug = snug(&garment.rims, &garment.faces, &x);
        garment.snug.iter_mut().for_each(|s| *s = round(*s));
        garment.draw_pattern(&recipe.plan(&stand, None), (&stand, &x), &sheet.rows);
        garment.standing = x;
        Ok(garment)
    }

    /// Whether much of it may hang where no body is: skirts, dresses, and what a user brought.
    pub fn hangs_freely(&self) -> bool {
        !matches!(self.recipe, Some(Recipe::Tee(_) | Recipe::Trousers(_)))
    }

    /// Whether nothing but a waistband holds it: skirts, and what of a user's is pinned and not known to be trousers.
    pub fn hangs_from_the_waist(&self) -> bool {
        !self.pins.is_empty() && !matches!(self.recipe, Some(Recipe::Trousers(_)))
    }

    /// How many vertices it has.
    pub fn n_verts(&self) -> usize {
        self.binding.n_rows()
    }

    /// Puts the garment on a figure, outside of what is worn `under` it.
    ///
    /// What lies under pushes the cloth out but does not change its size. For several garments
    /// at once, [`Outfit::worn`](crate::Outfit::worn).
    pub fn worn(
        &self,
        avatar: &Avatar,
        figure: &Figure,
        under: &[(&Garment, &Worn)],
    ) -> Result<Worn, GarmentError> {
        let base = avatar.standard()?;
        let map = BodyMap::new(avatar, &base)?;
        let stand = Stand::new(&map, figure);
        let alone = self.alone(&stand, None);
        Ok(self.put_on(&stand, under, (alone, None)))
    }

    /// Where it lies with nothing under it [m]; nowhere yet, if it was brought. `tuck` is the height [m] of a
    /// waistband that it is tucked into.
    pub(crate) fn alone(&self, stand: &Stand, tuck: Option<f64>) -> Vec<DVec3> {
        match &self.recipe {
            Some(_) if tuck.is_none() && stand.is_standard() => self.standing.clone(),
            Some(recipe) if self.brought.is_none() => self.settled(recipe, stand, (&[], tuck)),
            _ => Vec::new(),
        }
    }

    /// As [`Garment::worn`], of a garment that lies so `alone`.
    pub(crate) fn put_on(
        &self,
        stand: &Stand,
        under: &[(&Garment, &Worn)],
        (alone, tuck): (Vec<DVec3>, Option<f64>),
    ) -> Worn {
        let inner: Vec<(Surface, Vec<bool>)> = (under.iter())
            .map(|(g, w)| (Surface::new(&w.verts, &g.faces), g.net.on_rim()))
            .collect();
        let recipe = match (&self.brought, &self.recipe) {
            (Some(brought), _) => {
                return brought.put_on((&self.binding, &self.offset), stand, &inner);
            }
            (None, recipe) => recipe.as_ref().expect("a garment is cut or brought"),
        };
        let rest = self.rest(&alone);
        let verts = if inner.is_empty() {
            alone
        } else {
            self.settled(recipe, stand, (&inner, tuck))
        };
        Worn { verts, rest }
    }

    /// The height of an opening on a body [m]; none without such an opening.
    pub(crate) fn height_of(&self, opening: Opening, stand: &Stand) -> Option<f64> {
        let rim = self.rims.iter().find(|r| r.opening == opening)?;
        let y = |&i: &u32| blend(self.binding.row(i as usize), stand.verts).y;
        Some(rim.verts.iter().map(y).sum::<f64>() / rim.verts.len() as f64)
    }

    /// Vertex → (bone of the full rig, weight): what the binding gives.
    pub fn skin_weights(&self, avatar: &Avatar) -> Sparse {
        if let Some(brought) = &self.brought {
            return brought.weights().clone();
        }
        let bones = &avatar.rig().weights;
        let mut out = Sparse::new();
        for row in self.binding.rows() {
            let mut all: Row = (row.iter())
                .flat_map(|&(i, w)| bones.row(i as usize).iter().map(move |&(b, s)| (b, s * w)))
                .collect();
            all.sort_by_key(|e| e.0);
            all.dedup_by(|b, a| {
                let same = a.0 == b.0;
                a.1 += if same { b.1 } else { 0.0 };
                same
            });
            out.push(all);
        }
        out
    }

    /// The mesh on its form around a body [m].
    fn settled(
        &self,
        recipe: &Recipe,
        stand: &Stand,
        (under, tuck): (&[(Surface, Vec<bool>)], Option<f64>),
    ) -> Vec<DVec3> {
        let rows = self.binding.rows().zip(&self.offset);
        let scale = stand.scale();
        let (mut x, mut left) = (Vec::new(), Vec::new());
        for (row, o) in rows {
            x.push(blend(row, stand.verts) + *o * scale);
            left.push(
                row.iter()
                    .map(|&(i, w)| stand.map.base[i as usize].x * w)
                    .sum::<f64>()
                    + o.x,
            );
        }
        let plan = recipe.plan(stand, tuck);
        let mut form = plan.form();
        plan.prepare(&form, &mut x, &left);
        for (surface, rim) in under {
            form.parts.push(Solid::Cloth(surface, rim, BETWEEN_LAYERS));
        }
        self.net.round_rims(&mut x, 10);
        let tracks = tracks(&plan, &self.rims, &x);
        self.net.settle(&form, &mut x, &tracks, SETTLE_AGAIN);
        x
    }

    /// How many times as long cloth is whose faces have these shapes [m] as its own pattern.
    pub fn larger(&self, faces: &[[DVec2; 3]]) -> f64 {
        let total = |faces: &[[DVec2; 3]]| faces.iter().map(|f| area(f).abs()).sum::<f64>();
        (total(faces) / total(&self.uv)).sqrt()
    }

    /// Each face's own shape at `x`, turned so that the grain is upright. Where a full body leaves it no
    /// room, as in an armpit, the cloth is cut all the same.
    fn rest(&self, x: &[DVec3]) -> Vec<[DVec2; 3]> {
        let flat: Vec<[DVec2; 3]> = (self.faces.iter())
            .map(|f| lay_flat(f.map(|i| x[i as usize])))
            .collect();
        let scale = self.larger(&flat);
        let turned = |((flat, uv), snug): ((&[DVec2; 3], &[DVec2; 3]), &f64)| {
            let r = turn(flat, uv);
            roomy(flat.map(|p| r.rotate(p)), &uv.map(|p| p * scale)).map(|p| p * *snug)
        };
        flat.iter()
            .zip(&self.uv)
            .zip(&self.snug)
            .map(turned)
            .collect()
    }

    fn draw_pattern(&mut self, plan: &Plan, (stand, x): (&Stand, &[DVec3]), rows: &[Row]) {
        let laid: Vec<_> = (self.faces.iter())
            .map(|f| {
                let corner = |k: usize| &rows[f[k] as usize];
                let arm = [0, 1].map(|s| share(&stand.map.arm[s], [0, 1, 2].map(corner)));
                plan.lay(f.map(|i| x[i as usize]), arm)
            })
            .collect();
        self.panel = laid.iter().map(|l| l.panel as u8).collect();
        let flat = flatten(x, &self.faces, &laid).into_iter();
        self.uv = flat
            .map(|f| f.map(|p| DVec2::new(round(p.x), round(p.y))))
            .collect();
    }
}

/// Twice a triangle's area over its longest side squared that it has at least in the cloth: 0.87 where all
/// sides are alike, 0.33 at least in garments on the default body.
const ROOMY: f64 = 0.25;

/// The triangle, or the more like its pattern the thinner it is; where that is thin as well, the more like a
/// regular one.
fn roomy(flat: [DVec2; 3], pattern: &[DVec2; 3]) -> [DVec2; 3] {
    let thicker = |f: &[DVec2; 3], like: &[DVec2; 3]| -> [DVec2; 3] {
        let t = (1.0 - roundness(f) / ROOMY).clamp(0.0, 1.0);
        std::array::from_fn(|k| f[0] + (f[k] - f[0]).lerp(like[k] - like[0], t))
    };
    let half = thicker(&flat, pattern);
    thicker(&half, &regular(&half))
}

/// Twice the area over the longest side squared.
fn roundness(f: &[DVec2; 3]) -> f64 {
    let longest = (0..3).map(|k| f[k].distance_squared(f[(k + 1) % 3]));
    2.0 * area(f) / longest.fold(f64::MIN_POSITIVE, f64::max)
}

/// The triangle of equal sides that is as large as `f` all around, and lies as it does.
fn regular(f: &[DVec2; 3]) -> [DVec2; 3] {
    let around = (0..3).map(|k| f[k].distance_squared(f[(k + 1) % 3]));
    let side = (around.sum::<f64>() / 3.0).sqrt();
    let upright = [0.0, 1.0, 2.0].map(|k| DVec2::from_angle(TAU / 3.0 * k) * (side / 3f64.sqrt()));
    let r = turn(&upright, f);
    upright.map(|p| r.rotate(p))
}

/// Area [m²], positive where the corners go round counter-clockwise.
fn area(f: &[DVec2; 3]) -> f64 {
    0.5 * (f[1] - f[0]).perp_dot(f[2] - f[0])
}

/// A neckband is ribbed: this much shorter than the neckline, over this width [m].
const NECKBAND: (f64, f64) = (0.05, 0.02);

/// How much shorter each face is than where it lies, 1 away from the neckband.
fn snug(rims: &[Rim], faces: &[[u32; 3]], x: &[DVec3]) -> Vec<f64> {
    let neck = rims
        .iter()
        .filter(|r| r.opening == Opening::Neck)
        .flat_map(|r| &r.verts);
    let neck: Vec<DVec3> = neck.map(|&i| x[i as usize]).collect();
    let (pull, width) = NECKBAND;
    let short = |f: &[u32; 3]| {
        let middle = f.iter().map(|&i| x[i as usize]).sum::<DVec3>() / 3.0;
        let off = neck
            .iter()
            .map(|p| p.distance(middle))
            .fold(f64::MAX, f64::min);
        1.0 - pull * (1.0 - off / width).clamp(0.0, 0.5) * 2.0
    };
    faces.iter().map(short).collect()
}

/// The mean of a per-vertex share over three rows.
fn share(values: &[f64], rows: [&Row; 3]) -> f64 {
    let of = |r: &Row| r.iter().map(|&(i, w)| values[i as usize] * w).sum::<f64>();
    rows.map(of).iter().sum::<f64>() / 3.0
}

/// Cut from the second skin, remeshed there, laid on the form, and remeshed on it.
fn mesh(recipe: &Recipe, stand: &Stand) -> Result<(Sheet, Vec<DVec3>), GarmentError> {
    let sheet = recipe.cut(stand);
    let on_body = sheet.at(stand.verts);
    let (rough, _) = sheet.remeshed(on_body, 1.1 * recipe.edge().max(0.012), 4);
    let mut x = rough.at(stand.verts);
    let net = Net::new(rough.faces.clone(), x.len());
    net.round_rims(&mut x, 10);
    let rims = name_rims(recipe, &net, &x);
    let plan = recipe.plan(stand, None);
    let tracks = tracks(&plan, &rims, &x);
    net.settle(&plan.form(), &mut x, &tracks, SETTLE);
    let (fine, x) = rough.remeshed(x, recipe.edge(), 6);
    Ok((fine.bound(stand.verts, &recipe.ground(stand))?, x))
}

fn tracks(plan: &Plan, rims: &[Rim], x: &[DVec3]) -> Vec<Track> {
    let at = |r: &Rim| r.verts.iter().map(|&i| x[i as usize]).collect::<Vec<_>>();
    rims.iter().map(|r| plan.track(r.opening, &at(r))).collect()
}

pub(crate) fn name_rims(recipe: &Recipe, net: &Net, x: &[DVec3]) -> Vec<Rim> {
    let middle =
        |ring: &Vec<u32>| ring.iter().map(|&i| x[i as usize]).sum::<DVec3>() / ring.len() as f64;
    let middles: Vec<DVec3> = net.loops.iter().map(middle).collect();
    let rim = |(k, ring): (usize, &Vec<u32>)| Rim {
        opening: recipe.opening(&middles, k),
        verts: ring.clone(),
    };
    net.loops.iter().enumerate().map(rim).collect()
}

pub(crate) fn pins(rims: &[Rim]) -> Vec<u32> {
    let mut all: Vec<u32> = rims
        .iter()
        .filter(|r| r.opening == Opening::Waist)
        .flat_map(|r| r.verts.clone())
        .collect();
    all.sort_unstable();
    all
}
