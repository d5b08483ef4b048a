//! Teaching a garment: from a body, a garment and motions to a model on disk.

mod asked;
mod kept;
mod lessons;
mod log;
mod options;
mod pace;
mod safe;
mod sketch;
mod small;
mod told;
pub(crate) mod variety;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use muslin_body::{Avatar, Figure, Motion, Pose};
use muslin_geom::{Report, Value};
use muslin_io::{Journal, Lock, report_json, write_file, write_weights};
use muslin_model::Model;
use muslin_train::published::{Published, System};
use muslin_train::{
    LEARNT, SKINNING, Told, TrainError, Trainer, Training, has_learnt_skinning, placed,
};

use crate::animate::{note_of, read_model};
use crate::apart::{apart, worn};
use crate::brought::is_file;
use crate::drape::cloth_of;
use crate::dress::file_failure;
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of, body_note, standing};
use crate::options::DressOptions;
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::simulate::{expanded, motion};
use crate::size::Size;
use crate::swings;
use crate::table::Table;
use crate::tell;
use crate::watch::Watch;

use asked::{asked, hashes};
pub(crate) use kept::failure;
use kept::{beside, keep, resume, stopped};
use lessons::Class;
use log::Log;
pub use options::{Skinning, TrainOptions};
use pace::Pace;
use safe::Safe;
use sketch::Sketch;
pub(crate) use told::{Learnt, topology};
use told::{energies, table};

/// How many stages a training has.
const STAGES: usize = 5;
/// Seconds from one copy of the work on disk to the next.
const KEEP_EVERY: f64 = 15.0;

/// Teaches the garment of the options to lie on a moving body, and writes the model to `out` (a
/// `.muslin`), with `NAME.report.json` and `NAME.csv` (the curve of the training) beside it; of an outfit
/// `NAME.GARMENT.muslin` for each.
///
/// With a published system it is that which is taught, on the same body, garment and motions.
///
/// While it works, what is learnt is kept in `OUT.part`; with `resume` a stopped run goes on from
/// there and gives the same bits as one that was never stopped.
pub fn train(out: &Path, options: &TrainOptions, watch: &mut Watch) -> Result<Outcome, Failure> {
    options.check(out)?;
    let mut read = worn(&options.dress);
    read.extend(options.from.clone());
    let motions = expanded(&options.motion)?;
    read.extend(motions.iter().map(|m| motion::named(m).0.to_owned()));
    let made = ["csv", "report.json"].map(|kind| beside(out, kind));
    apart(&read, made.into_iter().chain([out.to_owned()]))?;
    let _alone = Lock::hold(out).map_err(|e| file_failure(&e))?;
    let options = &options.with_fabric(|w| watch.warn(w)).with_skinning();
    let hero = Hero::load(&options.dress)?;
    let avatar = avatar_of(hero.as_ref())?;
    let mut school = School {
        hero: hero.as_ref(),
        options,
        watch,
        report: Report::default(),
        times: Report::default(),
    };
    school
        .report
        .set("options", asked(options))
        .set("seed", options.seed as usize);
    let kept = [beside(out, "part"), beside(out, "coarse.part")];
    let figure = school.body(&avatar)?;
    let (motions, sources) = school.motions((&avatar, &figure), &motions)?;
    let (mut class, outfit) = school.garment(&avatar, &figure)?;
    if options.resume && !kept.iter().any(|p| p.exists()) {
        if school.has_ended((&class, &sources), out) {
            return Ok(school.ended(&class.files(out)));
        }
        school
            .watch
            .warn("nothing to go on from; starting at the first step");
    }
    if let Some(edge) = options.coarse {
        let model = school.coarse((&avatar, &figure), &motions, (edge, &kept[1]))?;
        class.begun = Some(model);
    }
    let worn = (&class, &outfit);
    let told = school.teach(&avatar, (motions, sources), (worn, out, &kept[0]))?;
    for part in &kept {
        Journal::remove(part).map_err(|e| file_failure(&e))?;
    }
    Ok(told)
}

/// Cloth that costs more has flown apart [J].
const DIVERGED: f64 = 1e8;

/// As the command line says it.
fn cut_name(dress: &DressOptions) -> String {
    format!("{:?}", dress.cut).to_lowercase()
}

/// One course of steps: on coarse cloth, or on that which is asked for.
struct Lap<'a> {
    /// What is kept of it unfinished.
    part: &'a Path,
    /// Its curve so far, if that is of interest.
    curve: Option<&'a Path>,
    /// What its steps are called.
    kind: &'static str,
    /// As many steps come after it, each of which takes so many times as long.
    after: f64,
}

