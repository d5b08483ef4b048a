//! An outfit on a moving body: from a motion to an animation on disk.

mod bake;
pub(crate) mod files;
mod film;
pub(crate) mod motion;
mod options;
pub(crate) mod quality;
pub(crate) mod reel;
mod room;
pub(crate) mod set;
mod several;
mod shoot;

use std::path::{Path, PathBuf};

use muslin_body::{Avatar, Figure};
use muslin_geom::{Report, Value};
use muslin_io::{Clip, Journal};
use muslin_sim::Air;

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of, standing};
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::table::Table;
use crate::tell;
use crate::watch::Watch;

use files::{Folders, Made};
use motion::Moving;
use quality::{Quality, round};
use reel::Reel;
use set::{Set, megabytes};

pub use bake::Bake;
pub use options::SimulateOptions;
pub(crate) use several::expanded;
pub use several::simulate_several;

/// How many stages a simulation has.
const STAGES: usize = 5;
/// An array file has to stay below this [bytes].
const MOST_BYTES: usize = 4 << 30;

/// Moves an outfit on a moving body and writes the animation to `out` (a `.glb`), with
/// `NAME.report.json` beside it.
///
/// While it works, what is done is kept in `OUT.part`; with `resume` a stopped run goes on from
/// there and gives the same bits as one that was never stopped.
pub fn simulate(
    out: &Path,
    options: &SimulateOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    options.check(out)?;
    let folders = Folders::open(out, options, Vec::new())?;
    on_set(options, watch, |run, set| run.film(set, (out, folders)))
}

/// Moves an outfit on a moving body and writes nothing; `judge` is shown what came of it.
pub(crate) fn filmed(
    options: &SimulateOptions,
    watch: &mut Watch,
    judge: impl FnOnce(&Set, &Clip, &Quality) -> Result<(), Failure>,
) -> Result<(), Failure> {
    on_set(options, watch, |run, set| {
        let (clip, quality) = shot(set, None, run.watch)?;
        judge(set, &clip, &quality)
    })
}

/// All frames, and how good they are; `part` as [`shoot::shoot`] takes it.
fn shot(
    set: &Set,
    part: Option<(&Path, bool)>,
    watch: &mut Watch,
) -> Result<(Clip, Quality), Failure> {
    Ok(measured(set, shoot::shoot(set, part, watch)?))
}

/// Frames as they are delivered, and how good they are.
pub(crate) fn measured(set: &Set, mut reel: Reel) -> (Clip, Quality) {
    let told = (std::mem::take(&mut reel.told), reel.again);
    let clip = set.clip(reel);
    let quality = Quality::measure(set, &clip, told);
    (clip, quality)
}

/// Gets body, motion and outfit ready, and goes on with them.
fn on_set<T>(
    options: &SimulateOptions,
    watch: &mut Watch,
    then: impl FnOnce(Run, &Set) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let hero = Hero::load(&options.dress)?;
    let avatar = avatar_of(hero.as_ref())?;
    let mut run = Run {
        options,
        watch,
        report: Report::default(),
        times: Report::default(),
        warnings: Vec::new(),
    };
    let figure = run.body(&avatar, hero.as_ref())?;
    let moving = run.motion((&avatar, hero.as_ref()), &figure)?;
    let set = run.outfit((&avatar, hero.as_ref()), figure, moving)?;
    then(run, &set)
}

struct Run<'a, 'w> {
    options: &'a SimulateOptions,
    watch: &'a mut Watch<'w>,
    report: Report,
    times: Report,
    warnings: Vec<String>,
}

impl Run<'_, '_> {
    fn done(&mut self, number: usize, name: &'static str, result: String) -> Result<(), Failure> {
        let seconds = self.watch.done((number, STAGES), name, result)?;
        self.times.set(name, round(seconds));
        Ok(())
    }

    fn warn(&mut self, warnings: Vec<String>) {
        warnings.iter().for_each(|w| self.watch.warn(w));
        self.warnings.extend(warnings);
    }

    fn body(&mut self, avatar: &Avatar, hero: Option<&Hero>) -> Result<Figure, Failure> {
        let stands = standing(avatar, hero, &self.options.dress)?;
        self.warn(stands.warnings);
        self.report.set("body", stands.report);
        self.done(1, "body", stands.told)?;
        Ok(stands.figure)
    }

    fn motion(
        &mut self,
        (avatar, hero): (&Avatar, Option<&Hero>),
        figure: &Figure,
    ) -> Result<Moving, Failure> {
        let mut moving = motion::load((avatar, hero), figure, self.options)?;
        self.warn(std::mem::take(&mut moving.warnings));
        let (n, fps) = (moving.frames(), moving.motion.fps);
        let seconds = n as f64 / fps;
        let mut r = moving.report();
        r.set("start_s", self.options.start).set("seconds", seconds);
        r.set("frames_of_lead_in", moving.lead);
        self.report.set("motion", r);
        let told = format!(
            "{}: {n} frames, {seconds:.2} s at {fps} a second",
            moving.name
        );
        self.done(2, "motion", told)?;
        Ok(moving)
    }

