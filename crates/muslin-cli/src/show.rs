//! Runs a verb and shows how it goes: progress and errors to stderr, results to stdout.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use muslin::{Exit, Failure, Outcome, Watch};

use crate::args::{
    Animate, Bench, BenchKind, Common, Evaluate, Kind, Simulate, Telling, Train, Verb,
};

/// Does what the verb says.
pub fn run(verb: &Verb) -> Result<(), Failure> {
    match verb {
        Verb::Dress(d) => match (&d.photo, &d.pose) {
            (Some(photo), _) => job(&d.common, |out, options, watch| {
                muslin::dress(photo, out, options, watch)
            }),
            (None, pose) => job(&d.common, |out, options, watch| {
                muslin::dress_pose(pose.as_deref().unwrap_or("stand"), out, options, watch)
            }),
        },
        Verb::Demo(d) => job(&d.common, muslin::demo),
        Verb::Simulate(s) => simulate(s),
        Verb::Train(t) => train(t),
        Verb::Animate(a) => animate(a),
        Verb::List { what, json } => list(*what, *json),
        Verb::Check(c) => watched(&c.telling, |watch| {
            muslin::check(&c.files, &c.options(), watch)
        }),
        Verb::Evaluate(e) => evaluate(e),
        Verb::Bench(b) => bench(b),
    }
}

type Options = muslin::DressOptions;

fn job(
    common: &Common,
    dress: impl FnOnce(&Path, &Options, &mut Watch) -> Result<Outcome, Failure>,
) -> Result<(), Failure> {
    watched(&common.telling, |watch| {
        dress(&common.out, &common.options(), watch)
    })
}

fn simulate(s: &Simulate) -> Result<(), Failure> {
    watched(&s.telling, |watch| match s.motion.as_slice() {
        [one] if !Path::new(one).is_dir() => muslin::simulate(&s.out, &s.options(), watch),
        all => muslin::simulate_several(all, &s.out, &s.options(), watch),
    })
}

fn animate(a: &Animate) -> Result<(), Failure> {
    watched(&a.telling, |watch| {
        muslin::animate(&a.out, &a.options(), watch)
    })
}

fn train(t: &Train) -> Result<(), Failure> {
    watched(&t.telling, |watch| {
        muslin::train(&t.out, &t.options(), watch)
    })
}

/// Does a job, tells how it goes, and prints what came out.
fn watched(
    telling: &Telling,
    job: impl FnOnce(&mut Watch) -> Result<Outcome, Failure>,
) -> Result<(), Failure> {
    let outcome = shown(telling.quiet, job);
    if let (Err(failure), true) = (&outcome, telling.json) {
        print(&failure.json())?;
    }
    let outcome = outcome?;
    print(if telling.json {
        &outcome.json
    } else {
        &outcome.table
    })?;
    outcome.fault.map_or(Ok(()), Err)
}

/// Does a job and tells how it goes.
fn shown<T>(quiet: bool, job: impl FnOnce(&mut Watch) -> Result<T, Failure>) -> Result<T, Failure> {
    let flag = stop_flag()?;
    let line = Mutex::new(LiveLine::new());
    let line = || line.lock().expect("nobody panics while telling");
    let stage = |s: &muslin::Stage| {
        if !quiet {
            let head = format!("[{}/{}] {:<7} {}", s.number, s.of, s.name, s.result);
            line().print(&format!("  {head:<68} {:>6.2} s", s.seconds));
        }
    };
    let follow = |text: &str| {
        if !quiet {
            line().update(text);
        }
    };
    let warn = |w: &str| line().print(&format!("warning: {w}"));
    let mut watch = Watch::new(stage, warn).following(follow).stopping_at(&flag);
    let result = job(&mut watch);
    drop(watch);
    line().clear();
    result
}

/// The last line of a terminal, which changes in place; elsewhere a line every five seconds.
struct LiveLine {
    is_terminal: bool,
    told: Instant,
    is_shown: bool,
}

/// How often the line changes: on a terminal, and elsewhere.
const EVERY: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(5)];

impl LiveLine {
    fn new() -> Self {
        Self {
            is_terminal: std::io::stderr().is_terminal(),
            told: Instant::now(),
            is_shown: false,
        }
    }

    fn update(&mut self, text: &str) {
        if self.told.elapsed() < EVERY[usize::from(!self.is_terminal)] {
            return;
        }
        self.told = Instant::now();
        match self.is_terminal {
            true => tell(&format!("\r        {text}\x1b[K")),
            false => tell(&format!("        {text}\n")),
        }
        self.is_shown = self.is_terminal;
    }

