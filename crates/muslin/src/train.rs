//! Teaching a garment: from a body, a garment and motions to a model on disk.

mod log;
mod options;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use muslin_body::{Avatar, Figure, Motion, Pose, Sparse};
use muslin_geom::{Report, Value};
use muslin_io::{Journal, read_file, read_weights, report_json, sha256, write_file, write_weights};
use muslin_net::learn::Noise;
use muslin_sim::Cloth;
use muslin_train::{Lesson, Plan, Told, TrainError, Trainer, diffused, mixed, sampled};

use crate::drape::{cloth, put_on};
use crate::dress::{asked_figure, file_failure};
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::simulate::{SimulateOptions, expanded, motion};
use crate::table::Table;
use crate::tell;
use crate::watch::Watch;

use log::Log;
pub use options::TrainOptions;

/// How many stages a training has.
const STAGES: usize = 5;
/// Rounds in which skin weights spread, and bones a vertex follows at most.
const DIFFUSED: (usize, usize) = (20, 6);
/// Seconds from one copy of the work on disk to the next.
const KEEP_EVERY: f64 = 60.0;
/// Bytes that a kept training may have.
pub(crate) const MOST_BYTES: u64 = 8 << 30;

/// Teaches the garment of the options to lie on a moving body, and writes the model to `out` (a
/// `.muslin`), with `NAME.report.json` and `NAME.csv` (the curve of the training) beside it.
///
/// While it works, what is learnt is kept in `OUT.part`; with `resume` a stopped run goes on from
/// there and gives the same bits as one that was never stopped.
pub fn train(out: &Path, options: &TrainOptions, watch: &mut Watch) -> Result<Outcome, Failure> {
    options.check(out)?;
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let mut school = School {
        options,
        watch,
        report: Report::default(),
        times: Report::default(),
    };
    let figure = school.body(&avatar)?;
    let (pool, sources) = school.poses(&avatar, &figure)?;
    let wear = school.garment(&avatar, &figure)?;
    school.teach((&avatar, &figure), (pool, sources), (&wear, out))
}

/// A garment as it is taught.
struct Wear {
    cloth: Cloth,
    template: Vec<glam::DVec3>,
    weights: Sparse,
    fabric: String,
}

