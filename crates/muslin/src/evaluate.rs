//! Judges any animated cloth by the same measures, wherever it came from.
//!
//! Energies are those of one reference cloth (the material that SNUG, Santesteban et al. 2022,
//! trains with): isotropic, E = 70 kPa, ν = 0.485, 0.47 mm thick, 426 kg/m³, bending fifty times
//! that of the plate. So figures compare cloths of different makers, not fabrics. Areas are true
//! areas, folds have a sign, and the side of a closed body is told by how often it winds around a
//! point (of an open one by pseudo-normals). Intersections are decided by exact predicates.
//! Non-finite frames are counted and left out.

pub(crate) mod beyond;
mod contact;
mod frame;
mod material;
mod passage;
mod series;
pub(crate) mod solver;

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use glam::DVec3;
use muslin_geom::{Aabb, Report, Value};
use muslin_io::{Clip, read_clip, report_json, write_file};
use rayon::prelude::*;

use crate::apart::full;
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::outcome::Outcome;
use crate::table::Table;
use crate::watch::Watch;
use beyond::Still;
use contact::Scene;
use frame::Frame;
use material::Reference;
use solver::Solver;

/// Cloth that is as large as this at its largest is no surprise [m].
const SIZES: RangeInclusive<f64> = 0.1..=20.0;

/// Vertices deeper in the body than this are counted over all frames [m].
const DEEP: f32 = 0.5e-3;

/// Who a file is held against.
#[derive(Clone, Debug, PartialEq)]
pub enum Against {
    /// Somebody else's file of the same cloth and motion.
    File(PathBuf),
    /// Our solver, that leads some frames of the file to rest.
    Minimiser,
    /// Our simulator, on the file's own body from where its first frame lies.
    Simulator,
}

/// Frames that are led to the minimiser, where nobody says how many.
const SAMPLES: usize = 9;

/// What a file is held against, and where the answer goes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluateOptions {
    /// Whom distances and energies are told against.
    pub against: Option<Against>,
    /// What minimiser and simulator take the cloth to be made of: a fabric's name or file. Without it, what the file
    /// says, and `paper-snug-cotton` where it says nothing.
    pub fabric: Option<String>,
    /// Frames, evenly spread, that the minimiser leads to rest; nine if none is said, all of them for zero.
    pub samples: Option<usize>,
    /// A file of the same cloth and motion without swing, as `animate --motion-level 0` writes it: what cloth does
    /// beyond it is its dynamic content.
    pub still: Option<PathBuf>,
    /// Where the report goes: beside the file, as `NAME.evaluation.json`, if that is not said.
    pub out: Option<PathBuf>,
    /// A table (CSV) of every frame, as well.
    pub frames: Option<PathBuf>,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// All figures, in groups.
    pub report: Report,
    /// What changes over time: CSV, one line a frame.
    pub frames: String,
}

/// Measures every frame of `clip`; `against`, of the same cloth and rate, gives distances and the
/// gap of energies to another answer, as a rule the simulator's.
///
/// The rest shape is the clip's own: its pattern, else its shape at rest, else the first frame
/// (which the report then says). The same clip gives the same figures on any number of threads.
pub fn evaluate(clip: &Clip, against: Option<&Clip>) -> Result<Evaluation, Failure> {
    judge(clip, None, |cloth, frames| {
        let told = against.map(|t| compare((clip, None), (t, Report::default()), cloth, frames));
        told.transpose()
    })
}

fn judge(
    clip: &Clip,
    still: Option<&Still>,
    against: impl FnOnce(&Reference, &[Frame]) -> Result<Option<Report>, Failure>,
) -> Result<Evaluation, Failure> {
    clip.check_shape().map_err(|e| file_failure(&e))?;
    let cloth = Reference::of(clip);
    let sound = frame::sound(clip);
    if !sound.contains(&true) {
        let fault = Failure::new(
            Exit::Invalid,
            "not-finite",
            "no frame has finite positions only",
        );
        return Err(fault.hint("write the animation again: nothing in it can be measured"));
    }
    let indices: Vec<usize> = (0..sound.len()).filter(|&t| sound[t]).collect();
    let scene = Scene::new(clip, indices[0]);
    let measure = |scene: &mut Scene, &t: &usize| Frame::measure(clip, &cloth, scene, (t, &sound));
    let each = indices.par_iter();
    let frames: Vec<Frame> = each.map_init(|| scene.clone(), measure).collect();
    let mut report = Report::default();
    report.set("clip", about(clip, &cloth, &sound));
    report.set("energies", energies(&frames));
    report.set("stretch", stretch(&frames));
    report.set("shape", shape(&frames));
    if !clip.body.is_empty() {
        report.set("contact", contact(clip, &frames, &sound));
    }
    report.set("self", crossings(clip, &frames, &sound));
    report.set("time", time((clip, still), &frames, &sound));
    if let Some(told) = against(&cloth, &frames)? {
        report.set("against", told);
    }
    let frames = series::csv(&frames, clip.drape.fps);
    Ok(Evaluation { report, frames })
}

