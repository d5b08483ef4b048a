//! How a job fails: what was wrong, where, and what to do.

use std::fmt;

use muslin_geom::Report;
use muslin_io::{plain, report_json};

/// The class of a failure; its number is the exit code of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The command was not understood.
    Usage = 2,
    /// The input is not what it should be.
    Invalid = 3,
    /// The input is beyond a limit or not allowed.
    Refused = 4,
    /// A file cannot be read or written.
    Files = 5,
    /// Numbers failed: not finite, or no convergence.
    Numbers = 6,
    /// The result is below its quality gate.
    Quality = 7,
    /// Another job is writing the same files.
    Busy = 8,
    /// A fault in Muslin itself.
    Internal = 70,
    /// Stopped by the user.
    Interrupted = 130,
    /// Stopped by the system.
    Terminated = 143,
}

/// A job that could not be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// What kind of failure this is.
    pub exit: Exit,
    /// A short stable name, such as `nobody-found`.
    pub code: &'static str,
    /// The file, argument or place within it; may be empty.
    pub place: String,
    /// What is wrong, with what was found and what is allowed.
    pub what: String,
    /// What to do about it; may be empty.
    pub hint: String,
}

impl Failure {
    /// A failure without a hint.
    pub fn new(exit: Exit, code: &'static str, what: impl Into<String>) -> Self {
        Self {
            exit,
            code,
            place: String::new(),
            what: what.into(),
            hint: String::new(),
        }
    }

    /// Whether somebody asked to stop.
    pub fn is_stop(&self) -> bool {
        matches!(self.exit, Exit::Interrupted | Exit::Terminated)
    }

    /// The same for programs: an object called `error`.
    pub fn json(&self) -> String {
        let mut told = Report::default();
        told.set("code", self.code)
            .set("exit", self.exit as usize)
            .set("place", self.place.as_str())
            .set("what", self.what.as_str())
            .set("hint", self.hint.as_str());
        let mut whole = Report::default();
        whole.set("error", told);
        report_json(&whole)
    }

    /// Names the file, argument or place.
    pub fn at(mut self, place: impl Into<String>) -> Self {
        self.place = place.into();
        self
    }

    /// Says what to do.
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = hint.into();
        self
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error[{}]: ", self.code)?;
        if !self.place.is_empty() {
            write!(f, "{}: ", plain(&self.place))?;
        }
        write!(f, "{}", plain(&self.what))?;
        if !self.hint.is_empty() {
            write!(f, "\nhint: {}", plain(&self.hint))?;
        }
        Ok(())
    }
}

impl std::error::Error for Failure {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_reads_as_place_fault_and_hint() {
        let f = Failure::new(Exit::Invalid, "nobody-found", "no person in the picture")
            .at("a\u{1b}b.jpg")
            .hint("show the whole body");
        let text = "error[nobody-found]: a\\u{1b}b.jpg: no person in the picture\nhint: show the whole body";
        assert_eq!(f.to_string(), text);
        let json = f.json();
        assert!(json.contains("\"exit\": 3") && json.contains("\"code\": \"nobody-found\""));
    }
}
