//! Frame after frame, kept on disk every so often so that a stopped job can go on.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use muslin_io::Journal;
use muslin_sim::{Moment, Options, SimError, State, simulate_while};

use crate::anew::{Solved, once_more};
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::watch::Watch;

use super::reel::{Reel, Told};
use super::set::Set;

/// Simulates all frames, from where the file `part` ends if that is asked for; those in which cloth still meets the
/// body are then reached once more.
///
/// Every [`muslin_sim::CHECKPOINT`] frames, sooner where they take long, and at the end, what is new is added to `part`, if there is one.
pub fn shoot(set: &Set, part: Option<(&Path, bool)>, watch: &mut Watch) -> Result<Reel, Failure> {
    let mut take = match part {
        Some((part, true)) => Take::resume(set, part, watch)?,
        Some((part, false)) => {
            Journal::ask(part).map_err(|e| file_failure(&e))?;
            Take::new(set, Some(part))
        }
        None => Take::new(set, None),
    };
    if take.reel.len() < set.moving.frames() {
        film(set, &mut take, watch)?;
    }
    let mut frames: Vec<Solved> = std::mem::take(&mut take.reel).into_frames().collect();
    once_more(set, &mut frames, watch).map_err(|f| take.hint(f))?;
    Ok(frames.into_iter().collect())
}

/// Adds all frames that are not there yet.
fn film(set: &Set, take: &mut Take, watch: &mut Watch) -> Result<(), Failure> {
    let state = take.state.take();
    let (rest, at) = (set.rest(), |k: usize| set.frame(k));
    let walk = set.walk(&rest, &at);
    watch.progress("on the way from the rest pose into the motion");
    let may_go_on = watch.may_go_on();
    let (mut stopped, mut pace) = (Ok(()), Pace::new(take.reel.len()));
    let deliver = |moment: &Moment| {
        stopped = take.frame(moment, pace.lap());
        watch.progress(&pace.text(take.reel.len(), set.moving.frames()));
        match stopped {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    };
    let start = (set.start.as_slice(), state.as_ref());
    let options = Options {
        second_order: set.bdf2,
        air: set.air,
        ..Options::default()
    };
    let how = (&walk, &options, &may_go_on as _);
    let ended = simulate_while(&set.cloth, start, how, deliver);
    stopped?;
    match ended {
        Err(SimError::Stopped) => watch.go_on().map_err(|f| take.hint(f))?,
        Err(e) => return Err(Failure::new(Exit::Numbers, "simulate", e.to_string())),
        Ok(()) => {}
    }
    take.keep(None)
}

/// What there is so far, and its copy on disk.
struct Take<'a> {
    set: &'a Set<'a>,
    part: Option<&'a Path>,
    reel: Reel,
    state: Option<State>,
    /// Frames that are on disk.
    kept: usize,
    journal: Option<Journal>,
}

impl<'a> Take<'a> {
    fn new(set: &'a Set<'a>, part: Option<&'a Path>) -> Self {
        Self {
            set,
            part,
            reel: Reel::default(),
            state: None,
            kept: 0,
            journal: None,
        }
    }

    /// Picks up what an earlier run left.
    fn resume(set: &'a Set<'a>, part: &'a Path, watch: &mut Watch) -> Result<Self, Failure> {
        let mut take = Self::new(set, Some(part));
        let open = Journal::open(part).map_err(|e| file_failure(&e))?;
        let Some(mut journal) = open else {
            watch.warn("nothing to go on from; starting at the first frame");
            return Ok(take);
        };
        let damaged = || {
            let fault = Failure::new(Exit::Invalid, "cannot-resume", "it is damaged");
            let fault = fault.at(part.display().to_string());
            fault.hint("start again without --resume")
        };
        let records = journal.take_records();
        let (head, records) = records.split_first().ok_or_else(damaged)?;
        same_inputs(set, head).map_err(|f| f.at(part.display().to_string()))?;
        for record in records {
            let state = take.reel.read(record, set.n_verts());
            take.state = state.ok_or_else(damaged)?;
        }
        take.kept = take.reel.len();
        let ends = match &take.state {
            Some(state) => state.frame.saturating_sub(set.moving.lead),
            None if records.is_empty() => 0,
            None => set.moving.frames(),
        };
        if take.kept != ends {
            return Err(damaged());
        }
        take.journal = Some(journal);
        Ok(take)
    }

