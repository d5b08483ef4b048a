//! A place in a JSON document, which knows its way from the root.

use serde_json::Value;

use crate::error::{Fault, IoError, Place};

/// A value and where it stands.
pub struct At<'a> {
    file: &'a str,
    pointer: String,
    value: &'a Value,
}

impl<'a> At<'a> {
    /// The whole document.
    pub fn root(file: &'a str, value: &'a Value) -> At<'a> {
        At {
            file,
            pointer: String::new(),
            value,
        }
    }

    /// A fault at this place.
    pub fn fault(&self, what: &str) -> Fault {
        Fault::new("pattern", self.file, what).at(Place::Pointer(self.pointer.clone()))
    }

    fn is_no(&self, kind: &str) -> IoError {
        let what = format!("{kind} is expected here");
        self.fault(&what).found(self.value).invalid()
    }

    fn within(&self, key: &str, value: &'a Value) -> At<'a> {
        let key = key.replace('~', "~0").replace('/', "~1");
        At {
            file: self.file,
            pointer: format!("{}/{key}", self.pointer),
            value,
        }
    }

    /// What stands under a key, if anything does.
    pub fn get(&self, key: &str) -> Result<Option<At<'a>>, IoError> {
        match self.value {
            Value::Object(map) => Ok(map.get(key).map(|v| self.within(key, v))),
            _ => Err(self.is_no("an object")),
        }
    }

    /// What must stand under a key.
    pub fn need(&self, key: &str) -> Result<At<'a>, IoError> {
        let missing = || self.fault(&format!("{key:?} is missing")).invalid();
        self.get(key)?.ok_or_else(missing)
    }

    /// All keys with what stands under them.
    pub fn entries(&self) -> Result<Vec<(&'a str, At<'a>)>, IoError> {
        match self.value {
            Value::Object(map) => Ok(map
                .iter()
                .map(|(k, v)| (k.as_str(), self.within(k, v)))
                .collect()),
            _ => Err(self.is_no("an object")),
        }
    }

    /// Whether this is a list.
    pub fn is_list(&self) -> bool {
        self.value.is_array()
    }

    /// The items of a list, `most` at the most.
    pub fn items(&self, most: usize) -> Result<Vec<At<'a>>, IoError> {
        let Value::Array(list) = self.value else {
            return Err(self.is_no("a list"));
        };
        if list.len() > most {
            let fault = self.fault("the list is too long").found(list.len());
            return Err(fault.allowed(most).refused());
        }
        let item = |(k, v): (usize, &'a Value)| self.within(&k.to_string(), v);
        Ok(list.iter().enumerate().map(item).collect())
    }

    /// A text.
    pub fn text(&self) -> Result<&'a str, IoError> {
        self.value.as_str().ok_or_else(|| self.is_no("a text"))
    }

    /// A number from `low` to `high`.
    pub fn number_in(&self, low: f64, high: f64) -> Result<f64, IoError> {
        let x = self.value.as_f64().ok_or_else(|| self.is_no("a number"))?;
        if (low..=high).contains(&x) {
            return Ok(x);
        }
        let fault = self.fault("the number is out of range").found(x);
        Err(fault.allowed(format!("{low} to {high}")).invalid())
    }

    /// `N` numbers, none larger than `most`.
    pub fn numbers<const N: usize>(&self, most: f64) -> Result<[f64; N], IoError> {
        let items = self.items(N.max(64))?;
        if items.len() != N {
            let fault = self.fault("another count of numbers is expected here");
            return Err(fault.found(items.len()).allowed(N).invalid());
        }
        let mut out = [0.0; N];
        for (o, item) in out.iter_mut().zip(&items) {
            *o = item.number_in(-most, most)?;
        }
        Ok(out)
    }

    /// Yes or no, also as 1 or 0.
    pub fn flag(&self) -> Result<bool, IoError> {
        match self.value.as_bool() {
            Some(b) => Ok(b),
            None => Ok(self.number_in(0.0, 1.0)? != 0.0),
        }
    }
}
