//! Who is measured: random adults, and poses taken from recordings.

use std::path::{Path, PathBuf};

use muslin_body::retarget::{Recording, retarget};
use muslin_body::{Avatar, Figure, PHENOTYPES, Pose, Shape};
use muslin_garment::Cut;
use muslin_io::{bvh, read_file};

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::options::{DressOptions, Wear};

/// Largest recording read [bytes].
const CAP: u64 = 64 << 20;

/// A sequence of numbers in 0 to 1 that is the same everywhere (SplitMix64).
pub struct Dice(pub u64);

impl Dice {
    /// The next number.
    pub fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64
    }
}

/// A random adult: every phenotype anywhere in its range but for its last tenth at either end.
pub fn stranger(seed: u64) -> Shape {
    let mut dice = Dice(seed.wrapping_mul(0x5851_f42d_4c95_7f2d));
    let mut shape = Shape::default();
    for (name, value) in PHENOTYPES.iter().zip(&mut shape.phenotypes) {
        let (low, high) = if *name == "age" {
            (2.0 / 3.0, 1.0)
        } else {
            (0.0, 1.0)
        };
        *value = low + (high - low) * (0.1 + 0.8 * dice.roll());
    }
    shape
}

/// What strangers wear, innermost first.
const WORN: [&[&str]; 10] = [
    &["tee"],
    &["long-sleeve"],
    &["trousers"],
    &["shorts"],
    &["skirt"],
    &["dress"],
    &["trousers", "tee"],
    &["shorts", "long-sleeve"],
    &["skirt", "tee"],
    &["trousers", "dress"],
];
/// What it is made of.
const MADE_OF: [&str; 7] = [
    "cotton-shirting",
    "cotton-jersey",
    "silk-charmeuse",
    "wool-suiting",
    "denim",
    "polyester-lining",
    "nylon-taffeta",
];

/// A random outfit: one garment or two that are worn together, each of any fabric, in any cut.
pub fn outfit(seed: u64) -> DressOptions {
    let mut dice = Dice(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let mut one_of = |n: usize| ((dice.roll() * n as f64) as usize).min(n - 1);
    let garments = WORN[one_of(WORN.len())].iter();
    let wear = garments.map(|g| Wear::parse(&format!("{g}:{}", MADE_OF[one_of(MADE_OF.len())])));
    let outfit = wear.collect();
    let cut = [Cut::Slim, Cut::Regular, Cut::Loose][one_of(3)];
    DressOptions {
        outfit,
        cut,
        ..Default::default()
    }
}

/// A moment of a recording.
pub struct Moment {
    /// File and frame, for reports.
    pub name: String,
    recording: std::sync::Arc<Recording>,
    frame: usize,
}

impl Moment {
    /// The pose of that moment on a figure.
    pub fn pose(&self, avatar: &Avatar, figure: &Figure) -> Result<Pose, Failure> {
        let mut pose = retarget(avatar, figure, &self.recording, self.frame)
            .map_err(|e| body_failure(&e).at(self.name.clone()))?;
        // Travel does not matter to a still.
        pose.root = glam::DVec3::new(0.0, pose.root.y, 0.0);
        Ok(pose)
    }
}

/// Recordings that may be used for figures that are published.
const CLIPS: [&str; 4] = ["cmu-bvh", "cmu-fbx-as-bvh", "makehuman-poses", "reactidle"];

/// `count` moments spread over the recordings under `data/motion`.
pub fn moments(data: &Path, count: usize) -> Result<Vec<Moment>, Failure> {
    let mut files: Vec<PathBuf> = Vec::new();
    for folder in CLIPS {
        let entries = std::fs::read_dir(data.join("motion").join(folder));
        files.extend(entries.into_iter().flatten().flatten().map(|e| e.path()));
    }
    files.retain(|p| p.extension().is_some_and(|e| e == "bvh"));
    files.sort();
    if files.is_empty() {
        let what = "no recordings under motion/";
        return Err(Failure::new(Exit::Files, "no-data", what).at(data.display().to_string()));
    }
    let mut dice = Dice(7);
    let pick = |k: usize| k * files.len() / count.max(1);
    let mut out = Vec::new();
    for k in 0..count {
        let path = &files[pick(k) % files.len()];
        let input = read_file(path, CAP).map_err(|e| file_failure(&e))?;
        let read = bvh::read(&input.file, &input.bytes).map_err(|e| file_failure(&e))?;
        let n = read.recording.frames.len();
        let frame = ((0.1 + 0.85 * dice.roll()) * n as f64) as usize;
        let stem = path
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default();
        let name = format!("{stem} frame {frame}");
        out.push(Moment {
            name,
            recording: read.recording.into(),
            frame,
        });
    }
    Ok(out)
}

/// The photos under `data/photos`, in order of their names.
pub fn photos(data: &Path) -> Result<Vec<PathBuf>, Failure> {
    let folder = data.join("photos");
    let entries = std::fs::read_dir(&folder).map_err(|e| {
        Failure::new(Exit::Files, "no-data", e.to_string()).at(folder.display().to_string())
    })?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    files.retain(|p| {
        p.extension()
            .is_some_and(|e| e == "jpg" || e == "png" || e == "webp")
    });
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strangers_are_adults_and_differ() {
        assert!(stranger(1).check().is_ok());
        assert_ne!(stranger(1), stranger(2));
        assert_eq!(stranger(3), stranger(3));
    }

    #[test]
    fn all_that_strangers_wear_is_there() {
        let all: Vec<DressOptions> = (1..200).map(outfit).collect();
        for name in WORN.concat() {
            assert!(
                all.iter()
                    .any(|o| o.outfit.iter().any(|w| w.garment == name))
            );
        }
        for name in MADE_OF {
            let has = |w: &Wear| w.fabric.as_deref() == Some(name);
            assert!(all.iter().any(|o| o.outfit.iter().any(has)));
        }
    }
}
