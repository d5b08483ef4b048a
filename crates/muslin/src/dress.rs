//! The main job: from a photo to a dressed figure on disk.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use muslin_body::{Avatar, Figure, Pose, Shape};
use muslin_fit::detect::{Found, Models, Person as Seen, find_people};
use muslin_fit::solve::{Fit, FitOptions, Fitter};
use muslin_fit::{Camera, UNSEEN};
use muslin_geom::{Image, Report, Value};
use muslin_io::{
    Lock, Output, Photo, PhotoLimits, animated_png, flatten, glb, png, read_photo, report_json,
};

use crate::apart::{apart, worn};
use crate::drape::{Dressed, drape_outfit, lay_outfit};
use crate::failure::{Exit, Failure};
use crate::figure::{Sitter, body_failure};
use crate::options::{Backdrop, DressOptions, Person};
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::size::Wearer;
use crate::watch::Watch;
use crate::{files, look, tell};

/// The photo that `demo` dresses.
const EXAMPLE: &[u8] = include_bytes!("../../../assets/examples/walk.jpg");

/// Pieces of a job that its later stages add to.
pub(crate) struct Job<'a, 'w> {
    pub avatar: &'a Avatar,
    pub options: &'a DressOptions,
    pub watch: &'a mut Watch<'w>,
    pub report: Report,
    pub times: Report,
    pub warnings: Vec<String>,
}

/// Somebody to dress, and what of them goes over the photo.
struct Model<'a> {
    sitter: Sitter,
    over: Option<(Camera, &'a Image)>,
}

/// Dresses the person in the photo at `photo` and writes the results to the folder `out`.
pub fn dress(
    photo: &Path,
    out: &Path,
    options: &DressOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    options.check()?;
    let photo = read_photo(photo, &PhotoLimits::default()).map_err(|e| file_failure(&e));
    let done = photo.and_then(|photo| dress_photo(&photo, out, options, watch));
    done.map_err(|f| with_left_over(f, out))
}

/// Dresses the person in the built-in photo.
pub fn demo(out: &Path, options: &DressOptions, watch: &mut Watch) -> Result<Outcome, Failure> {
    options.check()?;
    let input = muslin_io::Input {
        file: tell::BUILT_IN_PHOTO.into(),
        bytes: EXAMPLE.to_vec(),
    };
    let image =
        muslin_io::decode_photo(&input, &PhotoLimits::default()).map_err(|e| file_failure(&e))?;
    let photo = Photo {
        sha256: input.sha256(),
        file: input.file,
        image,
    };
    dress_photo(&photo, out, options, watch).map_err(|f| with_left_over(f, out))
}

/// Dresses the default body in the built-in stance called `pose`.
pub fn dress_pose(
    pose: &str,
    out: &Path,
    options: &DressOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    options.check()?;
    apart(&worn(options), RESULTS.map(|name| out.join(name)))?;
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let mut job = Job::new(&avatar, options, watch);
    let shape = asked_shape(&avatar, options)?;
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let stance = Pose::stance(&avatar, &figure, pose)
        .map_err(|e| Failure::new(Exit::Usage, "unknown-pose", e.to_string()).at("--pose"))?;
    job.done(1, "pose", format!("built in: {pose}"))?;
    let sitter = Sitter::new(&avatar, &shape, stance)?;
    let measures = avatar.measure(&sitter.figure);
    job.report.set("body", tell::person(&shape, &measures));
    job.done(2, "body", tell::measures(&measures))?;
    let model = Model { sitter, over: None };
    let done = job.clothe(&model, &Cut::new(&avatar, options), out);
    done.map_err(|f| with_left_over(f, out))
}

/// The average body with what the options say of it.
pub(crate) fn asked_shape(avatar: &Avatar, options: &DressOptions) -> Result<Shape, Failure> {
    if options.body.is_some() {
        return Ok(Shape::default());
    }
    let shape = expected(options)?;
    let shape = match (options.height, options.weight) {
        (Some(m), Some(kg)) => shape.with_height_and_mass(avatar, m, kg),
        (Some(m), None) => shape.with_height(avatar, m),
        (None, Some(kg)) => shape.with_mass(avatar, kg),
        (None, None) => Ok(shape),
    };
    shape.map_err(|e| body_failure(&e))
}

/// That body at rest, what the report says of it, and the line for the user.
pub(crate) fn asked_figure(
    avatar: &Avatar,
    options: &DressOptions,
) -> Result<(Figure, Report, String), Failure> {
    let shape = asked_shape(avatar, options)?;
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let measures = avatar.measure(&figure);
    let report = match options.body {
        Some(_) => tell::body(&shape, &measures),
        None => tell::person(&shape, &measures),
    };
    Ok((figure, report, tell::measures(&measures)))
}

