//! What a garment learns from: motions as poses or as they are, and the garment itself.

use std::path::{Path, PathBuf};

use glam::DVec2;
use muslin_body::{Avatar, Figure, Motion, Sparse};
use muslin_garment::{Fabric, Garment};
use muslin_geom::Part;
use muslin_model::{Model, ModelError, Player};
use muslin_net::learn::Noise;
use muslin_sim::Cloth;
use muslin_train::published::System;
use muslin_train::{Lesson, diffused, mixed, thinned};
use rayon::prelude::*;

use super::told::FROM_FILE;
use super::{TrainOptions, variety};
use crate::brought::dressed;
use crate::drape::{cloth, places};
use crate::dress::asked_shape;
use crate::failure::Failure;
use crate::figure::body_failure;
use crate::hero::Hero;
use crate::outfit::Outfit;
use crate::simulate::{SimulateOptions, motion};
use crate::size::{CutFor, Wearer};
use crate::traits::{self, Trait};

/// Bones that a vertex follows at most.
const BONES: usize = 6;
/// Rounds in which skin weights spread over cloth with edges of [`SPREAD_AT`] [m], as far as over any other; and rounds
/// at most.
const SPREAD: f64 = 20.0;
const SPREAD_AT: f64 = 0.025;
const MOST_ROUNDS: f64 = 500.0;
/// As many bones as a file can name: the published systems leave none out.
const ALL_BONES: usize = 255;
/// Poses a second that are taken from a motion where each is learnt from on its own.
const APART: f64 = 10.0;
/// Poses a second of motions that are learnt from in time.
pub(crate) const IN_TIME: f64 = 30.0;

/// A garment as somebody wears it who is learnt from.
pub(super) struct Pupil {
    pub figure: Figure,
    pub cloth: Cloth,
    /// Where it lies around the body at rest [m].
    pub template: Vec<glam::DVec3>,
    pub traits: Vec<Trait>,
}

impl Pupil {
    /// A player of `model` for this wearer.
    pub fn player(&self, model: Model, avatar: &Avatar) -> Result<Player, ModelError> {
        let told = |name: &str| Some(self.traits.iter().find(|t| t.0 == name)?.1);
        Player::new(&model.told(told), avatar)
    }
}

/// A garment as it is taught.
pub(super) struct Class {
    /// The wearer and the fabric that were asked for, then others.
    pub pupils: Vec<Pupil>,
    pub weights: Sparse,
    /// Fabrics, innermost first.
    pub fabrics: Vec<Fabric>,
    pub parts: Vec<Part>,
    /// What it begins with.
    pub begun: Option<Model>,
}