    fn frame(&mut self, moment: &Moment, seconds: f64) -> Result<(), Failure> {
        let told = Told {
            yielded: moment.yielded,
            body_intersections: moment.body_intersections as f64,
            steps: moment.steps as f64,
            seconds,
        };
        self.reel.push(moment.verts, moment.body, told);
        match moment.state {
            Some(state) => self.keep(Some(state)),
            None => Ok(()),
        }
    }

    /// Brings the file on disk up to date.
    fn keep(&mut self, state: Option<&State>) -> Result<(), Failure> {
        let Some(part) = self.part else {
            return Ok(());
        };
        let fault = |e| file_failure(&e);
        let journal = match self.journal.take() {
            Some(journal) => journal,
            None => Journal::create(part, head(self.set).as_bytes()).map_err(fault)?,
        };
        let journal = self.journal.insert(journal);
        let record = self.reel.record(self.kept, state);
        self.kept = self.reel.len();
        journal.append(&record).map_err(fault)
    }

    /// Says how a stopped job goes on.
    fn hint(&self, failure: Failure) -> Failure {
        let Some(part) = self.part.filter(|_| self.kept > 0) else {
            return failure;
        };
        let (kept, of) = (self.kept, self.set.moving.frames());
        Failure {
            what: format!(
                "stopped; {kept} of {of} frames are kept in {}",
                part.display()
            ),
            ..failure
        }
        .hint("the same command with --resume goes on from there")
    }
}

/// One line for each thing that the frames depend on.
pub(super) fn head(set: &Set) -> String {
    let lines = set.identity().into_iter();
    lines
        .map(|(name, hash)| format!("{name} {hash}\n"))
        .collect()
}

fn same_inputs(set: &Set, found: &[u8]) -> Result<(), Failure> {
    let found = String::from_utf8_lossy(found);
    let wanted = set.identity();
    let other = wanted.iter().filter(|(name, hash)| {
        let line = format!("{name} {hash}");
        !found.lines().any(|l| l == line)
    });
    let other: Vec<&str> = other.map(|(name, _)| *name).collect();
    if other.is_empty() {
        return Ok(());
    }
    let what = format!(
        "it was left by a run with another {}",
        other.join(" and another ")
    );
    let fault = Failure::new(Exit::Invalid, "cannot-resume", what);
    Err(fault.hint("give the same options as then, or start again without --resume"))
}

/// How fast it goes.
struct Pace {
    since: Instant,
    lap: Instant,
    first: usize,
}

impl Pace {
    fn new(first: usize) -> Self {
        let now = Instant::now();
        Self {
            since: now,
            lap: now,
            first,
        }
    }

    /// Seconds since the last call. The first lap holds the lead-in, of which nothing is known.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = now.duration_since(self.lap).as_secs_f64();
        self.lap = now;
        seconds
    }

    /// As in `frame 31 of 240, 212 ms a frame, 44 s left`.
    fn text(&mut self, done: usize, of: usize) -> String {
        let here = done - self.first;
        if here <= 1 {
            self.since = self.lap;
            return format!("frame {done} of {of}");
        }
        let each = (self.lap - self.since).as_secs_f64() / (here - 1) as f64;
        let left = each * (of - done) as f64;
        format!(
            "frame {done} of {of}, {:.0} ms a frame, {left:.0} s left",
            each * 1e3
        )
    }
}

#[cfg(test)]
mod tests;