/// Who to expect before the photo is looked at.
fn expected(options: &DressOptions) -> Result<Shape, Failure> {
    match options.gender {
        Some(g) => Shape::default()
            .with("gender", g)
            .map_err(|e| body_failure(&e)),
        None => Ok(Shape::default()),
    }
}

fn dress_photo(
    photo: &Photo,
    out: &Path,
    options: &DressOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    // Unpacking the body and looking for people need nothing of one another.
    let (avatar, found) = rayon::join(Avatar::embedded, || look_for_people(photo));
    let (avatar, found) = (avatar.map_err(|e| body_failure(&e))?, found?);
    let mut job = Job::new(&avatar, options, watch);
    job.report.set("photo", tell::photo(photo));
    let chosen = choose(&found, photo, &mut job)?;
    // Whoever asks for all gets the same files of one as of several.
    let several = options.person == Person::All;
    let of = found.people.len();
    let (mut outcomes, mut fault) = (Vec::new(), None);
    let cut = OnceLock::new();
    let folder = |n: usize| match several {
        true => out.join(format!("person-{n}")),
        false => out.to_owned(),
    };
    let folders: Vec<PathBuf> = chosen.iter().map(|&n| folder(n)).collect();
    let now: Vec<&Path> = folders.iter().map(PathBuf::as_path).collect();
    for warning in left_over(out, &now) {
        job.warn(warning);
    }
    let mut read = worn(options);
    read.push(PathBuf::from(&photo.file));
    let all = folders
        .iter()
        .flat_map(|f| RESULTS.map(|name| f.join(name)));
    apart(&read, all)?;
    for (&n, folder) in chosen.iter().zip(&folders) {
        let mut one = Job::new(&avatar, options, job.watch);
        (one.report, one.warnings) = (job.report.clone(), job.warnings.clone());
        one.report.set("person", n).set("people", of);
        match one.dress_person((&found.people[n - 1], photo), &cut, folder) {
            Ok(outcome) => outcomes.push(outcome),
            Err(failure) if !several => return Err(failure),
            Err(stop) if stop.is_stop() => {
                fault = Some(stop);
                break;
            }
            // The others are dressed all the same.
            Err(failure) => {
                fault.get_or_insert(Failure {
                    what: format!("person {n}: {}", failure.what),
                    ..failure
                });
            }
        }
    }
    match fault {
        Some(fault) => Outcome::with_fault(outcomes, fault),
        None if several => Ok(Outcome::all(outcomes)),
        None => Ok(outcomes.swap_remove(0)),
    }
}

fn look_for_people(photo: &Photo) -> Result<Found, Failure> {
    Ok(find_people(&models()?, &flatten(&photo.image, [255; 3])))
}

/// How many people can be dressed in a photo; nobody is a failure.
pub(crate) fn people(photo: &Photo) -> Result<usize, Failure> {
    let found = look_for_people(photo)?;
    match found.people.len() {
        0 => Err(nobody(&found).at(photo.file.clone())),
        n => Ok(n),
    }
}

/// The two networks that come with Muslin.
pub(crate) fn models() -> Result<Models, Failure> {
    let damaged =
        |e: String| Failure::new(Exit::Invalid, "pose-asset", e).hint("install Muslin again");
    let graphs = muslin_io::pose_graphs().map_err(|e| damaged(e.to_string()))?;
    Models::new(&graphs.detector, &graphs.landmarks).map_err(|e| damaged(e.to_string()))
}

/// Numbers, from 1, of the people to dress.
fn choose(found: &Found, photo: &Photo, job: &mut Job) -> Result<Vec<usize>, Failure> {
    let n = found.people.len();
    if n == 0 {
        return Err(nobody(found).at(photo.file.clone()));
    }
    match job.options.person {
        Person::All => Ok((1..=n).collect()),
        Person::Nth(k) if k <= n => Ok(vec![k]),
        Person::Nth(k) => {
            let what = format!("there is no person {k}: {n} found");
            Err(Failure::new(Exit::Invalid, "no-such-person", what).at(photo.file.clone()))
        }
        Person::Largest => {
            if n > 1 {
                job.warn(format!(
                    "{n} people in the photo; dressing the largest. --person 2 takes the next, --person all everybody"
                ));
            }
            Ok(vec![1])
        }
    }
}

/// Scores that a person has at least.
const NEEDED: f64 = 0.5;

