//! Several motions: one on each core, each with files of its own.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use muslin_body::Part;

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of, standing};
use crate::outcome::Outcome;
use crate::outfit::Outfit;
use crate::watch::Watch;

use super::motion::{self, KINDS};
use super::set::Memory;
use super::{SimulateOptions, simulate};

/// One of several simulations.
struct Job {
    name: String,
    out: PathBuf,
    options: SimulateOptions,
}

/// Simulates every motion of `motions` (names, files, folders of files), as many side by side as
/// there are cores, and writes `NAME.glb` each into the folder `out`.
///
/// `npz` and `pc2` of the options are folders too: `NAME.npz`, and `NAME/` for point caches. A
/// simulation that fails does not keep the others from being done; the answer is then the first
/// failure, which tells how many there are. The bits do not depend on the number of cores.
pub fn simulate_several(
    motions: &[String],
    out: &Path,
    options: &SimulateOptions,
    watch: &mut Watch,
) -> Result<Outcome, Failure> {
    let jobs = jobs(&expanded(motions)?, out, options)?;
    // What is wrong with all of them is told once, before the work.
    jobs.iter().try_for_each(|j| j.options.check(&j.out))?;
    let side = jobs.len().clamp(1, rayon::current_num_threads());
    let memory = needed(&jobs, side)?;
    let told = format!(
        "{} motions, {side} at a time: {}",
        jobs.len(),
        memory.text()
    );
    memory.scarce().iter().for_each(|w| watch.warn(w));
    watch.done((1, 1), "memory", told)?;
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let whole = Mutex::new(watch);
    let work = || {
        loop {
            let k = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(k) else { break };
            let mut watch = Watch::side(&whole, &job.name);
            let result = simulate(&job.out, &job.options, &mut watch);
            let mut done = done.lock().expect("nobody panics while adding");
            done.push((k, result));
        }
    };
    on_all_cores(jobs.len(), &work)?;
    let mut done = done.into_inner().expect("nobody panics while adding");
    done.sort_by_key(|d| d.0);
    summary(&jobs, done.into_iter().map(|d| d.1).collect())
}

/// What the jobs take in memory at their most, `side` by side. A motion that cannot be read takes none: its job says
/// what is wrong with it.
fn needed(jobs: &[Job], side: usize) -> Result<Memory, Failure> {
    let Some(options) = jobs.first().map(|j| &j.options) else {
        return Ok(Memory::at_once(Vec::new(), side));
    };
    let hero = Hero::load(&options.dress)?;
    let avatar = avatar_of(hero.as_ref())?;
    let who = (&avatar, hero.as_ref());
    let figure = standing(&avatar, who.1, &options.dress)?.figure;
    let outfit = Outfit::make_for(who, &options.dress, |_| {})?;
    let cloth = outfit.pieces.iter().map(|p| p.garment.n_verts()).sum();
    let verts = [cloth, avatar.part(Part::Body).len()];
    let one = |j: &Job| motion::frames(who, &figure, &j.options).ok();
    let each = jobs.iter().filter_map(one).map(|n| Memory::of(n, verts));
    Ok(Memory::at_once(each.collect(), side))
}

/// Runs `work` once for each of `n` jobs, at most once a core; the cores are shared out evenly.
fn on_all_cores(n: usize, work: &(dyn Fn() + Sync)) -> Result<(), Failure> {
    let cores = rayon::current_num_threads();
    let side = n.clamp(1, cores);
    let pool = |_| {
        let threads = rayon::ThreadPoolBuilder::new().num_threads(cores / side);
        let fault = |e: rayon::ThreadPoolBuildError| e.to_string();
        let built = threads.build().map_err(fault);
        built.map_err(|e| Failure::new(Exit::Internal, "threads", e))
    };
    let pools: Vec<rayon::ThreadPool> = (0..side).map(pool).collect::<Result<_, _>>()?;
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| pool.install(work));
        }
    });
    Ok(())
}

/// Folders replaced by the files in them.
pub(crate) fn expanded(motions: &[String]) -> Result<Vec<String>, Failure> {
    let mut out = Vec::new();
    for motion in motions {
        if !Path::new(motion).is_dir() {
            out.push(motion.clone());
            continue;
        }
        let files = muslin_io::files_in(Path::new(motion), &KINDS);
        let files = files.map_err(|e| file_failure(&e))?;
        if files.is_empty() {
            let fault = Failure::new(
                Exit::Invalid,
                "no-motions",
                "no .bvh, .npz or .vrma in this folder",
            );
            return Err(fault.at(motion.clone()));
        }
        out.extend(files.iter().map(|f| f.to_string_lossy().into_owned()));
    }
    Ok(out)
}

