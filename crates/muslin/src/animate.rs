//! Playing trained garments: from models and a motion to an animation on disk.

mod frames;
mod options;

use std::path::Path;

use muslin_body::Avatar;
use muslin_geom::{Report, Value};
use muslin_io::{read_file, read_weights};
use muslin_model::{Model, ModelError};

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, OURS, Standing, avatar_of, body_note, standing};
use crate::options::{DressOptions, Wear};
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::simulate::files::{self, Folders, Made};
use crate::simulate::motion;
use crate::simulate::quality::{Quality, round};
use crate::simulate::set::Set;
use crate::simulate::{SimulateOptions, measured};
use crate::size::Size;
use crate::swings;
use crate::table::Table;
use crate::tell;
use crate::train::topology;
use crate::traits;
use crate::wardrobe;
use crate::watch::Watch;
use muslin_garment::{Cut, Garment};

use frames::{Played, play};
pub(crate) use frames::{along, predict};
pub use options::AnimateOptions;

/// How many stages an animation has.
const STAGES: usize = 5;
/// Models with more bytes are refused.
const MOST_BYTES: u64 = 256 << 20;

/// Plays a model on a motion, or several garments one over the other, and writes the animation to `out` (a
/// `.glb`), with `NAME.report.json` beside it.
///
/// Cloth of our own models swings on from where the first frame was led to, `refine` iterations for each
/// of the solver's steps in time; without motion, and for the published systems, every frame that the
/// network predicts is led by as many to where it lies without touching. Frames are checked by exact
/// predicates, and those that fail are solved again.
/// With `refine` zero frames are written as predicted, and the report says `unchecked`.
pub fn animate(
    out: &Path,
    options: &AnimateOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    options.check(out)?;
    let models = models(options)?;
    for model in &models {
        knows(model, options)?;
        wants_character(model, options.simulate.dress.body.is_some())?;
    }
    let simulate = as_trained(&models, &options.simulate)?;
    let hero = Hero::load(&simulate.dress)?;
    let avatar = avatar_of(hero.as_ref())?;
    let folders = Folders::open(out, &simulate, options.models.clone())?;
    let mut stage = Theatre {
        hero: hero.as_ref(),
        options,
        watch,
        report: Report::default(),
        times: Report::default(),
        warnings: Vec::new(),
    };
    let set = stage.set(&avatar, &models, &simulate)?;
    let strangers = stage.strangers(&models, &set, &simulate.dress)?;
    let mut ready = Vec::with_capacity(models.len());
    for (k, (model, stranger)) in models.into_iter().zip(strangers).enumerate() {
        ready.push(stage.swinging((k, set.told(k, model)?), &set, stranger)?);
    }
    stage.perform((&set, &ready), &simulate, (out, folders))
}

/// The models that are asked for, innermost first.
fn models(options: &AnimateOptions) -> Result<Vec<Model>, Failure> {
    if options.models.is_empty() {
        let worn = &options.simulate.dress.outfit;
        return worn.iter().map(|w| wardrobe::model(&w.garment)).collect();
    }
    options.models.iter().map(|p| read_model(p)).collect()
}

/// The model in a file.
pub(crate) fn read_model(path: &Path) -> Result<Model, Failure> {
    let input = read_file(path, MOST_BYTES).map_err(|e| file_failure(&e))?;
    decode_model(&input.file, &input.bytes)
}

/// The model in these bytes of a file.
pub(crate) fn decode_model(file: &str, bytes: &[u8]) -> Result<Model, Failure> {
    let weights = read_weights(file, bytes).map_err(|e| file_failure(&e))?;
    Model::from_weights(&weights).map_err(|e| model_failure(&e).at(file.to_owned()))
}

/// Refuses a motion level for a model that cannot tell motion from the pose.
fn knows(model: &Model, options: &AnimateOptions) -> Result<(), Failure> {
    if options.motion_level.is_none() || swings::are_ours(model) || model.has_motion_level() {
        return Ok(());
    }
    let what = match model.encoder.is_moving() {
        true => "the model does not tell motion from the pose",
        false => "the model knows poses, not motion",
    };
    Err(Failure::new(Exit::Usage, "no-motion-level", what)
        .at("--motion-level")
        .hint("our own models and those of `muslin train ncs` have one"))
}

/// The body that a model was taught on.
fn body_of(model: &Model) -> &str {
    model.notes.get("body").map_or(OURS, String::as_str)
}

