//! What went wrong with a file, told so that a stranger can mend it.
//!
//! Every error names the file, the place in it, what is wrong and what to do. The variant
//! decides the exit code of a command.

use std::fmt;
use std::io;
use std::path::Path;

/// Longest piece of a stranger's text that a message repeats [characters].
const QUOTE: usize = 80;

/// A file that could not be read or written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IoError {
    /// The contents break their format or miss what the job needs: exit code 3.
    #[error("{0}")]
    Invalid(Box<Fault>),
    /// The contents may be fine but exceed a limit or are of a kind not taken: exit code 4.
    #[error("{0}")]
    Refused(Box<Fault>),
    /// The system could not read or write: exit code 5.
    #[error("{0}")]
    Disk(Box<Fault>),
    /// Another job writes there: exit code 8.
    #[error("{0}")]
    Busy(Box<Fault>),
}

impl IoError {
    /// All that is known about the fault.
    pub fn fault(&self) -> &Fault {
        match self {
            Self::Invalid(f) | Self::Refused(f) | Self::Disk(f) | Self::Busy(f) => f,
        }
    }

    /// The same fault, told of `file`.
    pub(crate) fn of(self, file: &Path) -> Self {
        let named = |f: Box<Fault>| {
            Box::new(Fault {
                file: name(file),
                ..*f
            })
        };
        match self {
            Self::Invalid(f) => Self::Invalid(named(f)),
            Self::Refused(f) => Self::Refused(named(f)),
            Self::Disk(f) => Self::Disk(named(f)),
            Self::Busy(f) => Self::Busy(named(f)),
        }
    }

    /// The exit code a command ends with: 3, 4, 5 or 8.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Invalid(_) => 3,
            Self::Refused(_) => 4,
            Self::Disk(_) => 5,
            Self::Busy(_) => 8,
        }
    }

    /// The stable short name of the fault, such as `photo-cut`.
    pub fn code(&self) -> &'static str {
        self.fault().code
    }

    /// What to do about it; may be empty.
    pub fn hint(&self) -> &str {
        &self.fault().hint
    }

    /// The lines a command prints: `error[CODE]: FILE: what`, then `hint: what to do`.
    pub fn message(&self) -> String {
        let mut text = format!("error[{}]: {self}", self.code());
        if !self.hint().is_empty() {
            text += "\nhint: ";
            text += self.hint();
        }
        text
    }
}

/// Where in a file the fault stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    #[default]
    Whole,
    /// Byte offset from the start.
    Byte(u64),
    /// Line, counted from one.
    Line(usize),
    /// Line and column, counted from one.
    Column(usize, usize),
    /// JSON pointer, such as `/meshes/0`.
    Pointer(String),
}

/// A fault in a file, field by field.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fault {
    /// Stable short name, lower case with dashes.
    pub code: &'static str,
    /// The file as the user named it, or words for what is built in.
    pub file: String,
    /// Where in the file.
    pub place: Place,
    /// What is wrong.
    pub what: String,
    /// What stands there; empty if that says nothing.
    pub found: String,
    /// What could stand there; empty if that says nothing.
    pub allowed: String,
    /// What to do; empty if nobody knows.
    pub hint: String,
}

impl Fault {
    /// A fault in `file`; add the rest with the methods below and end with an exit class.
    pub fn new(code: &'static str, file: impl Into<String>, what: impl Into<String>) -> Self {
        Self {
            code,
            file: file.into(),
            what: what.into(),
            ..Self::default()
        }
    }

    /// Sets the place.
    pub fn at(mut self, place: Place) -> Self {
        self.place = place;
        self
    }

    /// Sets what was found.
    pub fn found(mut self, found: impl fmt::Display) -> Self {
        self.found = found.to_string();
        self
    }

    /// Sets what is allowed.
    pub fn allowed(mut self, allowed: impl fmt::Display) -> Self {
        self.allowed = allowed.to_string();
        self
    }

