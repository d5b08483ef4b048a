//! Many drapes, and the whole job.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use glam::DVec3;
use muslin_body::Avatar;
use muslin_io::{Output, png};

use super::clock::{least_of, load, peak_memory};
use super::{crowd, needed};
use crate::drape::{Dressed, Quality, drape_outfit};
use crate::dress::{dress as whole_job, file_failure};
use crate::failure::Failure;
use crate::figure::{Sitter, body_failure};
use crate::look;
use crate::options::{Backdrop, DressOptions, Wear};
use crate::outfit::Outfit;
use crate::table::Table;
use crate::watch::Watch;

/// What happened to one garment over all cases.
#[derive(Default)]
struct Tally {
    cases: usize,
    failed: Vec<String>,
    in_body: Vec<String>,
    crossed: Vec<String>,
    stretched: Vec<String>,
    restless: usize,
    seconds: Vec<f64>,
}

impl Tally {
    fn add(&mut self, name: &str, result: Result<Dressed, Failure>, seconds: f64) {
        self.cases += 1;
        self.seconds.push(seconds);
        let dressed = match result {
            Ok(dressed) => dressed,
            Err(e) => return self.failed.push(format!("{name}: {e}")),
        };
        let (q, s) = (&dressed.quality, &dressed.quality.settled);
        if s.body_intersections > 0 {
            self.in_body
                .push(format!("{name}: {}", s.body_intersections));
        }
        if s.self_crossings > 0 {
            self.crossed.push(format!("{name}: {}", s.self_crossings));
        }
        if !q.within_limits() {
            self.stretched
                .push(format!("{name}: {:.1} %", q.stretch_p99() * 100.0));
        }
        self.restless += usize::from(!s.converged);
    }

    fn row(&mut self, garment: &str) -> [String; 9] {
        self.seconds.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let k = ((self.seconds.len().max(1) - 1) as f64 * share) as usize;
            format!("{:.2}", self.seconds.get(k).copied().unwrap_or(0.0))
        };
        [
            garment.to_owned(),
            self.cases.to_string(),
            self.failed.len().to_string(),
            self.in_body.len().to_string(),
            self.crossed.len().to_string(),
            self.stretched.len().to_string(),
            self.restless.to_string(),
            at(0.5),
            at(1.0),
        ]
    }

    fn faults(&self) -> usize {
        self.failed.len() + self.in_body.len() + self.crossed.len() + self.stretched.len()
    }

    /// How many cases and faults there were.
    fn so_far(&self, garment: &str) -> String {
        let kinds = [&self.failed, &self.in_body, &self.crossed, &self.stretched];
        let [failed, body, crossed, stretched] = kinds.map(Vec::len);
        format!(
            "{garment} {} ({failed} failed, {body} in the body, {crossed} crossed, \
             {stretched} stretched)",
            self.cases
        )
    }

    fn words(&self) -> String {
        let kinds = [
            ("failed", &self.failed),
            ("in the body", &self.in_body),
            ("crosses itself", &self.crossed),
            ("beyond its limit", &self.stretched),
        ];
        let lines = kinds
            .into_iter()
            .filter(|(_, list)| !list.is_empty())
            .map(|(kind, list)| format!("{kind}: {}", list.join("; ")));
        lines.collect::<Vec<_>>().join("\n")
    }
}

/// Which drapes to do, and what to keep of those that go wrong.
#[derive(Clone, Debug, Default)]
pub struct Drapes {
    /// Bodies, and poses for each.
    pub cases: usize,
    /// Only cases whose name ("tee, body 3, sit01 frame 0") holds one of these; all if empty.
    pub only: Vec<String>,
    /// Folder for a picture of every case with a fault, or of every case named by `only`.
    pub pictures: Option<PathBuf>,
}

/// One drape to do.
struct Case<'a> {
    name: String,
    /// Where it counts, in [`KINDS`].
    kind: usize,
    /// What is worn.
    options: DressOptions,
    body: u64,
    moment: &'a crowd::Moment,
}