/// Evaluates the file (or folder of point caches) at `path`, writes what the options ask for, and gives the table.
pub fn evaluate_file(
    path: &Path,
    options: &EvaluateOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    let beside = beside(path);
    let target = options.out.as_deref().unwrap_or(&beside);
    kept_apart((path, options), target)?;
    if let (Some(Against::File(_)), Some(_)) = (&options.against, &options.fabric) {
        let what = "it is for minimiser and simulator: a file's cloth is what that file has";
        return Err(Failure::new(Exit::Usage, "no-use", what).at("--fabric"));
    }
    if options.against != Some(Against::Minimiser) && options.samples.is_some() {
        let what = "only the minimiser leads single frames to rest: all of them are compared here";
        return Err(Failure::new(Exit::Usage, "no-use", what).at("--samples"));
    }
    let read = |p: &Path| read_clip(p).map_err(|e| file_failure(&e));
    let clip = read(path)?;
    if clip.body.is_empty() {
        watch.warn("the file has no body that cloth lies on: how they meet is not measured");
    }
    let still = options.still.as_deref().map(read).transpose()?;
    let still = still.map(|s| Still::of(&clip, s)).transpose()?;
    let still = still.as_ref();
    let solver = || Solver::new(&clip, options.fabric.as_deref());
    let mut evaluation = match &options.against {
        None => judge(&clip, still, |_, _| Ok(None)),
        Some(Against::File(path)) => {
            let other = read(path)?;
            judge(&clip, still, |cloth, frames| {
                compare((&clip, still), (&other, Report::default()), cloth, frames).map(Some)
            })
        }
        Some(Against::Minimiser) => {
            let solver = solver()?;
            let samples = options.samples.unwrap_or(SAMPLES);
            let some = (samples > 0).then_some(samples);
            judge(&clip, still, |cloth, _| {
                solver.minimised(some, (cloth, watch)).map(Some)
            })
        }
        Some(Against::Simulator) => {
            let solver = solver()?;
            judge(&clip, still, |cloth, frames| {
                let truth = (&solver.simulated(watch)?, solver.told("simulator"));
                compare((&clip, still), truth, cloth, frames).map(Some)
            })
        }
    }
    .map_err(|fault| match fault.place.is_empty() {
        true => fault.at(muslin_io::name(path)),
        false => fault,
    })?;
    size(&clip).into_iter().for_each(|w| watch.warn(&w));
    if clip.rate_unknown && clip.drape.frames.len() > 1 {
        watch.warn("it does not tell its frames a second (`fps`): taken as 30, which speeds, accelerations and energies in motion go by");
    }
    let file = muslin_io::name(path);
    evaluation
        .report
        .set("file", file.as_str())
        .set("muslin", env!("CARGO_PKG_VERSION"));
    let json = report_json(&evaluation.report);
    write_file(target, json.as_bytes()).map_err(|e| file_failure(&e))?;
    if let Some(path) = &options.frames {
        write_file(path, evaluation.frames.as_bytes()).map_err(|e| file_failure(&e))?;
    }
    Ok(Outcome::new(evaluation.table(), &evaluation.report))
}

/// What is to be said of cloth whose size no clothes have.
fn size(clip: &Clip) -> Option<String> {
    let first = clip
        .drape
        .frames
        .iter()
        .find(|f| f.iter().all(|x| x.is_finite()))?;
    let bounds = Aabb::of(first);
    let largest = (bounds.max - bounds.min).max_element();
    (!SIZES.contains(&largest)).then(|| {
        format!("the cloth is {largest:.3} m across: positions are to be in metres, or energies and distances mean nothing")
    })
}

/// Where the report of `path` goes if nobody says: beside it, after its name; a folder keeps what is after a dot there.
fn beside(path: &Path) -> PathBuf {
    const OWN: &str = "evaluation.json";
    if !path.is_dir() {
        return path.with_extension(OWN);
    }
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let mut name = full.into_os_string();
    name.push(".");
    name.push(OWN);
    name.into()
}

