//! One room at a time: the posed body, the detector, the fit.

use std::path::Path;

use muslin_body::{Avatar, Keypoints, Pose};
use muslin_fit::detect::{Models, find_people};
use muslin_fit::solve::{FitOptions, Fitter};
use muslin_fit::trial::{RoundTrip, round_trip};
use muslin_io::{PhotoLimits, flatten, read_photo};

use super::clock::{Timing, least_of, load};
use super::{crowd, needed};
use crate::dress::{file_failure, models};
use crate::failure::Failure;
use crate::figure::body_failure;
use crate::table::Table;

/// How often a figure is taken.
const RUNS: usize = 20;
/// The same, where there are many figures.
const FEW: usize = 10;

/// Made-up bodies that are found again.
const TRIPS: std::ops::Range<u64> = 100..130;

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

/// The fit on the largest person of every photo, with and without points in space; the way from
/// a photo to a posed body; and made-up bodies found again from their own exact points.
///
/// The photos take turns, so that a busy moment of the machine does not fall on one of them alone.
/// The whole takes about a minute.
pub fn fit(data: Option<&Path>) -> Result<String, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let fitter = Fitter::new(&avatar)
        .map_err(|e| Failure::new(crate::Exit::Invalid, "fit", e.to_string()))?;
    let models = models()?;
    let rooms = (&avatar, &fitter, &models);
    let mut all = Vec::new();
    for path in crowd::photos(needed(data)?)? {
        let photo = read_photo(&path, &PhotoLimits::default()).map_err(|e| file_failure(&e))?;
        all.push((path, photo, [f64::INFINITY; 5]));
    }
    for round in 1..=FEW {
        for (path, photo, least) in &mut all {
            let figures = fit_figures(rooms, (path, photo)).unwrap_or([f64::NAN; 5]);
            (0..5).for_each(|k| least[k] = figures[k].min(least[k]));
        }
        eprintln!("round {round} of {FEW}");
    }
    let mut table = Table::new(&[
        "photo (CPU ms, least of 10 runs)",
        "px",
        "with 3D",
        "2D only",
        "pixels to body",
        "file to body",
    ]);
    let mut worst = [0.0f64; 5];
    for (_, photo, least) in &all {
        if least[0].is_finite() {
            fit_row(&mut table, &photo.file, *least);
            (0..5).for_each(|k| worst[k] = worst[k].max(least[k]));
        } else {
            table.row([photo.file.as_str(), "nobody", "", "", "", ""]);
        }
    }
    fit_row(&mut table, "worst", worst);
    fit_row(
        &mut table,
        "to be at most",
        [f64::NAN, 3.0, 10.0, 40.0, f64::NAN],
    );
    Ok(format!(
        "{}\n{}\n{}",
        table.text(),
        round_trips(&fitter),
        load()
    ))
}

/// Mean distance of the points [px], then times [ms]: fits with and without points in space,
/// and the way to a posed body from pixels and from the file.
fn fit_figures(
    (avatar, fitter, models): (&Avatar, &Fitter, &Models),
    (path, photo): (&Path, &muslin_io::Photo),
) -> Option<[f64; 5]> {
    let image = flatten(&photo.image, [255; 3]);
    let fit = |k: &Keypoints| fitter.fit(k, &FitOptions::default()).ok();
    let posed = |image: &muslin_geom::Image| {
        let found = find_people(models, image);
        let fit = fit(&found.people.first()?.keypoints)?;
        let figure = avatar.figure(&fit.shape).ok()?;
        Some(avatar.pose(&figure, &fit.pose))
    };
    let seen = find_people(models, &image)
        .people
        .into_iter()
        .next()?
        .keypoints;
    let flat = Keypoints {
        world: None,
        ..seen.clone()
    };
    Some([
        fit(&seen)?.reprojection_px,
        spent(least_of(1, || fit(&seen))),
        spent(least_of(1, || fit(&flat))),
        spent(least_of(1, || posed(&image))),
        spent(least_of(1, || {
            let photo = read_photo(path, &PhotoLimits::default()).ok()?;
            posed(&flatten(&photo.image, [255; 3]))
        })),
    ])
}

/// Processor time where the system tells it, else time on the wall [ms].
fn spent(timing: Timing) -> f64 {
    timing.cpu.unwrap_or(timing.wall)
}

fn fit_row(table: &mut Table, name: &str, figures: [f64; 5]) {
    let [a, b, c, d, e] = told(figures);
    table.row([name.to_owned(), a, b, c, d, e]);
}

fn told(figures: [f64; 5]) -> [String; 5] {
    figures.map(|x| match x.is_nan() {
        true => String::new(),
        false => format!("{x:.2}"),
    })
}

/// The worst of some made-up bodies.
fn round_trips(fitter: &Fitter) -> String {
    let one = |seed: u64| {
        let trip = round_trip(fitter, seed)?;
        let (mm, degrees) = (1e3 * trip.points, trip.bones.to_degrees());
        eprintln!("body {seed}: points within {mm:.4} mm, bones within {degrees:.4} degrees");
        Some(trip)
    };
    let trips: Vec<RoundTrip> = TRIPS.filter_map(one).collect();
    let worst = |f: fn(&RoundTrip) -> f64| trips.iter().map(f).fold(0.0, f64::max);
    format!(
        "{} of {} bodies from their own exact points, nothing expected of them: points within \
         {:.4} mm (to be 1), bones within {:.4} degrees (to be 0.5)",
        trips.len(),
        TRIPS.count(),
        1e3 * worst(|t| t.points),
        worst(|t| t.bones).to_degrees()
    )
}
