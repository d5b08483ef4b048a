//! What a job says about its own result: a tree of named values.

/// A value in a [`Report`].
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number; its unit belongs in the name. Not-a-number is written as null.
    Number(f64),
    /// Words.
    Text(String),
    /// Yes or no.
    Flag(bool),
    /// Several values.
    List(Vec<Value>),
    /// Named values.
    Tree(Report),
}

/// Named values in the order they were set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    entries: Vec<(String, Value)>,
}

impl Report {
    /// Sets `name`, replacing what stood there.
    pub fn set(&mut self, name: &str, value: impl Into<Value>) -> &mut Self {
        let value = value.into();
        match self.entries.iter_mut().find(|(n, _)| n == name) {
            Some(entry) => entry.1 = value,
            None => self.entries.push((name.to_owned(), value)),
        }
        self
    }

    /// The value called `name`.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.entries.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }

    /// Names and values in order.
    pub fn entries(&self) -> &[(String, Value)] {
        &self.entries
    }
}

macro_rules! into_value {
    ($($from:ty => |$x:ident| $to:expr),* $(,)?) => {
        $(impl From<$from> for Value { fn from($x: $from) -> Self { $to } })*
    };
}

into_value! {
    f64 => |x| Value::Number(x),
    usize => |x| Value::Number(x as f64),
    u32 => |x| Value::Number(f64::from(x)),
    &str => |x| Value::Text(x.to_owned()),
    String => |x| Value::Text(x),
    bool => |x| Value::Flag(x),
    Report => |x| Value::Tree(x),
    Vec<Value> => |x| Value::List(x),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setting_twice_keeps_the_place_and_the_last_value() {
        let mut r = Report::default();
        r.set("a", 1.0).set("b", "x").set("a", 2.0);
        assert_eq!(r.entries()[0], ("a".into(), Value::Number(2.0)));
        assert_eq!(r.entries().len(), 2);
    }
}
