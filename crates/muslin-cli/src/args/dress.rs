//! `dress` and `demo`.

use std::path::PathBuf;

use clap::Args;
use muslin::{DressOptions, Person};

use super::common::{BackdropName, Telling, Wearing};

/// Options of `dress`.
#[derive(Debug, Args)]
pub struct Dress {
    /// Photo that shows one whole person (JPEG, PNG or WebP); or none, with --pose.
    #[arg(required_unless_present = "pose")]
    pub photo: Option<PathBuf>,
    /// Dress the standard body in a built-in pose instead of a photo (see `muslin list poses`).
    #[arg(long, conflicts_with_all = ["photo", "overlay", "person"])]
    pub pose: Option<String>,
    /// Options shared with `demo`.
    #[command(flatten)]
    pub common: Common,
}

/// Options of `demo`.
#[derive(Debug, Args)]
pub struct Demo {
    /// Options shared with `dress`.
    #[command(flatten)]
    pub common: Common,
}

/// What `dress` and `demo` share.
#[derive(Debug, Args)]
pub struct Common {
    /// Who wears what.
    #[command(flatten)]
    pub wearing: Wearing,
    /// Whom to dress when there are several: a number from 1 (the largest), or `all`.
    #[arg(long, value_parser = person)]
    pub person: Option<Person>,
    /// Solve the whole way from the body at rest, instead of starting from how trained garments of the
    /// wardrobe say that they lie.
    #[arg(long)]
    pub simulate: bool,
    /// Write the result even if the cloth crosses itself somewhere; never where it meets the body.
    #[arg(long)]
    pub allow_crossings: bool,
    /// Also draw the fitted body over the photo (overlay.png).
    #[arg(long)]
    pub overlay: bool,
    /// What lies behind the figure.
    #[arg(long, value_enum, default_value_t = BackdropName::Studio)]
    pub backdrop: BackdropName,
    /// Folder for the results.
    #[arg(short, long, default_value = "out")]
    pub out: PathBuf,
    /// How it is told.
    #[command(flatten)]
    pub telling: Telling,
}

impl Common {
    /// The same in the library's words.
    pub fn options(&self) -> DressOptions {
        DressOptions {
            person: self.person.unwrap_or(Person::Largest),
            simulate: self.simulate,
            allow_crossings: self.allow_crossings,
            overlay: self.overlay,
            backdrop: self.backdrop.into(),
            ..self.wearing.options(DressOptions::default())
        }
    }
}

fn person(text: &str) -> Result<Person, String> {
    match text.parse::<usize>() {
        _ if text == "all" => Ok(Person::All),
        Ok(n) if n > 0 => Ok(Person::Nth(n)),
        _ => Err("a number from 1, or `all`".to_owned()),
    }
}