    fn outfit<'a>(
        &mut self,
        (avatar, hero): (&'a Avatar, Option<&'a Hero>),
        figure: Figure,
        moving: Moving,
    ) -> Result<Set<'a>, Failure> {
        let mut warnings = Vec::new();
        let note = |w: &str| warnings.push(w.to_owned());
        let outfit = Outfit::make_for((avatar, hero), &self.options.dress, note)?;
        self.warn(warnings);
        self.warn(outfit.tight().into_iter().collect());
        self.report.set("outfit", tell::outfit(&outfit));
        tell::size(&mut self.report, &outfit);
        let mut set = Set::new(avatar, figure, moving, outfit)?;
        set.bdf2 = self.options.bdf2;
        set.air = Air {
            density: self.options.air,
            wind: self.options.wind.into(),
        };
        self.report.set("air_kg_m3", self.options.air);
        let wind = self.options.wind.map(Value::Number).to_vec();
        self.report.set("wind_m_s", wind);
        set.hero = hero;
        let memory = set.memory();
        if memory.frames / 5 > MOST_BYTES {
            let what = format!("{} frames are too many for one file", set.moving.frames());
            let fault = Failure::new(Exit::Refused, "too-long", what).at(set.moving.name);
            return Err(fault.hint("take a part with --start and --seconds, or a lower --fps"));
        }
        self.warn(memory.scarce().into_iter().collect());
        self.report
            .set("memory_of_frames_MB", megabytes(memory.frames))
            .set("memory_MB", megabytes(memory.all));
        let told = format!("{}; {}", tell::pieces(&set.outfit), memory.text());
        self.done(3, "outfit", told)?;
        Ok(set)
    }

    fn film(mut self, set: &Set, (out, folders): (&Path, Folders)) -> Result<Outcome, Failure> {
        let part = part(out);
        let inputs = inputs(set, self.options);
        if self.options.resume && !part.exists() && files::are_there(out, &inputs) {
            let text = format!("there already  {}\n", out.display());
            return Ok(Outcome::new(text, &self.report));
        }
        let (clip, quality) = shot(set, Some((&part, self.options.resume)), self.watch)?;
        self.report.set("inputs_sha256", inputs);
        self.report.set("simulation", quality.report());
        self.warn(quality.warnings(clip.drape.fps, true));
        self.done(4, "cloth", line(&quality))?;
        if let Some(fault) = quality.fault(self.options.dress.allow_crossings) {
            return Err(fault);
        }
        self.warn(
            files::thinned(&clip, self.options.bake)
                .into_iter()
                .collect(),
        );
        let (mut made, baked) = files::make(set, &clip, (out, self.options))?;
        let baked = baked.map(|baked| {
            self.report.set("bake", baked.report);
            self.warn(baked.warnings);
            baked.told
        });
        let text = written(&made);
        self.done(5, "write", text)?;
        self.warn(files::leftovers(self.options, &made));
        let kept = files::make_way(out)?;
        self.warn(kept.iter().map(|k| k.1.clone()).collect());
        self.finish(&made);
        made.extend(kept.map(|k| k.0));
        made.push(files::report(out, &self.report));
        folders.write(&made)?;
        Journal::remove(&part).map_err(|e| file_failure(&e))?;
        Ok(Outcome::new(
            table(&self.report, (&quality, baked), &made),
            &self.report,
        ))
    }

    /// The rest of the report.
    fn finish(&mut self, made: &[Made]) {
        let mut sizes = Report::default();
        for file in made {
            sizes.set(&muslin_io::name(&file.path), file.bytes.len());
        }
        self.report.set("files", sizes);
        let warnings = self.warnings.iter().map(|w| Value::from(w.as_str()));
        self.report.set("warnings", warnings.collect::<Vec<_>>());
        self.report.set("seconds", self.times.clone());
        tell::colophon(&mut self.report);
    }
}

/// What all results follow from, in short: what frames do, and how they are written.
fn inputs(set: &Set, options: &SimulateOptions) -> String {
    let o = options;
    let looks = set.outfit.pieces.iter().map(|p| &p.fabric.look);
    let clothes = (set.outfit.names(), looks.collect::<Vec<_>>());
    let how = (o.bake, &o.npz, &o.pc2, o.picture, o.turn, o.dress.backdrop);
    let how = (how, clothes);
    muslin_io::sha256(format!("{}{how:?}", shoot::head(set)).as_bytes())
}

/// Where the frames are kept until all are there.
fn part(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// The line of the cloth stage.
fn line(q: &Quality) -> String {
    let worst = q.strained.iter().map(|s| s.max).fold(0.0, f64::max);
    format!("{}, stretch {:.1} %", q.line(), worst * 100.0)
}

/// The line of the write stage.
fn written(made: &[Made]) -> String {
    let one = |m: &Made| format!("{} {:.1} MB", m.path.display(), m.bytes.len() as f64 / 1e6);
    made.iter().map(one).collect::<Vec<_>>().join("  ")
}

/// The last words: what came out and how good it is.
fn table(report: &Report, (q, baked): (&Quality, Option<String>), made: &[Made]) -> String {
    let mut table = Table::new(&[]);
    if let Some(Value::Tree(motion)) = report.get("motion") {
        let of = |name: &str| match motion.get(name) {
            Some(Value::Number(x)) => round(*x).to_string(),
            Some(Value::Text(t)) => t.clone(),
            _ => String::new(),
        };
        let told = [of("name"), of("frames"), of("frames_per_second")];
        let [name, frames, fps] = told;
        table.row([
            "motion",
            &format!("{name}: {frames} frames, {fps} a second"),
        ]);
    }
    for s in &q.strained {
        let limit = s
            .limit
            .map_or("no limit".into(), |l| format!("limit {:.1} %", l * 100.0));
        let told = format!(
            "stretch {:.1} % at most, {:.1} % p99 ({limit})",
            s.max * 100.0,
            s.p99 * 100.0
        );
        table.row([s.name.as_str(), &told]);
    }
    q.tell_contact(&mut table, baked);
    let [median, worst] = q.pace();
    table.row([
        "speed",
        &format!("{median:.0} ms a frame, {worst:.0} ms the slowest"),
    ]);
    for (i, file) in made.iter().enumerate() {
        let head = if i == 0 { "wrote" } else { "" };
        table.row([head, &file.path.display().to_string()]);
    }
    table.text()
}
