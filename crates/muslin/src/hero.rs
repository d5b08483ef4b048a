//! Who wears it: our own body, or a character that our body is made to resemble.

use std::sync::OnceLock;

use glam::DAffine3;
use muslin_body::{Avatar, Character, Figure, Motion, Pose, Shape, Twin};
use muslin_geom::Report;
use muslin_io::{CharacterFile, read_character};

use crate::dress::{asked_figure, file_failure};
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::options::DressOptions;

/// A character from a file, and our body in its likeness.
#[derive(Clone, Debug)]
pub struct Hero {
    /// As it was read.
    pub file: CharacterFile,
    /// The same on our floor, in metres.
    pub character: Character,
    /// Our body in its likeness.
    pub twin: Twin,
    /// Our body as it is; garments are cut on it and then put on the likeness.
    pub base: Avatar,
    /// From the file's places to ours.
    pub ours_from_file: DAffine3,
    colours: OnceLock<Vec<[f32; 3]>>,
}

/// Above this share of skin that our likeness does not cover, a warning is due.
const UNCOVERED: f64 = 0.02;
/// Above this share there is no body to be seen.
const STRANGE: f64 = 0.3;

impl Hero {
    /// The character that the options name, if they do.
    pub fn load(options: &DressOptions) -> Result<Option<Hero>, Failure> {
        let Some(path) = &options.body else {
            return Ok(None);
        };
        if path.extension().is_none() && !path.exists() {
            let what = format!("no body is called {:?}", muslin_io::name(path));
            let fault = Failure::new(Exit::Usage, "unknown-body", what).at("--body");
            return Err(fault.hint("there is anny; a character is a .glb, .gltf or .vrm file"));
        }
        let file = read_character(path).map_err(|e| file_failure(&e))?;
        let place = |e: &muslin_body::BodyError| {
            Failure::new(Exit::Invalid, "character", e.to_string())
                .at(file.file.clone())
                .hint("a character needs two arms, two legs, a trunk and a head, each with its joints")
        };
        let base = Avatar::embedded().map_err(|e| body_failure(&e))?;
        let mut character = file.character.clone();
        let stood = character.stand(&base, options.height);
        let ours_from_file = stood.map_err(|e| place(&e))?;
        let twin = Twin::new(&base, &Shape::default(), &character).map_err(|e| place(&e))?;
        let strange = twin.uncovered.max(twin.unmet);
        if strange > STRANGE {
            let what = format!(
                "its skin is not that of a body: {:.0} % of it is not where our body, bent to its skeleton, has skin",
                strange * 100.0
            );
            let fault = Failure::new(Exit::Invalid, "character", what).at(file.file);
            return Err(fault.hint(
                "bind the skin to the whole skeleton, arms and legs in sleeves of their own",
            ));
        }
        Ok(Some(Hero {
            file,
            character,
            twin,
            base,
            ours_from_file,
            colours: OnceLock::new(),
        }))
    }

    /// Linear light of each of the character's vertices, as its materials have it.
    pub fn colours(&self) -> &[[f32; 3]] {
        self.colours.get_or_init(|| self.file.colours())
    }

    /// An animation of its file by name or number, if it has one, in our places.
    pub fn clip(&self, name: &str, fps: f64) -> Result<Option<Motion>, Failure> {
        let Some(clip) = self.file.clip(name) else {
            return Ok(None);
        };
        let frames = self.file.play(clip, fps).map_err(|e| file_failure(&e))?;
        let (mut follower, mut pose) = (self.twin.follower(), Pose::rest(&self.twin.avatar));
        let figure = self.twin.avatar.figure(&Shape::default());
        let figure = figure.map_err(|e| body_failure(&e))?;
        let poses = frames.iter().map(|joints| {
            let ours: Vec<DAffine3> = joints.iter().map(|j| self.ours_from_file * *j).collect();
            follower.follow(&ours, &mut pose);
            let bones = self.twin.avatar.bones(&figure, &pose);
            Pose {
                beyond: self.twin.beyond(&bones, &ours),
                ..pose.clone()
            }
        });
        Ok(Some(Motion {
            fps,
            poses: poses.collect(),
        }))
    }

    /// What the report says of it.
    fn report(&self, r: &mut Report) {
        r.set("file", self.file.file.as_str());
        r.set("sha256", self.file.sha256.as_str());
        r.set("scale", self.ours_from_file.matrix3.determinant().cbrt());
        r.set("joints", self.character.parents.len());
        r.set("vertices", self.character.verts.len());
        let percent = (self.twin.uncovered * 1e4).round() / 100.0;
        r.set("uncovered_percent", percent);
        r.set("unmet_percent", (self.twin.unmet * 1e4).round() / 100.0);
    }

    /// What the user should know.
    fn warnings(&self) -> Vec<String> {
        let mut all = Vec::new();
        let scale = self.ours_from_file.matrix3.determinant().cbrt();
        if (scale - 1.0).abs() > 1e-6 {
            all.push(format!(
                "{} is dressed at {:.0} cm, {scale:.3} of its size; --height sets another",
                self.file.file,
                self.character.height() * 100.0
            ));
        }
        if !self.file.wears.is_empty() {
            all.push(format!(
                "it wears {} already, which stay as they are; dress the file that these were made for",
                self.file.wears.join(", ")
            ));
        }
        if self.twin.uncovered > UNCOVERED {
            all.push(format!(
                "{:.1} % of its vertices stick out of the skin that cloth lies on (hair, armour, clothes?): cloth may pass through them",
                self.twin.uncovered * 100.0
            ));
        }
        all
    }
}

/// Whom motions move and garments are put on: the likeness of the character, or our own body.
pub(crate) fn avatar_of(hero: Option<&Hero>) -> Result<Avatar, Failure> {
    match hero {
        Some(hero) => Ok(hero.twin.avatar.clone()),
        None => Avatar::embedded().map_err(|e| body_failure(&e)),
    }
}

/// Somebody at rest, and what is to be told of them.
pub(crate) struct Standing {
    pub figure: Figure,
    pub report: Report,
    /// The line for the user.
    pub told: String,
    pub warnings: Vec<String>,
}

/// The body that was asked for, or the character's likeness, at rest.
pub(crate) fn standing(
    avatar: &Avatar,
    hero: Option<&Hero>,
    options: &DressOptions,
) -> Result<Standing, Failure> {
    let (figure, mut report, told) = asked_figure(avatar, options)?;
    if let Some(hero) = hero {
        hero.report(&mut report);
    }
    Ok(Standing {
        figure,
        report,
        told,
        warnings: hero.map_or_else(Vec::new, Hero::warnings),
    })
}

/// What a model that was taught on our own body says of it.
pub(crate) const OURS: &str = "anny";

/// What a model says of the body that it was taught on.
pub(crate) fn body_note(hero: Option<&Hero>) -> String {
    match hero {
        Some(hero) => format!("sha256:{}", &hero.file.sha256[..16]),
        None => OURS.into(),
    }
}