impl Class {
    /// The garments of an outfit: as a rule there is one. `base` is our body as it is, where a character wears it.
    pub fn new(
        (avatar, figure): (&Avatar, &Figure),
        (outfit, base): (&Outfit, Option<&Avatar>),
        options: &TrainOptions,
    ) -> Result<Self, Failure> {
        let mut weights = Sparse::new();
        for piece in &outfit.pieces {
            let spread = match options.system {
                Some(s) => (s.smoothed(), ALL_BONES),
                None => (rounds(&piece.garment), BONES),
            };
            let skin = piece.garment.skin_weights(avatar);
            let own = diffused(&skin, &piece.garment.faces, spread);
            (0..piece.garment.n_verts()).for_each(|v| weights.push(own.row(v).iter().copied()));
        }
        let piece = &outfit.pieces[0];
        let (fabrics, noise) = (variety::fabrics(), &mut Noise::new(options.seed ^ 0xc1a5));
        let lessons = match (options.any_shape || options.any_size, options.any_fabric) {
            (true, _) => variety::WEARERS,
            (false, true) => variety::FABRICS,
            (false, false) => 1,
        };
        let own = asked_shape(avatar, &options.dress)?;
        let mut wear = vec![(figure.clone(), piece.fabric.clone(), outfit.cut_for.clone())];
        for k in 1..lessons {
            let (mut who, mut what, mut cut) = wear[0].clone();
            let mut shape = own.clone();
            if options.any_shape {
                shape = variety::any_shape(noise);
                who = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
            }
            if options.any_fabric {
                what = variety::lesson_fabric(&fabrics, k, noise);
            }
            // Every other one wears what was made to measure: that is what most ask for.
            if options.any_size && k % 2 == 1 {
                let wearer = Wearer {
                    avatar,
                    shape: &shape,
                    figure: &who,
                    base,
                };
                cut = Some(variety::any_cut(wearer, noise));
            }
            wear.push((who, what, cut));
        }
        type Wear = (Figure, Fabric, Option<CutFor>);
        let one = |(figure, fabric, cut): Wear| -> Result<Pupil, Failure> {
            let mut worn = outfit.clone().for_whom(avatar, cut)?;
            let mut traits = Vec::new();
            if options.any_fabric {
                traits.extend(traits::of_fabric(&fabric));
            }
            if options.any_shape || options.system == Some(System::Snug) {
                traits.extend(traits::of_wearer(&avatar.measure(&figure)));
            }
            if options.any_size {
                traits.extend(traits::of_cut(worn.cut_for.as_ref()));
            }
            worn.pieces[0].fabric = fabric;
            let lies = dressed(avatar, &worn, (&figure, &avatar.dressing(&figure)))?;
            let start = places(&lies);
            Ok(Pupil {
                cloth: cloth(&worn, &lies),
                template: avatar.at_rest(&figure, (&weights, &start)),
                traits,
                figure,
            })
        };
        let pupils: Result<Vec<Pupil>, Failure> = wear.into_par_iter().map(one).collect();
        Ok(Self {
            pupils: pupils?,
            weights,
            fabrics: outfit.pieces.iter().map(|p| p.fabric.clone()).collect(),
            parts: outfit.parts(),
            begun: None,
        })
    }

    /// The files of the garments, of one `out` itself, of several `NAME.GARMENT.muslin`.
    pub fn files(&self, out: &Path) -> Vec<PathBuf> {
        let one = |part: &Part| out.with_extension(format!("{}.muslin", part.name));
        match self.parts.as_slice() {
            [_] => vec![out.to_owned()],
            several => several.iter().map(one).collect(),
        }
    }

    /// What the model of all says of garment `k`.
    pub fn part_of(&self, model: &Model, k: usize) -> Model {
        match self.parts.as_slice() {
            [_] => model.clone(),
            several => model.garment(several[k].verts.clone(), several[k].faces.clone()),
        }
    }

    /// The triangles of garment `k` by itself.
    pub fn faces(&self, k: usize) -> Vec<[u32; 3]> {
        let (part, cloth) = (&self.parts[k], &self.pupils[0].cloth);
        let first = part.verts.start as u32;
        let own = cloth.faces[part.faces.clone()].iter();
        own.map(|f| f.map(|v| v - first)).collect()
    }

    /// What it learnt from in all, that which the model at the beginning learnt from first.
    pub fn sources(&self, own: &[String]) -> Vec<String> {
        let before = self.begun.as_ref().and_then(|m| m.notes.get("trained_on"));
        let before = before.map_or("", String::as_str).split("; ");
        let mut all: Vec<String> = before
            .filter(|s| !s.is_empty())
            .map(str::to_owned)
            .collect();
        for source in own {
            if !all.contains(source) {
                all.push(source.clone());
            }
        }
        all
    }

    /// What is to be learnt of each of them.
    pub fn lessons<'l>(&'l self, avatar: &'l Avatar) -> Vec<Lesson<'l>> {
        let one = |p: &'l Pupil| Lesson {
            avatar,
            figure: &p.figure,
            cloth: &p.cloth,
            template: &p.template,
            weights: &self.weights,
            traits: &p.traits,
        };
        self.pupils.iter().map(one).collect()
    }
}

/// Rounds in which skin weights spread as far over a garment as over any other: how far goes with the square root of
/// their number, and with its edges.
fn rounds(garment: &Garment) -> usize {
    let sides = |f: &[DVec2; 3]| {
        (0..3)
            .map(|k| f[k].distance_squared(f[(k + 1) % 3]))
            .sum::<f64>()
    };
    let n = 3 * garment.uv.len().max(1);
    let square = garment.uv.iter().map(sides).sum::<f64>() / n as f64;
    let rounds = SPREAD * SPREAD_AT * SPREAD_AT / square;
    rounds.round().clamp(1.0, MOST_ROUNDS) as usize
}