struct School<'a, 'w> {
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
        let (figure, report, told) = asked_figure(avatar, &self.options.dress)?;
        self.report.set("body", report);
        self.done(1, "body", told)?;
        Ok(figure)
    }

    /// The poses to learn from, and what they come from.
    fn poses(
        &mut self,
        avatar: &Avatar,
        figure: &Figure,
    ) -> Result<(Vec<Pose>, Vec<String>), Failure> {
        let mut motions = Vec::new();
        let mut sources = Vec::new();
        for name in expanded(&self.options.motion)? {
            self.watch.progress(&name);
            self.watch.go_on()?;
            let (motion, source) = one_motion(avatar, figure, &name)?;
            motions.push(motion);
            sources.push(source);
        }
        let mut pool = thinned(sampled(&motions, RATE), self.options.poses);
        let seen = pool.len();
        if seen > 0 {
            let noise = &mut Noise::new(self.options.seed ^ 0x5eed);
            pool.extend(mixed(avatar, &pool, (self.options.mixed, noise)));
        }
        let list = sources.iter().map(|s| Value::from(s.as_str()));
        let mut r = Report::default();
        r.set("motions", list.collect::<Vec<_>>());
        r.set("poses", seen).set("poses_mixed", pool.len() - seen);
        self.report.set("learnt_from", r);
        let told = format!(
            "{} motions, {seen} poses and {} mixed of them",
            sources.len(),
            pool.len() - seen
        );
        self.done(2, "motion", told)?;
        Ok((pool, sources))
    }

    fn garment(&mut self, avatar: &Avatar, figure: &Figure) -> Result<Wear, Failure> {
        let mut warnings = Vec::new();
        let outfit = Outfit::make(avatar, &self.options.dress, |w| warnings.push(w.to_owned()))?;
        warnings.iter().for_each(|w| self.watch.warn(w));
        let wear = wear(avatar, figure, &outfit)?;
        self.report.set("outfit", tell::outfit(&outfit));
        self.done(3, "garment", tell::pieces(&outfit))?;
        Ok(wear)
    }

    fn teach(
        mut self,
        (avatar, figure): (&Avatar, &Figure),
        (pool, sources): (Vec<Pose>, Vec<String>),
        (wear, out): (&Wear, &Path),
    ) -> Result<Outcome, Failure> {
        let lesson = Lesson {
            avatar,
            figure,
            cloth: &wear.cloth,
            template: &wear.template,
            weights: &wear.weights,
        };
        let plan = self.options.plan();
        let mut trainer = Trainer::new(lesson, plan.clone(), pool).map_err(|e| failure(&e))?;
        let part = beside(out, "part");
        let mut log = Log::default();
        if self.options.resume {
            resume(&mut trainer, &part, &mut log, self.watch)?;
        }
        let last = self.steps(&mut trainer, &part, &mut log)?;
        self.check((avatar, figure), &trainer)?;
        let e = last.energies;
        let line = format!(
            "{} steps, {:.4} J a pose, stretch {:.4} J",
            last.step,
            e.total(),
            e.membrane
        );
        self.done(4, "learn", line)?;
        let model = trainer.model(self.notes(wear, &sources, &last));
        let bytes = write_weights(&model.to_weights());
        self.report.set("model_bytes", bytes.len());
        self.told(&last, &plan);
        self.done(
            5,
            "write",
            format!("{} {:.1} MB", out.display(), bytes.len() as f64 / 1e6),
        )?;
        self.report.set("seconds", self.times.clone());
        tell::colophon(&mut self.report);
        let json = report_json(&self.report);
        let files = [
            (out.to_owned(), bytes),
            (out.with_extension("csv"), log.text().into_bytes()),
            (out.with_extension("report.json"), json.into_bytes()),
        ];
        for (path, bytes) in &files {
            write_file(path, bytes).map_err(|e| file_failure(&e))?;
        }
        Journal::remove(&part).map_err(|e| file_failure(&e))?;
        Ok(Outcome::new(table(&last, &files), &self.report))
    }

    /// What motions cost that were not learnt from.
    fn check(
        &mut self,
        (avatar, figure): (&Avatar, &Figure),
        trainer: &Trainer,
    ) -> Result<(), Failure> {
        let mut all = Vec::new();
        for name in expanded(&self.options.check)? {
            self.watch.progress(&format!("judging {name}"));
            let (motion, source) = one_motion(avatar, figure, &name)?;
            let told = trainer.judge(&thinned(sampled(&[motion], RATE), CHECKED));
            let mut r = energies(&told);
            r.set("motion", source);
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

    /// All steps that are left; stops where it is asked to, and keeps what is done.
    fn steps(
        &mut self,
        trainer: &mut Trainer,
        part: &Path,
        log: &mut Log,
    ) -> Result<Told, Failure> {
        let mut last = log.last().unwrap_or_default();
        let first = trainer.steps();
        let (since, mut kept) = (Instant::now(), Instant::now());
        while trainer.steps() < self.options.steps {
            let told = trainer.step();
            if told.is_err()
                || self.watch.go_on().is_err()
                || kept.elapsed().as_secs_f64() > KEEP_EVERY
            {
                keep(trainer, part, log)?;
                kept = Instant::now();
            }
            last = told.map_err(|e| failure(&e))?;
            log.add(last);
            self.watch
                .go_on()
                .map_err(|f| stopped(f, part, trainer.steps(), self.options.steps))?;
            let done = trainer.steps() - first;
            let each = since.elapsed().as_secs_f64() / done as f64;
            let left = each * (self.options.steps - trainer.steps()) as f64;
            self.watch.progress(&format!(
                "step {} of {}, {:.4} J a pose, stretch {:.4} J, {:.2} % of the cloth under the skin, {left:.0} s left",
                last.step, self.options.steps, last.energies.total(), last.energies.membrane, last.under * 100.0
            ));
        }
        Ok(last)
    }

    /// What the file says of itself.
    fn notes(&self, wear: &Wear, sources: &[String], last: &Told) -> BTreeMap<String, String> {
        let d = &self.options.dress;
        let asked = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
        let notes = [
            ("garment", d.outfit[0].garment.clone()),
            ("fabric", wear.fabric.clone()),
            ("cut", format!("{:?}", d.cut).to_lowercase()),
            ("edge", d.edge.to_string()),
            ("body", "anny".into()),
            ("height", asked(d.height)),
            ("weight", asked(d.weight)),
            ("gender", asked(d.gender)),
            ("topology", topology(&wear.cloth.faces)),
            ("trained_on", sources.join("; ")),
            ("licence", licence(sources)),
            ("steps", last.step.to_string()),
            ("seed", self.options.seed.to_string()),
            ("muslin", env!("CARGO_PKG_VERSION").into()),
        ];
        notes.map(|(k, v)| (k.to_owned(), v)).into()
    }

    fn told(&mut self, last: &Told, plan: &Plan) {
        let mut r = Report::default();
        r.set("steps", last.step as f64)
            .set("poses_a_step", 16 * plan.packs);
        r.set("codes", plan.codes);
        r.set("last_batch", energies(last));
        self.report.set("learning", r);
    }
}

/// Poses that a motion is judged by, at most.
const CHECKED: usize = 32;

fn energies(told: &Told) -> Report {
    let mut r = Report::default();
    for (name, value) in told.energies.terms() {
        r.set(&format!("{name}_J"), value);
    }
    r.set("under_percent", 100.0 * told.under);
    r
}

/// Poses a second that are taken from a motion.
const RATE: f64 = 10.0;

/// At most `most` poses, evenly taken.
fn thinned(poses: Vec<Pose>, most: usize) -> Vec<Pose> {
    let n = poses.len();
    if n <= most {
        return poses;
    }
    (0..most).map(|k| poses[k * n / most].clone()).collect()
}

/// A motion without its way in from the rest pose, and what to call it.
fn one_motion(avatar: &Avatar, figure: &Figure, name: &str) -> Result<(Motion, String), Failure> {
    let options = SimulateOptions {
        motion: name.to_owned(),
        fps: RATE,
        ..SimulateOptions::default()
    };
    let moving = motion::load(avatar, figure, &options)?;
    let source = match &moving.sha256 {
        Some(hash) => format!("{} sha256:{}", moving.name, &hash[..16]),
        None => format!("built-in {}", moving.name),
    };
    let motion = Motion {
        fps: moving.motion.fps,
        poses: moving.motion.poses[moving.lead..].to_vec(),
    };
    Ok((motion, source))
}

/// The one garment of an outfit, ready to be taught.
fn wear(avatar: &Avatar, figure: &Figure, outfit: &Outfit) -> Result<Wear, Failure> {
    let worn = put_on(avatar, outfit, figure)?;
    let piece = &outfit.pieces[0];
    let skin = piece.garment.skin_weights(avatar);
    Ok(Wear {
        cloth: cloth(outfit, &worn),
        template: worn[0].verts.clone(),
        weights: diffused(&skin, &piece.garment.faces, DIFFUSED),
        fabric: piece.fabric.name.clone(),
    })
}

/// A hash of the triangles: models of other triangles are not for this garment.
pub(crate) fn topology(faces: &[[u32; 3]]) -> String {
    let bytes: Vec<u8> = faces
        .as_flattened()
        .iter()
        .flat_map(|i| i.to_le_bytes())
        .collect();
    sha256(&bytes)
}

/// The terms of everything that was learnt from.
fn licence(sources: &[String]) -> String {
    let own = "body CC0; built-in motions and garment Apache-2.0 OR MIT";
    match sources.iter().all(|s| s.starts_with("built-in")) {
        true => own.into(),
        false => format!("{own}; recordings under their owners' terms: see trained_on"),
    }
}

fn resume(
    trainer: &mut Trainer,
    part: &Path,
    log: &mut Log,
    watch: &mut Watch,
) -> Result<(), Failure> {
    if !part.exists() {
        watch.warn("nothing to go on from; starting at the first step");
        return Ok(());
    }
    let input = read_file(part, MOST_BYTES).map_err(|e| file_failure(&e))?;
    let kept = read_weights(&input.file, &input.bytes).map_err(|e| file_failure(&e))?;
    trainer
        .restore(&kept)
        .map_err(|e| failure(&e).at(part.display().to_string()))?;
    if let Some(text) = kept.notes.get("log") {
        *log = Log::read(text);
    }
    Ok(())
}

fn keep(trainer: &Trainer, part: &Path, log: &Log) -> Result<(), Failure> {
    let mut kept = trainer.keep();
    kept.notes.insert("log".into(), log.text());
    let written = write_file(part, &write_weights(&kept));
    written.map(|_| ()).map_err(|e| file_failure(&e))
}

fn stopped(failure: Failure, part: &Path, step: u64, of: u64) -> Failure {
    Failure {
        what: format!(
            "stopped; {step} of {of} steps are kept in {}",
            part.display()
        ),
        ..failure
    }
    .hint("the same command with --resume goes on from there")
}

/// `OUT.EXT`.
fn beside(out: &Path, extension: &str) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(format!(".{extension}"));
    name.into()
}

fn failure(e: &TrainError) -> Failure {
    let (exit, code) = match e {
        TrainError::NotFinite { .. } => (Exit::Numbers, "not-finite"),
        TrainError::OtherTraining(_) => (Exit::Invalid, "cannot-resume"),
        _ => (Exit::Invalid, "train"),
    };
    Failure::new(exit, code, e.to_string())
}

fn table(last: &Told, files: &[(PathBuf, Vec<u8>)]) -> String {
    let mut table = Table::new(&[]);
    table.row(["learnt", &format!("{} steps", last.step)]);
    let terms = last.energies.terms().map(|(n, v)| format!("{n} {v:.4}"));
    table.row(["J a pose", &terms.join(", ")]);
    table.row([
        "contact",
        &format!("{:.3} % of the cloth under the skin", 100.0 * last.under),
    ]);
    for (i, (path, _)) in files.iter().enumerate() {
        table.row([
            if i == 0 { "wrote" } else { "" },
            &path.display().to_string(),
        ]);
    }
    table.text()
}