fn nobody(found: &Found) -> Failure {
    let (score, whole) = (found.best_score, found.best_presence);
    let what = match score.min(whole) >= NEEDED {
        true => {
            "no person found: what looks like one shows too few of a person's points".to_owned()
        }
        false => format!(
            "no person found: best score {score:.2}, {whole:.2} for a whole person (needed {NEEDED:.2} each)"
        ),
    };
    let hint = "use a photo that shows a person from head to feet, upright, in good light, \
                at least 200 pixels tall; one of many, or far away, is found once the picture is cut to them";
    Failure::new(Exit::Invalid, "nobody-found", what).hint(hint)
}

/// A file's fault as a job's failure.
pub(crate) fn file_failure(e: &muslin_io::IoError) -> Failure {
    let exit = match e.exit_code() {
        3 => Exit::Invalid,
        4 => Exit::Refused,
        8 => Exit::Busy,
        _ => Exit::Files,
    };
    Failure::new(exit, e.code(), e.to_string()).hint(e.hint())
}

/// How many stages a job has.
const STAGES: usize = 5;
/// Limbs that are turned farther off a pose than this are told of [rad].
const TURNED: f64 = 0.25;
/// The fitted body over the photo.
const OVERLAY: &str = "overlay.png";
/// What may be written to a folder.
const RESULTS: [&str; 5] = ["look.glb", "front.png", "turntable.png", OVERLAY, REPORT];
const REPORT: &str = "report.json";

/// A body in its pose, as it fits a person.
fn fitted(avatar: &Avatar, options: &DressOptions, seen: &Seen) -> Result<(Fit, Sitter), Failure> {
    let how = FitOptions {
        height_m: options.height,
        weight_kg: options.weight,
        shape: expected(options)?,
        focal_px: None,
    };
    let fit = Fitter::new(avatar).and_then(|f| f.fit(&seen.keypoints, &how));
    let fit = fit.map_err(|e| Failure::new(Exit::Invalid, "fit", e.to_string()))?;
    let sitter = Sitter::new(avatar, &fit.shape, fit.pose.clone())?;
    Ok((fit, sitter))
}

/// What is worn, as it was cut, and what there is to be said of it.
struct Cut {
    outfit: Result<Outfit, Failure>,
    warnings: Vec<String>,
}

impl Cut {
    fn new(avatar: &Avatar, options: &DressOptions) -> Self {
        let mut warnings = Vec::new();
        let outfit = Outfit::make(avatar, options, |w| warnings.push(w.to_owned()));
        Self { outfit, warnings }
    }
}

impl<'a, 'w> Job<'a, 'w> {
    fn new(avatar: &'a Avatar, options: &'a DressOptions, watch: &'a mut Watch<'w>) -> Self {
        Self {
            avatar,
            options,
            watch,
            report: Report::default(),
            times: Report::default(),
            warnings: Vec::new(),
        }
    }

    fn warn(&mut self, warning: String) {
        self.watch.warn(&warning);
        self.warnings.push(warning);
    }

    fn done(&mut self, number: usize, name: &'static str, result: String) -> Result<(), Failure> {
        let seconds = self.watch.done((number, STAGES), name, result)?;
        self.times.set(name, (seconds * 1e4).round() / 1e4);
        Ok(())
    }

    /// Dresses somebody in a photo; clothes are cut once for all.
    fn dress_person(
        mut self,
        (seen, photo): (&Seen, &Photo),
        cut: &OnceLock<Cut>,
        folder: &Path,
    ) -> Result<Outcome, Failure> {
        let (avatar, options) = (self.avatar, self.options);
        self.report.set("pose", tell::pose(seen));
        self.done(1, "pose", tell::points(seen))?;
        // Cutting needs nothing of a body's fit.
        let (fitted, cut) = rayon::join(
            || fitted(avatar, options, seen),
            || cut.get_or_init(|| Cut::new(avatar, options)),
        );
        let model = self.fitted(fitted.map_err(|f| f.at(photo.file.clone()))?, photo)?;
        self.clothe(&model, cut, folder)
    }