/// Tee and trousers on random bodies in recorded poses, and ten times `cases` random outfits on them,
/// as many drapes at a time as there are cores, each on one of them.
pub fn drape(data: Option<&Path>, drapes: &Drapes) -> Result<String, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let moments = crowd::moments(needed(data)?, drapes.cases)?;
    let cases = all_cases(&moments, drapes);
    let tallies = Mutex::new(KINDS.map(|_| Tally::default()));
    in_turns(cases.len(), |turn| {
        let case = &cases[turn];
        let outfit = Outfit::make(&avatar, &case.options, |_| {});
        let since = Instant::now();
        let result = outfit.and_then(|outfit| one(&avatar, &outfit, case, drapes));
        let mut tallies = tallies.lock().expect("nobody panics holding it");
        let before = tallies[case.kind].faults();
        tallies[case.kind].add(&case.name, result, since.elapsed().as_secs_f64());
        let all: Vec<String> = tallies
            .iter()
            .zip(KINDS)
            .map(|(t, g)| t.so_far(g))
            .collect();
        let faulty = tallies[case.kind].faults() > before;
        let name = if faulty { case.name.as_str() } else { "" };
        eprintln!("{}/{}: {}  {name}", turn + 1, cases.len(), all.join("; "));
    });
    let tallies = tallies.into_inner().expect("nobody panicked holding it");
    Ok(format!("{}\n{}", told(tallies), load()))
}

/// Every garment on every body at every moment, far apart in order; then random outfits.
fn all_cases<'a>(moments: &'a [crowd::Moment], drapes: &Drapes) -> Vec<Case<'a>> {
    let n = drapes.cases * drapes.cases;
    let case = |turn: usize| {
        let (k, kind) = (scattered(turn / GARMENTS, n), turn % GARMENTS);
        let (body, moment) = (k / drapes.cases, &moments[k % drapes.cases]);
        Case {
            name: format!("{}, body {body}, {}", KINDS[kind], moment.name),
            kind,
            options: DressOptions {
                outfit: vec![Wear::parse(KINDS[kind])],
                ..Default::default()
            },
            body: body as u64 + 1,
            moment,
        }
    };
    let random = |k: usize| {
        let options = crowd::outfit(k as u64 + 1);
        let wear = |w: &Wear| format!("{}:{}", w.garment, w.fabric.as_deref().unwrap_or("usual"));
        let worn: Vec<String> = options.outfit.iter().map(wear).collect();
        let moment = &moments[k % drapes.cases];
        Case {
            name: format!(
                "outfit {k}, {}, {:?}, {}",
                worn.join("+"),
                options.cut,
                moment.name
            ),
            kind: GARMENTS,
            options,
            body: 1000 + k as u64,
            moment,
        }
    };
    let wanted = |c: &Case<'_>| {
        drapes.only.is_empty() || drapes.only.iter().any(|part| c.name.contains(part))
    };
    let all = (0..n * GARMENTS)
        .map(case)
        .chain((0..OUTFITS * drapes.cases).map(random));
    all.filter(wanted).collect()
}

fn told(tallies: [Tally; 3]) -> String {
    let mut table = Table::new(&[
        "garment",
        "cases",
        "failed",
        "in body",
        "crossed",
        "stretched",
        "moving",
        "median s",
        "worst s",
    ]);
    let mut words = Vec::new();
    for (garment, mut tally) in KINDS.into_iter().zip(tallies) {
        table.row(tally.row(garment));
        words.push(tally.words());
    }
    format!("{}\n{}", table.text(), words.join("\n"))
}

/// What is tried on: two garments on everybody in every pose, then anything.
const KINDS: [&str; 3] = ["tee", "trousers", "outfits"];
const GARMENTS: usize = 2;
/// Random outfits for each of the cases asked for.
const OUTFITS: usize = 10;

/// The `k`th of `n` in an order that visits all, far apart: a bench that is cut short has seen
/// every body and every pose.
fn scattered(k: usize, n: usize) -> usize {
    let apart = |a: usize| {
        let (mut a, mut b) = (a, n);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a == 1
    };
    let golden = (n as f64 * 0.618) as usize;
    let stride = (golden.max(1)..).find(|s| apart(*s)).unwrap_or(1);
    k * stride % n
}

