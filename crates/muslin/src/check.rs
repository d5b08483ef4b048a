//! What files are, and whether jobs can use them: told in words before hours are spent.
//!
//! Every file goes through what the jobs themselves do with it first: a garment is read, fitted or sewn and put on the
//! body, a motion is led over to it, a character gets its likeness, a trained garment is held against the one that is
//! cut today.

use std::path::{Path, PathBuf};

use muslin_body::Avatar;
use muslin_geom::{Report, Value};
use muslin_io::{PhotoLimits, files_in, read_clip, read_file, read_photo};

use crate::animate::{as_trained, fits, note_of, read_model, wants_character};
use crate::brought::{led, lies};
use crate::drape::put_on;
use crate::dress::{asked_figure, file_failure, people};
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of, standing};
use crate::options::{DressOptions, Wear};
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::simulate::{SimulateOptions, motion};
use crate::table::Table;
use crate::tell;
use crate::watch::Watch;

/// What a file may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Garment,
    Fabric,
    Motion,
    Character,
    Model,
    Clip,
    Photo,
}

/// What was found in a file that can be used.
struct Found {
    kind: &'static str,
    told: String,
    warnings: Vec<String>,
}

/// Says of each of `files` what it is and what the user should know of it; `options` tell who wears and moves it, and
/// how finely garments are cut.
///
/// Of those that cannot be used the outcome says why, and its fault is what a job would end with; if it is several, which.
///
/// # Errors
/// What stops all of them: the options, the character, or the user.
pub fn check(
    files: &[PathBuf],
    options: &DressOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    let whole = DressOptions {
        outfit: vec![Wear::parse("tee")],
        ..options.clone()
    };
    whole.check()?;
    if files.is_empty() {
        let fault = Failure::new(Exit::Usage, "no-file", "no file to look at");
        return Err(fault.hint("name garments, motions, characters, fabrics, models or photos"));
    }
    let hero = Hero::load(options)?;
    let avatar = avatar_of(hero.as_ref())?;
    let room = Room {
        who: (&avatar, hero.as_ref()),
        options,
    };
    let files: Vec<PathBuf> = files.iter().flat_map(|p| opened(p)).collect();
    let mut table = Table::new(&["file", "it is", "and has"]);
    let (mut all, mut faults) = (Vec::new(), Vec::new());
    let mut stopped = None;
    for (k, path) in files.iter().enumerate() {
        let file = muslin_io::name(path.file_name().unwrap_or_default().as_ref());
        watch.progress(&file);
        let line = match room.look(path) {
            Ok(found) => {
                let warnings = found.warnings.iter();
                warnings.for_each(|w| watch.warn(&format!("{file}: {w}")));
                table.row([&file, found.kind, &found.told]);
                let list = found.warnings.iter().map(|w| Value::from(w.as_str()));
                let mut r = Report::default();
                r.set("file", file.as_str()).set("kind", found.kind);
                r.set("told", found.told.as_str());
                r.set("warnings", list.collect::<Vec<_>>());
                all.push(Value::Tree(r));
                format!("{file}: {}, {}", found.kind, found.told)
            }
            Err(fault) => {
                table.row([file.as_str(), "no use", fault.what.as_str()]);
                all.push(Value::Tree(useless(&file, &fault)));
                faults.push(fault);
                format!("{file}: no use")
            }
        };
        // What was looked at is told, even if the user does not wait for the rest.
        if let Err(stop) = watch.done((k + 1, files.len()), "file", line) {
            stopped = Some(stop);
            break;
        }
    }
    let mut report = Report::default();
    report.set("files", all);
    let fault = match faults.len() {
        0 | 1 => faults.pop(),
        n => {
            let each: Vec<String> = faults.iter().map(Failure::to_string).collect();
            let what = format!("{n} files cannot be used\n{}", each.join("\n"));
            Some(Failure::new(faults[0].exit, "check", what))
        }
    };
    Ok(Outcome {
        fault: stopped.or(fault),
        ..Outcome::new(table.text(), &report)
    })
}