    fn clear(&mut self) {
        if std::mem::take(&mut self.is_shown) {
            tell("\r\x1b[K");
        }
    }

    fn print(&mut self, text: &str) {
        self.clear();
        tell(&format!("{text}\n"));
    }
}

fn list(what: Kind, json: bool) -> Result<(), Failure> {
    let table = match what {
        Kind::Garments => muslin::list::garments(),
        Kind::Fabrics => muslin::list::fabrics(),
        Kind::Poses => muslin::list::poses(),
        Kind::Motions => muslin::list::motions(),
    };
    print(&if json { table.json() } else { table.text() })
}

fn evaluate(e: &Evaluate) -> Result<(), Failure> {
    let options = e.options();
    watched(&e.telling, |watch| {
        muslin::evaluate_file(&e.file, &options, watch)
    })
}

fn bench(bench: &Bench) -> Result<(), Failure> {
    bench.check()?;
    let data = bench.data.as_deref();
    let report = match bench.what {
        BenchKind::Body => muslin::bench::body(),
        BenchKind::Pose => muslin::bench::pose(data),
        BenchKind::Fit => muslin::bench::fit(data),
        BenchKind::Drape => muslin::bench::drape(data, &drapes(bench)),
        BenchKind::Dress => muslin::bench::dress(data),
        BenchKind::Garments => {
            let job = |watch: &mut Watch| muslin::bench::garments(data, &bench.trials(), watch);
            shown(false, job)
        }
        BenchKind::Cloth => match &bench.peers {
            Some(home) if bench.only.is_empty() => {
                let scene = home.join("scene");
                let out = bench.out.as_deref().unwrap_or(&scene);
                muslin::bench::peers(home, (bench.times(), out))
            }
            _ => shown(false, |watch| muslin::bench::cloth(&bench.walks(), watch)),
        },
    }?;
    print(&report)
}

fn drapes(bench: &Bench) -> muslin::bench::Drapes {
    muslin::bench::Drapes {
        cases: bench.cases.unwrap_or(20),
        only: bench.only.clone(),
        pictures: bench.pictures.clone(),
    }
}

/// Writes to standard error. Where nobody reads it any more, the job goes on.
fn tell(text: &str) {
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// Writes to standard output; a reader that has gone away is no failure.
fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::Files, "stdout", e.to_string()).at("standard output"))
        }
        _ => Ok(()),
    }
}

/// A second signal so soon after the first is the same one, told twice: to a program and to its group [s].
const TWICE: Duration = Duration::from_millis(500);

/// A flag that holds the number of the signal that asked to stop; a second one stops at once.
fn stop_flag() -> Result<Arc<AtomicUsize>, Failure> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let flag = Arc::new(AtomicUsize::new(0));
    let signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]);
    let mut signals =
        signals.map_err(|e| Failure::new(Exit::Internal, "signals", e.to_string()))?;
    let told = Arc::clone(&flag);
    std::thread::spawn(move || {
        let mut first: Option<Instant> = None;
        for signal in signals.forever() {
            match first {
                Some(since) if since.elapsed() > TWICE => std::process::exit(128 + signal),
                Some(_) => {}
                None => {
                    first = Some(Instant::now());
                    told.store(usize::try_from(signal).unwrap_or(1), Ordering::SeqCst);
                }
            }
        }
    });
    Ok(flag)
}

/// Prints a failure and gives its exit code.
pub fn exit(result: Result<(), Failure>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            tell(&format!("{failure}\n"));
            ExitCode::from(failure.exit as u8)
        }
    }
}

/// A panic is a fault of ours: leave a report and exit with 70.
pub fn guard_against_panics() {
    std::panic::set_hook(Box::new(|info| {
        let name = format!("muslin-crash-{}.txt", std::process::id());
        let path = std::env::temp_dir().join(name);
        let version = env!("CARGO_PKG_VERSION");
        let trace = std::backtrace::Backtrace::force_capture();
        let report = format!("muslin {version}\n{info}\n{trace}\n");
        let kept = std::fs::write(&path, report).is_ok();
        tell(&format!(
            "error[internal]: a fault in Muslin itself: {info}\n"
        ));
        if kept {
            tell(&format!(
                "hint: please report it with the file {}\n",
                path.display()
            ));
        }
        std::process::exit(Exit::Internal as i32);
    }));
}