/// One outfit on one stranger at one moment.
fn one(
    avatar: &Avatar,
    outfit: &Outfit,
    case: &Case<'_>,
    drapes: &Drapes,
) -> Result<Dressed, Failure> {
    let shape = crowd::stranger(case.body);
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let sitter = Sitter::new(avatar, &shape, case.moment.pose(avatar, &figure)?)?;
    let dressed = drape_outfit(avatar, outfit, &sitter, &Watch::nobody())?;
    let shown = !drapes.only.is_empty() || faulty(&dressed.quality);
    if let Some(folder) = drapes.pictures.as_ref().filter(|_| shown) {
        let skin = &dressed.quality.settled.body;
        let body = sitter.with_skin(avatar, skin).posed.verts;
        let worn = (outfit, dressed.drape.frames[0].as_slice());
        picture(folder, (avatar, &body), worn, &case.name)?;
    }
    Ok(dressed)
}

fn faulty(quality: &Quality) -> bool {
    let s = &quality.settled;
    s.body_intersections + s.self_crossings > 0 || !quality.within_limits()
}

/// Front picture of a body and what it wears, named like the case.
pub(super) fn picture(
    folder: &Path,
    who: (&Avatar, &[DVec3]),
    (outfit, x): (&Outfit, &[DVec3]),
    name: &str,
) -> Result<(), Failure> {
    let scene = look::scene(who, outfit, x, Backdrop::default());
    let front = look::front(&look::stage(&scene));
    let mut output = Output::open(folder).map_err(|e| file_failure(&e))?;
    let file = format!("{}.png", name.replace([',', ' ', ':', '+'], "-"));
    output
        .add(&file, &png(&front))
        .map_err(|e| file_failure(&e))?;
    output.commit().map_err(|e| file_failure(&e))?;
    Ok(())
}

/// `work(k)` for `0..n`, each on a thread of its own that no other work enters.
fn in_turns(n: usize, work: impl Fn(usize) + Sync) {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
                let pool = pool.expect("one more thread can be had");
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= n {
                        return;
                    }
                    pool.install(|| work(k));
                }
            });
        }
    });
}

/// The whole job on the built-in photo, one garment; then the drapes, if there is data.
pub fn dress(data: Option<&Path>) -> Result<String, Failure> {
    let out = std::env::temp_dir().join(format!("muslin-bench-{}", std::process::id()));
    let options = DressOptions {
        outfit: vec![Wear::parse("tee")],
        allow_crossings: true,
        ..Default::default()
    };
    let mut fault = None;
    let time = least_of(10, || {
        let job = crate::dress::demo(&out, &options, &mut Watch::nobody());
        fault = fault.take().or(job.err());
    });
    let memory = peak_memory().map_or("unknown".to_owned(), |m| format!("{m:.0} MiB"));
    let mut table = Table::new(&["what", "least of 10 runs"]);
    table.row(["photo to files, tee", &time.text()]);
    table.row(["peak memory", &memory]);
    let each = data.map(|d| each_photo(d, &out)).transpose();
    let _ = std::fs::remove_dir_all(&out);
    match fault {
        Some(fault) => Err(fault),
        None => Ok(format!(
            "{}\n{}\n{}",
            table.text(),
            each?.unwrap_or_default(),
            load()
        )),
    }
}

/// The default outfit on every photo, once.
fn each_photo(data: &Path, out: &Path) -> Result<String, Failure> {
    let mut table = Table::new(&["photo", "seconds", "result"]);
    for path in crowd::photos(data)? {
        let since = Instant::now();
        let job = whole_job(&path, out, &DressOptions::default(), &mut Watch::nobody());
        let seconds = format!("{:.2}", since.elapsed().as_secs_f64());
        let result = job.map_or_else(|e| e.to_string().replace('\n', " "), |_| "ok".to_owned());
        let name = path
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        table.row([name, seconds, result]);
    }
    Ok(table.text())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scattered_order_visits_all() {
        for n in [1, 2, 4, 25, 400] {
            let mut seen: Vec<usize> = (0..n).map(|k| scattered(k, n)).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..n).collect::<Vec<_>>());
        }
    }
}