/// Refuses to write over what is read, or both results into one file.
fn kept_apart((path, options): (&Path, &EvaluateOptions), target: &Path) -> Result<(), Failure> {
    let against = match &options.against {
        Some(Against::File(file)) => Some(file.as_path()),
        _ => None,
    };
    let read = [Some(path), options.still.as_deref(), against];
    let read: Vec<&Path> = read.into_iter().flatten().collect();
    let made = [
        ("--out", Some(target)),
        ("--frames", options.frames.as_deref()),
    ];
    let made: Vec<(&str, &Path)> = made
        .into_iter()
        .filter_map(|(o, p)| Some((o, p?)))
        .collect();
    for (k, (option, file)) in made.iter().enumerate() {
        let taken = read.iter().copied().chain(made[..k].iter().map(|m| m.1));
        if taken
            .into_iter()
            .any(|t| t == *file || (full(t).is_some() && full(t) == full(file)))
        {
            let what = format!("{} is read, or written, already", file.display());
            let fault = Failure::new(Exit::Usage, "same-file", what).at(*option);
            return Err(fault.hint(
                "the report is JSON and the table of frames CSV: name a file of its own for each",
            ));
        }
    }
    Ok(())
}

impl Evaluation {
    /// A figure of a group; NaN if there is none.
    pub(crate) fn figure(&self, group: &str, name: &str) -> f64 {
        match self.report.get(group) {
            Some(Value::Tree(tree)) => match tree.get(name) {
                Some(Value::Number(x)) => *x,
                _ => f64::NAN,
            },
            _ => f64::NAN,
        }
    }

    /// One line a figure: group, name, value.
    pub fn table(&self) -> String {
        let mut table = Table::new(&["group", "figure", "value"]);
        for (group, value) in self.report.entries() {
            let Value::Tree(figures) = value else {
                continue;
            };
            for (i, (name, value)) in figures.entries().iter().enumerate() {
                let shown = match value {
                    Value::Number(x) => short(*x),
                    Value::Text(t) => t.clone(),
                    Value::Flag(f) => f.to_string(),
                    _ => continue,
                };
                let group = if i == 0 { group.as_str() } else { "" };
                table.row([group, &name.replace('_', " "), &shown]);
            }
        }
        table.text()
    }
}

/// Four digits that count.
fn short(x: f64) -> String {
    match x.abs() {
        _ if x == x.round() && x.abs() < 1e9 => format!("{x}"),
        a if a >= 1000.0 => format!("{x:.0}"),
        a if a >= 1.0 => format!("{x:.3}"),
        a if a >= 1e-3 => format!("{x:.5}"),
        _ => format!("{x:.3e}"),
    }
}

/// NaN of nothing.
pub(crate) fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for x in values {
        (sum, n) = (sum + x, n + 1);
    }
    if n == 0 { f64::NAN } else { sum / n as f64 }
}

fn most(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NAN, f64::max)
}

/// The value below which a share of all lies.
fn percentile(values: &mut [f32], share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
}

fn about(clip: &Clip, cloth: &Reference, sound: &[bool]) -> Report {
    let mut r = Report::default();
    let n_body = clip.body.first().map_or(0, Vec::len);
    r.set("frames", clip.drape.frames.len())
        .set("frames_per_second", clip.drape.fps);
    r.set("vertices", clip.n_verts())
        .set("triangles", clip.drape.faces.len());
    r.set("body_vertices", n_body)
        .set("garments", clip.garments().len());
    r.set("rest_shape", cloth.rest_from)
        .set("mass_kg", cloth.mass.iter().sum::<f64>());
    r.set("non_finite_frames", sound.iter().filter(|s| !**s).count());
    r.set("non_finite_values", frame::non_finite(clip));
    r
}

fn energies(frames: &[Frame]) -> Report {
    let mut r = Report::default();
    let of = |f: fn(&Frame) -> f64| mean(frames.iter().map(f));
    let [strain, bend, gravity] = [of(|f| f.strain), of(|f| f.bend), of(|f| f.gravity)];
    let inertia = mean(frames.iter().filter_map(|f| f.inertia));
    let lowest = frames
        .iter()
        .map(|f| f.gravity)
        .fold(f64::INFINITY, f64::min);
    r.set("strain_J", strain).set("bend_J", bend);
    r.set("gravity_J", gravity)
        .set("gravity_above_lowest_frame_J", gravity - lowest);
    r.set("inertia_J", inertia);
    r.set(
        "total_J",
        strain + bend + gravity + if inertia.is_nan() { 0.0 } else { inertia },
    );
    r.set(
        "residual_force_per_weight_free_vertices",
        // Frames in which all cloth lies on the body have none.
        mean(frames.iter().map(|f| f.residual).filter(|r| r.is_finite())),
    );
    r
}

