//! The flat part of TOML: `key = value`, one a line.

use muslin_body::names;

use crate::error::{Fault, IoError, Place, quote};

/// A value as it was written.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Text(String),
    Number(f64),
}

/// The lines of a flat file.
pub(super) struct Flat<'a> {
    file: &'a str,
    entries: Vec<(String, Value, usize)>,
}

impl<'a> Flat<'a> {
    /// Reads `text`, whose keys must be among `keys` and stand there once.
    pub(super) fn read(file: &'a str, text: &str, keys: &[&str]) -> Result<Self, IoError> {
        let mut entries: Vec<(String, Value, usize)> = Vec::new();
        for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let (at, line) = (i + 1, line.trim());
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let wrong = |what: &str| fault(file, at, what).found(quote(line)).invalid();
            let Some((key, rest)) = line.split_once('=').filter(|_| !line.starts_with('[')) else {
                return Err(wrong("a fabric file has one `key = value` a line"));
            };
            let key = key.trim().to_owned();
            if !keys.contains(&key.as_str()) {
                let near = names::nearest(&key, keys.iter().copied());
                let near: Vec<String> = near.into_iter().take(3).collect();
                let fault = fault(file, at, "no fabric has this key").found(quote(&key));
                return Err(fault.allowed(near.join(", ")).invalid());
            }
            if entries.iter().any(|e| e.0 == key) {
                return Err(wrong("this key was given before"));
            }
            let value = value(rest.trim()).map_err(wrong)?;
            entries.push((key, value, at));
        }
        Ok(Self { file, entries })
    }

    fn find(&self, key: &str) -> Option<&(String, Value, usize)> {
        self.entries.iter().find(|e| e.0 == key)
    }

    /// A text and its line, if the key is given.
    pub(super) fn text(&self, key: &str) -> Result<Option<(String, usize)>, IoError> {
        match self.find(key) {
            None => Ok(None),
            Some((_, Value::Text(t), line)) => Ok(Some((t.clone(), *line))),
            Some((_, _, line)) => {
                Err(fault(self.file, *line, "this must be text in quotes").invalid())
            }
        }
    }

    /// A finite number, if the key is given.
    pub(super) fn number(&self, key: &str) -> Result<Option<f64>, IoError> {
        match self.find(key) {
            None => Ok(None),
            Some((_, Value::Number(x), _)) => Ok(Some(*x)),
            Some((_, _, line)) => Err(fault(self.file, *line, "this must be a number").invalid()),
        }
    }
}

fn fault(file: &str, line: usize, what: &str) -> Fault {
    Fault::new("fabric-line", file, what).at(Place::Line(line))
}

/// A string or number with nothing but a comment behind it; else what is wrong.
fn value(text: &str) -> Result<Value, &'static str> {
    let (value, rest) = match text.chars().next() {
        Some('"') if !text.starts_with("\"\"\"") => basic(&text[1..])?,
        Some('\'') if !text.starts_with("'''") => {
            let end = text[1..].find('\'').ok_or("a quote is not closed")?;
            (Value::Text(text[1..=end].to_owned()), &text[end + 2..])
        }
        _ => {
            let end = text.find('#').unwrap_or(text.len());
            (Value::Number(number(text[..end].trim())?), &text[end..])
        }
    };
    let rest = rest.trim_start();
    match rest.is_empty() || rest.starts_with('#') {
        true => Ok(value),
        false => Err("something stands behind the value"),
    }
}

/// A string after its opening quote, with the escapes of one letter; and what is behind it.
fn basic(text: &str) -> Result<(Value, &str), &'static str> {
    let (mut out, mut chars) = (String::new(), text.char_indices());
    while let Some((i, c)) = chars.next() {
        match c {
            '"' => return Ok((Value::Text(out), &text[i + 1..])),
            '\\' => out.push(match chars.next() {
                Some((_, c @ ('"' | '\\'))) => c,
                Some((_, 'n')) => '\n',
                Some((_, 't')) => '\t',
                _ => return Err("only \\\", \\\\, \\n and \\t are read after a backslash"),
            }),
            c => out.push(c),
        }
    }
    Err("a quote is not closed")
}

/// A number as TOML writes it; underscores stand between digits.
fn number(text: &str) -> Result<f64, &'static str> {
    const WRONG: &str = "the value must be a number or text in quotes";
    let digit = |b: Option<&u8>| b.is_some_and(u8::is_ascii_digit);
    let bytes = text.as_bytes();
    let split = |i: usize| i > 0 && digit(bytes.get(i - 1)) && digit(bytes.get(i + 1));
    let sound = (0..bytes.len()).all(|i| match bytes[i] {
        b'_' => split(i),
        b => b.is_ascii_digit() || b"+-.eE".contains(&b),
    });
    let parsed = text.replace('_', "").parse::<f64>().ok();
    parsed.filter(|x| sound && x.is_finite()).ok_or(WRONG)
}