    /// Tells of a body that was fitted to a person.
    fn fitted<'p>(
        &mut self,
        (fit, sitter): (Fit, Sitter),
        photo: &'p Photo,
    ) -> Result<Model<'p>, Failure> {
        let measures = self.avatar.measure(&sitter.figure);
        let mut body = match self.options.weight {
            Some(_) => tell::person(&fit.shape, &measures),
            // Girths that nobody has measured say nothing of a size.
            None => tell::body(&fit.shape, &measures),
        };
        let doubts = tell::doubts(&fit, self.options);
        tell::fit(&mut body, &fit, &doubts);
        self.report.set("body", body);
        self.done(2, "body", tell::fitted(&fit, &measures))?;
        let unseen = doubts.iter().filter_map(|d| d.strip_suffix(UNSEEN));
        let unseen: Vec<&str> = unseen.collect();
        if !unseen.is_empty() {
            self.warn(format!(
                "hidden or unclear in the photo, and guessed: {}",
                unseen.join(", ")
            ));
        }
        let over = self.options.overlay.then_some((fit.camera, &photo.image));
        Ok(Model { sitter, over })
    }

    /// Sizes, drapes, judges and writes.
    fn clothe(mut self, model: &Model, cut: &Cut, out: &Path) -> Result<Outcome, Failure> {
        // An unwritable folder must be known before the work is done.
        let output = Output::open(out).map_err(|e| file_failure(&e))?;
        // Files of two jobs must not come to lie beside each other.
        let alone = Lock::hold(&out.join("look.glb")).map_err(|e| file_failure(&e))?;
        cut.warnings.iter().for_each(|w| self.warn(w.clone()));
        let outfit = cut.outfit.clone()?;
        let wearer = Wearer {
            avatar: self.avatar,
            shape: &model.sitter.shape,
            figure: &model.sitter.figure,
            base: None,
        };
        let outfit = outfit.sized(wearer, self.options)?;
        outfit.tight().into_iter().for_each(|w| self.warn(w));
        self.report.set("outfit", tell::outfit(&outfit));
        tell::size(&mut self.report, &outfit);
        self.done(3, "outfit", tell::pieces(&outfit))?;
        let who = (self.avatar, &model.sitter);
        let dressed = match self.options.simulate {
            true => drape_outfit(self.avatar, &outfit, &model.sitter, self.watch)?,
            false => lay_outfit(who, &outfit, self.watch)?,
        };
        self.report
            .set("drape", tell::drape(&outfit, &dressed, model.sitter.turned));
        self.report
            .set("garments", tell::garments(&outfit, &dressed.uv));
        self.done(4, "drape", tell::quality(&dressed.quality))?;
        if let Some(fault) = dressed.quality.fault(self.options.allow_crossings) {
            return Err(fault);
        }
        if !dressed.quality.within_limits() {
            self.warn("the cloth is stretched beyond its fabric's limit; try --cut loose".into());
        } else if dressed.quality.is_caught() {
            let most = dressed.quality.settled.stretch_max * 100.0;
            self.warn(format!(
                "the cloth is caught somewhere, and stretched by {most:.0} % there; try --simulate, or a finer --edge"
            ));
        }
        let turned = model.sitter.turned;
        if turned > TURNED {
            self.warn(format!(
                "limbs are turned by up to {:.0} degrees off the pose, to make room for cloth",
                turned.to_degrees()
            ));
        }
        self.write(model, (&outfit, &dressed), (out, output, alone))
    }

    fn write(
        mut self,
        model: &Model,
        (outfit, dressed): (&Outfit, &Dressed),
        // The lock goes first: a folder that was made for nothing is empty then.
        (out, mut output, _alone): (&Path, Output, Option<Lock>),
    ) -> Result<Outcome, Failure> {
        let mut files = self.files(model, (outfit, dressed))?;
        let is_stale = !files.iter().any(|f| f.0 == OVERLAY) && is_as_told(out, OVERLAY);
        let written: Vec<_> = files
            .iter()
            .map(|(name, bytes)| (*name, bytes.len()))
            .collect();
        self.report.set("files", tell::files(&written));
        self.watch.go_on()?;
        let text = tell::written(out, &written);
        let seconds = self.watch.done((5, STAGES), "write", text)?;
        self.times.set("write", (seconds * 1e4).round() / 1e4);
        self.report.set("seconds", self.times.clone());
        let warnings = self.warnings.iter().map(|w| Value::from(w.as_str()));
        self.report.set("warnings", warnings.collect::<Vec<_>>());
        tell::colophon(&mut self.report);
        files.push((REPORT, report_json(&self.report).into_bytes()));
        for (name, bytes) in &files {
            output.add(name, bytes).map_err(|e| file_failure(&e))?;
        }
        output.commit().map_err(|e| file_failure(&e))?;
        if is_stale {
            // Whoever it shows may be somebody else; that it cannot be removed is no reason to fail.
            let _ = std::fs::remove_file(out.join(OVERLAY));
        }
        Ok(Outcome::new(tell::table(&self.report, out), &self.report))
    }

    /// Names and bytes of the results, the report left out.
    fn files(
        &self,
        model: &Model,
        (outfit, dressed): (&Outfit, &Dressed),
    ) -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
        let (avatar, backdrop) = (self.avatar, self.options.backdrop);
        let sitter = model
            .sitter
            .with_skin(avatar, &dressed.quality.settled.body);
        let who = (avatar, &sitter);
        let (file, [front, turning]) = rayon::join(
            || {
                let figure = files::scene(who, outfit, dressed);
                files::check_stored(avatar, &figure)?;
                glb(&figure, &muslin_io::GlbOptions::default()).map_err(|e| file_failure(&e))
            },
            || pictures(who, (outfit, dressed), backdrop),
        );
        let mut files = vec![
            ("look.glb", file?),
            ("front.png", front),
            ("turntable.png", turning),
        ];
        if let Some((camera, photo)) = &model.over {
            files.push((
                OVERLAY,
                png(&look::over_photo(avatar, &model.sitter, camera, photo)),
            ));
        }
        Ok(files)
    }
}