fn stretch(frames: &[Frame]) -> Report {
    let mut r = Report::default();
    let mut edges: Vec<f32> = frames
        .iter()
        .flat_map(|f| f.edges.iter().copied())
        .collect();
    let mut large: Vec<f32> = frames
        .iter()
        .flat_map(|f| f.large.iter().copied())
        .collect();
    let mut small: Vec<f32> = frames
        .iter()
        .flat_map(|f| f.small.iter().copied())
        .collect();
    let square = mean(edges.iter().map(|&e| f64::from(e).powi(2)));
    r.set("edge_mean", mean(edges.iter().map(|&e| f64::from(e))))
        .set("edge_rms", square.sqrt());
    r.set("edge_p99", percentile(&mut edges, 0.99))
        .set("edge_max", percentile(&mut edges, 1.0));
    r.set("area_change_mean", mean(frames.iter().map(|f| f.area)));
    r.set("principal_p01", percentile(&mut small, 0.01))
        .set("principal_p99", percentile(&mut large, 0.99));
    r.set("principal_max", percentile(&mut large, 1.0));
    r
}

fn shape(frames: &[Frame]) -> Report {
    let mut r = Report::default();
    r.set("fold_mean_deg", mean(frames.iter().map(|f| f.fold)));
    r.set(
        "fold_change_mean_deg",
        mean(frames.iter().map(|f| f.fold_change)),
    );
    r
}

fn contact(clip: &Clip, frames: &[Frame], sound: &[bool]) -> Report {
    let mut r = Report::default();
    let n = clip.n_verts() as f64;
    let share = |f: fn(&Frame) -> usize| 100.0 * mean(frames.iter().map(|x| f(x) as f64)) / n;
    let depths = frames.iter().flat_map(|f| f.contact.depths.iter());
    let deepest = most(
        frames
            .iter()
            .flat_map(|f| f.contact.depths.iter().map(|d| f64::from(*d))),
    );
    let mean_depth = mean(depths.map(|d| f64::from(*d)));
    let or_zero = |x: f64| if x.is_nan() { 0.0 } else { 1000.0 * x };
    r.set("penetrating_percent", share(|f| f.contact.depths.len()));
    r.set("depth_mean_mm", or_zero(mean_depth))
        .set("depth_max_mm", or_zero(deepest));
    let deep = |f: &Frame| f.contact.depths.iter().filter(|d| **d > DEEP).count();
    r.set(
        "deeper_than_half_a_mm",
        frames.iter().map(deep).sum::<usize>(),
    );
    r.set("under_2_mm_percent", share(|f| f.contact.close));
    r.set(
        "penetrating_by_nearest_vertex_percent",
        share(|f| f.contact.by_nearest_vertex),
    );
    let pairs = || frames.iter().map(|f| f.contact.pairs as f64);
    r.set("body_intersections_a_frame", mean(pairs()))
        .set("body_intersections_max", most(pairs()));
    r.set(
        "frames_with_body_intersections",
        pairs().filter(|&p| p > 0.0).count(),
    );
    r.set(
        "passages_between_frames",
        passage::through_body(clip, sound),
    );
    // Mouth and eye sockets cross at all times; what comes on top is the pose's doing.
    let own = || {
        frames
            .iter()
            .filter_map(|f| f.contact.body_self.map(|n| n as f64))
    };
    let least = own().fold(f64::INFINITY, f64::min);
    if least.is_finite() {
        r.set("body_self_crossings_least", least)
            .set("body_self_crossings_max", most(own()));
    }
    r
}

fn crossings(clip: &Clip, frames: &[Frame], sound: &[bool]) -> Report {
    let mut r = Report::default();
    let edges = || frames.iter().map(|f| f.crossings as f64);
    r.set("edge_triangle_crossings_a_frame", mean(edges()))
        .set("edge_triangle_crossings_max", most(edges()));
    r.set(
        "frames_with_crossings",
        edges().filter(|&c| c > 0.0).count(),
    );
    r.set(
        "passages_between_frames",
        passage::through_cloth(clip, sound),
    );
    let n = clip.n_verts() as f64;
    if clip.drape.parts.len() > 1 {
        let wrong = mean(frames.iter().map(|f| f.wrong_order as f64));
        r.set("wrong_order_layer_percent", 100.0 * wrong / n);
    }
    r
}

