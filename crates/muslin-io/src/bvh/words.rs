//! The words of a BVH file, and what is wrong with them.

use glam::DVec3;

const MAX_NAME: usize = 64;

/// What is wrong, and on which line.
pub struct Bad {
    pub line: usize,
    pub what: String,
    /// Where it is too much of something: how much is allowed.
    pub allowed: Option<String>,
}

pub fn error(line: usize, what: impl Into<String>) -> Bad {
    Bad {
        line,
        what: what.into(),
        allowed: None,
    }
}

pub fn large(line: usize, what: impl Into<String>, allowed: impl Into<String>) -> Bad {
    Bad {
        allowed: Some(allowed.into()),
        ..error(line, what)
    }
}

/// Words with the line they stand on; braces are words of their own.
pub struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    rest: &'a str,
    /// The line that the last word stands on.
    pub line: usize,
}

impl<'a> Words<'a> {
    pub fn new(text: &'a str) -> Self {
        Words {
            lines: text.lines().enumerate(),
            rest: "",
            line: 1,
        }
    }

    pub fn peek(&mut self) -> Option<&'a str> {
        let gap = |c: char| c.is_whitespace() || c == ',' || c == '\0';
        loop {
            self.rest = self.rest.trim_start_matches(gap);
            if !self.rest.is_empty() {
                break;
            }
            let (number, line) = self.lines.next()?;
            (self.line, self.rest) = (number + 1, line);
        }
        if self.rest.starts_with(['{', '}']) {
            return Some(&self.rest[..1]);
        }
        let end = self
            .rest
            .find(|c| gap(c) || c == '{' || c == '}')
            .unwrap_or(self.rest.len());
        Some(&self.rest[..end])
    }

    pub fn next(&mut self) -> Option<&'a str> {
        let word = self.peek()?;
        self.rest = &self.rest[word.len()..];
        Some(word)
    }

    /// The rest of this line, as a name.
    pub fn name(&mut self) -> &'a str {
        let end = self.rest.find('{').unwrap_or(self.rest.len());
        let (name, rest) = self.rest.split_at(end);
        self.rest = rest;
        name.trim()
    }

    pub fn word(&mut self, wanted: &str) -> Result<&'a str, Bad> {
        let line = self.line;
        self.next()
            .ok_or_else(|| error(line, format!("the file ends where {wanted} should be")))
    }

    pub fn number(&mut self, wanted: &str) -> Result<f64, Bad> {
        let word = self.word(wanted)?;
        parse(word, self.line)
    }

    pub fn vector(&mut self) -> Result<DVec3, Bad> {
        Ok(DVec3::new(
            self.number("x")?,
            self.number("y")?,
            self.number("z")?,
        ))
    }
}

pub fn parse(word: &str, line: usize) -> Result<f64, Bad> {
    let value: f64 = word
        .parse()
        .map_err(|_| error(line, format!("{:?} where a number should be", clean(word))))?;
    if value.is_finite() && value.abs() < 1e12 {
        return Ok(value);
    }
    Err(error(
        line,
        format!("{:?} is no usable number", clean(word)),
    ))
}

/// A name fit for printing: no control characters, 64 characters at most.
pub fn clean(name: &str) -> String {
    name.chars()
        .filter(|c| !c.is_control())
        .take(MAX_NAME)
        .collect()
}