    /// Sets the hint.
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = hint.into();
        self
    }

    /// The contents are wrong: exit code 3.
    pub fn invalid(self) -> IoError {
        IoError::Invalid(Box::new(self))
    }

    /// A limit or policy says no: exit code 4.
    pub fn refused(self) -> IoError {
        IoError::Refused(Box::new(self))
    }

    /// The system says no: exit code 5.
    pub fn disk(self) -> IoError {
        IoError::Disk(Box::new(self))
    }

    /// Another job is at it: exit code 8.
    pub fn busy(self) -> IoError {
        IoError::Busy(Box::new(self))
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = quote(&self.file);
        match &self.place {
            Place::Whole => write!(f, "{file}")?,
            Place::Byte(n) => write!(f, "{file} @ byte {n}")?,
            Place::Line(l) => write!(f, "{file}:{l}")?,
            Place::Column(l, c) => write!(f, "{file}:{l}:{c}")?,
            Place::Pointer(p) => write!(f, "{file}#{}", quote(p))?,
        }
        write!(f, ": {}", quote(&self.what))?;
        match (self.found.is_empty(), self.allowed.is_empty()) {
            (true, true) => Ok(()),
            (false, true) => write!(f, " (found {})", quote(&self.found)),
            (true, false) => write!(f, " (allowed {})", quote(&self.allowed)),
            (false, false) => {
                write!(
                    f,
                    " (found {}, allowed {})",
                    quote(&self.found),
                    quote(&self.allowed)
                )
            }
        }
    }
}

/// `text` fit for a terminal: control characters escaped, long text cut in the middle.
pub fn quote(text: &str) -> String {
    let safe: Vec<char> = text.chars().flat_map(visible).collect();
    if safe.len() <= 2 * QUOTE {
        return safe.into_iter().collect();
    }
    let head: String = safe[..QUOTE].iter().collect();
    let tail: String = safe[safe.len() - QUOTE..].iter().collect();
    format!("{head}…{tail}")
}

/// `text` fit for a terminal, as long as it is and in its lines.
pub fn plain(text: &str) -> String {
    let kept = |c: char| match c {
        '\n' => vec![c],
        _ => visible(c),
    };
    text.chars().flat_map(kept).collect()
}

/// A path as messages name it.
pub fn name(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// The system's refusal to read `file`.
pub(crate) fn unreadable(file: &str, err: &io::Error) -> IoError {
    let (what, hint) = match err.kind() {
        io::ErrorKind::NotFound => ("no such file", "check the spelling and the folder"),
        io::ErrorKind::PermissionDenied => (
            "you may not read this file",
            "ask its owner, or copy it to where you may",
        ),
        _ => ("cannot be read", ""),
    };
    let fault = Fault::new("cannot-read", file, what).hint(hint);
    match err.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied => fault.disk(),
        _ => fault.found(err).disk(),
    }
}

/// A character, or its escape if a terminal would act on it or hide it.
fn visible(c: char) -> Vec<char> {
    let reorders = matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}');
    if c.is_control() || reorders {
        c.escape_unicode().collect()
    } else {
        vec![c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_file_place_found_allowed_and_hint() {
        let err = Fault::new("photo-large", "a.png", "too many pixels")
            .at(Place::Byte(16))
            .found("50 MPixel")
            .allowed("40 MPixel")
            .hint("scale it down")
            .refused();
        let want = "error[photo-large]: a.png @ byte 16: too many pixels \
                    (found 50 MPixel, allowed 40 MPixel)\nhint: scale it down";
        assert_eq!(err.message(), want);
        assert_eq!(err.exit_code(), 4);
    }

    #[test]
    fn a_strangers_text_cannot_drive_the_terminal() {
        let err = Fault::new("x", "\u{1b}[2Ja\n.png", "y".repeat(500)).invalid();
        let text = err.to_string();
        assert!(!text.contains('\u{1b}') && !text.contains('\n'), "{text}");
        assert!(text.chars().count() < 240, "{text}");
        assert!(quote("a\u{202e}b").starts_with("a\\u{202e}"));
    }
}