/// Refuses a model that was taught on a character without that character.
pub(crate) fn wants_character(model: &Model, is_character: bool) -> Result<(), Failure> {
    let taught = body_of(model);
    if is_character || taught == OURS {
        return Ok(());
    }
    let what = format!("the model was taught on a character ({taught})");
    Err(Failure::new(Exit::Usage, "no-character", what)
        .at("--body")
        .hint("name the character's file with --body"))
}

/// What to say where a model that knows motion is played at another rate than it was taught.
fn other_rate(model: &Model, fps: f64) -> Option<String> {
    let taught: f64 = model.notes.get("fps")?.parse().ok()?;
    (model.encoder.is_moving() && taught != fps).then(|| {
        format!("the model was taught at {taught} frames a second; at {fps} its motion is off")
    })
}

pub(crate) fn model_failure(e: &ModelError) -> Failure {
    Failure::new(Exit::Invalid, "model", e.to_string())
        .hint("give a file that `muslin train` wrote")
}

/// The options with the garments that the models were trained with, and with their body and fabrics where no
/// others were asked for. An outfit is of one body, cut, size and edge.
pub(crate) fn as_trained(
    models: &[Model],
    asked: &SimulateOptions,
) -> Result<SimulateOptions, Failure> {
    let mut all: Option<DressOptions> = None;
    for (k, model) in models.iter().enumerate() {
        let own = dress_of((k, model), &asked.dress)?;
        let Some(first) = &mut all else {
            all = Some(own);
            continue;
        };
        let same = [
            ("height", first.height == own.height),
            ("weight", first.weight == own.weight),
            ("gender", first.gender == own.gender),
            ("edge", first.edge == own.edge),
            ("cut", first.cut == own.cut),
            ("size", first.size == own.size),
        ];
        if let Some((what, _)) = same.iter().find(|s| !s.1) {
            let garments = [&first.outfit[0], &own.outfit[0]].map(|w| w.garment.as_str());
            let what = format!(
                "{} and {} were taught with another {what}",
                garments[0], garments[1]
            );
            return Err(Failure::new(Exit::Usage, "other-outfit", what)
                .at("--model")
                .hint("train them with the same options, or play them one by one"));
        }
        first.outfit.extend(own.outfit);
    }
    Ok(SimulateOptions {
        dress: all.unwrap_or_else(|| asked.dress.clone()),
        ..asked.clone()
    })
}

/// The same of one model, number `k` of the outfit.
fn dress_of((k, model): (usize, &Model), asked: &DressOptions) -> Result<DressOptions, Failure> {
    let note = |name: &str| note_of(model, name);
    let number = |name: &str| number(model, name);
    let cut = match note("cut") {
        "slim" => Cut::Slim,
        "loose" => Cut::Loose,
        _ => Cut::Regular,
    };
    let fabric = asked.outfit.get(k).and_then(|w| w.fabric.clone());
    // A character is not as tall and heavy as one of our bodies that the model was taught on, nor the other way round.
    let is_alike = asked.body.is_some() == (body_of(model) != OURS);
    let shape = |name: &str| if is_alike { number(name) } else { Ok(None) };
    let wear = Wear {
        garment: note("garment").to_owned(),
        fabric: fabric.or_else(|| Some(note("fabric").to_owned())),
    };
    Ok(DressOptions {
        outfit: vec![wear],
        height: asked.height.or(shape("height")?),
        weight: asked.weight.or(shape("weight")?),
        gender: asked.gender.or(shape("gender")?),
        edge: number("edge")?.unwrap_or(asked.edge),
        cut,
        size: asked.size.or_else(|| Size::parse(note("size")).ok()),
        ..asked.clone()
    })
}

pub(crate) fn note_of<'m>(model: &'m Model, name: &str) -> &'m str {
    model.notes.get(name).map_or("", String::as_str)
}

/// Whether body, shape, fabric and size are others than those that a model's file is of, for garment `k` of an
/// outfit.
pub(crate) fn others(
    (k, model): (usize, &Model),
    dress: &DressOptions,
    body: &str,
) -> Result<[bool; 4], Failure> {
    let asked = [dress.height, dress.weight, dress.gender];
    let mut shape = false;
    for (name, asked) in ["height", "weight", "gender"].into_iter().zip(asked) {
        shape |= number(model, name)? != asked;
    }
    Ok([
        model.notes.contains_key("body") && note_of(model, "body") != body,
        shape,
        Some(note_of(model, "fabric")) != dress.outfit[k].fabric.as_deref(),
        note_of(model, "size") != dress.size.map_or("", Size::label),
    ])
}