/// What the report says of a file that no job can use.
fn useless(file: &str, fault: &Failure) -> Report {
    let mut error = Report::default();
    error
        .set("code", fault.code)
        .set("exit", fault.exit as usize)
        .set("what", fault.what.as_str());
    if !fault.hint.is_empty() {
        error.set("hint", fault.hint.as_str());
    }
    let mut r = Report::default();
    r.set("file", file).set("error", error);
    r
}

/// Where files are tried.
struct Room<'a> {
    who: (&'a Avatar, Option<&'a Hero>),
    options: &'a DressOptions,
}

impl Room<'_> {
    fn look(&self, path: &Path) -> Result<Found, Failure> {
        let file = muslin_io::name(path);
        let kind = match motion::named(&file) {
            (_, Some(_)) => Kind::Motion,
            _ => kind(path)?,
        };
        match kind {
            Kind::Garment => self.garment(path),
            Kind::Fabric => fabric_of(path),
            Kind::Motion => self.motion(path),
            Kind::Character => self.character(path),
            Kind::Model => self.model(path),
            Kind::Clip => clip(path),
            Kind::Photo => photo(path),
        }
        .map_err(
            |fault| match fault.place.is_empty() && !fault.what.contains(&file) {
                true => fault.at(file),
                false => fault,
            },
        )
    }

    /// A garment, put on.
    fn garment(&self, path: &Path) -> Result<Found, Failure> {
        let dress = DressOptions {
            outfit: vec![Wear {
                garment: path.to_string_lossy().into_owned(),
                fabric: None,
            }],
            ..self.options.clone()
        };
        let mut warnings = Vec::new();
        let outfit = Outfit::make_for(self.who, &dress, |w: &str| warnings.push(w.to_owned()))?;
        let (figure, ..) = asked_figure(self.who.0, &dress)?;
        warnings.extend(self.caught(&outfit, &figure)?);
        let openings = |p: &crate::outfit::Piece| p.garment.rims.len();
        let n: usize = outfit.pieces.iter().map(openings).sum();
        Ok(Found {
            kind: "garment",
            told: format!("{}; {}", tell::pieces(&outfit), count(n, "opening")),
            warnings,
        })
    }

    /// Where it does not lie clean on who wears it; of what lies as it was read, that was said.
    fn caught(
        &self,
        outfit: &Outfit,
        figure: &muslin_body::Figure,
    ) -> Result<Option<String>, Failure> {
        let avatar = self.who.0;
        let (pose, stood) = avatar.dressing(figure);
        if lies(avatar, outfit, &stood)? {
            return Ok(None);
        }
        let worn = put_on(avatar, outfit, &stood)?;
        let settled = led((avatar, figure), &pose, (outfit, &worn))?;
        let (inside, crossed) = (settled.body_intersections, settled.self_crossings);
        Ok((inside + crossed > 0).then(|| {
            format!(
                "put on and at rest it meets the body in {inside} places and itself in {crossed}: no job may get out of that"
            )
        }))
    }

    fn motion(&self, path: &Path) -> Result<Found, Failure> {
        let options = SimulateOptions {
            dress: self.options.clone(),
            motion: path.to_string_lossy().into_owned(),
            ..SimulateOptions::default()
        };
        let (figure, ..) = asked_figure(self.who.0, self.options)?;
        let moving = motion::load(self.who, &figure, &options)?;
        let fps = moving.motion.fps;
        Ok(Found {
            kind: "motion",
            told: format!(
                "{:.2} s; limbs turn by up to {:.0} degrees to make room for cloth",
                moving.frames() as f64 / fps,
                moving.turned.to_degrees()
            ),
            warnings: moving.warnings,
        })
    }

    /// A character, as garments would be put on it.
    fn character(&self, path: &Path) -> Result<Found, Failure> {
        let options = DressOptions {
            body: Some(path.to_owned()),
            ..self.options.clone()
        };
        let hero = Hero::load(&options)?;
        let avatar = avatar_of(hero.as_ref())?;
        let stands = standing(&avatar, hero.as_ref(), &options)?;
        let clips = hero.map_or_else(Vec::new, |h| h.file.clips);
        let clips = match clips.is_empty() {
            true => "no animations".to_owned(),
            false => format!("animations {}", clips.join(", ")),
        };
        Ok(Found {
            kind: "character",
            told: format!("{}; {clips}", stands.told),
            warnings: stands.warnings,
        })
    }

    /// A trained garment, held against what is cut today.
    fn model(&self, path: &Path) -> Result<Found, Failure> {
        let model = read_model(path)?;
        wants_character(&model, self.who.1.is_some())?;
        let options = SimulateOptions {
            dress: self.options.clone(),
            ..SimulateOptions::default()
        };
        let dress = as_trained(std::slice::from_ref(&model), &options)?.dress;
        let mut warnings = Vec::new();
        let outfit = Outfit::make_for(self.who, &dress, |w: &str| warnings.push(w.to_owned()))?;
        fits(&model, &outfit.pieces[0].garment)?;
        let any = |what: &str, name: &str| match note_of(&model, name) {
            "any" => format!("any {what}"),
            _ => format!("one {what}"),
        };
        let knows = [("fabric", "fabrics"), ("body", "shapes"), ("size", "sizes")];
        let knows: Vec<String> = knows.iter().map(|(what, name)| any(what, name)).collect();
        Ok(Found {
            kind: "trained garment",
            told: format!(
                "{} by {}, for {}; {} codes",
                note_of(&model, "garment"),
                note_of(&model, "system"),
                knows.join(", "),
                model.n_codes()
            ),
            warnings,
        })
    }
}

