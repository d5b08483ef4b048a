//! One room at a time: the posed body, the detector, the fit.

use std::path::Path;

use muslin_body::{Avatar, Keypoints, Pose};
use muslin_fit::detect::{Models, find_people};
use muslin_fit::solve::{FitOptions, Fitter};
use muslin_io::{PhotoLimits, flatten, read_photo};

use super::clock::{Timing, least_of, load};
use super::{crowd, needed};
use crate::dress::{file_failure, models};
use crate::failure::Failure;
use crate::figure::body_failure;
use crate::table::Table;

/// How often a figure is taken.
const RUNS: usize = 20;

fn head() -> Table {
    Table::new(&["what", "least of 20 runs"])
}

fn done(table: &Table) -> String {
    format!("{}\n{}", table.text(), load())
}

/// One posed body: shape to rest pose, then rest pose to pose.
pub fn body() -> Result<String, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let shape = crowd::stranger(1);
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let pose = Pose::stance(&avatar, &figure, "walk").map_err(|e| body_failure(&e))?;
    let mut table = head();
    table.row([
        "shape to figure",
        &least_of(RUNS, || avatar.figure(&shape)).text(),
    ]);
    table.row([
        "figure to posed body",
        &least_of(RUNS, || avatar.pose(&figure, &pose)).text(),
    ]);
    Ok(done(&table))
}

/// Detector and landmarks on every photo, one thread.
pub fn pose(data: Option<&Path>) -> Result<String, Failure> {
    let models = models()?;
    let mut table = Table::new(&[
        "photo",
        "people",
        "detector and landmarks, least of 20 runs",
    ]);
    for path in crowd::photos(needed(data)?)? {
        let photo = read_photo(&path, &PhotoLimits::default()).map_err(|e| file_failure(&e))?;
        let image = flatten(&photo.image, [255; 3]);
        let people = find_people(&models, &image).people.len();
        let time = least_of(RUNS, || find_people(&models, &image));
        table.row([photo.file, people.to_string(), time.text()]);
    }
    Ok(done(&table))
}

/// The fit on every person of every photo, with and without points in space.
pub fn fit(data: Option<&Path>) -> Result<String, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let fitter = Fitter::new(&avatar)
        .map_err(|e| Failure::new(crate::Exit::Invalid, "fit", e.to_string()))?;
    let models = models()?;
    let mut table = Table::new(&[
        "photo",
        "reprojection px",
        "with 3D",
        "2D only",
        "photo to body",
    ]);
    for path in crowd::photos(needed(data)?)? {
        let photo = read_photo(&path, &PhotoLimits::default()).map_err(|e| file_failure(&e))?;
        table.row(fit_row(&fitter, &models, &photo));
    }
    Ok(done(&table))
}

fn fit_row(fitter: &Fitter, models: &Models, photo: &muslin_io::Photo) -> [String; 5] {
    let image = flatten(&photo.image, [255; 3]);
    let found = find_people(models, &image);
    let Some(person) = found.people.first() else {
        return [
            photo.file.clone(),
            "nobody".into(),
            String::new(),
            String::new(),
            String::new(),
        ];
    };
    let flat = Keypoints {
        world: None,
        ..person.keypoints.clone()
    };
    let fit = |k: &Keypoints| fitter.fit(k, &FitOptions::default());
    let px = match fit(&person.keypoints) {
        Ok(fit) => format!("{:.2}", fit.reprojection_px),
        Err(e) => e.to_string(),
    };
    let both = [&person.keypoints, &flat].map(|k| least_of(RUNS, || fit(k)));
    let whole: Timing = least_of(10, || {
        let found = find_people(models, &image);
        found.people.first().map(|p| fit(&p.keypoints))
    });
    [
        photo.file.clone(),
        px,
        both[0].text(),
        both[1].text(),
        whole.text(),
    ]
}
