//! Watching a job: its stages as they finish, and a way to stop it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use muslin_io::plain;

use crate::failure::{Exit, Failure};

/// A finished stage of a job.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Which one, from 1.
    pub number: usize,
    /// How many there are.
    pub of: usize,
    /// Its name, one word.
    pub name: &'static str,
    /// What came out of it.
    pub result: String,
    /// How long it took [s].
    pub seconds: f64,
}

/// Somebody who hears what is said.
type Hears<'a> = Box<dyn FnMut(&str) + Send + 'a>;

/// What a job may call while it works: tells of stages, asks whether to go on.
///
/// What it tells is fit for a terminal: names that came in files are escaped where they would drive it.
pub struct Watch<'a> {
    tell: Box<dyn FnMut(&Stage) + Send + 'a>,
    warn: Hears<'a>,
    progress: Mutex<Hears<'a>>,
    stop: Option<&'a AtomicUsize>,
    since: Instant,
}

impl<'a> Watch<'a> {
    /// Nobody watches.
    pub fn nobody() -> Self {
        Self::new(|_| {}, |_| {})
    }

    /// `tell` hears of each finished stage, `warn` of each warning.
    pub fn new(tell: impl FnMut(&Stage) + Send + 'a, warn: impl FnMut(&str) + Send + 'a) -> Self {
        Self {
            tell: Box::new(tell),
            warn: Box::new(warn),
            progress: Mutex::new(Box::new(|_| {})),
            stop: None,
            since: Instant::now(),
        }
    }

    /// Stops at the next stage once `flag` holds a signal's number (2 interrupt, 15 terminate).
    pub fn stopping_at(mut self, flag: &'a AtomicUsize) -> Self {
        self.stop = Some(flag);
        self
    }

    /// `progress` hears how far a long stage has come, many times a second.
    pub fn following(mut self, progress: impl FnMut(&str) + Send + 'a) -> Self {
        self.progress = Mutex::new(Box::new(progress));
        self
    }

    /// Says how far the stage has come.
    pub fn progress(&mut self, text: &str) {
        let follow = self.progress.get_mut();
        follow.expect("nobody panics while telling")(&plain(text));
    }

    /// A watch that hears nothing, and stops when this one does.
    pub(crate) fn quiet(&self) -> Self {
        Self {
            stop: self.stop,
            ..Self::nobody()
        }
    }

    /// A watch for one of several jobs that run side by side: `whole` hears everything that it is
    /// told, with the job's name before it, and stops it.
    pub(crate) fn side<'b>(whole: &'b Mutex<&mut Watch<'a>>, name: &'b str) -> Watch<'b>
    where
        'a: 'b,
    {
        let lock = || whole.lock().expect("nobody panics while telling");
        let tell = move |s: &Stage| {
            let result = format!("{name}: {}", s.result);
            (lock().tell)(&Stage {
                result,
                ..s.clone()
            });
        };
        let warn = move |w: &str| (lock().warn)(&format!("{name}: {w}"));
        let progress = move |text: &str| lock().progress(&format!("{name}: {text}"));
        Watch {
            stop: lock().stop,
            ..Watch::new(tell, warn).following(progress)
        }
    }

    /// Says something the user should know.
    pub fn warn(&mut self, text: &str) {
        (self.warn)(&plain(text));
    }

    /// Ends stage `number` of `of`; returns the seconds it took, or that the user wants to stop.
    pub fn done(
        &mut self,
        (number, of): (usize, usize),
        name: &'static str,
        result: String,
    ) -> Result<f64, Failure> {
        let seconds = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        (self.tell)(&Stage {
            number,
            of,
            name,
            result: plain(&result),
            seconds,
        });
        self.go_on().map(|()| seconds)
    }

    /// Whether nobody has asked to stop yet, for work on other threads to ask.
    pub fn may_go_on(&self) -> impl Fn() -> bool + Sync + 'a {
        let stop = self.stop;
        move || stop.is_none_or(|f| f.load(Ordering::Relaxed) == 0)
    }

    /// The same for a long stage that asks at each of its steps: so many are told as `what` was done.
    pub fn stepping<'s>(&'s self, what: &'s str) -> impl Fn() -> bool + Sync + 's {
        let (may_go_on, steps) = (self.may_go_on(), AtomicUsize::new(0));
        let follow = &self.progress;
        move || {
            let step = steps.fetch_add(1, Ordering::Relaxed) + 1;
            let mut follow = follow.lock().expect("nobody panics while telling");
            follow(&format!("{what}, step {step}"));
            may_go_on()
        }
    }

    /// An error once the user has asked to stop.
    pub fn go_on(&self) -> Result<(), Failure> {
        match self.stop.map_or(0, |f| f.load(Ordering::Relaxed)) {
            0 => Ok(()),
            15 => Err(Failure::new(
                Exit::Terminated,
                "stopped",
                "stopped; nothing was written",
            )),
            _ => Err(Failure::new(
                Exit::Interrupted,
                "stopped",
                "stopped; nothing was written",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_raised_flag_stops_at_the_next_stage() {
        let flag = AtomicUsize::new(0);
        let mut heard = Vec::new();
        let mut watch = Watch::new(|s| heard.push(s.name), |_| {}).stopping_at(&flag);
        assert!(watch.done((1, 2), "pose", String::new()).is_ok());
        flag.store(2, Ordering::Relaxed);
        let stopped = watch.done((2, 2), "body", String::new()).unwrap_err();
        assert_eq!(stopped.exit, Exit::Interrupted);
        drop(watch);
        assert_eq!(heard, ["pose", "body"]);
    }
}