fn fabric_of(path: &Path) -> Result<Found, Failure> {
    let (fabric, mut warnings) = fabric::find(&path.to_string_lossy())?;
    warnings.extend(fabric.warnings());
    Ok(Found {
        kind: "fabric",
        told: format!(
            "{}, {:.0} g/m2, stretch {:.0} and {:.0} N/m",
            fabric.name,
            fabric.density * 1e3,
            fabric.stretch_warp,
            fabric.stretch_weft
        ),
        warnings,
    })
}

fn clip(path: &Path) -> Result<Found, Failure> {
    let clip = read_clip(path).map_err(|e| file_failure(&e))?;
    let body = match clip.body.is_empty() {
        true => "no body",
        false => "a body",
    };
    Ok(Found {
        kind: "animated cloth",
        told: format!(
            "{}, {}, {body}",
            count(clip.drape.frames.len(), "frame"),
            count(clip.garments().len(), "garment")
        ),
        warnings: Vec::new(),
    })
}

fn photo(path: &Path) -> Result<Found, Failure> {
    let photo = read_photo(path, &PhotoLimits::default()).map_err(|e| file_failure(&e))?;
    let n = people(&photo)?;
    let who = if n == 1 { "person" } else { "people" };
    Ok(Found {
        kind: "photo",
        told: format!("{} x {}, {n} {who}", photo.image.width, photo.image.height),
        warnings: Vec::new(),
    })
}

/// As in `1 frame` and `2 frames`.
fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Files with more bytes are not looked into for what they are.
const MAX_BYTES: u64 = 512 << 20;

/// A folder of motions as those; everything else as itself.
fn opened(path: &Path) -> Vec<PathBuf> {
    let all = match path.is_dir() {
        true => files_in(path, &motion::KINDS).unwrap_or_default(),
        false => Vec::new(),
    };
    match all.first().map(|first| kind(first)) {
        Some(Ok(Kind::Motion)) => all,
        _ => vec![path.to_owned()],
    }
}

