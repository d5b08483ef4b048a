//! What may be asked of `dress`.

use std::path::{Path, PathBuf};

use muslin_garment::Cut;

use crate::fabric::has_kind;
use crate::failure::{Exit, Failure};
use crate::size::Size;

/// Which of the people in a photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Person {
    /// The one that fills most of the picture.
    Largest,
    /// The n-th from the largest, from 1.
    Nth(usize),
    /// Everybody, each in a folder of their own, even if it is one.
    All,
}

/// One garment of an outfit, by name or file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wear {
    /// The garment, such as `tee`, or a file such as `shirt.json`.
    pub garment: String,
    /// The fabric; the garment's own when absent.
    pub fabric: Option<String>,
}

impl Wear {
    /// Reads `garment` or `garment:fabric`; a colon before a folder belongs to the garment's file, unless what follows is
    /// a fabric's, and every colon of a file that is there.
    pub fn parse(text: &str) -> Self {
        if Path::new(text).is_file() {
            return Self {
                garment: text.to_owned(),
                fabric: None,
            };
        }
        let at = text.rfind(':').map(|at| {
            // The colon of a drive, as in `tee:C:\\mine.toml`.
            let before = &text[..at];
            let is_drive = text[at + 1..].starts_with(['/', '\\'])
                && before.len() > 2
                && before.as_bytes()[at - 2] == b':'
                && before.as_bytes()[at - 1].is_ascii_alphabetic();
            if is_drive { at - 2 } else { at }
        });
        match at.map(|at| (&text[..at], &text[at + 1..])) {
            Some((g, f)) if !f.contains(['/', '\\']) || (g.len() > 1 && has_kind(f)) => Self {
                garment: g.to_owned(),
                fabric: Some(f.to_owned()),
            },
            _ => Self {
                garment: text.to_owned(),
                fabric: None,
            },
        }
    }
}

/// What lies behind the figure in the pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backdrop {
    /// A soft studio wall and floor.
    #[default]
    Studio,
    /// White, with the shadow on the floor.
    White,
    /// Nothing: transparent pixels.
    Transparent,
}

/// Options of `dress`; the default is what a stranger would want.
#[derive(Clone, Debug)]
pub struct DressOptions {
    /// What to wear, innermost first.
    pub outfit: Vec<Wear>,
    /// A rigged character in place of our own body: `.glb`, `.gltf` or `.vrm`.
    pub body: Option<PathBuf>,
    /// Standing height [m]; exact when given.
    pub height: Option<f64>,
    /// Body weight [kg].
    pub weight: Option<f64>,
    /// 0 male to 1 female on the body's own scale; between when unknown.
    pub gender: Option<f64>,
    /// Whom to dress.
    pub person: Person,
    /// How loosely.
    pub cut: Cut,
    /// What the label says; made to measure when absent.
    pub size: Option<Size>,
    /// Triangle edge of the garments [m], 0.005 to 0.025.
    pub edge: f64,
    /// Deliver cloth that crosses itself, and what moves also where it meets the body.
    pub allow_crossings: bool,
    /// Solve from the body at rest, also where trained garments know how they lie.
    pub simulate: bool,
    /// Also draw the fitted body over the photo.
    pub overlay: bool,
    /// Behind the figure.
    pub backdrop: Backdrop,
}

impl Default for DressOptions {
    fn default() -> Self {
        Self {
            outfit: vec![Wear::parse("trousers"), Wear::parse("tee")],
            body: None,
            height: None,
            weight: None,
            gender: None,
            person: Person::Largest,
            cut: Cut::Regular,
            size: None,
            edge: 0.012,
            allow_crossings: false,
            simulate: false,
            overlay: false,
            backdrop: Backdrop::Studio,
        }
    }
}

impl DressOptions {
    /// Refuses numbers that no adult and no cloth has.
    pub fn check(&self) -> Result<(), Failure> {
        within(
            "--height",
            "cm",
            self.height.map(|h| h * 100.0),
            (120.0, 230.0),
        )
        .map_err(|f| match self.height.is_some_and(|h| h < 0.03) {
            true => f.hint("heights are in centimetres: 175 is 1.75 m"),
            false => f,
        })?;
        if let (Some(_), Some(name)) = (&self.body, self.shaped()) {
            let what = "a character has a shape of its own";
            let fault = Failure::new(Exit::Usage, "own-shape", what).at(name);
            return Err(fault.hint("leave it out; --height sets a character's size"));
        }
        within("--weight", "kg", self.weight, (30.0, 250.0))?;
        within("--gender", "", self.gender, (0.0, 1.0))?;
        within("--edge", "mm", Some(self.edge * 1000.0), (5.0, 25.0))
    }

    /// An option that shapes our own body, if given.
    fn shaped(&self) -> Option<&'static str> {
        let given = [
            ("--weight", self.weight.is_some()),
            ("--gender", self.gender.is_some()),
        ];
        given.into_iter().find(|g| g.1).map(|g| g.0)
    }
}

/// Refuses a value outside the range; `name` is the option's.
pub(crate) fn within(
    name: &str,
    unit: &str,
    value: Option<f64>,
    (low, high): (f64, f64),
) -> Result<(), Failure> {
    match value {
        Some(v) if !(low..=high).contains(&(v * (1.0 + 1e-12))) && !(low..=high).contains(&v) => {
            let short = |x: f64| (x * 1e4).round() / 1e4;
            let value = format!("{} {unit}", short(v));
            let what = format!(
                "{} is out of range (allowed {} to {})",
                value.trim_end(),
                short(low),
                short(high)
            );
            Err(Failure::new(Exit::Usage, "out-of-range", what).at(name))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_height_in_metres_by_mistake_is_refused() {
        let options = DressOptions {
            height: Some(0.0172),
            ..Default::default()
        };
        let f = options.check().unwrap_err();
        assert_eq!((f.exit, f.place.as_str()), (Exit::Usage, "--height"));
        assert!(DressOptions::default().check().is_ok());
    }

    #[test]
    fn a_fabric_follows_a_colon() {
        assert_eq!(Wear::parse("tee:denim").fabric.as_deref(), Some("denim"));
        assert_eq!(Wear::parse("tee").fabric, None);
        let file = Wear::parse("C:\\wardrobe\\shirt.json:denim");
        assert_eq!(file.garment, "C:\\wardrobe\\shirt.json");
        assert_eq!(Wear::parse("C:\\shirt.obj").fabric, None);
        assert_eq!(Wear::parse("C:\\shirt.json").fabric, None);
        for fabric in ["fabrics/own.toml", "/home/me/own.u3m", "C:\\mine\\own.toml"] {
            for garment in ["tee", "C:\\wardrobe\\shirt.obj"] {
                let worn = Wear::parse(&format!("{garment}:{fabric}"));
                assert_eq!(worn.garment, garment);
                assert_eq!(worn.fabric.as_deref(), Some(fabric));
            }
        }
    }
}
