//! The wardrobe: trained garments that come with the program.

use std::path::Path;
use std::slice;

use glam::DVec3;
use muslin_body::{Avatar, Figure, Pose, Sparse, names};
use muslin_garment::Worn;
use muslin_io::{read_weights, write_weights};
use muslin_model::{Model, Player};
use muslin_sim::Frame;
use rayon::prelude::*;

use crate::animate::{as_trained, decode_model, model_failure};
use crate::brought::standing_in;
use crate::drape::cloth;
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::layers::{Lead, Predicted, stacked};
use crate::outfit::{Outfit, Piece};
use crate::simulate::SimulateOptions;
use crate::swings;
use crate::train::{Learnt, topology};
use crate::traits;

/// Models by the name of their garment, made by `cargo xtask assets wardrobe`.
pub(crate) const TAUGHT: [(&str, &[u8]); 6] = [
    ("tee", include_bytes!("../../../assets/wardrobe/tee.muslin")),
    (
        "long-sleeve",
        include_bytes!("../../../assets/wardrobe/long-sleeve.muslin"),
    ),
    (
        "trousers",
        include_bytes!("../../../assets/wardrobe/trousers.muslin"),
    ),
    (
        "shorts",
        include_bytes!("../../../assets/wardrobe/shorts.muslin"),
    ),
    (
        "skirt",
        include_bytes!("../../../assets/wardrobe/skirt.muslin"),
    ),
    (
        "dress",
        include_bytes!("../../../assets/wardrobe/dress.muslin"),
    ),
];

/// The trained model of a garment, by name.
pub(crate) fn model(garment: &str) -> Result<Model, Failure> {
    let asked = garment.trim().to_lowercase();
    let Some((name, bytes)) = TAUGHT.iter().find(|t| t.0 == asked) else {
        let near = names::nearest(&asked, TAUGHT.iter().map(|t| t.0));
        let what = format!("no trained {garment:?} comes with the program");
        return Err(Failure::new(Exit::Usage, "not-taught", what)
            .at("--garment")
            .hint(format!(
                "there is {}; `muslin train --garment {garment} -o {}.muslin` teaches another, and --model plays it",
                near.join(", "),
                muslin_io::name(Path::new(Path::new(garment).file_stem().unwrap_or_default()))
            )));
    };
    decode_model(name, bytes)
}

/// The trained garments with their swings found anew, by name: the bytes of their files, where all that was taught
/// stays as it is. `cargo xtask assets swings` keeps them.
pub fn swung_anew() -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let one = |(name, bytes): &(&'static str, &[u8])| {
        let mut weights = read_weights(name, bytes).map_err(|e| file_failure(&e))?;
        let model = Model::from_weights(&weights).map_err(|e| model_failure(&e))?;
        let asked = as_trained(slice::from_ref(&model), &SimulateOptions::default())?.dress;
        let (figure, outfit, worn) = standing_in((&avatar, None), &asked)?;
        let cloth = cloth(&outfit, &worn);
        let model = swings::swinging(model, (&avatar, &figure), &cloth)?;
        let swings = |name: &String| name.starts_with("sway.");
        weights.arrays.retain(|name, _| !swings(name));
        let own = model.to_weights().arrays;
        weights
            .arrays
            .extend(own.into_iter().filter(|a| swings(&a.0)));
        Ok((*name, write_weights(&weights)))
    };
    TAUGHT.par_iter().map(one).collect()
}

/// The trained garments as they are, but that their notes say these `terms` of the recordings that they learnt from.
/// `cargo xtask assets terms` keeps them.
pub fn under_terms(terms: &str) -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let one = |(name, bytes): &(&'static str, &[u8])| {
        let mut weights = read_weights(name, bytes).map_err(|e| file_failure(&e))?;
        let sources = weights.notes.get("trained_on").map(|s| s.split("; "));
        let sources: Vec<String> = sources.into_iter().flatten().map(str::to_owned).collect();
        let learnt = Learnt {
            is_character: false,
            garment: name,
            sources: &sources,
            terms: Some(terms),
        };
        weights.notes.insert("licence".into(), learnt.licence());
        Ok((*name, write_weights(&weights)))
    };
    TAUGHT.iter().map(one).collect()
}