/// A number that the model was trained with, if it was.
fn number(model: &Model, name: &str) -> Result<Option<f64>, Failure> {
    match note_of(model, name) {
        "" => Ok(None),
        text => text.parse().map(Some).map_err(|_| {
            let what = format!("its note {name:?} is no number");
            Failure::new(Exit::Invalid, "model", what)
        }),
    }
}

struct Theatre<'a, 'w> {
    hero: Option<&'a Hero>,
    options: &'a AnimateOptions,
    watch: &'a mut Watch<'w>,
    report: Report,
    times: Report,
    warnings: Vec<String>,
}

impl<'a> Theatre<'a, '_> {
    fn done(&mut self, number: usize, name: &'static str, result: String) -> Result<(), Failure> {
        let seconds = self.watch.done((number, STAGES), name, result)?;
        self.times.set(name, round(seconds));
        Ok(())
    }

    fn warn(&mut self, warnings: impl IntoIterator<Item = String>) {
        for warning in warnings {
            self.watch.warn(&warning);
            self.warnings.push(warning);
        }
    }

    /// Body, motion and garments, as the models know them.
    fn set<'s>(
        &mut self,
        avatar: &'s Avatar,
        models: &[Model],
        simulate: &SimulateOptions,
    ) -> Result<Set<'s>, Failure>
    where
        'a: 's,
    {
        let Standing {
            figure,
            report,
            told,
            warnings,
        } = standing(avatar, self.hero, &simulate.dress)?;
        self.warn(warnings);
        self.report.set("body", report);
        self.done(1, "body", told)?;
        let mut moving = motion::load((avatar, self.hero), &figure, simulate)?;
        self.warn(std::mem::take(&mut moving.warnings));
        self.report.set("motion", moving.report());
        let told = format!(
            "{}: {} frames at {} a second",
            moving.name,
            moving.frames(),
            moving.motion.fps
        );
        self.done(2, "motion", told)?;
        self.warn(models.iter().find_map(|m| other_rate(m, simulate.fps)));
        let mut warnings = Vec::new();
        let note = |w: &str| warnings.push(w.to_owned());
        let outfit = Outfit::make_for((avatar, self.hero), &simulate.dress, note)?;
        self.warn(warnings);
        self.report.set("outfit", tell::outfit(&outfit));
        tell::size(&mut self.report, &outfit);
        let told = tell::pieces(&outfit);
        let mut set = Set::rested(avatar, figure, moving, outfit)?;
        set.hero = self.hero;
        for (model, piece) in models.iter().zip(&set.outfit.pieces) {
            fits(model, &piece.garment)?;
        }
        self.done(3, "garment", told)?;
        Ok(set)
    }

    /// Says what the models never met, and for each whether wearer or fabric are others than those that its
    /// file is of.
    fn strangers(
        &mut self,
        models: &[Model],
        set: &Set,
        dress: &DressOptions,
    ) -> Result<Vec<bool>, Failure> {
        let of_wearer = traits::of_wearer(&set.avatar.measure(&set.figure));
        let of_cut = traits::of_cut(set.outfit.cut_for.as_ref());
        let mut strange = [("body", false), ("fabric", false), ("size", false)];
        let mut all = Vec::with_capacity(models.len());
        for (k, (model, piece)) in models.iter().zip(&set.outfit.pieces).enumerate() {
            let of_fabric = traits::of_fabric(&piece.fabric);
            let others = others((k, model), dress, &body_note(self.hero))?;
            let [body, shape, fabric, size] = others;
            let own = [
                body || (shape && !traits::taught(model, &of_wearer)),
                fabric && !traits::taught(model, &of_fabric),
                size && !traits::taught(model, &of_cut),
            ];
            strange.iter_mut().zip(own).for_each(|(s, own)| s.1 |= own);
            all.push(others.contains(&true));
        }
        let others: Vec<&str> = strange.iter().filter(|s| s.1).map(|s| s.0).collect();
        let list = others.iter().map(|o| Value::from(*o));
        self.report.set("not_taught", list.collect::<Vec<_>>());
        if !others.is_empty() && self.options.refine == 0 {
            let what = others.join(" and ");
            self.warn([format!(
                "the model was taught with another {what}: its folds are laid over this one unchanged"
            )]);
        }
        Ok(all)
    }

    /// Model `k` with the swings of the garment as it is worn: its own, or those of another body or
    /// fabric. The published systems know motion in their own ways, or not at all.
    fn swinging(
        &mut self,
        (k, model): (usize, Model),
        set: &Set,
        stranger: bool,
    ) -> Result<Model, Failure> {
        let wanted = self.options.motion_level != Some(0.0);
        if !swings::are_ours(&model) || !wanted || (model.sway.is_some() && !stranger) {
            return Ok(model);
        }
        self.watch.progress("how it swings");
        swings::swinging(model, (set.avatar, &set.figure), &set.cloth_of(k))
    }

    fn perform(
        mut self,
        (set, models): (&Set, &[Model]),
        simulate: &SimulateOptions,
        (out, folders): (&Path, Folders),
    ) -> Result<Outcome, Failure> {
        let level = self.options.motion_level.unwrap_or(1.0);
        let played = play((set, models), (self.options.refine, level), self.watch)?;
        let Played { reel, raw } = played;
        let (clip, quality) = measured(set, reel);
        let refined = self.options.refine > 0;
        let mut r = Report::default();
        r.set("refine", self.options.refine);
        if models.iter().any(Model::has_motion_level) {
            r.set("motion_level", level);
        }
        r.set("checked", if refined { "exact" } else { "unchecked" });
        r.set("frames_solved_again", quality.again);
        r.set("raw_frames_a_second", raw.rate.round());
        r.set("raw_vertices_inside_percent", raw.inside);
        let notes = models.iter().map(|m| Value::Tree(notes(m)));
        r.set("models", notes.collect::<Vec<_>>());
        self.report.set("animation", r);
        self.report.set("cloth", quality.report());
        self.warn(quality.warnings(clip.drape.fps, false));
        if !refined {
            self.warn(vec![
                "unchecked: frames are as the network predicts them; --refine 5 makes them clean"
                    .into(),
            ]);
        }
        self.done(4, "cloth", quality.line())?;
        let fault = quality.fault(self.options.simulate.dress.allow_crossings || !refined);
        if let Some(fault) = fault {
            let hint = "a larger --refine, or --allow-crossings to write the frames all the same";
            return Err(Failure {
                hint: hint.into(),
                ..fault
            });
        }
        self.warn(files::thinned(&clip, simulate.bake));
        let (mut made, baked) = files::make(set, &clip, (out, simulate))?;
        let baked = baked.map(|baked| {
            self.report.set("bake", baked.report);
            self.warn(baked.warnings);
            baked.told
        });
        let one = |m: &Made| format!("{} {:.1} MB", m.path.display(), m.bytes.len() as f64 / 1e6);
        let text = made.iter().map(one).collect::<Vec<_>>().join("  ");
        self.done(5, "write", text)?;
        self.warn(files::leftovers(simulate, &made));
        let kept = files::make_way(out)?;
        self.warn(kept.iter().map(|k| k.1.clone()));
        let warnings = self.warnings.iter().map(|w| Value::from(w.as_str()));
        self.report.set("warnings", warnings.collect::<Vec<_>>());
        self.report.set("seconds", self.times.clone());
        tell::colophon(&mut self.report);
        made.extend(kept.map(|k| k.0));
        made.push(files::report(out, &self.report));
        folders.write(&made)?;
        let table = table((&quality, baked), (raw.rate, raw.inside), &made);
        Ok(Outcome::new(table, &self.report))
    }
}