struct School<'a, 'w> {
    hero: Option<&'a Hero>,
    options: &'a TrainOptions,
    watch: &'a mut Watch<'w>,
    report: Report,
    times: Report,
}

impl School<'_, '_> {
    fn done(&mut self, number: usize, name: &'static str, result: String) -> Result<(), Failure> {
        let seconds = self.watch.done((number, STAGES), name, result)?;
        self.times.set(name, (seconds * 100.0).round() / 100.0);
        Ok(())
    }

    fn body(&mut self, avatar: &Avatar) -> Result<Figure, Failure> {
        let stands = standing(avatar, self.hero, &self.options.dress)?;
        stands.warnings.iter().for_each(|w| self.watch.warn(w));
        self.report.set("body", stands.report);
        self.done(1, "body", stands.told)?;
        Ok(stands.figure)
    }

    /// The motions to learn from, and what they come from.
    fn motions(
        &mut self,
        (avatar, figure): (&Avatar, &Figure),
        names: &[String],
    ) -> Result<(Vec<Motion>, Vec<String>), Failure> {
        let mut motions = Vec::new();
        let mut sources = Vec::new();
        let mut turned = 0.0f64;
        let rate = lessons::rate(self.options.system);
        for name in names {
            self.watch.progress(name);
            self.watch.go_on()?;
            let seen = lessons::one((avatar, self.hero), figure, (name, rate))?;
            for warning in &seen.warnings {
                match warning.contains(name) {
                    true => self.watch.warn(warning),
                    false => self.watch.warn(&format!("{name}: {warning}")),
                }
            }
            turned = turned.max(seen.turned.to_degrees());
            motions.push(seen.motion);
            sources.push(seen.source);
        }
        let (motions, [seen, mixed]) = lessons::gathered(avatar, motions, self.options);
        let list = sources.iter().map(|s| Value::from(s.as_str()));
        let mut r = Report::default();
        r.set("motions", list.collect::<Vec<_>>());
        r.set("poses", seen).set("poses_mixed", mixed);
        r.set("limbs_turned_deg", turned.round());
        self.report.set("learnt_from", r);
        let more = match mixed {
            0 => String::new(),
            n => format!(" and {n} mixed of them"),
        };
        let s = if sources.len() == 1 { "" } else { "s" };
        let told = format!("{} motion{s}, {seen} poses{more}", sources.len());
        self.done(2, "motion", told)?;
        Ok((motions, sources))
    }

    fn garment(&mut self, avatar: &Avatar, figure: &Figure) -> Result<(Class, Outfit), Failure> {
        let mut warnings = Vec::new();
        let note = |w: &str| warnings.push(w.to_owned());
        let outfit = Outfit::make_for((avatar, self.hero), &self.options.dress, note)?;
        warnings.iter().for_each(|w| self.watch.warn(w));
        one_each(&self.options.dress, &outfit)?;
        let base = self.hero.map(|h| &h.base);
        let mut class = Class::new((avatar, figure), (&outfit, base), self.options)?;
        if let Some(path) = &self.options.from {
            class.begun = Some(read_model(path)?);
        }
        let dress = &self.options.dress;
        self.report
            .set("outfit", tell::outfit(&outfit))
            .set("edge_mm", dress.edge * 1000.0)
            .set("cut", cut_name(dress));
        tell::size(&mut self.report, &outfit);
        let mut told = tell::pieces(&outfit);
        if class.pupils.len() > 1 {
            told += &format!(", for {} wearers and fabrics", class.pupils.len());
        }
        self.done(3, "garment", told)?;
        Ok((class, outfit))
    }