/// Seconds between poses of which there is only one.
const STEP: f64 = 1.0 / 30.0;

/// A garment, its player, and how it is led out of those below it.
type Wise<'a> = (&'a Piece, Player, Option<Lead>);

/// An outfit of trained garments on somebody, which knows where it lies in a pose.
///
/// The networks know their own garment's folds in a pose, for this shape and fabric where they were told
/// of them; they are laid over the garments as they are cut for this body.
pub(crate) struct Known<'a> {
    avatar: &'a Avatar,
    figure: &'a Figure,
    pieces: Vec<Wise<'a>>,
}

impl<'a> Known<'a> {
    /// An outfit that is `worn` so, of garments with these models.
    pub fn new(
        (avatar, figure): (&'a Avatar, &'a Figure),
        (outfit, worn): (&'a Outfit, &[Worn]),
        models: Vec<Model>,
    ) -> Option<Self> {
        let measures = avatar.measure(figure);
        let all = outfit.pieces.par_iter().zip(worn).zip(models);
        let one = |((piece, worn), model): ((&'a Piece, &Worn), Model)| {
            let of = (&piece.fabric, &measures, outfit.cut_for.as_ref());
            let model = traits::told(fitted(model, &worn.verts), of);
            Some((
                piece,
                Player::new(&model, avatar).ok()?,
                Some(Lead::STRANGE),
            ))
        };
        let pieces = all.map(one).collect::<Option<_>>()?;
        Some(Self {
            avatar,
            figure,
            pieces,
        })
    }

    /// An outfit of models that know this figure and fabric already.
    pub fn told((avatar, figure): (&'a Avatar, &'a Figure), pieces: Vec<Wise<'a>>) -> Self {
        Self {
            avatar,
            figure,
            pieces,
        }
    }

    /// Where it lies with each frame of a path of the body in these `poses` [m]; empty if there is no way, or if next to
    /// nothing is known of it.
    pub fn along(&self, path: &[Frame], poses: impl Fn(usize) -> Pose + Sync) -> Vec<Vec<DVec3>> {
        if path.len() < 2 {
            return Vec::new();
        }
        let each = (0..path.len()).into_par_iter();
        let laid: Option<Vec<_>> = each.map(|k| self.laid(&poses(k))).collect();
        laid.filter(|laid| !strays(path, laid)).unwrap_or_default()
    }

    /// Where it lies [m]; nothing if that is nowhere.
    pub fn laid(&self, pose: &Pose) -> Option<Vec<DVec3>> {
        let mut garments = Vec::with_capacity(self.pieces.len());
        let bones = self.avatar.bones(self.figure, pose);
        for (piece, player, lead) in &mut self.pieces.clone() {
            let mut verts = vec![[0.0; 3]; player.n_verts()];
            player.begin(STEP);
            player.frame(pose, &bones, &mut verts);
            let wide = |p: [f32; 3]| DVec3::from_array(p.map(f64::from));
            let verts: Vec<DVec3> = verts.into_iter().map(wide).collect();
            if !verts.iter().all(|p| p.is_finite()) {
                return None;
            }
            garments.push(Predicted {
                garment: &piece.garment,
                x: verts,
                lead: *lead,
            });
        }
        Some(stacked(garments.into_iter()))
    }
}

/// Cloth goes no farther than this many times the skin's way where its networks know the poses: up to 1.4 times where that
/// ends well, from 1.5 times on where they do not.
const ASTRAY: f64 = 1.5;

/// Whether what goes farthest of cloth that goes `along` [m] with a path of the body goes so much farther than what goes
/// farthest of the skin that its networks know little of the way.
fn strays(path: &[Frame], along: &[Vec<DVec3>]) -> bool {
    let farthest = |a: &[DVec3], b: &[DVec3]| {
        let ways = a.iter().zip(b).map(|(a, b)| a.distance(*b));
        ways.fold(0.0, f64::max)
    };
    let skin = path.windows(2).map(|f| farthest(&f[0].skin, &f[1].skin));
    let cloth = along.windows(2).map(|c| farthest(&c[0], &c[1]));
    cloth.sum::<f64>() > ASTRAY * skin.sum::<f64>()
}

/// The models of an outfit; nothing if one of its garments was not taught, or not in this cut.
pub(crate) fn taught(outfit: &Outfit) -> Option<Vec<Model>> {
    outfit.pieces.par_iter().map(model_of).collect()
}

/// The model of a garment of the outfit, if it is of just these triangles.
fn model_of(piece: &Piece) -> Option<Model> {
    let garment = &piece.garment;
    let known = piece.sha256.is_none().then_some(&garment.name)?;
    let (name, bytes) = TAUGHT.iter().find(|t| t.0 == known)?;
    let model = decode_model(name, bytes).ok()?;
    let same = model.notes.get("topology") == Some(&topology(&garment.faces));
    (same && model.n_verts() == garment.n_verts()).then_some(model)
}

/// How the cloth of a model follows the bones of an avatar.
fn weights(model: &Model, avatar: &Avatar) -> Result<Sparse, Failure> {
    let bones = model.bones.iter().map(|name| avatar.bone(name));
    let bones: Vec<usize> = bones
        .collect::<Result<_, _>>()
        .map_err(|e| body_failure(&e))?;
    let mut weights = Sparse::new();
    for v in 0..model.n_verts() {
        let row = model.skin.row(v);
        weights.push(row.map(|(b, w)| (bones[b] as u32, f64::from(w))));
    }
    Ok(weights)
}

/// The model for a garment that lies at `rest` [m] around the body at rest.
fn fitted(model: Model, rest: &[DVec3]) -> Model {
    let template = rest.iter().map(|p| p.as_vec3().to_array()).collect();
    Model { template, ..model }
}

/// The model of an outfit's garment `k`, which lies at `start` [m] around a figure as it is dressed, told of
/// that figure and of the fabric.
pub(crate) fn around(
    model: Model,
    (avatar, figure): (&Avatar, &Figure),
    (outfit, k, start): (&Outfit, usize, &[DVec3]),
) -> Result<Model, Failure> {
    let weights = weights(&model, avatar)?;
    let template = avatar.at_rest(figure, (&weights, start));
    let of = (
        &outfit.pieces[k].fabric,
        &avatar.measure(figure),
        outfit.cut_for.as_ref(),
    );
    Ok(traits::told(fitted(model, &template), of))
}

#[cfg(test)]
mod tests {
    use muslin_body::Shape;
    use muslin_train::has_learnt_skinning;

    use super::*;
    use crate::drape::{lay_outfit, put_on};
    use crate::figure::Sitter;
    use crate::options::{DressOptions, Wear};
    use crate::train::variety;
    use crate::watch::Watch;

    fn outfit(avatar: &Avatar, worn: &str, edge: f64) -> Outfit {
        let options = DressOptions {
            outfit: worn.split(',').map(Wear::parse).collect(),
            edge,
            ..DressOptions::default()
        };
        Outfit::make(avatar, &options, |_| {}).expect("it can be cut")
    }

    #[test]
    fn every_model_is_of_the_garment_that_is_cut_today() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for (name, _) in TAUGHT {
            let made = outfit(&avatar, name, DressOptions::default().edge);
            assert!(taught(&made).is_some(), "{name}");
            let other = outfit(&avatar, name, 0.02);
            assert!(taught(&other).is_none(), "{name} of other triangles");
        }
    }

    #[test]
    fn every_model_says_whose_recordings_it_learnt_from_and_that_is_all_that_stating_them_changes()
    {
        let anew = under_terms("terms of somebody else").expect("sound files");
        for ((name, bytes), (again, stated)) in TAUGHT.iter().zip(&anew) {
            assert_eq!(name, again);
            let [old, mut new] = [*bytes, stated].map(|b| read_weights(name, b).expect(name));
            let licence = new
                .notes
                .insert("licence".into(), old.notes["licence"].clone());
            assert!(
                licence
                    .expect("it has one")
                    .ends_with("under terms of somebody else")
            );
            assert!(
                old == new && old.notes["licence"].contains("mocap.cs.cmu.edu"),
                "{name}"
            );
        }
    }

    #[test]
    fn every_model_was_taught_the_fabrics_that_there_are_and_how_to_follow_the_bones() {
        for (name, _) in TAUGHT {
            let model = model(name).expect("it is there");
            for fabric in variety::fabrics() {
                let is_known = traits::taught(&model, &traits::of_fabric(&fabric));
                assert!(is_known, "{name}: {}", fabric.name);
            }
            assert!(has_learnt_skinning(&model), "{name}");
        }
    }

    #[test]
    fn every_model_knows_how_it_swings_and_what_skin_is_below() {
        for (name, _) in TAUGHT {
            let sway = model(name).expect("it is there").sway.expect(name);
            let most = sway.walls.iter().map(|w| w.weights[0]).fold(0.0, f32::max);
            assert!(sway.len() == 16 && sway.walls.len() > 200, "{name}");
            assert!(most > 0.9, "{name}: {most}");
        }
    }

    #[test]
    fn a_shirt_lies_near_the_body_whatever_its_shape_and_an_unknown_one_nowhere() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for weight in [0.3, 0.8] {
            let shape = Shape::default().with("weight", weight).expect("a share");
            let figure = avatar.figure(&shape).expect("a figure");
            let pose = Pose::stance(&avatar, &figure, "walk").expect("built in");
            let sitter = Sitter::new(&avatar, &shape, pose).expect("sound");
            let lie = |worn: &str, edge: f64| {
                let outfit = outfit(&avatar, worn, edge);
                let worn = put_on(&avatar, &outfit, &sitter.figure).expect("it can be worn");
                let who = (&avatar, &sitter.figure);
                Known::new(who, (&outfit, &worn), taught(&outfit)?)?.laid(&sitter.pose)
            };
            let edge = DressOptions::default().edge;
            let shirt = lie("tee", edge).expect("it was taught");
            let skin = muslin_geom::Surface::new(
                &sitter.posed.verts[avatar.part(muslin_body::Part::Body)],
                avatar.collision_faces(),
            );
            let far = shirt.iter().filter(|p| skin.closest(**p, 0.08).is_none());
            assert!(far.count() < shirt.len() / 20);
            assert!(lie("tee", 0.02).is_none());
        }
    }