/// Whether the garment that was made is the one that was taught.
pub(crate) fn fits(model: &Model, garment: &Garment) -> Result<(), Failure> {
    let faces = &garment.faces;
    let same = note_of(model, "topology") == topology(faces) && model.faces == *faces;
    let n = garment.n_verts();
    if same && model.n_verts() == n {
        return Ok(());
    }
    let what = format!(
        "the model's cloth has {} vertices and other triangles than the {} that this version cuts ({n})",
        model.n_verts(),
        garment.name
    );
    Err(Failure::new(Exit::Invalid, "other-garment", what).hint("train it again with this version"))
}

fn notes(model: &Model) -> Report {
    let mut r = Report::default();
    for (name, value) in &model.notes {
        r.set(name, value.as_str());
    }
    r
}

fn table(
    (q, baked): (&Quality, Option<String>),
    (rate, inside): (f64, f64),
    made: &[Made],
) -> String {
    let mut table = Table::new(&[]);
    table.row([
        "network",
        &format!("{rate:.0} frames a second, {inside:.3} % of its vertices in the body"),
    ]);
    for s in &q.strained {
        let told = format!(
            "stretch {:.1} % at most, {:.1} % p99",
            s.max * 100.0,
            s.p99 * 100.0
        );
        table.row([s.name.as_str(), &told]);
    }
    q.tell_contact(&mut table, baked);
    for (i, file) in made.iter().enumerate() {
        table.row([
            if i == 0 { "wrote" } else { "" },
            &file.path.display().to_string(),
        ]);
    }
    table.text()
}