    /// What is going to learn.
    fn trainer<'l>(
        &mut self,
        (avatar, class): (&'l Avatar, &'l Class),
        motions: Vec<Motion>,
    ) -> Result<Box<dyn Training + 'l>, Failure> {
        let lessons = class.lessons(avatar);
        let Some(system) = self.options.system else {
            let pool = motions.into_iter().flat_map(|m| m.poses).collect();
            let plan = self.options.plan();
            let trainer = match &class.begun {
                Some(model) => Trainer::begun(lessons, plan, pool, model),
                None => Trainer::new(lessons, plan, pool),
            };
            let trainer = trainer.map_err(|e| failure(&e))?;
            let (trainer, place) =
                placed(trainer, self.options.device).map_err(|e| failure(&e).at("--device"))?;
            self.report.set("device", place);
            return Ok(trainer);
        };
        let course = self.options.course(system, &class.fabrics[0]);
        let trainer = Published::new(lessons, course, motions);
        Ok(Box::new(trainer.map_err(|e| failure(&e))?))
    }

    /// What the same garment with edges of `edge` [m] learns in as many steps.
    fn coarse(
        &mut self,
        (avatar, figure): (&Avatar, &Figure),
        motions: &[Motion],
        (edge, part): (f64, &Path),
    ) -> Result<Model, Failure> {
        let dress = DressOptions {
            edge,
            ..self.options.dress.clone()
        };
        // What there is to be said of the garment is said of the fine one.
        let outfit = Outfit::make_for((avatar, self.hero), &dress, |_: &str| ())?;
        let base = self.hero.map(|h| &h.base);
        let class = Class::new((avatar, figure), (&outfit, base), self.options)?;
        let mut trainer = self.trainer((avatar, &class), motions.to_vec())?;
        // As many steps of finer cloth are yet to come, which cost as much more as it has more triangles.
        let finer = edge / self.options.dress.edge;
        let lap = Lap {
            part,
            curve: None,
            kind: "coarse ",
            after: finer * finer,
        };
        let (last, log) = self.learn(&mut *trainer, &lap, None)?;
        keep(&*trainer, (part, None), (&log, &Safe::default()))?;
        let mut r = energies(&last);
        r.set("edge_mm", edge * 1000.0)
            .set("steps", last.step as f64);
        self.report.set("learnt_coarsely", r);
        trainer.model(BTreeMap::new()).map_err(|e| failure(&e))
    }

    fn teach(
        mut self,
        avatar: &Avatar,
        (motions, sources): (Vec<Motion>, Vec<String>),
        ((class, outfit), out, part): ((&Class, &Outfit), &Path, &Path),
    ) -> Result<Outcome, Failure> {
        let pupil = &class.pupils[0];
        let figure = &pupil.figure;
        let shown = small::shown(&motions);
        let sketch = self.options.picture.map(|every| Sketch {
            poses: sketch::drawn(&motions),
            avatar,
            pupil,
            outfit,
            every,
            out,
        });
        let mut trainer = self.trainer((avatar, class), motions)?;
        let curve = out.with_extension("csv");
        let lap = Lap {
            part,
            curve: Some(&curve),
            kind: "",
            after: 0.0,
        };
        let (last, log) = self.learn(&mut *trainer, &lap, sketch.as_ref())?;
        // What is no number is beyond it as well.
        let is_sound = last.energies.total() <= DIVERGED;
        if !is_sound {
            let what = format!(
                "cloth has {:.1e} J a pose after {} steps",
                last.energies.total(),
                last.step
            );
            let fault = Failure::new(Exit::Numbers, "diverged", what);
            return Err(fault.hint("teach it anew with a lower --rate, or more --steps"));
        }
        self.check((avatar, figure), &*trainer)?;
        let e = last.energies;
        let line = format!(
            "{} steps, {:.4} J a pose, stretch {:.4} J",
            last.step,
            e.total(),
            e.membrane
        );
        self.done(4, "learn", line)?;
        let model = trainer.model(BTreeMap::new());
        let model = model.map_err(|e| failure(&e))?;
        let mut files = Vec::with_capacity(class.parts.len() + 2);
        let mut list = Vec::new();
        for (k, name) in class.files(out).into_iter().enumerate() {
            let mut model = class.part_of(&model, k);
            model.notes = self.notes((class, k), (&model.faces, &sources), &last);
            let bytes = self.stored((avatar, class, k), model, &shown)?;
            list.push(format!(
                "{} {:.1} MB",
                name.display(),
                bytes.len() as f64 / 1e6
            ));
            files.push((name, bytes));
        }
        let bytes: usize = files.iter().map(|f| f.1.len()).sum();
        self.report.set("model_bytes", bytes);
        self.told(&last, model.n_codes());
        self.done(5, "write", list.join("  "))?;
        self.report.set("seconds", self.times.clone());
        tell::colophon(&mut self.report);
        let json = report_json(&self.report);
        files.extend([
            (curve, log.text().into_bytes()),
            (out.with_extension("report.json"), json.into_bytes()),
        ]);
        for (path, bytes) in &files {
            write_file(path, bytes).map_err(|e| file_failure(&e))?;
        }
        Ok(Outcome::new(table(&last, &files), &self.report))
    }

    /// The file of garment `k`, with its swings; `shown`: poses that were learnt from.
    fn stored(
        &mut self,
        (avatar, class, k): (&Avatar, &Class, usize),
        mut model: Model,
        shown: &[Pose],
    ) -> Result<Vec<u8>, Failure> {
        let pupil = &class.pupils[0];
        if self.options.system.is_none() {
            let part = &class.parts[k];
            let cloth = cloth_of(&pupil.cloth, (k, part));
            let lies = (&cloth, &pupil.template[part.verts.clone()]);
            model.sway = swings::swings((avatar, &pupil.figure), lies, &model.bones)?;
        }
        let learnt_from = (&class.pupils[..], shown);
        let stored = small::stored((&model, avatar), learnt_from, self.options.weights)?;
        let shapes = small::name(stored.precision);
        self.report.set("shapes_in", shapes);
        if let Some(off) = stored.off {
            self.report.set("off_in_file_mm", off * 1e3);
        }
        if let (Some(far), Some(_)) = (stored.too_far, self.options.weights) {
            self.watch.warn(&format!(
                "steps as coarse as asked for move a vertex by {:.1} mm; shapes are written as {shapes}",
                far * 1e3
            ));
        }
        Ok(write_weights(&stored.weights))
    }

    /// What motions cost that were not learnt from.
    fn check(
        &mut self,
        (avatar, figure): (&Avatar, &Figure),
        trainer: &dyn Training,
    ) -> Result<(), Failure> {
        let rate = lessons::rate(self.options.system);
        let mut all = Vec::new();
        for name in expanded(&self.options.check)? {
            self.watch.progress(&format!("judging {name}"));
            let shown = lessons::one((avatar, self.hero), figure, (&name, rate))?;
            let told = trainer.judge(&shown.motion);
            let told = told.map_err(|e| failure(&e))?;
            let mut r = energies(&told);
            r.set("motion", shown.source);
            all.push(Value::Tree(r));
            let line = format!(
                "{name}: {:.4} J a pose, stretch {:.4} J",
                told.energies.total(),
                told.energies.membrane
            );
            self.watch.progress(&line);
        }
        if !all.is_empty() {
            self.report.set("not_learnt_from", all);
        }
        Ok(())
    }

    /// All steps that are left after what was kept; stops where it is asked to, and keeps what is done.
    fn learn(
        &mut self,
        trainer: &mut dyn Training,
        course: &Lap<'_>,
        sketch: Option<&Sketch>,
    ) -> Result<(Told, Log), Failure> {
        let (mut log, mut safe) = (Log::default(), Safe::default());
        let files = (course.part, course.curve);
        if self.options.resume {
            resume(trainer, course.part, (&mut log, &mut safe))?;
        }
        let steps = self.options.steps;
        let mut last = log.last().unwrap_or_default();
        let (mut pace, mut kept) = (Pace::new(), Instant::now());
        while trainer.steps() < steps {
            safe.mind(trainer).map_err(|e| failure(&e))?;
            match trainer.step() {
                Ok(told) => last = told,
                // What a device that fails has half done is not kept: what was kept before goes on to the same bits.
                Err(e @ TrainError::Device(_)) => return Err(failure(&e)),
                Err(e) => {
                    let what = e.to_string();
                    let back = safe.go_back(trainer, e);
                    log.back_to(trainer.steps());
                    keep(trainer, files, (&log, &safe))?;
                    let step = back.map_err(|e| failure(&e))?;
                    self.watch.warn(&format!(
                        "{what}; going on from step {step}, with other poses"
                    ));
                    continue;
                }
            }
            log.add(last);
            if let Some(sketch) = sketch {
                sketch.draw(trainer, steps)?;
            }
            let go = self.watch.go_on();
            if go.is_err() || kept.elapsed().as_secs_f64() > KEEP_EVERY {
                keep(trainer, files, (&log, &safe))?;
                kept = Instant::now();
            }
            go.map_err(|f| stopped(f, course.part, trainer.steps(), steps))?;
            let left = pace.left(trainer, steps, course.after);
            let left = left.map_or(String::new(), |s| format!(", {s:.0} s left"));
            self.watch.progress(&format!(
                "{}step {} of {steps}, {:.4} J a pose, stretch {:.4} J, {:.2} % of the cloth under the skin{left}",
                course.kind, last.step, last.energies.total(), last.energies.membrane, last.under * 100.0
            ));
        }
        if safe.gone_back > 0 {
            self.report.set("gone_back", safe.gone_back as f64);
        }
        Ok((last, log))
    }

    /// What the file says of itself.
    fn notes(
        &self,
        (class, k): (&Class, usize),
        (faces, sources): (&[[u32; 3]], &[String]),
        last: &Told,
    ) -> BTreeMap<String, String> {
        let d = &self.options.dress;
        let sources = &class.sources(sources);
        let system = self.options.system;
        let over: Vec<&str> = d.outfit[..k].iter().map(|w| w.garment.as_str()).collect();
        let wear = &d.outfit[k];
        let learnt = Learnt {
            is_character: self.hero.is_some(),
            garment: &wear.garment,
            sources,
            terms: self.options.terms.as_deref(),
        };
        let told = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
        let own_fabric = wear.fabric.clone().filter(|f| fabric::is_file(f));
        let notes = [
            ("garment", wear.garment.clone()),
            (
                "fabric",
                own_fabric.unwrap_or_else(|| class.fabrics[k].name.clone()),
            ),
            ("files", hashes(wear)),
            ("over", over.join(",")),
            ("fabrics", which(self.options.any_fabric).into()),
            ("shapes", which(self.options.any_shape).into()),
            ("sizes", which(self.options.any_size).into()),
            ("size", d.size.map_or("", Size::label).into()),
            ("cut", cut_name(d)),
            ("edge", d.edge.to_string()),
            ("body", body_note(self.hero)),
            ("height", told(d.height)),
            ("weight", told(d.weight)),
            ("gender", told(d.gender)),
            ("topology", topology(faces)),
            ("trained_on", sources.join("; ")),
            ("licence", learnt.licence()),
            ("steps", last.step.to_string()),
            ("seed", self.options.seed.to_string()),
            ("options", asked(self.options)),
            (SKINNING, self.skinning(class).into()),
            ("system", system.map_or("muslin", System::name).to_owned()),
            ("fps", lessons::rate(system).to_string()),
            ("muslin", env!("CARGO_PKG_VERSION").into()),
        ];
        notes.map(|(k, v)| (k.to_owned(), v)).into()
    }

    /// Whether the models at `out` are what this training ends with: to go on with it there is nothing to do.
    fn has_ended(&self, (class, sources): (&Class, &[String]), out: &Path) -> bool {
        let last = Told {
            step: self.options.steps,
            ..Told::default()
        };
        let is_done = |(k, file): (usize, &PathBuf)| {
            let model = read_model(file).ok();
            model.is_some_and(|model| {
                let notes = self.notes((class, k), (&class.faces(k), sources), &last);
                let same = |(name, value): (&String, &String)| note_of(&model, name) == value;
                notes.iter().all(same)
            })
        };
        class.files(out).iter().enumerate().all(is_done)
    }

    /// What there is to be said of such a training.
    fn ended(self, files: &[PathBuf]) -> Outcome {
        let mut table = Table::new(&[]);
        for file in files {
            table.row(["there already", &file.display().to_string()]);
        }
        Outcome::new(table.text(), &self.report)
    }

    /// How the cloth came to follow the bones as it does.
    fn skinning(&self, class: &Class) -> &'static str {
        let begun = class.begun.as_ref().is_some_and(has_learnt_skinning);
        match self.options.learns_skinning() || begun {
            true => LEARNT,
            false => "given",
        }
    }

    fn told(&mut self, last: &Told, codes: usize) {
        let mut r = Report::default();
        r.set("steps", last.step as f64);
        match self.options.system {
            Some(system) => r.set("system", system.name()).set("poses_a_step", 16_usize),
            None => r.set("poses_a_step", 16 * self.options.plan().packs),
        };
        r.set("codes", codes);
        r.set("last_batch", energies(last));
        self.report.set("learning", r);
    }
}

/// Refuses a file of several garments: each of them has a model of its own.
fn one_each(asked: &DressOptions, outfit: &Outfit) -> Result<(), Failure> {
    let (n, all) = (asked.outfit.len(), outfit.pieces.len());
    if n == all {
        return Ok(());
    }
    let file = asked.outfit.iter().map(|w| w.garment.as_str());
    let file = file.filter(|g| is_file(g)).collect::<Vec<_>>().join(", ");
    let names: Vec<&str> = (outfit.pieces.iter())
        .map(|p| p.garment.name.as_str())
        .collect();
    let what = format!(
        "{all} garments where {n} are asked for: {}",
        names.join(", ")
    );
    Err(Failure::new(Exit::Usage, "several-pieces", what)
        .at(file)
        .hint("teach them one by one, by their numbers: FILE.obj#1, FILE.obj#2; `animate` wears all of them"))
}

/// Whether any was taught, in the words of a note.
fn which(any: bool) -> &'static str {
    if any { "any" } else { "one" }
}