/// What a file may be, by its ending and, where that says too little, by what is in it.
fn kind(path: &Path) -> Result<Kind, Failure> {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let holds = |what: &[u8]| {
        let input = read_file(path, MAX_BYTES).map_err(|e| file_failure(&e))?;
        let bytes = &input.bytes;
        Ok::<bool, Failure>(bytes.windows(what.len()).any(|w| w == what))
    };
    // A piece of a file has its number behind it.
    let ending = ending.split('#').next().unwrap_or_default().to_lowercase();
    Ok(match ending.as_str() {
        _ if path.is_dir() => Kind::Clip,
        "obj" => Kind::Garment,
        "json" if holds(b"\"panels\"")? => Kind::Garment,
        "json" | "toml" | "u3m" | "u3ma" => Kind::Fabric,
        "npz" if holds(b"cloth.npy")? => Kind::Clip,
        "bvh" | "npz" | "vrma" => Kind::Motion,
        "glb" if holds(b"\"rest_corners\"")? => Kind::Clip,
        // What was baked, but not a character's own file with baked garments in it, which says how many nodes are its own.
        "glb" if holds(b"\"muslin\":\"garment\"")? && !holds(b"\"character_nodes\"")? => Kind::Clip,
        "glb" | "gltf" if holds(b"\"animations\"")? && !holds(b"\"skins\"")? => Kind::Motion,
        "glb" | "gltf" | "vrm" => Kind::Character,
        "pc2" => Kind::Clip,
        "muslin" => Kind::Model,
        "jpg" | "jpeg" | "png" | "webp" => Kind::Photo,
        _ => {
            let what = "no kind of file that is read here";
            let fault = Failure::new(Exit::Refused, "unknown-kind", what);
            return Err(fault.at(muslin_io::name(path)).hint(
                "garments are .obj and .json, fabrics .toml, .u3m and .u3ma, motions .bvh, .npz and .vrma, characters .glb, .gltf and .vrm, photos .jpg, .png and .webp",
            ));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_by_endings_and_by_what_is_inside() {
        let folder = std::env::temp_dir().join(format!("muslin-check-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let put = |name: &str, text: &str| {
            let path = folder.join(name);
            std::fs::write(&path, text).expect("a small file");
            kind(&path).map_err(|f| f.code)
        };
        assert_eq!(put("a.OBJ", ""), Ok(Kind::Garment));
        assert_eq!(put("a.json", "{ \"panels\": {} }"), Ok(Kind::Garment));
        assert_eq!(put("b.json", "{ \"weave\": 1 }"), Ok(Kind::Fabric));
        assert_eq!(put("a.npz", "PK cloth.npy"), Ok(Kind::Clip));
        assert_eq!(put("b.npz", "PK poses.npy"), Ok(Kind::Motion));
        assert_eq!(put("a.vrm", ""), Ok(Kind::Character));
        assert_eq!(put("a.docx", ""), Err("unknown-kind"));
        assert_eq!(put("a.vrma", ""), Ok(Kind::Motion));
        let character = "{ \"skins\": [], \"animations\": [] }";
        assert_eq!(put("a.gltf", character), Ok(Kind::Character));
        assert_eq!(put("b.gltf", "{ \"animations\": [] }"), Ok(Kind::Motion));
        let baked = "glTF { \"muslin\":\"garment\" }";
        assert_eq!(put("a.glb", baked), Ok(Kind::Clip));
        let dressed = format!("{baked} \"character_nodes\"");
        assert_eq!(put("b.glb", &dressed), Ok(Kind::Character));
        let takes = folder.join("takes");
        std::fs::create_dir_all(&takes).expect("a temporary folder");
        assert_eq!(opened(&takes), [takes.as_path()]);
        put("takes/b.bvh", "").expect("a motion");
        put("takes/a.vrma", "").expect("a motion");
        assert_eq!(opened(&takes), [takes.join("a.vrma"), takes.join("b.bvh")]);
        assert_eq!(kind(&folder).map_err(|f| f.code), Ok(Kind::Clip));
        std::fs::remove_dir_all(&folder).expect("our own folder");
        let gone = kind(&folder.join("c.json")).expect_err("it is gone");
        assert_eq!(gone.exit, Exit::Files);
    }
}