    /// Leather trousers, caught in the bend of the hips on the way to a seat, stretch by 20 %.
    #[test]
    fn what_lies_too_tight_where_it_was_laid_is_let_go_there() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let figure = avatar.standard().expect("the default body");
        let pose = Pose::stance(&avatar, &figure, "sit").expect("built in");
        let sitter = Sitter::new(&avatar, &Shape::default(), pose).expect("sound");
        let outfit = outfit(
            &avatar,
            "trousers:nappa-leather",
            DressOptions::default().edge,
        );
        let watch = Watch::nobody();
        let dressed = lay_outfit((&avatar, &sitter), &outfit, &watch).expect("it can be worn");
        assert!(dressed.taught && dressed.quality.within_limits());
        assert!(dressed.quality.fault(false).is_none());
    }

    #[test]
    fn what_was_not_taught_is_named_with_what_was() {
        let fault = model("poncho").expect_err("there is none");
        assert_eq!((fault.exit, fault.code), (Exit::Usage, "not-taught"));
        assert!(
            fault.hint.contains("tee") && fault.hint.contains("--model"),
            "{fault}"
        );
    }

    #[test]
    fn cloth_strays_that_goes_much_farther_than_the_skin_in_all_but_not_in_one_step() {
        let at = |x: f64| vec![DVec3::ZERO, DVec3::X * x];
        let path: Vec<Frame> = [0.0, 0.1, 0.2, 0.3].map(|x| at(x).into()).into();
        let goes = |ways: [f64; 4]| strays(&path, &ways.map(at));
        assert!(!goes([0.0, 0.1, 0.2, 0.3]));
        assert!(
            !goes([0.0, 0.01, 0.31, 0.4]),
            "a step of three times the skin's"
        );
        assert!(goes([0.0, 0.2, 0.31, 0.5]));
        assert!(goes([0.0, 0.2, -0.1, 0.1]), "to and fro");
        assert!(!strays(&path[..1], &[at(0.0)]), "no way");
    }
}