fn time((clip, still): (&Clip, Option<&Still>), frames: &[Frame], sound: &[bool]) -> Report {
    let mut r = Report::default();
    r.set(
        "acceleration_mean_m_s2",
        mean(frames.iter().filter_map(|f| f.acceleration)),
    );
    r.set("jerk_mean_m_s3", mean(frames.iter().filter_map(|f| f.jerk)));
    if let Some(drift) = frame::drift(clip, sound) {
        r.set("drift_on_still_body_mm_10s", 1000.0 * drift);
    }
    if let Some(still) = still {
        let [content, swing] = still.own;
        r.set("dynamic_content_mm", content).set("swing_mm", swing);
    }
    r
}

/// Rates of frames that differ by no more than this share are the same: 29.97 and 30.
const SAME_RATE: f64 = 0.002;

/// Refuses what is not the same cloth for as many frames at the same rate; `at` is where the other file is named.
fn same_cloth(clip: &Clip, other: &Clip, at: &str) -> Result<(), Failure> {
    other.check_shape().map_err(|e| file_failure(&e))?;
    let frames = [clip, other].map(|c| c.drape.frames.len());
    let fps = [clip, other].map(|c| c.drape.fps);
    let verts = [clip, other].map(|c| c.drape.frames.first().map_or(0, Vec::len));
    let what = if other.drape.faces != clip.drape.faces {
        "the other file has other triangles".to_owned()
    } else if verts[0] != verts[1] {
        format!(
            "the other file has {} vertices, this one {}",
            verts[1], verts[0]
        )
    } else if frames[0] != frames[1] {
        format!(
            "the other file has {} frames, this one {}",
            frames[1], frames[0]
        )
    } else if frames[0] > 1 && (fps[1] / fps[0] - 1.0).abs() > SAME_RATE {
        format!(
            "the other file has {} frames a second, this one {}",
            fps[1], fps[0]
        )
    } else {
        return Ok(());
    };
    let fault = Failure::new(Exit::Invalid, "not-the-same-cloth", what);
    Err(fault
        .at(at)
        .hint("export both from the same garment and motion"))
}

fn compare(
    (clip, still): (&Clip, Option<&Still>),
    (truth, mut r): (&Clip, Report),
    cloth: &Reference,
    frames: &[Frame],
) -> Result<Report, Failure> {
    same_cloth(clip, truth, "--against")?;
    let sound = frame::sound(truth);
    let both: Vec<&Frame> = frames.iter().filter(|f| sound[f.t]).collect();
    let mut distances = Distances::default();
    let (mut gaps, mut accelerations) = (Vec::new(), Vec::new());
    for frame in &both {
        let (a, b) = (&clip.drape.frames[frame.t], &truth.drape.frames[frame.t]);
        distances.add(a, b);
        let theirs = Frame::energy(truth, cloth, (frame.t, &sound));
        // Behind a frame that is not finite nobody knows how fast they go.
        if frame.inertia.is_some() == theirs.inertia.is_some() {
            gaps.push(frame.total() - theirs.total());
        }
        accelerations.extend(theirs.acceleration);
    }
    distances.tell(&mut r);
    r.set("energy_gap_J", mean(gaps))
        .set("energies_of", "reference cloth");
    r.set("their_acceleration_mean_m_s2", mean(accelerations));
    if let Some(still) = still {
        let [content, swing] = still.content(&truth.drape.frames);
        r.set("their_dynamic_content_mm", content)
            .set("their_swing_mm", swing);
        r.set("dynamic_content_of_theirs", still.own[0] / content)
            .set("swing_of_theirs", still.own[1] / swing);
    }
    Ok(r)
}

/// How far vertices are from where somebody else has them.
#[derive(Default)]
struct Distances(Vec<f32>);

impl Distances {
    fn add(&mut self, a: &[DVec3], b: &[DVec3]) {
        let each = a.iter().zip(b);
        self.0
            .extend(each.map(|(x, y)| 1000.0 * x.distance(*y) as f32));
    }

    fn tell(mut self, r: &mut Report) {
        r.set("distance_mean_mm", mean(self.0.iter().map(|&d| d.into())));
        r.set("distance_p95_mm", percentile(&mut self.0, 0.95));
    }
}

#[cfg(test)]
mod tests;