/// Poses a second at which a system learns.
pub(super) fn rate(system: Option<System>) -> f64 {
    match system.is_some_and(System::is_moving) {
        true => IN_TIME,
        false => APART,
    }
}

/// A motion that is shown.
pub(super) struct Shown {
    /// Without its way in from the rest pose.
    pub motion: Motion,
    /// What to call it.
    pub source: String,
    /// What there is to be said of it.
    pub warnings: Vec<String>,
    /// How far limbs were turned at most, where it leads the body deep into itself [rad].
    pub turned: f64,
}

/// The motion of that name.
pub(super) fn one(
    who: (&Avatar, Option<&Hero>),
    figure: &Figure,
    (name, fps): (&str, f64),
) -> Result<Shown, Failure> {
    let options = SimulateOptions {
        motion: name.to_owned(),
        fps,
        ..SimulateOptions::default()
    };
    let moving = motion::load(who, figure, &options)?;
    let source = match &moving.sha256 {
        Some(hash) => format!("{}{FROM_FILE}{}", file_name(&moving.name), &hash[..16]),
        None => format!("built-in {}", moving.name),
    };
    let motion = Motion {
        fps: moving.motion.fps,
        poses: moving.motion.poses[moving.lead..].to_vec(),
    };
    Ok(Shown {
        motion,
        source,
        warnings: moving.warnings,
        turned: moving.turned,
    })
}

/// A file without its folder: models travel, folders do not.
fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Motions ready to be learnt from, how many poses they show, and how many more were mixed of
/// these. Where poses are learnt from one by one, all are in one list.
pub(super) fn gathered(
    avatar: &Avatar,
    motions: Vec<Motion>,
    options: &TrainOptions,
) -> (Vec<Motion>, [usize; 2]) {
    if options.is_moving() {
        let seen = motions.iter().map(|m| m.poses.len()).sum();
        return (motions, [seen, 0]);
    }
    let all = motions.into_iter().flat_map(|m| m.poses).collect();
    let mut poses = thinned(all, options.poses);
    let seen = poses.len();
    if seen > 0 {
        let noise = &mut Noise::new(options.seed ^ 0x5eed);
        let count = options.mixed.unwrap_or(TrainOptions::MIXED);
        poses.extend(mixed(avatar, &poses, (count, noise)));
    }
    let more = poses.len() - seen;
    (vec![Motion { fps: APART, poses }], [seen, more])
}

#[cfg(test)]
mod tests {
    use muslin_garment::{Recipe, Tee};

    use super::*;

    /// How far weights spread from where they change at once: the mean square of the distance [m²] of what one side has
    /// of the other.
    fn spread_over(garment: &Garment, avatar: &Avatar) -> f64 {
        let figure = avatar.figure(&Default::default()).expect("a body");
        let x = garment
            .worn(avatar, &figure, &[])
            .expect("it can be worn")
            .verts;
        let middle = x.iter().map(|p| p.y).sum::<f64>() / x.len() as f64;
        let mut sharp = Sparse::new();
        x.iter()
            .for_each(|p| sharp.push([(u32::from(p.y > middle), 1.0)]));
        let soft = diffused(&sharp, &garment.faces, (rounds(garment), BONES));
        let crossed = |(p, row): (&glam::DVec3, &[(u32, f64)])| {
            let other = u32::from(p.y <= middle);
            let w = row.iter().find(|e| e.0 == other).map_or(0.0, |e| e.1);
            (w, w * (p.y - middle).powi(2))
        };
        let (w, far) = (x.iter().zip(soft.rows()).map(crossed))
            .fold((0.0, 0.0), |s, c| (s.0 + c.0, s.1 + c.1));
        far / w
    }

    #[test]
    fn weights_spread_alike_however_fine_the_cloth() {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let [coarse, fine] = [0.025, 0.015].map(|edge| {
            let recipe = Recipe::Tee(Tee {
                edge,
                ..Tee::default()
            });
            spread_over(&Garment::make(&avatar, &recipe).expect("a shirt"), &avatar)
        });
        assert!((coarse / fine - 1.0).abs() < 0.15, "{coarse} and {fine}");
    }
}