fn jobs(motions: &[String], out: &Path, options: &SimulateOptions) -> Result<Vec<Job>, Failure> {
    if out
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("glb"))
    {
        let what = format!(
            "{} is one file, and there are several motions",
            out.display()
        );
        let fault = Failure::new(Exit::Usage, "file-kind", what).at("--out");
        return Err(fault.hint("name a folder; each motion gets a file in it"));
    }
    let job = |motion: &String| {
        let (file, part) = motion::named(motion);
        let stem = muslin_io::name(Path::new(file.file_stem().unwrap_or_default()));
        let stem = muslin_io::as_name(&stem);
        let name = match part {
            Some(part) => format!(
                "{stem}-{}",
                part.replace(|c: char| !c.is_alphanumeric(), "-")
            ),
            None => stem,
        };
        let own = |folder: &Option<PathBuf>, file: String| folder.as_ref().map(|f| f.join(file));
        let options = SimulateOptions {
            motion: motion.clone(),
            npz: own(&options.npz, format!("{name}.npz")),
            pc2: own(&options.pc2, name.clone()),
            ..options.clone()
        };
        let out = out.join(format!("{name}.glb"));
        Job { name, out, options }
    };
    let jobs: Vec<Job> = motions.iter().map(job).collect();
    let mut names = BTreeSet::new();
    match jobs.iter().find(|j| !names.insert(&j.name)) {
        None => Ok(jobs),
        Some(twice) => {
            let what = format!("two motions are called {:?}", twice.name);
            let fault = Failure::new(Exit::Usage, "same-name", what).at("--motion");
            Err(fault.hint("rename a file: results are named after motions"))
        }
    }
}

/// All outcomes together, and what failed: a stop before anything else.
fn summary(jobs: &[Job], results: Vec<Result<Outcome, Failure>>) -> Result<Outcome, Failure> {
    let n = results.len();
    let (mut outcomes, mut failures) = (Vec::new(), Vec::new());
    for (job, result) in jobs.iter().zip(results) {
        match result {
            Ok(outcome) => outcomes.push(outcome),
            Err(failure) => failures.push((job, failure)),
        }
    }
    let Some((_, first)) = failures.first() else {
        return Ok(Outcome::all(outcomes));
    };
    let told = failures.iter().take(8);
    let told = told.map(|(job, f)| format!("\n  {}: {}: {}", job.name, f.code, f.what));
    let what = format!(
        "{} of {n} failed:{}",
        failures.len(),
        told.collect::<String>()
    );
    let stop = failures.iter().map(|f| &f.1).find(|f| f.is_stop());
    let fault = stop.cloned().unwrap_or(Failure {
        what,
        place: String::new(),
        ..first.clone()
    });
    Outcome::with_fault(outcomes, fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(motions: &[&str], out: &str) -> Result<Vec<Job>, Failure> {
        let motions: Vec<String> = motions.iter().map(|m| (*m).to_owned()).collect();
        let options = SimulateOptions {
            npz: Some("arrays".into()),
            ..SimulateOptions::default()
        };
        jobs(&motions, Path::new(out), &options)
    }

    #[test]
    fn each_motion_gets_files_of_its_own() {
        let jobs = named(&["walk", "takes/a.b.bvh"], "out").expect("two names");
        assert_eq!(jobs[1].out, Path::new("out/a.b.glb"));
        assert_eq!(
            jobs[1].options.npz.as_deref(),
            Some(Path::new("arrays/a.b.npz"))
        );
        assert!(jobs.iter().all(|j| j.options.check(&j.out).is_ok()));
    }

    #[test]
    fn what_runs_side_by_side_adds_up() {
        let all: Vec<Memory> = [10, 300, 20].map(|n| Memory::of(n, [1000, 10_000])).into();
        let most = Memory::at_once(all.clone(), 2);
        assert_eq!(most.all, all[1].all + all[2].all);
        assert_eq!(most.frames, 320 * 11_000 * 60);
        assert_eq!(
            Memory::at_once(all.clone(), 8).all,
            all.iter().map(|m| m.all).sum::<usize>()
        );
    }

    #[test]
    fn one_file_for_several_and_one_name_for_two_are_refused() {
        let code = |r: Result<Vec<Job>, Failure>| r.err().map(|f| f.code);
        assert_eq!(code(named(&["walk", "run"], "a.glb")), Some("file-kind"));
        assert_eq!(
            code(named(&["a/x.bvh", "b/x.npz"], "out")),
            Some("same-name")
        );
    }

    #[test]
    fn what_failed_is_counted_and_a_stop_comes_first_and_the_rest_is_done() {
        let jobs = named(&["walk", "run"], "out").expect("two names");
        let fine = || {
            Ok(Outcome {
                table: "t".into(),
                json: "{}".into(),
                fault: None,
            })
        };
        let bad = || {
            Err(Failure::new(
                Exit::Quality,
                "cloth-in-body",
                "cloth meets the body",
            ))
        };
        assert!(summary(&jobs, vec![fine(), fine()]).is_ok());
        let stop = || Err(Failure::new(Exit::Interrupted, "stopped", "stopped"));
        let one = summary(&jobs, vec![fine(), bad()]).expect("the other is done");
        assert_eq!((one.table.as_str(), one.json.as_str()), ("t", "[\n{}\n]\n"));
        let fault = one.fault.expect("one failed");
        assert_eq!(fault.exit, Exit::Quality);
        let stopped = summary(&jobs, vec![bad(), stop()]).expect_err("neither is done");
        assert_eq!(stopped.exit, Exit::Interrupted);
        assert!(
            fault
                .what
                .starts_with("1 of 2 failed:\n  run: cloth-in-body"),
            "{fault}"
        );
    }
}