/// Whether the report in a folder tells of a file of that name.
fn told_of(folder: &Path, file: &str) -> bool {
    tell::tells_of(&folder.join(REPORT), file)
}

/// Whether a result is there that an earlier run told of, as large as it was then: what somebody else has put in its place
/// is not ours to take away.
fn is_as_told(folder: &Path, file: &str) -> bool {
    let told = tell::bytes_of(&folder.join(REPORT), file);
    let there = std::fs::metadata(folder.join(file)).map(|m| m.len());
    told.is_some_and(|bytes| there.is_ok_and(|b| b == bytes))
}

/// Results of earlier runs in `out` that those of `now` do not replace: of other people, perhaps.
fn left_over(out: &Path, now: &[&Path]) -> Vec<String> {
    let folders = std::fs::read_dir(out).into_iter().flatten().flatten();
    let is_person = |p: &Path| {
        let name = p.file_name().unwrap_or_default().to_string_lossy();
        name.strip_prefix("person-")
            .is_some_and(|n| n.parse::<usize>().is_ok())
    };
    let people = folders.map(|f| f.path()).filter(|p| is_person(p));
    let all = people
        .chain([out.to_owned()])
        .filter(|p| told_of(p, "look.glb"));
    let mut left: Vec<String> = all
        .filter(|p| !now.contains(&p.as_path()))
        .map(|p| format!("{} has the results of an earlier run", p.display()))
        .collect();
    left.sort();
    left
}

/// A failure that says what lies in the folder that nothing was written to now.
fn with_left_over(failure: Failure, out: &Path) -> Failure {
    let left = left_over(out, &[]);
    if left.is_empty() {
        return failure;
    }
    let hints = [failure.hint.clone(), left.join(", ")];
    let hints = hints.into_iter().filter(|h| !h.is_empty());
    failure.hint(hints.collect::<Vec<_>>().join("; "))
}

/// The front picture and the turntable.
fn pictures(
    (avatar, sitter): (&Avatar, &Sitter),
    (outfit, dressed): (&Outfit, &Dressed),
    backdrop: Backdrop,
) -> [Vec<u8>; 2] {
    let cloth = &dressed.drape.frames[0];
    let who = (avatar, sitter.posed.verts.as_slice());
    let scene = look::scene(who, outfit, cloth, backdrop);
    let stage = look::stage(&scene);
    let (turning, front) = rayon::join(
        || animated_png(&look::turning(&stage), look::FRAME_MS),
        || png(&look::front(&stage)),
    );
    [front, turning]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_of_other_people_are_told_of_and_those_that_are_replaced_are_not() {
        let out = std::env::temp_dir().join(format!("muslin-left-{}", std::process::id()));
        let people = ["person-1", "person-2", "person-x"].map(|p| out.join(p));
        assert_eq!(left_over(&out, &[]), Vec::<String>::new());
        for folder in people.iter().chain([&out]) {
            std::fs::create_dir_all(folder).expect("our own folder");
            let report = "{\"files\": {\"look.glb\": 3}}";
            std::fs::write(folder.join("report.json"), report).expect("it is written");
        }
        assert!(told_of(&out, "look.glb") && !told_of(&out, OVERLAY));
        let left = left_over(&out, &[&people[0]]);
        let of = |p: &Path| {
            left.iter()
                .any(|w| w.starts_with(&format!("{} has", p.display())))
        };
        assert_eq!(left.len(), 2, "{left:?}");
        assert!(of(&out) && of(&people[1]));
        let fault = Failure::new(Exit::Invalid, "fit", "no").hint("look again");
        let told = with_left_over(fault, &out).hint;
        assert!(
            told.starts_with("look again; ") && told.contains("an earlier run"),
            "{told}"
        );
        std::fs::remove_dir_all(&out).expect("our own folder");
    }
}
